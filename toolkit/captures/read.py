"""Read a capture folder: `captures/SOURCE/OBJECT/VARIANT/FILE`, with a manifest or sorted by hand."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.captures.capture import SETTINGS, UNPATCHED, Capture
from toolkit.captures.manifest import MANIFEST, CaptureRecord, read_manifest
from toolkit.captures.reconcile import SetAside, SourceManifest, find_missing, reconcile
from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import real_path, sha256_file
from toolkit.core.text import is_folder_name, list_some
from toolkit.imaging.preprocessing import Preprocessing, resize_and_crop
from toolkit.imaging.read import FoundFiles, find_files, read_image, show_path

POOLED = "all"
LAYOUT = "SOURCE/OBJECT/VARIANT/FILE, for example captures/real/racer/patched/1.jpg"
# ImageNet's folders are called by WordNet ids: n and eight digits
WNID = re.compile(r"^n\d{8}$")
MAX_POSE_DIGITS = 5
MOST_LISTED = 5


@dataclass(frozen=True)
class CaptureFolder:
    """A capture folder.

    Attributes:
        root: the folder.
        captures: the images that count, by source, object, variant and path.
        refused_folders: (path, reason) of linked folders, whose images are missing.
        notes: what the reader should know and no image stands for: files passed over, several images of one pose.
        set_aside: the images that do not count, each with its reason.
        without_manifest: names of the sources that have none: their images are paired by name.
        is_trusted: images that differ from their manifest were counted all the same.
    """

    root: Path
    captures: tuple[Capture, ...]
    refused_folders: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    set_aside: tuple[SetAside, ...] = ()
    without_manifest: tuple[str, ...] = ()
    is_trusted: bool = False

    @property
    def faults(self) -> list[tuple[str, str]]:
        """(path, reason) of the images in which the folder contradicts itself."""
        return [(capture.path, capture.reason) for capture in self.set_aside if capture.is_fault]

    @cached_property
    def objects(self) -> list[str]:
        """Names of the objects, sorted."""
        return sorted({capture.object for capture in self.captures})


@dataclass(frozen=True)
class Selection:
    """Which part of a capture folder is meant; empty means all."""

    sources: tuple[str, ...] = ()
    objects: tuple[str, ...] = ()
    variants: tuple[str, ...] = ()


def find_captured(root: Path) -> FoundFiles:
    """The files of a capture folder, nothing of them read.

    Raises:
        ToolkitError: no folder, or no images in it.
    """
    found = find_files(root)
    if not found.images and not found.refused:
        raise ToolkitError(f"{root} holds no images: expected {LAYOUT}")
    return found


def read_captures(root: Path, selection: Selection | None = None, *, trust_files: bool = False) -> CaptureFolder:
    """Read `captures/`, one of its sources, one object's folder, or an ImageFolder whose folders are WordNet ids.

    Images are paired by pose: the manifest's pose id, else the number in the name (`pose_03.jpg`, `IMG_0003.jpg`), else
    names that are equal in several variants. What counts is decided by `toolkit.captures.reconcile`.

    Args:
        root: the folder.
        selection: which part of it is meant.
        trust_files: count images that are not as their manifest says, by their folder and name.

    Raises:
        ToolkitError: no folder, no images, images that are not sorted into folders, a broken manifest, an object called
            `all`, a selected source, object or variant that is not there, folders that contradict the manifest, or
            no image that counts.
    """
    root = Path(root)
    found = find_captured(root)
    prefix, depth, suffix = _read_layout(root, found)
    manifests: dict[Path, dict[str, CaptureRecord]] = {}
    sources: dict[str, Path] = {}
    captures: list[Capture] = []
    stray: list[str] = []
    unread: list[tuple[str, str]] = []
    for parts, refused in _all_files(found):
        if len(parts) - 1 < depth:
            if refused is None:
                stray.append(show_path(parts))
            else:
                unread.append((show_path(parts), refused))
            continue
        full = (*prefix, *parts[:depth], *suffix, *parts[depth:])
        # the manifest lies in the source's folder: below the root, the root itself, or above it
        source_dir = (root / parts[0], root, real_path(root).parent)[len(prefix)]
        if source_dir not in manifests:
            manifests[source_dir] = read_manifest(source_dir)
        sources[show_path((full[0],))] = source_dir
        record = manifests[source_dir].get("/".join(full[1:]))
        captures.append(_capture(root / Path(*parts), full, record, refused))
    known = {name: _open_source(name, folder, manifests[folder]) for name, folder in sources.items()}
    known = {name: one for name, one in known.items() if one.records}
    wanted = [replace(one, image_sha256=_hash_file(one)) for one in _select(captures, selection or Selection())]
    counted, aside = reconcile(_pair_by_stem(wanted), known, trust_files=trust_files)
    if not trust_files:
        # of a part of a source, other folders are not looked for
        is_whole = len(prefix) < 2 and (selection or Selection()) == Selection()
        aside += find_missing(wanted, known, is_whole=is_whole)
    if wanted and not counted:
        raise ToolkitError(f"{root}: none of {len(wanted)} images counts; {aside[0].path}: {aside[0].reason}")
    counted.sort(key=lambda capture: (capture.source, capture.object, capture.variant, capture.path))
    if any(capture.object == POOLED for capture in counted):
        raise ToolkitError(f"{root}: an object may not be called '{POOLED}', the pooled rows are: rename its folder")
    notes = (*_note_files(found, stray), *_note_retextured(counted), *_note_doubles(counted), *_note_aside(aside))
    without = sorted({one.source for one in counted} - known.keys())
    return CaptureFolder(
        root, tuple(counted), tuple(unread), notes, tuple(aside), tuple(without), is_trusted=trust_files and bool(known)
    )


def find_faults(root: Path) -> dict[str, str]:
    """Return the images below a folder that contradict their manifest, by path below it, and why.

    A folder without a manifest in it, or in a folder directly below it, has none.

    Raises:
        ToolkitError: as `read_captures`.
    """
    is_source = (root / MANIFEST).is_file()
    if not (root.is_dir() and (is_source or any(root.glob(f"*/{MANIFEST}")))):
        return {}
    faults = read_captures(root).faults
    return {path.partition("/")[2] if is_source else path: reason for path, reason in faults}


def _open_source(name: str, folder: Path, records: dict[str, CaptureRecord]) -> SourceManifest:
    """The manifest of a source; of corrupted copies also that of the source beside it that they were made from."""
    of = next((str(record.made["of"]) for record in records.values() if isinstance(record.made.get("of"), str)), "")
    beside = of.partition("/")[0]
    # a manifest may come from elsewhere: only a folder beside this one is meant
    originals = read_manifest(folder.absolute().with_name(beside)) if is_folder_name(beside) else {}
    return SourceManifest(name, folder, records, originals)


def _hash_file(capture: Capture) -> str | None:
    """Hash of an image's bytes; None if it must not or cannot be opened, which is told where it is read."""
    if capture.refused is not None:
        return None
    try:
        return sha256_file(capture.file)
    except (OSError, ToolkitError):
        return None


def read_pose_id(name: str) -> int | None:
    """The pose number in a file name: after `pose`, else the last number; None where there is none.

    A number stands alone, as in `IMG_0003`, or ends a name that is one word, as in `DSC01234`: in `bear1_2in_over` both
    belong to what is shown. A copy's mark such as ` (1)` is no pose, a number of more than five digits is a date or a
    time, and digits among letters, as in `38bdd950c1d0`, are a hash.
    """
    stem = re.sub(r"\s*\(\d+\)$", "", Path(name).stem)
    named = re.search(r"pose[\s_-]*(\d+)", stem, re.IGNORECASE)
    words = re.split(r"[^0-9A-Za-z]+", stem)
    numbers = [re.fullmatch(r"[A-Za-z]*(\d+)" if len(words) == 1 else r"(\d+)", word) for word in words]
    match = named or next((number for number in reversed(numbers) if number), None)
    return int(match[1]) if match and len(match[1]) <= MAX_POSE_DIGITS else None


def _pair_by_stem(captures: Sequence[Capture]) -> list[Capture]:
    """The captures; of those without a pose, equal names in several variants of an object are one, above all others."""
    groups: dict[tuple[str, str], list[Capture]] = {}
    for capture in captures:
        groups.setdefault((capture.source, capture.object), []).append(capture)
    paired: list[Capture] = []
    for group in groups.values():
        variants: dict[str, set[str]] = {}
        for one in group:
            if one.pose_id is None:
                # cameras and computers write IMG_1.JPG and img_1.jpg alike
                variants.setdefault(one.file.stem.lower(), set()).add(one.variant)
        shared = sorted(stem for stem, found in variants.items() if len(found) > 1)
        first = 1 + max((one.pose_id or 0 for one in group), default=0)
        ids = {stem: first + i for i, stem in enumerate(shared)}
        paired += [
            replace(one, pose_id=ids.get(one.file.stem.lower())) if one.pose_id is None else one for one in group
        ]
    return paired


def _all_files(found: FoundFiles) -> list[tuple[tuple[str, ...], str | None]]:
    files: list[tuple[tuple[str, ...], str | None]] = [(parts, None) for parts in found.images]
    return files + [(tuple(path.split("/")), reason) for path, reason in found.refused]


def _read_layout(root: Path, found: FoundFiles) -> tuple[tuple[str, ...], int, tuple[str, ...]]:
    """Folders that stand before and after those under `root` to make SOURCE/OBJECT/VARIANT, and how many those are."""
    name = real_path(root).name
    files = found.images or tuple(tuple(path.split("/")) for path, _ in found.refused)
    # most files decide: a stray picture beside the folders does not change how the rest is read
    depth = min(3, Counter(len(parts) - 1 for parts in files).most_common(1)[0][0])
    folders = {parts[0] for parts in files if len(parts) > 1}
    # a source itself: a manifest says so, or its name
    if (root / MANIFEST).is_file() or (name in ("sim", "real") and depth > 1):
        return (name,), 2, ()
    if depth == 0:
        raise ToolkitError(f"{root}: the images are not sorted into folders: expected {LAYOUT}")
    # an ImageFolder: classes for objects, all of them bare
    if depth == 1 and all(WNID.match(folder) for folder in folders):
        return (name,), 1, (UNPATCHED,)
    if depth == 1:
        return (real_path(root).parent.name or "captures", name), 1, ()
    return ((), 3, ()) if depth == 3 else ((name,), 2, ())


def _capture(file: Path, full: tuple[str, ...], record: CaptureRecord | None, refused: str | None) -> Capture:
    source, name, variant = (show_path((part,)) for part in full[:3])
    capture = Capture(source, name, variant, read_pose_id(full[-1]), file, path=show_path(full), refused=refused)
    if record is None:
        return capture
    rows, lens = record.T_world_camera, record.intrinsics
    return replace(
        capture,
        pose_id=record.pose_id if record.pose_id is not None else capture.pose_id,
        T_world_camera=tuple(tuple(row) for row in rows) if rows is not None else None,
        focal_length=lens["fx"] / max(lens["width"], lens["height"]) if lens else None,
        class_name=said if isinstance(said := record.made.get("class"), str) else None,
        booster_sha256=record.booster_sha256,
        is_rendered="renderer" in record.made,
        is_by_plan="renderer" in record.made and not {"like", "rehearsed"} & record.made.keys(),
        is_retextured="retextured" in record.made,
        settings=read_settings(record.made),
        **_read_corruption(record.made),
    )


def read_settings(made: dict[str, Any]) -> dict[str, Any]:
    """How an image was made, by the names of `toolkit.captures.capture.SETTINGS`, and the `booster`'s name."""
    found = {name: made[name] for name in (*SETTINGS, "booster") if name in made}
    if "renderer" not in made:  # a photograph's board and light are not the rig's
        # its class follows from the spec, unless a table states it
        names = ("pose_sha256", "sheet_sha256", "booster", *(["class"] if "row" in made else []))
        return {name: found[name] for name in names if name in found}
    # such as linen/studio/0-1810094345/board
    backdrop, light, _, *board = (*str(made.get("studio", "")).split("/"), "", "", "")[:4]
    named = {"backdrop": backdrop, "light": light, "board": board[0]} if light else {}
    return {"rehearsed": False} | found | named


def _read_corruption(made: dict[str, Any]) -> dict[str, Any]:
    name, severity, cut_px = (made.get(key) for key in ("corruption", "severity", "cut_px"))
    if not (isinstance(name, str) and isinstance(severity, int) and isinstance(cut_px, int)):
        return {}
    return {"corruption": (name, severity), "cut_px": cut_px}


def _select(captures: list[Capture], selection: Selection) -> list[Capture]:
    wanted = {"source": selection.sources, "object": selection.objects, "variant": selection.variants}
    for kind, names in wanted.items():
        known = sorted({getattr(capture, kind) for capture in captures})
        for name in names:
            if name not in known:
                raise one_of(f"{kind} in this folder", name, known)
        if names:
            captures = [capture for capture in captures if getattr(capture, kind) in names]
    return list(captures)


def _note_files(found: FoundFiles, stray: list[str]) -> list[str]:
    notes = []
    if found.others:
        notes.append(f"not images, not counted: {list_some(found.others, MOST_LISTED)}")
    if stray:
        notes.append(f"not inside SOURCE/OBJECT/VARIANT, not counted: {list_some(stray, MOST_LISTED)}")
    return notes


def _note_retextured(captures: list[Capture]) -> list[str]:
    counts = Counter((capture.object, capture.variant) for capture in captures if capture.is_retextured)
    if not counts:
        return []
    named = ", ".join(f"{name}/{variant} {count}" for (name, variant), count in sorted(counts.items()))
    return [f"retextured: photographs in which another patch replaces the printed one: {named}"]


def _note_doubles(captures: list[Capture]) -> list[str]:
    seen: dict[tuple[str, str, str], dict[int, list[Capture]]] = {}
    variants: dict[tuple[str, str], set[str]] = {}
    for capture in captures:
        variants.setdefault((capture.source, capture.object), set()).add(capture.variant)
        if capture.pose_id is not None:
            group = capture.source, capture.object, capture.variant
            seen.setdefault(group, {}).setdefault(capture.pose_id, []).append(capture)
    notes = []
    for key, poses in seen.items():
        several = [(pose_id, group) for pose_id, group in poses.items() if len(group) > 1]
        if several and len(variants[key[:2]]) > 1:  # with one variant nothing is paired
            (pose_id, first), more = several[0], f" and {len(several) - 1} more poses" if len(several) > 1 else ""
            listed = list_some([one.path for one in first], MOST_LISTED)
            notes.append(
                f"several images of pose {pose_id}{more} in {'/'.join(key)}: {listed}; "
                "all count in the table, the first is paired"
            )
    return notes


def _note_aside(aside: Sequence[SetAside]) -> list[str]:
    """One note for each kind of reason for which images were left out on purpose, or are copies."""
    kinds: dict[str, list[SetAside]] = {}
    for one in aside:
        if not one.is_fault:
            kinds.setdefault(one.kind, []).append(one)
    return [f"{list_some([one.path for one in group], MOST_LISTED)}: {group[0].reason}" for group in kinds.values()]


def read_crop(capture: Capture, how: Preprocessing) -> np.ndarray:
    """(crop_px, crop_px, 3) uint8 sRGB of one image, as a network sees it.

    Raises:
        UnreadableImage: the file cannot be read as an image.
    """
    pixels = read_image(capture.file, how.resize_px)
    # a file that was cut to this size is not resized once more: it would lose some of its corruption
    is_cut = capture.cut_px == how.crop_px and pixels.shape[:2] == (how.crop_px, how.crop_px)
    return pixels if is_cut else resize_and_crop(pixels, how)
