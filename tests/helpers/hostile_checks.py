"""What must hold whatever comes: an end in time, a line that says what is wrong, nothing changed outside."""

import gc
import io
import os
import shutil
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from functools import partial
from pathlib import Path
from unicodedata import category

import pytest

from toolkit.core.child import limit_memory, run_python

LONGEST_S = 20
"""Of this process's work, and of waiting six times as long: other work on the machine is no hang."""
MOST_BYTES = 2 << 30
"""That an input may take, over what the tests have loaded already."""
LONGEST_LINE = 2500
TRIED: dict[str, int] = {}


class Hang(BaseException):
    """What was asked did not end in time."""


@contextmanager
def limited(seconds: int = LONGEST_S) -> Iterator[None]:
    """Within, what takes longer is a `Hang`, and what takes too much memory a `MemoryError`."""

    def ring(*_):
        raise Hang(f"longer than {seconds} s")

    signals = (signal.SIGPROF, signal.SIGALRM)
    before = [signal.signal(one, ring) for one in signals]
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.alarm(6 * seconds)
    gc.freeze()  # what earlier tests hold is not searched again and again in this one's time
    try:
        with limit_memory(MOST_BYTES):
            yield
    finally:
        gc.unfreeze()
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
        for one, handler in zip(signals, before, strict=True):
            signal.signal(one, handler)


@contextmanager
def small_pictures() -> Iterator[None]:
    """Within, what plans and shot lists draw is a quarter as wide: how a command ends does not hang on it."""
    from toolkit.captures import render
    from toolkit.rig import plan_pictures
    from toolkit.rooms.photos.shot_list import mounting

    encode = plan_pictures.encode_figure
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan_pictures, "encode_figure", lambda figure, dpi: encode(figure, dpi // 4))
        patch.setattr(render, "draw_contact_sheet", partial(plan_pictures.draw_contact_sheet, tile_px=80))
        for name in ("LONG_SIDE_PX", "WIDTH_PX"):
            patch.setattr(mounting, name, getattr(mounting, name) // 4)
        yield


def peak(code: str) -> int:
    """Most bytes that Python statements ever held, in a process of their own, which must end well."""
    told = "; print(open('/proc/self/status').read().partition('VmHWM:')[2].split()[0])"
    done = run_python(code + told)
    assert done.returncode == 0, done.stderr.decode()
    return int(done.stdout.split()[-1]) << 10


def count(what: str, more: int = 1) -> None:
    """So many more inputs tried."""
    TRIED[what] = TRIED.get(what, 0) + more


def look_at(folder: Path) -> dict[str, tuple[int, int]]:
    """What lies outside the workspace, with sizes and times."""
    found = {}
    for place, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if name != "space"]
        for name in names:
            status = os.lstat(os.path.join(place, name))  # noqa: PTH118
            found[os.path.join(place, name)] = (status.st_size, status.st_mtime_ns)  # noqa: PTH118
    return found


class Sandbox:
    """A small workspace, made anew from a template for each input, deep in a folder that must not change."""

    def __init__(self, root: Path, template: Path) -> None:
        self.root, self.template = root, template
        self.space_dir = root / "a" / "b" / "space"
        self.out = self.err = ""

    def renew(self) -> Path:
        """The workspace as it was."""
        if self.space_dir.exists():
            shutil.rmtree(self.space_dir)
        shutil.copytree(self.template, self.space_dir)
        return self.space_dir

    def run(self, *words: str) -> int:
        """Run a command in the workspace, in this process; returns its exit code.

        It must end in time with 0, 1 or 2 (130 where a question finds nobody), say what is wrong in lines, and change
        nothing outside.
        """
        from toolkit.cli import main

        before, here, argv, stdin = look_at(self.root), Path.cwd(), sys.argv, sys.stdin
        out, err = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.TextIOWrapper(io.BytesIO(), "utf-8")
        sys.argv, sys.stdin = ["toolkit", *words], io.StringIO()
        os.chdir(self.space_dir)
        code: object = "none"
        try:
            with small_pictures(), limited(), redirect_stdout(out), redirect_stderr(err):
                main()
        except SystemExit as ended:
            code = ended.code or 0
        finally:
            os.chdir(here)
            sys.argv, sys.stdin = argv, stdin
        out.flush(), err.flush()
        self.out = out.buffer.getvalue().decode("utf-8", "backslashreplace")
        self.err = err.buffer.getvalue().decode("utf-8", "backslashreplace")
        said = f"toolkit {words!a}\ncode {code}\n{self.out[-3000:]}\n{self.err[-3000:]}"
        assert code in (0, 1, 2, 130), said
        assert "Traceback" not in self.err and "this is a defect of toolkit" not in self.err, said
        assert "the memory is full" not in self.err, said
        shown = (sign == "\n" or sign.isprintable() or category(sign) == "Zs" for sign in self.err)
        assert all(shown), said  # a name may hold a wide or narrow space, which a terminal neither obeys nor hides
        assert max(map(len, self.err.splitlines()), default=0) < LONGEST_LINE, said
        assert code != 2 or sum(line.startswith("error: ") for line in self.err.splitlines()) == 1, said
        assert look_at(self.root) == before, f"wrote outside\n{said}"
        return int(code)
