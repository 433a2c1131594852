"""The benchmark in words, and as a table on the console."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from toolkit.benchmark.answers import READER, UNPATCHED
from toolkit.benchmark.summary import Summary
from toolkit.corruptions.catalogue import COMMON

if TYPE_CHECKING:
    from toolkit.benchmark.summary import Interval, Summary, VariantMean

FEW_NAMES, ROUNDING = 4, 1e-9
INITIALS = {"gaussian": "Gaussian", "jpeg": "JPEG"}


def say_corruption(name: str) -> str:
    """`JPEG compression` of `jpeg_compression`."""
    return " ".join(INITIALS.get(word, word) for word in name.split("_"))


def say_percent(share: float | None) -> str:
    """`61`, or a dash where there is none; a tenth more where rounding would hide that it is not 0 or 100."""
    if share is None:
        return "–"
    is_hidden = ROUNDING < share < 0.005 or 0.995 <= share < 1 - ROUNDING
    return f"{min(max(100 * share, 0.1), 99.9):.1f}" if is_hidden else f"{100 * share:.0f}"


def say_interval(interval: "Interval | None") -> str:
    """`55–67`, empty where there is none."""
    return f"{100 * interval[0]:.0f}–{100 * interval[1]:.0f}" if interval else ""


def say_points(share: float) -> str:
    """`-6`, `0`, `+11`: a difference of shares in percentage points."""
    points = round(100 * share)
    return "0" if points == 0 else f"{points:+d}".replace("-", "−")


def say_points_interval(interval: "Interval | None") -> str:
    """`-6 to +11`, empty where there is none."""
    return f"{say_points(interval[0])} to {say_points(interval[1])}" if interval else ""


def say_levels(severities: Sequence[int]) -> str:
    """`severity 3`, `severities 1, 2, 5`."""
    return f"severit{'y' if len(severities) == 1 else 'ies'} {', '.join(map(str, severities))}"


def say_mean(corruptions: Mapping[str, Sequence[int]], is_whole: bool) -> str:
    """Which corruptions and severities a mean is taken over, from the severities of each."""
    common = {name: tuple(severities) for name, severities in corruptions.items() if name in COMMON}
    if is_whole:
        return "mean of the 15 common corruptions at 5 severities"
    if not common:
        return "no mean: none of the 15 common corruptions was run"
    levels = set(common.values())
    same = f" at {say_levels(levels.pop())}" if len(levels) == 1 else ""
    if len(common) <= FEW_NAMES:
        own = (say_corruption(name) + ("" if same else f" at {say_levels(common[name])}") for name in common)
        names = f" ({'; '.join(own)})"
    else:
        names = ""
    which = "the 15 common corruptions" if len(common) == len(COMMON) else f"{len(common)} of the 15 corruptions"
    where = same or ("" if names else " at several severities")
    return f"mean of {which}{names}{where}: a part of the benchmark, so no mCE"


def name_row(summary: "Summary", row: "VariantMean") -> str:
    """The variant, and who answers where that is not the benchmark's own network."""
    is_own = row.answerer == _own_network(summary)
    return row.variant if is_own else f"{row.variant}, {row.answerer}"


def say_benchmark(summary: "Summary") -> list[str]:
    """A sentence for every variant and answerer; `unpatched` is in those that it is compared to, or alone."""
    return [sentence for _, sentence in judge_benchmark(summary)]


def judge_benchmark(summary: "Summary") -> list[tuple[str, str]]:
    """`say_benchmark` with each sentence's tone before it: `good`, `bad`, or `open` where nothing is shown."""
    compared = {row.answerer for row in summary.variants if summary.unpatched_of(row) is not None}
    return [
        _say_row(summary, row) for row in summary.variants if row.variant != UNPATCHED or row.answerer not in compared
    ]


def _say_row(summary: "Summary", row: "VariantMean") -> tuple[str, str]:
    what, share, ci95 = "corrupted", row.top1, row.top1_ci95
    wrong, not_decoded = row.wrong, row.not_decoded
    if share is None:
        what, share, ci95, wrong, not_decoded = "clean", row.clean_top1, None, row.clean_wrong, row.clean_not_decoded
    if share is None:
        return "open", f"{row.answerer} saw neither clean images with {row.variant} nor any of the 15 corruptions."
    how_many = _say_share(share, ci95)
    if row.kind == READER:
        rest = f"another on {say_percent(wrong)} %, none on {say_percent(not_decoded)} %"
        return "open", f"{row.answerer} reads the right code on {how_many} of {what} images with {row.variant}, {rest}."
    if row.variant == UNPATCHED:
        return "open", f"{row.answerer} recognises {how_many} of {what} images, without patches."
    sentence = f"{row.answerer} recognises {how_many} of {what} images with {row.variant}"
    before, difference = summary.unpatched_of(row), summary.differences_of(row).get("unpatched")
    if before is None:
        return "open", f"{sentence}."
    if difference is None:
        return "open", f"{sentence}, {_say_share(before.clean_top1 or 0.0, None)} without."
    sentence += f", {_say_share(before.top1 or 0.0, before.top1_ci95)} without"
    if difference.ci95 is None:
        return "open", f"{sentence}: {say_points(difference.difference)} points."
    tone = "good" if difference.ci95[0] > 0 else "bad" if difference.ci95[1] < 0 else "open"
    points = f"{say_points(difference.difference)} points ({say_points_interval(difference.ci95)})"
    return tone, f"{sentence}: {points}{'' if tone != 'open' else ', no difference shown'}."


def _say_share(share: float, ci95: "Interval | None") -> str:
    return f"{say_percent(share)} %" + (f" ({say_interval(ci95)})" if ci95 else "")


def _own_network(summary: "Summary") -> str:
    name = (summary.about.get("model") or {}).get("name")
    return name or next((row.answerer for row in summary.variants if row.kind != READER), "")


def build_table(summary: Summary) -> Table:
    """A line for each variant and answerer: clean, and the mean that its title names."""
    title = Text(f"{summary.n} images of {summary.n_classes} classes; {summary.mean_of}")
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("variant", overflow="fold", min_width=12)
    has_mce = any(row.mce_alexnet is not None for row in summary.variants)
    heads = ("clean %", "corrupted %", "95 %", "top-5 %", "not decoded %", *(["mCE %"] if has_mce else []))
    for name in (*heads, "to unpatched", "95 %"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in summary.variants:
        difference = summary.differences_of(row).get("unpatched")
        table.add_row(
            Text(name_row(summary, row)),
            say_percent(row.clean_top1),
            say_percent(row.top1),
            say_interval(row.top1_ci95),
            "" if row.top5 is None else say_percent(row.top5),
            "" if row.not_decoded is None else say_percent(row.not_decoded),
            *([f"{100 * row.mce_alexnet:.1f}" if row.mce_alexnet is not None else ""] if has_mce else []),
            say_points(difference.difference) if difference else "",
            say_points_interval(difference.ci95) if difference else "",
        )
    return table
