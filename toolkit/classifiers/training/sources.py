"""What `--data` names: procedural objects, the workspace's objects, a folder of images, or CIFAR-10."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

from toolkit.classifiers.cifar10 import CIFAR_PREFIX
from toolkit.classifiers.training.cifar import StoredImage, list_cifar
from toolkit.classifiers.training.folder import LabelledFile, find_classes
from toolkit.classifiers.training.renders import EVERYDAY, RIG, RenderUnit
from toolkit.errors import ToolkitError
from toolkit.files import inside, sha256_bytes, sha256_file
from toolkit.objects.spec import read_spec
from toolkit.workspace import Workspace

PACKAGE = Path(__file__).parents[2]
PICTURE_MAKERS = ("training", "raycast", "lighting", "shading", "studio", "materials", "room", "backdrop", "finish")
"""Modules of `toolkit.rig` that decide what a render looks like."""


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
            raise ToolkitError(f"--per-class {self.per_class} --views {self.views}: expected at least 1 of each")
        if not 0 <= self.held_out < 1:
            raise ToolkitError(f"--held-out {self.held_out:g}: expected a share from 0 to below 1, such as 0.1")

    def units(self, source: str, label: str, name: str) -> tuple[tuple[RenderUnit, ...], tuple[RenderUnit, ...]]:
        """What to render of one object's kind, to train on and held out."""
        parts = []
        for part, images in enumerate((self.per_class, round(self.held_out * self.per_class))):
            seeds = [(self.seed, crc32(name.encode()), part, k) for k in range(-(-images // self.views))]
            parts.append(tuple(RenderUnit(source, label, seed, self.views, self.px) for seed in seeds))
        return parts[0], parts[1]


@dataclass(frozen=True)
class Source:
    """One `--data`.

    Attributes:
        train, held_out: images and renders.
        skipped: (path, reason) of what is left out from the start.
        record: for the classifier's record.
        key: of all else that decides the pixels.
        words: what it is, in a few words.
        held_out_words: how the held-out images differ.
    """

    train: tuple[LabelledFile | RenderUnit | StoredImage, ...]
    held_out: tuple[LabelledFile | RenderUnit | StoredImage, ...]
    skipped: tuple[tuple[str, str], ...]
    record: dict[str, Any]
    key: str
    words: str
    held_out_words: str


def open_source(data: str, workspace: Workspace, counts: RenderCounts, download: bool = False) -> Source:
    """What one `--data` offers; `everyday` and `rig` are sources, a folder of that name is `./everyday`.

    Args:
        data: as typed.
        workspace: whose objects `rig` is.
        counts: of renders.
        download: fetch CIFAR-10 where `cifar10:FOLDER` has none.

    Raises:
        ToolkitError: a folder that is missing or has no classes, or an object that cannot be rendered.
    """
    if data == EVERYDAY:
        return _everyday(counts)
    if data == RIG:
        return _rig(workspace, counts)
    if data.startswith(CIFAR_PREFIX):
        return _cifar(Path(data.removeprefix(CIFAR_PREFIX)), download)
    found = find_classes(Path(data), counts.held_out, counts.seed)
    kinds = sorted({one.label for one in found.train})
    record = {"source": Path(data).resolve().name, "classes": len(kinds)}
    words = f"photographs of {len(kinds)} classes from the folder {record['source']}"
    return Source(found.train, found.held_out, found.skipped, record, "", words, found.how)


def _cifar(folder: Path, download: bool) -> Source:
    train, held_out = (list_cifar(folder, split, download) for split in ("train", "test"))
    record = {"source": "cifar10", "classes": len({one.label for one in train})}
    return Source(train, held_out, (), record, "", "photographs of CIFAR-10", "CIFAR-10's test images")


def _everyday(counts: RenderCounts) -> Source:
    from toolkit.objects.everyday import MAKERS

    units = [counts.units(EVERYDAY, label, f"{EVERYDAY}/{label}") for label in sorted(MAKERS)]
    record = {"source": EVERYDAY, "classes": len(MAKERS), "objects": sum(len(train) for train, _ in units)}
    words = f"renders of {len(MAKERS)} kinds of everyday objects"
    return _source(units, record, _hash_code(), words, "other objects of each kind, in other studios and views")


def _rig(workspace: Workspace, counts: RenderCounts) -> Source:
    specs = {name: (file, read_spec(file)) for name, file in sorted(workspace.object_specs().items())}
    units: list[tuple] = []
    keys: list[Any] = [_hash_code()]
    for name, (file, spec) in specs.items():
        if isinstance(spec.class_name, int):
            raise ToolkitError(
                f"{file}: field 'class' is the number {spec.class_name}: a new classifier needs its classes by name"
            )
        units.append(counts.units(str(file), spec.class_name, f"{RIG}/{name}"))
        keys.append([spec.model_dump(mode="json"), _hash_mesh(file, spec.mesh)])
    kinds = {spec.class_name for _, spec in specs.values()}
    record = {"source": RIG, "classes": len(kinds), "objects": list(specs)}
    words = f"renders of {len(specs)} objects in the rig"
    return _source(units, record, json.dumps(keys), words, "the same objects in other studios and views")


def _source(units: Sequence[tuple], record: dict[str, Any], key: str, words: str, held_out_words: str) -> Source:
    train = tuple(unit for own, _ in units for unit in own)
    held_out = tuple(unit for _, own in units for unit in own)
    return Source(train, held_out, (), record, key, words, held_out_words)


def _hash_mesh(spec_file: Path, mesh: str) -> str:
    if not mesh.startswith("builtin:") and (path := inside(spec_file.parent, mesh)).is_file():
        return sha256_file(path)
    return mesh


def _hash_code() -> str:
    """Of the modules that make and render objects: renders of another version are not mixed with this one's."""
    files = sorted((PACKAGE / "objects").rglob("*.py"))
    files += [PACKAGE / "rig" / f"{name}.py" for name in PICTURE_MAKERS]
    return sha256_bytes("".join(sha256_file(file) for file in files).encode())
