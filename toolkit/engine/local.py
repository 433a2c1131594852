"""Units on this machine: in this process, or in a pool of processes with a core each."""

import itertools
import pickle
import shutil
import tempfile
import weakref
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Generic

from toolkit.core.child import count_cores, open_pool
from toolkit.core.errors import ToolkitError
from toolkit.engine.units import KILLED, Outcome, Result, Unit, Value, do_work, explain_failure, run_ahead

TRIES = 2
"""Number of tries for a unit whose process dies."""
Done = tuple[list[Result], str]
"""Results of a unit, and the reason if it failed."""


class Here(Generic[Value]):
    """A shared value in this process."""

    def __init__(self, value: Value) -> None:
        self._value = value

    def get(self) -> Value:
        """Return the value."""
        return self._value


class InProcess:
    """Runs units in this process, in their order; the work may use all cores.

    Attributes:
        raises: whether a unit's error ends the run.
    """

    def __init__(self, raises: bool = False) -> None:
        self.raises = raises

    def share(self, value: Value) -> Here[Value]:
        """Return the value as it is."""
        return Here(value)

    def run(self, units: Iterable[Unit[Result]]) -> Iterator[Outcome[Result]]:
        """See `Engine.run`; a result is yielded before the next result of the unit is begun."""
        with ThreadPoolExecutor(1, "begin") as pool:
            for unit, begin in _look_ahead(units, pool):
                try:
                    for key, result in zip(unit.keys, begin(), strict=True):
                        yield Outcome(unit, key, result)
                except Exception as error:
                    if self.raises:
                        raise
                    yield Outcome(unit, None, None, explain_failure(error))

    def __enter__(self) -> "InProcess":
        return self

    def __exit__(self, *error: object) -> None:
        pass


def _look_ahead(
    units: Iterable[Unit[Result]], pool: Executor
) -> Iterator[tuple[Unit[Result], Callable[[], Iterable[Result]]]]:
    """Yield each unit and what returns its results; the next one has begun by then, where both may."""
    rest = iter(units)
    unit, begin = next(rest, None), None
    while unit is not None:
        following, begin_following = None, None
        # a unit may begin early on a core that is free
        if unit.begins_early and count_cores() > 1:
            following = next(rest, None)
            if following is not None and following.begins_early:
                begin_following = pool.submit(_begin, following).result
        yield unit, begin or partial(_begin, unit)
        unit, begin = following or next(rest, None), begin_following


def _begin(unit: Unit[Result]) -> Iterable[Result]:
    """The results of a unit, of which the first is made here."""
    results = iter(unit.work(*unit.inputs))
    return itertools.chain(list(itertools.islice(results, 1)), results)


class Stored(Generic[Value]):
    """A shared value in a file, which each worker reads once; the file is deleted with this object."""

    def __init__(self, file: Path, value: Value) -> None:
        self._file = file
        try:
            with file.open("wb") as stream:
                pickle.dump(value, stream, protocol=pickle.HIGHEST_PROTOCOL)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise ToolkitError(
                f"{type(value).__name__} cannot be sent to another process ({error}): run without workers"
            ) from None
        weakref.finalize(self, file.unlink, missing_ok=True)

    def get(self) -> Value:
        """Return the value, from the file or this process's cache."""
        return _load(self._file)

    # workers get only the path, and must not delete the file
    def __reduce__(self) -> tuple[Callable[[Path], "Stored[Any]"], tuple[Path]]:
        return _open_stored, (self._file,)


def _open_stored(file: Path) -> "Stored[Any]":
    made: Stored[Any] = Stored.__new__(Stored)
    made._file = file
    return made


@lru_cache(maxsize=8)
def _load(file: Path) -> Any:
    with file.open("rb") as stream:
        return pickle.load(stream)  # our own file, in a folder that only this user may write to


class LocalPool:
    """A pool of processes on this machine.

    A unit whose worker dies is tried again alone; after two tries it has failed.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._pool: Executor | None = None
        self._folder: Path | None = None
        self._numbers = itertools.count()

    def share(self, value: Value) -> Stored[Value]:
        """Write the value to a file for the workers; a `ToolkitError` if it cannot be sent."""
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix="toolkit-engine-"))
        return Stored(self._folder / f"{next(self._numbers)}.pickle", value)

    def run(self, units: Iterable[Unit[Result]]) -> Iterator[Outcome[Result]]:
        """See `run_ahead`."""
        return run_ahead(units, self.workers, self._submit, self._wait)

    def _wait(
        self, unit: Unit[Result], future: "Future[Done[Result]]",
        waiting: "deque[tuple[Unit[Result], Future[Done[Result]]]]",
    ) -> "Done[Result]":  # fmt: skip
        try:
            return future.result()
        except BrokenProcessPool:
            # the pool does not know which unit broke it: try this unit alone
            found = self._try_alone(unit)
            # the others were lost with the pool, but for units that had ended before
            for _ in range(len(waiting)):
                other, done = waiting.popleft()
                is_there = done.done() and not done.cancelled() and not isinstance(done.exception(), BrokenProcessPool)
                waiting.append((other, done if is_there else self._submit(other)))
            return found
        except Exception as error:  # inputs or results that cannot be sent
            return [], explain_failure(error)

    def _submit(self, unit: Unit[Result]) -> "Future[Done[Result]]":
        try:
            return self._open().submit(do_work, unit.work, unit.inputs)
        except BrokenProcessPool:
            self._close()
            return self._open().submit(do_work, unit.work, unit.inputs)

    def _try_alone(self, unit: Unit[Result]) -> Done[Result]:
        """Run a unit alone in a pool, so that it caused the death of a process."""
        for _ in range(TRIES):
            self._close()
            try:
                return self._open(workers=1).submit(do_work, unit.work, unit.inputs).result()
            except BrokenProcessPool:
                continue
            finally:
                self._close()
        return [], KILLED

    def _open(self, workers: int | None = None) -> Executor:
        if self._pool is None:
            self._pool = open_pool(workers or self.workers)
        return self._pool

    def _close(self) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None

    def __enter__(self) -> "LocalPool":
        return self

    def __exit__(self, *error: object) -> None:
        self._close()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None
