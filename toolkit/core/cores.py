"""How many cores the work of this process may use."""

import os
import sys

_limit: int | None = None


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
