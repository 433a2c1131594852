"""A unit of work, what came of it, what runs lists of them, and the loop that does what is missing."""

import traceback
from collections import deque
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import groupby, islice
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from toolkit.core.console import Ticker, progress
from toolkit.core.errors import ToolkitError
from toolkit.core.files import delete_file, write_text
from toolkit.core.records import Record, RecordLog

Result = TypeVar("Result")
Value = TypeVar("Value")
Value_co = TypeVar("Value_co", covariant=True)


class Shared(Protocol[Value_co]):
    """A value that many units need: a network, a shard of images. It travels once to each process that needs it."""

    def get(self) -> Value_co:
        """The value, where the work runs."""
        ...


@dataclass(frozen=True)
class Unit(Generic[Result]):
    """Work that gives the same results wherever and however often it is done.

    Attributes:
        keys: of its results, in their order: what tells each from all others, such as a hash of its inputs.
        work: function of a module; from `inputs` an iterable of a result for each key.
        inputs: all that it needs; values of `Shared` stand for what other units need as well.
        name: what it is called where it fails.
        begins_early: it may work on its first result beside the unit before it, in the same process.
    """

    keys: tuple[Any, ...]
    work: Callable[..., Iterable[Result]]
    inputs: tuple[object, ...]
    name: str
    begins_early: bool = False


@dataclass(frozen=True)
class Outcome(Generic[Result]):
    """One result of a unit, or why there are no more.

    Attributes:
        unit: whose.
        key: of the result; None where it failed.
        result: None where it failed.
        reason: why it failed, in a line; empty where it did not.
    """

    unit: Unit[Result]
    key: Any
    result: Result | None
    reason: str = ""


class Engine(Protocol):
    """What runs units; a context manager, which holds its processes until it is left."""

    def share(self, value: Value) -> Shared[Value]:
        """Make a value ready for many units; it is dropped when no unit holds it any more."""
        ...

    def run(self, units: Iterable[Unit[Result]]) -> Iterator[Outcome[Result]]:
        """Do the units, and give their results in the order of the units, whoever finishes first.

        Of `units` no more are read than the workers need next. A unit fails alone: its outcome has a reason.
        """
        ...

    def __enter__(self) -> "Engine":
        """Start what is needed."""
        ...

    def __exit__(self, *error: object) -> None:
        """End it."""
        ...


class Reason(str):
    """Why a unit failed, in a line.

    Attributes:
        trace: the traceback of an error that nobody foresaw; empty for others.
    """

    trace: str = ""


def explain_failure(error: BaseException) -> Reason:
    """Why a unit failed: a `ToolkitError` says it itself, of others kind, place and traceback."""
    if isinstance(error, ToolkitError):
        return Reason(error)
    if isinstance(error, MemoryError) or "can't allocate memory" in str(error):  # as torch says it
        return Reason("the memory is full")
    if type(error).__name__ == "OutOfMemoryError":
        return Reason("the GPU's memory is full")
    last = traceback.extract_tb(error.__traceback__)[-1:]
    where = f" in {Path(last[0].filename).name}, line {last[0].lineno}" if last else ""
    reason = Reason(f"{type(error).__name__}{where}: {' '.join(str(error).split())}")
    reason.trace = "".join(traceback.format_exception(error))
    return reason


def do_work(work: Callable[..., Iterable[Result]], inputs: tuple[object, ...]) -> tuple[list[Result], str]:
    """Return the results of a unit until it ended or failed, and the reason if it failed."""
    results: list[Result] = []
    try:
        results.extend(work(*inputs))
    except Exception as error:
        return results, explain_failure(error)
    return results, ""


def done_unit(result: Result) -> Iterator[Result]:
    """Yield a result that was computed before: the work of a finished unit."""
    yield result


PREFETCH = 2
"""Number of units started for each worker: the first runs, the second waits."""
KILLED = "its process was killed, as it is where the memory is full"
Pending = TypeVar("Pending")


def run_ahead(
    units: Iterable[Unit[Result]],
    workers: int,
    begin: Callable[[Unit[Result]], Pending],
    end: Callable[[Unit[Result], Pending, deque[tuple[Unit[Result], Pending]]], tuple[list[Result], str]],
) -> Iterator[Outcome[Result]]:
    """See `Engine.run`; the results of a unit are handed over together, while the next units run.

    Args:
        units, workers: what, by how many.
        begin: hands a unit to the workers.
        end: waits for a unit; gives its results and, where it failed, the reason. It may begin those that wait anew.
    """
    waiting: deque[tuple[Unit[Result], Pending]] = deque()
    rest = iter(units)
    while True:
        waiting.extend((unit, begin(unit)) for unit in islice(rest, max(0, PREFETCH * workers - len(waiting))))
        if not waiting:
            return
        # in the order of submission: results come back as if a single process had done them
        unit, pending = waiting.popleft()
        results, reason = end(unit, pending, waiting)
        yield from (Outcome(unit, key, result) for key, result in zip(unit.keys, results, strict=False))
        if not reason and len(results) != len(unit.keys):
            reason = f"gave {len(results)} results, expected {len(unit.keys)}"
        if reason:
            yield Outcome(unit, None, None, reason)


Key = TypeVar("Key", bound=Hashable)
Item = TypeVar("Item")

FAILURES = "failures.log"
MOST_TRACES = 100
"""Largest number of tracebacks in that file; a hundred show what is wrong."""
GIVE_UP_AFTER = 3
"""Number of first units that must fail for the same reason before the run gives up: the fault is the run's."""


class WorkLog(Generic[Key, Value, Record]):
    """Finished work, in memory and in a log that runs may share; what stood in a broken line is done again.

    Attributes:
        known: what the last record of each key says.
    """

    def __init__(
        self, file: Path, model: type[Record], entries: Callable[[Record], Iterable[tuple[Key, Value]]],
        wanted: Collection[Key],
    ) -> None:  # fmt: skip
        """Read from the log the entries, (key, value), that are wanted; raises as `RecordLog.read`."""
        self._log, self._entries = RecordLog(file, model, required=False, compact=True), entries
        self.known = {key: value for record in self._log.read() for key, value in entries(record) if key in wanted}

    def find_missing(self, wanted: Mapping[Key, Item]) -> dict[Key, Item]:
        """What has no record yet, in order."""
        return {key: item for key, item in wanted.items() if key not in self.known}

    def add(self, *records: Record) -> None:
        """Append to the log; raises as `RecordLog.append`."""
        self._log.append(*records)
        self.known |= {key: value for record in records for key, value in self._entries(record)}


@dataclass(frozen=True)
class Ran:
    """What a run did.

    Attributes:
        made, kept: what was done now, and what was there before, as `weigh` counts it.
        failed: (name, reason) of units that failed; the next run tries them again.
    """

    made: int
    kept: int
    failed: tuple[tuple[str, str], ...]


def run_resumable(
    title: str, wanted: Mapping[Key, Item], missing: Mapping[Key, Item], units: Iterable[Unit[Result]],
    keep: Callable[[Key, Item, Result], None], engine: Engine, folder: Path,
    weigh: Callable[[Item], int] = lambda item: 1, bar: Ticker | None = None,
) -> Ran:  # fmt: skip
    """Do what is missing.

    A result is kept before the next result is taken, so a run that was stopped goes on where it was, on any engine. A
    unit fails alone: the others are done.

    Args:
        title: of the progress bar.
        wanted: all items of the run, by what tells their results from all others, such as a hash of the inputs.
        missing: those that are to be done now.
        units: units of the missing items; only read if items are missing, and no faster than the engine takes them.
        keep: puts an item's result on disk.
        engine: does the units.
        folder: of the run; `failures.log` in it gets the tracebacks of errors that nobody foresaw.
        weigh: how much an item counts on the progress bar.
        bar: of a longer work, where this is a part of it; by default a bar of its own.

    Raises:
        ToolkitError: the first units all failed for the same reason, nothing could be done, or the disk is full.
    """
    todo, total = sum(map(weigh, missing.values())), sum(map(weigh, wanted.values()))
    failed: list[tuple[str, str]] = []
    log = _FailureLog(folder)
    # tracebacks of an earlier run would be mistaken for this run's
    if missing:
        log.clear()
    made = 0
    with progress(title, total, done=total - todo) if bar is None else nullcontext(bar) as bar:
        for outcome in engine.run(_tell(units, bar) if missing else ()):
            if outcome.result is None:
                failed.append((outcome.unit.name, log.note(outcome)))
                # the same reason for all: a single failing unit does not stop the run
                if not made and len(failed) == GIVE_UP_AFTER and len({reason for _, reason in failed}) == 1:
                    raise ToolkitError(failed[0][1])
                continue
            item = missing[outcome.key]
            keep(outcome.key, item, outcome.result)
            # after `keep`: what the bar counts is on disk
            made += weigh(item)
            bar.advance(weigh(item), note=outcome.unit.name)
    # a run without a single result is an error, not an empty result
    if failed and not made and todo == total:
        raise ToolkitError(failed[0][1])
    return Ran(made, total - todo, tuple(failed))


class _FailureLog:
    """Tracebacks of a run in a file of its own."""

    def __init__(self, folder: Path) -> None:
        self._file, self._entries = folder / FAILURES, list[str]()

    def clear(self) -> None:
        """Remove what an earlier run left."""
        delete_file(self._file)

    def note(self, outcome: Outcome[Any]) -> str:
        """Log the traceback of a unit that failed, if it has a traceback; returns the reason with the file's name."""
        trace = getattr(outcome.reason, "trace", "")
        if not trace:
            return str(outcome.reason)
        if len(self._entries) < MOST_TRACES:
            self._entries.append(f"{outcome.unit.name}\n{trace}")
            write_text(self._file, "\n".join(self._entries))
        return f"{outcome.reason} (traceback in {self._file})"


def _tell(units: Iterable[Unit[Result]], bar: Ticker) -> Iterator[Unit[Result]]:
    """Yield the units, each named on the bar when it starts."""
    bar.advance(0, note="preparing")
    for unit in units:
        bar.advance(0, note=unit.name)
        yield unit


def cut_groups(
    items: Mapping[Key, Item], group: Callable[[Item], Hashable], size: int
) -> Iterator[tuple[tuple[Key, ...], list[Item]]]:
    """Yield the keys and items of units: at most `size` consecutive items of the same group."""
    for _, own in groupby(items.items(), key=lambda pair: group(pair[1])):
        while some := list(islice(own, size)):
            yield tuple(key for key, _ in some), [item for _, item in some]
