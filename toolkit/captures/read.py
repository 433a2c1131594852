"""Read a capture folder: `captures/SOURCE/OBJECT/VARIANT/FILE`, with a manifest or sorted by hand."""

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.captures.manifest import MANIFEST, CaptureRecord, read_manifest
from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import real_path, sha256_file
from toolkit.imaging.preprocessing import Preprocessing, resize_and_crop
from toolkit.imaging.read import FoundFiles, find_files, read_image, show_path

UNPATCHED = "unpatched"
POOLED = "all"
LAYOUT = "SOURCE/OBJECT/VARIANT/FILE, for example captures/real/racer/patched/1.jpg"
# ImageNet's folders are called by WordNet ids: n and eight digits
WNID = re.compile(r"^n\d{8}$")
MAX_POSE_DIGITS = 5
LEAST_PHOTO_BYTES = 20_000
"""A smaller file is a drawing, not a photograph: two that are equal may well be two."""
SAME_CAMERA = (3.0, 0.05)
"""Two renders by plan are of one pose up to here: degrees seen from the object, share of distance and focal length."""
SAME_PHOTOGRAPH = (15.0, 0.5)
"""Likewise where one camera is held by hand, of a photograph or a rehearsal: degrees and share of distance alone."""


@dataclass(frozen=True)
class Capture:
    """One image and what is known of it.

    Attributes:
        source, object, variant: the folders that it lies in.
        pose_id: from the manifest, else the number in the file's name, else one for names that are equal; else None.
        file: where it is.
        path: how it is named in results: SOURCE/OBJECT/VARIANT/FILE.
        refused: why it must not be opened, None when it may.
        T_world_camera: 4×4, OpenCV axes, millimetres, where the manifest has it.
        focal_length: of the lens as a share of the image's longer side, where the manifest has it.
        class_name: what the object should be recognised as, where the manifest says so.
        booster_sha256: of what was on the object, where the manifest has it.
        is_rendered: the manifest says that a renderer made it.
        is_by_plan: likewise, and that its camera is the plan's: no photograph's (`--like`) and no rehearsal's.
        is_retextured: by the manifest a true photograph, in which another patch was put in the printed one's place.
        corruption: (name, severity) that it has, or gets where `cut_px` is None; None for an image as it was taken.
        cut_px: side of the square that the file was cut to before it was corrupted, by the manifest; None for an image
            that is corrupted when it is read, after it was resized and cut for the network.
        failed_gates: what its photograph failed when it was judged, such as `over-exposure 64 % of the object clipped`.
    """

    source: str
    object: str
    variant: str
    pose_id: int | None
    file: Path
    path: str
    refused: str | None = None
    T_world_camera: tuple[tuple[float, ...], ...] | None = None
    focal_length: float | None = None
    class_name: str | None = None
    booster_sha256: str | None = None
    is_rendered: bool = False
    is_by_plan: bool = False
    is_retextured: bool = False
    corruption: tuple[str, int] | None = None
    cut_px: int | None = None
    failed_gates: tuple[str, ...] = ()

    @property
    def path_in_source(self) -> str:
        """OBJECT/VARIANT/FILE."""
        return self.path.split("/", 1)[1]

    @property
    def source_dir(self) -> Path:
        """As many folders up as `path_in_source` has, absolute: where the source's manifest lies."""
        above = self.file.absolute().parents
        return above[min(self.path_in_source.count("/"), len(above) - 1)]

    def tell_cameras_apart(self, other: "Capture") -> str | None:
        """How another image's camera stands elsewhere, in words; None where it does not, or one is not known.

        See `SAME_CAMERA` and `SAME_PHOTOGRAPH`. Cameras are compared as seen from the object, the world's origin.
        """
        if self.T_world_camera is None or other.T_world_camera is None:
            return None
        one, two = ([row[3] for row in rows[:3]] for rows in (self.T_world_camera, other.T_world_camera))
        far, near = math.hypot(*one), math.hypot(*two)
        if not far or not near:
            return None
        by_plan = self.is_by_plan and other.is_by_plan
        most_deg, most_share = SAME_CAMERA if by_plan else SAME_PHOTOGRAPH
        cosine = sum(a * b for a, b in zip(one, two, strict=True)) / (far * near)
        # clamped: rounding may leave a cosine just outside of [-1, 1]
        apart_deg = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
        if apart_deg > most_deg:
            return f"{apart_deg:.0f}° apart"
        if abs(far - near) > most_share * min(far, near):
            return f"{far:.0f} and {near:.0f} mm away"
        lens, second = self.focal_length, other.focal_length
        if by_plan and lens and second and abs(lens - second) > most_share * min(lens, second):
            return "with another lens"
        return None


@dataclass(frozen=True)
class CaptureFolder:
    """A capture folder.

    Attributes:
        root: the folder.
        captures: its images by source, object, variant and path.
        refused_folders: (path, reason) of linked folders, whose images are missing.
        notes: what the reader should know and no image stands for: files passed over, several images of one pose.
    """

    root: Path
    captures: tuple[Capture, ...]
    refused_folders: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]

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


def read_captures(root: Path, selection: Selection | None = None) -> CaptureFolder:
    """Read `captures/`, one of its sources, one object's folder, or an ImageFolder whose folders are WordNet ids.

    Images are paired by pose: the manifest's pose id, else the number in the name (`pose_03.jpg`, `IMG_0003.jpg`), else
    names that are equal in several variants.
    Where the manifest knows both cameras they must agree too: see `Capture.tell_cameras_apart`.

    Raises:
        ToolkitError: no folder, no images, images that are not sorted into folders, a broken manifest, an object called
            `all`, or a selected source, object or variant that is not there.
    """
    root = Path(root)
    found = find_captured(root)
    prefix, depth, suffix = _read_layout(root, found)
    manifests: dict[Path, dict[str, CaptureRecord]] = {}
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
        record = manifests[source_dir].get("/".join(full[1:]))
        captures.append(_capture(root / Path(*parts), full, record, refused))
    chosen, copies = _drop_copies(_pair_by_stem(_select(captures, selection or Selection())))
    chosen.sort(key=lambda capture: (capture.source, capture.object, capture.variant, capture.path))
    if any(capture.object == POOLED for capture in chosen):
        raise ToolkitError(f"{root}: an object may not be called '{POOLED}', the pooled rows are: rename its folder")
    return CaptureFolder(
        root,
        tuple(chosen),
        tuple(unread),
        (*_note_files(found, stray), *_note_retextured(chosen), *_note_doubles(chosen), *copies),
    )


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


def _size_bytes(file: Path) -> int:
    """Of a file; 0 of a link that leads nowhere or in a circle, which is refused where it is read."""
    try:
        return file.stat().st_size
    except OSError:
        return 0


def _drop_copies(captures: Sequence[Capture]) -> tuple[list[Capture], list[str]]:
    """The captures, of photographs that lie there several times as one variant the first alone; a note of the others.

    One bare photograph under eight names is one observation and not eight.
    """
    sizes: dict[tuple[str, str, str, int], list[Capture]] = {}
    for one in captures:
        # photographs alone: a renderer may well give two equal pictures
        if one.refused is None and not one.is_rendered and (size := _size_bytes(one.file)) >= LEAST_PHOTO_BYTES:
            sizes.setdefault((one.source, one.object, one.variant, size), []).append(one)
    copies: dict[str, list[str]] = {}
    for group in sizes.values():
        first: dict[str, Capture] = {}
        # hashed only where sizes are equal: most photographs are never read for this
        for one in sorted(group, key=lambda capture: capture.path) if len(group) > 1 else ():
            original = first.setdefault(sha256_file(one.file), one)
            if original is not one:
                copies.setdefault(original.path, []).append(one.path)
    dropped = {path for paths in copies.values() for path in paths}
    notes = [
        f"{_some(paths)}: the same photograph as {original}, which counts once" for original, paths in copies.items()
    ]
    return [one for one in captures if one.path not in dropped], notes


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
        **_read_corruption(record.made),
    )


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
        notes.append(f"not images, not counted: {_some(found.others)}")
    if stray:
        notes.append(f"not inside SOURCE/OBJECT/VARIANT, not counted: {_some(stray)}")
    return notes


def _note_retextured(captures: list[Capture]) -> list[str]:
    counts = Counter((one.object, one.variant) for one in captures if one.is_retextured)
    if not counts:
        return []
    named = ", ".join(f"{name}/{variant} {count}" for (name, variant), count in sorted(counts.items()))
    return [f"retextured: photographs in which another patch replaces the printed one: {named}"]


def _note_doubles(captures: list[Capture]) -> list[str]:
    seen: dict[tuple[str, str, str, int], list[Capture]] = {}
    variants: dict[tuple[str, str], set[str]] = {}
    for capture in captures:
        variants.setdefault((capture.source, capture.object), set()).add(capture.variant)
        if capture.pose_id is not None:
            seen.setdefault((capture.source, capture.object, capture.variant, capture.pose_id), []).append(capture)
    return [
        f"several images of pose {key[3]} in {key[0]}/{key[1]}/{key[2]}: {_some([one.path for one in group])}; "
        "all count in the table, the first is paired"
        for key, group in seen.items()
        if len(group) > 1 and len(variants[key[:2]]) > 1  # with one variant nothing is paired
    ]


def _some(paths: Sequence[str], limit: int = 5) -> str:
    listed = ", ".join(paths[:limit])
    return listed if len(paths) <= limit else f"{listed} and {len(paths) - limit} more"


def read_crop(capture: Capture, how: Preprocessing) -> np.ndarray:
    """(crop_px, crop_px, 3) uint8 sRGB of one image, as a network sees it.

    Raises:
        UnreadableImage: the file cannot be read as an image.
    """
    pixels = read_image(capture.file, how.resize_px)
    # a file that was cut to this size is not resized once more: it would lose some of its corruption
    is_cut = capture.cut_px == how.crop_px and pixels.shape[:2] == (how.crop_px, how.crop_px)
    return pixels if is_cut else resize_and_crop(pixels, how)
