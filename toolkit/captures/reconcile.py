"""Decide which images of a capture folder count: those that match their manifest, each once.

Every reader of captures uses `reconcile`, through `toolkit.captures.read.read_captures`.
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
"""Digits of a hash in the name of a variant with several boosters."""


@dataclass(frozen=True)
class SetAside:
    """An image that does not count.

    Attributes:
        reason: reason in words; the part before a colon is the same for all images of a kind.
        is_fault: whether the image contradicts its manifest; False if it was left out on purpose, or is a copy.
    """

    path: str
    reason: str
    is_fault: bool = True

    @property
    def kind(self) -> str:
        """Reason without the details of this image."""
        return self.reason.partition(": ")[0]

    def as_json(self) -> dict[str, str | bool]:
        """Return the fields of `summary.json`."""
        return {"path": self.path, "reason": self.reason, "fault": self.is_fault}


@dataclass(frozen=True)
class SourceManifest:
    """The manifest of a source.

    Attributes:
        records: last line of each path below the folder.
        originals: for corrupted copies, the lines of their original source.
    """

    source: str
    folder: Path
    records: dict[str, CaptureRecord]
    originals: dict[str, CaptureRecord]

    @cached_property
    def paths(self) -> dict[str | None, str]:
        """Path of each image by the hash of its file; the first of equal images."""
        return {record.image_sha256: path for path, record in reversed(self.records.items())}


def reconcile(
    captures: Sequence[Capture], manifests: Mapping[str, SourceManifest], *, trust_files: bool = False
) -> tuple[list[Capture], list[SetAside]]:
    """Compare images with their manifests.

    An image counts if its file is the file in the manifest's line. Without a manifest every image counts. Copies of a
    photograph count once.

    Args:
        trust_files: count images that contradict their line, or have no line, by folder and name.

    Returns:
        The images that count, and those that do not. A variant with several boosters is split into several variants,
        such as `patched-3fa2b1c0`.

    Raises:
        ToolkitError: by the manifest, images called `unpatched` carry a booster, or images with a booster's name carry
            none.
    """
    counted: list[Capture] = []
    aside: list[SetAside] = []
    # each image against its line
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
    # checked before variants are split, while they still have their folders' names
    _check_variants(counted, manifests)
    counted, doubles = _drop_doubles(_split_boosters(counted), manifests)
    return counted, [*aside, *doubles]


def find_missing(
    captures: Sequence[Capture], manifests: Mapping[str, SourceManifest], *, is_whole: bool = True
) -> list[SetAside]:
    """Return the lines of manifests whose image is gone; a whole folder that is gone is not a fault.

    Args:
        is_whole: whether `captures` are complete sources; else folders that are gone do not count.
    """
    # by path and by picture: a folder that was renamed is not missing
    found = {capture.path for capture in captures}
    pictures = {capture.image_sha256 for capture in captures}
    folders = {capture.path.rpartition("/")[0] for capture in captures}
    missing = []
    for manifest in manifests.values():
        for path, record in manifest.records.items():
            shown = f"{manifest.source}/{path}"
            # lines that were left out on purpose may lose their image
            if shown in found or LEFT_OUT in record.made:
                continue
            if shown.rpartition("/")[0] in folders:
                why = f"{MANIFEST} lists it, and the file is gone: bring it back, or delete its line"
                missing.append(SetAside(shown, why))
            elif is_whole and record.image_sha256 not in pictures and not (manifest.folder / path).parent.exists():
                missing.append(SetAside(shown, f"{MANIFEST} lists it, and its folder is gone", is_fault=False))
    return missing


def _find_fault(capture: Capture, manifest: SourceManifest) -> str | None:
    """Return how an image contradicts its line; None if it does not."""
    record = manifest.records.get(capture.path_in_source)
    # a line without a hash was written by an earlier version: it fits any file
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
    return f"it is not the picture in {MANIFEST} (another SHA-256): was it edited or replaced?"


def _find_exclusion(capture: Capture, manifest: SourceManifest) -> str | None:
    """Return why an image was left out on purpose, or is a copy of an earlier image; None if it counts."""
    # only a line can say that an image was left out
    record = manifest.records.get(capture.path_in_source)
    if record is None:
        return None
    if LEFT_OUT in record.made:
        return str(record.made[LEFT_OUT])
    # `of` names source and path of the original: the source's name is cut off
    original = manifest.originals.get(str(record.made.get("of", "")).partition("/")[2])
    if original is None:
        return None
    # a corrupted copy counts if its original is unchanged; copies of earlier versions hold no hash of it
    facts = ("booster_sha256", "T_world_camera", "pose_id")
    is_same = all(getattr(record, name) == getattr(original, name) for name in facts)
    if record.made.get("of_sha256") is not None:
        is_same = record.made["of_sha256"] == original.image_sha256
    if is_same:
        return None
    return f"made from an earlier picture: {record.made['of']} has changed since. Corrupt that source again"


def _check_variants(captures: Sequence[Capture], manifests: Mapping[str, SourceManifest]) -> None:
    """Refuse a variant whose name contradicts the manifest; raises as `reconcile`."""
    for capture in captures:
        manifest = manifests.get(capture.source)
        record = manifest.records.get(capture.path_in_source) if manifest else None
        if record is None:
            continue
        # a variant with a name of the toolkit's own must carry a booster; what others mean is not known
        if capture.variant == UNPATCHED and record.booster_sha256:
            said = f"carries the booster {record.made.get('booster') or record.booster_sha256[:SHORT]}"
        elif capture.variant in {*VARIANTS} - {UNPATCHED} and capture.is_rendered and not record.booster_sha256:
            said = "carries no booster"
        else:
            continue
        raise ToolkitError(
            f"{capture.path} is called '{capture.variant}', and by {MANIFEST} it {said}: were the folders swapped? "
            "Rename them back, or shoot the object again"
        )


def _split_boosters(captures: Sequence[Capture]) -> list[Capture]:
    """Split variants of an object with several boosters, or with sheets of several sizes."""
    boosters: dict[tuple[str, str, str], set[str]] = {}
    sheets: dict[tuple[str, str, str], set[str]] = {}
    for capture in captures:
        if capture.booster_sha256:
            group = capture.source, capture.object, capture.variant
            boosters.setdefault(group, set()).add(capture.booster_sha256)
            # lines of earlier versions do not state the sheet's place: they go with any
            sheets.setdefault(group, set()).update([str(capture.settings[SHEET])] if SHEET in capture.settings else [])
    # an image is renamed only where its group has several
    split = []
    for capture in captures:
        group, name = (capture.source, capture.object, capture.variant), capture.variant
        if capture.booster_sha256 and len(boosters[group]) > 1:
            name += f"-{capture.booster_sha256[:SHORT]}"
        elif capture.booster_sha256 is None and capture.refused is None and group in boosters:
            name += "-unknown"  # its booster is not known, those of other images are
        if capture.booster_sha256 and len(sheets[group]) > 1:
            name += f"-{str(capture.settings.get(SHEET, 'unknown'))[:SHORT]}"
        split.append(replace(capture, variant=name))
    return split


def _drop_doubles(
    captures: Sequence[Capture], manifests: Mapping[str, SourceManifest]
) -> tuple[list[Capture], list[SetAside]]:
    """Return the images without doubles, and the doubles."""
    # the order of the lines is the order in which images were made
    order = {(manifest.source, path): at for manifest in manifests.values() for at, path in enumerate(manifest.records)}
    first: dict[tuple[object, ...], Capture] = {}
    dropped: list[SetAside] = []
    # of a pose that was shot twice the newest line counts, of copies of a photograph the first name
    for capture in sorted(captures, key=lambda item: (-order.get((item.source, item.path_in_source), -1), item.path)):
        if capture.refused is not None:
            continue
        place = capture.source, capture.object, capture.variant
        if capture.is_by_plan and capture.pose_id is not None:
            key: tuple[object, ...] = (*place, capture.pose_id, capture.T_world_camera)
            why = "the same pose was shot again: {} counts"
        elif not capture.is_rendered:
            key = (*place, capture.image_sha256 or capture.path)
            why = "a copy of a photograph that counts once: {}"
        else:
            continue
        kept = first.setdefault(key, capture)
        if kept is not capture:
            dropped.append(SetAside(capture.path, why.format(kept.path), is_fault=False))
    # the first of each key counts
    gone = {item.path for item in dropped}
    return [capture for capture in captures if capture.path not in gone], dropped
