"""A patch in training without files: what each step left is kept, and nothing is written."""

from pathlib import Path

import torch
from tiny_network import tiny_config

from toolkit.boosters.booster import BoosterFiles
from toolkit.boosters.data import TrainingData
from toolkit.boosters.patch import PatchTask, patch_loss
from toolkit.boosters.patch_config import PatchConfig
from toolkit.boosters.pixels import Target
from toolkit.boosters.transforms.show import Appearance
from toolkit.core.draws import Draws
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.loop import History, fit

NOWHERE = BoosterFiles(Path("/nowhere/p.png"), Path("/nowhere/v.png"), Path("/nowhere"))


class WatchedPatch(PatchTask):
    """`seen` holds θ after each step, `history` their figures."""

    def __init__(
        self, images: torch.Tensor, targets: list[Target], appearance: Appearance | None = None,
        config: PatchConfig | None = None, views=None,
    ) -> None:  # fmt: skip
        pixels = images.permute(0, 2, 3, 1).numpy()
        data = TrainingData(pixels, pixels, (), {"sha256": ""}, True)
        super().__init__(config or tiny_config(), targets, data, views, NOWHERE)
        self._appearance = appearance or self._appearance
        self.seen: list[torch.Tensor] = []
        self.history = History()

    def constrain(self) -> None:
        super().constrain()
        self.seen.append(self.pixels.detach().clone())

    def find_finished(self):
        return None  # nothing is written

    def finish(self, history: History):
        self.history = history


def train_watched(*arguments, checkpoint: Checkpoint | None = None, **options) -> WatchedPatch:
    """Train and look on."""
    task = WatchedPatch(*arguments, **options)
    fit(task, task.config.fit_config(), checkpoint)
    return task


def patch_gradient(
    patch: torch.Tensor, images: torch.Tensor, targets: list[Target], appearance: Appearance, draws: Draws, **options
) -> tuple[torch.Tensor, float, float]:
    """Gradient of the loss by θ, the loss and the share recognised."""
    theta = patch.detach().clone().requires_grad_(True)
    loss, accuracy = patch_loss(theta, images, targets, appearance, draws, **options)
    (gradient,) = torch.autograd.grad(loss, theta)
    return gradient, loss.item(), accuracy
