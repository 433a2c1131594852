"""The command line: parse, call a function, print."""

import logging
import os
import sys
import traceback
import warnings
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path

import typer

from toolkit.cli.app import DEBUG, UsageError, explain_usage, make_app
from toolkit.core.errors import ToolkitError
from toolkit.core.text import shorten
from toolkit.training.processes import LAUNCHED, joined

INTERRUPTED, BAD_INPUT, DEFECT = 130, 2, 1
TRAINED_TOGETHER = (
    "train-patch", "train-patches", "train-texture", "train-wrap", "train-classifier", "refine-network",
)  # fmt: skip
app = make_app()


def main() -> None:
    """Run the command line; every error becomes a line on stderr, with a traceback only under --debug.

    Bad input ends with exit code 2, a defect of toolkit with 1, Ctrl-C with 130.
    """
    # pydantic would look for plugins in every installed package
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # before torch and its libraries load, which read these variables once
    _wait_without_spinning()
    _open_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # a terminal may lack letters
    # what was typed, for messages that repeat the command
    typed = [word for word in sys.argv[1:] if word != DEBUG]
    # libraries log and warn: trimesh logs a traceback for each file that it cannot read
    if not _is_debugging():
        logging.lastResort = logging.NullHandler()
        warnings.filterwarnings("ignore", module=r"(?!toolkit\b)")
    try:
        with _join_processes(typed):
            code = app(typed, standalone_mode=False) or 0
        # an error of what is still to be written is told too
        sys.stdout.flush()
    except BaseException as error:
        code = _end(error, typed)
    if code == INTERRUPTED:
        typer.echo("stopped: finished work is kept; run the same command again to resume", err=True)
    sys.exit(code)


WAITING = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME")


def _wait_without_spinning() -> None:
    """Let threads of OpenMP (torch, OpenBLAS) sleep while they wait, also in processes that this process starts.

    They spin by default, which takes the cores from whatever else runs: a training step beside two busy processes then
    takes 2.7 times as long. The libraries read this when they are loaded; a user's own setting stays.
    """
    if not any(name in os.environ for name in WAITING):
        # the second is for LLVM's OpenMP, which waits 200 ms before it sleeps
        os.environ |= {"OMP_WAIT_POLICY": "PASSIVE", "KMP_BLOCKTIME": "0"}


def _is_debugging() -> bool:
    return DEBUG in sys.argv[1:] or bool(os.environ.get("TOOLKIT_DEBUG"))


def _open_closed_streams() -> None:
    """Open streams that a shell closed (`>&-`): the next opened file would take their place, and get the output."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this stream's
            setattr(sys, name, os.fdopen(opened, "r" if number == 0 else "w", closefd=False))


def _join_processes(typed: list[str]) -> AbstractContextManager[None]:
    """Train with the processes that torchrun started; only the first of them runs any other command."""
    if LAUNCHED not in os.environ:
        return nullcontext()
    if typed[:1] and typed[0] in TRAINED_TOGETHER:
        return joined()
    if os.environ.get("RANK", "0") != "0":
        raise SystemExit(0)
    return nullcontext()


def _end(error: BaseException, typed: list[str]) -> int:
    """Print why a command ended, as a line; return its exit code."""
    if isinstance(error, KeyboardInterrupt | typer.Abort):
        return INTERRUPTED
    # such as the processes of torchrun that have nothing to do
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else DEFECT
    if isinstance(error, BrokenPipeError):  # the reader, such as `head`, has enough
        _close_output()
        return DEFECT
    if type(error).__name__ == "NoArgsIsHelpError":  # its message is the help
        typer.echo(error, err=True)
        return BAD_INPUT
    # every other error is explained in a line or two
    lines, code = explain_end(error, typed)
    # the error stream may be closed as well
    with suppress(OSError):
        if _is_debugging():
            traceback.print_exception(error)
        from toolkit.core.console import errors

        for line in lines:
            errors.print(shorten(line), style="red", markup=False, soft_wrap=True)
    if isinstance(error, OSError):
        _close_output()
    return code


def explain_end(error: BaseException, typed: list[str]) -> tuple[list[str], int]:
    """Return the lines for an error that ended a command, and the exit code."""
    # errors that a user can mend come first
    match error:
        case ToolkitError():
            return [f"error: {error}"], BAD_INPUT
        case UsageError():
            return [f"error: {explain_usage(error, typed)}"], BAD_INPUT
        case OSError(filename=str() | bytes() as name):
            from toolkit.core.files import explain_read_error

            return [f"error: {explain_read_error(Path(os.fsdecode(name)), error)}"], BAD_INPUT
        case OSError():
            return [f"error: {error.strerror or error}"], BAD_INPUT
        case MemoryError():
            return ["error: the memory is full: use fewer or smaller images, or a smaller batch"], BAD_INPUT
        case UnicodeEncodeError():
            line = f"error: {error.object[error.start : error.end]!a} is no character and cannot be written"
            return [f"{line}: rename the file that has it in its name"], BAD_INPUT
    # any other error is a defect of ours
    last = traceback.extract_tb(error.__traceback__)[-1:]
    where = f" in {Path(last[0].filename).name}, line {last[0].lineno}" if last else ""
    said = " ".join(str(error).split())
    return [
        f"error: {type(error).__name__}{where}: {shorten(said, 300)}",
        f"this is a defect of toolkit: please report it, with the output of the same command under {DEBUG}",
    ], DEFECT


def _close_output() -> None:
    """Send further output to the null device: writing it when Python ends would fail again."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
