"""Load a classifier by name: of torchvision or timm, the bundled `rig18`, the user's own, a program or a function."""

from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import read_json, sha256_file
from toolkit.imaging.preprocessing import published_preprocessing
from toolkit.models.architectures import build_network, imagenet_labels, published_weights
from toolkit.models.find import (
    BUNDLED,
    BUNDLED_DIR,
    DEFAULT_ARCH,
    ONNX_PREFIX,
    SUFFIX,
    TIMM_PREFIX,
    ClassifierRecord,
    Found,
    find_classifier,
    is_program,
    pair_weights,
)
from toolkit.models.labels import adapt_preprocessing, choose_labels
from toolkit.models.network import Classifier, check_numbers, choose_device, read_network_file
from toolkit.models.weights import WeightsFile, download, find_local, find_weights

if TYPE_CHECKING:
    from collections.abc import Mapping

    import torch


def load_classifier(
    model: str | None = None, weights: Path | None = None, device: str = "auto", folder: Path | None = None
) -> Classifier:
    """Load a classifier: a network by name, one that `toolkit train-classifier` made, a program, a function's.

    The module is stored channels-last: the same numbers to 1e-5, about 1.5 times faster on a CPU.

    Args:
        model: any of `list_architectures`, also as `torchvision:NAME`; `timm:NAME`; the name of a classifier of the
            kit; `onnx:FILE`; a `.pt2` of torch.export; `python:MODULE:FUNCTION`; the file of a state dict; see
            `find_classifier`.
        weights: state dict, `.pth`, `.ckpt` or `.safetensors`; by default see `find_weights`. The number of classes is
            read from it; a `WEIGHTS.json` beside it may name them. Half precision becomes single.
        device: `auto`, `cpu` or `cuda`.
        folder: of the workspace's own classifiers.

    Raises:
        ToolkitError: unknown network or device, no weights, weights of another network, or other than their record
            says.
    """
    import torch

    if not isinstance(model, str | None):
        how = "a module of your own becomes one by wrap_module(module, labels, size, mean, std)"
        raise FieldError(f"expected the name of a network; {how}", {"model": model.__class__.__name__})
    found = find_classifier(model, weights, folder)
    if (elsewhere := _load_elsewhere(found, device)) is not None:
        return elsewhere
    arch, entry, place = found.arch, published_weights(found.arch), choose_device(device)
    file = find_weights(arch, found.weights)
    state, own = read_network_file(file)
    published = entry.meta["categories"]
    num_classes = _count_classes(arch, state, len(published), file)
    module = build_network(arch, num_classes)
    _fill(module, state, arch, file)
    module = module.requires_grad_(False).eval().to(memory_format=torch.channels_last).to(place)
    labels = choose_labels(file.path, own.labels, published, num_classes)
    preprocessing = adapt_preprocessing(published_preprocessing(entry.transforms()), own)
    is_imagenet = labels == imagenet_labels()
    return Classifier(
        arch=arch, module=module, labels=labels, preprocessing=preprocessing, weights=file, device=place,
        is_imagenet=is_imagenet, name=own.name or arch, trained_on=own.trained_on or "",
    )  # fmt: skip


def _load_elsewhere(found: Found, device: str) -> Classifier | None:
    """A network that is none of torchvision's."""
    if found.arch.startswith(TIMM_PREFIX):
        from toolkit.models.timm_networks import load_timm_network

        return load_timm_network(found.arch, found.weights, device)
    if not is_program(found.arch):
        return None
    from toolkit.models import programs

    if found.weights is None:
        return programs.load_python_classifier(found.arch, device)
    load = programs.load_onnx_classifier if found.arch.startswith(ONNX_PREFIX) else programs.load_exported_classifier
    return load(found.weights, device)


def load_classifiers(
    models: Sequence[str] | None, weights: Sequence[Path] | None, device: str = "auto", folder: Path | None = None
) -> list[Classifier]:
    """Several classifiers, at least one; see `load_classifier`.

    Raises:
        ToolkitError: as `pair_weights` and `load_classifier`.
    """
    return [load_classifier(name, file, device, folder) for name, file in pair_weights(models, weights, folder)]


def _count_classes(arch: str, state: "Mapping[str, torch.Tensor]", published: int, file: WeightsFile) -> int:
    import torch

    # on the meta device a network has shapes and no numbers: nothing is allocated
    with torch.device("meta"):
        expected = build_network(arch, published).state_dict()
    # the last weight with as many rows as there are classes is the classifier's head
    last = [name for name, value in expected.items() if name.endswith(".weight") and value.shape[0] == published][-1]
    if last not in state:
        raise _misfit(arch, file, f"it has no '{last}'")
    if state[last].ndim == 0:
        raise _misfit(arch, file, f"'{last}' is a single number")
    return int(state[last].shape[0])


def _fill(module: "torch.nn.Module", state: "OrderedDict[str, torch.Tensor]", arch: str, file: WeightsFile) -> None:
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
    check_numbers(module.state_dict().values(), file)


def _misfit(arch: str, file: WeightsFile, why: str) -> ToolkitError:
    return FieldError(f"{file.path} holds no weights of {arch}: {why}: name its network with {{model}}", {})


PATIENCE_S = 5.0
"""How long the network is waited for where there is something else to go on with."""


def bundled_file() -> Path | None:
    """The weights of `rig18`; None where they are not installed."""
    file = BUNDLED_DIR / f"{BUNDLED}{SUFFIX}"
    return file if file.is_file() else None


def read_bundled() -> ClassifierRecord | None:
    """The record of `rig18`, checked against its weights; None where they are not installed.

    Raises:
        ToolkitError: the record is broken, or is of other weights.
    """
    file = bundled_file()
    if file is None:
        return None
    record = read_json(file.with_suffix(".json"), ClassifierRecord)
    if sha256_file(file) != record.sha256:
        raise ToolkitError(f"{file} does not match its record: it was changed or damaged")
    return record


def load_best(device: str) -> tuple[Classifier, str]:
    """ImageNet's ResNet-18 where it can be had, else the bundled classifier; and why, in a sentence.

    Local weights are looked for first, then torchvision's download is tried, shortly.

    Raises:
        ToolkitError: the weights cannot be had and there is no bundled classifier, or a file is damaged.
    """
    if find_local(DEFAULT_ARCH) is not None:
        return load_classifier(DEFAULT_ARCH, device=device), "its weights are on this machine"
    if bundled_file() is None:
        return load_classifier(DEFAULT_ARCH, device=device), "its weights were downloaded"
    try:
        download(DEFAULT_ARCH, str(published_weights(DEFAULT_ARCH).url), PATIENCE_S)
    except ToolkitError:
        why = f"no weights of {DEFAULT_ARCH} on this machine, and none could be downloaded"
        return load_classifier(BUNDLED, device=device), why
    return load_classifier(DEFAULT_ARCH, device=device), "its weights were downloaded"
