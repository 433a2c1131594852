"""Compiling the functions of this folder with numba, whose machine code is kept on disk between runs.

The cache lies with the user, never beside the code, so that an install that cannot be written to is as fast as any. Its
folder is named after the sources: numba itself would not notice a change in a function that another file calls. Numba
runs what it loads from there, so a folder that others could have filled is never used.
"""

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from contextlib import nullcontext
from functools import lru_cache
from pathlib import Path
from threading import RLock
from typing import Any, ParamSpec, TypeVar

import numba
import numba.core.config as config
from numba.core.caching import FunctionCache

from toolkit.core.cache import PLACE, cache_root, explain_distrust, make_private
from toolkit.core.child import without_collector
from toolkit.core.console import notice
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file, write_text

MARK = "made-by-toolkit.txt"
"""In each folder that was made here; a folder without it is never deleted."""
SEAL = "complete"
"""File that lists such a folder's files by hash: damaged machine code does not run."""
P = ParamSpec("P")
R = TypeVar("R")


_refused = ""


@lru_cache(maxsize=1)
def cache_folder() -> Path | None:
    """Folder of this version's machine code; None if none of the user's folders can be written to.

    If others could have filled that folder, it is a new folder for this process and those that it starts.
    """
    global _refused
    try:
        # the folder must be there before its owner and rights can be looked at
        folder = _make_folder()
        _refused = explain_distrust(folder)
        if _refused:
            # cached code is run: a folder that others can write to could hold theirs
            fresh = tempfile.mkdtemp(prefix="toolkit-kernel-")  # which nobody else can enter
            atexit.register(shutil.rmtree, fresh, ignore_errors=True)
            os.environ[PLACE] = fresh
            folder = _make_folder()
    except (OSError, ToolkitError):
        return None
    return folder if os.access(folder, os.W_OK) else None


def find_refusal() -> str:
    """Why the usual folder is not used, such as `/x belongs to another user`; empty where it is."""
    cache_folder()
    return _refused


def _make_folder() -> Path:
    # machine code of another numba, Python or source must not be found: each has another folder
    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]}".encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(f"{source} {source.stat().st_mtime_ns}".encode())  # numba compiles again if either differs
        digest.update(source.read_bytes())
    folder = cache_root() / f"kernel-{digest.hexdigest()[:16]}"
    if make_private(folder):
        write_text(folder / MARK, "The renderer's machine code. It can be deleted at any time.\n")
    return folder


def is_compiled() -> bool:
    """Whether the machine code of this version is on disk, as it was written."""
    folder = cache_folder()
    try:
        sealed = [] if folder is None else [line.split(" ", 1) for line in (folder / SEAL).read_text().splitlines()]
        return folder is not None and all(sha256_file(folder / name) == digest for digest, name in sealed)
    except (OSError, ValueError):
        return False


def _hash_code(folder: Path) -> str:
    files = sorted(folder.rglob("*.nb[ic]"))
    return "".join(f"{sha256_file(file)} {file.relative_to(folder)}\n" for file in files)


_prepared = False
_preparing = RLock()


def prepare(compile_all: Callable[[], None]) -> None:
    """Compile all, once per machine, with a line that says so; other threads wait for the first one.

    Args:
        compile_all: uses every function, in the types it is used with.
    """
    global _prepared
    is_first = _preparing.acquire(blocking=False)
    with nullcontext() if is_first else _preparing:
        try:
            if not is_first and not _prepared:
                raise KeyboardInterrupt  # of the first thread: to compile now would keep the process from its end
            if not _prepared:
                _prepared = True  # compiling makes renderers, which ask again
                _prepare(compile_all)
        except KeyboardInterrupt:
            _prepared = False
            raise
        finally:
            if is_first:
                _preparing.release()


def compile_share(compile_some: Callable[[], None]) -> None:
    """Compile a part of what another process prepares, which says it and seals the folder."""
    global _prepared
    _prepared = True
    with without_collector():
        compile_some()


def _prepare(compile_all: Callable[[], None]) -> None:
    # nothing is compiled ahead where it cannot be kept
    folder = cache_folder()
    if folder is None:
        notice(
            "compiling the renderer, which takes some seconds at every start, because no cache folder can be written to"
        )
    elif not is_compiled():
        # there are three reasons to compile: it was never done here, the folder is not trusted, or its code was
        # changed
        said = "compiling the renderer for this machine: some seconds, once"
        if refused := find_refusal():
            said = f"compiling the renderer, some seconds at every start: its cache is not used, as {refused}"
            said += f": set {PLACE} to your own folder"
        elif (folder / SEAL).is_file():
            said = f"compiling the renderer again: its machine code in {folder} is not as it was written"
        notice(said)
        # code that is not as it was written must not be loaded
        for file in folder.rglob("*.nb[ic]") if (folder / SEAL).is_file() else ():
            file.unlink(missing_ok=True)
        with without_collector():  # going through the compiler's objects is a tenth of its work
            compile_all()
        # last: an interrupted compilation is done again
        write_text(folder / SEAL, _hash_code(folder))
        # other versions' code goes once it has not been used for long
        for old in folder.parent.glob("kernel-*"):
            if old != folder and (old / MARK).is_file() and not old.is_symlink() and _is_stale(old):
                shutil.rmtree(old, ignore_errors=True)


def _is_stale(folder: Path) -> bool:
    """Whether a folder was last used more than 30 days before this version was made."""
    try:
        newest = max(file.stat().st_atime for file in folder.iterdir())
    except (OSError, ValueError):
        return False
    return Path(__file__).stat().st_mtime - newest > 30 * 86400


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that fills arrays, when it is first called; it runs without the interpreter's lock.

    It makes no arrays and counts no references. Numba would count each array of a scene for each sample, which takes
    several times as long as all the rest.
    """
    # `_nrt` off: kernels allocate nothing, and without numba's reference counting they are smaller
    return _compile(function, {"_nrt": False}, cache_folder())


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a part of kernels, inlined into those that call it, on disk too; Python itself cannot call it.

    A product that is added to something is not rounded before.
    """
    # "contract" lets a * b + c be one instruction (fused multiply-add), rounded once
    return _compile(function, {"_nrt": False, "fastmath": {"contract"}} | _PART, None)


def exact(function: Callable[P, R]) -> Callable[P, R]:
    """As `inlined`, but each product is rounded: results are opposites where their terms are."""
    return _compile(function, {"_nrt": False} | _PART, None)


class _KernelCache(FunctionCache):
    """Machine code on disk, which is loaded without the compiler's tables: importing those takes a second."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """As numba's own, which refreshes the context before; numba does so again before it compiles."""
        return self._load_overload(sig, target_context)


# LLVM inlines them all; wrappers for calls from Python or C would be compiled for nothing
_PART = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def _compile(function: Callable[P, R], options: dict[str, Any], folder: Path | None) -> Callable[P, R]:
    before = config.CACHE_DIR  # type: ignore[attr-defined]
    config.CACHE_DIR = "" if folder is None else str(folder)  # type: ignore[attr-defined]  # read at declaration
    compiler: Callable[..., Any] = numba.njit
    try:
        # the "numpy" error model divides without asking whether the divisor is 0, which would keep loops from vectors
        made = compiler(nogil=True, error_model="numpy", **options)(function)
        if folder is not None:
            made._cache = _KernelCache(function)
        return made
    finally:
        config.CACHE_DIR = before  # type: ignore[attr-defined]
