"""Training of pixels in [0, 1] that networks shall recognise as a class: the base of patch, texture and wrap."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Protocol

import numpy as np
import torch
from torch.nn.functional import cross_entropy, interpolate

from toolkit.boosters.pixel_config import PixelConfig
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.find import is_program
from toolkit.models.identity import hash_network_tensors
from toolkit.models.network import Classifier, fold_normalisation
from toolkit.models.precision import mixed_precision
from toolkit.models.predict import CPU_PART, LogitNetwork, predict
from toolkit.objects import records
from toolkit.training.loop import Made, TrainingTask
from toolkit.training.processes import current


class Network(LogitNetwork, Protocol):
    """A classifier as boosters use it, such as `toolkit.models.network.Classifier`."""

    @property
    def preprocessing(self) -> Preprocessing:
        """How it wants its images."""

    @property
    def is_imagenet(self) -> bool:
        """Whether the labels are the 1000 of ImageNet."""

    def class_index(self, name: str | int) -> int:
        """Index of a class by label, index or WordNet id."""


@dataclass(frozen=True)
class Target:
    """A network and the class that it shall see.

    Attributes:
        classifier: the network.
        class_index: in that network's own labels.
    """

    classifier: Network
    class_index: int

    @property
    def label(self) -> str:
        """Label of the class."""
        return self.classifier.labels[self.class_index]

    @property
    def turns(self) -> int:
        """Training steps of a round that use the network, see `choose_turn`."""
        return getattr(self.classifier, "turns", 1)

    def logits(self, photos: torch.Tensor) -> torch.Tensor:
        """(b, classes) of (b, 3, m, m) sRGB-encoded photographs, resized to the network's side; differentiable."""
        # the photographs may be made for another network of the ensemble
        return self.classifier.logits(resize_photos(photos, self.classifier.preprocessing.crop_px))

    @cached_property
    def folded(self) -> "Target":
        """The same, whose gradients cost less: a classifier's normalisations are in its convolutions."""
        network = self.classifier
        if not isinstance(network, Classifier) or is_program(network.arch):
            return self
        return replace(self, classifier=fold_normalisation(network))

    def predict(self, photos: torch.Tensor) -> torch.Tensor:
        """(b, classes) float64 on the CPU of (b, 3, m, m) photographs, without gradient, see `predict`."""
        return predict(resize_photos(photos, self.classifier.preprocessing.crop_px), self.classifier)

    def find_hits(self, photos: torch.Tensor) -> torch.Tensor:
        """(b,) bool, on the CPU: which (b, 3, m, m) sRGB-encoded photographs the network recognises as the class."""
        return self.predict(photos).argmax(1) == self.class_index

    def count_hits(self, photos: torch.Tensor) -> int:
        """How many of (b, 3, m, m) sRGB-encoded photographs the network recognises as the class."""
        return int(self.find_hits(photos).sum())


def resize_photos(photos: torch.Tensor, side: int) -> torch.Tensor:
    """(b, 3, m, m) photographs at another side; differentiable."""
    if photos.shape[-1] == side:
        return photos
    return interpolate(photos, (side, side), mode="bilinear", antialias=True, align_corners=False)


class PixelTask(TrainingTask[Made]):
    """Training of θ, (3, n, n) in [0, 1]; a subclass says what the networks are shown.

    The gradient is smoothed. For `sgd` and `adam` it is divided by its root mean square over the texels that are seen,
    so that the learning rate means the same as for `sign`.
    """

    advice = "the network's weights do not fit its images; check {model} and {weights}"

    def __init__(self, config: PixelConfig, size_px: int, targets: list[Target], optimiser: str = "sign") -> None:
        """Begin with random pixels.

        Args:
            config: how θ is moved.
            size_px: n.
            targets: the networks; θ is trained on the device of the first.
            optimiser: by which rule.
        """
        # random pixels, so that no picture is preferred
        first = draw_first_pixels(size_px, config.seed, config.start_contrast)
        self.batch = config.batch
        self.targets, self.image_px = targets, targets[0].classifier.preprocessing.crop_px
        self.pixels = first.to(targets[0].classifier.device).requires_grad_(True)
        self._smoothing_px, self._steps, self._is_signed = config.smoothing_px, config.step_count, optimiser == "sign"
        self._last_smoothing_px, self._momentum = config.last_smoothing_px, config.momentum
        self._velocity = None if not config.momentum else torch.zeros_like(self.pixels, requires_grad=False)

    def parameters(self) -> dict[str, torch.Tensor]:
        """The pixels."""
        return {"pixels": self.pixels}

    def buffers(self) -> dict[str, torch.Tensor]:
        """The gathered momentum."""
        return {} if self._velocity is None else {"velocity": self._velocity}

    def adjust_gradients(self, step: int) -> None:
        """Smooth them, add what was before, and divide by their size where the rule depends on it."""
        assert self.pixels.grad is not None
        left = 1 - step / self._steps
        # large shapes first, which survive blur and distance; detail as the smoothing fades
        sigma_px = self._smoothing_px * left + self._last_smoothing_px * (1 - left)
        gradient = smooth_gradient(self.pixels.grad, sigma_px)
        if self._velocity is not None:  # Dong et al. 2018, equation 6
            gradient = self._velocity.mul_(self._momentum).add_(gradient / gradient.abs().mean().clamp_min(1e-30))
        if not self._is_signed:
            # texels that no view shows have no gradient, and would make the mean smaller
            seen = (gradient != 0).any(dim=0, keepdim=True).sum().clamp_min(1) * len(gradient)
            gradient = gradient / (gradient.square().sum() / seen).sqrt().clamp_min(1e-12)
        self.pixels.grad = gradient

    def constrain(self) -> None:
        """Colours are in [0, 1]."""
        self.pixels.clamp_(0, 1)


def draw_first_pixels(size_px: int, seed: int, contrast: float = 1.0) -> torch.Tensor:
    """θ before the first step: (3, n, n) float32, uniform over `contrast` of [0, 1] about its middle."""
    rng = Draws(seed, 0).of("first patch")
    # drawn by NumPy, whose stream does not depend on the device
    return torch.from_numpy(rng.random((3, size_px, size_px), np.float32) - 0.5) * contrast + 0.5


def smooth_gradient(gradient: torch.Tensor, sigma_px: float) -> torch.Tensor:
    """Convolve (3, n, n) with a Gaussian, mirrored at the edges; below a third of a texel it is left as it is."""
    if sigma_px < 1 / 3:
        return gradient
    from toolkit.models.vision import torchvision

    # three standard deviations hold nearly all of the weight
    reach = min(int(3 * sigma_px) + 1, gradient.shape[-1] - 1)
    kernel_px = [2 * reach + 1] * 2
    return torchvision.transforms.functional.gaussian_blur(gradient, kernel_px, [sigma_px, sigma_px])


def judge_photos(
    photos: torch.Tensor, targets: list[Target], objective: str = "cross-entropy", known: torch.Tensor | None = None,
    lost_weight: float = 1.0,
) -> tuple[torch.Tensor, float]:  # fmt: skip
    """The networks' loss of (b, 3, m, m) sRGB-encoded photographs, and the share that they recognise.

    Returns the cross-entropy towards the target class, mean over the batch and summed over the networks, and the share
    recognised, mean over the networks. By the objective `logit` the loss is the class' logit, its sign turned, whose
    gradient does not vanish where a network is sure (Zhao et al. 2021). With `known`, (b,) bool, photographs that are
    recognised there and not here count `lost_weight` times.
    """
    loss, recognised = photos.new_zeros(()), 0.0
    for target in targets:
        with mixed_precision(photos.device.type) if photos.dtype == torch.float32 else nullcontext():
            logits = target.logits(photos)
        wanted = torch.full((len(photos),), target.class_index, device=logits.device)
        # networks may run in half precision; the loss may not
        precise = logits.to(photos.dtype)
        if objective == "cross-entropy":
            losses = cross_entropy(precise, wanted, reduction="none")
        else:
            losses = -precise[:, target.class_index]
        # the share recognised is reported, and weighs the losses if some photographs count more
        hits = logits.argmax(1) == wanted
        if known is not None:
            losses = losses * weigh_lost(known.to(hits.device), hits, lost_weight).to(losses)
        loss = loss + losses.mean()
        recognised += float(hits.double().mean())
    return loss, recognised / len(targets)


def weigh_lost(known: torch.Tensor, hits: torch.Tensor, lost_weight: float) -> torch.Tensor:
    """(b,) how often each photograph counts: those that are known without the booster and missed with it count more."""
    return 1 + (lost_weight - 1) * (known & ~hits).double()


def judge_in_parts(
    photos: torch.Tensor, judge: Callable[[torch.Tensor, slice], tuple[torch.Tensor, float]]
) -> tuple[torch.Tensor, float]:
    """What a network says of photographs, a part at a time: what it keeps of them for the way back is much memory.

    Args:
        photos: (b, 3, m, m) sRGB-encoded in [0, 1].
        judge: the mean loss of a part of them, and the share recognised; it also gets the part's place in the batch.
    """
    if not photos.requires_grad:
        return judge(photos, slice(None))
    value, recognised = photos.new_zeros(()), 0.0
    gradients: list[torch.Tensor] = []
    # a part for each of a CPU's threads: more are no faster; a GPU takes all at once
    size = CPU_PART * torch.get_num_threads() if photos.device.type == "cpu" else len(photos)
    for first in range(0, len(photos), size):
        where = slice(first, first + size)
        part = photos.detach()[where].requires_grad_(True)
        loss, hits = judge(part, where)
        # a part counts by its share of the batch, so that the whole is its mean
        share = len(part) / len(photos)
        gradients += torch.autograd.grad(loss * share, part)
        value, recognised = value + loss.detach() * share, recognised + hits * share
    return _stand_in(photos, torch.cat(gradients), value), recognised


def judge_ensemble(
    photos: torch.Tensor, targets: Sequence[Target], config: PixelConfig, draws: Draws,
    clean: torch.Tensor | None = None, unmodified: torch.Tensor | None = None,
) -> tuple[torch.Tensor, float]:  # fmt: skip
    """The loss of photographs before the networks that a step asks, a scalar, and the mean share they recognise.

    Features that networks share transfer to unseen networks; those of a single network do not. The means are
    those of the literature on transfer: an ensemble (Liu et al. 2017), diverse inputs (DI; Xie et al. 2019), the logit
    in place of the cross-entropy (Zhao et al. 2021). Momentum (MI; Dong et al. 2018) and smoothed gradients (TI; Dong
    et al. 2019) are in `PixelTask.adjust_gradients`.

    Args:
        photos: (b, 3, m, m) sRGB-encoded, rendered once for all networks; of several processes each judges its part.
        targets: the networks.
        config: its `ensemble`, `objective`, `feature_mixup` and transforms of the stage `network` act here. By `sum`
            the losses are added. By `normalised` the value is that sum, and the gradient by the photographs is the sum
            of the networks' own, each scaled to their mean length, so that none drowns the others. By `turns` one
            network is asked, see `choose_turn`.
        draws: of this step.
        clean: all photographs without the booster, where features are mixed.
        unmodified: all photographs of the object as it is, if `lost_weight` acts.
    """

    # a network by itself, with its own draws of the transforms on its way
    def ask(seen: torch.Tensor, number: int) -> tuple[torch.Tensor, float]:
        target = targets[number].folded

        def look(photos: torch.Tensor) -> torch.Tensor:
            # drawn for each network by its number: they do not look at the same cut
            for transform in config.transforms("network"):
                photos = transform.change(photos, transform.rng(draws, f" {number}"))
            return current().share(photos)

        known = None if unmodified is None else target.find_hits(look(unmodified))
        if clean is None:
            return judge_in_parts(
                look(seen),
                lambda part, where: judge_photos(
                    part, [target], config.objective, None if known is None else known[where], config.lost_weight
                ),
            )
        network, see_clean = target.classifier, partial(judge_photos, clean, [target])
        assert isinstance(network, Classifier)
        # features are mixed inside the network while it is asked, with those of the clean photographs
        with ExitStack() as acting:
            for transform in config.transforms("features"):
                side = network.preprocessing.crop_px
                acting.enter_context(transform.inside(network.module, side, see_clean, draws, f" {number}"))
            return judge_photos(look(seen), [target], config.objective, known, config.lost_weight)

    # by turns, a step asks a single network
    if config.ensemble == "turns":
        return ask(photos, choose_turn(config.seed, draws.step, [target.turns for target in targets]))
    if config.ensemble == "normalised" and photos.requires_grad:
        return _normalise(photos, ask, len(targets))
    answers = [ask(photos, number) for number in range(len(targets))]
    return sum((loss for loss, _ in answers), photos.new_zeros(())), _mean([hits for _, hits in answers])


def choose_turn(seed: int, step: int, turns: Sequence[int]) -> int:
    """Number of the network that a step asks: each has its turns in every round, in an order of the round's own."""
    each = np.repeat(np.arange(len(turns)), turns)
    number, inside = divmod(step, len(each))
    return int(each[Draws(seed, number).of("turns").permutation(len(each))[inside]])


def choose_targets(targets: Sequence[Target], config: PixelConfig, step: int) -> list[Target]:
    """The networks that a step uses: a single network by turns, else all."""
    if config.ensemble != "turns":
        return list(targets)
    return [targets[choose_turn(config.seed, step, [target.turns for target in targets])]]


def _normalise(
    photos: torch.Tensor, ask: Callable[[torch.Tensor, int], tuple[torch.Tensor, float]], count: int
) -> tuple[torch.Tensor, float]:
    """Network after network, each graph freed before the next; one way back through the render for all."""
    # a separate leaf: the render's graph is walked once, with the joined gradient
    seen = photos.detach().requires_grad_(True)
    value, recognised = photos.new_zeros(()), []
    gradients: list[torch.Tensor] = []
    for number in range(count):
        loss, hits = ask(seen, number)
        gradients += torch.autograd.grad(loss, seen)
        value = value + loss.detach()
        recognised.append(hits)
    # of the whole batch, of which each process holds a part
    lengths = current().add(torch.stack([gradient.square().sum() for gradient in gradients])).sqrt()
    scales = lengths.mean() / lengths.clamp_min(1e-30)
    joined = sum(
        (gradient * scale for gradient, scale in zip(gradients, scales, strict=True)), torch.zeros_like(photos)
    )
    return _stand_in(photos, joined, value), _mean(recognised)


def _stand_in(photos: torch.Tensor, gradient: torch.Tensor, value: torch.Tensor) -> torch.Tensor:
    """Return a scalar with this value and this gradient by the photographs."""
    along = (photos * gradient).sum()
    return along - along.detach() + value


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def resolve_targets(networks: Sequence[Network], class_name: str | int) -> list[Target]:
    """The class in each network's own labels.

    Raises:
        ToolkitError: a network does not know it, or cannot be trained against.
    """
    # refused before anything is rendered
    for network in networks:
        if network.untrainable:
            raise FieldError(
                f"it can judge, but no booster can be trained against it: {network.untrainable}",
                {"model": network.arch},
            )
    return [Target(network, network.class_index(class_name)) for network in networks]


def quantise(pixels: torch.Tensor) -> np.ndarray:
    """(3, n, n) in [0, 1] to (n, n, 3) uint8, rounded as the file has it."""
    return np.round(pixels.detach().cpu().numpy().transpose(1, 2, 0) * 255).astype(np.uint8)


def from_picture(pixels: np.ndarray, device: str) -> torch.Tensor:
    """(n, n, 3) uint8 to (3, n, n) float32 in [0, 1]: the way back from `quantise`."""
    return torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1))).to(device).float().div(255)


def record_network(classifier: Network) -> records.NetworkRecord:
    """A classifier as records name it."""
    weights = classifier.weights
    return records.NetworkRecord(
        arch=classifier.arch, weights=weights.name, sha256=weights.sha256,
        tensors_sha256=hash_network_tensors(classifier),
    )  # fmt: skip


def list_networks(targets: list[Target]) -> list[list[object]]:
    """The networks and their classes, as hashes of inputs name them; of programs also what a TOML says of images."""
    rows: list[list[object]] = []
    for target in targets:
        # classifiers are known by weights and class; a program's TOML decides what it is shown
        network = target.classifier
        said: list[object] = [network.preprocessing.describe()] if is_program(network.arch) else []
        said += [{"turns": target.turns}] if target.turns != 1 else []
        rows.append([network.arch, network.weights.sha256, target.class_index, *said])
    return rows
