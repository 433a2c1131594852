"""What a command prints: lines and tables on stdout, notes and failures on stderr, or JSON on stdout."""

from collections.abc import Sequence
from typing import Any

import typer

from toolkit.core.text import escape, to_json


def say(line: str) -> None:
    """One line on stdout, as it is."""
    from toolkit.core.console import console

    console.print(line, markup=False, soft_wrap=True)


def warn(line: str, style: str = "yellow") -> None:
    """One line on stderr that wants to be seen."""
    from toolkit.core.console import errors

    errors.print(line, style=style, markup=False, soft_wrap=True)


def remark(line: str) -> None:
    """`note: …` on stderr."""
    warn(f"note: {line}", style="")


def show_json(content: Any) -> None:
    """The result for a script."""
    typer.echo(to_json(content))


def show_table(titles: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """A table on stdout, every cell whole: in a narrow terminal on several lines."""
    from rich.table import Column, Table
    from rich.text import Text

    from toolkit.core.console import console

    table = Table(*(Column(title, overflow="fold") for title in titles))
    for row in rows:
        table.add_row(*(Text(escape(str(cell))) for cell in row))
    console.print(table)
