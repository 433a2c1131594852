"""A regression, y = W x + b by least squares, as a task of a few lines: what the loop does not know of."""

from pathlib import Path

import numpy as np
import torch

from toolkit.core.work import Work
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.loop import FitConfig, Fitted, History, TrainingTask, fit

STEPS = 14


class Regressor(TrainingTask[dict[str, np.ndarray]]):
    """Where a drone shall land, (x, y) in metres, from three numbers; it keeps a running mean."""

    work = Work("regressor")
    TRUE = torch.tensor([[1.0, -2.0, 0.5], [0.25, 3.0, -1.0]])

    def __init__(self) -> None:
        generator = torch.Generator().manual_seed(0)
        self.weight = torch.randn(2, 3, generator=generator).requires_grad_(True)
        self.bias = torch.zeros(2, requires_grad=True)
        self.running_mean, self.shown = torch.zeros(2), 0

    def parameters(self):
        return {"weight": self.weight, "bias": self.bias}

    def buffers(self):
        return {"running_mean": self.running_mean}

    def loss(self, step):
        x = torch.from_numpy(np.random.default_rng([7, step]).normal(size=(16, 3))).float()
        away_m = x @ self.weight.T + self.bias - x @ self.TRUE.T
        self.running_mean.mul_(0.9).add_(0.1 * away_m.detach().mean(0))
        return away_m.square().mean() + 0 * self.running_mean.sum(), {
            "error_m": float(away_m.detach().norm(dim=1).mean())
        }

    def show(self):
        self.shown += 1

    def finish(self, history: History):
        tensors = {**self.parameters(), **self.buffers()}
        return {name: value.detach().numpy().copy() for name, value in tensors.items()} | {
            name: np.array(values) for name, values in history.figures.items()
        }


CONFIG = FitConfig(steps=STEPS, lr=0.05, schedule="one-cycle", momentum=0.9, weight_decay=1e-3)


def train_regressor(folder: Path, task: Regressor | None = None, restart: bool = False) -> Fitted:
    return fit(task or Regressor(), CONFIG, Checkpoint(folder, "ab" * 32, restart, every_s=0))
