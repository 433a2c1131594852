"""Processes that this one starts; none imports from the current folder, where files of anybody's may lie.

For `-c` and `-m` Python looks for modules there first, and multiprocessing starts its processes with `-c`. What forbids
it, `-P` and PYTHONSAFEPATH, came with Python 3.11. So every child begins with a statement of its own, by which it looks
where this process looks.
"""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import parent_process, util
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess
from typing import Any

from toolkit.core.limits import limit_cores

_starting = threading.Lock()


LATE = 124
"""The code of a process that was ended as it took too long; that of `timeout` as well."""


def run_python(code: str, given: bytes = b"", most_s: float | None = None) -> "subprocess.CompletedProcess[bytes]":
    """Run statements in a process of their own, and wait for it.

    Args:
        code: Python.
        given: what it reads from its input.
        most_s: seconds of work after which it is ended, with the code `LATE`; and where it waits, six times as long.
    """
    limit = "" if most_s is None else f"from toolkit.core.limits import limit_time; limit_time({most_s}); "
    command, longest = [sys.executable, "-c", f"{_begin()}{limit}\n{code}"], None if most_s is None else 6 * most_s
    try:
        done = subprocess.run(command, input=given, capture_output=True, check=False, timeout=longest)
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, LATE, b"", b"")
    if most_s is not None and done.returncode == -signal.SIGXCPU:
        done.returncode = LATE
    return done


def open_pool(workers: int) -> ProcessPoolExecutor:
    """Processes with one core each, which end when this one does.

    They are spawned, not forked: torch and numba do not survive a fork.
    """
    with _begin_safely():  # multiprocessing's count of semaphores is a process too
        return ProcessPoolExecutor(workers, _Context(), _begin_worker)


def _begin() -> str:
    """The first statement of a child; `sys` is built in, so that no file can stand in for it."""
    return f"import sys; sys.path[:] = {[place for place in sys.path if place]!a}; "


class _Process(SpawnProcess):
    @staticmethod
    def _Popen(process_obj: BaseProcess) -> Any:
        with _begin_safely():
            return SpawnProcess._Popen(process_obj)


class _Context(SpawnContext):
    Process = _Process


@contextmanager
def _begin_safely() -> Iterator[None]:
    """Within, what multiprocessing starts begins with our statement: it has no setting for that."""

    def start(path: bytes, arguments: Sequence[Any], open_files: Sequence[int]) -> int:
        code = arguments.index("-c") + 1
        return before(path, [*arguments[:code], _begin() + arguments[code], *arguments[code + 1 :]], open_files)

    with _starting:
        before, util.spawnv_passfds = util.spawnv_passfds, start  # type: ignore[assignment]
        try:
            yield
        finally:
            util.spawnv_passfds = before


def _begin_worker() -> None:
    limit_cores(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A parent that is killed tells its workers nothing, and they would wait for it for ever."""
    parent = parent_process()
    if parent is not None:
        # returns when the parent has ended, killed or not
        parent.join()
        os._exit(1)
