"""Work for the tests of the engines; workers import it by name."""

import os
import signal
import time
from pathlib import Path


def add(first, second):
    yield first + second


def count_to(end):
    yield from range(end)


def weigh(shared, index):
    yield float(shared.get()[index])


def fail_at(index, bad, error):
    if index == bad:
        raise error
    yield index


def die(index, bad):
    """Ends its process as the kernel does where the memory is full."""
    if index == bad:
        os.kill(os.getpid(), signal.SIGKILL)
    yield index


def die_once(index, marker):
    if not Path(marker).exists():
        Path(marker).write_text("died")
        os.kill(os.getpid(), signal.SIGKILL)
    yield index


def who(delay_s):
    time.sleep(delay_s)
    yield os.getpid()


def tell_cores():
    import torch

    from toolkit.core.child import count_cores

    yield count_cores(), torch.get_num_threads()


def wait_and_add(delay_s, number):
    time.sleep(delay_s)
    yield number


def allocate(gigabytes):
    """Asks for memory where a process may have two gigabytes more than it has."""
    import resource

    import numpy as np

    before = resource.getrlimit(resource.RLIMIT_AS)
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + 2**31, before[1]))
    try:
        yield len(np.ones(round(gigabytes * 2**27)))
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
