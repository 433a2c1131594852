"""train-patch against a bare ResNet-18 forward and backward to the input, same batch, same weights, taken in turns."""

from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
import torch
from torchvision.models import resnet18

from toolkit.boosters.affine import AffineRanges
from toolkit.boosters.appearance import Appearance
from toolkit.boosters.batches import stack_on_device
from toolkit.boosters.light import LightRanges
from toolkit.boosters.training import Descent, Target, draw_first_patch, train_steps
from toolkit.classifiers.network import Classifier, choose_device
from toolkit.classifiers.preprocessing import Preprocessing
from toolkit.classifiers.weights import WeightsFile

BATCH, IMAGE_PX, REPEATS = 16, 224, 9
GOAL = 0.9


def build_network(memory_format: torch.memory_format, device: str) -> torch.nn.Module:
    """ResNet-18 with random weights: speed does not depend on what it has learnt."""
    torch.manual_seed(0)
    module = resnet18(weights=None).eval().requires_grad_(False)
    return module.to(device=device, memory_format=memory_format)


def bare_step(memory_format: torch.memory_format, device: str) -> Callable[[], None]:
    module = build_network(memory_format, device)
    images = torch.rand(BATCH, 3, IMAGE_PX, IMAGE_PX, device=device).contiguous(memory_format=memory_format)
    wanted = torch.zeros(BATCH, dtype=torch.long, device=device)

    def step() -> None:
        pixels = images.detach().requires_grad_(True)
        loss = torch.nn.functional.cross_entropy(module(pixels), wanted)
        loss.item(), torch.autograd.grad(loss, pixels)

    return step


def toolkit_step(device: str) -> Callable[[], None]:
    """One step of the default recipe: cut, mirror, place, filter, light, paste, network, gradient, move."""
    module = build_network(torch.channels_last, device)
    how = Preprocessing(256, IMAGE_PX, (0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
    weights = WeightsFile(Path("random"), "0" * 64, "random")
    classifier = Classifier("resnet18", module, ["class"] * 1000, how, weights, device, False)
    photos = np.random.default_rng(0).integers(0, 256, (64, 256, 256, 3), np.uint8)
    steps = train_steps(
        draw_first_patch(100, 0),
        0,
        stack_on_device(photos, device),
        [Target(classifier, 0)],
        Appearance(AffineRanges(), on_paper=(LightRanges(),)),
        Descent(steps=10_000, batch=BATCH),
        IMAGE_PX,
    )
    return lambda: next(steps) and None


def run(repeats: int = REPEATS, device: str = "auto") -> dict[str, float]:
    """Images per second of each, and ours over the faster of the bare ones (it may choose its memory format).

    On a GPU the toolkit computes in bfloat16, as it does for its users; the bare step stays in float32.
    """
    device = choose_device(device)
    contenders = {
        "toolkit": toolkit_step(device),
        "bare, channels last": bare_step(torch.channels_last, device),
        "bare, channels first": bare_step(torch.contiguous_format, device),
    }
    seconds: dict[str, list[float]] = {name: [] for name in contenders}
    for turn in range(repeats + 1):
        for name, step in contenders.items():
            start = perf_counter()
            step()
            if device == "cuda":
                torch.cuda.synchronize()
            if turn:  # the first turn warms up
                seconds[name].append(perf_counter() - start)
    rates = {name: BATCH / median(times) for name, times in seconds.items()}
    bare = max(rate for name, rate in rates.items() if name != "toolkit")
    report = {f"{name}: images/s, batch {BATCH}, {device}": rate for name, rate in rates.items()}
    return report | {f"ratio to bare ResNet-18 forward + backward (mark {GOAL:g})": rates["toolkit"] / bare}


if __name__ == "__main__":
    import json

    print(json.dumps(run(), indent=2))
