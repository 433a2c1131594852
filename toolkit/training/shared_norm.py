"""Batch normalisation over the batch of all processes, so that their gradients are those of one process."""

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
        values = images if images.dtype == torch.float64 else images.float()
        count = values.numel() // values.shape[1] * current().count
        mean = _Sum.apply(values.sum((0, 2, 3))) / count
        away = values - mean[:, None, None]
        variance = _Sum.apply(away.square().sum((0, 2, 3))) / count
        if self.running_mean is not None and self.running_var is not None and self.momentum is not None:
            with torch.no_grad():
                if self.num_batches_tracked is not None:
                    self.num_batches_tracked.add_(1)
                self.running_mean.lerp_(mean, self.momentum)
                self.running_var.lerp_(variance * (count / (count - 1)), self.momentum)
        normal = away * (variance + self.eps).rsqrt()[:, None, None]
        if self.affine:
            normal = normal * self.weight[:, None, None] + self.bias[:, None, None]
        return normal.to(images.dtype)


def share_norms(module: nn.Module) -> None:
    """Let every batch normalisation of a network see the whole batch; weights and their names stay."""
    for layer in module.modules():
        if type(layer) is nn.BatchNorm2d and layer.momentum is not None:
            layer.__class__ = SharedBatchNorm
