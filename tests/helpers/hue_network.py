"""A network that tells red, green and blue by the mean colour, photographs that show neither, and patches that do."""

from pathlib import Path

import numpy as np
import torch
from PIL import Image

from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.network import Classifier
from toolkit.models.weights import WeightsFile
from toolkit.objects.records import write_patch
from toolkit.rooms.benchmarks.patch_sets import name_class

LABELS = ["red", "green", "blue"]
PX = 32


class Hue(torch.nn.Module):
    seen = 0

    def forward(self, batch):
        self.seen += len(batch)
        return 20 * batch.mean((2, 3))


class BlindToGreen(Hue):
    """The loss of a patch for green is infinite, that of another class is as before."""

    def forward(self, batch):
        return super().forward(batch).index_fill(1, torch.tensor(1), -torch.inf)


def make_hue_classifier(name: str = "hue") -> Classifier:
    """Logits are the mean of each channel; `module.seen` counts images."""
    how = Preprocessing(36, PX, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    file = WeightsFile(Path(f"{name}.pth"), name.encode().hex().ljust(64, "0"), f"{name}.pth")
    return Classifier(name, Hue().eval(), LABELS, how, file, "cpu", False)


def write_photos(folder: Path, per_class: int = 3, classes=LABELS) -> Path:
    """Noise of 40 × 44 px in one folder per class."""
    rng = np.random.default_rng(0)
    for label in classes:
        for k in range(per_class):
            file = folder / label / f"{k}.png"
            file.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(rng.integers(60, 200, (40, 44, 3), np.uint8)).save(file)
    return folder


def write_set(workspace, name: str = "paint-16", n_px: int = 16, classes=(0, 1, 2), settings=None, shift=0) -> None:
    """A patch set of plain colours, each its class's, or with a `shift` another's."""
    for index in classes:
        pixels = np.zeros((n_px, n_px, 3), np.uint8)
        pixels[..., (index + shift) % 3] = 255
        record = {
            "name": name_class(LABELS, index), "class_name": LABELS[index], "class_index": index, "networks": [],
            "data": {}, "seed": 0, "settings": settings or {"method": "paint"}, "final": {}, "toolkit_version": "0",
        }  # fmt: skip
        write_patch(workspace.root / "print" / "patches" / name, pixels, record)
