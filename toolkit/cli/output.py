"""What a command prints: lines and tables on stdout, notes and failures on stderr, or JSON on stdout."""

from collections.abc import Iterable, Sequence
from typing import Any, Protocol

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


class Result(Protocol):
    """What a command made: it says itself what became of it, for people and for scripts."""

    @property
    def skipped(self) -> Sequence[tuple[str, str]]:
        """(path, reason) of what could not be used."""

    def as_json(self) -> Any:
        """All of it for a script."""

    def lines(self) -> Iterable[str]:
        """The same for people."""


def show_result(result: Result, as_json: bool, lines: Iterable[str] | None = None) -> None:
    """What could not be used, and the result; then an exit code of 1 where something could not be used.

    Args:
        result: of the command.
        as_json: for a script.
        lines: for people, instead of the result's own.
    """
    from toolkit.core.console import list_skipped

    list_skipped(result.skipped)
    if as_json:
        show_json(result.as_json())
    else:
        for line in result.lines() if lines is None else lines:
            say(line)
        for line in getattr(result, "warnings", tuple)():
            warn(line)
    if result.skipped:
        raise typer.Exit(1)


def show_table(titles: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """A table on stdout, every cell whole.

    In a narrow terminal a cell takes several lines, between its words; where the words themselves do not fit side by
    side, each row becomes a block of lines, a title and its cell on each.
    """
    from rich.table import Column, Table
    from rich.text import Text

    from toolkit.core.console import console
    from toolkit.core.tables import share_width

    cells = [[escape(str(cell)) for cell in row] for row in rows]
    room = console.width - 3 * len(titles) - 1  # a bar and two blanks for each column, and the last bar
    widths = share_width(list(zip(titles, *cells, strict=True)), room)
    if sum(widths) > room:
        wide = max(map(len, titles))
        for row in cells:
            for title, cell in zip(titles, row, strict=True):
                console.print(f"{title:{wide}}  {cell}".rstrip(), markup=False, soft_wrap=True)
            console.print()
        return
    table = Table(*(Column(title, width=width) for title, width in zip(titles, widths, strict=True)))
    for row in cells:
        table.add_row(*map(Text, row))
    console.print(table)
