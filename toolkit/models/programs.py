"""Whole programs as classifiers: ONNX graphs, exported programs, modules that a function of the user's returns."""

import sys
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from copy import deepcopy
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import torch
from pydantic import ValidationError
from torch import nn
from torchvision.transforms._presets import ImageClassification

from toolkit.core.console import notice
from toolkit.core.errors import FieldError, ToolkitError, describe_failure
from toolkit.core.files import explain_validation, sha256_bytes, sha256_file
from toolkit.core.limits import is_memory_full, limit_memory
from toolkit.imaging.preprocessing import Preprocessing, published_preprocessing
from toolkit.models.architectures import imagenet_labels
from toolkit.models.find import EXPORTED_SUFFIX, ONNX_PREFIX
from toolkit.models.labels import (
    PYTHON_PREFIX,
    LabelsFile,
    adapt_preprocessing,
    check_size,
    choose_labels,
    read_labels_file,
)
from toolkit.models.network import Classifier, check_hash, choose_device, describe_answers
from toolkit.models.weights import TRYING_BYTES, WeightsFile, open_weights

DETECTOR_HINT = "a detector? 'toolkit eval' takes those it knows"

FOREIGN = (".onnx", EXPORTED_SUFFIX)
"""Files of programs, perhaps of somebody else's: they run in a bound of memory."""
IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


class LogProbabilities(nn.Module):
    """A network that ends in a softmax, as one that gives logits."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, batch: torch.Tensor) -> torch.Tensor:
        """The logarithms of its probabilities."""
        # softmax(log p) = p; a probability of 0 has no logarithm
        return self.network(batch).clamp_min(torch.finfo(torch.float32).tiny).log()


def load_onnx_classifier(path: Path, device: str) -> Classifier:
    """An ONNX graph that takes images and gives a number for each class; see `read_onnx`.

    Raises:
        ToolkitError: it is none, or ONNX Runtime cannot run it.
    """
    from toolkit.models.onnx_graphs import read_onnx
    from toolkit.models.onnx_networks import OnnxNetwork

    graph, own = read_onnx(path), _read_description(path)
    size = check_size(path, graph.size, own)
    network = OnnxNetwork(graph, size)
    made = _assemble(network, f"{ONNX_PREFIX}{path.name}", graph.file, own, _plain_preprocessing(size), device)
    return replace(made, untrainable=network.untrainable)


def _read_description(path: Path) -> LabelsFile:
    """What the file beside a program says; with a line where it leaves open how images are normalised."""
    own = read_labels_file(path)
    if own.mean is None and own.std is None:
        notice(
            f"{path.name}: no 'mean' and 'std' in a {path.with_suffix('.toml').name} beside it: its images are "
            "normalised by ImageNet's, as published networks' mostly are"
        )
    return own


def load_exported_classifier(path: Path, device: str) -> Classifier:
    """A program of `torch.export` that takes images and gives a number for each class; see `read_exported`.

    Raises:
        ToolkitError: it is none, or holds more than standard operations on tensors.
    """
    from toolkit.models.exported import read_exported

    network, size = read_exported(path)
    own, file = _read_description(path), open_weights(path)
    return _assemble(network, path.name, file, own, _plain_preprocessing(check_size(path, size, own)), device)


def load_python_classifier(model: str, device: str) -> Classifier:
    """What `python:module:function` returns: a module and its preprocessing.

    The preprocessing is a `Preprocessing`, torchvision's `weights.transforms()`, or a mapping with the fields of
    `LabelsFile`, such as `{"size": 224, "mean": …, "std": …, "labels": […]}`. The module is searched as Python does,
    and in the current folder.

    Raises:
        ToolkitError: it cannot be imported or called, or returns something else.
    """
    module_name, _, function_name = model.removeprefix(PYTHON_PREFIX).partition(":")
    if not module_name or not function_name:
        raise FieldError("expected python:MODULE:FUNCTION, such as python:my_networks:bolts", {"model": model})
    here = str(Path.cwd())
    # in front for this import alone, at the path's end afterwards
    sys.path.insert(0, here)
    try:
        module = import_module(module_name)
        made = getattr(module, function_name)()
    except Exception as error:  # any the user's code can raise
        raise FieldError(
            f"{function_name} of {module_name} cannot be called: {describe_failure(error)}", {"model": model}
        ) from None
    finally:
        sys.path.remove(here)
        if here not in sys.path:
            sys.path.append(here)  # workers find it as well
    if not isinstance(made, tuple | list) or len(made) != 2 or not isinstance(made[0], nn.Module):
        found = "a list" if isinstance(made, list) else made.__class__.__name__
        if isinstance(made, tuple | list):
            found += f" of {len(made)}: {', '.join(one.__class__.__name__ for one in made)[:80]}"
        raise FieldError(f"expected a torch.nn.Module and its preprocessing, in a tuple; found {found}",
                         {"model": model})  # fmt: skip
    network, own = made[0], LabelsFile()
    if isinstance(made[1], Preprocessing):
        how = made[1]
    elif isinstance(made[1], ImageClassification):
        how = published_preprocessing(made[1])
    else:
        own = _read_mapping(model, made[1])
        how = _plain_preprocessing(own.crop_px or own.size or 0)
    source = Path(getattr(module, "__file__", None) or f"{module_name}.py")
    network.requires_grad_(False).eval().to("cpu")
    file = WeightsFile(source, _hash_module(network, source), f"{module_name}:{function_name}")
    return _assemble(network, model, file, own, how, device)


def wrap_module(
    module: nn.Module, labels: Sequence[str], size: int = 224, mean: Sequence[float] = IMAGENET_MEAN,
    std: Sequence[float] = IMAGENET_STD, *, name: str = "", device: str = "auto",
) -> Classifier:  # fmt: skip
    """A copy of a PyTorch module in memory as a classifier; the module itself stays as it is.

    Args:
        module: (b, 3, size, size) float images to (b, classes) logits, or probabilities.
        labels: name of each output.
        size: side of the square that it sees, to which an image's central square is resized.
        mean: taken from the sRGB-encoded values in 0 to 1, per channel; by default ImageNet's.
        std: by which they are divided then.
        name: what to call it in results; by default its class.
        device: `auto`, `cpu` or `cuda`.

    Raises:
        ToolkitError: it is no module, a value cannot be used, or it gives something other than one finite number for
            each label and image.
    """
    arch = module.__class__.__name__
    if not isinstance(module, nn.Module):
        raise FieldError("expected a torch.nn.Module", {"module": arch})
    fields = {"labels": list(labels), "size": size, "mean": tuple(mean), "std": tuple(std), "name": name or arch}
    own = _read_mapping(arch, fields)
    network = deepcopy(module).requires_grad_(False).eval().to("cpu")
    file = WeightsFile(Path(arch), _hash_module(network, Path(arch)), f"a {arch} in memory")
    return _assemble(network, arch, file, own, _plain_preprocessing(own.size or 0), device)


def _read_mapping(model: str, given: object) -> LabelsFile:
    expected = "expected as preprocessing a Preprocessing, torchvision's transforms(), or a dict with 'size'"
    if not isinstance(given, Mapping):
        raise FieldError(f"{expected}; found {given.__class__.__name__}", {"model": model})
    try:
        own = LabelsFile.model_validate(dict(given))
    except ValidationError as error:
        raise FieldError(f"its preprocessing: {explain_validation(error)}", {"model": model}) from None
    if own.size is None and own.crop_px is None:
        raise FieldError(f"{expected}; found {', '.join(map(str, given)) or 'an empty dict'}", {"model": model})
    return own


def _hash_module(network: nn.Module, source: Path) -> str:
    # code and weights both: either may change alone
    parts = [sha256_file(source)] if source.is_file() else []
    for name, value in network.state_dict().items():
        content = value.detach().cpu().contiguous().flatten().view(torch.uint8).numpy().tobytes()
        parts.append(f"{name} {value.dtype} {tuple(value.shape)} {sha256_bytes(content)}")
    return sha256_bytes("\n".join(parts).encode())


def _plain_preprocessing(size: int) -> Preprocessing:
    return Preprocessing(size, size, IMAGENET_MEAN, IMAGENET_STD)


def _assemble(
    network: nn.Module, arch: str, file: WeightsFile, own: LabelsFile, how: Preprocessing, device: str
) -> Classifier:
    """Try the network on two images, and join it with its labels.

    Raises:
        ToolkitError: it gives something other than one finite number for each class and image, or its labels are of
            another number of classes.
    """
    check_hash(file, own)
    how, place = adapt_preprocessing(how, own), choose_device(device)
    network = network.to(place)
    answers = _try(network, arch, how, place, is_foreign=file.path.suffix in FOREIGN)
    total = answers.sum(1)
    # rows that sum to 1 are probabilities: their logarithms are logits, but for a constant
    if answers.min() >= 0 and torch.allclose(total, torch.ones_like(total), atol=1e-3):
        network = LogProbabilities(network)
    labels = choose_labels(file.path, own.labels, imagenet_labels(), answers.shape[1])
    return Classifier(
        arch=arch, module=network, labels=labels, preprocessing=how, weights=file, device=place,
        is_imagenet=labels == imagenet_labels(), trained_on=own.trained_on or "",
        name=own.name or (file.path.stem if file.path.suffix != ".py" else arch.rpartition(":")[2]),
    )  # fmt: skip


def _try(network: nn.Module, arch: str, how: Preprocessing, device: str, is_foreign: bool) -> torch.Tensor:
    """(2, classes): what it says to grey and to noise."""
    side = how.crop_px
    noise = torch.rand(1, 3, side, side, generator=torch.Generator().manual_seed(0))
    # about what normalised images are: within 1 of nought
    images = torch.cat([torch.full((1, 3, side, side), 0.5), noise]).sub(0.5).mul(2).to(device)
    room = limit_memory(TRYING_BYTES) if is_foreign and device == "cpu" else nullcontext()
    try:
        with torch.no_grad(), room:
            answers = network(images)
    except ToolkitError:
        raise
    except Exception as error:  # whatever a foreign module raises
        why = describe_failure(error)
        if is_foreign:
            full = f"it takes more than {TRYING_BYTES >> 30} GB"
            why = full if is_memory_full(error) else "its operations do not fit together"
        raise FieldError(f"it fails at two images of {side} px: {why}", {"model": arch}) from None
    if not isinstance(answers, torch.Tensor):
        hint = f" ({DETECTOR_HINT}; here a classifier is expected)" if _has_boxes(answers) else ""
        expected = f"expected one tensor, images × classes{hint}"
        raise FieldError(f"gives {describe_answers(answers)}: {expected}", {"model": arch})
    answers = answers.float().cpu()
    if answers.ndim == 4 and answers.shape[2:] == (1, 1):
        expected = "images × classes: flatten the two last axes"
        raise FieldError(f"gives {describe_answers(answers)}: expected {expected}", {"model": arch})
    if answers.ndim != 2 or len(answers) != 2 or answers.shape[1] < 2:
        hint = f" ({DETECTOR_HINT}; one that ends in features? expected a classifier)" if answers.ndim > 2 else ""
        raise FieldError(f"gives {describe_answers(answers)} for 2 images: expected 2×classes{hint}", {"model": arch})
    if not torch.isfinite(answers).all():
        raise FieldError("gives values that are not a number: its weights are damaged, or it needs other images",
                         {"model": arch})  # fmt: skip
    return answers


def _has_boxes(answers: object) -> bool:
    first = answers[0] if isinstance(answers, tuple | list) and answers else answers
    return isinstance(first, Mapping) and "boxes" in first
