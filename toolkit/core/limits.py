"""What this process may use: cores; memory, where somebody else's file asks for it; no search for garbage."""

import gc
import math
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_limit: int | None = None
_counting = threading.Lock()
_bounds: list[int] = []
_before = (0, 0)


def count_cores() -> int:
    """Cores that this process may use: all that the system gives it, or as many as `limit_cores` said."""
    if _limit is not None:
        return _limit
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def limit_cores(count: int) -> None:
    """From now on use no more: threads of ours, and those of torch and OpenCV. For a process that is one of many."""
    global _limit
    _limit = count
    # read by the libraries when they are first imported, which takes seconds: not here, where they may not be needed
    os.environ |= {"OMP_NUM_THREADS": str(count), "OPENCV_FOR_THREADS_NUM": str(count)}
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(count)
    if "cv2" in sys.modules:
        sys.modules["cv2"].setNumThreads(count)


def limit_time(seconds: float) -> None:
    """From now on this process ends when its cores have worked so long for it, where the system can tell."""
    try:
        import resource
    except ImportError:  # not on Linux
        return
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(seconds), resource.RLIM_INFINITY))


@contextmanager
def limit_memory(most_bytes: int) -> Iterator[None]:
    """Within, this process may take so many bytes more, on Linux; then allocations fail as on a full machine.

    The bound is the process's: where several are within, one in the other or in threads, the lowest counts.
    """
    global _before
    try:
        import resource

        facts = Path("/proc/self/status").read_text()
        used = int(facts.partition("VmData:")[2].split()[0]) << 10
    except (ImportError, OSError, ValueError, IndexError):  # not on Linux: nothing is bounded
        yield
        return
    mine = used + most_bytes

    def bound() -> None:
        lowest = [*_bounds, *(one for one in _before if one != resource.RLIM_INFINITY)]
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
    return isinstance(error, MemoryError) or any(one in str(error).lower() for one in words)


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
