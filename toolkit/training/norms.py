"""Batch normalisation: over the batch of all processes, as if they were one; and unfolded for training again."""

from collections.abc import Iterable

import torch
from torch import nn

from toolkit.training.processes import current


class _Sum(torch.autograd.Function):
    """Over all processes, of whose losses each holds a part: the gradients of a sum are summed as well."""

    @staticmethod
    def forward(ctx: object, tensor: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        return current().add(tensor)

    @staticmethod
    def backward(ctx: object, gradient: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        return current().add(gradient)


class SharedBatchNorm(nn.BatchNorm2d):
    """As `BatchNorm2d`, with the statistics of all processes' shares; torch's `SyncBatchNorm` takes GPUs alone."""

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(b, c, h, w) to the same shape; every process has as many images of one size."""
        if not self.training or current().count == 1:
            return super().forward(images)
        # sums of many squares lose too much in half precision
        values = images if images.dtype == torch.float64 else images.float()
        count = values.numel() // values.shape[1] * current().count
        mean = _Sum.apply(values.sum((0, 2, 3))) / count
        # in two passes: the mean of squares less the square of the mean would cancel
        away = values - mean[:, None, None]
        variance = _Sum.apply(away.square().sum((0, 2, 3))) / count
        if self.running_mean is not None and self.running_var is not None and self.momentum is not None:
            with torch.no_grad():
                if self.num_batches_tracked is not None:
                    self.num_batches_tracked.add_(1)
                self.running_mean.lerp_(mean, self.momentum)
                # the running variance is the unbiased one, as torch's own
                self.running_var.lerp_(variance * (count / (count - 1)), self.momentum)
        normal = away * (variance + self.eps).rsqrt()[:, None, None]
        if self.affine:
            normal = normal * self.weight[:, None, None] + self.bias[:, None, None]
        return normal.to(images.dtype)


def share_norms(module: nn.Module) -> None:
    """Let every batch normalisation of a network see the whole batch; weights and their names stay."""
    for layer in module.modules():
        # without momentum torch averages over all batches so far, which is not what is shared here
        if type(layer) is nn.BatchNorm2d and layer.momentum is not None:
            # the class alone: weights, names and hooks stay where they are
            layer.__class__ = SharedBatchNorm


def are_folded(module: nn.Module) -> bool:
    """Whether all batch normalisation of a network has mean 0 and variance 1."""
    norms = _list_norms(module)
    return bool(norms) and all(
        # 1 - eps is folded as well: it makes √(variance + eps) one
        bool((mean == 0).all() and ((variance - 1).abs() <= 2 * layer.eps).all())
        for layer, (mean, variance) in zip(norms, map(_running, norms), strict=True)
    )


def unfold_norms(module: nn.Module, batches: Iterable[torch.Tensor]) -> None:
    """Give batch normalisation the statistics of `batches` (b, 3, h, w); what the network says in eval mode stays."""
    norms = _list_norms(module)
    # double precision, on the CPU: sums over millions of values
    sums = {layer: torch.zeros(2, layer.num_features, dtype=torch.float64) for layer in norms}
    counts = dict.fromkeys(norms, 0)

    def measure(layer: nn.BatchNorm2d, inputs: tuple[torch.Tensor, ...]) -> None:
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
            running_mean, running_var = _running(layer)
            mean, square = (sums[layer] / counts[layer]).to(running_mean.device)
            # rounding may leave a variance a little below 0
            variance = (square - mean.square()).clamp(min=0)
            # the layer's line through old statistics, written with the new ones: slope · x + offset stays the same
            slope = layer.weight.double() / (running_var.double() + layer.eps).sqrt()
            layer.bias.add_(slope * (mean - running_mean.double()))
            layer.weight.copy_(slope * (variance + layer.eps).sqrt())
            running_mean.copy_(mean)
            running_var.copy_(variance)


def _running(layer: nn.BatchNorm2d) -> tuple[torch.Tensor, torch.Tensor]:
    """Mean and variance of a layer that `_list_norms` found."""
    assert layer.running_mean is not None and layer.running_var is not None
    return layer.running_mean, layer.running_var


def _list_norms(module: nn.Module) -> list[nn.BatchNorm2d]:
    return [layer for layer in module.modules() if isinstance(layer, nn.BatchNorm2d) and layer.track_running_stats]
