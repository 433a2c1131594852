"""The sweep as a table on the console: all objects together, and top-1 of each."""

from rich.table import Table
from rich.text import Text

from toolkit.captures.read import POOLED
from toolkit.sweeps.result import Sweep


def build_table(sweep: Sweep) -> Table:
    """A row per value and variant: n, top-1 and its interval, McNemar's p against bare, then top-1 of each object.

    A printed size is followed by its share of the longest side, where the objects agree on it.
    """
    one = len(sweep.objects) == 1
    name = next(iter(sweep.objects)) if one else POOLED
    rows = {(row.label, row.object, row.variant): row for row in sweep.rows}
    pairs = {(pair.label, pair.object, pair.variant): pair for pair in sweep.pairs}
    title = f"{sweep.axis.name}, {sweep.model['name']}, " + (name if one else f"{len(sweep.objects)} objects")
    table = Table(title=Text(title), title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column(sweep.axis.name)
    table.add_column("variant")
    for head in ("n", "top-1 %", "95 %", "top-5 %", "p", *([] if one else sweep.objects)):
        table.add_column(head, justify="right", no_wrap=True)
    for _, label in sweep.values:
        shares = [row.patch_share for row in sweep.rows if (row.label, row.object) == (label, name) and row.patch_share]
        shown = f"{label} ({100 * shares[0]:.0f} %)" if sweep.axis.name == "size" and shares else label
        for variant in sweep.variants:
            row, pair = rows.get((label, name, variant)), pairs.get((label, name, variant))
            if row is None or row.top1 is None or row.top5 is None:
                continue
            interval = f"{100 * row.ci95[0]:.0f}–{100 * row.ci95[1]:.0f}"
            p = "" if pair is None else "<0.0001" if pair.mcnemar_p < 1e-4 else f"{pair.mcnemar_p:.2g}"
            numbers = [str(row.n), f"{100 * row.top1:.0f}", interval, f"{100 * row.top5:.0f}", p]
            each = [] if one else [_share(rows.get((label, other, variant))) for other in sweep.objects]
            table.add_row(Text(shown), variant, *numbers, *each)
            shown = ""
    return table


def _share(row) -> str:
    return "–" if row is None or row.top1 is None else f"{100 * row.top1:.0f}"
