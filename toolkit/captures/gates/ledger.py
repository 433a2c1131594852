"""`captures/SOURCE/gates.jsonl`: what the gates said of each photograph, so that none is judged twice."""

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from toolkit.captures.gates.check_photo import PhotoCheck
from toolkit.captures.gates.moved import lines_from_json
from toolkit.captures.gates.result import GateResult
from toolkit.files import explain_write_error, sha256_file
from toolkit.workspace import Workspace

GATES_FILE = "gates.jsonl"
VERSION = 1
"""Of the measures: photographs that were judged by others are judged anew."""


def hash_setup(workspace: Workspace) -> str:
    """Hash of all but the image that a photograph's results follow from: board, lenses, patches, objects, measures."""
    digest = hashlib.sha256(f"gates {VERSION}".encode())
    for file in (workspace.root / "rig" / "board.json", workspace.root / "rig" / "lens.json"):
        digest.update(file.read_bytes() if file.is_file() else b"none")
    for name, file in sorted(workspace.patches().items()):
        digest.update(f"{name} {sha256_file(file)}".encode())
    # meshes may be large: their size and time tell a change
    for file in sorted(workspace.objects_dir.glob("*")):
        found = file.stat()
        digest.update(f"{file.name} {found.st_size} {found.st_mtime_ns}".encode())
    return digest.hexdigest()


def append_check(source_dir: Path, path: str, image_sha256: str, check: PhotoCheck, setup: str) -> None:
    """Append one photograph's results, whole and on disk when this returns.

    Args:
        source_dir: captures/SOURCE.
        path: of the image below it.
        image_sha256: of the image that was judged.
        check: from `inspect_photo`.
        setup: from `hash_setup`.

    Raises:
        ToolkitError: the file cannot be written.
    """
    file = Path(source_dir) / GATES_FILE
    line = {
        "setup": setup, "path": path, "image_sha256": image_sha256,
        "results": [result.to_json() for result in check.results],
        "lines": check.lines.to_json() if check.lines is not None else None,
    }  # fmt: skip
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("ab") as stream:
            # a line that a killed run left half-written is ended by the line's end before this one
            stream.write(b"\n" * (stream.tell() > 0) + json.dumps(line, ensure_ascii=False).encode())
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise explain_write_error(file, error) from error


def read_checks(source_dir: Path, setup: str) -> dict[tuple[str, str], PhotoCheck]:
    """Results by (path, image's hash), the last of each; lines that are broken or of another setup are passed over.

    Nothing is lost by that: such a photograph is judged again.
    """
    file = Path(source_dir) / GATES_FILE
    if not file.is_file():
        return {}
    found = {}
    for line in file.read_bytes().split(b"\n"):
        try:
            content = json.loads(line)
            if content["setup"] == setup:
                found[(content["path"], content["image_sha256"])] = _read_check(content)
        except (ValueError, KeyError, TypeError, AttributeError):
            continue
    return found


def _read_check(content: Mapping[str, Any]) -> PhotoCheck:
    results = tuple(GateResult(**result) for result in content["results"])
    return PhotoCheck(results, lines_from_json(content["lines"]) if content["lines"] else None)
