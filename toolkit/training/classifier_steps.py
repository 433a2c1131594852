"""The steps of a classifier's training, each by its number and the seed alone, and its state on disk."""

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.architectures import build_network
from toolkit.models.precision import autocast
from toolkit.models.weights import WeightsFile, read_state_dict
from toolkit.training.augment import augment_batch, corrupt_some
from toolkit.training.checkpoint import read_arrays, write_arrays
from toolkit.training.classifier_config import ClassifierRequest, Lay, Recipe


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


FORMAT = "toolkit classifier checkpoint 2"
HISTORY = "history"


@dataclass(frozen=True)
class Checkpoint:
    """Where a run stands.

    Attributes:
        inputs_sha256: hash of everything that the run depends on; a run with another hash is another run.
        tensors: what `Fit.state` gave.
        losses, accuracies: one per step made.
    """

    inputs_sha256: str
    tensors: Mapping[str, Any]
    losses: tuple[float, ...]
    accuracies: tuple[float, ...]


def write_checkpoint(file: Path, checkpoint: Checkpoint) -> None:
    """Write it in one rename.

    Raises:
        ToolkitError: the disk is full or read-only.
    """
    history = np.array([checkpoint.losses, checkpoint.accuracies], np.float64)
    arrays = {name: tensor.numpy() for name, tensor in checkpoint.tensors.items()} | {HISTORY: history}
    write_arrays(file, arrays, FORMAT, checkpoint.inputs_sha256, len(checkpoint.losses))


def read_checkpoint(file: Path, inputs_sha256: str) -> Checkpoint | None:
    """Read it, None where there is none.

    Raises:
        ToolkitError: it is damaged, or of other inputs.
    """
    import torch

    arrays = read_arrays(file, {HISTORY}, FORMAT, inputs_sha256)
    if arrays is None:
        return None
    losses, accuracies = (tuple(row) for row in arrays.pop(HISTORY).tolist())
    tensors = {name: torch.from_numpy(np.array(array)) for name, array in arrays.items()}
    return Checkpoint(inputs_sha256, tensors, losses, accuracies)


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
