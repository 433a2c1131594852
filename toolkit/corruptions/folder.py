"""Corrupt the images of a folder, or a single image, into files; the folder holds its settings and a log."""

import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from toolkit.core.config import FileRecord, Later
from toolkit.core.console import progress
from toolkit.core.draws import image_seed
from toolkit.core.errors import ToolkitError
from toolkit.core.files import inside, read_json, real_path, sha256_file, write_bytes, write_json
from toolkit.core.records import RecordLog, hold_folder
from toolkit.core.threads import run_each
from toolkit.corruptions.batch import MIN_SIDE_PX, corrupt
from toolkit.corruptions.catalogue import IMAGENET, choose_parameters, find_corruption
from toolkit.corruptions.digital import from_bytes, to_bytes
from toolkit.imaging.preprocessing import Preprocessing, resize_and_crop
from toolkit.imaging.read import UnreadableImage, encode_image, find_files, read_image

SETTINGS_FILE = "corruption.json"
LOG_FILE = "corrupted.jsonl"
METHOD = 1


class FolderSettings(FileRecord):
    """Settings of all images of a folder.

    Attributes:
        schema_version: version of this file.
        corruption, severity: None if images lie in folders NAME/SEVERITY.
        seed: seed of the run.
        size_px: side that the images were resized and cropped to, None for their own.
        image_format: png or jpg.
        method: version of the corruptions; raise `METHOD` if the same inputs give other pixels.
    """

    schema_version: Literal[1] = 1
    corruption: str | None = None
    severity: int | None = None
    seed: int = 0
    size_px: int | None = None
    image_format: str = "png"
    method: Annotated[int, Later] = 1


class CorruptedFile(BaseModel):
    """A finished file: its path below the folder, its hash, and the hash of the file it was made from."""

    model_config = ConfigDict(extra="ignore", frozen=True)
    path: str
    sha256: str
    source_sha256: str


def claim_folder(folder: Path, settings: FolderSettings) -> None:
    """Write the settings into `folder`, or check that those in it are the same.

    Raises:
        ToolkitError: it holds images made with other settings, or cannot be written.
    """
    file = folder / SETTINGS_FILE
    if not file.is_file():
        write_json(file, settings.model_dump())
        return
    before = read_json(file, FolderSettings)
    for name in FolderSettings.model_fields:
        wanted, found = getattr(settings, name), getattr(before, name)
        if found != wanted:
            raise ToolkitError(
                f"{folder} holds images of {name} {found}, not {wanted}: name another folder to write to"
            )


def read_finished(folder: Path) -> dict[str, CorruptedFile]:
    """Return lines by path; a `ToolkitError` if a line before the last is broken, or a path leaves the folder."""
    known = RecordLog(folder / LOG_FILE, CorruptedFile).read_last(lambda line: line.path)
    for path in known:
        inside(folder, path)
    return known


@dataclass(frozen=True)
class SourceImage:
    """An image: its file, its path below the folder with forward slashes, and the path of the corrupted file."""

    file: Path
    path: str
    target: str


def find_sources(folder: Path, out: Path, image_format: str) -> tuple[list[SourceImage], list[tuple[str, str]]]:
    """List images below `folder`, sorted, and (path, reason) of links that leave it, without hidden files and `out`.

    Raises:
        ToolkitError: the folder does not exist or may not be read.
    """
    # what an earlier run made within the folder is no source
    real_out = real_path(out)

    def is_made(path: Path) -> bool:
        file = folder / path
        return any(place.is_relative_to(real_out) for place in (real_path(file), real_path(file.parent) / file.name))

    found = find_files(folder)
    paths = [Path(*parts) for parts in found.images]
    paths = [path for path in paths if (folder / path).is_file() and not is_made(path)]
    plain = Counter(path.with_suffix("") for path in paths)
    # a.jpg and a.png would both become a.png
    sources = [
        SourceImage(
            folder / path,
            path.as_posix(),
            (path.with_suffix("") if plain[path.with_suffix("")] == 1 else path).as_posix() + f".{image_format}",
        )
        for path in paths
    ]
    return sources, [line for line in found.refused if not is_made(Path(line[0]))]


BATCH_PIXELS = 16 * 256**2
MARGIN = (8, 7)
"""Published: the short side to 256, then the middle 224."""
FORMATS = ("png", "jpg")
PNG_HOW: dict[str, Any] = {"compress_level": 3}
JPEG_HOW: dict[str, Any] = {"quality": 85, "optimize": True}
"""Pillow's settings; the quality is that of ImageNet-C's own files."""
MOST_SIZE_PX = 4096
"""Largest `size_px`: no network takes larger images."""


@dataclass(frozen=True)
class LoadedImage:
    """A source, its pixels (h, w, 3) uint8, the hash of its file, and the target of each corruption."""

    source: SourceImage
    pixels: np.ndarray
    sha256: str
    wanted: dict[tuple[str, int], str]


def read_picture(file: Path, size_px: int | None) -> np.ndarray:
    """Read (h, w, 3) uint8 sRGB; with `size_px`, the short side is resized to 8/7 of it and the middle is cropped.

    Raises:
        UnreadableImage: it does not decode, or is smaller than 16 px.
    """
    pixels = read_image(file)
    # a picture that has the size already stays as it is
    if size_px is not None and pixels.shape[:2] != (size_px, size_px):
        grown, kept = MARGIN
        how = Preprocessing(round(size_px * grown / kept), size_px, (0, 0, 0), (1, 1, 1))
        pixels = resize_and_crop(pixels, how)
    if min(pixels.shape[:2]) < MIN_SIDE_PX:
        size = f"{pixels.shape[1]}×{pixels.shape[0]} px"
        raise UnreadableImage(file, f"{size}: too small to corrupt, {MIN_SIDE_PX} px each way are needed")
    return pixels


def split_batches(loaded: list[LoadedImage]) -> Iterator[list[LoadedImage]]:
    """Yield batches of images of the same size, of at most a million pixels or a single image."""
    sizes: dict[tuple[int, ...], list[LoadedImage]] = {}
    for image in loaded:
        sizes.setdefault(image.pixels.shape, []).append(image)
    for shape, same in sizes.items():
        count = max(1, BATCH_PIXELS // (shape[0] * shape[1]))
        for start in range(0, len(same), count):
            yield same[start : start + count]


def render(
    batch: list[LoadedImage], name: str, severity: int, *, seed: int, image_format: str, device: str
) -> list[bytes]:
    """Corrupt pictures of the same size, and return the bytes of their files."""
    images = from_bytes(np.stack([image.pixels for image in batch]), device)
    # by path, so that other images of the folder change nothing
    seeds = [image_seed(seed, image.source.path) for image in batch]
    pixels = to_bytes(corrupt(images, name, severity, seeds))
    files = [b""] * len(batch)
    kind, how = ("PNG", PNG_HOW) if image_format == "png" else ("JPEG", JPEG_HOW)

    def encode(index: int) -> None:
        files[index] = encode_image(pixels[index], kind, **how)

    run_each(encode, len(batch))
    return files


CHUNK_FILES = 8
CHANGED = "was changed since it was made, and is left as it is: delete it to make it again"


@dataclass
class CorruptResult:
    """Result of a run.

    Attributes:
        made, kept: numbers of files written now, and kept from before.
        failed: (path, reason) of files that could not be read or written.
        left: paths of images of earlier runs that no image of the folder makes now.
        sizes: numbers of images corrupted now, by (parameter set, height, width).
    """

    made: int = 0
    kept: int = 0
    failed: list[tuple[str, str]] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    sizes: Counter[tuple[str, int, int]] = field(default_factory=Counter)

    def as_json(self) -> dict[str, Any]:
        """Return counts and failures for a script."""
        failed = [{"path": path, "reason": reason} for path, reason in self.failed]
        return {"made": self.made, "kept": self.kept, "failed": failed, "left": self.left}

    def describe_scale(self) -> list[str]:
        """Say in a line for each parameter set how many images took it, and how many have another size."""
        lines = []
        for name in sorted({size[0] for size in self.sizes}):
            made_for = 224 if name == IMAGENET else 32
            count = sum(number for size, number in self.sizes.items() if size[0] == name)
            other = sum(n for size, n in self.sizes.items() if size[0] == name and min(size[1:]) != made_for)
            line = f"{count} images with the parameters for {made_for}² ({name})"
            if other:
                line += f"; {other} have another size, and lengths are not scaled: compare with image_px {made_for}"
            lines.append(line)
        return lines


def corrupt_images(
    source: Path, out: Path, corruptions: Sequence[tuple[str, int]], *, seed: int = 0, size_px: int | None = None,
    image_format: str = "png", device: str = "cpu", skip: Mapping[str, str] | None = None,
) -> CorruptResult:  # fmt: skip
    """Corrupt every image of a folder, or a single image, into a folder of the same layout, or into an image.

    A single corruption at a single severity lies in `out` itself, others in `out`/NAME/SEVERITY. An image's seed is its
    path below `source`. Finished files of an earlier run are kept; other files are left as they are.

    Args:
        source: a folder, or an image.
        out: folder to write to, beside or within `source`; for an image also a .png or .jpg.
        corruptions: name and severity of each, see `parse_corruptions`.
        seed: seed of the run.
        size_px: resize to 8/7 of it and crop the middle, as published; None keeps the images' sizes.
        image_format: `png`, or `jpg` of quality 85, as ImageNet-C's files.
        device: cpu or cuda.
        skip: paths below `source` of images that are left out, and why; they are listed as failed.

    Raises:
        ToolkitError: there are no images, `out` holds images of other settings or another image, or a setting is wrong.
    """
    if source.is_file() and out.suffix.lower() in (".png", ".jpg", ".jpeg"):
        return _corrupt_file(source, out, corruptions, seed, size_px, device)
    plan = list(dict.fromkeys(corruptions))
    for name, severity in plan:
        find_corruption(name, severity)
    _check_settings(source, out, size_px, image_format)
    sources, failed = _list_sources(source, out, image_format, skip or {})
    result = CorruptResult(failed=failed)
    # the settings of the folder are checked against those of an earlier run
    alone = plan[0] if len(plan) == 1 else (None, None)
    settings = FolderSettings(
        corruption=alone[0], severity=alone[1], seed=seed, size_px=size_px, image_format=image_format, method=METHOD
    )
    places = {item: "" if len(plan) == 1 else f"{item[0]}/{item[1]}/" for item in plan}
    log = RecordLog(out / LOG_FILE, CorruptedFile)
    with hold_folder(out), progress("corrupting", len(sources) * len(plan)) as ticker:
        claim_folder(out, settings)
        known = read_finished(out)
        # images are read in chunks; those of the same size are corrupted together
        for start in range(0, len(sources), CHUNK_FILES):
            chunk = sources[start : start + CHUNK_FILES]
            loaded = _load(chunk, out, places, known, size_px, result=result)
            ticker.advance(len(chunk) * len(plan) - sum(len(image.wanted) for image in loaded))
            for name, severity in plan:
                ready = [image for image in loaded if (name, severity) in image.wanted]
                for batch in split_batches(ready):
                    files = render(batch, name, severity, seed=seed, image_format=image_format, device=device)
                    targets = [(image.wanted[name, severity], image.sha256) for image in batch]
                    lines = _write(out, targets, files, known, result)
                    log.append(*lines)
                    known.update({line.path: line for line in lines})
                    result.made += len(lines)
                    ticker.advance(len(batch))
        if source.is_dir():
            wanted = {place + image.target for place in places.values() for image in sources}
            left = (path for path in sorted(known.keys() - wanted) if path.startswith(tuple(places.values())))
            result.left = [path for path in left if (out / path).is_file()]
    return result


def _list_sources(
    source: Path, out: Path, image_format: str, skip: Mapping[str, str]
) -> tuple[list[SourceImage], list[tuple[str, str]]]:
    """Return the images to corrupt, and (path, reason) of links that leave the folder and of those to skip."""
    if source.is_file():
        sources, refused = [SourceImage(source, source.name, f"{source.stem}.{image_format}")], list[tuple[str, str]]()
    else:
        sources, refused = find_sources(source, out, image_format)
    if not sources:
        why = f" but links ({refused[0][0]}: {refused[0][1]})" if refused else ""
        raise ToolkitError(f"{source} holds no images{why}: name a folder of photographs, in any layout")
    refused = [*refused, *((image.path, skip[image.path]) for image in sources if image.path in skip)]
    return [image for image in sources if image.path not in skip], refused


def _check_settings(source: Path, out: Path, size_px: int | None, image_format: str) -> None:
    if not source.exists():
        raise ToolkitError(f"{source} does not exist: name a folder of images, or an image")
    if real_path(out) == real_path(source) or out.is_file():
        raise ToolkitError(f"{out} cannot take the images: name another folder to write to")
    if size_px is not None and not MIN_SIDE_PX <= size_px <= MOST_SIZE_PX:
        wrong = "small" if size_px < MIN_SIDE_PX else "large"
        raise ToolkitError(f"size {size_px} px is too {wrong}: choose {MIN_SIDE_PX} to {MOST_SIZE_PX} px")
    if image_format not in FORMATS:
        raise ToolkitError(f"no format '{image_format}': choose png or jpg")


def _load(
    chunk: Sequence[SourceImage], out: Path, places: Mapping[tuple[str, int], str], known: Mapping[str, CorruptedFile],
    size_px: int | None, result: CorruptResult,
) -> list[LoadedImage]:  # fmt: skip
    """Read images that are not finished; the result lists those that cannot be read or must not be overwritten."""
    slots: list[LoadedImage | None] = [None] * len(chunk)
    trouble: list[list[tuple[str, str]]] = [[] for _ in chunk]
    kept = [0] * len(chunk)

    def load(index: int) -> None:
        source = chunk[index]
        try:
            sha256 = sha256_file(source.file)
            wanted = {}
            for item, place in places.items():
                target = place + source.target
                state = _look(out / target, known.get(target), sha256)
                if state == "finished":
                    kept[index] += 1
                elif state == "changed":
                    trouble[index].append((target, CHANGED))
                else:
                    wanted[item] = target
            # read only if something is missing
            if wanted:
                slots[index] = LoadedImage(source, read_picture(source.file, size_px), sha256, wanted)
        except UnreadableImage as error:
            trouble[index].append((source.path, error.reason))
        except OSError as error:
            trouble[index].append((source.path, (error.strerror or str(error)).lower()))

    # results are merged in the order of the sources, whichever thread was first
    run_each(load, len(chunk))
    result.kept += sum(kept)
    result.failed += [line for lines in trouble for line in lines]
    loaded = [slot for slot in slots if slot is not None]
    result.sizes.update((choose_parameters(*image.pixels.shape[:2]), *image.pixels.shape[:2]) for image in loaded)
    return loaded


def _look(file: Path, line: CorruptedFile | None, source_sha256: str) -> str:
    if line is None or not file.is_file():
        return "missing"
    if sha256_file(file) != line.sha256:
        return "changed"
    return "finished" if line.source_sha256 == source_sha256 else "missing"


def _write(
    out: Path, targets: Sequence[tuple[str, str]], files: list[bytes], known: dict[str, CorruptedFile],
    result: CorruptResult,
) -> list[CorruptedFile]:  # fmt: skip
    """Write files and return their lines; the result lists files that are not this command's."""
    lines = []
    for (target, source_sha256), content in zip(targets, files, strict=True):
        line = CorruptedFile(path=target, sha256=hashlib.sha256(content).hexdigest(), source_sha256=source_sha256)
        file = out / target
        if file.exists() and target not in known and not _is_same(file, line.sha256):
            # the same bytes: a run before was stopped after the file and before its line
            result.failed.append((target, "exists and was not made by this command: left as it is"))
            continue
        write_bytes(file, content, out)
        lines.append(line)
    return lines


def _is_same(file: Path, sha256: str) -> bool:
    return file.is_file() and sha256_file(file) == sha256


def _corrupt_file(
    source: Path, out: Path, corruptions: Sequence[tuple[str, int]], seed: int, size_px: int | None, device: str
) -> CorruptResult:
    """Corrupt an image into a file, PNG or JPEG by its suffix; its seed is its name."""
    if len(corruptions) != 1:
        raise ToolkitError(
            f"{out} is a single file for {len(corruptions)} corruptions: name one at one severity, or a folder"
        )
    ((name, severity),) = corruptions
    image_format = "png" if out.suffix.lower() == ".png" else "jpg"
    _check_settings(source, out.parent / f"{out.name}.folder", size_px, image_format)
    result = CorruptResult()
    pixels = read_picture(source, size_px)
    loaded = LoadedImage(SourceImage(source, source.name, out.name), pixels, "", {})
    content = render([loaded], name, severity, seed=seed, image_format=image_format, device=device)[0]
    result.sizes.update([(choose_parameters(*pixels.shape[:2]), *pixels.shape[:2])])
    # a file that is there is kept if it is the same, and never overwritten
    if not out.exists():
        write_bytes(out, content)
        result.made += 1
    elif _is_same(out, hashlib.sha256(content).hexdigest()):
        result.kept += 1
    else:
        raise ToolkitError(f"{out} exists and holds something else: name another file, or delete it")
    return result
