"""Memory: a bound on what somebody else's file may take, and no search for garbage where there is none."""

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_counting = threading.Lock()
_within = 0
_before = (0, 0)


@contextmanager
def limit_memory(most_bytes: int) -> Iterator[None]:
    """Within, this process may take so many bytes more, on Linux; then allocations fail as on a full machine.

    The bound is the process's: where several threads are within, it is that of the first, until the last has left.
    """
    global _within, _before
    try:
        import resource

        facts = Path("/proc/self/status").read_text()
        used = int(facts.partition("VmData:")[2].split()[0]) << 10
    except (ImportError, OSError, ValueError, IndexError):  # not on Linux: nothing is bounded
        yield
        return
    with _counting:
        if _within == 0:
            _before = resource.getrlimit(resource.RLIMIT_DATA)
            wanted = [used + most_bytes, *(one for one in _before if one != resource.RLIM_INFINITY)]
            resource.setrlimit(resource.RLIMIT_DATA, (min(wanted), _before[1]))
        _within += 1
    try:
        yield
    finally:
        with _counting:
            _within -= 1
            if _within == 0:
                resource.setrlimit(resource.RLIMIT_DATA, _before)


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
