"""The tables in docs/results as CSV: from a workspace's evaluations and from docs/records, no number typed by hand."""

import csv
import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from toolkit.core.files import read_json, write_text
from toolkit.core.tables import FormattedNumber, decode_cell, encode_csv
from toolkit.core.workspace import Workspace
from toolkit.models.load import read_bundled
from toolkit.objects.records import PatchRecord, TextureRecord, read_patch, read_texture
from toolkit.rooms.benchmarks.challenge.score import Score, describe_rank
from toolkit.rooms.benchmarks.corruptions import CLEAN
from toolkit.rooms.benchmarks.corruptions.benchmark_summary import Summary, read_summary
from toolkit.rooms.benchmarks.sweeps.axes import AXES
from toolkit.rooms.benchmarks.transfer.leave_one_out import BOOSTED
from toolkit.rooms.wraps.wrap_booster import WRAP

DOCS = Path(__file__).resolve().parents[1]
RECORDS = DOCS / "records"
TABLES = DOCS / "results"
BENCHMARKS = ("photographs", "held", "cifar", "robust", "ablation")
"""Runs of the corruption benchmark whose `summary.json` lies in `records/benchmark`."""
BOOSTERS = BOOSTED | {WRAP.variant: "wrap"}
"""Names of the variants with a booster in the tables."""
Row = dict[str, Any]


def read_summaries(space: Workspace) -> dict[str, dict[str, Any]]:
    """Every run's `summary.json` by the run's name."""
    files = sorted(space.eval_dir.glob("*/summary.json"))
    return {file.parent.name: json.loads(file.read_text(encoding="utf-8")) for file in files}


def write_evaluation_tables(space: Workspace, folder: Path = TABLES) -> None:
    """`runs`, `captures`, `pairs`, `answers` and `sweeps`: what a finished workspace holds; other sweeps stay."""
    summaries, seen = read_summaries(space), list_networks(space)
    write_table(folder / "runs.csv", [describe_run(seen, run, each) for run, each in summaries.items()])
    write_table(folder / "captures.csv", [row for run, each in summaries.items() for row in list_groups(run, each)])
    write_table(folder / "pairs.csv", [row for run, each in summaries.items() for row in list_pairs(run, each)])
    answers = [
        {"run": run, **{key: one[key] for key in ("source", "question", "verdict", "sentence")}}
        for run, each in summaries.items()
        for one in each["controls"]["answers"]
    ]
    write_table(folder / "answers.csv", answers)
    write_renderer_tables(summaries, folder)
    sweeps = list(list_sweeps(space))
    write_table(folder / "sweeps.csv", sweeps + read_others(folder / "sweeps.csv", sweeps, "run", "axis"))
    if crossed := list(list_crossed(space)):
        write_table(folder / "tags.csv", crossed)


def write_renderer_tables(summaries: dict[str, dict[str, Any]], folder: Path = TABLES) -> None:
    """`renderers` and `renderer-answers`: the gain in each renderer, and how far every two agree; other runs stay."""
    agreements = [(run, one) for run, each in summaries.items() for one in each.get("renderers", [])]
    gains = [
        {
            "run": run, "renderer": one["renderers"][one["sources"].index(row["source"])],
            **{key: row[key] for key in ("source", "variant", "n_pairs", "n_first", "n_second", "gained", "lost")},
            "mcnemar_p": row["mcnemar_p"],
        }
        for run, one in agreements for row in one["gains"]
    ]  # fmt: skip
    answers = [
        {
            "run": run, "first": pair["first"], "second": pair["second"],
            **{key: row[key] for key in ("variant", "n", "same_answer", "kappa")},
            **{f"delta_e_{key}": value for key, value in (pair["colour"] or {}).items()},
        }
        for run, one in agreements for pair in one["pairs"] for row in pair["rows"]
    ]  # fmt: skip
    for name, rows in (("renderers", gains), ("renderer-answers", answers)):
        if rows:
            write_table(folder / f"{name}.csv", rows + read_others(folder / f"{name}.csv", rows, "run"))


def write_record_tables(space: Workspace, folder: Path = TABLES) -> None:
    """`patches`, `textures`, `rig18` and the benchmark's tables: from records that are in the repository."""
    sets = [space, *(space.with_patches(one) for one in space.patch_sets())]
    patches = [
        describe_patch(own.patch_set, read_patch(file).record) for own in sets for file in own.patches().values()
    ]
    write_table(folder / "patches.csv", patches)
    shipped = [read_texture(file).record for file in space.textures().values()]
    folders = (RECORDS / "gradients", DOCS.parent / "rig/textures/resnet18", RECORDS / "meshes")
    gradients, alone, meshes = map(_read_textures, folders)
    trained = [*gradients, *shipped, *alone, *meshes]
    write_table(folder / "textures.csv", [describe_texture(record) for record in trained])
    bundled = read_bundled()
    if bundled is not None:
        kinds = sorted(bundled.held_out.per_class.items())
        write_table(
            folder / "rig18.csv", [{"kind": name, "n": share.n, "correct": share.correct} for name, share in kinds]
        )
    for name in BENCHMARKS:
        summary = read_summary(RECORDS / "benchmark" / f"{name}.json")
        write_table(folder / f"benchmark-{name}.csv", list(list_variants(summary)))
        write_table(folder / f"benchmark-{name}-cells.csv", list(list_cells(summary)))
    write_table(folder / "challenge.csv", list(list_scores(RECORDS / "challenge")))
    networks = json.loads((RECORDS / "benchmark" / "robust-networks.json").read_text(encoding="utf-8"))
    write_table(folder / "robust-networks.csv", [describe_network(one) for one in networks])


def list_scores(folder: Path) -> Iterator[Row]:
    """Our own entries of the challenge in the order of their board, whose `board.csv` and scores lie in a folder."""
    with (folder / "board.csv").open(encoding="utf-8", newline="") as stream:
        placed = {row["entry"]: row for row in csv.DictReader(stream)}
    for name, place in placed.items():
        score = read_json(folder / f"{name}.json", Score)
        counted = describe_rank(score)
        left_out = ("authors", "link", "is_official", "networks", "unseen_judges")
        yield {"rank": place["rank"], **{key: counted[key] for key in counted if key not in left_out}} | {
            "p_next": float(place["p_next"]) if place["p_next"] else None,
            "trained_on": "; ".join(one.arch for one in score.entry.networks),
            "unseen": "; ".join(one.name for one in score.judges if not one.seen),
            "pictures": score.pooled[0].n // sum(not one.seen for one in score.judges) if score.pooled else None,
            "renderers": place["renderers"],
        }


def write_table(file: Path, rows: Sequence[Row]) -> None:
    """Write rows under the first row's keys; shares with four decimals."""
    if not rows:
        return
    heads = list(rows[0])
    write_text(file, encode_csv(heads, ([_write_value(row.get(key)) for key in heads] for row in rows)))


def read_others(file: Path, rows: Sequence[Row], *keys: str) -> list[Row]:
    """Rows that a table has by now of what was not measured again: whose `keys` none of the new rows has."""
    if not file.is_file():
        return []
    new = {tuple(row[key] for key in keys) for row in rows}
    with file.open(encoding="utf-8", newline="") as stream:
        before = [{name: decode_cell(cell) for name, cell in row.items()} for row in csv.DictReader(stream)]
    return [row for row in before if tuple(row[key] for key in keys) not in new]


NUMBER = re.compile(r"-?\d+(\.\d+)?(e-\d+)?")


def _write_value(value: object) -> object:
    if isinstance(value, float):
        value = f"{value:.3g}" if 0 < abs(value) < 0.001 else f"{value:.4f}".rstrip("0").rstrip(".")
    # a number below 0 is no formula
    return FormattedNumber(value) if isinstance(value, str) and NUMBER.fullmatch(value) else value


def list_networks(space: Workspace) -> dict[str, set[str]]:
    """The weights' hashes that a workspace's patches were trained on, and its textures."""
    records = {
        "patches": [read_patch(file).record for file in space.patches().values()],
        "textures": [read_texture(file).record for file in space.textures().values()],
    }
    return {kind: {one.sha256 for record in found for one in record.networks} for kind, found in records.items()}


def describe_run(seen: dict[str, set[str]], run: str, summary: dict[str, Any]) -> Row:
    """The network of a run, its crop, and whether the workspace's patches and textures were trained on it."""
    model = summary["model"]
    return {
        "run": run, "network": model["name"], "weights": model["weights"], "sha256": model["sha256"][:16],
        "preprocessing": model["preprocessing"].partition(", normalised")[0],
        **{f"{kind}_trained_on_it": "yes" if model["sha256"] in hashes else "no" for kind, hashes in seen.items()},
    }  # fmt: skip


def list_groups(run: str, summary: dict[str, Any]) -> Iterator[Row]:
    """One row per source, object and variant."""
    for group in summary["groups"]:
        low, high = group["top1_ci95"]
        yield {
            "run": run, "source": group["source"], "object": group["object"], "variant": group["variant"],
            "n": group["n"], "correct": round(group["top1"] * group["n"]), "top1": group["top1"], "top1_low": low,
            "top1_high": high, "top5": group["top5"], "mean_true_prob": group["mean_true_prob"],
        }  # fmt: skip


def list_pairs(run: str, summary: dict[str, Any]) -> Iterator[Row]:
    """Return a row for each source, object and variant, against the unmodified object at the same pose."""
    for pair in summary["pairs"]:
        names = {key: pair[key] for key in ("source", "object", "variant", "n_pairs", "gained", "lost", "mcnemar_p")}
        yield {"run": run, **names}


def list_changes(run: str, summary: dict[str, Any]) -> Iterator[Row]:
    """Return the rows of `list_pairs` with the correct images of the pairs, without the booster and with it."""
    right = {(one["source"], one["object"], one["variant"]): one["correct"] for one in list_groups(run, summary)}
    for pair in list_pairs(run, summary):
        source, name, variant = pair["source"], pair["object"], pair["variant"]
        boosted = right[source, name, variant]
        yield {
            "source": source, "object": name, "variant": variant, "n": pair["n_pairs"],
            "bare": boosted - pair["gained"] + pair["lost"], "boosted": boosted,
            "gained": pair["gained"], "lost": pair["lost"], "p": pair["mcnemar_p"],
        }  # fmt: skip


def list_crossed(space: Workspace) -> Iterator[Row]:
    """Every table of `toolkit sweep --cross`, `eval/sweeps/AXIS/cross-NAME.csv`."""
    for file in sorted(space.eval_dir.glob("sweeps/*/cross-*.csv")):
        with file.open(encoding="utf-8", newline="") as stream:
            yield from ({"run": file.stem.removeprefix("cross-"), **row} for row in csv.DictReader(stream))


def list_sweeps(space: Workspace) -> Iterator[Row]:
    """Every finished sweep of a workspace, `eval/sweeps/AXIS/sweep-NAME.json`."""
    for axis in AXES:
        for file in sorted((space.eval_dir / "sweeps" / axis).glob("sweep-*.json")):
            content = json.loads(file.read_text(encoding="utf-8"))
            pairs = {(one["label"], one["object"], one["variant"]): one for one in content["pairs"]}
            for row in content["rows"]:
                pair = pairs.get((row["label"], row["object"], row["variant"]), {})
                low, high = row["ci95"]
                yield {
                    "run": file.stem.removeprefix("sweep-"), "axis": axis, "value": row["label"],
                    "object": row["object"], "variant": row["variant"], "n": row["n"],
                    "correct": round((row["top1"] or 0) * row["n"]), "top1": row["top1"], "top1_low": low,
                    "top1_high": high, "gained": pair.get("gained"), "lost": pair.get("lost"),
                    "mcnemar_p": pair.get("mcnemar_p"),
                }  # fmt: skip


def describe_patch(patch_set: str | None, record: PatchRecord) -> Row:
    """Return a patch's training data and its print scores."""
    settings = record.settings
    return {
        "patch": record.name if patch_set is None else f"{patch_set}/{record.name}", "n_px": record.n_px,
        "size_mm": round(record.size_mm, 1),
        "networks": " + ".join(f"{net.weights} {net.sha256[:8]}" for net in record.networks),
        "data": " + ".join(f"{source['used']} images of {source['source']}" for source in record.data["sources"]),
        "mounted_views": settings.get("mounted_views", 0), "mounted_share": settings.get("mounted_share", 0),
        "steps": settings["steps"], "batch": settings["batch"], "lr": settings["lr"],
        "total_variation": record.final["total_variation"], "non_printability": record.final["non_printability"],
    }  # fmt: skip


def describe_texture(record: TextureRecord) -> Row:
    """Return a texture's accuracy on held-out views of its first network, clear and in fog, with it and without."""
    networks, final = [one.arch for one in record.networks], record.final
    shares = {
        f"{paint}_{weather}": final[f"{networks[0]}_{place}_{of}_top1"]
        for paint, of in (("bare", "bare"), ("textured", "patched"))
        for weather, place in (("studio", "held_out"), ("fog", "held_out_fog"))
    }
    return {
        "texture": record.name, "class": record.class_name, "objects": " + ".join(one.name for one in record.objects),
        "new_coordinates": "yes" if any(one.unwrapped for one in record.objects) else "no",
        "networks": " + ".join(networks), "gradient": record.settings["gradient"],
        "steps": record.settings["steps"], "last_loss": final["loss"], "last_recognised": final["accuracy"],
        "n": round(final[f"{networks[0]}_held_out_bare_n"]), **shares,
    }  # fmt: skip


def _read_textures(folder: Path) -> list[TextureRecord]:
    files = sorted(folder.glob("*.json"))
    return [TextureRecord.model_validate_json(file.read_text(encoding="utf-8")) for file in files]


def list_variants(summary: Summary) -> Iterator[Row]:
    """Means over the corruptions, one row for each variant and who answered."""
    changes = {(one.variant, one.answerer): one for one in summary.differences if one.against == "unpatched"}
    for row in summary.variants:
        change = changes.get((row.variant, row.answerer))
        low, high = row.top1_ci95
        change_low, change_high = change.ci95 if change else (None, None)
        yield {
            "variant": row.variant, "answered_by": row.answerer, "clean_top1": row.clean_top1,
            "corrupted_top1": row.top1, "low": low, "high": high, "change": change.difference if change else None,
            "change_low": change_low, "change_high": change_high, "corrupted_top5": row.top5, "mce": row.mce_alexnet,
            "relative_ce": row.mce_unpatched, "wrong": row.wrong, "not_decoded": row.not_decoded,
        }  # fmt: skip


def describe_network(record: Row) -> Row:
    """How a network was trained, and what it gets right, clean and under attack."""
    n, (low, high), (attacked_low, attacked_high) = record["n"], record["ci95"], record["attacked_ci95"]
    kept = {key: value for key, value in record.items() if not key.endswith("ci95")}
    return kept | {
        "top1": record["correct"] / n, "top1_low": low, "top1_high": high,
        "attacked_top1": record["attacked_correct"] / n, "attacked_low": attacked_low, "attacked_high": attacked_high,
    }  # fmt: skip


def list_cells(summary: Summary) -> Iterator[Row]:
    """Every variant under every corruption at every severity; severity 0 is the clean image."""
    for cell in summary.cells:
        if cell.corruption == CLEAN or cell.severity:
            yield {
                "variant": cell.variant, "answered_by": cell.answerer, "corruption": cell.corruption,
                "severity": cell.severity, "n": cell.n, "correct": cell.right, "top1": cell.top1,
                "gained": cell.gained, "lost": cell.lost, "mcnemar_p": cell.mcnemar_p,
            }  # fmt: skip
