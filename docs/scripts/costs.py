"""Measure what commands cost: CPU seconds, peak memory and bytes written, into docs/results/costs.csv.

Called as costs.py TOOLKIT FOLDER [NAME …]: runs each command of `COMMANDS` in a workspace below FOLDER, or those that
are named; rows of others stay. CPU seconds of all processes are counted, so that other work on the machine changes
little. The machine is noted in every row.
"""

import csv
import os
import platform
import subprocess
import sys
from pathlib import Path

# nothing of the toolkit is imported: a process's peak memory counts that of the process that starts it
FILE = Path(__file__).resolve().parents[1] / "results" / "costs.csv"
COMMANDS = {
    "init": "init .",
    "objects": "objects",
    "doctor": "doctor",
    "models": "models",
    "plan": "plan --preview",
    "capture-sim": "capture-sim",
    "eval": "eval captures/ --run shipped",
    "eval without saliency": "eval captures/ --run plain --no-saliency",
    "eval --corrupt fog:3": "eval captures/ --run fog --corrupt fog:3 --no-saliency",
    "verify": "verify shipped",
    "runs": "runs",
    "report": "report --all",
    "compare": "compare shipped plain",
    "export": "export shipped",
    "print": "print --all",
    "print --board": "print --board",
    "place": "place --object racer",
    "train-patch": "train-patch --object racer --steps 20 --out print/patches/mine",
    "train-texture": "train-texture --object eggnog --steps 10",
    "wrap": "wrap --object eggnog",
    "train-wrap": "train-wrap --object eggnog --steps 10",
    "print --wrap": "print --wrap eggnog",
    "sweep": "sweep light --object eggnog",
    "corrupt": "corrupt captures/sim foggy --corrupt fog:3",
    "coco": "coco captures/sim",
    "world preview": "world preview city",
    "world-eval": "world-eval --object warplane --world city --places 1 --sample 2 --weather fog:3",
    "challenge init": "challenge init entry",
}
"""By the name in the table, what is run; in this order, because later commands use what earlier commands made."""


def measure(toolkit: str, folder: Path, words: str) -> dict[str, float]:
    """Run a command and return what it took; raises `ValueError` if it fails.

    Args:
        toolkit: the program.
        folder: in which it runs.
        words: its arguments.
    """
    before = measure_folder(folder)
    with (folder / "costs.log").open("ab") as log:
        process = subprocess.Popen([toolkit, *words.split()], cwd=folder, stdout=log, stderr=log)
        _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise ValueError(f"{words} ended with exit code {process.returncode}: see {folder / 'costs.log'}")
    written = measure_folder(folder) - before
    return {
        "cpu_s": round(used.ru_utime + used.ru_stime, 1), "peak_mb": round(used.ru_maxrss / 1000),
        "written_mb": round(max(written, 0) / 1e6, 1),
    }  # fmt: skip


def measure_folder(folder: Path) -> int:
    """Return the bytes of all files below a folder."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def describe_machine() -> str:
    """Return processor, cores and threads in words."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    model = next((line.partition(": ")[2] for line in lines if line.startswith("model name")), platform.machine())
    return f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}"


def main(toolkit: str, folder: str, *wanted: str) -> None:
    """Measure, and write the table after each command."""
    space = Path(folder)
    space.mkdir(parents=True, exist_ok=True)
    known: dict[str, dict] = {}
    if FILE.is_file():
        with FILE.open(encoding="utf-8", newline="") as stream:
            known = {row["name"]: row for row in csv.DictReader(stream)}
    for name in wanted or COMMANDS:
        about = {"name": name, "command": f"toolkit {COMMANDS[name]}"}
        known[name] = about | measure(str(Path(toolkit).absolute()), space, COMMANDS[name])
        known[name]["machine"] = describe_machine()
        with FILE.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.DictWriter(stream, list(known[name]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(known[one] for one in COMMANDS if one in known)


if __name__ == "__main__":
    main(*sys.argv[1:])
