"""The result of an evaluation in a world in words, and as a table on the console."""

from typing import TYPE_CHECKING, Any

from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.core.statistics import SIGNIFICANT
from toolkit.core.tables import NONE, build_table, format_interval, format_p, format_percent, format_points, format_test
from toolkit.evaluation.metrics import name_booster
from toolkit.evaluation.verdict import Verdict, find_tone
from toolkit.experiments.worlds.config import ABSENT
from toolkit.worlds.conditions import CLEAR

if TYPE_CHECKING:
    from rich.table import Table

Summary = dict[str, Any]
Row = dict[str, Any]


def pooled(summary: Summary) -> dict[tuple[str, str, int], Row]:
    """Groups over all places by variant, weather and severity."""
    return {
        (row["variant"], row["weather"], row["severity"]): row for row in summary["groups"] if row["place"] == POOLED
    }


def judge_world(summary: Summary) -> list[Verdict]:
    """A sentence on every variant in clear air, then on what each sees through each kind of weather.

    `good` and `bad` where both the interval over places and the paired test say so, else `open`.
    """
    groups = pooled(summary)
    variants = list(dict.fromkeys(row["variant"] for row in summary["groups"]))
    pairs = {row["variant"]: row for row in summary["pairs"] if (row["weather"], row["place"]) == (CLEAR[0], POOLED)}
    found = []
    for variant in variants:
        row = groups[variant, CLEAR[0], CLEAR[1]]
        who = f"{summary['model']['name']} has the {summary['about']['class']} among its first five guesses"
        sentence = f"In clear air {who} on {_share(row)} of {row['n']} pictures {_name(variant)}."
        tone, why = ("open", "") if variant == ABSENT else _judge_pair(pairs.get(variant))
        found.append(Verdict(tone, f"{sentence}{why}"))
    return found + [_judge_half(row) for row in summary["half_lost"] if row["variant"] != ABSENT]


def _name(variant: str) -> str:
    if variant == ABSENT:
        return "of the places without it"
    return "bare" if variant == UNPATCHED else f"with {name_booster(variant)}"


def _share(row: Row) -> str:
    interval = f" ({format_interval(row['top5_ci95'])})" if row["top5_ci95"] else ""
    return f"{format_percent(row['top5'])} %{interval}"


def _judge_pair(pair: Row | None) -> tuple[str, str]:
    if pair is None:
        return "open", ""
    interval, p = pair["difference_top5_ci95"], pair["mcnemar_p_top5"]
    points = format_points(pair["difference_top5"])
    limits = f" ({format_points(interval[0])} to {format_points(interval[1])})" if interval else ""
    tone = find_tone(interval) if p < SIGNIFICANT else "open"
    tests = f"{pair['gained_top5']} gained, {pair['lost_top5']} lost, {format_test(pair['mcnemar_p_top5'])}"
    return (
        tone,
        f" That is {points} points{limits} against bare: {tests}; over places p {format_p(pair['places_p_top5'])}.",
    )


def _judge_half(row: Row) -> Verdict:
    what = f"In {row['weather']}, {_name(row['variant'])}: "
    if not row["clear_top5"]:
        return Verdict("open", f"{what}nothing was recognised in clear air, so that nothing can be lost.")
    half = f"half of the recognitions are lost at a visibility of {format_visibility(row)}"
    if row["visibility_m"] is None:
        half = (
            f"half of the recognitions are not lost down to a visibility of {row['densest_m']:.3g} m, the least shown"
        )
    if row["times"] is None:
        return Verdict("open", f"{what}{half}.")
    same = f"The share that bare has left at its half is reached through {format_times(row, 'same_times')} as much."
    sentence = f"{what}{half}, through {format_times(row, 'times')} as much of it as bare. {same}"
    return Verdict(find_tone(row["same_times_ci95"], none=1), sentence)


def format_visibility(row: Row) -> str:
    """`42 m (95 % 35–51)`; `not reached` where half was not lost."""
    if row["visibility_m"] is None:
        return "not reached" if row["clear_top5"] else "–"
    interval = row["visibility_ci95"]
    if interval is None:
        return f"{row['visibility_m']:.3g} m"
    low, high = ("not reached" if one is None else f"{one:.3g}" for one in interval)
    return f"{row['visibility_m']:.3g} m (95 % {low}–{high})"


def format_times(row: Row, key: str) -> str:
    """A ratio of `half_lost`, `times` or `same_times`: `2.1 times (1.5–3.0)`."""
    value, interval = row[key], row[f"{key}_ci95"]
    if value is None:
        return NONE
    if row["times_is_bound" if key == "times" else "same_is_bound"]:
        return f"at least {value:.1f} times"
    if interval is None:
        return f"{value:.1f} times"
    low, high = ("?" if one is None else f"{one:.1f}" for one in interval)
    return f"{value:.1f} times ({low}{'–' + high if high != '?' else ' or more'})"


def build_world_table(summary: Summary) -> "Table":
    """A line for each variant and weather, over all places."""
    pairs = {
        (row["variant"], row["weather"], row["severity"]): row for row in summary["pairs"] if row["place"] == POOLED
    }
    cells = []
    for key, row in pooled(summary).items():
        pair = pairs.get(key)
        visibility = "" if row["visibility_m"] is None else f"{row['visibility_m']:.4g}"
        change = (
            [str(pair["gained_top5"]), str(pair["lost_top5"]), format_p(pair["mcnemar_p_top5"])] if pair else [""] * 3
        )
        name = row["weather"] if not row["severity"] else f"{row['weather']} {row['severity']}"
        cells.append([
            row["variant"], name, visibility, str(row["n"]), format_percent(row["top1"]), format_percent(row["top5"]),
            format_interval(row["top5_ci95"]), f"{row['mean_true_prob']:.2f}", *change,
        ])  # fmt: skip
    about = summary["about"]
    count = len(about["places"])
    title = f"{about['object']} in {about['world']}, {about['sky']}: {count} place{'s' if count > 1 else ''}"
    heads = ("vis. m", "n", "top-1 %", "top-5 %", "95 %", "prob", "gained", "lost", "p")
    return build_table(title, ("variant", "weather"), heads, cells)
