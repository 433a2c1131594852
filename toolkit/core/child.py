"""What this process may use of the machine, and processes that it starts: none imports from the current folder.

For `-c` and `-m` Python looks for modules there first, and multiprocessing starts its processes with `-c`. What forbids
it, `-P` and PYTHONSAFEPATH, came with Python 3.11. So every child begins with a statement of its own, by which it looks
where this process looks.
"""

import gc
import math
import os
import resource
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
from pathlib import Path
from typing import Any

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
    limit = "" if most_s is None else f"from toolkit.core.child import limit_time; limit_time({most_s}); "
    command, longest = [sys.executable, "-c", f"{_begin()}{limit}\n{code}"], None if most_s is None else 6 * most_s
    try:
        done = subprocess.run(command, input=given, capture_output=True, check=False, timeout=longest)
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, LATE, b"", b"")
    if most_s is not None and done.returncode == -signal.SIGXCPU:
        done.returncode = LATE
    return done


def open_pool(workers: int) -> ProcessPoolExecutor:
    """Processes with a core each, which end with their parent.

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


_limit: int | None = None
_counting = threading.Lock()
_bounds: list[int] = []
_before = (0, 0)


def count_cores() -> int:
    """Number of cores that this process may use, at least 1: as `limit_cores` said, else as the system allows.

    The system's bounds are the process's affinity and, in a container, the quota of its control groups.
    """
    if _limit is not None:
        return _limit
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    quota = find_cpu_quota()
    return cores if quota >= cores else max(1, math.ceil(quota))


def find_cpu_quota(own: Path = Path("/proc/self/cgroup"), root: Path = Path("/sys/fs/cgroup")) -> float:
    """Least CPU time per time that this process's control groups and those around them allow; infinite without a bound.

    Source: the kernel's documentation, `cpu.max` of version 2 and `cpu.cfs_quota_us` of version 1.

    Args:
        own: a line `number:controllers:path` for each hierarchy that the process is in.
        root: where the hierarchies are mounted: version 2 there or in `unified`, those of version 1 by their names.
    """
    least = math.inf
    for line in _read_text(own).splitlines():
        _, controllers, path = line.split(":", 2)
        if controllers and "cpu" not in controllers.split(","):
            continue
        mounts = (root / controllers, root / "cpu") if controllers else (root, root / "unified")
        inner = Path(path.lstrip("/"))
        # a container may see its own group as the root, while the path is that of the host
        for group in (mount / part for mount in mounts for part in (inner, *inner.parents)):
            words = _read_text(group / "cpu.max") or " ".join(
                _read_text(group / f"cpu.cfs_{name}_us") for name in ("quota", "period")
            )
            numbers = [int(word) for word in words.split() if word.isdecimal()]  # `max` and -1 are no bound
            if len(numbers) == 2 and all(numbers):
                least = min(least, numbers[0] / numbers[1])
    return least


def _read_text(file: Path) -> str:
    try:
        return file.read_text()
    except OSError:
        return ""


def limit_cores(count: int) -> None:
    """From now on use no more: threads of ours, and those of torch and OpenCV. For a process among many."""
    global _limit
    _limit = count
    # read by the libraries when they are first imported, which takes seconds: not here, where they may not be needed
    os.environ |= {"OMP_NUM_THREADS": str(count), "OPENCV_FOR_THREADS_NUM": str(count)}
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(count)
    if "cv2" in sys.modules:
        sys.modules["cv2"].setNumThreads(count)


def limit_time(seconds: float) -> None:
    """From now on this process ends when its cores have worked so long for it."""
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(seconds), resource.RLIM_INFINITY))


@contextmanager
def limit_memory(most_bytes: int) -> Iterator[None]:
    """Within, this process may take so many bytes more, on Linux; then allocations fail as on a full machine.

    The bound is the process's: of several bounds, nested or in threads, the lowest counts.
    """
    global _before
    try:
        facts = Path("/proc/self/status").read_text()
        used = int(facts.partition("VmData:")[2].split()[0]) << 10
    except (OSError, ValueError, IndexError):  # not on Linux: nothing is bounded
        yield
        return
    mine = used + most_bytes

    def bound() -> None:
        lowest = [*_bounds, *(limit for limit in _before if limit != resource.RLIM_INFINITY)]
        resource.setrlimit(resource.RLIMIT_DATA, (min(lowest), _before[1]) if _bounds else _before)

    with _counting:
        if not _bounds:
            _before = resource.getrlimit(resource.RLIMIT_DATA)
        _bounds.append(mine)
        bound()
    try:
        yield
    finally:
        with _counting:
            _bounds.remove(mine)
            bound()


def is_memory_full(error: BaseException) -> bool:
    """Whether this is what Python, torch or ONNX Runtime raises where memory cannot be had."""
    words = ("can't allocate memory", "out of memory", "allocate memory", "bad_alloc", "bad allocation")
    return isinstance(error, MemoryError) or any(word in str(error).lower() for word in words)


@contextmanager
def without_collector() -> Iterator[None]:
    """Within, Python looks for no cycles: where millions of objects are made that live on, that is much of the work."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
