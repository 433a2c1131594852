"""Photographs to import, each once, in the order in which they were taken; and photographs imported before."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from toolkit.captures.manifest import MANIFEST, CaptureRecord, read_manifest
from toolkit.captures.read import read_pose_id
from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.files import inside, real_path, sha256_file, write_text
from toolkit.imaging.read import UnreadableImage, is_image_name, show_path
from toolkit.rooms.photos.importing.copies import find_copied
from toolkit.rooms.photos.photo import (
    Photo,
    SortKey,
    align_times,
    check_file,
    is_photo_name,
    list_photos,
    natural_key,
    read_photo,
    show_name,
    split_copy,
)
from toolkit.rooms.photos.video import VIDEO_SUFFIXES, pick_frames, read_video

LIVE_PHOTO_S = 5.0
"""Longest film of a live photo: a video beside a photograph of the same name."""
COMPANION_RANK = {"heif": 0, "jpeg": 1, "tiff": 2, "png": 3, "webp": 4, "avif": 5, "bmp": 6, "gif": 7, "dng": 8}


@dataclass(frozen=True)
class Candidate:
    """A photograph that may be imported.

    Attributes:
        label: its path below the given folder, for messages.
        folders: names of the folders that hold it, from the given folder down.
    """

    photo: Photo
    label: str
    folders: tuple[str, ...]


@dataclass(frozen=True)
class Gathered:
    """Photographs in the order in which they were taken, and files that are left out.

    Attributes:
        by_time: whether that order is the camera's time, and not the order of names.
        duplicates, unreadable: (label, reason).
        others: names of files that are no photographs.
        kept: label of the photograph that is kept, by the label of a duplicate.
    """

    candidates: tuple[Candidate, ...]
    by_time: bool
    duplicates: tuple[tuple[str, str], ...]
    unreadable: tuple[tuple[str, str], ...]
    others: tuple[str, ...]
    kept: dict[str, str] = field(default_factory=dict)

    def find_ties(self) -> list[tuple[str, ...]]:
        """Labels of photographs with equal times, so that their names order them."""
        times = [candidate.photo.taken for candidate in self.candidates if candidate.photo.taken is not None]
        tied: dict[object, list[str]] = {}
        if self.by_time:
            for moment, candidate in zip(align_times(times), self.candidates, strict=True):
                tied.setdefault(moment, []).append(candidate.label)
        return [tuple(labels) for labels in tied.values() if len(labels) > 1]


def gather_photos(paths: Sequence[Path], every_s: float | None = None) -> Gathered:
    """Describe the photographs in folders and single files; videos become frames, as `pick_frames` takes them.

    Raises:
        ToolkitError: a path does not exist, or none of them holds a photograph.
    """
    listed, unreadable, others = _list_all(paths)
    if not listed and not unreadable:
        named = ", ".join(str(path) for path in paths)
        raise ToolkitError(f"{named}: holds no photographs: expected JPEG, HEIC, PNG, TIFF, WebP, DNG or video files")
    # equal bytes are the same photograph under any name
    found: list[Candidate] = []
    duplicates: list[tuple[str, str]] = []
    kept: dict[str, str] = {}
    first: dict[str, str] = {}
    with progress("reading photographs", len(listed)) as bar:
        for file, label, folders in listed:
            try:
                photo = read_photo(file)
                if photo.sha256 in first:
                    duplicates.append((label, f"the same photograph as {first[photo.sha256]}"))
                    kept[label] = first[photo.sha256]
                else:
                    first[photo.sha256] = label
                    found.append(Candidate(photo, label, folders))
            except UnreadableImage as error:
                unreadable.append((label, error.reason))
            bar.advance()
    # other formats and copies of the same shot
    rest, companions = drop_companions(found)
    rest, copies = drop_twins(rest)
    kept |= {label: best for label, best, _ in (*companions, *copies)}
    duplicates += [(label, reason) for label, _, reason in (*companions, *copies)]
    # videos become frames
    candidates: list[Candidate] = []
    for candidate in rest:
        try:
            candidates += _take_frames(candidate, every_s)
        except UnreadableImage as error:
            unreadable.append((candidate.label, error.reason))
    ordered, by_time = sort_by_time(candidates)
    return Gathered(tuple(ordered), by_time, tuple(duplicates), tuple(unreadable), tuple(others), kept)


LeftOut = tuple[str, str, str]
"""Label of a photograph that is left out, label of the photograph that is kept for it, and the reason."""


def drop_companions(candidates: Sequence[Candidate]) -> tuple[list[Candidate], list[LeftOut]]:
    """Leave out files that a camera stored beside a photograph of the same shot; returns the rest, and those left out.

    Files of the same name in a folder (IMG_1.HEIC, IMG_1.DNG, IMG_1.MOV) are the same shot if they have the same time,
    or if the video is the short film of a live photo.
    """
    # files of a shot share a folder and a name without its suffix
    groups: dict[tuple[Path, str], list[Candidate]] = {}
    for candidate in candidates:
        path = candidate.photo.path
        groups.setdefault((path.parent, path.stem.lower()), []).append(candidate)
    dropped: dict[int, LeftOut] = {}
    for group in groups.values():
        stills = [candidate for candidate in group if candidate.photo.kind != "video"]
        # the lowest rank is kept; a raw file comes last, as only its preview would be taken
        stills.sort(key=lambda candidate: COMPANION_RANK.get(candidate.photo.kind, len(COMPANION_RANK)))
        for companion in group:
            if not stills or companion is stills[0]:
                continue
            best = stills[0]
            why = ""
            if companion.photo.kind == "video" and _is_live(companion.photo):
                why = f"the film of the live photo {best.label}"
            # the same name alone is not enough: counters of cameras start again at 1
            elif companion.photo.taken is not None and companion.photo.taken == best.photo.taken:
                why = f"the same shot as {best.label}, in another format"
            if why:
                dropped[id(companion)] = companion.label, best.label, why
    return _leave_out(candidates, dropped)


def drop_twins(candidates: Sequence[Candidate]) -> tuple[list[Candidate], list[LeftOut]]:
    """Leave out copies: IMG_1.png or `IMG_1 copy.jpg` with the pixels of IMG_1.jpg beside it.

    Only such names are compared: from a tripod, pictures of other variants may look the same.
    """
    # originals and copies of the same name, tails such as "copy" aside
    groups: dict[tuple[Path, str], list[Candidate]] = {}
    for candidate in candidates:
        path = candidate.photo.path
        if candidate.photo.kind != "video":
            groups.setdefault((path.parent, split_copy(path.stem)[0]), []).append(candidate)

    def find_tail(candidate: Candidate) -> str:
        return split_copy(candidate.photo.path.stem)[1]

    dropped: dict[int, LeftOut] = {}
    for group in groups.values():
        # the original comes first: without a copy's tail, then the better format
        group.sort(key=lambda c: (bool(find_tail(c)), COMPANION_RANK.get(c.photo.kind, 9), _name_key(c)))
        kept: list[Candidate] = []
        for twin in group:
            # a copy is compared with the original, and with copies of the same tail
            beside = [other for other in kept if find_tail(other) in ("", find_tail(twin))]
            number = find_copied(twin.photo, [other.photo for other in beside])
            if number is None:
                kept.append(twin)
            else:
                best = beside[number].label
                dropped[id(twin)] = twin.label, best, f"a copy of {best}: the same photograph counts once"
    return _leave_out(candidates, dropped)


def _leave_out(candidates: Sequence[Candidate], dropped: dict[int, LeftOut]) -> tuple[list[Candidate], list[LeftOut]]:
    rest = [candidate for candidate in candidates if id(candidate) not in dropped]
    return rest, [dropped[id(candidate)] for candidate in candidates if id(candidate) in dropped]


def sort_by_time(candidates: Sequence[Candidate]) -> tuple[list[Candidate], bool]:
    """Sort candidates by the camera's times, else by name; also returns whether by time.

    Names count if a candidate has no time, or if there are videos, whose times are UTC, and times without an offset.
    """
    times = [candidate.photo.taken for candidate in candidates if candidate.photo.taken is not None]
    # a photograph without a time could stand anywhere, so times order all or none
    is_known = 0 < len(times) == len(candidates)
    is_local = any(taken.tzinfo is None for taken in times)
    if not is_known or (is_local and any(candidate.photo.kind == "video" for candidate in candidates)):
        return sorted(candidates, key=_name_key), False
    moments = zip(align_times(times), candidates, strict=True)
    return [own for _, own in sorted(moments, key=lambda pair: (pair[0], _name_key(pair[1])))], True


Listed = list[tuple[Path, str, tuple[str, ...]]]


def _list_all(paths: Sequence[Path]) -> tuple[Listed, list[tuple[str, str]], list[str]]:
    listed: Listed = []
    unreadable: list[tuple[str, str]] = []
    others: list[str] = []
    for path in map(Path, paths):
        # a file that is named itself
        if not path.is_dir():
            if not path.exists():
                raise ToolkitError(f"{path} does not exist: expected a photograph, a video, or a folder of them")
            label = show_name(path.name)
            if is_photo_name(path.name):
                listed.append((path, label, ()))
            else:
                unreadable.append((label, "no photograph or video by its name"))
            continue
        # all photographs below a folder
        found = list_photos(path)
        unreadable += [(show_name(name), reason) for name, reason in found.refused]
        others += map(show_name, found.others)
        for file in found.photos:
            parts = file.relative_to(path).parts
            label = "/".join(show_name(part) for part in parts)
            try:
                check_file(file)  # a pipe or an empty file is listed, and never opened
            except UnreadableImage as error:
                unreadable.append((label, error.reason))
            else:
                listed.append((file, label, tuple(map(show_name, (real_path(path).name, *parts[:-1])))))
    return listed, unreadable, others


def _take_frames(candidate: Candidate, every_s: float | None) -> Iterable[Candidate]:
    photo = candidate.photo
    if photo.kind != "video":
        return [candidate]
    with progress(f"looking through {candidate.label}", 1) as bar:
        frames = pick_frames(photo.path, every_s)
        facts = read_video(photo.path)
        bar.advance()
    # a frame was taken so long after the video began
    photos = (replace(photo, frame=frame, taken=facts.taken_at(frame)) for frame in frames)
    return [replace(candidate, photo=photo, label=f"{candidate.label} frame {photo.frame}") for photo in photos]


def _is_live(photo: Photo) -> bool:
    if photo.path.suffix.lower() not in VIDEO_SUFFIXES:
        return False
    facts = read_video(photo.path)
    return facts.n_frames / facts.fps <= LIVE_PHOTO_S


def _name_key(candidate: Candidate) -> list[SortKey]:
    return [natural_key(part) for part in candidate.label.split("/")]


REPLACED = ".replaced"
"""Folder of replaced photographs below the source's; hidden, so that nothing counts them."""


@dataclass(frozen=True)
class CaptureKey:
    """Place of an image in a capture folder: an object, a variant, a pose of the plan."""

    object: str
    variant: str
    pose_id: int

    def __str__(self) -> str:
        return f"{self.object}/{self.variant} pose {self.pose_id}"


@dataclass(frozen=True)
class SourceIndex:
    """Photographs in captures/SOURCE.

    Attributes:
        current: whole images that lie there now, by the identity of their originals.
        replaced: images that a retake replaced, likewise.
        records: all current records by path.
    """

    source_dir: Path
    current: dict[tuple[str, int | None], CaptureRecord]
    replaced: dict[tuple[str, int | None], CaptureRecord]
    records: dict[str, CaptureRecord]


def index_source(source_dir: Path) -> SourceIndex:
    """Index the imports of a source; a file that was deleted or changed since counts as not imported.

    Lines of replaced images, which a killed run may leave, are removed. A broken manifest is a `ToolkitError`.
    """
    records = read_manifest(source_dir)
    # images that a retake replaced are kept aside with records of their own
    kept_aside = read_manifest(source_dir / REPLACED).values()
    replaced = {original: record for record in kept_aside if (original := find_original(record))}
    # the image of a replaced line is gone, its line may still be there
    gone = (path for path, record in records.items() if find_original(record) in replaced)
    stale = {path for path in gone if not inside(source_dir, path).is_file()}
    drop_records(source_dir, stale)
    records = {path: record for path, record in records.items() if path not in stale}
    # only what is on disk as recorded counts as imported
    whole = (record for record in records.values() if find_original(record) and is_whole(source_dir, record))
    current = {original: record for record in whole if (original := find_original(record))}
    return SourceIndex(source_dir, current, replaced, records)


def find_original(record: CaptureRecord) -> tuple[str, int | None] | None:
    """Return the identity of the photograph that a record was imported from; None if it was not imported."""
    sha256, frame = record.made.get("original_sha256"), record.made.get("frame")
    return (sha256, frame) if isinstance(sha256, str) and (frame is None or isinstance(frame, int)) else None


def is_whole(source_dir: Path, record: CaptureRecord) -> bool:
    """Whether a record's image is there, as it was written."""
    file = inside(source_dir, record.path)
    return file.is_file() and sha256_file(file) == record.image_sha256


def find_images(index: SourceIndex, key: CaptureKey) -> list[Path]:
    """List the images that are there for a key, imported or put there by hand."""
    folder = index.source_dir / key.object / key.variant
    if not folder.is_dir():
        return []
    found = []
    for file in sorted(folder.iterdir()):
        if file.name.startswith(".") or not is_image_name(file.name) or not file.is_file():
            continue
        # the manifest knows the pose; of images put there by hand, their names
        record = index.records.get(show_path((key.object, key.variant, file.name)))
        pose_id = record.pose_id if record is not None and record.pose_id is not None else read_pose_id(file.name)
        if pose_id == key.pose_id:
            found.append(file)
    return found


def describe_imported(index: SourceIndex, photo: Photo) -> str | None:
    """Say to where a photograph was imported before; None if it was not."""
    if record := index.current.get(photo.identity):
        return f"imported before, as {record.path}"
    if record := index.replaced.get(photo.identity):
        return f"imported before, and replaced by a later photograph (kept as {REPLACED}/{record.path})"
    return None


def drop_records(source_dir: Path, paths: set[str]) -> None:
    """Remove the lines of images that are no longer there from the manifest, which is whole at every moment."""
    file = source_dir / MANIFEST
    if not paths or not file.is_file():
        return
    # decoded with replacement: a cut last line of a killed run must not stop the others
    lines = file.read_text(encoding="utf-8", errors="replace").split("\n")
    kept = [line for line in lines if line.strip() and _path_in(line) not in paths]
    if len(kept) < sum(1 for line in lines if line.strip()):
        write_text(file, "".join(f"{line}\n" for line in kept))


def _path_in(line: str) -> str | None:
    try:
        return json.loads(line).get("path")
    except (ValueError, AttributeError):  # the cut end of a killed run
        return None
