"""A classifier that is ready to use: network, weights, labels and preprocessing together."""

import copy
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from toolkit.core.errors import FieldError, ToolkitError, describe_failure, one_of
from toolkit.core.lazy import torch
from toolkit.core.text import join_words
from toolkit.imaging.preprocessing import Preprocessing, resize_and_crop
from toolkit.models.labels import (
    BESIDE_FILE,
    FROM_FUNCTION,
    PYTHON_PREFIX,
    LabelsFile,
    imagenet_wnids,
    index_of_label,
    index_of_wnid,
    join_labels_files,
    plain_name,
    read_labels_file,
)
from toolkit.models.weights import WeightsFile, read_checkpoint


class AnyNetwork(Protocol):
    """The attributes of every network, a `Classifier` or a detector."""

    @property
    def name(self) -> str:
        """Name in results."""

    @property
    def arch(self) -> str:
        """Name of its architecture."""

    @property
    def labels(self) -> list[str]:
        """Name of each class."""

    @property
    def weights(self) -> WeightsFile:
        """File of its weights."""

    @property
    def device(self) -> str:
        """`cpu` or `cuda`."""

    @property
    def untrainable(self) -> str:
        """Why no gradient leads back to the image; empty if it does."""


class BadAnswer(FieldError):
    """A network's answer to a batch that cannot be used; `row` is that of the image, None: of any."""

    def __init__(self, reason: str, arch: str, row: int | None = None) -> None:
        """Name the network `arch` and the reason."""
        super().__init__(reason, {"model": arch})
        self.row = row

    def at(self, names: Sequence[str]) -> FieldError:
        """Return the error with the image's name; copies of the last image may follow those in `names`."""
        where = names[min(self.row or 0, len(names) - 1)]
        if self.row is None and len(names) > 1:
            where += f" or the {len(names) - 1} images after it"
        return FieldError(f"{self.expected} (at {where})", self.found)


def blame_model(arch: str, what: str, longest: int = 200) -> Callable[[Exception], FieldError]:
    """Return the function that makes other code's exception a `FieldError` of the model, for `foreign_code`."""
    return lambda error: FieldError(f"{what}: {describe_failure(error, longest)}", {"model": arch})


def check_finite(answers: "torch.Tensor", arch: str, weights: WeightsFile) -> None:
    """Raise `BadAnswer` for the first of (b, classes) answers whose best is not finite; -∞ excludes a class alone."""
    is_bad = ~torch.isfinite(answers.amax(1))
    if is_bad.any():
        reason = f"{weights.name}: the network's output is not a number: its weights are damaged"
        raise BadAnswer(reason, arch, int(is_bad.nonzero()[0, 0]))


def describe_answers(answers: object) -> str:
    """Describe a network's output: `2×1000`, `a list of 3`."""
    shape = getattr(answers, "shape", None)
    if shape is not None:
        return "×".join(map(str, shape)) or "a single number"
    return f"a {answers.__class__.__name__}" + (f" of {len(answers)}" if isinstance(answers, tuple | list) else "")


@dataclass(frozen=True)
class Classifier:
    """A frozen network with its labels and preprocessing.

    Attributes:
        arch: name of the network, see `list_architectures`.
        module: the network, in eval mode, its parameters without gradient.
        labels: name of each output.
        preprocessing: resize, crop and normalisation of its images.
        weights: the file that its weights came from.
        device: `cpu` or `cuda`.
        is_imagenet: whether the labels are the 1000 of ImageNet.
        name: name in results; by default `arch`.
        trained_on: training data in a few words, from its record.
        untrainable: why no gradient leads back to the image, so that nothing can be trained against it; else empty.
        notes: remarks for a reader of its results, a sentence each.
        turns: training steps of a round that use it, if several networks train by turns.
    """

    arch: str
    module: "torch.nn.Module"
    labels: list[str]
    preprocessing: Preprocessing
    weights: WeightsFile
    device: str
    is_imagenet: bool
    name: str = ""
    trained_on: str = ""
    untrainable: str = ""
    notes: tuple[str, ...] = ()
    turns: int = 1

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", self.arch)

    def describe(self) -> str:
        """Name the network, its training data and its classes."""
        if self.is_imagenet and not self.trained_on:
            return f"{self.name} (ImageNet's 1000 classes, weights {self.weights.name})"
        trained = f" trained on {self.trained_on}" if self.trained_on else f", {self.weights.name}"
        classes = "ImageNet's 1000 classes" if self.is_imagenet else f"{len(self.labels)} classes, not ImageNet's"
        return f"{self.name} ({self.arch}{trained}; {classes})"

    def preprocess(self, image: np.ndarray) -> "torch.Tensor":
        """Resize and crop (h, w, 3) uint8 sRGB to (3, crop, crop) float32, sRGB-encoded in [0, 1]."""
        pixels = np.ascontiguousarray(resize_and_crop(image, self.preprocessing).transpose(2, 0, 1))
        return torch.from_numpy(pixels).float().div(255)

    def logits(self, batch: "torch.Tensor") -> "torch.Tensor":
        """(b, 3, h, w) float tensor, sRGB-encoded in [0, 1], to (b, classes); normalises inside, differentiable.

        Raises:
            ValueError: the batch has another shape.
            BadAnswer: the network gives something else, or code of the user's fails.
        """
        if batch.ndim != 4 or batch.shape[1] != 3:
            raise ValueError(f"batch must be Bx3xHxW, got {tuple(batch.shape)}")
        batch = batch.to(self.device)
        # `mean` and `std` are in the network's own order, so the flip comes first
        if self.preprocessing.channels == "BGR":
            batch = batch.flip(1)
        mean, std = (
            torch.tensor(values, dtype=batch.dtype, device=batch.device).view(1, 3, 1, 1)
            for values in (self.preprocessing.mean, self.preprocessing.std)
        )
        normalised = (batch - mean).div_(std)
        # convolutions are about 1.5 times as fast with the channels last
        if not getattr(self.module, "takes_planes", False):
            normalised = normalised.contiguous(memory_format=torch.channels_last)
        answers = self._ask(normalised)
        wanted = (len(batch), len(self.labels))
        if not isinstance(answers, torch.Tensor) or answers.shape != wanted:
            expected = "×".join(map(str, wanted))
            raise BadAnswer(
                f"gives {describe_answers(answers)} for {len(batch)} images: expected {expected}", self.arch
            )
        return answers

    def _ask(self, batch: "torch.Tensor") -> object:
        try:
            return self.module(batch)
        except (ToolkitError, MemoryError, torch.OutOfMemoryError, KeyboardInterrupt):
            raise
        except BaseException as error:  # whatever the user's code raises
            if not self.arch.startswith(PYTHON_PREFIX):
                raise
            why = describe_failure(error)
            raise BadAnswer(f"fails at {len(batch)} images of {batch.shape[-1]} px: {why}", self.arch) from None

    def class_index(self, name: str | int) -> int:
        """Index of a class by name, by index, or for ImageNet by WordNet id.

        Raises:
            ToolkitError: there is no such class (the nearest names are listed), or several share the name.
        """
        remedy = FROM_FUNCTION if self.arch.startswith(PYTHON_PREFIX) else BESIDE_FILE
        if self.is_imagenet and isinstance(name, str) and name in imagenet_wnids():
            return index_of_wnid(name)
        return index_of_label(self.labels, name, remedy)


ROUNDING = 1e-4
"""Share of the largest answer by which answers of a folded network may differ."""


def fold_normalisation(network: Classifier) -> Classifier:
    """Return a copy with each batch normalisation folded into the convolution before it: faster, in less memory.

    Hooks of a single pass show which normalisation follows which convolution. The network itself is returned if there
    is nothing to fold, or if the copy's answers to a random image differ.
    """
    from torch.nn.utils.fusion import fuse_conv_bn_eval

    module = copy.deepcopy(network.module)
    names, made = {layer: name for name, layer in module.named_modules()}, dict[int, tuple[Any, torch.Tensor]]()
    asked, pairs = Counter[torch.nn.Module](), list[tuple[torch.nn.Conv2d, torch.nn.BatchNorm2d]]()

    def watch(layer: torch.nn.Module, given: tuple[torch.Tensor, ...], answer: torch.Tensor) -> None:
        asked[layer] += 1
        if isinstance(layer, torch.nn.Conv2d):
            made[id(answer)] = layer, answer  # kept, so that no other gets its number
        elif isinstance(layer, torch.nn.BatchNorm2d) and id(given[0]) in made:
            pairs.append((made[id(given[0])][0], layer))

    kinds = torch.nn.Conv2d | torch.nn.BatchNorm2d
    hooks = [layer.register_forward_hook(watch) for layer in names if isinstance(layer, kinds)]
    # a first pass shows which layers follow each other, and what the network answers
    side = network.preprocessing.crop_px
    of = next((parameter.dtype for parameter in module.parameters()), torch.float32)
    image = torch.rand(1, 3, side, side, generator=torch.Generator().manual_seed(0)).to(network.device, of)
    folded = replace(network, module=module)
    with torch.no_grad():
        wanted = folded.logits(image)
        for hook in hooks:
            hook.remove()
        # a layer that runs twice may serve other layers too
        for layer, norm in pairs:
            if asked[layer] > 1 or asked[norm] > 1 or norm.running_mean is None or norm.training:
                continue
            whole = fuse_conv_bn_eval(layer, norm)
            layer.weight, layer.bias = whole.weight, whole.bias
            # timm's normalisations hold the layers that follow them
            rest = [part for part in (getattr(norm, "drop", None), getattr(norm, "act", None)) if part is not None]
            above, _, name = names[norm].rpartition(".")
            setattr(module.get_submodule(above), name, torch.nn.Sequential(*rest))
        # the copy serves only if it answers as the network does
        module.requires_grad_(False).to(memory_format=torch.channels_last)
        is_same = bool(pairs) and (folded.logits(image) - wanted).abs().max() <= ROUNDING * wanted.abs().max()
    return folded if is_same else network


def choose_device(device: str) -> str:
    """Return `cpu` or `cuda`; `auto` means `cuda` if there is a GPU.

    Raises:
        ToolkitError: the name is unknown, or this machine has no GPU for `cuda`.
    """
    if device not in ("auto", "cpu", "cuda"):
        raise one_of("device", device, ["auto", "cpu", "cuda"])
    if device == "cpu":
        return "cpu"
    available = torch.cuda.is_available()
    if device == "cuda" and not available:
        raise FieldError("torch sees no CUDA device here: use the cpu, or repair the driver", {"device": "cuda"})
    if not available:
        return "cpu"
    # else cuDNN rounds the factors of convolutions to 10 bits, and answers would differ from a CPU's
    torch.backends.cudnn.allow_tf32 = False
    return "cuda"


def check_hash(file: WeightsFile, own: LabelsFile) -> None:
    """Raise a `ToolkitError` if the record beside the weights is of other weights."""
    if own.sha256 is not None and own.sha256 != file.sha256:
        raise ToolkitError(
            f"{file.path}: its hash {file.sha256[:12]} does not match the {own.sha256[:12]} of "
            f"{file.path.with_suffix('.json').name}: the weights changed: restore the pair, or train again"
        )


def match_classes(names: Sequence[str], classifier: Classifier, root: Path, field: str = "model") -> dict[str, int]:
    """Return the class index of each folder's name: a WordNet id, or a label in any case, with `_` or `-` for spaces.

    Raises:
        ToolkitError: a name is not a class, or two folders are of the same class.
    """
    # several classes of ImageNet share a name
    by_name: dict[str, list[int]] = {}
    for index, label in enumerate(classifier.labels):
        by_name.setdefault(plain_name(label), []).append(index)
    # folders of ImageNet are often named by WordNet ids
    if classifier.is_imagenet:
        by_name |= {wnid: [index] for index, wnid in enumerate(imagenet_wnids())}
    unknown = [name for name in names if plain_name(name) not in by_name]
    if unknown:
        more = f" ({len(unknown)} of {len(names)} folders)" if len(unknown) > 1 else ""
        raise FieldError(
            f"{root / unknown[0]}: '{unknown[0]}' is not a class of {classifier.describe()}{more}: name the classifier "
            f"of this data with {{{field}}}, or rename the folder",
            {},
        )
    index_of = {}
    for name in names:
        indices = by_name[plain_name(name)]
        exact = [index for index in indices if classifier.labels[index] == name]
        indices = exact if len(exact) == 1 else indices  # ImageNet has a dog 'Cardigan' and a jacket 'cardigan'
        if len(indices) > 1:
            raise ToolkitError(
                f"{root / name}: {len(indices)} classes are called '{name}' ({', '.join(map(str, indices))}): call the "
                "folder by its WordNet id"
            )
        index_of[name] = indices[0]
    # two folders of a class would be counted apart
    for name in names:
        same = [other for other in names if index_of[other] == index_of[name]]
        if len(same) > 1:
            raise ToolkitError(f"{root}: {join_words(same)} are the same class: join the folders")
    return index_of


def read_network_file(file: WeightsFile) -> "tuple[OrderedDict[str, torch.Tensor], LabelsFile]":
    """Read parameters by name, and the description beside the weights, completed by the weights' file.

    Raises:
        ToolkitError: as `read_checkpoint` and `join_labels_files`; the record is of other weights.
    """
    own = read_labels_file(file.path)
    check_hash(file, own)
    state, inside = read_checkpoint(file)
    return state, join_labels_files(own, inside, file.path)


def check_numbers(values: "Iterable[torch.Tensor]", file: WeightsFile) -> None:
    """Raise a `ToolkitError` if a weight is infinite or not a number."""
    if not all(value.isfinite().all() for value in values):
        raise ToolkitError(f"{file.path}: some weights are infinite or not a number: the file is damaged or diverged")
