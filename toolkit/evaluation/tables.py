"""Results on the console: a table for each source, the rig against photographs, and results in words."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Protocol, TypeVar

from rich.console import Console
from rich.table import Table

from toolkit.captures.capture import UNPATCHED
from toolkit.captures.read import POOLED
from toolkit.core.console import is_verbose
from toolkit.core.tables import (
    NONE,
    build_table,
    format_interval,
    format_kappa,
    format_p,
    format_percent,
    format_points,
    format_points_interval,
    format_rank,
)
from toolkit.core.text import count_of, list_some
from toolkit.evaluation.agreement import (
    ANSWER_HEADS,
    GAIN_HEADS,
    RendererAgreement,
    list_answers,
    list_colours,
    list_flips,
    list_gains,
)
from toolkit.evaluation.metrics import NO_PAIR, Comparison, Group
from toolkit.evaluation.origin import TITLE, Origin
from toolkit.evaluation.results import Findings, Training, describe_unseen, mark_seen
from toolkit.evaluation.sim_real import SimReal, place_of

MAX_ROWS, MAX_WRONG, MAX_LINES = 60, 12, 20
MAX_VERDICTS, MAX_OUTCOMES, MAX_NAMED = 8, 6, 3
LIMITS = ("images", "pairs", "note")
"""Headings of an origin that limit what a result shows."""
WHO = ("object", "variant")


class HasObject(Protocol):
    """A row of a table."""

    @property
    def object(self) -> str:
        """Name of the object; `all` for the pooled row."""


Row = TypeVar("Row", bound=HasObject)


def print_tables(console: Console, findings: Findings, network: str = "the network") -> None:
    """Print the verdicts, the numbers that decide, and what limits them; whole tables if the console is verbose."""
    verdicts = []
    for headline in findings.headlines:
        asked = f"{headline.question} " if headline.question else ""
        verdicts.append(f"{headline.source}: {asked}{headline.verdict}. {headline.sentence}")
    if is_verbose():
        _print_lines(console, verdicts)
        _print_all(console, findings)
    else:
        hidden = len(verdicts) - MAX_VERDICTS
        rest = [f"and {hidden} more verdicts, all in the report"] if hidden > 0 else []
        _print_lines(console, [*verdicts[:MAX_VERDICTS], *rest])
        console.print(build_outcomes(findings.groups, findings.pairs))
    origin = [] if findings.origin is None else list_origin(findings.origin)
    _print_lines(console, [*describe_unseen(network, findings.training), *findings.gate_lines, *origin])


def list_origin(origin: Origin) -> list[str]:
    """Return lines on what limits a result: images that do not count, and sources without a control.

    If the console is verbose, all of the origin is in them.
    """
    if is_verbose():
        return [TITLE, *(f"  {name}: {text}" for name, text in origin.lines())]
    lines = [
        f"{name}: {text}" for name, text in origin.lines() if name in LIMITS and text != f"{origin.counted} counted"
    ]
    without = [source.source for source in origin.sources if not source.controls]
    if without:
        lines.append(f"no control was shot ({list_some(without, MAX_NAMED)}): the report says how to shoot one")
    return lines


def _print_lines(console: Console, lines: Iterable[str]) -> None:
    for line in lines:
        console.print(line, markup=False, highlight=False, soft_wrap=True)


def _print_all(console: Console, findings: Findings) -> None:
    for table in build_tables(findings.groups, findings.pairs, count_gated(findings), findings.training):
        console.print(table)
        console.print()
    print_sim_real(console, findings.sim_real)
    print_agreement(console, findings.renderers)


def build_outcomes(groups: Sequence[Group], pairs: Sequence[Comparison]) -> Table:
    """Return a table of each object and booster against `unpatched`; of many rows only the pooled rows."""
    changes = {(pair.source, pair.object, pair.second): pair.outcomes for pair in pairs}
    paired = {source for source, _, _ in changes}
    # with a booster beside it, `unpatched` is the first number of a row
    rows = [group for group in groups if group.variant != UNPATCHED or group.source not in paired]
    # verdicts name the source if there is a single one
    heads = WHO if len({group.source for group in rows}) == 1 else ("source", *WHO)
    cells = []
    for group in pick_rows(rows, MAX_OUTCOMES):
        found = changes.get((group.source, group.object, group.variant))
        numbers = [f"{group.n_top1} of {group.n}", "", "", ""]
        if found is not None:
            correct = f"{found.n_first} → {found.n_second} of {found.n}"
            numbers = [correct, str(found.only_second), str(found.only_first), format_p(found.mcnemar_p)]
        cells.append([*(group.source, group.object, group.variant)[-len(heads) :], *numbers])
    return build_table("", heads, ("correct", "gained", "lost", "p"), cells, bold=POOLED)


def count_gated(findings: Findings) -> Counter[tuple[str, str, str]]:
    """Count the photographs that failed a gate, by source, object and variant, and pooled."""
    captures = [photo.capture for photo in findings.gated]
    return Counter((capture.source, name, capture.variant) for capture in captures for name in (capture.object, POOLED))


def pick_rows(rows: Sequence[Row], max_rows: int = MAX_ROWS) -> list[Row]:
    """Return the rows to show: without the pooled row of a single object; of too many rows only the pooled rows."""
    single = [row for row in rows if row.object != POOLED]
    if len({row.object for row in single}) == 1:
        return single
    return list(rows) if len(single) <= max_rows else [row for row in rows if row.object == POOLED]


def rows_by_source(
    groups: Sequence[Group], pairs: Sequence[Comparison], max_rows: int = MAX_ROWS
) -> Iterator[tuple[str, int, list[tuple[Group, Comparison | None]]]]:
    """Yield each source, its number of objects, and the rows to show with their pairs against `unpatched`."""
    paired = {(pair.source, pair.object, pair.second): pair for pair in pairs}
    for source in dict.fromkeys(group.source for group in groups):
        own = [group for group in groups if group.source == source]
        rows = [(row, paired.get((source, row.object, row.variant))) for row in pick_rows(own, max_rows)]
        yield source, len({group.object for group in own} - {POOLED}), rows


def build_tables(
    groups: Sequence[Group], pairs: Sequence[Comparison], gated: Mapping[tuple[str, str, str], int] | None = None,
    training: Sequence[Training] = (),
) -> list[Table]:  # fmt: skip
    """Return a table for each source: object × variant, then pooled rows; of more than 60 rows only the pooled rows.

    `gated` counts photographs that failed a gate, by source, object and variant. `training` adds a column if a booster
    was not trained on the network.
    """
    gated = gated or {}
    tables = []
    for source, n_objects, rows in rows_by_source(groups, pairs):
        # columns that only some sources need
        failed = ["failed"] if any(group.failed for group, _ in rows) else []
        gates = ["failed a gate"] if any(key[0] == source for key in gated) else []
        unseen = ["seen"] if any(booster.source == source and not booster.seen for booster in training) else []
        # if some images have no partner, a column compares the images in pairs
        alone = {group.object: group.n for group, _ in rows if group.variant == UNPATCHED}
        is_part = any(pair and {group.n, alone.get(group.object)} != {len(pair.pairs)} for group, pair in rows)
        both = ["in pairs"] if is_part else []
        numbers = ("n", *failed, *gates, *unseen, "top-1 %", "95 %", "top-5 %", "prob", *both, "gained", "lost", "p")
        cells = []
        for group, pair in rows:
            head = [group.object, group.variant, str(group.n), *(str(group.failed or "") for _ in failed)]
            head += [str(gated.get((source, group.object, group.variant), "")) for _ in gates]
            head += [mark_seen(training, source, group.object, group.variant) for _ in unseen]
            prob = NONE if group.mean_true_prob is None else f"{group.mean_true_prob:.2f}"
            interval = format_interval(group.top1_ci95) if group.n else NONE
            head += [format_percent(group.top1), interval, format_percent(group.top5), prob]
            if pair is None:
                cells.append([*head, *("" for _ in both), "", "", ""])
                continue
            found = pair.outcomes
            head += [f"{found.n_first} → {found.n_second} of {found.n}" for _ in both]
            cells.append([*head, str(found.only_second), str(found.only_first), format_p(found.mcnemar_p)])
        title = f"{source}: {count_of(n_objects, 'object')}"
        tables.append(build_table(title, WHO, numbers, cells, bold=POOLED))
    return tables


def print_sim_real(console: Console, comparisons: Sequence[SimReal]) -> None:
    """Print for each pair of sources the gap, the ranks, the gains, and the poses that were predicted wrongly."""
    for comparison in comparisons:
        pairs = f"{count_of(len(comparison.pairs), 'pair')} of images of the same pose"
        title = f"{comparison.sim} and {comparison.real}: {pairs}, rendered and photographed"
        # accuracy of rig and photographs
        gaps = []
        for row in pick_rows(comparison.rows):
            found = row.outcomes
            gap = f"{format_points(found.gain)} ({format_points_interval(found.gain_ci95)})"
            shares = [format_percent(count / found.n) for count in (found.n_first, found.n_second)]
            tests = [format_p(found.mcnemar_p), format_rank(row.rank)]
            gaps.append([row.object, row.second, str(found.n), *shares, gap, *tests])
        numbers = ("n", "rend. %", "phot. %", "gap (95 %)", "p", "rank correlation")
        console.print(build_table(title, WHO, numbers, gaps, bold=POOLED))
        # poses that the booster gains in each
        gains = []
        for forecast in pick_rows(comparison.forecasts):
            found = forecast.outcomes
            counts = (found.n, found.both, found.only_first, found.only_second, found.neither)
            points = [format_points(forecast.sim_gain), format_points(forecast.real_gain)]
            gains.append([forecast.object, forecast.variant, *map(str, counts), format_kappa(found.kappa), *points])
        if gains:
            heads = ("n", "both", "rend. only", "phot. only", "neither", "kappa", "+ rend.", "+ phot.")
            title = "poses gained over unpatched, foreseen by the rig or not"
            console.print(build_table(title, WHO, heads, gains, bold=POOLED))
        for line in _list_rest(comparison):
            console.print(line, markup=False, soft_wrap=True)
        console.print()


def print_agreement(console: Console, found: Sequence[RendererAgreement]) -> None:
    """Print, for each plan that several renderers shot, the gain in each, and where answers and colours differ."""
    for agreement in found:
        title = f"{', '.join(agreement.sources)}: {count_of(len(agreement.images[0]), 'image')} by each renderer"
        console.print(build_table(title, GAIN_HEADS[:2], GAIN_HEADS[2:], list_gains(agreement)))
        console.print(build_table("predictions agree", ANSWER_HEADS[:2], ANSWER_HEADS[2:], list_answers(agreement)))
        flips = list_flips(agreement)
        share = f"{len(agreement.flips)} of {len(agreement.images[0])}"
        lines = [f"correct in some renderers only, {share}:"] if flips else []
        lines += [f"  {line}" for line in flips[:MAX_WRONG]]
        if len(flips) > MAX_WRONG:
            lines.append(f"  and {len(flips) - MAX_WRONG} more lines, all in summary.json")
        for line in (*lines, *list_colours(agreement)):
            console.print(line, markup=False, soft_wrap=True)
        console.print()


def _list_rest(comparison: SimReal) -> list[str]:
    lines = []
    if comparison.wrong:
        marks = "− the photograph does worse, + better"
        lines.append(f"predicted wrongly, {len(comparison.wrong)} of {len(comparison.pairs)} ({marks}):")
        found: dict[str, list[str]] = {}
        for pair in comparison.wrong:
            name, variant, pose_id = place_of(pair)
            found.setdefault(f"{name} {variant}", []).append(f"{pose_id}{'+' if pair.is_gained else '−'}")
        lines += [f"  {who}: pose {', '.join(poses)}" for who, poses in list(found.items())[:MAX_WRONG]]
        if len(found) > MAX_WRONG:
            lines.append(f"  and {len(found) - MAX_WRONG} more lines, all in summary.json")
    # images without a match
    rest = ((comparison.real, comparison.unmatched_real), (comparison.sim, comparison.unmatched_sim))
    for name, left in rest:
        if left:
            images = "image" if len(left) == 1 else "images, the first"
            lines.append(f"not compared, {name}: {len(left)} {images} {left[0][0]}: {left[0][1]}")
    return lines


def list_unpaired(items: Sequence[tuple[str, str]], no_pairs: Sequence[tuple[str, int]]) -> list[str]:
    """Return lines on images without a partner; those that differ in more than the booster are counted by reason."""
    words = "than the unpatched: shoot both again"
    lines = [f"{count_of(count, 'pair')} not formed, {reason} {words}" for reason, count in no_pairs]
    rest = [(path, why) for path, why in items if not why.startswith(NO_PAIR)]
    return lines + list_lines("without a partner", rest)


def list_lines(title: str, items: Sequence[tuple[str, str]]) -> list[str]:
    """Return `title` and a line for each (path, reason), the rest counted; nothing without items."""
    if not items:
        return []
    lines = [f"{len(items)} {title}:", *(f"  {path}: {reason}" for path, reason in items[:MAX_LINES])]
    return lines if len(items) <= MAX_LINES else [*lines, f"  and {len(items) - MAX_LINES} more, all in summary.json"]
