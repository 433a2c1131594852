"""Training and held-out images from any mix of sources, packed into files that are read without loading them whole."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from toolkit.core.console import progress
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import (
    delete_folder,
    load_json,
    open_whole,
    real_path,
    sha256_bytes,
    sha256_file,
    write_json,
)
from toolkit.core.rooms import ask_room, find_code
from toolkit.core.threads import map_ahead
from toolkit.core.work import Work
from toolkit.core.workspace import Workspace
from toolkit.imaging.preprocessing import Preprocessing, resize_and_crop
from toolkit.imaging.read import UnreadableImage, read_image
from toolkit.models.network import Classifier, match_classes
from toolkit.objects.load import load_object
from toolkit.objects.spec import BUILTIN_PREFIX, names_with_mesh, read_spec
from toolkit.training.images import (
    CIFAR_PREFIX,
    CifarImage,
    FolderClasses,
    LabelledFile,
    cut_square,
    find_classes,
    find_photographs,
    list_cifar,
)
from toolkit.training.renders import EVERYDAY, RIG, RenderUnit, render_shards

PACKAGE = Path(__file__).parents[1]
Item = LabelledFile | RenderUnit | CifarImage


@dataclass(frozen=True)
class RenderCounts:
    """How many renders of a class.

    Attributes:
        per_class: to train on.
        views: of each object in its studio; another object, or another studio, has other views.
        held_out: share of `per_class` that is rendered on top and held out.
        seed: of all draws.
        px: side of the pictures.
    """

    per_class: int
    views: int
    held_out: float
    seed: int
    px: int

    def __post_init__(self) -> None:
        if self.per_class < 1 or self.views < 1:
            raise FieldError("expected at least 1 of each", {"per_class": self.per_class, "views": self.views})
        if not 0 <= self.held_out < 1:
            raise FieldError("expected a share from 0 to below 1, such as 0.1", {"held_out": self.held_out})

    def units(self, source: str, label: str, name: str) -> tuple[tuple[RenderUnit, ...], tuple[RenderUnit, ...]]:
        """Renders of a kind of object, to train on and held out."""
        parts = []
        for part, images in enumerate((self.per_class, round(self.held_out * self.per_class))):
            # `part` keeps the objects of training and of the test apart
            seeds = [(self.seed, crc32(name.encode()), part, k) for k in range(-(-images // self.views))]
            parts.append(tuple(RenderUnit(source, label, seed, self.views, self.px) for seed in seeds))
        return parts[0], parts[1]


@dataclass(frozen=True)
class DataSource:
    """One `--data`.

    Attributes:
        train, held_out: images and renders.
        skipped: (path, reason) of what is left out from the start.
        record: for the classifier's record.
        key: of all else that decides the pixels.
        words: what it is, in a few words.
        held_out_words: how the held-out images differ.
    """

    train: tuple[Item, ...]
    held_out: tuple[Item, ...]
    skipped: tuple[tuple[str, str], ...]
    record: dict[str, Any]
    key: str
    words: str
    held_out_words: str


def open_source(data: str, workspace: Workspace, counts: RenderCounts, download: bool = False) -> DataSource:
    """Images and renders of a `--data`; `everyday` and `rig` are sources, a folder of that name is `./everyday`.

    Args:
        data: as typed.
        workspace: whose objects `rig` is.
        counts: of renders.
        download: fetch CIFAR-10 where `cifar10:FOLDER` has none.

    Raises:
        ToolkitError: a folder that is missing or has no classes, or an object that cannot be rendered.
    """
    # the words `everyday` and `rig` win; a folder of that name is ./everyday
    if data == EVERYDAY:
        return _everyday(counts)
    if data == RIG:
        return _rig(workspace, counts)
    if data.startswith(CIFAR_PREFIX):
        return _cifar(Path(data.removeprefix(CIFAR_PREFIX)), download)
    return _photographs(data, find_classes(Path(data), counts.held_out, counts.seed))


def open_photographs(folder: str, held_out: float) -> DataSource:
    """The photographs of a folder, a fixed share held out whatever their classes; see `find_photographs`.

    Raises:
        ToolkitError: a folder that is missing or has no classes.
    """
    return _photographs(folder, find_photographs(Path(folder), held_out))


def _photographs(data: str, found: FolderClasses) -> DataSource:
    kinds = sorted({image.label for image in (*found.train, *found.held_out)})
    record = {"source": real_path(Path(data)).name, "classes": len(kinds)}
    words = f"photographs of {len(kinds)} classes from the folder {record['source']}"
    return DataSource(found.train, found.held_out, found.skipped, record, "", words, found.how)


def _cifar(folder: Path, download: bool) -> DataSource:
    train, held_out = (list_cifar(folder, split, download) for split in ("train", "test"))
    record = {"source": "cifar10", "classes": len({image.label for image in train})}
    return DataSource(train, held_out, (), record, "", "photographs of CIFAR-10", "CIFAR-10's test images")


def _everyday(counts: RenderCounts) -> DataSource:
    makers = ask_room(EVERYDAY)
    units = [counts.units(EVERYDAY, label, f"{EVERYDAY}/{label}") for label in sorted(makers)]
    record = {"source": EVERYDAY, "classes": len(makers), "objects": sum(len(train) for train, _ in units)}
    words = f"renders of {len(makers)} kinds of everyday objects"
    return _source(units, record, _hash_code(), words, "other objects of each kind, in other studios and views")


def _rig(workspace: Workspace, counts: RenderCounts) -> DataSource:
    files = {name: workspace.object_spec(name) for name in names_with_mesh(workspace)}
    specs = {name: (file, read_spec(file)) for name, file in files.items()}
    units: list[tuple] = []
    keys: list[Any] = [_hash_code()]
    # the source's key: code that renders, spec and mesh of each object
    for name, (file, spec) in specs.items():
        if isinstance(spec.class_name, int):
            raise ToolkitError(
                f"{file}: field 'class' is the number {spec.class_name}: a new classifier needs its classes by name"
            )
        units.append(counts.units(str(file), spec.class_name, f"{RIG}/{name}"))
        # the mesh as it is read: an OBJ, glTF or PLY has its colours and numbers in other files
        is_builtin = spec.mesh.startswith(BUILTIN_PREFIX)
        keys.append([spec.model_dump(mode="json"), spec.mesh if is_builtin else load_object(file).mesh_sha256])
    kinds = {spec.class_name for _, spec in specs.values()}
    record = {"source": RIG, "classes": len(kinds), "objects": list(specs)}
    words = f"renders of {len(specs)} objects in the rig"
    return _source(units, record, json.dumps(keys), words, "the same objects in other studios and views")


def _source(units: Sequence[tuple], record: dict[str, Any], key: str, words: str, held_out_words: str) -> DataSource:
    train = tuple(unit for own, _ in units for unit in own)
    held_out = tuple(unit for _, own in units for unit in own)
    return DataSource(train, held_out, (), record, key, words, held_out_words)


def _hash_code() -> str:
    """Return the hash of the modules that make and render objects, so that renders of two versions do not mix."""
    folders = (PACKAGE / "objects", *find_code(BUILTIN_PREFIX), PACKAGE / "rig")
    files = [file for folder in folders for file in sorted(folder.rglob("*.py"))]
    return sha256_bytes("".join(sha256_file(file) for file in files).encode())


@dataclass(frozen=True)
class TrainingClasses:
    """The outputs of a network and the data's names for them.

    Attributes:
        labels: a label per output.
        index_of: output by the label of an image, its folder's name.
    """

    labels: tuple[str, ...]
    index_of: dict[str, int]

    @property
    def used(self) -> list[int]:
        """Outputs that have images, sorted."""
        return sorted(set(self.index_of.values()))


def list_classes(sources: Sequence[DataSource]) -> TrainingClasses:
    """The classes of the data, by name.

    Raises:
        ToolkitError: fewer than two.
    """
    labels = tuple(sorted({item.label for source in sources for item in source.train}))
    if len(labels) < 2:
        only = f"found only '{labels[0]}'" if labels else "found none"
        raise FieldError(f"a classifier needs at least two classes: {only}: add another {{data}} or class folder", {})
    return TrainingClasses(labels, {label: index for index, label in enumerate(labels)})


def keep_classes(sources: Sequence[DataSource], classifier: Classifier, field: str = "init") -> TrainingClasses:
    """All classes of a classifier; the data's are found among them by WordNet id or by label.

    Errors name `field` as what chose the classifier.

    Raises:
        ToolkitError: the data has a class that the classifier has not.
    """
    index_of: dict[str, int] = {}
    for source in sources:
        names = sorted({item.label for item in (*source.train, *source.held_out)})
        index_of |= match_classes(names, classifier, Path(source.record["source"]), field)
    return TrainingClasses(tuple(classifier.labels), index_of)


PACKS = ("train", "held_out")


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
    """Training and test images of a classifier.

    Attributes:
        labels: a label per output of the network.
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
    sources: Sequence[DataSource], classes: TrainingClasses, how: Preprocessing, keep: Path, workers: int, *,
    every_class: bool = True,
) -> TrainingSet:  # fmt: skip
    """Render and decode what the sources offer, or take what an earlier run left in `keep`.

    Args:
        sources: at least one.
        classes: what their labels stand for.
        how: how images are stored: square, `crop_px` a side.
        keep: folder for what is rendered and packed, until the training is finished.
        workers: processes that render.
        every_class: whether each must have an image to train on; a network's own answers are learnt without.

    Raises:
        ToolkitError: a class none of whose images can be read, no image at all, or the disk is full.
    """
    # by all that decides the pixels: trainings that differ in their steps share a pack
    place = keep / f"data-{_hash_sources(sources, classes, how)[:16]}"
    # the record is written last: without it the pack is unfinished, and made from the start
    if not (place / "about.json").is_file():
        _render(sources, place / "shards", workers)
        _pack_all(sources, classes.index_of, how, place)
        delete_folder(place / "shards")
    about = load_json(place / "about.json")
    skipped = [skip for source in sources for skip in source.skipped] + [tuple(skip) for skip in about["skipped"]]
    train, held_out = (_open_pack(place, name, about[name], how.crop_px) for name in PACKS)
    offered = {item.label for source in sources for item in source.train}
    # a class without a readable image cannot be learnt
    if every_class or not len(train.images):
        _check_classes({label: classes.index_of[label] for label in sorted(offered)}, train, skipped)
    record = {
        "sources": [source.record for source in sources],
        "trained_on": {"images": len(train.images), "sha256": train.sha256},
        "held_out": {"images": len(held_out.images), "sha256": held_out.sha256},
        "stored_px": how.crop_px,
        "skipped": len(skipped),
    }
    return TrainingSet(classes.labels, train, held_out, tuple(skipped), record)


def _hash_sources(sources: Sequence[DataSource], classes: TrainingClasses, how: Preprocessing) -> str:
    """Address of the packed images: of the files' names, sizes and times, and of all that decides the renders."""
    items = [[source.key, *map(_address, (*source.train, *source.held_out))] for source in sources]
    return Work("packed images").key(items, asdict(how), classes.index_of)


def _address(item: Item) -> str:
    if isinstance(item, RenderUnit | CifarImage):
        return item.name
    status = item.path.stat()
    # size and time stand for the content, which may be gigabytes
    return f"{item.path} {item.label} {status.st_size} {status.st_mtime_ns}"


def _render(sources: Sequence[DataSource], folder: Path, workers: int) -> None:
    units = [item for source in sources for item in (*source.train, *source.held_out) if isinstance(item, RenderUnit)]
    if not units:
        return
    total = sum(unit.views for unit in units)
    done = sum(unit.views for unit in units if (folder / unit.name).is_file())
    with progress(f"Rendering {len(units)} objects", total, done=done) as bar:
        render_shards(units, folder, workers, bar.advance)


def _pack_all(sources: Sequence[DataSource], index_of: dict[str, int], how: Preprocessing, place: Path) -> None:
    parts = {name: [item for source in sources for item in getattr(source, name)] for name in PACKS}
    skipped: list[tuple[str, str]] = []
    about: dict[str, Any] = {"skipped": skipped}
    files = sum(isinstance(item, LabelledFile) for items in parts.values() for item in items)
    read = partial(_read_item, place / "shards", how)
    with progress("Reading images", files, quiet=not files) as bar:
        for name, items in parts.items():
            about[name] = _write_pack(place / f"{name}.raw", _read_items(items, read, skipped, bar.advance), index_of)
    # last: where it is, the packs are whole
    write_json(place / "about.json", about)


def _write_pack(file: Path, labelled: Iterable[tuple[str, np.ndarray]], index_of: Mapping[str, int]) -> dict[str, Any]:
    """Consecutive pixels in a raw file, its length told by `about.json`, which is written last."""
    classes: list[int] = []
    digest = sha256()
    with open_whole(file) as stream:
        for label, pictures in labelled:
            content = np.ascontiguousarray(pictures).tobytes()
            stream.write(content)
            digest.update(content)
            classes += [index_of[label]] * len(pictures)
    # little-endian: the hash is the same on every machine
    digest.update(np.array(classes, "<i8").tobytes())
    return {"classes": classes, "sha256": digest.hexdigest()}


def _read_items(
    items: Sequence[Item], read: Callable[[Item], np.ndarray | str], skipped: list[tuple[str, str]],
    advance: Callable[[int], None],
) -> Iterator[tuple[str, np.ndarray]]:  # fmt: skip
    """(label, (k, s, s, 3) uint8) of each item in order; a file that cannot be read goes to `skipped`."""
    for item, found in zip(items, map_ahead(read, items), strict=True):
        if isinstance(item, LabelledFile):
            advance(1)
            if isinstance(found, str):
                skipped.append((item.shown, found))
        if not isinstance(found, str):
            yield item.label, found


def _read_item(shards: Path, how: Preprocessing, item: Item) -> np.ndarray | str:
    if isinstance(item, RenderUnit):
        return np.load(shards / item.name, allow_pickle=False, mmap_mode=None)
    if isinstance(item, CifarImage):
        return resize_and_crop(item.pixels, how)[None]
    try:
        return cut_square(read_image(item.path, how.resize_px), item.path, how)[None]
    except UnreadableImage as error:
        return error.reason


def _open_pack(place: Path, name: str, about: dict[str, Any], px: int) -> Pack:
    classes = np.array(about["classes"], np.int64)
    shape = (len(classes), px, px, 3)
    file = place / f"{name}.raw"
    expected = int(np.prod(shape))
    if not file.is_file() or file.stat().st_size != expected:
        raise FieldError(f"{file} is damaged: expected {expected} bytes: delete {place}, or train with {{restart}}", {})
    # mapped, not read: a set may be larger than memory; an empty file cannot be mapped
    images = np.memmap(file, np.uint8, "r", shape=shape) if len(classes) else np.zeros(shape, np.uint8)
    return Pack(images, classes, about["sha256"])


def _check_classes(index_of: Mapping[str, int], train: Pack, skipped: Sequence[tuple[str, str]]) -> None:
    filled = set(train.classes.tolist())
    label = next((label for label, index in index_of.items() if index not in filled), None)
    if label is not None:
        path, reason = next((skip for skip in skipped if label in skip[0]), ("", "none found"))
        raise ToolkitError(f"class '{label}': none of its images can be used; {path}: {reason}")


def store_preprocessing(how: Preprocessing, px: int) -> Preprocessing:
    """How images are kept for training: the whole middle square at `px`."""
    return replace(how, resize_px=px, crop_px=px)
