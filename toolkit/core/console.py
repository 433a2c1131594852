"""Console: progress bars with rate and time left, notices, and lists of skipped files."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from toolkit.core.text import escape


class LineConsole(Console):
    """A console that prints each string as a single line, without control codes of names in it."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does, with control codes escaped."""
        super().print(*(escape(item) if isinstance(item, str) else item for item in objects), **options)


console = LineConsole(highlight=False)
errors = LineConsole(stderr=True, highlight=False)


_is_quiet = False


@contextmanager
def quietly(quiet: bool = True) -> Iterator[None]:
    """Within, there are no progress bars and no notices; `quiet=False` changes nothing."""
    global _is_quiet
    before = _is_quiet
    _is_quiet = before or quiet
    try:
        yield
    finally:
        _is_quiet = before


def is_quiet() -> bool:
    """Whether progress bars and notices are off."""
    return _is_quiet


_is_verbose = False


@contextmanager
def verbosely() -> Iterator[None]:
    """Within, commands also print every setting and whole tables."""
    global _is_verbose
    before, _is_verbose = _is_verbose, True
    try:
        yield
    finally:
        _is_verbose = before


def is_verbose() -> bool:
    """Whether every setting and whole tables are printed."""
    return _is_verbose


def notice(line: str) -> None:
    """Print a notice on stderr."""
    if not _is_quiet:
        errors.print(line, markup=False, soft_wrap=True)


_noticed: set[str] = set()


def notice_once(line: str) -> None:
    """Print a notice, each line only once in a process."""
    if not _is_quiet and line not in _noticed:
        _noticed.add(line)
        notice(line)


def list_skipped(skipped: Iterable[tuple[str, str]]) -> None:
    """Print on stderr which files could not be used, and why."""
    for path, reason in skipped:
        errors.print(f"skipped {path}: {reason}", style="yellow", markup=False, soft_wrap=True)


class RateColumn(ProgressColumn):
    """Column with the units of work per second."""

    def render(self, task: Task) -> Text:
        """Return the recent rate; empty until it is known."""
        speed = task.finished_speed or task.speed
        return Text(f"{speed:.1f}/s" if speed else "", style="cyan")


FIRST_LINE_S, LINE_EVERY_S = 10.0, 300.0
"""Seconds until the first line of progress if stderr is no terminal, and most seconds between two lines."""


class Ticker:
    """Handle of a progress bar, or of the lines in its place."""

    def __init__(
        self, progress: Progress | None, task: TaskID, title: str = "", total: int = 0, done: int = 0
    ) -> None:  # fmt: skip
        self._progress, self._task = progress, task
        self._title, self._total, self._done = title, total, done
        self._told, self._wait_s = monotonic(), FIRST_LINE_S
        self._first: tuple[float, int] | None = None

    def advance(self, amount: int = 1, note: str | None = None) -> None:
        """Count `amount` more units; `note` replaces the text at the bar's end."""
        self._done += amount
        # preparation before the first unit, such as baking a world's light, does not count for the rate
        if amount and self._first is None:
            self._first = monotonic(), self._done
        if self._progress is not None:
            self._progress.update(self._task, advance=amount)
            if note is not None:
                self._progress.update(self._task, note=escape(note))
        elif self._title and monotonic() - self._told >= self._wait_s:
            # the time between lines doubles: a log of hours keeps few
            self._told, self._wait_s = monotonic(), min(2 * self._wait_s, LINE_EVERY_S)
            start, before = self._first or (self._told, self._done)
            rate = (self._done - before) / max(self._told - start, 1e-9)
            left = f", {rate:.3g}/s, {(self._total - self._done) / rate:.0f} s left" if rate > 0 else ""
            errors.print(f"{self._title}: {self._done} of {self._total}{left}", markup=False, soft_wrap=True)


@contextmanager
def progress(title: str, total: int, quiet: bool = False, done: int = 0) -> Iterator[Ticker]:
    """Show a progress bar on stderr over `total` units, `done` of them finished by an earlier run.

    If stderr is no terminal, print a line at the start, after 10 s, and ever more rarely, up to every 5 minutes.
    """
    # no bar, but something to advance
    if quiet or _is_quiet:
        yield Ticker(None, TaskID(0))
        return
    # lines for a log
    if not errors.is_terminal:
        counts = f"{title}: {total - done} to do" + (f", {done} done before" if done else "")
        errors.print(f"{title} …" if total == 1 else counts, markup=False)
        yield Ticker(None, TaskID(0), "" if total == 1 else title, total, done)
        return
    # a bar for a terminal, which makes way for the result
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        RateColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}", markup=False),
    )
    with Progress(*columns, console=errors, transient=True) as bar:
        yield Ticker(bar, bar.add_task(escape(title), total=total, completed=done, note=""))
