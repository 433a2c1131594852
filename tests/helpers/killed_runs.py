"""Commands that die at one of their writes, as a kill -9 or a power cut ends them, and trainings that Ctrl-C stops."""

import ctypes
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import CompletedProcess

import forked
import pytest

RUN = """
import os, signal, sys
at, cut, fsync, n = int(sys.argv.pop(1)), sys.argv.pop(1) == "cut", os.fsync, 0

def die(number):
    global n
    n += 1
    if n != at:
        return fsync(number)
    if cut:
        os.ftruncate(number, max(0, os.fstat(number).st_size - 9))
    os.kill(os.getpid(), signal.SIGKILL)

os.fsync = die  # every write of the kit ends with it, before a file is given its name
from toolkit.cli import main
main()
"""


def run(words, cwd, at=0, cut=False, **how) -> CompletedProcess[bytes]:
    """`toolkit WORDS` in a folder; dies at its write number `at`, whose last bytes are missing where it is `cut`."""
    return forked.run(RUN, at, "cut" if cut else "whole", *words, cwd=cwd, **how)


def train_killed(program: str, *arguments: object, **how) -> None:
    """Run a program that imports `dying`, and check that it was killed."""
    ended = forked.run(program, *arguments, **how)
    assert ended.returncode == -signal.SIGKILL, ended.stderr.decode()[-2000:]


def end_in_spite_of_kills(words, cwd, kills: int, **how) -> int:
    """Run until the command ends, killed at its first write, whole and cut, then at its second; says how often it died.

    So each two kills go on by one write at least, and most writes are met in both ways.
    """
    for died in range(kills + 1):
        done = run(words, cwd, 1 + died // 2 % 2 if died < kills else 0, died % 2 == 1, **how)
        if done.returncode != -signal.SIGKILL:
            assert done.returncode == 0, done.stderr.decode()[-2000:]
            return died
    raise AssertionError("killed by something else")


def files_below(root: Path) -> list[str]:
    """The names of a folder's files, from it on."""
    return sorted(str(file.relative_to(root)) for file in root.rglob("*") if file.is_file())


def read_folder(root: Path) -> dict[str, bytes]:
    """What each file of a folder holds."""
    return {str(file.relative_to(root)): file.read_bytes() for file in sorted(root.rglob("*")) if file.is_file()}


def fill_the_disk() -> None:
    """For `begin`: no file may grow beyond two thousand bytes."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))


def be_nobody_special() -> None:
    """For `begin`: even root asks for permission, as everybody else."""
    version, found = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
    kernel = ctypes.CDLL(None)
    assert kernel.capget(version, found) == 0
    for at in range(3):  # effective, permitted, inheritable
        found[at] &= ~(1 << 1 | 1 << 2)  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
    assert kernel.capset(version, found) == 0


@contextmanager
def stopped_at(task: type, step: int) -> Iterator[None]:
    """Ctrl-C as a training of this kind begins the step; that it stops there is checked."""
    loss = task.loss

    def interrupted(self, at):
        if at == step:
            raise KeyboardInterrupt
        return loss(self, at)

    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(task, "loss", interrupted)
        yield
