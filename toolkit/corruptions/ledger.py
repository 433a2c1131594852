"""What `toolkit corrupt` has put into a folder: its settings, and one line per finished file."""

import json
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from toolkit.core.errors import ToolkitError
from toolkit.core.files import explain_write_error, inside, read_json, write_json

SETTINGS_FILE = "corruption.json"
LEDGER_FILE = "corrupted.jsonl"


class FolderSettings(BaseModel):
    """What all images of a folder have in common.

    Attributes:
        schema_version: of this file.
        corruption, severity: of every image, None where they lie in folders NAME/SEVERITY.
        seed: of the run.
        size_px: side that the images were resized and cut to, None for their own.
        image_format: png or jpg.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: Literal[1] = 1
    corruption: str | None = None
    severity: int | None = None
    seed: int = 0
    size_px: int | None = None
    image_format: str = "png"


class Line(BaseModel):
    """One finished file: its path below the folder, its hash, and the hash of the file it was made from."""

    model_config = ConfigDict(extra="ignore", frozen=True)
    path: str
    sha256: str
    source_sha256: str


def claim_folder(folder: Path, settings: FolderSettings) -> None:
    """Write the settings into `folder`, or see that those in it are the same.

    Raises:
        ToolkitError: it holds images made with other settings, or cannot be written.
    """
    file = folder / SETTINGS_FILE
    if not file.is_file():
        write_json(file, settings.model_dump())
        return
    before = read_json(file, FolderSettings)
    for field, wanted in settings.model_dump().items():
        found = getattr(before, field)
        if found != wanted:
            raise ToolkitError(
                f"{folder} holds images of {field} {found}, not {wanted}: name another folder to write to"
            )


def read_ledger(folder: Path) -> dict[str, Line]:
    """Lines by path; a half-written last line (a kill while appending) is passed over.

    Raises:
        ToolkitError: a line before the last is broken, or a path leaves the folder.
    """
    file = folder / LEDGER_FILE
    if not file.is_file():
        return {}
    known: dict[str, Line] = {}
    lines = file.read_text(encoding="utf-8", errors="replace").split("\n")
    for number, text in enumerate(lines, 1):
        if not text:
            continue
        try:
            line = Line.model_validate(json.loads(text))
        except (json.JSONDecodeError, ValidationError):
            if number == len(lines):
                break
            raise ToolkitError(f"{file}: line {number} is broken: delete that line") from None
        inside(folder, line.path)
        known[line.path] = line
    return known


def append_lines(folder: Path, lines: list[Line]) -> None:
    """Append `lines`; a half-written last line is dropped first."""
    file = folder / LEDGER_FILE
    try:
        if file.is_file():
            with file.open("r+b") as stream:
                content = stream.read()
                stream.truncate(content.rfind(b"\n") + 1)
        with file.open("ab") as stream:
            stream.write("".join(json.dumps(line.model_dump(), ensure_ascii=False) + "\n" for line in lines).encode())
    except OSError as error:
        raise explain_write_error(file, error) from error
