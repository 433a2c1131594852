"""Put a photograph into a capture folder, and know what was imported before."""

import contextlib
import io
import json
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from PIL import Image

from toolkit import __version__
from toolkit.captures.manifest import MANIFEST, CaptureRecord, append_record, read_manifest
from toolkit.captures.read import read_pose_id
from toolkit.core.files import explain_write_error, inside, sha256_bytes, sha256_file, write_bytes, write_text
from toolkit.imaging.folder import show_path
from toolkit.imaging.read import is_image_name
from toolkit.photos.exif import ExifFacts, read_preview, write_exif
from toolkit.photos.importing.decide import Decision
from toolkit.photos.importing.evidence import Evidence, Target
from toolkit.photos.importing.gather import Candidate
from toolkit.photos.photo import SUFFIXES, Photo, load_pixels

REPLACED = ".replaced"
"""Folder of photographs that were replaced, below the source's; hidden, so that nothing counts them."""


@dataclass(frozen=True)
class Ledger:
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


def read_ledger(source_dir: Path) -> Ledger:
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
    return Ledger(source_dir, current, replaced, records)


def find_original(record: CaptureRecord) -> tuple[str, int | None] | None:
    """The identity of the photograph that a record was imported from; None for images that were not imported."""
    sha256, frame = record.made.get("original_sha256"), record.made.get("frame")
    return (sha256, frame) if isinstance(sha256, str) and (frame is None or isinstance(frame, int)) else None


def is_whole(source_dir: Path, record: CaptureRecord) -> bool:
    """Whether a record's image is there, as it was written."""
    file = inside(source_dir, record.path)
    return file.is_file() and sha256_file(file) == record.image_sha256


def find_occupants(ledger: Ledger, target: Target) -> list[Path]:
    """Images that are there for a target, imported or put there by hand."""
    folder = ledger.source_dir / target.object / target.variant
    if not folder.is_dir():
        return []
    found = []
    for file in sorted(folder.iterdir()):
        if file.name.startswith(".") or not is_image_name(file.name) or not file.is_file():
            continue
        record = ledger.records.get(show_path((target.object, target.variant, file.name)))
        pose_id = record.pose_id if record is not None and record.pose_id is not None else read_pose_id(file.name)
        if pose_id == target.pose_id:
            found.append(file)
    return found


def list_poses(ledger: Ledger, name: str, variant: str, pose_ids: Iterable[int]) -> set[int]:
    """Which of an object's poses have an image in a variant."""
    return {pose_id for pose_id in pose_ids if find_occupants(ledger, Target(name, variant, pose_id))}


def describe_before(ledger: Ledger, photo: Photo) -> str | None:
    """Where a photograph was imported to before; None where it was not."""
    if record := ledger.current.get(photo.identity):
        return f"imported before, as {record.path}"
    if record := ledger.replaced.get(photo.identity):
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


JPEG_QUALITY = 95
HOW = {"dng": "preview of a raw photograph", "video": "frame of a video"}


class Verdict(Protocol):
    """What a gate says of one photograph; `toolkit.photos.gates` makes them."""

    @property
    def name(self) -> str:
        """Of the gate."""

    @property
    def value(self) -> float | None:
        """What was measured."""

    @property
    def failed(self) -> bool:
        """Whether it was measured and is not good enough."""

    @property
    def advice(self) -> str:
        """What to do when it is not."""


Check = Callable[[Photo, np.ndarray, CaptureRecord], Sequence[Verdict]]
"""(photo, its pixels (h, w, 3) uint8, its record) -> what the gates say."""


@dataclass(frozen=True)
class Stored:
    """An imported photograph: its record, the gates' advice for a retake, and whether it was linked, not copied."""

    record: CaptureRecord
    advice: tuple[str, ...]
    linked: bool


def store_photo(
    ledger: Ledger, candidate: Candidate, decision: Decision, evidence: Evidence, booster_sha256: str | None,
    check: Check | None = None, link: bool = False,
) -> Stored:  # fmt: skip
    """Write one photograph and its record; an image that is there for the same pose is kept aside in `.replaced`.

    A kill at any moment loses nothing: the same call goes on. Old images are copied aside before they are touched, the
    new one is whole before it has a line in the manifest.

    Args:
        ledger: of the source.
        candidate: the photograph.
        decision, evidence: what it shows, and how that is known.
        booster_sha256: of the PNG that is stuck on, None without one.
        check: the gates.
        link: make a hard link where the file can stay as it is and lies on the same disk.

    Raises:
        ToolkitError: the disk is full, read-only or not to be written.
        UnreadableImage: the photograph does not decode.
    """
    photo, target, root = candidate.photo, decision.target, ledger.source_dir
    content = encode_photo(photo)
    name = f"pose_{target.pose_id:02d}{SUFFIXES[photo.kind]}"
    file = root / target.object / target.variant / name
    record = _describe(candidate, decision, evidence, booster_sha256, sha256_bytes(content))
    advice: tuple[str, ...] = ()
    if check is not None:
        verdicts = check(photo, load_pixels(photo), record)
        advice = tuple(f"{one.name}: {one.advice}" for one in verdicts if one.failed)
        gates = {one.name: None if one.value is None else float(one.value) for one in verdicts}
        made = {**record.made, "gates": gates, **({"retake": list(advice)} if advice else {})}
        record = record.model_copy(update={"made": made})
    old = [
        one for one in find_occupants(ledger, target) if not (one == file and sha256_file(one) == record.image_sha256)
    ]
    for one in old:
        _keep_aside(ledger, one, target)
    linked = link and content_is_file(photo) and _link(photo.path, file)
    if not linked:
        write_bytes(file, content)
    for one in old:
        if one != file:
            one.unlink(missing_ok=True)
    append_record(root, record)
    drop_records(root, {show_path(one.relative_to(root).parts) for one in old if one != file})
    return Stored(record, advice, linked)


def encode_photo(photo: Photo) -> bytes:
    """The bytes that go into a capture folder: the original's, a DNG's preview, or a video's frame as JPEG."""
    if photo.kind == "dng":
        return read_preview(photo.path)
    if photo.kind != "video":
        return photo.path.read_bytes()
    buffer = io.BytesIO()
    facts = ExifFacts(photo.taken, photo.camera, photo.focal_mm, photo.focal_35mm_mm)
    picture = Image.fromarray(load_pixels(photo))
    picture.save(buffer, "JPEG", quality=JPEG_QUALITY, subsampling=0, exif=write_exif(facts))
    return buffer.getvalue()


def content_is_file(photo: Photo) -> bool:
    """Whether the original's bytes go into the capture folder as they are."""
    return photo.kind not in HOW


def _describe(
    candidate: Candidate, decision: Decision, evidence: Evidence, booster_sha256: str | None, image_sha256: str
) -> CaptureRecord:
    photo, target, located, match = candidate.photo, decision.target, evidence.located, decision.match
    made: dict[str, Any] = {
        "with": f"toolkit {__version__}", "how": HOW.get(photo.kind, "photograph"), "camera": photo.camera,
        "taken": photo.taken.isoformat() if photo.taken else None, "focal_mm": photo.focal_mm,
        "focal_35mm_mm": photo.focal_35mm_mm, "original_name": show_path((photo.path.name,)),
        "original_sha256": photo.sha256, "matched_by": decision.matched_by,
    }  # fmt: skip
    if photo.frame is not None:
        made["frame"] = photo.frame
    if match is not None:
        made |= {"pose_error_deg": round(match.error_deg, 3), "pose_error_mm": round(match.error_mm, 2)}
    if located is not None:
        made |= dict(located.details)
        if any(located.camera.distortion):
            made["distortion"] = list(located.camera.distortion)
    name = f"pose_{target.pose_id:02d}{SUFFIXES[photo.kind]}"
    return CaptureRecord(
        path=f"{target.object}/{target.variant}/{name}", object=target.object, variant=target.variant,
        pose_id=target.pose_id, intrinsics=located.camera.intrinsics if located else None,
        T_world_camera=np.round(located.T_world_camera, 6).tolist() if located else None,
        booster_sha256=booster_sha256, image_sha256=image_sha256, made=made,
    )  # fmt: skip


def _keep_aside(ledger: Ledger, file: Path, target: Target) -> None:
    """Copy an image that gives way to .replaced/OBJECT/VARIANT/NAME-HASH.SUFFIX, with its record."""
    content = file.read_bytes()
    sha256 = sha256_bytes(content)
    aside = ledger.source_dir / REPLACED
    path = f"{target.object}/{target.variant}/{file.stem}-{sha256[:8]}{file.suffix}"
    if not ((aside / path).is_file() and sha256_file(aside / path) == sha256):
        write_bytes(aside / path, content)
    record = ledger.records.get(show_path((target.object, target.variant, file.name)))
    if record is not None and record.image_sha256 == sha256 and show_path((path,)) not in read_manifest(aside):
        append_record(aside, record.model_copy(update={"path": show_path((path,))}))


def _link(original: Path, file: Path) -> bool:
    """Make a hard link under a temporary name and rename it; False where the file system has none."""
    partial = file.with_name(f".{file.name}.{os.getpid()}.partial")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        partial.unlink(missing_ok=True)
        partial.hardlink_to(original.resolve())
    except OSError:
        return False  # another disk, or one without links: the caller copies
    try:
        partial.replace(file)
    except OSError as error:
        raise explain_write_error(file, error) from error
    finally:
        with contextlib.suppress(OSError):  # renaming one link over another of the same file leaves both
            partial.unlink(missing_ok=True)
    return True
