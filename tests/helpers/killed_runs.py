"""Commands that die at one of their writes, as a kill -9 or a power cut ends them, and trainings that Ctrl-C stops."""

import ctypes
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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


def run(words, cwd, at=0, cut=False, begin=None) -> subprocess.CompletedProcess[bytes]:
    """`toolkit WORDS` in a folder; dies at its write number `at`, whose last bytes are missing where it is `cut`.

    `begin` is called in the new process before anything else.
    """
    command = [sys.executable, "-c", RUN, str(at), "cut" if cut else "whole", *map(str, words)]
    return subprocess.run(command, cwd=cwd, capture_output=True, check=False, preexec_fn=begin,
                          env=os.environ | {"OMP_NUM_THREADS": "1"})  # fmt: skip


def train_killed(program: str, *arguments) -> None:
    """Run a program that imports `dying`, and check that it was killed."""
    path = os.pathsep.join(filter(None, [str(Path(__file__).parent), os.environ.get("PYTHONPATH")]))
    ended = subprocess.run([sys.executable, "-c", program, *map(str, arguments)], capture_output=True, check=False,
                           env=os.environ | {"PYTHONPATH": path}, timeout=300)  # fmt: skip
    assert ended.returncode == -signal.SIGKILL, ended.stderr.decode()[-2000:]


def end_in_spite_of_kills(words, cwd, kills: int) -> int:
    """Run until the command ends, killed at its first write, whole and cut, then at its second; says how often it died.

    So each two kills go on by one write at least, and most writes are met in both ways.
    """
    for died in range(kills + 1):
        done = run(words, cwd, 1 + died // 2 % 2 if died < kills else 0, cut=died % 2 == 1)
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
    for capability in (1, 2):  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
        ctypes.CDLL(None).prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP


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
