"""The network before its first step: random weights by the seed, or those of a file."""

from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

from toolkit.classifiers.architectures import build_network
from toolkit.classifiers.training.request import ClassifierRequest
from toolkit.classifiers.weights import WeightsFile, read_state_dict
from toolkit.errors import ToolkitError


def start_network(request: ClassifierRequest, classes: int, init: WeightsFile | None) -> Any:
    """A network of the request's architecture, its weights drawn by the seed; with `init`, all but the last layer's.

    Raises:
        ToolkitError: the file holds weights of another network.
    """
    import torch

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(request.recipe.seed)
        module = build_network(request.arch, classes)
        _initialise(module, request.arch)
    if init is not None:
        _take_weights(module, request.arch, init)
    return module


def load_tensors(module: Any, tensors: Mapping[str, Any], strict: bool = True) -> None:
    """`load_state_dict` for tensors that have lost torch's notes on the versions of layers, which some need."""
    state = OrderedDict(tensors)
    state._metadata = module.state_dict()._metadata  # type: ignore[attr-defined]
    module.load_state_dict(state, strict=strict)


def _initialise(module: Any, arch: str) -> None:
    """GoogLeNet and Inception are built bare, as they are for loading; here they need a start."""
    from torch import nn

    if arch not in ("googlenet", "inception_v3"):
        return
    for layer in module.modules():
        if isinstance(layer, nn.Conv2d | nn.Linear):
            nn.init.trunc_normal_(layer.weight, std=0.05)


def _take_weights(module: Any, arch: str, init: WeightsFile) -> None:
    own, given = module.state_dict(), read_state_dict(init)
    # side outputs for training only, and batch norm's step counter, may be absent
    needed = [name for name in own if not name.endswith("num_batches_tracked") and not name.lower().startswith("aux")]
    other = [name for name in needed if name not in given or given[name].shape != own[name].shape]
    layers = {name.rpartition(".")[0] for name in other}
    if len(layers) > 1:
        raise ToolkitError(
            f"--init {init.path} holds no weights of {arch}: {len(layers)} layers differ (first: {sorted(layers)[0]}): "
            "name its network with --arch"
        )
    fitting = {name: value for name, value in given.items() if name in own and value.shape == own[name].shape}
    load_tensors(module, fitting, strict=False)
