"""Work on several threads: steps of torch, each on a single thread, and items that are made ahead."""

import os
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from typing import TypeVar

from toolkit.core.child import count_cores
from toolkit.core.lazy import torch

Item = TypeVar("Item")
Made = TypeVar("Made")
_starting = threading.Lock()


@lru_cache(maxsize=2)
def _pool(workers: int, process_id: int) -> ThreadPoolExecutor:
    # a pool for each process: threads do not survive a fork, such as of a data loader's workers
    # all threads are started, and limited to a thread each, before the process's own setting is restored
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
    # OpenMP has a setting for each thread, torch also one for the process, which the workers have just changed
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
        with _starting:
            pool = _pool(workers, os.getpid())
        list(pool.map(work, range(count)))


def map_ahead(
    make: Callable[[Item], Made], items: Iterable[Item], threads: int | None = None, ahead: int | None = None
) -> Generator[Made]:
    """Yield `make` of each item in order, made ahead on threads.

    Args:
        make: function that several threads call at once.
        items: items, taken as they are needed.
        threads: number of threads, by default the number of cores; a single thread is the caller's own.
        ahead: items made in advance, by default two for each thread.
    """
    threads = threads or count_cores()
    if threads == 1:
        yield from map(make, items)
        return
    # threads, not processes: decoders, kernels and torch release the interpreter's lock
    waiting: deque[Future[Made]] = deque()
    with ThreadPoolExecutor(threads, "ahead") as pool:
        try:
            for item in items:
                waiting.append(pool.submit(make, item))
                # no further ahead, so that finished items do not fill the memory
                if len(waiting) > (ahead or 2 * threads):
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        # the caller stopped early
        finally:
            for future in waiting:
                future.cancel()
