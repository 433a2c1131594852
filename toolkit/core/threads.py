"""Work on as many threads as torch may use, each step on its own thread alone."""

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache


@lru_cache(maxsize=2)
def _pool(workers: int, process_id: int) -> ThreadPoolExecutor:
    import torch

    # by process: the threads of a pool do not survive a fork, as of a data loader's workers
    # all threads are started, and pinned to a thread each, before the process's own setting is put back
    ready = threading.Barrier(workers + 1)

    def keep_to_one_thread() -> None:
        torch.get_num_threads()  # a thread takes over the process's setting on first use
        ready.wait()
        torch.set_num_threads(1)
        ready.wait()

    pool = ThreadPoolExecutor(workers, "each", keep_to_one_thread)
    for _ in range(workers):
        pool.submit(int)
    ready.wait()
    ready.wait()
    # OpenMP keeps the setting by thread, torch also a setting for the process, which the workers have just changed
    torch.set_num_threads(workers)
    return pool


def run_each(work: Callable[[int], object], count: int) -> None:
    """Call `work(0)` … `work(count - 1)` on as many threads as torch may use, and return when all are done.

    The steps of `work` run on its own thread alone. It must not call `run_each` in its turn.
    """
    import torch

    workers = torch.get_num_threads()
    if workers == 1:
        for index in range(count):
            work(index)
    else:
        list(_pool(workers, os.getpid()).map(work, range(count)))
