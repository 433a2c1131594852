"""Commands that die at one of their writes, as a kill -9 or a power cut ends them, and are run again."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

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


def run(words, cwd, at=0, cut=False) -> subprocess.CompletedProcess[bytes]:
    """`toolkit WORDS` in a folder; dies at its write number `at`, whose last bytes are missing where it is `cut`."""
    command = [sys.executable, "-c", RUN, str(at), "cut" if cut else "whole", *map(str, words)]
    return subprocess.run(command, cwd=cwd, capture_output=True, check=False, env=os.environ | {"OMP_NUM_THREADS": "1"})


def end_in_spite_of_kills(words, cwd, kills: int) -> int:
    """Run until the command ends, killed at its first write, then at its second, and so on; says how often it died."""
    for died in range(kills + 1):
        done = run(words, cwd, died + 1 if died < kills else 0, cut=died % 2 == 1)
        if done.returncode != -signal.SIGKILL:
            assert done.returncode == 0, done.stderr.decode()[-2000:]
            return died
    raise AssertionError("killed by something else")


def read_folder(root: Path, changing: tuple[str, ...] = ()) -> dict[str, object]:
    """What each file of a folder holds; of JSON the parts that are not `changing`, which say when or how fast."""
    return {
        str(file.relative_to(root)): _drop(json.loads(file.read_bytes()), changing)
        if file.suffix == ".json"
        else file.read_bytes()
        for file in sorted(root.rglob("*"))
        if file.is_file()
    }


def _drop(content: object, changing: tuple[str, ...]) -> object:
    if isinstance(content, list):
        return [_drop(one, changing) for one in content]
    if isinstance(content, dict):
        return {name: _drop(one, changing) for name, one in content.items() if name not in changing}
    return content
