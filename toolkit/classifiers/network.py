"""A classifier that is ready to use: network, weights, labels and preprocessing in one."""

from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.classifiers.architectures import build_network, imagenet_labels, published_weights
from toolkit.classifiers.find import TIMM_PREFIX, find_classifier
from toolkit.classifiers.labels import (
    LabelsFile,
    choose_labels,
    imagenet_wnids,
    index_of_label,
    index_of_wnid,
    read_labels_file,
)
from toolkit.classifiers.preprocessing import (
    Preprocessing,
    adapt_preprocessing,
    published_preprocessing,
    resize_and_crop,
)
from toolkit.classifiers.weights import WeightsFile, find_weights, read_state_dict
from toolkit.errors import ToolkitError


@dataclass(frozen=True)
class Classifier:
    """A frozen network and all that is needed to feed it and read it.

    Attributes:
        arch: name of the network, see `list_architectures`.
        module: the network, in eval mode, its parameters without gradient.
        labels: name of each output.
        preprocessing: how it wants its images.
        weights: the file that its weights came from.
        device: where it runs, `cpu` or `cuda`.
        is_imagenet: whether the labels are the 1000 of ImageNet.
        name: what to call it in a result: of a classifier of one's own its file's, else the network's.
        trained_on: in a few words, where its record says.
    """

    arch: str
    module: Any
    labels: list[str]
    preprocessing: Preprocessing
    weights: WeightsFile
    device: str
    is_imagenet: bool
    name: str = ""
    trained_on: str = ""

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", self.arch)

    def describe(self) -> str:
        """Which network speaks, on what it was trained, and whose classes it answers with."""
        if self.is_imagenet and not self.trained_on:
            return f"{self.name} (ImageNet's 1000 classes, weights {self.weights.name})"
        trained = (
            f"{self.arch} trained on {self.trained_on}" if self.trained_on else f"{self.arch}, {self.weights.name}"
        )
        if self.is_imagenet:
            return f"{self.name} ({trained}; ImageNet's 1000 classes)"
        return f"{self.name} ({trained}; {len(self.labels)} classes of its own, not ImageNet's)"

    def preprocess(self, image: np.ndarray):
        """(h, w, 3) uint8 sRGB to a (3, crop, crop) float32 tensor, sRGB-encoded in [0, 1], not normalised."""
        import torch

        pixels = np.ascontiguousarray(resize_and_crop(image, self.preprocessing).transpose(2, 0, 1))
        return torch.from_numpy(pixels).float().div(255)

    def logits(self, batch):
        """(b, 3, h, w) float tensor, sRGB-encoded in [0, 1], to (b, classes); normalises inside, differentiable.

        Raises:
            ValueError: the batch has another shape.
        """
        import torch

        if batch.ndim != 4 or batch.shape[1] != 3:
            raise ValueError(f"batch must be Bx3xHxW, got {tuple(batch.shape)}")
        batch = batch.to(self.device)
        mean, std = (
            torch.tensor(values, dtype=batch.dtype, device=batch.device).view(1, 3, 1, 1)
            for values in (self.preprocessing.mean, self.preprocessing.std)
        )
        normalised = (batch - mean) / std
        return self.module(normalised.contiguous(memory_format=torch.channels_last))

    def class_index(self, name: str | int) -> int:
        """Index of a class by name, by index, or for ImageNet by WordNet id.

        Raises:
            ToolkitError: there is no such class (the nearest names are listed), or several share the name.
        """
        if self.is_imagenet and isinstance(name, str) and name in imagenet_wnids():
            return index_of_wnid(name)
        return index_of_label(self.labels, name)


def load_classifier(
    model: str | None = None,
    weights: Path | None = None,
    device: str = "auto",
    quiet: bool = False,
    folder: Path | None = None,
) -> Classifier:
    """Load a classifier: a torchvision network, the bundled `rig18`, or one that `toolkit train-classifier` made.

    The module is stored channels-last: the same numbers to 1e-5, about 1.5 times faster on a CPU.

    Args:
        model: any of `list_architectures`, `timm:NAME` for one of timm's, or the name of a classifier of the
            kit; see `find_classifier`.
        weights: state dict, `.pth` or `.safetensors`; by default see `find_weights`. The number of classes is read from
            it; a `WEIGHTS.json` beside it may name them. Half precision becomes single.
        device: `auto`, `cpu` or `cuda`.
        quiet: no progress bar when downloading.
        folder: of the workspace's own classifiers.

    Raises:
        ToolkitError: unknown network or device, no weights, weights of another network, or other than their record
            says.
    """
    import torch

    found = find_classifier(model, weights, folder)
    if found.arch.startswith(TIMM_PREFIX):
        from toolkit.classifiers.timm_networks import load_timm_network

        return load_timm_network(found.arch, found.weights, device, quiet)
    arch, entry, place = found.arch, published_weights(found.arch), choose_device(device)
    file = find_weights(arch, found.weights, quiet)
    own = read_labels_file(file.path)
    check_hash(file, own)
    state = read_state_dict(file)
    published = entry.meta["categories"]
    num_classes = _count_classes(arch, state, len(published), file)
    module = build_network(arch, num_classes)
    _fill(module, state, arch, file)
    for parameter in module.parameters():
        parameter.requires_grad_(False)
    module = module.eval().to(device=place, memory_format=torch.channels_last)
    labels = choose_labels(file.path, own.labels, published, num_classes)
    preprocessing = adapt_preprocessing(published_preprocessing(entry.transforms()), own)
    is_imagenet = labels == imagenet_labels()
    return Classifier(
        arch, module, labels, preprocessing, file, place, is_imagenet, own.name or arch, own.trained_on or ""
    )


def load_classifiers(
    models: list[str] | None, weights: list[Path] | None, device: str = "auto", quiet: bool = False,
    folder: Path | None = None,
) -> list[Classifier]:  # fmt: skip
    """Several classifiers, at least one; see `load_classifier`.

    Raises:
        ToolkitError: not one file of weights for each network, or as `load_classifier`.
    """
    names: list[str | None] = list(models) if models else [None] * len(weights or [None])
    files: list[Path | None] = list(weights) if weights else [None] * len(names)
    if len(files) != len(names):
        raise ToolkitError(f"{len(names)} --model and {len(files)} --weights: expected one --weights for each --model")
    return [load_classifier(name, file, device, quiet, folder) for name, file in zip(names, files, strict=True)]


def choose_device(device: str) -> str:
    """`auto` to `cuda` where there is one, else `cpu`.

    Raises:
        ToolkitError: the name is unknown, or `cuda` was asked for and this machine has none.
    """
    import torch

    from toolkit.errors import one_of

    if device not in ("auto", "cpu", "cuda"):
        raise one_of("device", device, ["auto", "cpu", "cuda"])
    if device == "cpu":
        return "cpu"
    available = torch.cuda.is_available()
    if device == "cuda" and not available:
        raise ToolkitError("--device cuda: torch sees no CUDA device here: use --device cpu, or mend the driver")
    return "cuda" if available else "cpu"


def check_hash(file: WeightsFile, own: LabelsFile) -> None:
    """A `ToolkitError` where the record beside the weights is of other weights."""
    if own.sha256 is not None and own.sha256 != file.sha256:
        raise ToolkitError(
            f"{file.path}: its hash {file.sha256[:12]} does not match the {own.sha256[:12]} of "
            f"{file.path.with_suffix('.json').name}: the weights were changed or damaged: "
            "restore the pair, or train again"
        )


def _count_classes(arch: str, state: dict[str, Any], published: int, file: WeightsFile) -> int:
    import torch

    with torch.device("meta"):
        expected = build_network(arch, published).state_dict()
    last = [name for name, value in expected.items() if name.endswith(".weight") and value.shape[0] == published][-1]
    if last not in state:
        raise _misfit(arch, file, f"it has no '{last}'")
    return int(state[last].shape[0])


def _fill(module: Any, state: OrderedDict[str, Any], arch: str, file: WeightsFile) -> None:
    import torch

    expected = module.state_dict()
    wrong = [name for name in expected if name in state and state[name].shape != expected[name].shape]
    # batch norm's step counter is absent from old files and plays no part in eval mode
    missing = [name for name in expected if name not in state and not name.endswith("num_batches_tracked")]
    unknown = [name for name in state if name not in expected]
    if wrong:
        shapes = f"{tuple(state[wrong[0]].shape)}, expected {tuple(expected[wrong[0]].shape)}"
        raise _misfit(arch, file, f"'{wrong[0]}' is {shapes}")
    if missing or unknown:
        which = f"it has no '{missing[0]}'" if missing else f"it has '{unknown[0]}', which {arch} has not"
        raise _misfit(arch, file, which)
    if not getattr(state, "_metadata", None):  # safetensors has none: take the file for one of this version
        state._metadata = expected._metadata  # type: ignore[attr-defined]
    module.load_state_dict(state, strict=False)
    if not all(torch.isfinite(value).all() for value in module.state_dict().values()):
        raise ToolkitError(f"{file.path}: some weights are infinite or not a number: the file is damaged or diverged")


def _misfit(arch: str, file: WeightsFile, why: str) -> ToolkitError:
    return ToolkitError(f"{file.path} holds no weights of {arch}: {why}: name its network with --model")
