"""The images of a batch side by side, one thread for each.

Each step on one image stays in the cache, where a step on a batch goes to memory; and no thread waits for another
within a step, which on a busy machine costs more than the step itself.
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import torch


@lru_cache(maxsize=2)
def _pool(workers: int, process_id: int) -> ThreadPoolExecutor:
    # by process: the threads of a pool do not survive a fork, as of a data loader's workers
    ready = threading.Barrier(workers + 1)

    def keep_to_one_thread() -> None:
        torch.get_num_threads()  # a thread takes over the process's setting on first use
        ready.wait()
        torch.set_num_threads(1)
        ready.wait()

    pool = ThreadPoolExecutor(workers, "corrupt", keep_to_one_thread)
    for _ in range(workers):
        pool.submit(int)
    ready.wait()
    ready.wait()
    # OpenMP keeps the setting by thread, torch also one for the process, which the workers have just changed
    torch.set_num_threads(workers)
    return pool


def run_each(work: Callable[[int], object], count: int) -> None:
    """Call `work(0)` … `work(count - 1)` on as many threads as torch may use, and return when all are done.

    The steps of `work` run on its own thread alone. It must not call `run_each` in its turn.
    """
    workers = torch.get_num_threads()
    if workers == 1:
        for index in range(count):
            work(index)
    else:
        list(_pool(workers, os.getpid()).map(work, range(count)))
