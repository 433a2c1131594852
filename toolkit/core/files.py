"""Files: read within bounds, and written whole or not at all, never outside of their folder."""

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import re
import secrets
import shutil
import stat
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from pydantic import BaseModel, ValidationError

from toolkit.core.errors import ToolkitError
from toolkit.core.places import check_links

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

Model = TypeVar("Model", bound=BaseModel)

MOST_JSON_BYTES = 64 << 20
"""A plan of 10 000 poses of each of ten objects takes 40 MB."""
MOST_TOML_BYTES = 1 << 20
MOST_NAME_BYTES = 255
MOST_LEVELS = 50
"""Largest depth of nesting in JSON and TOML; our files have seven levels."""
BETWEEN_KEYS, KEY_DOT = re.compile(r"[=\[\]{},#\n]"), re.compile(r"[\w\"'-][ \t]*\.")
NO_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
NO_FOLLOWING = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
NOT_PLAIN = "it is a pipe or a device, expected a plain file"
SECOND_NAME = "the file has a second name (a hard link), and would change there too: delete this name"

WRITE_TROUBLE = {
    errno.ENOSPC: "the disk is full: free some space and run the same command again to resume",
    errno.EDQUOT: "the disk quota is used up: free some space and run the same command again",
    errno.EFBIG: "it is larger than this disk or account allows (ulimit -f): write elsewhere, and run it again",
    errno.EROFS: "the file system is read-only: choose a folder that you can write to",
    errno.EACCES: "permission denied: choose a folder that you can write to",
    errno.EISDIR: "a folder of that name is there: choose another name",
    errno.ENAMETOOLONG: "the name is too long for the file system: choose one under 200 bytes",
    errno.ELOOP: "it is a link, which is not followed: write to its target, or delete the link",
}
READ_TROUBLE = {
    errno.ENOENT: "no such file",
    errno.ENOTDIR: "no such file: a part of its path is a file, not a folder",
    errno.EISDIR: "it is a folder, expected a file",
    errno.EACCES: "permission denied",
    errno.ELOOP: "its links lead in a circle",
    errno.ENAMETOOLONG: "no such file: the name is longer than any file's",
}


def explain_write_error(path: Path, error: OSError, doing: str = "write") -> ToolkitError:
    """Return the error for an `OSError` while writing `path`, or `doing` something else to it."""
    if error.errno in (errno.ENOTDIR, errno.EEXIST):
        file = next((place for place in (Path(path), *Path(path).parents) if place.is_file()), None)
        if file is not None:
            return ToolkitError(f"cannot write {path}: {file} is a file, expected a folder: choose another place")
    why = WRITE_TROUBLE.get(error.errno or 0, str(error.strerror or error))
    return ToolkitError(f"cannot {doing} {path}: {why}")


def explain_read_error(path: Path, error: OSError | ValueError) -> ToolkitError:
    """Return the error for an exception while reading `path`; an impossible path raises a `ValueError`."""
    code = getattr(error, "errno", None)
    return ToolkitError(f"cannot read {path}: {READ_TROUBLE.get(code or 0, getattr(error, 'strerror', None) or error)}")


POINTER = b"version https://git-lfs.github.com/"


def open_plain(path: Path) -> BinaryIO:
    """Open a plain file to read; pipes and devices, which may never end, are refused.

    Raises:
        OSError: it does not exist, is not a plain file, may not be read, or is a Git LFS pointer.
    """
    # open first, then check: the file could change in between
    number = os.open(path, os.O_RDONLY | NO_WAITING)
    kind = os.fstat(number).st_mode
    if stat.S_ISREG(kind):
        file = os.fdopen(number, "rb")
        # a clone without Git LFS holds a few lines in place of each large file
        if file.peek(len(POINTER)).startswith(POINTER):
            file.close()
            raise OSError(errno.EINVAL, "it is a Git LFS pointer, not the file: run 'git lfs pull' there", str(path))
        return file
    os.close(number)
    if stat.S_ISDIR(kind):
        raise IsADirectoryError(errno.EISDIR, "it is a folder, expected a file", str(path))
    raise OSError(errno.EINVAL, NOT_PLAIN, str(path))


def open_in_place(path: Path, flags: int = 0) -> int:
    """Open a log or a lock to change it in place, without truncation; it is made if it is missing.

    Raises:
        OSError: it is a link, has a second name, is not a plain file, or may not be written.
    """
    # without waiting for a pipe's other end, without following a link
    number = os.open(path, os.O_RDWR | os.O_CREAT | NO_WAITING | NO_FOLLOWING | flags, 0o666)
    facts = os.fstat(number)
    # a second name could be a file outside of the workspace
    if stat.S_ISREG(facts.st_mode) and facts.st_nlink < 2:
        return number
    os.close(number)
    if stat.S_ISREG(facts.st_mode):
        raise OSError(errno.EMLINK, SECOND_NAME, str(path))
    raise OSError(errno.EINVAL, NOT_PLAIN, str(path))


def read_bytes(path: Path, most_bytes: int) -> bytes:
    """Return the content of a plain file.

    Raises:
        ToolkitError: it does not exist, is not plain, may not be read, or is larger than `most_bytes`.
    """
    try:
        with open_plain(path) as file:
            # a byte more than allowed, as the file may grow meanwhile
            content = file.read(most_bytes + 1)
    except (OSError, ValueError) as error:
        raise explain_read_error(path, error) from None
    if len(content) > most_bytes:
        raise ToolkitError(f"cannot read {path}: it is larger than {most_bytes >> 20} MB, the most that is read")
    return content


@contextlib.contextmanager
def open_whole(path: Path, root: Path | None = None) -> Iterator[BinaryIO]:
    """Open a file that replaces `path` when the block has ended, and is deleted if the block fails.

    All files are written here. A link at `path` is replaced, not followed.

    Args:
        path: file to write.
        root: folder that must hold the file, after following links, for a path from another file.

    Raises:
        ToolkitError: the path leaves `root`, or a link in a workspace leads to it (see `check_links`); something else
            than a file is there, the disk is full or read-only, or the folder may not be written.
    """
    path = Path(path)
    try:
        # checked before the first byte is written
        make_folder(path.parent, root)
        _check_replaceable(path)
        number, partial = _open_partial(path)
        with os.fdopen(number, "wb") as file:
            try:
                yield file
                file.flush()
                # on disk before the rename, or a crash could leave the new name on an empty file
                os.fsync(file.fileno())
                partial.replace(path)  # before it is closed, while it is locked
            except BaseException:
                with contextlib.suppress(OSError):
                    partial.unlink(missing_ok=True)
                raise
    except OSError as error:
        raise explain_write_error(path, error) from error


def _open_partial(path: Path) -> tuple[int, Path]:
    """Return a temporary file beside `path`: new, or of a killed run, never a file in use."""
    partial = path.with_name(f".{path.name}.partial")
    with contextlib.suppress(OSError):
        number = open_in_place(partial)
        with contextlib.suppress(OSError):
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(number), partial.lstat()):  # not renamed by its last holder
                os.truncate(number, 0)
                return number, partial
        os.close(number)
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    return os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | NO_FOLLOWING, 0o666), partial


def _check_replaceable(path: Path) -> None:
    """Raise an `OSError` for a folder, a pipe, a device, or a link to them, which a renamed file would replace."""
    try:
        kind = path.stat().st_mode
    except OSError:  # nothing is there, or a link to nothing
        return
    if stat.S_ISDIR(kind):
        raise IsADirectoryError(errno.EISDIR, "it is a folder", str(path))
    is_stream = path.is_symlink() and str(path.readlink()).startswith("/proc/")  # /dev/stdout, sent to a file
    if is_stream or not stat.S_ISREG(kind):
        raise OSError(errno.EINVAL, NOT_PLAIN, str(path))


def make_folder(folder: Path, root: Path | None = None) -> Path:
    """Make a folder and the folders above it; raises as `open_whole`."""
    if root is not None:
        # links are followed on both sides, or a link within would lead out
        home = real_path(root)
        try:
            # the folder need not exist yet
            place = Path(folder).resolve()
        except (ValueError, OSError, RuntimeError) as error:  # a null byte; a loop of links
            raise ToolkitError(f"cannot write to {str(folder)!r}: {error}") from None
        if not place.is_relative_to(home):
            raise ToolkitError(f"'{folder}' leads outside {home}, to {place}: nothing is written there")
    # a link in a workspace from somebody else is not followed
    check_links(folder)
    try:
        with contextlib.suppress(FileNotFoundError):  # another process has just removed an empty folder above
            folder.mkdir(parents=True, exist_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise explain_write_error(folder, error) from error
    return folder


def real_path(path: Path) -> Path:
    """Return `path` without links and dots; unlike `Path.resolve`, links in a circle do not raise."""
    return Path(os.path.realpath(path))


def delete_file(path: Path) -> None:
    """Delete a file or a link, if it exists; a `ToolkitError` as `check_links`, or if it may not be deleted."""
    check_links(path.parent)
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        if error.errno != errno.ENOTDIR:  # its folder is a file: there is nothing to delete
            raise explain_write_error(path, error, "delete") from error


def delete_folder(folder: Path) -> None:
    """Delete a folder with its content, as far as allowed; raises as `check_links`."""
    check_links(folder)
    shutil.rmtree(folder, ignore_errors=True)


def walk_folders(
    root: Path, on_error: Callable[[OSError], None] = lambda error: None
) -> Iterator[tuple[Path, list[str], list[str]]]:
    """Yield each folder from `root` down, with the sorted names of its folders and files, as `os.walk`.

    Folders that the caller takes out of the list are skipped. There is no recursion, which ends at a thousand levels.
    Links to folders are listed and not followed. `on_error` gets the error of a folder that may not be read.
    """

    def is_folder(entry: "os.DirEntry[str]") -> bool:
        try:
            return entry.is_dir()
        except OSError:  # links in a circle
            return False

    # a stack in place of recursion, the last folder on top
    waiting = [Path(root)]
    while waiting:
        here = waiting.pop()
        try:
            with os.scandir(here) as found:
                kinds = {entry.name: is_folder(entry) for entry in found}
        except OSError as error:
            on_error(error)
            continue
        folders = sorted(name for name, is_dir in kinds.items() if is_dir)
        yield here, folders, sorted(name for name, is_dir in kinds.items() if not is_dir)
        # reversed, so that folders come in the order of their names
        waiting += [here / name for name in reversed(folders) if not (here / name).is_symlink()]


def write_bytes(path: Path, content: bytes, root: Path | None = None) -> Path:
    """Write `content` to `path`; an interruption leaves the old or the new file. Raises as `open_whole`."""
    with open_whole(path, root) as file:
        file.write(content)
    return Path(path)


def write_text(path: Path, content: str, root: Path | None = None) -> Path:
    """Write UTF-8 text; see `write_bytes`."""
    return write_bytes(path, content.encode(), root)


def write_json(path: Path, content: Any, root: Path | None = None) -> Path:
    """Write indented JSON; see `write_bytes`."""
    return write_text(path, json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n", root)


def move_file(file: Path, path: Path, root: Path) -> Path:
    """Rename a file of the same disk to `path`; raises as `open_whole`."""
    make_folder(path.parent, root)
    try:
        _check_replaceable(path)
        return file.replace(path)
    except OSError as error:
        raise explain_write_error(path, error) from error


def link_file(original: Path, path: Path, root: Path) -> bool:
    """Make a hard link to a file at `path`; False on another disk, or without links. Raises as `open_whole`."""
    make_folder(path.parent, root)
    # a name of its own, which then replaces the file in a single step
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    try:
        partial.hardlink_to(original.resolve())
    except OSError:
        # another disk, or a file system without links
        return False
    try:
        _check_replaceable(path)
        partial.replace(path)
    except OSError as error:
        raise explain_write_error(path, error) from error
    finally:
        with contextlib.suppress(OSError):  # renaming a link over another of the same file leaves both
            partial.unlink(missing_ok=True)
    return True


def sha256_bytes(content: bytes) -> str:
    """Return the SHA-256 of `content`, 64 hex digits."""
    return hashlib.sha256(content).hexdigest()


def sha256_file(path: Path) -> str:
    """Return the SHA-256 of a plain file, 64 hex digits, read in blocks; raises as `open_plain`."""
    digest = hashlib.sha256()
    with open_plain(path) as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()


def sha256_json(content: Any) -> str:
    """Return the SHA-256 of a JSON value, keys in any order; other values are hashed as text."""
    return sha256_bytes(json.dumps(content, sort_keys=True, default=str).encode())


def load_json(path: Path) -> Any:
    """Return the content of a JSON file.

    Raises:
        ToolkitError: it cannot be read, is not JSON, or is too large or too deep.
    """
    content, constants = _load_json(path)
    if constants:
        raise ToolkitError(f"{path}: not JSON: {constants[0]} is not allowed as a number")
    return content


def _load_json(path: Path) -> tuple[Any, list[str]]:
    """Return the content, and the names of NaN and infinities, which are no JSON."""
    text = _read_text(path, MOST_JSON_BYTES)
    # Python's reader takes NaN and infinities, which no other program reads
    constants: list[str] = []

    def note(name: str) -> float:
        constants.append(name)
        return float(name)

    with _explain_syntax(path, "JSON"):
        content = json.loads(text, parse_constant=note)
        _check_depth(content)
        # escapes may hold half a pair of surrogates, which cannot be written
        if "\\u" in text:
            json.dumps(content, ensure_ascii=False).encode()
    return content, constants


@contextlib.contextmanager
def _explain_syntax(path: Path, kind: str) -> Iterator[None]:
    """Within, errors of a parser become a `ToolkitError`."""
    try:
        yield
    except json.JSONDecodeError as error:
        raise ToolkitError(f"{path}: not JSON at line {error.lineno}: {error.msg}") from None
    except RecursionError:
        raise ToolkitError(f"{path}: not read: more than {MOST_LEVELS} levels within one another") from None
    except UnicodeEncodeError:
        raise ToolkitError(f"{path}: not JSON: it holds half of a surrogate pair") from None
    except ValueError as error:  # also TOML's syntax
        why = "a number of thousands of digits" if "digits" in str(error) else error
        raise ToolkitError(f"{path}: not {kind}: {why}") from None


def read_json(path: Path, model: type[Model]) -> Model:
    """Read and validate a JSON file.

    Raises:
        ToolkitError: the file is missing, is not JSON, or a field is wrong; the message names file and field.
    """
    content, constants = _load_json(path)
    # the model's errors first: they name the field
    made = _validate(path, content, model)
    if constants:
        raise ToolkitError(f"{path}: not JSON: {constants[0]} is not allowed as a number")
    return made


def read_toml(path: Path, model: type[Model]) -> Model:
    """Read and validate a TOML file; raises as `read_json` does."""
    text = _read_text(path, MOST_TOML_BYTES)
    with _explain_syntax(path, "TOML"):
        # tomllib needs memory with the square of a dotted key's length
        if any(len(KEY_DOT.findall(part)) >= MOST_LEVELS for part in BETWEEN_KEYS.split(text)):
            raise RecursionError
        content = tomllib.loads(text)
        _check_depth(content)
    return _validate(path, content, model)


def _read_text(path: Path, most_bytes: int) -> str:
    try:
        return read_bytes(path, most_bytes).decode("utf-8-sig")  # Windows' editors write a byte order mark
    except UnicodeDecodeError as error:
        raise ToolkitError(f"cannot read {path}: not UTF-8 text at byte {error.start}: save it as UTF-8") from None


def _check_depth(content: Any) -> None:
    """Raise a `RecursionError` for too many levels, without recursion, which a deep file would exhaust."""
    level = [content]
    for _ in range(MOST_LEVELS):
        level = [
            child
            for node in level
            if isinstance(node, dict | list)
            for child in (node.values() if isinstance(node, dict) else node)
        ]
        if not level:
            return
    raise RecursionError


def _validate(path: Path, content: Any, model: type[Model]) -> Model:
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise ToolkitError(
            f"{path}: {explain_validation(error)}: correct the file, or delete it and make it again"
        ) from None


def explain_validation(error: ValidationError) -> str:
    """Return the first error with its field: `field 'camera.width': expected …, found 3`."""
    first = error.errors()[0]
    field = ".".join(str(part)[:40] for part in first["loc"])
    if first["type"] == "missing":
        # pydantic counts items from 0, people from 1
        place, _, last = field.rpartition(".")
        return f"field '{place}' has no item {int(last) + 1}" if last.isdigit() else f"field '{field}' is missing"
    if first["type"] == "extra_forbidden":
        return f"there is no field '{field}'"
    # pydantic names Python's classes here
    is_model = first["type"] in ("model_type", "model_attributes_type", "dataclass_type")
    words = "expected named fields" if is_model else first["msg"].removeprefix("Value error, ")
    words = words.replace("Input should be", "expected")
    if field or first["type"] != "value_error":
        # what was found is shown as it stands in the file
        found = json.dumps(first["input"], default=str)
        words += f", found {found if len(found) <= 80 else f'{found[:77]}...'}"
    return f"field '{field}': {words}" if field else words


def inside(root: Path, relative: str) -> Path:
    """Return `root / relative` for a path from a file; a `ToolkitError` if it leaves `root` or is no path."""
    root = Path(root).resolve()
    try:
        # followed, so that a link inside that leads out is found
        path = (root / relative).resolve()
        is_usable = all(len(os.fsencode(part)) <= MOST_NAME_BYTES for part in path.parts)
        if any(place.is_symlink() for place in (path, *path.parents)):
            raise OSError("links in a circle")  # Python 3.13 and later leave them unresolved
    except (ValueError, OSError, RuntimeError) as error:  # a null byte; a loop of links
        raise ToolkitError(f"path {relative!r} in {root} cannot be used: {error}") from None
    if not is_usable:
        raise ToolkitError(
            f"path '{relative[:60]}...' in {root} cannot be used: a name of over {MOST_NAME_BYTES} bytes"
        )
    if not path.is_relative_to(root):
        raise ToolkitError(f"path '{relative}' leaves its folder {root}: expected a path inside it")
    return path
