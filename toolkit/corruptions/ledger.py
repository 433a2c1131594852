"""What `toolkit corrupt` has put into a folder: its settings, and one line per finished file."""

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from toolkit.core.errors import ToolkitError
from toolkit.core.files import inside, read_json, write_json
from toolkit.core.records import RecordLog

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


def open_ledger(folder: Path) -> RecordLog[Line]:
    """The log of a folder's finished files."""
    return RecordLog(folder / LEDGER_FILE, Line)


def read_ledger(folder: Path) -> dict[str, Line]:
    """Lines by path; a half-written last line (a kill while appending) is passed over.

    Raises:
        ToolkitError: a line before the last is broken, or a path leaves the folder.
    """
    known = open_ledger(folder).read_last(lambda line: line.path)
    for path in known:
        inside(folder, path)
    return known
