"""Files that are whole or absent: written under a temporary name, then renamed."""

import contextlib
import errno
import hashlib
import json
import os
import sys
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from toolkit.core.errors import ToolkitError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

Model = TypeVar("Model", bound=BaseModel)

WRITE_TROUBLE = {
    errno.ENOSPC: "the disk is full: free some space and run the same command again, it goes on where it stopped",
    errno.EDQUOT: "the disk quota is used up: free some space and run the same command again",
    errno.EROFS: "the file system is read-only: choose a folder that you can write to",
    errno.EACCES: "permission denied: choose a folder that you can write to",
}


def explain_write_error(path: Path, error: OSError) -> ToolkitError:
    """One line for an `OSError` met while writing `path`."""
    why = WRITE_TROUBLE.get(error.errno or 0, str(error.strerror or error))
    return ToolkitError(f"cannot write {path}: {why}")


def write_bytes(path: Path, content: bytes) -> Path:
    """Write `content` to `path` so that an interruption leaves the old file or the new one, never half of one.

    Raises:
        ToolkitError: the disk is full or read-only, or the folder may not be written.
    """
    path = Path(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        raise explain_write_error(path, error) from error
    return path


def write_text(path: Path, content: str) -> Path:
    """`write_bytes` for UTF-8 text."""
    return write_bytes(path, content.encode())


def write_json(path: Path, content: Any) -> Path:
    """`write_bytes` for JSON, indented so that a person can read and edit it."""
    return write_text(path, json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def sha256_bytes(content: bytes) -> str:
    """SHA-256 of `content`, 64 hex digits."""
    return hashlib.sha256(content).hexdigest()


def sha256_file(path: Path) -> str:
    """SHA-256 of a file, 64 hex digits, read in blocks."""
    digest = hashlib.sha256()
    with Path(path).open("rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()


def _validate(path: Path, content: Any, model: type[Model]) -> Model:
    try:
        return model.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or "(whole file)"
        found = "" if first["type"] == "missing" else f", found {json.dumps(first['input'], default=str)[:80]}"
        raise ToolkitError(
            f"{path}: field '{field}': {first['msg']}{found}: correct the file, or delete it to get the default back"
        ) from None


def read_json(path: Path, model: type[Model]) -> Model:
    """Read and validate a JSON file.

    Raises:
        ToolkitError: the file is missing, is not JSON, or a field is wrong; the message names file and field.
    """
    try:
        return _validate(path, json.loads(Path(path).read_text(encoding="utf-8")), model)
    except (OSError, UnicodeDecodeError) as error:
        raise ToolkitError(f"cannot read {path}: {error}") from None
    except json.JSONDecodeError as error:
        raise ToolkitError(f"{path}: not JSON at line {error.lineno}: {error.msg}") from None


def read_toml(path: Path, model: type[Model]) -> Model:
    """Read and validate a TOML file; raises as `read_json` does."""
    try:
        return _validate(path, tomllib.loads(Path(path).read_text(encoding="utf-8")), model)
    except (OSError, UnicodeDecodeError) as error:
        raise ToolkitError(f"cannot read {path}: {error}") from None
    except tomllib.TOMLDecodeError as error:
        raise ToolkitError(f"{path}: not TOML: {error}") from None


def inside(root: Path, relative: str) -> Path:
    """`root / relative`, for a path that came from a file.

    Raises:
        ToolkitError: the path leaves `root`, or is no path at all.
    """
    root = Path(root).resolve()
    try:
        path = (root / relative).resolve()
    except (ValueError, OSError, RuntimeError) as error:  # a null byte; a loop of links
        raise ToolkitError(f"path {relative!r} in {root} cannot be used: {error}") from None
    if not path.is_relative_to(root):
        raise ToolkitError(f"path '{relative}' leaves its folder {root}: expected a path inside it")
    return path
