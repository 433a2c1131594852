"""The entries that we make of the challenge, from what the repository ships: challenge_entries.py FOLDER [PHOTOGRAPHS].

PHOTOGRAPHS: ImageNet's, a folder for each class, of which the best image of each class becomes an entry.
"""

import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
from tables import DOCS

from toolkit import __version__
from toolkit.core.draws import Draws
from toolkit.core.files import read_json, write_json
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.models.load import load_classifier
from toolkit.objects.load import load_object
from toolkit.objects.records import write_patch
from toolkit.rooms.benchmarks.challenge import CLOSED_OBJECTS, EntryConfig
from toolkit.rooms.benchmarks.challenge.entry import ENTRY, EntryRecord, init_entry
from toolkit.rooms.benchmarks.patch_sets.baselines import BaselineConfig
from toolkit.rooms.benchmarks.patch_sets.baselines.make import make_baseline

ROOT = DOCS.parent
N_PX = 100
"""Boosters of a baseline: as many as the shipped patches."""
BASELINES = {
    "best-image": "The training image of the class that ResNet-18 is surest of.",
    "fixed-pattern": "A pattern of Gaussian noise, drawn by seed and class: the paper's, D.2.",
    "qr": "A QR code of the class's index: the paper's, D.2.",
}
TEXTURES = ROOT / "rig" / "textures"


def main(folder: str, photographs: str | None = None) -> None:
    """Make each entry that is not there yet."""
    entries = make_workspace(folder).root
    space = make_workspace(entries / "spaces" / "patches")
    copy(ROOT / "print/patches/four-networks", space.root / "print/patches/four-networks")
    enter(entries, space, "patch-resnet18", "The kit's own patches: `toolkit train-patch`, against ResNet-18 alone.")
    said = "`toolkit train-patch --view-jitter --corrupt common` against four networks by turns."
    enter(entries, space, "patch-four-networks", said, patch_set="four-networks")
    said = "The kit's own textures: `toolkit train-texture --view-jitter --corrupt common`, four networks by turns."
    enter(entries, space, "texture-four-networks", said, budget="texture")
    said = "The kit's own wraps: `toolkit train-wrap --view-jitter --corrupt common --max-change auto`, four networks."
    enter(entries, space, "wrap-four-networks", said, budget="wrap")
    for name, method in (
        ("texture-resnet18", "`toolkit train-texture` against ResNet-18 alone."),
        ("texture-near", "The kit's own textures, the eggnog's kept near its paint: `--max-change 0.2`."),
    ):
        own = make_workspace(entries / "spaces" / name)
        copy(TEXTURES / name.removeprefix("texture-"), own.textures_dir)
        enter(entries, own, name, method, budget="texture")
    make_plain(space)
    enter(entries, space, "grey", "Middle grey paper.", patch_set="grey")
    enter(entries, space, "noise", "Each value of each pixel drawn alike from 0 to 255.", patch_set="noise")
    labels = tuple(load_object(space.object_spec(name)).spec.class_name for name in CLOSED_OBJECTS)
    for kind, method in BASELINES.items():
        if kind != "best-image" or photographs is not None:
            data = photographs if kind == "best-image" else None
            config = BaselineConfig(kind=kind, class_names=tuple(map(str, labels)), sizes_px=(N_PX,), data=data)
            make_baseline(config, load_classifier("resnet18"), space)
            enter(entries, space, kind, method, patch_set=config.name_set(N_PX))


def copy(source: Path, target: Path) -> None:
    """The entries that are missing."""
    shutil.copytree(source, target, dirs_exist_ok=True)


def make_plain(space: Workspace) -> None:
    """Two sets of patches of every object: middle grey, and noise."""
    for name in CLOSED_OBJECTS:
        spec = load_object(space.object_spec(name)).spec
        index = load_classifier("resnet18").class_index(spec.class_name)
        noise = Draws(0, index, "challenge noise").of("pixels").integers(0, 256, (N_PX, N_PX, 3), dtype=np.uint8)
        for what, pixels in (("grey", np.full_like(noise, 128)), ("noise", noise)):
            record: dict[str, Any] = {
                "name": name, "class_name": spec.class_name, "class_index": index, "networks": [], "data": {},
                "seed": 0, "settings": {"method": what}, "final": {}, "toolkit_version": __version__,
            }  # fmt: skip
            write_patch(space.root / "print" / "patches" / what, pixels, record)


def enter(
    entries: Path, space: Workspace, name: str, method: str, *, budget: str = "patch", patch_set: str | None = None
) -> None:
    """Make an entry of a workspace's boosters, unless it is there."""
    folder = entries / "entries" / name
    if folder.exists():
        return
    made = init_entry(space.with_patches(patch_set), folder, EntryConfig(budget=budget))
    words = {"name": name, "authors": ["toolkit"], "method": method}
    record = EntryRecord.model_validate(read_json(made.folder / ENTRY, EntryRecord).model_dump() | words)
    write_json(made.folder / ENTRY, record.model_dump(mode="json"), made.folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
