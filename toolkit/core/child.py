"""Limits of this process, and child processes, which never import from the current folder.

With `-c`, as in multiprocessing, Python looks for modules in the current folder first. Python 3.10 has no option
against it, so every child begins with a statement that sets the path of this process.
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
"""Exit code of a process that took too long, as `timeout` has it."""


def run_python(code: str, given: bytes = b"", most_s: float | None = None) -> "subprocess.CompletedProcess[bytes]":
    """Run Python code in a child process, and wait for it.

    Args:
        code: Python statements.
        given: standard input.
        most_s: CPU seconds after which it is ended with the code `LATE`, or six times as many seconds of waiting.
    """
    # the child limits itself before it runs the code
    limit = "" if most_s is None else f"from toolkit.core.child import limit_time; limit_time({most_s}); "
    command, longest = [sys.executable, "-c", f"{_begin()}{limit}\n{code}"], None if most_s is None else 6 * most_s
    try:
        done = subprocess.run(command, input=given, capture_output=True, check=False, timeout=longest)
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, LATE, b"", b"")
    # the kernel's signal for too much processor time
    if most_s is not None and done.returncode == -signal.SIGXCPU:
        done.returncode = LATE
    return done


def open_pool(workers: int) -> ProcessPoolExecutor:
    """Return a pool of processes with a core each, which end with their parent; torch and numba cannot be forked."""
    with _begin_safely():  # multiprocessing's resource tracker is a process too
        return ProcessPoolExecutor(workers, _Context(), _begin_worker)


def _begin() -> str:
    """Return the first statement of a child; `sys` is built in, so no file can replace it."""
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
    """Within, every process of multiprocessing begins with our statement, for which it has no setting."""

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
    """End this worker with its parent: without a parent it would wait for ever."""
    parent = parent_process()
    if parent is not None:
        parent.join()  # returns when the parent has ended, also if it was killed
        os._exit(1)


_limit: int | None = None
_counting = threading.Lock()
_bounds: list[int] = []
_before = (0, 0)


def count_cores() -> int:
    """Return the number of cores for this process: that of `limit_cores`, else by affinity and the CPU quota."""
    if _limit is not None:
        return _limit
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    quota = find_cpu_quota()
    return cores if quota >= cores else max(1, math.ceil(quota))


def find_cpu_quota(own: Path = Path("/proc/self/cgroup"), root: Path = Path("/sys/fs/cgroup")) -> float:
    """Return the least CPU quota, in cores, of this process's control groups; infinite without a bound.

    Source: the kernel's documentation, `cpu.max` of version 2 and `cpu.cfs_quota_us` of version 1.

    Args:
        own: file with a line `number:controllers:path` for each hierarchy of the process.
        root: mount point of the hierarchies: version 2 there or in `unified`, version 1 by their names.
    """
    # the narrowest of all groups above this process counts
    least = math.inf
    for line in _read_text(own).splitlines():
        _, controllers, path = line.split(":", 2)
        # a hierarchy of version 1 that does not count processor time
        if controllers and "cpu" not in controllers.split(","):
            continue
        mounts = (root / controllers, root / "cpu") if controllers else (root, root / "unified")
        inner = Path(path.lstrip("/"))
        # in a container the root may be its own group, while the path is that of the host
        for group in (mount / part for mount in mounts for part in (inner, *inner.parents)):
            # version 2 writes quota and period into a single file, version 1 into two
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
    """Limit the threads of this process, also those of torch and OpenCV."""
    global _limit
    _limit = count
    # libraries that are not imported yet read these variables
    os.environ |= {"OMP_NUM_THREADS": str(count), "OPENCV_FOR_THREADS_NUM": str(count)}
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(count)
    if "cv2" in sys.modules:
        sys.modules["cv2"].setNumThreads(count)


def limit_time(seconds: float) -> None:
    """End this process after so many CPU seconds."""
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(seconds), resource.RLIM_INFINITY))


@contextmanager
def limit_memory(most_bytes: int) -> Iterator[None]:
    """Within, limit further memory of this process on Linux; of nested or parallel limits the lowest counts."""
    global _before
    # size of the data segment now, from kB
    try:
        facts = Path("/proc/self/status").read_text()
        used = int(facts.partition("VmData:")[2].split()[0]) << 10
    except (OSError, ValueError, IndexError):  # not on Linux
        yield
        return
    mine = used + most_bytes

    # the lowest of all limits now in force, and never above that from before
    def bound() -> None:
        lowest = [*_bounds, *(limit for limit in _before if limit != resource.RLIM_INFINITY)]
        resource.setrlimit(resource.RLIMIT_DATA, (min(lowest), _before[1]) if _bounds else _before)

    # several threads may be within at once: whichever ends must not lift the limits of the others
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
    """Whether this is the error of Python, torch or ONNX Runtime for a full memory."""
    words = ("can't allocate memory", "out of memory", "allocate memory", "bad_alloc", "bad allocation")
    return isinstance(error, MemoryError) or any(word in str(error).lower() for word in words)


@contextmanager
def without_collector() -> Iterator[None]:
    """Within, switch off the garbage collector, which slows down the making of millions of objects."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
