"""The rig against photographs, as a table on the console."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from toolkit.captures.read import POOLED
from toolkit.evaluation.sim_real import FlipForecast, SimReal, SimRealRow
from toolkit.evaluation.sim_real_say import list_wrong, say_interval, say_kappa, say_points, say_rank

MAX_ROWS, MAX_WRONG = 60, 12


def print_sim_real(console: Console, comparisons: Sequence[SimReal]) -> None:
    """Print, for each pair of sources, the gap, the ranks, the gains, and the poses that were predicted wrongly."""
    for one in comparisons:
        console.print(_gaps(one))
        forecasts = pick_own(one.forecasts)
        if forecasts:
            console.print(_gains(forecasts))
        for line in _say_rest(one):
            console.print(line, markup=False, soft_wrap=True)
        console.print()


def pick_own(rows: Sequence, max_rows: int = MAX_ROWS) -> list:
    """The rows worth showing: the pooled alone when they are too many, none pooled for one object."""
    single = [row for row in rows if row.object != POOLED]
    if len({row.object for row in single}) == 1:
        return single
    return list(rows) if len(single) <= max_rows else [row for row in rows if row.object == POOLED]


def _gaps(one: SimReal) -> Table:
    table = _start(f"{one.sim} and {one.real}: {len(one.couples)} pairs of images of the same pose")
    for name in ("n", "sim %", "real %", "gap (95 %)", "p", "rank correlation"):
        table.add_column(name, justify="right", no_wrap=True)
    last = ""
    for row in pick_own(one.rows):
        table.add_row(*_head(row, last), *_numbers(row), style=_style(row))
        last = row.object
    return table


def _numbers(row: SimRealRow) -> list[str]:
    p = "<0.0001" if row.mcnemar_p < 1e-4 else f"{row.mcnemar_p:.2g}"
    gap = f"{say_points(row.gap)} ({say_interval(row.gap_ci95)})"
    shares = [f"{100 * count / row.n:.0f}" for count in (row.n_sim, row.n_real)]
    return [str(row.n), *shares, gap, p, say_rank(row.rank)]


def _gains(forecasts: Sequence[FlipForecast]) -> Table:
    table = _start("poses gained over unpatched, foreseen by the rig or not")
    for name in ("n", "both", "sim only", "real only", "neither", "kappa", "adds sim", "adds real"):
        table.add_column(name, justify="right", no_wrap=True)
    last = ""
    for row in forecasts:
        counts = [str(count) for count in (row.n, row.both, row.sim_only, row.real_only, row.neither)]
        adds = [say_points(row.sim_gain), say_points(row.real_gain)]
        table.add_row(*_head(row, last), *counts, say_kappa(row), *adds, style=_style(row))
        last = row.object
    return table


def _start(title: str) -> Table:
    table = Table(title=Text(title), title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("object", overflow="fold", min_width=6)
    table.add_column("variant", overflow="fold", min_width=9)
    return table


def _head(row: SimRealRow | FlipForecast, last: str) -> tuple[Text, Text]:
    return Text("" if row.object == last else row.object), Text(row.variant)


def _style(row: SimRealRow | FlipForecast) -> str:
    return "bold" if row.object == POOLED else ""


def _say_rest(one: SimReal) -> list[str]:
    lines = []
    if one.wrong:
        marks = "− the photograph does worse, + better"
        lines.append(f"predicted wrongly, {len(one.wrong)} of {len(one.couples)} ({marks}):")
        found = list_wrong(one.wrong)
        lines += [f"  {name} {variant}: pose {', '.join(poses)}" for name, variant, poses in found[:MAX_WRONG]]
        if len(found) > MAX_WRONG:
            lines.append(f"  and {len(found) - MAX_WRONG} more lines, all in summary.json")
    for name, left in ((one.real, one.unmatched_real), (one.sim, one.unmatched_sim)):
        if left:
            images = "image" if len(left) == 1 else "images, the first"
            lines.append(f"not compared, {name}: {len(left)} {images} {left[0][0]}: {left[0][1]}")
    return lines
