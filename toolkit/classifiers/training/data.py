"""Training and held-out images from any mix of sources, packed into files that are read without loading them whole."""

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.classifiers.preprocessing import Preprocessing, resize_and_crop
from toolkit.classifiers.training.cifar import StoredImage
from toolkit.classifiers.training.classes import TrainingClasses
from toolkit.classifiers.training.folder import LabelledFile, load_square
from toolkit.classifiers.training.renders import RenderUnit, render_shards
from toolkit.classifiers.training.sources import Source
from toolkit.console import progress
from toolkit.errors import ToolkitError
from toolkit.files import explain_write_error, sha256_bytes, write_json
from toolkit.images import UnreadableImage

BLOCK = 256
PACKS = ("train", "held_out")
Item = LabelledFile | RenderUnit | StoredImage


@dataclass(frozen=True)
class Pack:
    """Images on disk.

    Attributes:
        images: (n, s, s, 3) uint8 sRGB, mapped from the file.
        classes: (n,) int64.
        sha256: of pixels and classes.
    """

    images: np.ndarray
    classes: np.ndarray
    sha256: str


@dataclass(frozen=True)
class TrainingSet:
    """What a classifier is trained on and tested with.

    Attributes:
        labels: one per output of the network.
        train, held_out: images; none may be held out.
        skipped: (path, reason) of images that could not be used.
        record: for the classifier's record.
    """

    labels: tuple[str, ...]
    train: Pack
    held_out: Pack
    skipped: tuple[tuple[str, str], ...]
    record: dict[str, Any]


def load_training_set(
    sources: Sequence[Source], classes: TrainingClasses, how: Preprocessing, keep: Path, workers: int, quiet: bool
) -> TrainingSet:
    """Render and decode what the sources offer, or take what an earlier run left in `keep`.

    Args:
        sources: at least one.
        classes: what their labels stand for.
        how: how images are stored: square, `crop_px` a side.
        keep: folder for what is rendered and packed, until the training is finished.
        workers: processes that render.
        quiet: no progress bar.

    Raises:
        ToolkitError: a class none of whose images can be read, or the disk is full.
    """
    place = keep / f"data-{_hash_sources(sources, classes, how)[:16]}"
    if not (place / "about.json").is_file():
        _render(sources, place / "shards", workers, quiet)
        _pack_all(sources, classes.index_of, how, place, quiet)
        shutil.rmtree(place / "shards", ignore_errors=True)
    about = json.loads((place / "about.json").read_text(encoding="utf-8"))
    skipped = [one for source in sources for one in source.skipped] + [tuple(one) for one in about["skipped"]]
    train, held_out = (_open_pack(place, name, about[name], how.crop_px) for name in PACKS)
    _check_classes(classes, train, skipped)
    record = {
        "sources": [source.record for source in sources],
        "trained_on": {"images": len(train.images), "sha256": train.sha256},
        "held_out": {"images": len(held_out.images), "sha256": held_out.sha256},
        "stored_px": how.crop_px,
        "skipped": len(skipped),
    }
    return TrainingSet(classes.labels, train, held_out, tuple(skipped), record)


def _hash_sources(sources: Sequence[Source], classes: TrainingClasses, how: Preprocessing) -> str:
    """Address of the packed images: of the files' names, sizes and times, and of all that decides the renders."""
    items = [[source.key, *map(_address, (*source.train, *source.held_out))] for source in sources]
    return sha256_bytes(json.dumps([items, asdict(how), classes.index_of]).encode())


def _address(item: Item) -> str:
    if isinstance(item, RenderUnit | StoredImage):
        return item.name
    status = item.path.stat()
    return f"{item.path} {item.label} {status.st_size} {status.st_mtime_ns}"


def _render(sources: Sequence[Source], folder: Path, workers: int, quiet: bool) -> None:
    units = [item for source in sources for item in (*source.train, *source.held_out) if isinstance(item, RenderUnit)]
    if not units:
        return
    total = sum(unit.views for unit in units)
    done = sum(unit.views for unit in units if (folder / unit.name).is_file())
    with progress(f"Rendering {len(units)} objects", total, quiet, done) as bar:
        render_shards(units, folder, workers, bar.advance)


def _pack_all(
    sources: Sequence[Source], index_of: dict[str, int], how: Preprocessing, place: Path, quiet: bool
) -> None:
    parts = {name: [item for source in sources for item in getattr(source, name)] for name in PACKS}
    about: dict[str, Any] = {"skipped": []}
    files = sum(isinstance(item, LabelledFile) for items in parts.values() for item in items)
    with progress("Reading images", files, quiet or not files) as bar:
        for name, items in parts.items():
            about[name] = _write_pack(place, name, items, index_of, how, about["skipped"], bar.advance)
    write_json(place / "about.json", about)


def _write_pack(place: Path, name: str, items, index_of, how: Preprocessing, skipped: list, advance) -> dict[str, Any]:
    """Pixels one after the other in a raw file, its length told by `about.json`, which is written last."""
    classes: list[int] = []
    digest = sha256()
    try:
        place.mkdir(parents=True, exist_ok=True)
        with (place / f"{name}.raw").open("wb") as file:
            for label, pictures in _read_items(items, place / "shards", how, skipped, advance):
                content = np.ascontiguousarray(pictures).tobytes()
                file.write(content)
                digest.update(content)
                classes += [index_of[label]] * len(pictures)
    except OSError as error:
        raise explain_write_error(place / f"{name}.raw", error) from error
    digest.update(np.array(classes, "<i8").tobytes())
    return {"classes": classes, "sha256": digest.hexdigest()}


def _read_items(
    items: Sequence[Item], shards: Path, how: Preprocessing, skipped: list, advance: Callable[[int], None]
) -> Iterator[tuple[str, np.ndarray]]:
    """(label, (k, s, s, 3) uint8) of each item in order; a file that cannot be read goes to `skipped`."""
    with ThreadPoolExecutor() as pool:
        for start in range(0, len(items), BLOCK):
            block = items[start : start + BLOCK]
            for item, found in zip(block, pool.map(lambda one: _read_item(one, shards, how), block), strict=True):
                if isinstance(item, LabelledFile):
                    advance(1)
                    if isinstance(found, str):
                        skipped.append((item.shown, found))
                if not isinstance(found, str):
                    yield item.label, found


def _read_item(item: Item, shards: Path, how: Preprocessing) -> np.ndarray | str:
    if isinstance(item, RenderUnit):
        return np.load(shards / item.name, allow_pickle=False, mmap_mode=None)
    if isinstance(item, StoredImage):
        return resize_and_crop(item.pixels, how)[None]
    try:
        return load_square(item.path, how)[None]
    except UnreadableImage as error:
        return error.reason


def _open_pack(place: Path, name: str, about: dict[str, Any], px: int) -> Pack:
    classes = np.array(about["classes"], np.int64)
    shape = (len(classes), px, px, 3)
    file = place / f"{name}.raw"
    expected = int(np.prod(shape))
    if not file.is_file() or file.stat().st_size != expected:
        raise ToolkitError(f"{file} is damaged: expected {expected} bytes: delete {place}, or train with --restart")
    images = np.memmap(file, np.uint8, "r", shape=shape) if len(classes) else np.zeros(shape, np.uint8)
    return Pack(images, classes, about["sha256"])


def _check_classes(classes: TrainingClasses, train: Pack, skipped: Sequence[tuple[str, str]]) -> None:
    filled = set(train.classes.tolist())
    label = next((label for label, index in classes.index_of.items() if index not in filled), None)
    if label is not None:
        path, reason = next((one for one in skipped if label in one[0]), ("", "none found"))
        raise ToolkitError(f"class '{label}': none of its images can be used; {path}: {reason}")


def store_preprocessing(how: Preprocessing, px: int) -> Preprocessing:
    """How images are kept for training: the whole middle square at `px`."""
    return replace(how, resize_px=px, crop_px=px)
