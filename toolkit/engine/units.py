"""Units of work, their outcomes, engines that run lists of units, and the loop that does missing work."""

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
    """A value for many units, such as a network or a shard of images, which is sent to each process once."""

    def get(self) -> Value_co:
        """Return the value in the process of the work."""
        ...


@dataclass(frozen=True)
class Unit(Generic[Result]):
    """Work with the same results wherever and however often it is done.

    Attributes:
        keys: unique keys of its results, in their order, such as hashes of their inputs.
        work: function of a module that returns an iterable of a result for each key.
        inputs: arguments of `work`; a `Shared` stands for a value of many units.
        name: name in messages.
        begins_early: its first result may be made beside the unit before it, in the same process.
    """

    keys: tuple[Any, ...]
    work: Callable[..., Iterable[Result]]
    inputs: tuple[object, ...]
    name: str
    begins_early: bool = False


@dataclass(frozen=True)
class Outcome(Generic[Result]):
    """A result of a unit, or why it failed.

    Attributes:
        reason: why the unit failed, as a line.
    """

    unit: Unit[Result]
    key: Any
    result: Result | None
    reason: str = ""


class Engine(Protocol):
    """Runs units; a context manager, which holds its processes."""

    def share(self, value: Value) -> Shared[Value]:
        """Prepare a value for many units; it is dropped when no unit holds it any more."""
        ...

    def run(self, units: Iterable[Unit[Result]]) -> Iterator[Outcome[Result]]:
        """Run units, and yield their results in the order of the units.

        Units are taken only as the workers need them. A unit that fails has an outcome with a reason.
        """
        ...

    def __enter__(self) -> "Engine":
        """Start the processes."""
        ...

    def __exit__(self, *error: object) -> None:
        """End the processes."""
        ...


class Reason(str):
    """Why a unit failed, as a line; `trace` is the traceback of an unexpected error."""

    trace: str = ""


def explain_failure(error: BaseException) -> Reason:
    """Return why a unit failed: the message of a `ToolkitError`, or kind, place and traceback of another error."""
    if isinstance(error, ToolkitError):
        return Reason(error)
    if isinstance(error, MemoryError) or "can't allocate memory" in str(error):  # torch's message
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
    """Yield a result that was computed before, as the work of a finished unit."""
    yield result


PREFETCH = 2
"""Number of units started for each worker: the first runs, the second waits."""
KILLED = "its process was killed, as by a full memory"
Pending = TypeVar("Pending")


def run_ahead(
    units: Iterable[Unit[Result]],
    workers: int,
    begin: Callable[[Unit[Result]], Pending],
    end: Callable[[Unit[Result], Pending, deque[tuple[Unit[Result], Pending]]], tuple[list[Result], str]],
) -> Iterator[Outcome[Result]]:
    """Run units as `Engine.run`, with `PREFETCH` units for each worker.

    Args:
        units, workers: units, and number of workers.
        begin: gives a unit to the workers.
        end: waits for a unit; returns its results, and the reason if it failed. It may begin waiting units again.
    """
    waiting: deque[tuple[Unit[Result], Pending]] = deque()
    rest = iter(units)
    while True:
        # more units than workers, so that no worker waits for the driver
        waiting.extend((unit, begin(unit)) for unit in islice(rest, max(0, PREFETCH * workers - len(waiting))))
        if not waiting:
            return
        # in the order of submission, as in a single process
        unit, pending = waiting.popleft()
        results, reason = end(unit, pending, waiting)
        yield from (Outcome(unit, key, result) for key, result in zip(unit.keys, results, strict=False))
        # work that stops early gives fewer results than its unit has keys
        if not reason and len(results) != len(unit.keys):
            reason = f"gave {len(results)} results, expected {len(unit.keys)}"
        if reason:
            yield Outcome(unit, None, None, reason)


Key = TypeVar("Key", bound=Hashable)
Item = TypeVar("Item")

FAILURES = "failures.log"
MOST_TRACES = 100
"""Largest number of tracebacks in that file."""
GIVE_UP_AFTER = 3
"""Number of first units with the same failure that end the run."""


class WorkLog(Generic[Key, Value, Record]):
    """Finished work, in memory and in a log that runs may share; work of a broken line is done again.

    Attributes:
        known: last value of each key.
    """

    def __init__(
        self, file: Path, model: type[Record], entries: Callable[[Record], Iterable[tuple[Key, Value]]],
        wanted: Collection[Key],
    ) -> None:  # fmt: skip
        """Read the wanted entries, (key, value), of the log; raises as `RecordLog.read`."""
        self._log, self._entries = RecordLog(file, model, required=False, compact=True), entries
        self.known = {key: value for record in self._log.read() for key, value in entries(record) if key in wanted}

    def find_missing(self, wanted: Mapping[Key, Item]) -> dict[Key, Item]:
        """Return the items without a record, in order."""
        return {key: item for key, item in wanted.items() if key not in self.known}

    def add(self, *records: Record) -> None:
        """Append to the log; raises as `RecordLog.append`."""
        self._log.append(*records)
        self.known |= {key: value for record in records for key, value in self._entries(record)}


@dataclass(frozen=True)
class Ran:
    """Result of a run: work made now and kept from before, and (name, reason) of failed units."""

    made: int
    kept: int
    failed: tuple[tuple[str, str], ...]


def run_resumable(
    title: str, wanted: Mapping[Key, Item], missing: Mapping[Key, Item], units: Iterable[Unit[Result]],
    keep: Callable[[Key, Item, Result], None], engine: Engine, folder: Path,
    weigh: Callable[[Item], int] = lambda item: 1, bar: Ticker | None = None,
) -> Ran:  # fmt: skip
    """Do the missing work, and keep each result before the next is taken, so that interrupted runs resume.

    Args:
        title: title of the progress bar.
        wanted: all items of the run by unique keys, such as hashes of their inputs.
        missing: items to be done now.
        units: units of the missing items, taken only as the engine needs them.
        keep: writes an item's result to disk.
        engine: runs the units.
        folder: folder of the run; `failures.log` in it gets the tracebacks of unexpected errors.
        weigh: weight of an item on the progress bar.
        bar: progress bar of a longer work; by default a new bar.

    Raises:
        ToolkitError: the first units all failed for the same reason, nothing could be done, or the disk is full.
    """
    # in weights, so that the bar also counts what earlier runs did
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
            # after `keep`: the bar counts results on disk
            made += weigh(item)
            bar.advance(weigh(item), note=outcome.unit.name)
    # a run without a single result is an error, not an empty result
    if failed and not made and todo == total:
        raise ToolkitError(failed[0][1])
    return Ran(made, total - todo, tuple(failed))


class _FailureLog:
    """Tracebacks of a run in a file."""

    def __init__(self, folder: Path) -> None:
        self._file, self._entries = folder / FAILURES, list[str]()

    def clear(self) -> None:
        """Delete the file of an earlier run."""
        delete_file(self._file)

    def note(self, outcome: Outcome[Any]) -> str:
        """Log the traceback of a failed unit, if it has any; return the reason with the file's name."""
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
    """Yield keys and items of units: at most `size` consecutive items of the same group."""
    for _, own in groupby(items.items(), key=lambda pair: group(pair[1])):
        while some := list(islice(own, size)):
            yield tuple(key for key, _ in some), [item for _, item in some]
