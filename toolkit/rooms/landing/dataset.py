"""A landing data set on disk: tar shards as WebDataset streams them, and `dataset.json` beside them.

A sample is three files of the same key: `KEY.png` the picture, `KEY.seg.png` the pad (255) in it, `KEY.json` its
`Truth`.
"""

import io
import json
import math
import tarfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.files import explain_validation, inside, open_plain, open_whole, read_json, sha256_file
from toolkit.core.text import escape, shorten
from toolkit.imaging.read import UnreadableImage, decode_frame

DATASET = "dataset.json"
KINDS = ("json", "png", "seg.png")
MOST_SIDE_PX, MOST_SHARDS = 1024, 20_000
MOST_ENTRY_BYTES = 8 << 20
"""Two and a half times the noisiest picture of the largest camera."""
SPLITS = ("train", "held_out")
Split = Literal["train", "held_out"]


class Truth(BaseModel):
    """The truth of a picture.

    Attributes:
        index: number of the sample.
        seed: seed of its draws.
        x_m, y_m, z_m: the pad's centre in the camera's frame: right, down in the image, ahead.
        yaw_deg: rotation of the pad in the image, clockwise; at 0 its top is up.
        place, time: place and time of day.
        weather, severity: weather and its severity.
        seen_px: number of pixels that show the pad.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    index: int = Field(ge=0)
    seed: int
    x_m: float
    y_m: float
    z_m: float = Field(gt=0)
    yaw_deg: float
    place: str
    time: str
    weather: str
    severity: int
    seen_px: int


class ShardFile(BaseModel):
    """A tar file."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    file: str
    split: Split
    n: int = Field(ge=0)
    sha256: str


class DatasetFile(BaseModel):
    """`dataset.json`.

    Attributes:
        inputs_sha256: hash of everything that decides the bytes.
        seed: seed of the draws.
        world, world_seed: world and its seed.
        pad, pad_sha256, size_m: pad, hash of its file, and its side.
        camera: width, height, fx, fy, cx and cy.
        places: places of each split.
        settings: all other settings.
        complete: whether all shards exist.
        shards: shards in order.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: int = 1
    inputs_sha256: str
    seed: int
    world: str
    world_seed: int
    pad: str
    pad_sha256: str
    size_m: float
    camera: dict[str, float]
    places: dict[str, list[str]]
    settings: dict[str, Any]
    complete: bool
    shards: list[ShardFile] = Field(max_length=MOST_SHARDS)
    toolkit_version: str

    @field_validator("camera")
    @classmethod
    def _check_camera(cls, camera: dict[str, float]) -> dict[str, float]:
        missing = [name for name in ("width", "height", "fx", "fy", "cx", "cy") if name not in camera]
        if missing:
            raise ValueError(f"expected '{missing[0]}' among its numbers")
        sides = camera["width"], camera["height"]
        if not all(1 <= side <= MOST_SIDE_PX and side == int(side) for side in sides):
            raise ValueError(f"expected width and height of 1 to {MOST_SIDE_PX} whole pixels")
        if not (min(camera["fx"], camera["fy"]) > 0 and all(math.isfinite(number) for number in camera.values())):
            raise ValueError("expected finite numbers, fx and fy over 0")
        return camera

    @field_validator("shards")
    @classmethod
    def _check_names(cls, shards: list[ShardFile]) -> list[ShardFile]:
        if len({shard.file for shard in shards}) < len(shards):
            raise ValueError("a shard is listed twice")
        return shards

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of its pictures."""
        return int(self.camera["width"]), int(self.camera["height"])


@dataclass(frozen=True)
class Sample:
    """A picture with what is known of it."""

    image: np.ndarray  # (h, w, 3) uint8 sRGB
    mask: np.ndarray  # (h, w) bool the pad
    truth: Truth  # where it is


@dataclass(frozen=True)
class SampleSet:
    """The samples of a split in memory."""

    images: np.ndarray  # (n, h, w, 3) uint8 sRGB
    truths: tuple[Truth, ...]  # in the same order

    @property
    def offsets(self) -> np.ndarray:
        """(n, 2) float32 x and y, metres."""
        return np.array([(truth.x_m, truth.y_m) for truth in self.truths], np.float32).reshape(-1, 2)

    @property
    def heights(self) -> np.ndarray:
        """(n,) z, metres."""
        return np.array([truth.z_m for truth in self.truths])


@dataclass(frozen=True)
class LoadedSet:
    """A data set in memory."""

    name: str  # of its folder
    about: DatasetFile  # its `dataset.json`
    train: SampleSet  # train, held_out: its samples
    held_out: SampleSet


EncodedSample = dict[str, bytes]
"""The files of a sample by name."""


def encode_sample(sample: Sample) -> EncodedSample:
    """Truth, picture and mask as they lie in a shard."""
    key = f"{sample.truth.index:08d}"
    return {
        f"{key}.json": json.dumps(sample.truth.model_dump(), sort_keys=True).encode(),
        f"{key}.png": _encode(sample.image[..., ::-1]),
        f"{key}.seg.png": _encode(sample.mask.astype(np.uint8) * 255),
    }


def write_shard(path: Path, samples: Iterable[EncodedSample]) -> None:
    """Write samples as a tar whose bytes depend on them alone."""
    with open_whole(path) as file, tarfile.open(fileobj=file, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for sample in samples:
            for name, content in sample.items():
                _add(tar, name, content)


def _add(tar: tarfile.TarFile, name: str, content: bytes) -> None:
    entry = tarfile.TarInfo(name)
    entry.size, entry.mode = len(content), 0o644
    tar.addfile(entry, io.BytesIO(content))


def _encode(picture: np.ndarray) -> bytes:
    return cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 3])[1].tobytes()


def read_shard(path: Path, size_px: tuple[int, int]) -> Iterator[Sample]:
    """The samples of a shard, in order.

    Args:
        path: of a plain tar, whose entries are plain files: nothing in it is unpacked, followed or filled with zeros.
        size_px: width and height of its pictures.

    Raises:
        ToolkitError: it is cut or damaged, of another kind, or a sample in it is none; the message names shard and
            sample.
    """
    # the parts of the sample that is being read, by kind
    parts: dict[str, bytes] = {}
    try:
        with open_plain(path) as file, tarfile.open(fileobj=file, mode="r:") as tar:
            for entry in tar:
                key, _, kind = entry.name.partition(".")
                # links, devices and sparse files are refused: they could lead elsewhere or swell
                found = tar.extractfile(entry) if entry.isreg() and not entry.issparse() else None
                if found is None or kind not in KINDS or kind in parts or entry.size > MOST_ENTRY_BYTES:
                    raise ToolkitError(
                        f"{path}: '{escape(shorten(entry.name, 80))}' is no part of a sample: expected plain files "
                        f"{', '.join(f'KEY.{kind}' for kind in KINDS)} of up to {MOST_ENTRY_BYTES >> 20} MB: "
                        "collect it again"
                    )
                parts[kind] = found.read()
                # the files of a sample follow each other
                if len(parts) == len(KINDS):
                    yield _decode(path, key, parts, size_px)
                    parts = {}
    except (tarfile.TarError, EOFError, OSError, ValueError):
        raise ToolkitError(f"{path}: the shard is missing, cut or damaged, or no plain tar: collect it again") from None
    if parts:
        raise ToolkitError(f"{path}: the shard ends in the middle of a sample: collect it again")


def _decode(path: Path, key: str, parts: dict[str, bytes], size_px: tuple[int, int]) -> Sample:
    where = f"{path}, sample {escape(shorten(key, 80))}"
    try:
        truth = Truth.model_validate_json(parts["json"])
        image = decode_frame(parts["png"], path, size_px=size_px)
        mask = decode_frame(parts["seg.png"], path, grey=True, size_px=size_px)
    except ValidationError as error:
        raise ToolkitError(f"{where}: the truth cannot be used: {explain_validation(error)}") from None
    except UnreadableImage as error:
        raise ToolkitError(f"{where}: a picture in it cannot be used ({error.reason}): collect it again") from None
    return Sample(image, mask > 127, truth)


def open_dataset(folder: Path) -> DatasetFile:
    """`dataset.json` of a folder; raises a `ToolkitError` if there is none, or the set is not complete."""
    file = folder / DATASET
    if not file.is_file():
        raise ToolkitError(f"{folder} holds no {DATASET}: name a landing data set, or make it: toolkit landing collect")
    about = read_json(file, DatasetFile)
    if not about.complete:
        raise ToolkitError(f"{folder}: the data set is not complete: run 'toolkit landing collect' again to resume")
    return about


def find_shard(folder: Path, about: DatasetFile, shard: ShardFile) -> Path:
    """The file of a shard, checked against its hash; a `ToolkitError` where it is missing or another."""
    path = inside(folder, shard.file)
    if not path.is_file():
        raise ToolkitError(f"{path}: the shard is missing: collect the data set again, or copy it whole")
    if sha256_file(path) != shard.sha256:
        _explain_change(path, about, shard)
    return path


def read_split(folder: Path, split: Split, most: int | None = None) -> SampleSet:
    """All samples of a split, or the first `most`, each shard checked against its hash.

    Raises:
        ToolkitError: a shard is missing, cut or changed, a truth is no number, or a sample is of another seed.
    """
    about = open_dataset(folder)
    shards = [shard for shard in about.shards if shard.split == split]
    total = sum(shard.n for shard in shards)
    # shards are read in turn, so that a limit leaves the later files unopened
    images: list[np.ndarray] = []
    truths: list[Truth] = []
    with progress(f"Reading {split.replace('_', '-')} frames", min(total, most or total)) as bar:
        for shard in shards:
            if most is not None and len(truths) >= most:
                break
            path = find_shard(folder, about, shard)
            for sample in read_shard(path, about.size_px):
                # the seed tells frames of this set from those of another in the same folder
                if sample.truth.seed != about.seed:
                    _refuse_seed(path, sample, about)
                images.append(sample.image)
                truths.append(sample.truth)
                bar.advance()
    if not truths:
        raise ToolkitError(f"{folder} has no {split.replace('_', '-')} frames: collect more, or split it otherwise")
    return SampleSet(np.stack(images[:most]), tuple(truths[:most]))


def read_sets(folders: Sequence[Path], most: int | None = None) -> tuple[LoadedSet, ...]:
    """Data sets that a network can be trained on together, with at most `most` training frames of each.

    Raises:
        ToolkitError: a set is named twice, or they differ in camera or pad; or as `read_split`.
    """
    abouts = [open_dataset(folder) for folder in folders]
    for k, (folder, about) in enumerate(zip(folders, abouts, strict=True)):
        # a set that counts twice would weigh twice
        if about.inputs_sha256 in [earlier.inputs_sha256 for earlier in abouts[:k]]:
            raise ToolkitError(f"{folder}: this data set is named twice: name each once")
        # a network has a single camera and pad size, so the sets must agree in them
        for what, own, first in _compare_sets(about, abouts[0]):
            raise ToolkitError(
                f"{folder}: its {what} is {own}, that of {folders[0]} is {first}: a network is trained on alike "
                "sets: collect them alike, or train a network for each"
            )
    return tuple(
        LoadedSet(folder.name, about, read_split(folder, "train", most), read_split(folder, "held_out"))
        for folder, about in zip(folders, abouts, strict=True)
    )


def _compare_sets(data: DatasetFile, other: DatasetFile) -> Iterator[tuple[str, str, str]]:
    """Differences between sets that a network cannot be trained on together, in words."""
    if data.camera != other.camera:
        yield "camera", _describe_camera(data.camera), _describe_camera(other.camera)
    if data.size_m != other.size_m:
        yield "pad's side", f"{data.size_m:g} m", f"{other.size_m:g} m"
    if data.pad_sha256 != other.pad_sha256:
        yield "pad", f"{data.pad} {data.pad_sha256[:8]}", f"{other.pad} {other.pad_sha256[:8]}"


def _describe_camera(camera: dict[str, float]) -> str:
    return f"{camera['width']:g} × {camera['height']:g} px with fx {camera['fx']:.4g}"


def join_samples(parts: Sequence[SampleSet]) -> SampleSet:
    """The samples of several in order."""
    if len(parts) == 1:
        return parts[0]
    return SampleSet(np.concatenate([part.images for part in parts]), tuple(t for part in parts for t in part.truths))


def _explain_change(path: Path, about: DatasetFile, shard: ShardFile) -> None:
    count = 0
    for sample in read_shard(path, about.size_px):
        count += 1
        if sample.truth.seed != about.seed:
            _refuse_seed(path, sample, about)
    raise ToolkitError(
        f"{path}: the shard differs from {DATASET} ({count} samples, {shard.n} expected): restore it, or collect again"
    )


def _refuse_seed(path: Path, sample: Sample, about: DatasetFile) -> None:
    raise ToolkitError(
        f"{path}, sample {sample.truth.index:08d}: of seed {sample.truth.seed}, the data set is of seed {about.seed}: "
        "shards of different sets were mixed: restore the right ones"
    )
