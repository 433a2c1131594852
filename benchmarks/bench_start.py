"""Whole commands, from the shell to their last line, against an import of torch alone.

Each is a process of its own, and they take turns, so that a busy machine slows all alike. The first turn fills the
cache, and does not count.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROUNDS, UNCOUNTED = 3, 1
IMPORT = "an import of torch"
TOOLKIT = (sys.executable, "-m", "toolkit")


def run_command(folder: Path, *command: str) -> None:
    """Run a command to its end; its output is thrown away.

    Raises:
        CalledProcessError: it failed.
    """
    root = str(Path(__file__).parents[1])
    places = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    subprocess.run(command, cwd=folder, env=os.environ | {"PYTHONPATH": places}, capture_output=True, check=True)


def measure() -> dict[str, float]:
    """Median seconds of each command."""
    with tempfile.TemporaryDirectory() as name:
        space, demo = Path(name) / "space", Path(name) / "demo"
        run_command(Path(name), *TOOLKIT, "init", str(space))
        run_command(space, *TOOLKIT, "plan")

        def shoot() -> None:
            shutil.rmtree(space / "captures", ignore_errors=True)
            run_command(space, *TOOLKIT, "capture-sim")

        def show() -> None:
            shutil.rmtree(demo, ignore_errors=True)
            run_command(Path(name), *TOOLKIT, "demo", str(demo))

        commands: dict[str, Callable[[], None]] = {
            IMPORT: lambda: run_command(space, sys.executable, "-c", "import torch"),
            "models": lambda: run_command(space, *TOOLKIT, "models"),
            "capture-sim": shoot,
            "demo": show,
        }
        seconds: dict[str, list[float]] = {command: [] for command in commands}
        for turn in range(UNCOUNTED + ROUNDS):
            for command, work in commands.items():
                start = time.perf_counter()
                work()
                if turn >= UNCOUNTED:
                    seconds[command].append(time.perf_counter() - start)
    return {command: float(np.median(taken)) for command, taken in seconds.items()}


def run() -> dict[str, float]:
    """Seconds of each command, and the ratio of an import of torch to them: 0.5 is a command that takes two imports."""
    seconds = measure()
    return {f"{command}, s": taken for command, taken in seconds.items()} | {
        f"{IMPORT}: ratio to {command}": seconds[IMPORT] / taken
        for command, taken in seconds.items()
        if command != IMPORT
    }


if __name__ == "__main__":
    for line, value in run().items():
        print(f"{line}: {value:.3g}")
