"""Arrays that are kept on disk between runs, in the user's cache folder, if nobody else could have written to it."""

import grp
import hashlib
import os
import pwd
import stat
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import lru_cache
from io import BytesIO
from pathlib import Path

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.files import write_bytes

PLACE = "TOOLKIT_CACHE"
"""Environment variable with another folder for the cache."""
PACKAGE = Path(__file__).parents[1]
MOST_BYTES = 512 * 2**20
"""Largest size of all cached arrays, bytes; the least recently used are deleted first."""
DIGEST_BYTES = hashlib.sha256().digest_size
Arrays = dict[str, np.ndarray]


def cache_root() -> Path:
    """Return the folder of the cache, which need not exist."""
    home = os.environ.get("XDG_CACHE_HOME") or str(Path("~/.cache").expanduser())
    return Path(os.environ.get(PLACE) or Path(home) / "toolkit")


def keep_arrays(kind: str, inputs: Sequence[object], make: Callable[[], Arrays]) -> Arrays:
    """Return the result of `make`, from disk if this version made it from the same inputs before.

    Args:
        kind: kind of the arrays, for the file's name.
        inputs: all inputs besides the package's sources: arrays, or objects that `repr` distinguishes.
        make: function that returns named arrays without Python objects.
    """
    # without a folder that is safe, nothing is kept
    folder = _arrays_folder(cache_root())
    if folder is None:
        return make()
    # the key: sources of the package, and all inputs
    digest = hashlib.sha256(_hash_sources())
    for part in inputs:
        if isinstance(part, np.ndarray):
            # the shape too: arrays of other shapes may hold the same bytes
            digest.update(f"{part.dtype} {part.shape}".encode() + part.tobytes())
        else:
            digest.update(f"{part!r};".encode())
    file = folder / f"{kind}-{digest.hexdigest()[:32]}"
    with suppress(OSError, ValueError):
        content = file.read_bytes()
        # a damaged file is made again
        if hashlib.sha256(content[DIGEST_BYTES:]).digest() == content[:DIGEST_BYTES]:
            # no pickles: arrays alone cannot run code
            with np.load(BytesIO(content[DIGEST_BYTES:]), allow_pickle=False) as stored:
                found = {name: stored[name] for name in stored.files}
            # the files that were used last are kept longest
            os.utime(file)
            return found
    made = make()
    stream = BytesIO()
    np.savez(stream, **made)  # type: ignore[arg-type]  # its stubs take any name for `allow_pickle`
    with suppress(OSError, ToolkitError):  # a full disk costs only time in the next run
        write_bytes(file, hashlib.sha256(stream.getvalue()).digest() + stream.getvalue())
        _trim(folder)
    return made


@lru_cache(maxsize=4)
def _arrays_folder(root: Path) -> Path | None:
    with suppress(OSError):
        folder = root / "arrays"
        make_private(folder)
        return folder if os.access(folder, os.W_OK) and not explain_distrust(folder) else None
    return None


@lru_cache(maxsize=1)
def _hash_sources() -> bytes:
    digest = hashlib.sha256(np.__version__.encode())
    root = str(PACKAGE)
    # as text: making a `Path` of each of many hundred files takes longer than to look at them
    sources = (f"{folder}/{name}" for folder, _, names in os.walk(root) for name in names if name.endswith(".py"))
    for source in sorted(sources):
        facts = os.stat(source)  # noqa: PTH116
        digest.update(f"{source[len(root) :]} {facts.st_size} {facts.st_mtime_ns}".encode())
    return digest.digest()


def _trim(folder: Path) -> None:
    facts = sorted(((file.stat(), file) for file in folder.iterdir()), key=lambda pair: pair[0].st_mtime)
    spare = sum(status.st_size for status, _ in facts) - MOST_BYTES
    # oldest first
    for status, file in facts:
        if spare <= 0:
            break
        file.unlink(missing_ok=True)
        spare -= status.st_size


OTHERS_READ_OR_WRITE = stat.S_IRWXG | stat.S_IRWXO


def make_private(folder: Path) -> bool:
    """Make a folder, with missing folders above it, for this user alone; return whether it is new."""
    missing = [place for place in (folder, *folder.parents) if not place.is_dir()]
    for place in reversed(missing):
        place.mkdir(mode=0o700, exist_ok=True)
    return bool(missing)


def explain_distrust(folder: Path) -> str:
    """Return why somebody else could have written into a folder, or replaced it; empty if nobody could.

    Everything in it must belong to this user, be no link, and be closed to others. Folders above may belong to the
    administrator, or be shared and sticky as /tmp is.
    """
    mine = os.geteuid()
    # who may change folders above: this user or the administrator
    trusted = (mine, Path("/").stat().st_uid)  # the administrator, also in a container
    folder = folder.absolute()
    # both as it is written and with links followed
    for above in dict.fromkeys((*folder.parents, *(folder.parent.resolve() / folder.name).parents)):
        facts = above.stat()
        if facts.st_uid not in trusted:
            return f"{above} belongs to another user"
        if _is_open(facts) and not facts.st_mode & stat.S_ISVTX:
            return f"others may write to {above}"
    # nobody else can reach what lies in a closed folder
    is_closed = not folder.lstat().st_mode & OTHERS_READ_OR_WRITE
    for path in (folder, *folder.rglob("*")):
        try:
            facts = path.lstat()
        except FileNotFoundError:  # another process has just renamed a file
            continue
        if stat.S_ISLNK(facts.st_mode):
            return f"{path} is a link"
        if facts.st_uid != mine:
            return f"{path} belongs to another user"
        has_second_name = stat.S_ISREG(facts.st_mode) and facts.st_nlink > 1
        if _is_open(facts) and (not is_closed or has_second_name):  # nobody else comes into a closed folder
            return f"others may write to {path}"
    return ""


def _is_open(facts: os.stat_result) -> bool:
    """Whether others may write; many systems make a group of the owner alone, which does not count."""
    if facts.st_mode & stat.S_IWOTH or not facts.st_mode & stat.S_IWGRP:
        return bool(facts.st_mode & stat.S_IWOTH)
    try:
        owner, group = pwd.getpwuid(facts.st_uid), grp.getgrgid(facts.st_gid)
    except KeyError:
        return True
    is_own = owner.pw_gid == group.gr_gid and owner.pw_name == group.gr_name and set(group.gr_mem) <= {owner.pw_name}
    return not is_own
