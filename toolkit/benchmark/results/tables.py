"""The benchmark as a table on the console."""

from rich.table import Table
from rich.text import Text

from toolkit.benchmark.results.say import name_row, say_interval, say_percent, say_points, say_points_interval
from toolkit.benchmark.results.summary import Summary


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
