"""Put a photograph into a capture folder."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from toolkit import __version__
from toolkit.captures.capture import UNPATCHED
from toolkit.captures.manifest import CaptureRecord, append_record, read_manifest
from toolkit.core.errors import ToolkitError
from toolkit.core.files import delete_file, link_file, sha256_bytes, sha256_file, sha256_json, write_bytes
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import encode_image, show_path
from toolkit.objects.load import load_object
from toolkit.objects.spec import read_spec
from toolkit.rig.variants import VARIANTS, find_booster, note_booster
from toolkit.rooms.photos.gates import Check
from toolkit.rooms.photos.importing.evidence import Evidence
from toolkit.rooms.photos.importing.gather import REPLACED, CaptureKey, SourceIndex, drop_records, find_images
from toolkit.rooms.photos.importing.match import Decision
from toolkit.rooms.photos.photo import SUFFIXES, ExifFacts, Photo, load_pixels, read_preview, write_exif

JPEG_QUALITY = 95
HOW = {"dng": "preview of a raw photograph", "video": "frame of a video"}


@dataclass(frozen=True)
class Subject:
    """Facts of the workspace on the object and booster of a photograph, when it is stored.

    Attributes:
        booster_sha256: of the booster's PNG, None without a booster, or if it is not known.
        made: class of the object, name of the booster, and hash of size and place of its sheet.
    """

    booster_sha256: str | None = None
    made: dict[str, Any] = field(default_factory=dict, hash=False)


def read_subject(workspace: Workspace, name: str, variant: str) -> tuple[Subject, str | None]:
    """Return the facts on an object in a variant, and why its booster is not known, if so."""
    specs = workspace.object_specs()
    made: dict[str, Any] = {}
    try:
        if name in specs:
            made["class"] = str(read_spec(specs[name]).class_name)
        # the booster of a variant that the user named is not known
        if variant == UNPATCHED or variant not in VARIANTS:
            return Subject(None, made), None
        item = load_object(workspace.object_spec(name))
        booster = find_booster(workspace, item, variant)
    except ToolkitError as error:
        return Subject(None, made), str(error)
    if booster is None:
        return Subject(None, made), None
    made |= note_booster(booster)
    # where the sheet lies goes into the record, so a moved sheet shows
    if place := booster.describe_place(item):
        made["sheet_sha256"] = sha256_json(place)
    return Subject(booster.sha256, made), None


def store_photo(
    index: SourceIndex, evidence: Evidence, decision: Decision, subject: Subject,
    check: Check | None = None, link: bool = False,
) -> tuple[CaptureRecord, bool]:  # fmt: skip
    """Write a photograph and its record; an earlier image of the same pose is kept aside in `.replaced`.

    A kill at any moment loses nothing: the same call resumes. Old images are copied aside before they are touched, and
    the new image is whole before it has a line in the manifest.

    Args:
        index: of the source.
        evidence: the photograph and its camera.
        decision: object, variant and pose.
        subject: from `read_subject`.
        check: the gates.
        link: make a hard link if the file stays as it is and lies on the same disk.

    Returns:
        Its record, and whether it was linked, not copied.

    Raises:
        ToolkitError: the disk is full, read-only or not to be written.
        UnreadableImage: the photograph does not decode.
    """
    photo, key, root = evidence.candidate.photo, decision.key, index.source_dir
    # the bytes that will be written, and their hash in the record
    content = encode_photo(photo)
    name = f"pose_{key.pose_id:02d}{SUFFIXES[photo.kind]}"
    file = root / key.object / key.variant / name
    record = _describe(evidence, decision, subject, sha256_bytes(content))
    # gates judge before anything is written, and never keep a photograph out
    if check is not None:
        verdicts = check(photo, load_pixels(photo), record)
        advice = [f"{verdict.name}: {verdict.advice}" for verdict in verdicts if verdict.failed]
        gates = {verdict.name: None if verdict.value is None else float(verdict.value) for verdict in verdicts}
        made = {**record.made, "gates": gates, **({"retake": advice} if advice else {})}
        record = record.model_copy(update={"made": made})
    # the very file that is to be written may be there from a killed run: it is not old
    images = find_images(index, key)
    old = [path for path in images if not (path == file and sha256_file(path) == record.image_sha256)]
    for path in old:
        _keep_aside(index, path, key)
    # only an original whose bytes are kept as they are; a link is refused across disks, and then they are copied
    linked = link and photo.kind not in HOW and link_file(photo.path, file, root)
    if not linked:
        write_bytes(file, content, root)
    for path in old:
        if path != file:
            delete_file(path)
    # the manifest's line comes after the image: a line always has its image
    append_record(root, record)
    drop_records(root, {show_path(path.relative_to(root).parts) for path in old if path != file})
    return record, linked


def encode_photo(photo: Photo) -> bytes:
    """Return the bytes for a capture folder: the original's, a DNG's preview, or a video's frame as JPEG."""
    if photo.kind == "dng":
        return read_preview(photo.path)
    if photo.kind != "video":
        return photo.path.read_bytes()
    facts = ExifFacts(photo.taken, photo.camera, photo.focal_mm, photo.focal_35mm_mm)
    return encode_image(load_pixels(photo), "JPEG", quality=JPEG_QUALITY, subsampling=0, exif=write_exif(facts))


def _describe(evidence: Evidence, decision: Decision, subject: Subject, image_sha256: str) -> CaptureRecord:
    photo, key, located, match = evidence.candidate.photo, decision.key, evidence.located, decision.match
    # facts of the photograph itself
    made: dict[str, Any] = {
        "with": f"toolkit {__version__}", "how": HOW.get(photo.kind, "photograph"), "camera": photo.camera,
        "taken": photo.taken.isoformat() if photo.taken else None, "focal_mm": photo.focal_mm,
        "focal_35mm_mm": photo.focal_35mm_mm, "original_name": show_path((photo.path.name,)),
        "original_sha256": photo.sha256, "matched_by": decision.matched_by,
        **subject.made,
    }  # fmt: skip
    if photo.frame is not None:
        made["frame"] = photo.frame
    # facts of a table of pairs and of the plan
    known = {
        "class": decision.class_name, "pose": decision.pose_name, "row": decision.row,
        "pose_sha256": decision.pose_sha256,
    }  # fmt: skip
    made |= {name: value for name, value in known.items() if value}
    # the camera by the board
    if match is not None:
        made |= {"pose_error_deg": round(match.error_deg, 3), "pose_error_mm": round(match.error_mm, 2)}
    if located is not None:
        made |= dict(located.details)
        if any(located.camera.distortion):
            made["distortion"] = list(located.camera.distortion)
    elif evidence.no_board != Evidence.no_board:
        made["no_pose"] = evidence.no_board
    name = f"pose_{key.pose_id:02d}{SUFFIXES[photo.kind]}"
    return CaptureRecord(
        path=f"{key.object}/{key.variant}/{name}", object=key.object, variant=key.variant,
        pose_id=key.pose_id, intrinsics=located.camera.intrinsics if located else None,
        T_world_camera=np.round(located.T_world_camera, 6).tolist() if located else None,
        booster_sha256=subject.booster_sha256, image_sha256=image_sha256, made=made,
    )  # fmt: skip


def _keep_aside(index: SourceIndex, file: Path, key: CaptureKey) -> None:
    """Copy an image that gives way to .replaced/OBJECT/VARIANT/NAME-HASH.SUFFIX, with its record."""
    content = file.read_bytes()
    sha256 = sha256_bytes(content)
    aside = index.source_dir / REPLACED
    path = f"{key.object}/{key.variant}/{file.stem}-{sha256[:8]}{file.suffix}"
    # the name holds the content's hash, so a call that was interrupted does not keep it twice
    if not ((aside / path).is_file() and sha256_file(aside / path) == sha256):
        write_bytes(aside / path, content, index.source_dir)
    record = index.records.get(show_path((key.object, key.variant, file.name)))
    if record is not None and record.image_sha256 == sha256 and show_path((path,)) not in read_manifest(aside):
        append_record(aside, record.model_copy(update={"path": show_path((path,))}))
