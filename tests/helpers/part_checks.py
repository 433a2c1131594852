"""What is asked of every random part: its gradient is that of finite differences, and its probability is kept."""

from collections.abc import Callable

import numpy as np
import torch


def check_gradient(function: Callable[[torch.Tensor], torch.Tensor], at: torch.Tensor) -> None:
    """Autograd against central differences of every input, in double precision.

    The outputs are weighed together in eight random ways: a wrong entry anywhere shows, and eight backward passes do
    instead of one for each output. A function that ignores its input would not pass.
    """
    at, step = at.double().clone().requires_grad_(True), 1e-6
    out = function(at)
    weights = torch.from_numpy(np.random.default_rng(17).normal(size=(8, out.numel())))
    gradients = torch.stack([torch.autograd.grad(out, at, w.view_as(out), retain_graph=True)[0] for w in weights])
    measured = torch.empty_like(gradients).flatten(1)
    with torch.no_grad():
        for index in range(at.numel()):
            moved = at.detach().clone()
            moved.view(-1)[index] += step
            higher = function(moved).flatten()
            moved.view(-1)[index] -= 2 * step
            measured[:, index] = weights @ (higher - function(moved).flatten()) / (2 * step)
    torch.testing.assert_close(gradients.flatten(1), measured, atol=1e-6, rtol=1e-4)
    (gradient,) = torch.autograd.grad(function(at).sum(), at)
    assert gradient.abs().max() > 1e-3


def count_changed(change: Callable[[torch.Tensor, np.random.Generator], torch.Tensor], images: torch.Tensor) -> int:
    """How many images a part changes; those that it leaves are left bit for bit, which `torch.equal` asks."""
    changed = change(images, np.random.default_rng(3))
    assert changed.shape == images.shape
    return sum(not torch.equal(before, after) for before, after in zip(images, changed, strict=True))


def grey_noise(*shape: int, seed: int = 0) -> torch.Tensor:
    """Values away from 0 and 1, where nothing is clamped."""
    return torch.from_numpy(np.random.default_rng(seed).uniform(0.25, 0.75, shape))
