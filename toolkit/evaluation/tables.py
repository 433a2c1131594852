"""The result as a table on the console."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from toolkit.captures.read import POOLED
from toolkit.evaluation.metrics import Group, Pair
from toolkit.evaluation.results import EvaluationResult
from toolkit.evaluation.sim_real_text import print_sim_real

MAX_ROWS = 60


def print_tables(console: Console, result: EvaluationResult) -> None:
    """Print the tables of an evaluation, then each result in words."""
    for table in build_tables(result.groups, result.pairs):
        console.print(table)
        console.print()
    print_sim_real(console, result.sim_real)
    for headline in result.headlines:
        asked = f"{headline.question} " if headline.question else ""
        words = f"{headline.source}: {asked}{headline.verdict}. {headline.sentence}"
        console.print(words, markup=False, soft_wrap=True)


def build_tables(groups: Sequence[Group], pairs: Sequence[Pair]) -> list[Table]:
    """One table per source: object × variant, then the pooled rows where there are several objects.

    A source with more than 60 rows shows the pooled ones alone.
    """
    paired = {(pair.source, pair.object, pair.variant): pair for pair in pairs}
    tables = []
    for source in dict.fromkeys(group.source for group in groups):
        rows = pick_rows([group for group in groups if group.source == source], MAX_ROWS)
        n_objects = len({group.object for group in groups if group.source == source} - {POOLED})
        tables.append(_build(f"{source}: {n_objects} object{'s' if n_objects != 1 else ''}", rows, paired))
    return tables


def pick_rows(rows: Sequence[Group], max_rows: int) -> list[Group]:
    """The rows of one source worth showing: the pooled alone when they are too many, none pooled for one object."""
    single = [group for group in rows if group.object != POOLED]
    if len({group.object for group in single}) == 1:
        return single
    return list(rows) if len(single) <= max_rows else [group for group in rows if group.object == POOLED]


def _build(title: str, rows: Sequence[Group], paired: dict[tuple[str, str, str], Pair]) -> Table:
    has_failed = any(group.failed for group in rows)
    table = Table(title=Text(title), title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("object", overflow="fold", min_width=6)
    table.add_column("variant", overflow="fold", min_width=12)
    for name in ("n", *(["failed"] if has_failed else []), "top-1 %", "95 %", "top-5 %", "prob", "gained", "lost", "p"):
        table.add_column(name, justify="right", no_wrap=True)
    last = None
    for group in rows:
        pair = paired.get((group.source, group.object, group.variant))
        name = group.object if group.object != last else ""
        failed = [str(group.failed or "")] if has_failed else []
        style = "bold" if group.object == POOLED else ""
        table.add_row(
            Text(name), Text(group.variant), str(group.n), *failed, *_numbers(group), *_tests(pair), style=style
        )
        last = group.object
    return table


def _numbers(group: Group) -> list[str]:
    if group.top1 is None or group.top5 is None or group.mean_true_prob is None:
        return ["–", "–", "–", "–"]
    low, high = group.top1_ci95
    interval = f"{100 * low:.0f}–{100 * high:.0f}"
    return [f"{100 * group.top1:.0f}", interval, f"{100 * group.top5:.0f}", f"{group.mean_true_prob:.2f}"]


def _tests(pair: Pair | None) -> list[str]:
    if pair is None:
        return ["", "", ""]
    p = "<0.0001" if pair.mcnemar_p < 1e-4 else f"{pair.mcnemar_p:.2g}"
    return [str(pair.gained), str(pair.lost), p]
