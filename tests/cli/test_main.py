"""However a command ends: a line, an exit code, and a traceback for those who ask."""

import errno
import os
import shlex
import subprocess
import sys

import pytest

from toolkit.cli import WAITING, main
from toolkit.core.errors import ToolkitError

TOOLKIT = [sys.executable, "-m", "toolkit"]


@pytest.fixture
def end(monkeypatch, type_toolkit, tmp_path):
    """A function (error, *words) -> exit code and stderr of `toolkit init here`, which ends in that error."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("TOOLKIT_DEBUG", raising=False)

    def call(error, *words):
        def fail(*_, **__):
            raise error

        monkeypatch.setattr("toolkit.cli.setup.make_workspace", fail)
        code, _, err = type_toolkit("init", "here", *words)
        return code, err

    return call


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (ToolkitError("no such thing"), 2, "error: no such thing"),
        (OSError(errno.EACCES, "Permission denied", "a/b"), 2, "error: cannot read a/b: permission denied"),
        (OSError(errno.ENOSPC, "No space left on device"), 2, "error: No space left on device"),
        (MemoryError(), 2, "error: the memory is full"),
        (UnicodeEncodeError("utf-8", "a\ud800", 1, 2, "no"), 2, "error: '\\ud800' is no character"),
        (RecursionError("too deep"), 1, "error: RecursionError in test_main.py, line"),
        (ValueError("one\ntwo" + "x" * 5000), 1, "error: ValueError in test_main.py, line"),
        (ZeroDivisionError(), 1, "error: ZeroDivisionError"),
    ],
)
def test_whatever_goes_wrong_is_a_line_and_an_exit_code(end, error, code, words):
    found, err = end(error)
    assert found == code and err.startswith(words), err
    lines = err.splitlines()
    assert len(lines) == (2 if code == 1 else 1) and max(map(len, lines)) < 500
    assert "Traceback" not in err
    if code == 1:
        assert lines[1].startswith("this is a defect of toolkit: please report it") and "--debug" in lines[1]


@pytest.mark.parametrize("words", [("--debug",), ()])
def test_a_traceback_is_shown_to_those_who_ask(end, monkeypatch, words):
    if not words:
        monkeypatch.setenv("TOOLKIT_DEBUG", "1")
    for error in (ToolkitError("no such thing"), ValueError("odd")):
        _, err = end(error, *words)
        assert err.startswith("Traceback") and str(error) in err.splitlines()[-2 if error.args == ("odd",) else -1]


def test_a_message_cannot_command_the_terminal(end):
    _, err = end(ToolkitError("file \x1b]0;owned\x07\x9b31m\n\u202egpj.exe is odd"))
    assert err == "error: file \\x1b]0;owned\\x07\\x9b31m\\n\\u202egpj.exe is odd\n"


def run(*arguments, stdout=subprocess.PIPE, **environment):
    return subprocess.run(
        [*TOOLKIT, *arguments], stdout=stdout, stderr=subprocess.PIPE, text=True, check=False,
        env={**os.environ, **environment}, timeout=60,
    )  # fmt: skip


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")  # noqa: PTH110
def test_a_full_output_is_one_line():
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = run("--version", stdout=full)
    assert (done.returncode, done.stderr) == (2, "error: No space left on device\n")


def test_a_reader_that_has_enough_hears_no_more():
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as pipe:
        done = run("--help", stdout=pipe)
    assert (done.returncode, done.stderr) == (1, "")


def test_an_ascii_terminal_gets_escapes():
    done = run(
        "plan", "--help", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0", LC_ALL="C", PYTHONIOENCODING="ascii:strict"
    )  # fmt: skip
    assert done.returncode == 0 and not done.stderr and done.stdout.isascii()
    done = run("plan", "--object", "größe\udcff", PYTHONIOENCODING="ascii:strict")
    assert done.returncode == 2 and done.stderr.startswith("error: no object called 'gr\\xf6\\xdfe\\udcff'")


@pytest.mark.skipif(os.name == "nt", reason="needs a POSIX shell")
@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", ">&- 2>&- <&-"])
def test_a_closed_stream_is_no_defect(tmp_path, closed):
    command = f"{' '.join(map(shlex.quote, TOOLKIT))} init new {closed}"
    done = subprocess.run(["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "defect" not in done.stderr and "Traceback" not in done.stderr
    assert (tmp_path / "new" / "toolkit.toml").is_file()
    written = [path.read_bytes() for path in (tmp_path / "new").rglob("*") if path.is_file()]
    assert not any(b"next:" in one or b"made" in one for one in written), "what is printed went into a file"


def test_an_interruption_while_the_command_line_is_imported_prints_no_traceback(tmp_path):
    code = """
import sys
import toolkit.__main__ as entry

class Interrupt:
    def find_spec(self, name, *_):
        if name == "toolkit.cli":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupt())
entry.main()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 130 and done.stderr == ""


@pytest.mark.parametrize("library, is_left", [("torch", True), ("triton", False), ("drjit", False)])
def test_the_end_of_a_command_looks_for_no_garbage_but_of_libraries_that_print_what_is_left(tmp_path, library, is_left):
    code = f"""
import atexit, gc, sys, types
from toolkit.__main__ import main

sys.modules["{library}"] = types.ModuleType("{library}")
atexit.register(lambda: print(len(gc.get_objects()) < 1000 < gc.get_freeze_count()))
main()
"""
    done = subprocess.run(
        [sys.executable, "-c", code, "--version"], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0 and done.stdout.splitlines()[-1] == str(is_left)


@pytest.mark.parametrize("own", [{}, {"OMP_WAIT_POLICY": "ACTIVE"}, {"GOMP_SPINCOUNT": "9"}, {"KMP_BLOCKTIME": "9"}])
def test_threads_that_wait_do_not_spin_unless_the_user_said_so(monkeypatch, own):
    for name in WAITING:
        monkeypatch.delenv(name, raising=False)
    for name, value in own.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "argv", ["toolkit", "--version"])
    with pytest.raises(SystemExit):
        main()
    found = {name: os.environ.pop(name) for name in WAITING if name in os.environ}
    assert found == (own or {"OMP_WAIT_POLICY": "PASSIVE", "KMP_BLOCKTIME": "0"})
