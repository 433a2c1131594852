"""For a training in a process of its own, on one thread, that is to be killed."""

import os
import signal

import torch

from toolkit.training.checkpoint import Checkpoint

torch.set_num_threads(1)


def die(*arguments) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def die_at_checkpoint(number: int) -> None:
    """Before it is written, with half a file of it beside; `number` counts from 1."""
    write, count = Checkpoint.write, 0

    def write_then_die(self, *arguments):
        nonlocal count
        count += 1
        if count == number:
            (self.folder / f".{self.file.name}.{os.getpid()}.partial").write_bytes(b"half of a checkp")
            die()
        write(self, *arguments)

    Checkpoint.write = write_then_die


def die_at_step(task: type, number: int) -> None:
    """As the step is begun; `number` counts from 0."""
    loss = task.loss
    task.loss = lambda self, step: die() if step == number else loss(self, step)
