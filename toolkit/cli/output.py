"""Output of commands: lines and tables on stdout, notes and failures on stderr, or JSON on stdout."""

from collections.abc import Iterable, Sequence
from typing import Any, Protocol

import typer

from toolkit.core.text import escape, to_json


def say(line: str) -> None:
    """Print a line on stdout, as it is."""
    from toolkit.core.console import console

    console.print(line, markup=False, soft_wrap=True)


def warn(line: str, style: str = "yellow") -> None:
    """Print a coloured line on stderr."""
    from toolkit.core.console import errors

    errors.print(line, style=style, markup=False, soft_wrap=True)


def remark(line: str) -> None:
    """Print `note: …` on stderr."""
    warn(f"note: {line}", style="")


def show_json(content: Any) -> None:
    """Print the result for a script."""
    typer.echo(to_json(content))


class Result(Protocol):
    """Result of a command, which describes itself for people and for scripts."""

    @property
    def skipped(self) -> Sequence[tuple[str, str]]:
        """(path, reason) of files that could not be used."""

    def as_json(self) -> Any:
        """Return the result for a script."""

    def lines(self) -> Iterable[str]:
        """Return the result as lines for people."""


def show_result(result: Result, as_json: bool, lines: Iterable[str] | None = None) -> None:
    """Print skipped files and the result; the exit code is 1 if there are skipped files.

    Args:
        result: result of the command.
        as_json: print it for a script.
        lines: lines for people, in place of the result's own.
    """
    from toolkit.core.console import list_skipped

    # skipped files are listed first, as the results are without them
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
    """Print a table on stdout, every cell whole.

    In a narrow terminal cells are wrapped. If not even their words fit, each row becomes a block of `title  cell`.
    """
    from rich.table import Column, Table
    from rich.text import Text

    from toolkit.core.console import console
    from toolkit.core.tables import share_width

    # letters that act on a terminal are shown as codes
    cells = [[escape(str(cell)) for cell in row] for row in rows]
    room = console.width - 3 * len(titles) - 1  # a bar and two blanks for each column, and the last bar
    widths = share_width(list(zip(titles, *cells, strict=True)), room)
    # not even the words fit: a block for each row
    if sum(widths) > room:
        wide = max(map(len, titles))
        for row in cells:
            for title, cell in zip(titles, row, strict=True):
                console.print(f"{title:{wide}}  {cell}".rstrip(), markup=False, soft_wrap=True)
            console.print()
        return
    # cells are wrapped to the widths
    table = Table(*(Column(title, width=width) for title, width in zip(titles, widths, strict=True)))
    for row in cells:
        table.add_row(*map(Text, row))
    console.print(table)
