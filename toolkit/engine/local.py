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
"""How often a unit may end its process before it is given up."""
Done = tuple[list[Result], str]
"""Results of a unit, and the reason where it failed."""


class Here(Generic[Value]):
    """A shared value of this very process."""

    def __init__(self, value: Value) -> None:
        self._value = value

    def get(self) -> Value:
        """The value."""
        return self._value


class InProcess:
    """Does each unit here when its turn comes; the work itself may use all cores.

    Attributes:
        raises: a unit's error ends the run.
    """

    def __init__(self, raises: bool = False) -> None:
        self.raises = raises

    def share(self, value: Value) -> Here[Value]:
        """The value as it is."""
        return Here(value)

    def run(self, units: Iterable[Unit[Result]]) -> Iterator[Outcome[Result]]:
        """See `Engine.run`; a result is handed over before the unit's next result is begun."""
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
    """A shared value in a file, which each worker reads once; the file goes when nobody in the driver holds this."""

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
        """Return the value, read from its file or from this process's cache."""
        return _load(self._file)

    # workers get the path alone, and must not delete the file at their end
    def __reduce__(self) -> tuple[Callable[[Path], "Stored[Any]"], tuple[Path]]:
        return _open_stored, (self._file,)


def _open_stored(file: Path) -> "Stored[Any]":
    made: Stored[Any] = Stored.__new__(Stored)
    made._file = file
    return made


@lru_cache(maxsize=8)
def _load(file: Path) -> Any:
    with file.open("rb") as stream:
        return pickle.load(stream)  # of our own, in a folder that only this user may write to


class LocalPool:
    """A pool of processes on this machine.

    A worker that dies costs its unit another try, with no other unit beside it; a unit that fails twice is given up.

    Attributes:
        workers: how many processes; each uses a core.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._pool: Executor | None = None
        self._folder: Path | None = None
        self._numbers = itertools.count()

    def share(self, value: Value) -> Stored[Value]:
        """Write the value where the workers find it.

        Raises:
            ToolkitError: it cannot be sent to another process.
        """
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
            # a pool that breaks does not say who broke it: the unit that was waited for is tried by itself
            found = self._try_alone(unit)
            for _ in range(len(waiting)):  # the pool took them all down with it
                other, done = waiting.popleft()
                waiting.append((other, self._again(other, done)))
            return found
        except Exception as error:  # inputs or results that cannot be sent
            return [], explain_failure(error)

    def _submit(self, unit: Unit[Result]) -> "Future[Done[Result]]":
        try:
            return self._open().submit(do_work, unit.work, unit.inputs)
        except BrokenProcessPool:
            self._close()
            return self._open().submit(do_work, unit.work, unit.inputs)

    def _again(self, unit: Unit[Result], done: "Future[Done[Result]]") -> "Future[Done[Result]]":
        """Return the results of a unit that had ended before; otherwise submit it again."""
        is_there = done.done() and not done.cancelled() and not isinstance(done.exception(), BrokenProcessPool)
        return done if is_there else self._submit(unit)

    def _try_alone(self, unit: Unit[Result]) -> Done[Result]:
        """Run a unit alone in a pool, so that a killed process is its own fault."""
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
