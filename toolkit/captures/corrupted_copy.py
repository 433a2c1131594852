"""Corrupt captures as ImageNet-C does: a corrupted copy of a source's images, in a source of its own.

The published parameters hold for images of 224². A shot is larger, and a network that shrinks it would remove part of
the corruption. So each shot is first resized and cut to 224², as published. `toolkit eval` shows such a file unchanged
to a network of 224 px, so with the usual preprocessing (256 px, 224² cut) the result equals `toolkit eval --corrupt`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from toolkit.captures.manifest import CaptureRecord, append_record, read_manifest, write_transforms
from toolkit.captures.read import find_faults
from toolkit.core.errors import FieldError
from toolkit.core.records import hold_folder
from toolkit.core.work import INPUTS
from toolkit.rig.camera import Camera

SEED = 0
"""Seed of every corrupted image, together with its path below the source."""
RESIZED_PX, CUT_PX = 256, 224
BENDING = ("elastic_transform",)
"""Corruptions that bend the image, so that no camera fits it."""

Corruption = tuple[str, int]


@dataclass(frozen=True)
class CorruptedSource:
    """A corrupted copy: folder, number of images made now and kept from before, and (path, reason) of failures."""

    source_dir: Path
    made: int
    kept: int
    failed: tuple[tuple[str, str], ...]


def name_source(source: str, corruption: Corruption) -> str:
    """Return `sim-fog-3`. Names are unique: no corruption's name has a hyphen."""
    return f"{source}-{corruption[0]}-{corruption[1]}"


def corrupt_source(source_dir: Path, corruptions: Sequence[Corruption]) -> list[CorruptedSource]:
    """Corrupt the images of a source into folders beside it: `captures/sim` in fog of 3 is `captures/sim-fog-3`.

    Each is a capture folder with the same objects, variants and poses. Finished images are kept; images that were shot
    again are corrupted again.

    Raises:
        ToolkitError: there are no images, the folder holds something else, or it cannot be written.
    """
    # brings torch, which is loaded only to corrupt
    from toolkit.corruptions.folder import corrupt_images

    made, skip = [], find_faults(source_dir)
    for corruption in corruptions:
        out = source_dir.with_name(name_source(source_dir.name, corruption))
        # two runs at once would both append to the manifest
        with hold_folder(out):
            # a folder that holds something else is left as it is
            for path, record in read_manifest(out).items():
                if (record.made.get("corruption"), record.made.get("severity")) != corruption:
                    why = f"{out} holds images that were not made by corrupting shots ({path}): name another {{source}}"
                    raise FieldError(why, {})
            done = corrupt_images(source_dir, out, [corruption], seed=SEED, size_px=CUT_PX, skip=skip)
            # after the images, as their hashes are in the records
            _write_records(source_dir, out, corruption)
        made.append(CorruptedSource(out, done.made, done.kept, tuple(done.failed)))
    return made


def _write_records(source_dir: Path, out: Path, corruption: Corruption) -> None:
    """Append the records of all images in the folder that the manifest lacks, also after a stopped run."""
    from toolkit.corruptions.folder import find_sources, read_finished

    shots, known, finished = read_manifest(source_dir), read_manifest(out), read_finished(out)
    records = []
    for source in find_sources(source_dir, out, "png")[0]:
        shot, line = shots.get(source.path), finished.get(source.target)
        # skip images that are not a copy of the shot as it is now
        if shot is None or line is None or line.source_sha256 != shot.image_sha256:
            continue
        record = _describe(shot, source.target, line.sha256, f"{source_dir.name}/{source.path}", corruption)
        records.append(record)
        if known.get(record.path) != record:
            append_record(out, record)
    # no camera fits a bent image
    if corruption[0] not in BENDING:
        write_transforms(out, sorted(records, key=lambda record: record.path))


def _describe(shot: CaptureRecord, path: str, sha256: str, of: str, corruption: Corruption) -> CaptureRecord:
    made = {
        "corruption": corruption[0], "severity": corruption[1], "corruption_seed": SEED, "cut_px": CUT_PX,
        "of": of, "of_sha256": shot.image_sha256,
    }  # fmt: skip
    changed = {
        "path": path, "image_sha256": sha256, "intrinsics": shot.intrinsics and cut_intrinsics(shot.intrinsics),
        "made": shot.made | made, INPUTS: None,  # the key is of the shot, not of the copy
    }  # fmt: skip
    return shot.model_copy(update=changed)


def cut_intrinsics(intrinsics: dict[str, float]) -> dict[str, float]:
    """Return the intrinsics after resizing and cutting to 224² as `toolkit.corruptions.folder.read_picture` does.

    Pixel centres are at half integers. A shot of 224² stays as it is.
    """
    width, height = round(intrinsics["width"]), round(intrinsics["height"])
    if width == height == CUT_PX:
        return intrinsics
    # the shorter side becomes 256 px, then the middle 224² are cut out
    short = min(width, height)
    # the long side is truncated and the corner rounded, as resize_and_crop does
    out_width, out_height = (int(RESIZED_PX * side / short) for side in (width, height))
    left, top = (round((side - CUT_PX) / 2) for side in (out_width, out_height))
    cut = Camera.from_intrinsics(intrinsics).scaled(out_width, out_height).cropped(left, top, CUT_PX, CUT_PX)
    return intrinsics | {name: float(value) for name, value in cut.intrinsics.items()}
