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
WNID = re.compile(r"^n\d{8}$")
"""WordNet ids, the names of ImageNet's folders."""
MAX_POSE_DIGITS = 5
MOST_LISTED = 5


Layout = tuple[tuple[str, ...], int, tuple[str, ...]]
"""Folders before those below a root, the number of those below it, and those after: SOURCE/OBJECT/VARIANT together."""


@dataclass(frozen=True)
class CaptureFolder:
    """A capture folder.

    Attributes:
        captures: images that count, by source, object, variant and path.
        refused_folders: (path, reason) of linked folders, whose images are missing.
        notes: remarks for the reader, such as ignored files, and several images of a pose.
        without_manifest: sources without a manifest: their images are paired by name.
        is_trusted: whether images that contradict their manifest were counted.
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
        """(path, reason) of images that contradict their manifest."""
        return [(capture.path, capture.reason) for capture in self.set_aside if capture.is_fault]

    @cached_property
    def objects(self) -> list[str]:
        """Names of the objects, sorted."""
        return sorted({capture.object for capture in self.captures})


@dataclass(frozen=True)
class Selection:
    """A part of a capture folder; empty means all."""

    sources: tuple[str, ...] = ()
    objects: tuple[str, ...] = ()
    variants: tuple[str, ...] = ()


def find_captured(root: Path) -> FoundFiles:
    """Return the files of a capture folder, unread; a `ToolkitError` if there is no folder or no image."""
    found = find_files(root)
    if not found.images and not found.refused:
        raise ToolkitError(f"{root} holds no images: expected {LAYOUT}")
    return found


def read_captures(root: Path, selection: Selection | None = None, *, trust_files: bool = False) -> CaptureFolder:
    """Read `captures/`, a source in it, the folder of an object, or an ImageFolder whose folders are WordNet ids.

    Images are paired by pose: the manifest's pose id, the number in the name (`pose_03.jpg`, `IMG_0003.jpg`), or equal
    names in several variants. `toolkit.captures.reconcile` decides which images count.

    Args:
        trust_files: count images that contradict their manifest, by folder and name.

    Raises:
        ToolkitError: there is no folder, image, or image that counts; images are not sorted into folders; a manifest is
            broken or contradicts the folders; an object is called `all`; a selected name does not exist.
    """
    root, selection = Path(root), selection or Selection()
    found = find_captured(root)
    # which levels of SOURCE/OBJECT/VARIANT lie above the root, how many below it, and which are missing
    layout = _read_layout(root, found)
    before, depth, _ = layout
    captures, known = _open_manifests(root, found, layout)
    # compare the selected images with their manifests
    selected = _select(captures, selection)
    wanted = [replace(capture, image_sha256=_hash_file(capture)) for capture in selected]
    counted, aside = reconcile(_pair_by_stem(wanted), known, trust_files=trust_files)
    if not trust_files:
        # in a part of a source, folders that are gone are not missing
        is_whole = len(before) < 2 and selection == Selection()
        aside += find_missing(wanted, known, is_whole=is_whole)
    if wanted and not counted:
        raise ToolkitError(f"{root}: none of {len(wanted)} images counts; {aside[0].path}: {aside[0].reason}")
    counted.sort(key=lambda capture: (capture.source, capture.object, capture.variant, capture.path))
    for what in ("object", "variant"):
        if any(getattr(capture, what) == POOLED for capture in counted):
            raise ToolkitError(
                f"{root}: {what} '{POOLED}': an object or a variant may not be called as the pooled rows are: rename "
                "its folder"
            )
    stray = [show_path(parts) for parts in found.images if len(parts) <= depth]
    unread = tuple((path, reason) for path, reason in found.refused if len(path.split("/")) <= depth)
    notes = _note_files(found, stray, counted) + _note_doubles(counted) + _note_aside(aside)
    # sources without a manifest count by their folders' names alone
    without = sorted({capture.source for capture in counted} - known.keys())
    return CaptureFolder(
        root, tuple(counted), unread, tuple(notes), tuple(aside), tuple(without), is_trusted=trust_files and bool(known)
    )


def find_faults(root: Path) -> dict[str, str]:
    """Return the images that contradict a manifest in a folder or directly below it: path -> reason.

    Raises as `read_captures`.
    """
    is_source = (root / MANIFEST).is_file()
    if not (root.is_dir() and (is_source or any(root.glob(f"*/{MANIFEST}")))):
        return {}
    faults = read_captures(root).faults
    return {path.partition("/")[2] if is_source else path: reason for path, reason in faults}


def _open_manifests(root: Path, found: FoundFiles, layout: Layout) -> tuple[list[Capture], dict[str, SourceManifest]]:
    """Return the images inside SOURCE/OBJECT/VARIANT with their records, and the manifests of their sources by name."""
    before, depth, after = layout
    # refused files have a place too, so that they are told where they lie
    files: list[tuple[tuple[str, ...], str | None]] = [(parts, None) for parts in found.images]
    files += [(tuple(path.split("/")), reason) for path, reason in found.refused]
    records: dict[Path, dict[str, CaptureRecord]] = {}
    sources: dict[str, Path] = {}
    captures: list[Capture] = []
    for parts, refused in files:
        if len(parts) <= depth:
            continue
        full = (*before, *parts[:depth], *after, *parts[depth:])
        # the manifest lies in the source's folder: below the root, the root itself, or above it
        source_dir = (root / parts[0], root, real_path(root).parent)[len(before)]
        if source_dir not in records:
            records[source_dir] = read_manifest(source_dir)
        sources[show_path((full[0],))] = source_dir
        record = records[source_dir].get("/".join(full[1:]))
        captures.append(_capture(root / Path(*parts), full, record, refused))
    known = {name: _open_source(name, folder, records[folder]) for name, folder in sources.items()}
    return captures, {name: manifest for name, manifest in known.items() if manifest.records}


def _open_source(name: str, folder: Path, records: dict[str, CaptureRecord]) -> SourceManifest:
    """Return the manifest of a source; for corrupted copies also that of their original source beside it."""
    of = next((str(record.made["of"]) for record in records.values() if isinstance(record.made.get("of"), str)), "")
    beside = of.partition("/")[0]
    # a manifest may come from elsewhere: only a folder beside this is opened
    originals = read_manifest(folder.absolute().with_name(beside)) if is_folder_name(beside) else {}
    return SourceManifest(name, folder, records, originals)


def _hash_file(capture: Capture) -> str | None:
    """Return the hash of an image's file; None if it cannot be opened, which is reported when it is read."""
    if capture.refused is not None:
        return None
    try:
        return sha256_file(capture.file)
    except (OSError, ToolkitError):
        return None


def read_pose_id(name: str) -> int | None:
    """Return the pose number in a file name: after `pose`, else the last number; None without a number.

    A number is a word, as in `IMG_0003`, or ends a name of a single word, as in `DSC01234`, but not in
    `bear1_2in_over`. A copy's mark ` (1)`, more than five digits (a date or time) and digits among letters (a hash,
    `38bdd950c1d0`) do not count.
    """
    stem = re.sub(r"\s*\(\d+\)$", "", Path(name).stem)
    named = re.search(r"pose[\s_-]*(\d+)", stem, re.IGNORECASE)
    words = re.split(r"[^0-9A-Za-z]+", stem)
    numbers = [re.fullmatch(r"[A-Za-z]*(\d+)" if len(words) == 1 else r"(\d+)", word) for word in words]
    match = named or next((number for number in reversed(numbers) if number), None)
    return int(match[1]) if match and len(match[1]) <= MAX_POSE_DIGITS else None


def _pair_by_stem(captures: Sequence[Capture]) -> list[Capture]:
    """Give a pose number to images without a pose if their name is in several variants of an object."""
    groups: dict[tuple[str, str], list[Capture]] = {}
    for capture in captures:
        groups.setdefault((capture.source, capture.object), []).append(capture)
    paired: list[Capture] = []
    for group in groups.values():
        variants: dict[str, set[str]] = {}
        for capture in group:
            if capture.pose_id is None:
                # cameras and computers write IMG_1.JPG and img_1.jpg alike
                variants.setdefault(capture.file.stem.lower(), set()).add(capture.variant)
        # numbers above all pose numbers of the object
        shared = sorted(stem for stem, found in variants.items() if len(found) > 1)
        first = 1 + max((capture.pose_id or 0 for capture in group), default=0)
        ids = {stem: first + i for i, stem in enumerate(shared)}
        paired += [
            replace(capture, pose_id=ids.get(capture.file.stem.lower())) if capture.pose_id is None else capture
            for capture in group
        ]
    return paired


def _read_layout(root: Path, found: FoundFiles) -> Layout:
    name = real_path(root).name
    files = found.images or tuple(tuple(path.split("/")) for path, _ in found.refused)
    # most files decide: a stray image beside the folders does not change the layout
    depth = min(3, Counter(len(parts) - 1 for parts in files).most_common(1)[0][0])
    folders = {parts[0] for parts in files if len(parts) > 1}
    # a source, by its manifest or its name
    if (root / MANIFEST).is_file() or (name in ("sim", "real") and depth > 1):
        return (name,), 2, ()
    if depth == 0:
        raise ToolkitError(f"{root}: the images are not sorted into folders: expected {LAYOUT}")
    # an ImageFolder: classes as objects, all unpatched
    if depth == 1 and all(WNID.match(folder) for folder in folders):
        return (name,), 1, (UNPATCHED,)
    if depth == 1:
        return (real_path(root).parent.name or "captures", name), 1, ()
    return ((), 3, ()) if depth == 3 else ((name,), 2, ())


def _capture(file: Path, full: tuple[str, ...], record: CaptureRecord | None, refused: str | None) -> Capture:
    # without a record, folders and file name say all
    source, name, variant = (show_path((part,)) for part in full[:3])
    capture = Capture(source, name, variant, read_pose_id(full[-1]), file, path=show_path(full), refused=refused)
    if record is None:
        return capture
    rows, lens, made = record.T_world_camera, record.intrinsics, record.made
    # all three or none: a manifest that was written by hand may hold only some
    corruption, severity, cut_px = made.get("corruption"), made.get("severity"), made.get("cut_px")
    is_corrupted = (type(corruption), type(severity), type(cut_px)) == (str, int, int)
    # the manifest comes before the file name
    return replace(
        capture, pose_id=record.pose_id if record.pose_id is not None else capture.pose_id,
        T_world_camera=tuple(tuple(row) for row in rows) if rows is not None else None,
        focal_length=lens["fx"] / max(lens["width"], lens["height"]) if lens else None,
        class_name=said if isinstance(said := made.get("class"), str) else None,
        booster_sha256=record.booster_sha256, is_rendered="renderer" in made,
        is_by_plan="renderer" in made and not {"like", "rehearsed"} & made.keys(),
        is_retextured="retextured" in made, settings=read_settings(made),
        corruption=(str(corruption), int(severity or 0)) if is_corrupted else None,
        cut_px=cut_px if is_corrupted else None,
    )  # fmt: skip


def read_settings(made: dict[str, Any]) -> dict[str, Any]:
    """Return the settings of an image, by the names of `toolkit.captures.capture.SETTINGS`, and its `booster`."""
    found = {name: made[name] for name in (*SETTINGS, "booster") if name in made}
    if "renderer" not in made:  # a photograph's board and light are not the rig's
        # the class follows from the spec, unless a table states it
        names = ("pose_sha256", "sheet_sha256", "booster", *(["class"] if "row" in made else []))
        return {name: found[name] for name in names if name in found}
    # such as linen/studio/0-1810094345/board
    backdrop, light, _, *board = (*str(made.get("studio", "")).split("/"), "", "", "")[:4]
    named = {"backdrop": backdrop, "light": light, "board": board[0]} if light else {}
    return {"rehearsed": False} | found | named


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


def _note_files(found: FoundFiles, stray: list[str], captures: list[Capture]) -> list[str]:
    notes = []
    if found.others:
        notes.append(f"not images, not counted: {list_some(found.others, MOST_LISTED)}")
    if stray:
        notes.append(f"not inside SOURCE/OBJECT/VARIANT, not counted: {list_some(stray, MOST_LISTED)}")
    counts = Counter((capture.object, capture.variant) for capture in captures if capture.is_retextured)
    if counts:
        named = ", ".join(f"{name}/{variant} {count}" for (name, variant), count in sorted(counts.items()))
        notes.append(f"retextured: photographs in which another patch replaces the printed patch: {named}")
    return notes


def _note_aside(aside: list[SetAside]) -> list[str]:
    """Return a note for each reason why images were left out on purpose, or are copies."""
    kinds: dict[str, list[SetAside]] = {}
    for item in aside:
        if not item.is_fault:
            kinds.setdefault(item.kind, []).append(item)
    return [f"{list_some([item.path for item in group], MOST_LISTED)}: {group[0].reason}" for group in kinds.values()]


def _note_doubles(captures: list[Capture]) -> list[str]:
    seen: dict[tuple[str, str, str], dict[int, list[Capture]]] = {}
    variants: dict[tuple[str, str], set[str]] = {}
    for capture in captures:
        variants.setdefault((capture.source, capture.object), set()).add(capture.variant)
        if capture.pose_id is not None:
            group = capture.source, capture.object, capture.variant
            seen.setdefault(group, {}).setdefault(capture.pose_id, []).append(capture)
    notes = []
    # a note for each variant with several images of a pose
    for key, poses in seen.items():
        several = [(pose_id, group) for pose_id, group in poses.items() if len(group) > 1]
        if several and len(variants[key[:2]]) > 1:  # a single variant has no pairs
            (pose_id, first), more = several[0], f" and {len(several) - 1} more poses" if len(several) > 1 else ""
            listed = list_some([capture.path for capture in first], MOST_LISTED)
            notes.append(
                f"several images of pose {pose_id}{more} in {'/'.join(key)}: {listed}; "
                "all count in the table, the first is paired"
            )
    return notes


def read_crop(capture: Capture, how: Preprocessing) -> np.ndarray:
    """Return an image as a network sees it, (crop_px, crop_px, 3) uint8 sRGB; an `UnreadableImage` if it is none."""
    pixels = read_image(capture.file, how.resize_px)
    # a file that was cut to this size is not resized again: it would lose some of its corruption
    is_cut = capture.cut_px == how.crop_px and pixels.shape[:2] == (how.crop_px, how.crop_px)
    return pixels if is_cut else resize_and_crop(pixels, how)
