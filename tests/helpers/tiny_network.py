"""A network of a few thousand weights behind the real `Classifier`, and photographs to go with it."""

from pathlib import Path

import numpy as np
import torch
from PIL import Image

from toolkit.boosters.patch import TrainedPatch, train_patch
from toolkit.boosters.patch_config import PatchConfig
from toolkit.boosters.pixel_config import DataConfig
from toolkit.core.workspace import Workspace
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.network import Classifier
from toolkit.models.weights import WeightsFile

LABELS = ["cat", "dog", "sports car", "jet"]
IMAGE_PX = 32


def wrap(module: torch.nn.Module, arch: str = "tiny", labels: list[str] | None = None) -> Classifier:
    how = Preprocessing(36, IMAGE_PX, (0.5, 0.5, 0.5), (0.25, 0.25, 0.25))
    for parameter in module.parameters():
        parameter.requires_grad_(False)
    weights = WeightsFile(Path("tiny.pth"), "ab" * 32, "tiny.pth")
    return Classifier(arch, module.eval(), labels or LABELS, how, weights, "cpu", False)


def tiny_classifier(seed: int = 0) -> Classifier:
    torch.manual_seed(seed)
    return wrap(
        torch.nn.Sequential(
            torch.nn.Conv2d(3, 8, 5, 2),
            torch.nn.Softplus(),
            torch.nn.Conv2d(8, 8, 3, 2),
            torch.nn.Softplus(),
            torch.nn.AdaptiveAvgPool2d(2),
            torch.nn.Flatten(),
            torch.nn.Linear(32, len(LABELS)),
        )
    )


def write_photos(folder: Path, count: int, seed: int = 0, size: tuple[int, int] = (60, 44)) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    for k in range(count):
        coarse = rng.integers(0, 256, (4, 5, 3), np.uint8)
        Image.fromarray(coarse).resize(size, Image.Resampling.BICUBIC).save(folder / f"photo_{k:02d}.png")
    return folder


def tiny_config(steps: int = 12, **changes) -> PatchConfig:
    return PatchConfig(**({"size_px": 16, "steps": steps, "batch": 4, "lr": 0.1} | changes))


def train_tiny(
    root: Path, photos: Path, config: PatchConfig | None = None, class_name: str = "jet", networks=None, **options
) -> TrainedPatch:
    """Train a patch for the tiny network in a workspace at `root`."""
    data = DataConfig(sources=(str(photos),))
    networks = networks or [tiny_classifier()]
    return train_patch(config or tiny_config(), class_name, networks, data, Workspace(root), **options)
