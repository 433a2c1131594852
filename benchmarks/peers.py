"""Rates of renderers that take turns, each in a process of its own; the peak memory of one."""

import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np


def peak_mb() -> float:
    """Peak resident memory of this process, MB.

    Not getrusage's ru_maxrss: a child process inherits its parent's peak there.
    """
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]) / 1024


def measure_in_turn(
    module: str, names: Iterable[str], arguments: list[str], rounds: int, quiet: bool
) -> dict[str, float]:
    """Median frames/s of each that runs; `python -m benchmarks.MODULE NAME ARGUMENTS` prints `{"fps": ...}` last."""
    rates: dict[str, list[float]] = {name: [] for name in names}
    for _ in range(rounds):
        for name in rates:
            command = [sys.executable, "-m", f"benchmarks.{module}", name, *arguments]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                last = (done.stderr.strip().splitlines() or ["no message"])[-1]
                if not quiet:
                    print(f"{name} did not run: {last[:160]}")
                continue
            rates[name].append(json.loads(done.stdout.strip().splitlines()[-1])["fps"])
    return {name: float(np.median(values)) for name, values in rates.items() if values}
