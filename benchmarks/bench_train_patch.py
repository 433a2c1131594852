"""train-patch against its floor and its peer, same batch, same network, same weights, taken in turns.

The floor is a bare ResNet-18 forward and backward to the input. The peer is ART's `AdversarialPatchPyTorch`.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path
from statistics import median
from time import perf_counter
from unittest.mock import patch

import numpy as np
import torch

from toolkit.boosters.booster import BoosterFiles
from toolkit.boosters.data import TrainingData
from toolkit.boosters.patch import PatchTask
from toolkit.boosters.patch_config import PatchConfig
from toolkit.boosters.pixels import Target
from toolkit.boosters.transforms.placement import AffineRanges
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.network import Classifier, choose_device
from toolkit.models.vision import torchvision
from toolkit.models.weights import WeightsFile
from toolkit.training.loop import make_steps

BATCH, IMAGE_PX, PATCH_PX, PHOTOS = 16, 224, 100, 64
REPEATS, FEWEST, BUDGET_S = 9, 3, 50.0
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
GOAL_BARE, GOAL_ART = 0.9, 1.2
FORMATS = {"channels last": torch.channels_last, "channels first": torch.contiguous_format}


def build_network(memory_format: torch.memory_format, device: str) -> torch.nn.Module:
    """ResNet-18 with random weights, frozen: speed does not depend on what it has learnt."""
    torch.manual_seed(0)
    module = torchvision.models.resnet18(weights=None).eval().requires_grad_(False)
    return module.to(device=device, memory_format=memory_format)


def bare_step(module: torch.nn.Module, memory_format: torch.memory_format, device: str) -> Callable[[], None]:
    images = torch.rand(BATCH, 3, IMAGE_PX, IMAGE_PX, device=device).contiguous(memory_format=memory_format)
    wanted = torch.zeros(BATCH, dtype=torch.long, device=device)

    def step() -> None:
        pixels = images.detach().requires_grad_(True)
        loss = torch.nn.functional.cross_entropy(module(pixels), wanted)
        loss.item(), torch.autograd.grad(loss, pixels)

    return step


def toolkit_step(module: torch.nn.Module, device: str) -> Callable[[], None]:
    """One step of the default recipe: cut, mirror, place, filter, light, paste, network, gradient, move."""
    how = Preprocessing(256, IMAGE_PX, MEAN, STD)
    weights = WeightsFile(Path("random"), "0" * 64, "random")
    classifier = Classifier("resnet18", module, ["class"] * 1000, how, weights, device, False)
    photos = np.random.default_rng(0).integers(0, 256, (PHOTOS, 256, 256, 3), np.uint8)
    data = TrainingData(photos, photos, (), {"sha256": ""}, True)
    files = BoosterFiles(Path("patch.png"), Path("preview.png"), Path("training"))
    config = PatchConfig(size_px=PATCH_PX, steps=10_000, batch=BATCH, start_contrast=1)
    task = PatchTask(config, [Target(classifier, 0)], data, None, files)
    steps = make_steps(task, config.fit_config())
    return lambda: next(steps)


def art_step(module: torch.nn.Module, device: str) -> Callable[[], None]:
    """One step of ART, targeted, with our ranges of turn and size, our learning rate and its sign step.

    `generate` is called once, which sets the attack up and warms it. What is timed is the body of its loop: the next
    batch of the loader that it would make, to the device, and its own `_train_step`. Its setting up, and a loader made
    for each call, are not charged. The network is frozen for it too, which spares it the gradients of the weights.

    Raises:
        ImportError: ART is not installed, or does not run with what is.
    """
    from art.attacks.evasion import AdversarialPatchPyTorch
    from art.estimators.classification import PyTorchClassifier

    estimator = PyTorchClassifier(
        module,
        loss=torch.nn.CrossEntropyLoss(),
        input_shape=(3, IMAGE_PX, IMAGE_PX),
        nb_classes=1000,
        clip_values=(0.0, 1.0),
        preprocessing=(np.array(MEAN, np.float32), np.array(STD, np.float32)),
        device_type="gpu" if device == "cuda" else "cpu",
    )
    ranges = AffineRanges()
    attack = AdversarialPatchPyTorch(
        estimator,
        rotation_max=ranges.rotation_deg[1],
        scale_min=ranges.share[0],
        scale_max=ranges.share[1],
        learning_rate=PatchConfig().lr,
        max_iter=1,
        batch_size=BATCH,
        patch_shape=(3, PATCH_PX, PATCH_PX),
        patch_type="square",
        optimizer="pgd",
        targeted=True,
        verbose=False,
    )
    photos = np.random.default_rng(0).random((PHOTOS, 3, IMAGE_PX, IMAGE_PX), np.float32)
    wanted = np.eye(1000, dtype=np.float32)[np.zeros(PHOTOS, int)]
    attack.generate(photos[:BATCH], wanted[:BATCH])
    data = torch.utils.data.TensorDataset(torch.from_numpy(photos), torch.from_numpy(wanted))
    loader = torch.utils.data.DataLoader(data, batch_size=BATCH, shuffle=True)
    batches = (batch for _ in iter(int, 1) for batch in loader)

    def step() -> None:
        images, target = next(batches)
        attack._train_step(images=images.to(device), target=target.to(device), mask=None)

    return step


def in_float32() -> AbstractContextManager:
    """Have the toolkit compute in float32 where it would choose bfloat16."""
    both = ExitStack()
    both.enter_context(patch("toolkit.models.precision.has_native_bfloat16", return_value=False))
    both.enter_context(patch("torch.cuda.is_bf16_supported", return_value=False))
    return both


def precision_of(module: torch.nn.Module, step: Callable[[], None]) -> str:
    """In which type the network really answers, seen in one step: `bfloat16` or `float32`."""
    seen: list[torch.dtype] = []
    hook = module.register_forward_hook(lambda module, inputs, logits: seen.append(logits.dtype))
    step()
    hook.remove()
    return str(seen[0]).removeprefix("torch.")


def make_contenders(device: str) -> tuple[dict[str, tuple[Callable[[], None], bool]], str]:
    """Steps by name, each with whether it is held in float32; and why ART is missing, empty where it is not."""
    contenders: dict[str, tuple[Callable[[], None], bool]] = {}
    network = build_network(torch.channels_last, device)
    step = toolkit_step(network, device)
    if (chosen := precision_of(network, step)) != "float32":
        contenders[f"toolkit, {chosen}"] = (step, False)
    contenders["toolkit, float32"] = (toolkit_step(network, device), True)
    missing = ""
    for name, memory_format in FORMATS.items():
        network = build_network(memory_format, device)
        contenders[f"bare, float32, {name}"] = (bare_step(network, memory_format, device), False)
    network = build_network(torch.channels_last, device)
    try:
        step = art_step(network, device)
        contenders[f"ART, {precision_of(network, step)}"] = (step, False)
    except ImportError as error:
        missing = f"skipped: {error}: pip install '.[bench]'"
    return contenders, missing


def take_turns(
    contenders: dict[str, tuple[Callable[[], None], bool]], repeats: int, device: str
) -> dict[str, list[float]]:
    """Seconds of each step; the contenders alternate, so that drift of the machine hits all alike.

    A busy machine makes fewer turns, so that the bench stays short.
    """
    began = perf_counter()
    seconds: dict[str, list[float]] = {name: [] for name in contenders}
    for turn in range(repeats + 1):
        if turn > FEWEST and perf_counter() - began > BUDGET_S:
            break
        for name, (step, held) in contenders.items():
            with in_float32() if held else nullcontext():
                start = perf_counter()
                step()
                if device == "cuda":
                    torch.cuda.synchronize()
            if turn:  # the first turn warms up
                seconds[name].append(perf_counter() - start)
    return seconds


def run(repeats: int = REPEATS, device: str = "auto") -> dict[str, float | str]:
    """Images per second of each, and the toolkit's over those of the bare step and of ART.

    The toolkit computes in bfloat16 where it does so for its users, and once more held to float32, which is what the
    bare step and ART compute in. The bare step may choose its memory format: the faster counts; ART has the toolkit's,
    channels last. Ratios are of medians.
    """
    device = choose_device(device)
    contenders, missing = make_contenders(device)
    seconds = take_turns(contenders, repeats, device)
    rates = {name: BATCH / median(times) for name, times in seconds.items()}
    report: dict[str, float | str] = {
        f"{name}: images/s, batch {BATCH}, {device}": rate for name, rate in rates.items()
    }
    peers = [("bare", "bare ResNet-18 forward + backward", GOAL_BARE), ("ART", "ART AdversarialPatchPyTorch", GOAL_ART)]
    for key, peer, goal in peers:
        theirs = [rate for name, rate in rates.items() if name.startswith(key)]
        if not theirs:
            report[f"ratio to {peer}"] = missing
            continue
        for name, rate in rates.items():
            if name.startswith("toolkit"):
                report[f"ratio of {name}, to {peer}, float32 (mark {goal:g})"] = rate / max(theirs)
    return report


if __name__ == "__main__":
    import json

    print(json.dumps(run(), indent=2))
