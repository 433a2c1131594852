"""The training loop: one step per turn of the caller's loop, each by its number and the seed alone."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from toolkit.classifiers.preprocessing import Preprocessing
from toolkit.classifiers.training.augment import augment_batch
from toolkit.classifiers.training.corrupted import corrupt_some
from toolkit.classifiers.training.half_precision import autocast
from toolkit.classifiers.training.norms import unfold_norms
from toolkit.classifiers.training.overlay import Lay
from toolkit.classifiers.training.recipe import Recipe
from toolkit.classifiers.training.start import load_tensors
from toolkit.draws import Draws
from toolkit.errors import ToolkitError

AUXILIARY_WEIGHT = 0.3
"""Of the side outputs that GoogLeNet and Inception have while they are trained."""
UNFOLD_BATCHES = 8


@dataclass(frozen=True)
class Step:
    """After one step.

    Attributes:
        done: how many steps have been made.
        loss: of its batch.
        accuracy: share of its batch recognised.
    """

    done: int
    loss: float
    accuracy: float


class Fit:
    """A network in training, with all that a later run needs to go on with it."""

    def __init__(
        self, module: Any, recipe: Recipe, device: str, how: Preprocessing, precision: str = "float32",
        lay: Lay | None = None,
    ) -> None:  # fmt: skip
        import torch

        self.module = module.to(device=device, memory_format=torch.channels_last)
        self._recipe, self._device, self._image_px, self._precision = recipe, device, how.crop_px, precision
        self._lay = lay
        self._mean, self._std = (torch.tensor(v, device=device).view(1, 3, 1, 1) for v in (how.mean, how.std))
        decayed = [p for p in module.parameters() if p.ndim > 1]
        others = [p for p in module.parameters() if p.ndim <= 1]
        groups = [{"params": decayed, "weight_decay": recipe.weight_decay}, {"params": others, "weight_decay": 0.0}]
        self._optimiser = torch.optim.SGD(groups, lr=recipe.lr, momentum=recipe.momentum, nesterov=True)

    def state(self) -> dict[str, Any]:
        """Tensors of the network, `model.NAME`, and of the momentum, `momentum.NAME`."""
        state = {f"model.{name}": value for name, value in self.module.state_dict().items()}
        for name, parameter in self.module.named_parameters():
            buffer = self._optimiser.state[parameter].get("momentum_buffer")
            if buffer is not None:
                state[f"momentum.{name}"] = buffer
        return {name: value.detach().cpu().contiguous().clone() for name, value in state.items()}

    def load(self, state: Mapping[str, Any]) -> None:
        """Take up what `state` gave."""
        import torch

        model = {name[6:]: value for name, value in state.items() if name.startswith("model.")}
        load_tensors(self.module, model)
        for name, parameter in self.module.named_parameters():
            if (buffer := state.get(f"momentum.{name}")) is not None:
                # in the layout of its parameter: sums in another order would round otherwise
                self._optimiser.state[parameter]["momentum_buffer"] = torch.empty_like(parameter).copy_(buffer)

    def unfold(self, images: np.ndarray, classes: np.ndarray) -> None:
        """Give batch normalisation the statistics of some batches as they are trained on; see `unfold_norms`."""
        unfold_norms(self.module, (self._draw_for(k, images, classes) for k in range(UNFOLD_BATCHES)))

    def run(self, images: np.ndarray, classes: np.ndarray, done: int = 0) -> Iterator[Step]:
        """Make the steps from number `done` to the last.

        Args:
            images: (n, s, s, 3) uint8 sRGB.
            classes: (n,) int64.
            done: how many were made before.

        Raises:
            ToolkitError: the loss is not a finite number.
        """
        import torch

        steps = self._recipe.count_steps(len(images))
        self.module.train()
        with torch.random.fork_rng(enabled=self._device == "cpu"):
            for index in range(done, steps):
                draws = Draws(self._recipe.seed, index, "classifier")
                torch.manual_seed(int(draws.of("dropout").integers(2**62)))
                yield self._step(index, steps, self._choose(index, len(images)), images, classes, draws)

    def _choose(self, index: int, count: int) -> np.ndarray:
        """Numbers of the images of a step: every image once in each epoch's own order."""
        per_epoch = max(count // self._recipe.batch, 1)
        epoch, k = divmod(index, per_epoch)
        order = np.random.default_rng([self._recipe.seed, epoch, 0x0E]).permutation(count)
        return np.sort(order[k * self._recipe.batch : (k + 1) * self._recipe.batch])

    def _step(self, index: int, steps: int, chosen: np.ndarray, images, classes, draws: Draws) -> Step:
        import torch

        batch = self._draw_batch(images[chosen], classes[chosen], draws)
        wanted = torch.from_numpy(classes[chosen]).to(self._device)
        for group in self._optimiser.param_groups:
            group["lr"] = self._recipe.lr_at(index, steps)
        self._optimiser.zero_grad(set_to_none=True)
        with autocast(self._precision, self._device):
            outputs = self.module(batch)
        loss, logits = self._loss(outputs, wanted)
        if not isfinite(loss.item()):
            raise ToolkitError(
                f"the loss at step {index + 1} is not a finite number: train again with --restart and a lower --lr "
                f"than {self._recipe.lr:g}"
            )
        loss.backward()
        self._optimiser.step()
        return Step(index + 1, loss.item(), float((logits.argmax(1) == wanted).float().mean()))

    def _draw_for(self, index: int, images: np.ndarray, classes: np.ndarray) -> Any:
        chosen = self._choose(index, len(images))
        return self._draw_batch(images[chosen], classes[chosen], Draws(self._recipe.seed, index, "unfold"))

    def _draw_batch(self, images: np.ndarray, classes: np.ndarray, draws: Draws) -> Any:
        """What the network is shown: augmented, with its overlay, some corrupted, normalised."""
        import torch

        raw = torch.from_numpy(np.ascontiguousarray(images.transpose(0, 3, 1, 2))).to(self._device)

        def lay(batch: Any) -> Any:
            if self._lay is None:
                return batch
            return self._lay(batch, classes, draws.of("overlay").integers(2**62, size=len(batch)).tolist())

        recipe = self._recipe
        batch = augment_batch(raw, draws.of("augmentation"), self._image_px, recipe.augmentation, lay)
        if recipe.corrupting is not None:
            batch = corrupt_some(batch, draws.of("corruption"), recipe.corrupting)
        return ((batch - self._mean) / self._std).contiguous(memory_format=torch.channels_last)

    def _loss(self, outputs: Any, wanted: Any) -> tuple[Any, Any]:
        """Cross-entropy, with that of side outputs where the network has them; and the main logits."""
        from torch.nn.functional import cross_entropy

        main, *sides = outputs if isinstance(outputs, tuple) else (outputs,)
        smoothing = self._recipe.label_smoothing
        loss = cross_entropy(main.float(), wanted, label_smoothing=smoothing)
        for side in sides:
            if side is not None:
                loss = loss + AUXILIARY_WEIGHT * cross_entropy(side.float(), wanted, label_smoothing=smoothing)
        return loss, main.float()
