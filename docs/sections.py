"""Two parts of docs/results.md, from result files alone: the summary at its top, and how far the patches carry."""

import json
import shutil
from pathlib import Path
from typing import Any

from toolkit.captures.read import POOLED
from toolkit.core.workspace import Workspace
from toolkit.sweeps.axes import AXES


def write_summary(summaries: dict[str, dict[str, Any]]) -> list[str]:
    """Markdown lines: per network and object bare against patched, from `summary.json` by the run's name.

    A run without pairs of a bare and a patched image has no row.
    """
    lines = [
        "| network | object | pairs | top-1 bare → patched | top-5 bare → patched | gain in top-1 | McNemar p |",
        "|---" * 7 + "|",
    ]
    for run, summary in summaries.items():
        groups = {(row["source"], row["object"], row["variant"]): row for row in summary["groups"]}
        tested = [pair for pair in summary["pairs"] if pair["variant"] == "patched"]
        sources = {pair["source"] for pair in tested}
        for pair in tested:
            source, name = pair["source"], pair["object"]
            bare, patched = groups[source, name, "unpatched"], groups[source, name, "patched"]
            n_objects = len({key[1] for key in groups if key[0] == source} - {POOLED})
            if bare["top1"] is None or patched["top1"] is None or (name == POOLED and n_objects == 1):
                continue
            shown = f"**all {n_objects}**" if name == POOLED else name
            gain = round(100 * (patched["top1"] - bare["top1"]))
            lines.append(
                f"| {run if len(sources) == 1 else f'{run}, {source}'} | {shown} | {pair['n_pairs']} "
                f"| {_percent(bare['top1'])} → {_percent(patched['top1'])} % "
                f"| {_percent(bare['top5'])} → {_percent(patched['top5'])} % | {gain:+d} | {_say_p(pair)} |"
            )
    return lines


def write_sweeps(space: Workspace, figures: Path, main_run: str = "resnet18") -> list[str]:
    """Markdown lines of every finished sweep, `eval/sweeps/AXIS/sweep-NAME.json`; none where there is no sweep.

    Figures are copied to `figures` as `sweep-AXIS.png`, those of other runs than `main_run` as `sweep-AXIS-NAME.png`.
    """
    lines: list[str] = []
    for axis in AXES.values():
        files = sorted((space.eval_dir / "sweeps" / axis.name).glob("sweep-*.json"))
        runs = {file.stem.removeprefix("sweep-"): file for file in files}
        for run in sorted(runs, key=lambda name: (name != main_run, name)):
            target = figures / (f"sweep-{axis.name}.png" if run == main_run else f"sweep-{axis.name}-{run}.png")
            shutil.copyfile(runs[run].with_suffix(".png"), target)
            content = json.loads(runs[run].read_text(encoding="utf-8"))
            lines += ["", f"### {axis.name.capitalize()}: {run}", "", *_write_table(content), ""]
            lines += [f"- not possible at {one['label']}: {one['reason']}" for one in content["skipped"]]
            lines += ["", f"![top-1 over {axis.title}, {run}](figures/{target.name})"]
    if not lines:
        return []
    intro = [
        "", "## How far it carries", "",
        "One thing varied by `toolkit sweep`, the rest kept: top-1 of all objects together, its 95 % interval, pairs",
        "gained and lost against the bare object with McNemar's p, then top-1 of each object.",
    ]  # fmt: skip
    return _single_blanks(intro + lines)


def _write_table(content: dict[str, Any]) -> list[str]:
    objects = [each["object"] for each in content["objects"]]
    whole = POOLED if len(objects) > 1 else objects[0]
    each = objects if len(objects) > 1 else []
    rows = {(row["label"], row["object"], row["variant"]): row for row in content["rows"]}
    pairs = {(row["label"], row["object"], row["variant"]): row for row in content["pairs"]}
    heads = [content["axis"], "variant", "n", "top-1", "95 % interval", "gained", "lost", "p", *each]
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for label in (value["label"] for value in content["values"]):
        for variant in content["variants"]:
            row, pair = rows.get((label, whole, variant)), pairs.get((label, whole, variant))
            if row is None or row["top1"] is None:
                continue
            low, high = row["ci95"]
            tests = [str(pair["gained"]), str(pair["lost"]), _say_p(pair)] if pair else ["", "", ""]
            others = [rows.get((label, name, variant)) for name in each]
            cells = [_say_value(content, label, row), variant, str(row["n"]), f"{_percent(row['top1'])} %"]
            cells += [f"{_percent(low)}–{_percent(high)} %", *tests]
            cells += ["–" if one is None or one["top1"] is None else f"{_percent(one['top1'])} %" for one in others]
            lines.append("| " + " | ".join(cells) + " |")
    return lines


def _say_value(content: dict[str, Any], label: str, row: dict[str, Any]) -> str:
    """A printed size with its share of the objects' longest side, where they agree; any other value as it is."""
    if content["axis"] == "size" and row["patch_share"]:
        return f"{row['value']:.3g} mm ({_percent(row['patch_share'])} % of the longest side)"
    return f"{row['value']:.3g} mm" if content["axis"] == "size" else label


def _percent(share: float) -> str:
    return f"{100 * share:.0f}"


def _say_p(pair: dict[str, Any]) -> str:
    return "< 0.0001" if pair["mcnemar_p"] < 1e-4 else f"{pair['mcnemar_p']:.2g}"


def _single_blanks(lines: list[str]) -> list[str]:
    return [line for i, line in enumerate(lines) if line or i == 0 or lines[i - 1]]
