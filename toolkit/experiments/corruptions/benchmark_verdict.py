"""The benchmark in words, and as a table on the console."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from toolkit.captures.read import UNPATCHED
from toolkit.core.statistics import Interval
from toolkit.core.tables import (
    build_table,
    format_interval,
    format_percent,
    format_points,
    format_points_interval,
)
from toolkit.corruptions.catalogue import COMMON
from toolkit.evaluation.verdict import Verdict, find_tone
from toolkit.experiments.corruptions.recognisers import READER

if TYPE_CHECKING:
    from rich.table import Table

    from toolkit.experiments.corruptions.benchmark_summary import Summary, VariantMean

FEW_NAMES = 4
INITIALS = {"gaussian": "Gaussian", "jpeg": "JPEG"}


def name_corruption(name: str) -> str:
    """`JPEG compression` of `jpeg_compression`."""
    return " ".join(INITIALS.get(word, word) for word in name.split("_"))


def name_levels(severities: Sequence[int]) -> str:
    """`severity 3`, `severities 1, 2, 5`."""
    return f"severit{'y' if len(severities) == 1 else 'ies'} {', '.join(map(str, severities))}"


def describe_mean(corruptions: Mapping[str, Sequence[int]], is_whole: bool) -> str:
    """Which corruptions and severities a mean is taken over, from the severities of each."""
    common = {name: tuple(severities) for name, severities in corruptions.items() if name in COMMON}
    if is_whole:
        return "mean of the 15 common corruptions at 5 severities"
    if not common:
        return "no mean: none of the 15 common corruptions was run"
    levels = set(common.values())
    same = f" at {name_levels(levels.pop())}" if len(levels) == 1 else ""
    if len(common) <= FEW_NAMES:
        own = (name_corruption(name) + ("" if same else f" at {name_levels(common[name])}") for name in common)
        names = f" ({'; '.join(own)})"
    else:
        names = ""
    which = "the 15 common corruptions" if len(common) == len(COMMON) else f"{len(common)} of the 15 corruptions"
    where = same or ("" if names else " at several severities")
    return f"mean of {which}{names}{where}: a part of the benchmark, so no mCE"


def label_row(summary: "Summary", row: "VariantMean") -> str:
    """The variant, and who recognises where that is not the benchmark's own network."""
    is_own = row.answerer == _own_network(summary)
    return row.variant if is_own else f"{row.variant}, {row.answerer}"


def judge_benchmark(summary: "Summary") -> list[Verdict]:
    """A sentence on every variant and answerer: `good`, `bad`, or `open` where nothing is shown.

    `unpatched` is in those that it is compared to, or alone.
    """
    compared = {row.answerer for row in summary.variants if summary.unpatched_of(row) is not None}
    return [
        _judge_row(summary, row) for row in summary.variants if row.variant != UNPATCHED or row.answerer not in compared
    ]


def _judge_row(summary: "Summary", row: "VariantMean") -> Verdict:
    what, share, ci95 = "corrupted", row.top1, row.top1_ci95
    wrong, not_decoded = row.wrong, row.not_decoded
    if share is None:
        what, share, ci95, wrong, not_decoded = "clean", row.clean_top1, None, row.clean_wrong, row.clean_not_decoded
    if share is None:
        return Verdict(
            "open", f"{row.answerer} saw neither clean images with {row.variant} nor any of the 15 corruptions."
        )
    how_many = _format_share(share, ci95)
    if row.kind == READER:
        rest = f"another on {format_percent(wrong)} %, none on {format_percent(not_decoded)} %"
        sentence = f"{row.answerer} reads the right code on {how_many} of {what} images with {row.variant}, {rest}."
        return Verdict("open", sentence)
    if row.variant == UNPATCHED:
        return Verdict("open", f"{row.answerer} recognises {how_many} of {what} images, without patches.")
    sentence = f"{row.answerer} recognises {how_many} of {what} images with {row.variant}"
    before, difference = summary.unpatched_of(row), summary.differences_of(row).get("unpatched")
    if before is None:
        return Verdict("open", f"{sentence}.")
    if difference is None:
        return Verdict("open", f"{sentence}, {_format_share(before.clean_top1 or 0.0, None)} without.")
    sentence += f", {_format_share(before.top1 or 0.0, before.top1_ci95)} without"
    if difference.ci95 is None:
        return Verdict("open", f"{sentence}: {format_points(difference.difference)} points.")
    tone = find_tone(difference.ci95)
    points = f"{format_points(difference.difference)} points ({format_points_interval(difference.ci95)})"
    return Verdict(tone, f"{sentence}: {points}{'' if tone != 'open' else ', no difference shown'}.")


def _format_share(share: float, ci95: Interval | None) -> str:
    return f"{format_percent(share)} %" + (f" ({format_interval(ci95)})" if ci95 else "")


def _own_network(summary: "Summary") -> str:
    name = (summary.about.get("model") or {}).get("name")
    return name or next((row.answerer for row in summary.variants if row.kind != READER), "")


def build_summary_table(summary: "Summary") -> "Table":
    """A line for each variant and answerer: clean, and the mean that its title names."""
    has_mce = any(row.mce_alexnet is not None for row in summary.variants)
    mce = ["mCE %"] if has_mce else []
    heads = ("clean %", "corrupted %", "95 %", "top-5 %", "not decoded %", *mce, "to unpatched", "95 %")
    cells = []
    for row in summary.variants:
        difference = summary.differences_of(row).get("unpatched")
        cells.append(
            [
                label_row(summary, row),
                format_percent(row.clean_top1),
                format_percent(row.top1),
                format_interval(row.top1_ci95),
                "" if row.top5 is None else format_percent(row.top5),
                "" if row.not_decoded is None else format_percent(row.not_decoded),
                *("" if row.mce_alexnet is None else f"{100 * row.mce_alexnet:.1f}" for _ in mce),
                format_points(difference.difference) if difference else "",
                format_points_interval(difference.ci95) if difference else "",
            ]
        )
    title = f"{summary.n} images of {summary.n_classes} classes; {summary.mean_of}"
    return build_table(title, ["variant"], heads, cells)
