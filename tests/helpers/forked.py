"""Processes that have the kit imported when they begin, which else takes each of them seconds.

They are forked from one that has done nothing else, on one thread. Each has its own folder, environment, output and
end: it is killed, or fails, as one that was started anew. That the kit works when it is started anew is tested beside.
"""

import atexit
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from multiprocessing import forkserver, get_context
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext
from pathlib import Path
from subprocess import CompletedProcess

import pytest

TOOLKIT = "from toolkit.cli import main; main()"
LONGEST_S = 600


@cache
def parent() -> ForkServerContext:
    """Whose children they are: a context of multiprocessing; for `toolkit.core.child._Context`, workers too."""
    forkserver.set_forkserver_preload(["imported_kit", __name__])
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {"PYTHONPATH": _path(), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}.items():
            patch.setenv(name, value)
        forkserver.ensure_running()
    return get_context("forkserver")


class Forked:
    """As `python -c PROGRAM ARGUMENTS`, on one thread.

    Attributes:
        process: of multiprocessing; it can be killed.
    """

    def __init__(
        self, program: str, *arguments: object, cwd: Path | None = None, environment: dict[str, str] | None = None,
        begin: Callable[[], None] | None = None,
    ) -> None:  # fmt: skip
        """Start it in a folder, with more in its environment; `begin` is called in it before anything else."""
        given = os.environ | {"OMP_NUM_THREADS": "1"} | (environment or {})
        self._words = [str(one) for one in arguments]
        pipes = [parent().Pipe(duplex=False) for _ in range(2)]
        self.process = parent().Process(
            target=_become, args=(program, self._words, cwd or Path.cwd(), given, begin, [end for _, end in pipes])
        )
        self.process.start()
        self._readers = ThreadPoolExecutor(2)
        self._said = [self._readers.submit(_read, end) for end, _ in pipes]
        for _, end in pipes:
            end.close()

    def wait(self) -> CompletedProcess[bytes]:
        """Its end, and what it has printed."""
        self.process.join(LONGEST_S)
        self.process.kill()  # where it has not ended
        out, err = (one.result() for one in self._said)
        self._readers.shutdown()
        return CompletedProcess(self._words, self.process.exitcode, out, err)


def run_two(program: str, *arguments: object) -> list[CompletedProcess[bytes]]:
    """Two that train together, as torchrun starts them; what became of the first and the second."""
    from torch.distributed import TCPStore

    store = TCPStore("127.0.0.1", 0, is_master=True, wait_for_workers=False)
    where = {
        "WORLD_SIZE": "2", "LOCAL_WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(store.port),
        "TORCHELASTIC_RUN_ID": "x", "TORCHELASTIC_USE_AGENT_STORE": "True",
    }  # fmt: skip
    both = [Forked(program, *arguments, environment=where | {"RANK": rank, "LOCAL_RANK": rank}) for rank in "01"]
    return [one.wait() for one in both]


def run(
    program: str, *arguments: object, is_forked: bool = True, cwd: Path | None = None, **how
) -> CompletedProcess[bytes]:
    """See `Forked`; or the same in a process that is started anew."""
    if is_forked:
        return Forked(program, *arguments, cwd=cwd, **how).wait()
    words = [sys.executable, "-c", program, *map(str, arguments)]
    environment = os.environ | {"PYTHONPATH": _path(), "OMP_NUM_THREADS": "1"}
    return subprocess.run(words, cwd=cwd, capture_output=True, check=False, env=environment, timeout=LONGEST_S)


def _path() -> str:
    return os.pathsep.join(filter(None, [str(Path(__file__).parent), os.environ.get("PYTHONPATH")]))


def _become(program, arguments, cwd, environment, begin, outputs) -> None:
    forkserver._forkserver.ensure_running = lambda: None  # it runs: workers of this process are its children too
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    for number, end in enumerate(outputs, 1):
        os.dup2(end.fileno(), number)
    sys.stdout = os.fdopen(1, "w", closefd=False)
    sys.stderr = os.fdopen(2, "w", buffering=1, errors="backslashreplace", closefd=False)
    if begin is not None:
        begin()
    sys.argv = ["-c", *arguments]
    try:
        exec(compile(program, "<string>", "exec"), {"__name__": "__main__"})
    finally:
        atexit._run_exitfuncs()


def _read(pipe: Connection) -> bytes:
    with os.fdopen(pipe.fileno(), "rb", closefd=False) as stream:
        return stream.read()
