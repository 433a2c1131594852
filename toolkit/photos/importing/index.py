"""What was imported into a source of photographs, and which image stands for which pose."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from toolkit.captures.manifest import MANIFEST, CaptureRecord, read_manifest
from toolkit.captures.read import read_pose_id
from toolkit.core.files import inside, sha256_file, write_text
from toolkit.imaging.read import is_image_name, show_path
from toolkit.photos.photo import Photo

REPLACED = ".replaced"
"""Folder of photographs that were replaced, below the source's; hidden, so that nothing counts them."""


@dataclass(frozen=True)
class CaptureKey:
    """The place of an image in a capture folder: an object, a variant, a pose of the plan."""

    object: str
    variant: str
    pose_id: int

    def __str__(self) -> str:
        return f"{self.object}/{self.variant} pose {self.pose_id}"


@dataclass(frozen=True)
class SourceIndex:
    """Photographs of a source.

    Attributes:
        source_dir: captures/SOURCE.
        current: what lies there now and is whole, by the identity of its original.
        replaced: what was there before a retake, likewise.
        records: all current records by path.
    """

    source_dir: Path
    current: dict[tuple[str, int | None], CaptureRecord]
    replaced: dict[tuple[str, int | None], CaptureRecord]
    records: dict[str, CaptureRecord]


def index_source(source_dir: Path) -> SourceIndex:
    """Read what was imported into a source; a file that was deleted or changed since counts as not imported.

    Lines of replaced images, which a run that was killed may have left, are taken out.

    Raises:
        ToolkitError: a manifest is broken.
    """
    records = read_manifest(source_dir)
    kept_aside = read_manifest(source_dir / REPLACED).values()
    replaced = {original: record for record in kept_aside if (original := find_original(record))}
    stale = {
        path
        for path, record in records.items()
        if find_original(record) in replaced and not inside(source_dir, path).is_file()
    }
    drop_records(source_dir, stale)
    records = {path: record for path, record in records.items() if path not in stale}
    current = {
        original: record
        for record in records.values()
        if (original := find_original(record)) and is_whole(source_dir, record)
    }
    return SourceIndex(source_dir, current, replaced, records)


def find_original(record: CaptureRecord) -> tuple[str, int | None] | None:
    """The identity of the photograph that a record was imported from; None for images that were not imported."""
    sha256, frame = record.made.get("original_sha256"), record.made.get("frame")
    return (sha256, frame) if isinstance(sha256, str) and (frame is None or isinstance(frame, int)) else None


def is_whole(source_dir: Path, record: CaptureRecord) -> bool:
    """Whether a record's image is there, as it was written."""
    file = inside(source_dir, record.path)
    return file.is_file() and sha256_file(file) == record.image_sha256


def find_images(index: SourceIndex, key: CaptureKey) -> list[Path]:
    """Images that are there for a key, imported or put there by hand."""
    folder = index.source_dir / key.object / key.variant
    if not folder.is_dir():
        return []
    found = []
    for file in sorted(folder.iterdir()):
        if file.name.startswith(".") or not is_image_name(file.name) or not file.is_file():
            continue
        record = index.records.get(show_path((key.object, key.variant, file.name)))
        pose_id = record.pose_id if record is not None and record.pose_id is not None else read_pose_id(file.name)
        if pose_id == key.pose_id:
            found.append(file)
    return found


def list_poses(index: SourceIndex, name: str, variant: str, pose_ids: Iterable[int]) -> set[int]:
    """Which of an object's poses have an image in a variant."""
    return {pose_id for pose_id in pose_ids if find_images(index, CaptureKey(name, variant, pose_id))}


def describe_imported(index: SourceIndex, photo: Photo) -> str | None:
    """Where a photograph was imported to before; None where it was not."""
    if record := index.current.get(photo.identity):
        return f"imported before, as {record.path}"
    if record := index.replaced.get(photo.identity):
        return f"imported before, and replaced by a later one (kept as {REPLACED}/{record.path})"
    return None


def drop_records(source_dir: Path, paths: set[str]) -> None:
    """Take the lines of images that are no longer there out of the manifest, which is whole at every moment."""
    file = source_dir / MANIFEST
    if not paths or not file.is_file():
        return
    lines = file.read_text(encoding="utf-8", errors="replace").split("\n")
    kept = [line for line in lines if line.strip() and _path_in(line) not in paths]
    if len(kept) < sum(1 for line in lines if line.strip()):
        write_text(file, "".join(f"{line}\n" for line in kept))


def _path_in(line: str) -> str | None:
    try:
        return json.loads(line).get("path")
    except (ValueError, AttributeError):  # the cut end of a killed run
        return None
