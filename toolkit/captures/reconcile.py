"""What of a capture folder counts: images that are what their manifest says, each once, and why the others do not.

A result is only as good as its images. Every reader of captures takes them from `reconcile`, by way of
`toolkit.captures.read.read_captures`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from toolkit.captures.capture import UNPATCHED, Capture
from toolkit.captures.manifest import LEFT_OUT, MANIFEST, CaptureRecord
from toolkit.core.errors import ToolkitError
from toolkit.rig.variants import VARIANTS

SHEET = "sheet_sha256"
SHORT = 8
"""Digits of a hash that tell two boosters of one variant apart."""


@dataclass(frozen=True)
class SetAside:
    """An image that does not count.

    Attributes:
        path: SOURCE/OBJECT/VARIANT/FILE.
        reason: why, in words; what is before a colon is the same for all images of one kind.
        is_fault: the folder contradicts itself there; False if the image was left out on purpose, or is a copy.
    """

    path: str
    reason: str
    is_fault: bool = True

    @property
    def kind(self) -> str:
        """The reason without what is of this image alone."""
        return self.reason.partition(": ")[0]

    def as_json(self) -> dict[str, str | bool]:
        """The fields of `summary.json`."""
        return {"path": self.path, "reason": self.reason, "fault": self.is_fault}


@dataclass(frozen=True)
class SourceManifest:
    """What the manifest of one source says.

    Attributes:
        source: name of the source.
        folder: where the manifest lies.
        records: its last line for each path below the folder.
        originals: of a source of corrupted copies, the lines of the source that they were made from.
    """

    source: str
    folder: Path
    records: dict[str, CaptureRecord]
    originals: dict[str, CaptureRecord]

    @cached_property
    def paths(self) -> dict[str | None, str]:
        """Path of each image by the hash of its file; of equal images the first."""
        return {record.image_sha256: path for path, record in reversed(self.records.items())}


def reconcile(
    captures: Sequence[Capture], manifests: Mapping[str, SourceManifest], *, trust_files: bool = False
) -> tuple[list[Capture], list[SetAside]]:
    """Compare images with their manifests.

    An image counts if its file is the one that the manifest's line describes. In a source without a manifest every
    image counts. Copies of one photograph count once.

    Args:
        captures: images as they lie in the folder, with what their lines say.
        manifests: by source, of those that have one.
        trust_files: count images that differ from their line, or that have none, by their folder and name.

    Returns:
        The images that count, and those that do not. A variant whose images carry several boosters becomes several,
        such as `patched-3fa2b1c0`.

    Raises:
        ToolkitError: a manifest says that images called `unpatched` carry a booster, or that images called after one
            carry none.
    """
    counted: list[Capture] = []
    aside: list[SetAside] = []
    for capture in captures:
        manifest = manifests.get(capture.source)
        if capture.refused is not None or manifest is None:
            counted.append(capture)
            continue
        fault = None if trust_files else _find_fault(capture, manifest)
        why = fault or _find_exclusion(capture, manifest)
        if why:
            aside.append(SetAside(capture.path, why, fault is not None))
        else:
            counted.append(capture)
    _check_variants(counted, manifests)
    counted, doubles = _drop_doubles(_split_boosters(counted), manifests)
    return counted, [*aside, *doubles]


def find_missing(
    captures: Sequence[Capture], manifests: Mapping[str, SourceManifest], *, is_whole: bool = True
) -> list[SetAside]:
    """Return the lines of manifests whose image is gone.

    An image is missing where others of its folder are there. A folder that is gone as a whole may have been deleted on
    purpose, which is no fault.

    Args:
        captures: all images that were found.
        manifests: by source.
        is_whole: `captures` are all of their sources; else folders that are gone as a whole are not looked for.
    """
    found = {capture.path for capture in captures}
    pictures = {capture.image_sha256 for capture in captures}
    folders = {capture.path.rpartition("/")[0] for capture in captures}
    missing = []
    for manifest in manifests.values():
        for path, record in manifest.records.items():
            shown = f"{manifest.source}/{path}"
            if shown in found or LEFT_OUT in record.made:
                continue
            if shown.rpartition("/")[0] in folders:
                why = f"{MANIFEST} lists it, and the file is gone: bring it back, or delete its line"
                missing.append(SetAside(shown, why))
            elif is_whole and record.image_sha256 not in pictures and not (manifest.folder / path).parent.exists():
                missing.append(SetAside(shown, f"{MANIFEST} lists it, and its folder is gone", is_fault=False))
    return missing


def _find_fault(capture: Capture, manifest: SourceManifest) -> str | None:
    """Return what an image and its line contradict each other in; None if nothing."""
    record = manifest.records.get(capture.path_in_source)
    sha256 = capture.image_sha256
    if record is not None and record.image_sha256 in (None, sha256):
        return None
    # the same bytes may be listed elsewhere: then a folder or file was renamed, swapped or copied
    own = manifest.paths.get(sha256) if sha256 else None
    if own is not None:
        return (
            f"{MANIFEST} lists this picture in another place: {manifest.source}/{own}. Was a folder or file renamed, "
            "swapped or copied?"
        )
    if record is None:
        return f"{MANIFEST} does not list it: import it, or sort it into a source of its own"
    return f"it is not the picture that {MANIFEST} lists (another SHA-256): was it edited or replaced?"


def _find_exclusion(capture: Capture, manifest: SourceManifest) -> str | None:
    """Return why an image was left out on purpose, or belongs to an earlier picture; None if it counts."""
    record = manifest.records.get(capture.path_in_source)
    if record is None:
        return None
    if LEFT_OUT in record.made:
        return str(record.made[LEFT_OUT])
    original = manifest.originals.get(str(record.made.get("of", "")).partition("/")[2])
    if original is not None and not _is_of(record, original):
        return f"made from an earlier picture: {record.made['of']} is another now. Corrupt that source again"
    return None


def _is_of(copy: CaptureRecord, original: CaptureRecord) -> bool:
    """Return whether a corrupted copy was made from what the original's line describes today."""
    made_from = copy.made.get("of_sha256")
    if made_from is not None:
        return bool(made_from == original.image_sha256)
    # copies of earlier versions do not say it: then by what was photographed, and from where
    facts = ("booster_sha256", "T_world_camera", "pose_id")
    return all(getattr(copy, name) == getattr(original, name) for name in facts)


def _check_variants(captures: Sequence[Capture], manifests: Mapping[str, SourceManifest]) -> None:
    """Refuse a variant that is called one thing while the manifest says another; raises as `reconcile`."""
    for capture in captures:
        manifest = manifests.get(capture.source)
        record = manifest.records.get(capture.path_in_source) if manifest else None
        if record is None:
            continue
        if capture.variant == UNPATCHED and record.booster_sha256:
            said = f"carries the booster {record.made.get('booster') or record.booster_sha256[:SHORT]}"
        elif (
            capture.variant in VARIANTS
            and capture.variant != UNPATCHED
            and capture.is_rendered
            and not record.booster_sha256
        ):
            said = "carries no booster"
        else:
            continue
        raise ToolkitError(
            f"{capture.path} is called '{capture.variant}', and by {MANIFEST} it {said}: were the folders swapped? "
            "Rename them back, or shoot the object again"
        )


def _split_boosters(captures: Sequence[Capture]) -> list[Capture]:
    """Return the images; a variant of an object with several boosters, or sheets of several sizes, is split."""
    boosters: dict[tuple[str, str, str], set[str]] = {}
    sheets: dict[tuple[str, str, str], set[str]] = {}
    for capture in captures:
        if capture.booster_sha256:
            group = capture.source, capture.object, capture.variant
            boosters.setdefault(group, set()).add(capture.booster_sha256)
            # a line of an earlier version does not say where the sheet is: it goes with any
            sheets.setdefault(group, set()).update([str(capture.settings[SHEET])] if SHEET in capture.settings else [])
    split = []
    for capture in captures:
        group, name = (capture.source, capture.object, capture.variant), capture.variant
        if capture.booster_sha256 and len(boosters[group]) > 1:
            name += f"-{capture.booster_sha256[:SHORT]}"
        elif capture.booster_sha256 is None and capture.refused is None and group in boosters:
            name += "-unknown"  # no line states what is on it, though those of others do
        if capture.booster_sha256 and len(sheets[group]) > 1:
            name += f"-{str(capture.settings.get(SHEET, 'unknown'))[:SHORT]}"
        split.append(replace(capture, variant=name))
    return split


def _drop_doubles(
    captures: Sequence[Capture], manifests: Mapping[str, SourceManifest]
) -> tuple[list[Capture], list[SetAside]]:
    """Return the images without those that are there twice, and the ones that were dropped."""
    order = {(manifest.source, path): at for manifest in manifests.values() for at, path in enumerate(manifest.records)}
    first: dict[tuple[object, ...], Capture] = {}
    dropped: list[SetAside] = []
    # the newest line of a pose that was shot twice, as JPEG and PNG; the first name of a photograph
    for capture in sorted(captures, key=lambda one: (-order.get((one.source, one.path_in_source), -1), one.path)):
        if capture.refused is not None:
            continue
        if capture.is_by_plan and capture.pose_id is not None:
            key: tuple[object, ...] = (
                capture.source,
                capture.object,
                capture.variant,
                capture.pose_id,
                capture.T_world_camera,
            )
            why = "the same pose was shot again: {} counts"
        elif not capture.is_rendered:
            key = (capture.source, capture.object, capture.variant, capture.image_sha256 or capture.path)
            why = "a copy of a photograph that counts once: {}"
        else:
            continue
        kept = first.setdefault(key, capture)
        if kept is not capture:
            dropped.append(SetAside(capture.path, why.format(kept.path), is_fault=False))
    gone = {one.path for one in dropped}
    return [capture for capture in captures if capture.path not in gone], dropped
