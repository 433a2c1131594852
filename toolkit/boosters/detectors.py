"""Detectors as what boosters are trained against, alone or by turns with classifiers."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from toolkit.boosters.pixel_config import PixelConfig, Settings
from toolkit.boosters.pixels import Network, Target, judge_in_parts, resize_photos, resolve_targets, weigh_lost
from toolkit.boosters.transforms import OF_NETWORKS
from toolkit.boosters.transforms.transfer import find_layers
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.detector import Detector, detector_class
from toolkit.models.find import expand_sets, may_be_detector, pair_weights
from toolkit.models.network import Classifier
from toolkit.models.weights import WeightsFile
from toolkit.training.processes import current

ANY_SIZE_PX = 320
"""Side of the pictures for a detector that takes any."""
FOUND_SCORE = 0.25
"""A detector finds an object whose class it lacks if any of its boxes scores as much, as `toolkit eval` counts."""


@dataclass(frozen=True)
class DetectorNetwork:
    """A detector in a classifier's clothes: what it is surest of in the picture, wherever it sees that.

    Attributes:
        detector: the network.
        any_class: whether it lacks the object's class. Then it only says whether anything is there.
        turns: training steps of a round that use it, see `toolkit.boosters.pixels.choose_turn`.
    """

    detector: Detector
    any_class: bool = False
    turns: int = 1
    is_imagenet: bool = False

    @property
    def name(self) -> str:
        """Name of the network in results."""
        return self.detector.name

    @property
    def arch(self) -> str:
        """Name of its architecture."""
        return self.detector.arch

    @property
    def labels(self) -> list[str]:
        """Name of each class."""
        return ["nothing", "object"] if self.any_class else self.detector.labels

    @property
    def weights(self) -> WeightsFile:
        """The file that its weights came from."""
        return self.detector.weights

    @property
    def device(self) -> str:
        """Device of the network, `cpu` or `cuda`."""
        return self.detector.device

    @property
    def untrainable(self) -> str:
        """Return why no gradient leads back to the image; empty if a gradient does."""
        return self.detector.untrainable

    @property
    def preprocessing(self) -> Preprocessing:
        """Its square; what it does with the pixels is its own."""
        side = self.detector.image_px or ANY_SIZE_PX
        return Preprocessing(side, side, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))

    def logits(self, batch: torch.Tensor) -> torch.Tensor:
        """(b, classes) the logarithm of each class's best score; for judging alone, no gradient leads back."""
        # whole levels, as a file has them
        pixels = batch.detach().mul(255).round().clamp(0, 255).byte().permute(0, 2, 3, 1).cpu().numpy()
        # a class that is seen nowhere has a small score, whose logarithm is finite
        best = torch.full((len(batch), len(self.detector.labels)), 1e-6)
        for k, seen in enumerate(self.detector.detect(list(pixels))):
            for index, score in zip(seen.classes, seen.scores, strict=True):
                best[k, index] = max(float(best[k, index]), float(score))
        if self.any_class:
            best = torch.stack([torch.full((len(batch),), FOUND_SCORE), best.amax(1)], 1)
        return best.log().to(batch.device)

    def class_index(self, name: str | int) -> int:
        """Index of a class by its label, or the name of an ImageNet class that is a kind of it."""
        return 1 if self.any_class else detector_class(self.detector, name)


def is_detector_target(target: Target) -> bool:
    """Whether a target's network is a detector."""
    return isinstance(target.classifier, DetectorNetwork)


def meet_networks(
    config: Settings, networks: Sequence[Network], class_name: str | int
) -> tuple[Settings, list[Target]]:
    """The settings that act for these networks, and the class in each network's own labels, classifiers first.

    A detector beside classifiers may lack the class. It then keeps the score of the unmodified object.

    Raises:
        ToolkitError: a network does not know the class or cannot be trained against, or an option does not act on
            them.
    """
    detectors = [network for network in networks if isinstance(network, DetectorNetwork)]
    classifiers = [network for network in networks if not isinstance(network, DetectorNetwork)]
    # without classifiers the detectors lead, and know the class themselves
    targets = resolve_targets(classifiers or detectors, class_name)
    if detectors and not classifiers:
        refuse_for_detectors([name for name, part in config.held_transforms() if part.stage in OF_NETWORKS])
    elif detectors:
        # networks of an ensemble see the same photographs, which detectors do not
        if config.ensemble not in (None, "turns"):
            expected = "expected turns: classifiers and detectors are shown different photographs"
            raise FieldError(expected, {"ensemble": config.ensemble})
        # beside classifiers a detector need not know the class
        label = targets[0].label
        targets += resolve_targets([_find_any_class(network, label) for network in detectors], label)
    # features are mixed in layers, which graphs do not show
    if config.feature_mixup is not None:
        whole = [network for network in classifiers if not find_layers(getattr(network, "module", None))]
        if whole:
            expected = "its features cannot be reached, so {feature_mixup} cannot mix them: leave one of the two out"
            raise FieldError(expected, {"model": whole[0].arch})
    return config.for_networks(len(targets)), targets


def _find_any_class(network: DetectorNetwork, label: str) -> DetectorNetwork:
    """The detector, asked whether anything is there if it lacks the class."""
    try:
        network.class_index(label)
    except ToolkitError:
        return replace(network, any_class=True)
    return network


def needs_unmodified(config: PixelConfig, targets: Sequence[Target]) -> bool:
    """Whether a step needs photographs of the object without the booster."""
    networks = (target.classifier for target in targets)
    return config.lost_weight > 1 or any(isinstance(each, DetectorNetwork) and each.any_class for each in networks)


def describe_targets(targets: Sequence[Target]) -> list[str]:
    """Name of each network, with what is special about its part in the training."""
    lines = []
    for target in targets:
        network = target.classifier
        keeps = f"knows no {targets[0].label}: keeps the unmodified object's score"
        said = [f"{target.turns} turns"] if target.turns != 1 else []
        said += [keeps] if isinstance(network, DetectorNetwork) and network.any_class else []
        lines.append(f"{network.name} ({'; '.join(said)})" if said else network.name)
    return lines


def refuse_for_detectors(acting: Sequence[str]) -> None:
    """Raise for the first of some fields: what they hold acts before classifiers alone."""
    for name in acting:
        raise FieldError(
            f"{{{name}}} acts on classifiers alone: leave it out, or train against classifiers without detectors", {}
        )


def load_networks(
    models: Sequence[str] | None, weights: Sequence[Path] | None, device: str = "auto", folder: Path | None = None,
    with_sets: bool = True,
) -> Sequence[Classifier | DetectorNetwork]:  # fmt: skip
    """Classifiers and detectors by name, for boosters to train on; see `load_classifiers`, `load_detector`.

    Args:
        models, weights, device, folder: as for these; the name of a set stands for its networks.
        with_sets: whether sets may be named; a network that is left out of training is no set.

    Raises:
        ToolkitError: as these, two of the same name, or a set without its files.
    """
    # how often each network of a set has its turn
    turns: list[int] = []
    if with_sets:
        members = expand_sets(models, folder)
        models, turns = [name for name, _ in members], [count for _, count in members]
    networks = _load_each(models, weights, device, folder)
    names = [network.name for network in networks]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        expected = f"several are called '{twice}': name each once; one of two files may have another 'name' in its TOML"
        raise FieldError(expected, {"model": names})
    # equal turns are the default
    if set(turns) <= {1}:
        return networks
    return [replace(network, turns=count) for network, count in zip(networks, turns, strict=True)]


def _load_each(
    models: Sequence[str] | None, weights: Sequence[Path] | None, device: str, folder: Path | None
) -> Sequence[Classifier | DetectorNetwork]:
    from toolkit.models.load import load_classifier, load_classifiers

    named = list(models or [])
    if any(map(may_be_detector, named)):
        from toolkit.models.load_detector import is_detector, load_detector

        # a name may mean either kind: the file decides
        kinds = [is_detector(name) for name in named]
        if any(kinds):
            # files are paired with the networks that need them
            pairs = zip(named, (file for _, file in pair_weights(named, weights, folder)), kinds, strict=True)
            return [
                DetectorNetwork(load_detector(name, file, device))
                if kind
                else load_classifier(name, file, device, folder)
                for name, file, kind in pairs
            ]
    return load_classifiers(named, weights, device, folder)


def judge_detectors(
    photos: torch.Tensor, targets: Sequence[Target], boxes: np.ndarray, unmodified: torch.Tensor | None = None,
    lost_weight: float = 1.0,
) -> tuple[torch.Tensor, float]:  # fmt: skip
    """The detectors' losses of photographs, mean over the batch and summed, and the share with the object found.

    A detector may lack the class. It then has a loss only for photographs in which the booster hides the object from
    it: its score is lower than without the booster.

    Args:
        photos: (b, 3, m, m) sRGB-encoded in [0, 1]; of several processes each judges its part.
        targets: whose networks are `DetectorNetwork`s.
        boxes: (b, 4) x1, y1, x2, y2 of the object, in pixels of the photographs.
        unmodified: all photographs without the booster, for detectors that lack the class, and for `lost_weight`.
        lost_weight: how often a photograph counts that shows the object found without the booster, and not with it.
    """
    # each process judges its own part of the photographs
    photos, boxes = current().share(photos), current().share(boxes)
    before = None if unmodified is None else current().share(unmodified)
    loss, seen, side = photos.new_zeros(()), 0.0, photos.shape[-1]
    # a box may reach out of the cut that the detector is shown
    places = torch.from_numpy(np.asarray(boxes, np.float32)).clamp(0, side).to(photos.device)
    for target in targets:
        judge = partial(_judge_part, target=target, places=places, unmodified=before, lost_weight=lost_weight)
        mean, found = judge_in_parts(photos, judge)
        loss, seen = loss + mean, seen + found
    return loss, seen / len(targets)


def _judge_part(
    part: torch.Tensor, where: slice, *, target: Target, places: torch.Tensor, unmodified: torch.Tensor | None,
    lost_weight: float,
) -> tuple[torch.Tensor, float]:  # fmt: skip
    """`judge_detectors` of a detector and the photographs that lie at `where` among all."""
    network, before = target.classifier, None if unmodified is None else unmodified[where]
    assert isinstance(network, DetectorNetwork)
    # found or not, before the loss: it weighs the losses below
    hits = target.find_hits(part.detach())
    losses = _find_losses(network, part, places[where], target)
    # without the class, only a loss beyond that of the unmodified object counts
    if network.any_class:
        assert before is not None
        with torch.no_grad():
            wanted = _find_losses(network, before, places[where], target)
        losses = (losses - wanted).clamp_min(0)
    # photographs in which the booster loses the object count more
    if before is not None and lost_weight > 1:
        losses = losses * weigh_lost(target.find_hits(before), hits, lost_weight).to(losses)
    return losses.mean(), float(hits.double().mean())


def _find_losses(network: DetectorNetwork, photos: torch.Tensor, places: torch.Tensor, target: Target) -> torch.Tensor:
    """(b,) losses of photographs at the size that the detector takes."""
    wanted = network.preprocessing.crop_px
    scaled, places = resize_photos(photos, wanted), places * (wanted / photos.shape[-1])
    return network.detector.losses(scaled, places, None if network.any_class else target.class_index)


def box_of_coverage(coverage: np.ndarray) -> tuple[int, int, int, int]:
    """x1, y1, x2, y2 round the pixels of (h, w) that an object covers by half; all 0 where there are none."""
    rows, columns = (np.flatnonzero((coverage > 0.5).any(axis)) for axis in (1, 0))
    if not len(rows):
        return 0, 0, 0, 0
    # the far edge of the last pixel: a box counts in edges, a pixel in its index
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
