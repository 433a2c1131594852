"""Weights whose batch normalisation was folded for evaluation, made fit for training again.

Such files hold mean 0 and variance 1 for every layer, and scales that have the true statistics in them. In training a
layer would normalise by its batch, and the network would answer at random; with the layers held still its gradients
are up to a hundred times too large. What was folded can be measured again: the statistics of some training images are
written into the layer, and its scale and offset changed so that it computes what it did before.
"""

from collections.abc import Iterable
from typing import Any


def are_folded(module: Any) -> bool:
    """Whether all batch normalisation of a network has mean 0 and variance 1."""
    norms = _list_norms(module)
    return bool(norms) and all(
        bool((layer.running_mean == 0).all() and ((layer.running_var - 1).abs() <= 2 * layer.eps).all())
        for layer in norms
    )


def unfold_norms(module: Any, batches: Iterable[Any]) -> None:
    """Give batch normalisation the statistics of `batches` (b, 3, h, w); what the network says in eval mode stays."""
    import torch

    norms = _list_norms(module)
    sums = {layer: torch.zeros(2, layer.num_features, dtype=torch.float64) for layer in norms}
    counts = dict.fromkeys(norms, 0)

    def measure(layer: Any, inputs: tuple) -> None:
        values = inputs[0].double()
        counts[layer] += values.numel() // layer.num_features
        sums[layer] += torch.stack([values.sum((0, 2, 3)), values.square().sum((0, 2, 3))]).cpu()

    hooks = [layer.register_forward_pre_hook(measure) for layer in norms]
    with torch.no_grad():
        module.eval()
        for batch in batches:
            module(batch)
        for hook in hooks:
            hook.remove()
        for layer in norms:
            mean, square = (sums[layer] / counts[layer]).to(layer.running_mean.device)
            variance = (square - mean.square()).clamp(min=0)
            slope = layer.weight.double() / (layer.running_var.double() + layer.eps).sqrt()
            layer.bias += slope * (mean - layer.running_mean.double())
            layer.weight.copy_(slope * (variance + layer.eps).sqrt())
            layer.running_mean.copy_(mean)
            layer.running_var.copy_(variance)


def _list_norms(module: Any) -> list[Any]:
    from torch.nn import BatchNorm2d

    return [layer for layer in module.modules() if isinstance(layer, BatchNorm2d) and layer.track_running_stats]
