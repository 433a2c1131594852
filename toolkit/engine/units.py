"""A unit of work, what came of it, and what runs lists of them."""

import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from toolkit.core.errors import ToolkitError

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
    """

    keys: tuple[Any, ...]
    work: Callable[..., Iterable[Result]]
    inputs: tuple[object, ...]
    name: str


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


def explain_failure(error: BaseException) -> str:
    """Why a unit failed, in a line: a `ToolkitError` says it itself, of others kind and place."""
    if isinstance(error, ToolkitError):
        return str(error)
    if isinstance(error, MemoryError) or "can't allocate memory" in str(error):  # as torch says it
        return "the memory is full"
    if type(error).__name__ == "OutOfMemoryError":
        return "the GPU's memory is full"
    last = traceback.extract_tb(error.__traceback__)[-1:]
    where = f" in {Path(last[0].filename).name}, line {last[0].lineno}" if last else ""
    return f"{type(error).__name__}{where}: {' '.join(str(error).split())}"


def do_work(work: Callable[..., Iterable[Result]], inputs: tuple[object, ...]) -> tuple[list[Result], str]:
    """The results of a unit until it ended or failed, and the reason where it failed."""
    results: list[Result] = []
    try:
        results.extend(work(*inputs))
    except Exception as error:
        return results, explain_failure(error)
    return results, ""


def give(result: Result) -> Iterator[Result]:
    """The work of a unit whose result is there."""
    yield result


AHEAD = 2
"""Units that are begun for each worker: one is done, one waits."""
KILLED = "its process was killed, as it is where the memory is full"
Begun = TypeVar("Begun")


def run_ahead(
    units: Iterable[Unit[Result]],
    workers: int,
    begin: Callable[[Unit[Result]], Begun],
    end: Callable[[Unit[Result], Begun, deque[tuple[Unit[Result], Begun]]], tuple[list[Result], str]],
) -> Iterator[Outcome[Result]]:
    """See `Engine.run`; the results of a unit are handed over together, while the next ones are done.

    Args:
        units, workers: what, by how many.
        begin: hands a unit to the workers.
        end: waits for a unit; gives its results and, where it failed, the reason. It may begin those that wait anew.
    """
    waiting: deque[tuple[Unit[Result], Begun]] = deque()
    rest = iter(units)
    while True:
        waiting.extend((unit, begin(unit)) for unit in islice(rest, max(0, AHEAD * workers - len(waiting))))
        if not waiting:
            return
        unit, begun = waiting.popleft()
        results, reason = end(unit, begun, waiting)
        yield from (Outcome(unit, key, result) for key, result in zip(unit.keys, results, strict=False))
        if not reason and len(results) != len(unit.keys):
            reason = f"gave {len(results)} results, expected {len(unit.keys)}"
        if reason:
            yield Outcome(unit, None, None, reason)
