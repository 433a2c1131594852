"""Detectors as what boosters are trained against."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from toolkit.boosters.pixel_config import Settings
from toolkit.boosters.pixels import Network, Target, resize_photos, resolve_targets
from toolkit.boosters.transforms import OF_NETWORKS
from toolkit.boosters.transforms.transfer import find_layers
from toolkit.core.errors import FieldError
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.detector import Detector, detector_class
from toolkit.models.find import expand_sets, may_be_detector, pair_weights
from toolkit.models.network import Classifier
from toolkit.models.weights import WeightsFile
from toolkit.training.processes import current

ANY_SIZE_PX = 320
"""Side of the pictures for a detector that takes any."""


@dataclass(frozen=True)
class DetectorNetwork:
    """A detector in a classifier's clothes: what it is surest of in the picture, wherever it sees that.

    Attributes:
        detector: the network.
    """

    detector: Detector
    is_imagenet: bool = False

    @property
    def name(self) -> str:
        """What to call it in a result."""
        return self.detector.name

    @property
    def arch(self) -> str:
        """Name of its architecture."""
        return self.detector.arch

    @property
    def labels(self) -> list[str]:
        """Name of each class."""
        return self.detector.labels

    @property
    def weights(self) -> WeightsFile:
        """The file that its weights came from."""
        return self.detector.weights

    @property
    def device(self) -> str:
        """Where it runs, `cpu` or `cuda`."""
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
        best = torch.full((len(batch), len(self.labels)), 1e-6)
        for k, seen in enumerate(self.detector.detect(list(pixels))):
            for index, score in zip(seen.classes, seen.scores, strict=True):
                best[k, index] = max(float(best[k, index]), float(score))
        return best.log().to(batch.device)

    def class_index(self, name: str | int) -> int:
        """Index of a class by its label, or the name of an ImageNet class that is a kind of it."""
        return detector_class(self.detector, name)


def find_detectors(networks: Sequence[Network]) -> list[DetectorNetwork] | None:
    """The networks, where they are detectors; None where they are classifiers.

    Raises:
        ToolkitError: classifiers and detectors are mixed.
    """
    found = [network for network in networks if isinstance(network, DetectorNetwork)]
    if found and len(found) < len(networks):
        raise FieldError(
            "name classifiers or detectors, not both", {"model": " ".join(network.arch for network in networks)}
        )
    return found or None


def meet_networks(
    config: Settings, networks: Sequence[Network], class_name: str | int
) -> tuple[Settings, list[Target]]:
    """The settings that act for these networks, and the class in each network's own labels.

    Raises:
        ToolkitError: a network does not know the class or cannot be trained against, some are classifiers and some
            detectors, or an option does not act on them.
    """
    targets = resolve_targets(networks, class_name)
    if find_detectors(networks):
        refuse_for_detectors([name for name, part in config.held_transforms() if part.stage in OF_NETWORKS])
    if config.feature_mixup is not None:
        whole = [network for network in networks if not find_layers(getattr(network, "module", None))]
        if whole:
            expected = "its features cannot be reached, so {feature_mixup} cannot mix them: leave one of the two out"
            raise FieldError(expected, {"model": whole[0].arch})
    return config.for_networks(len(targets)), targets


def refuse_for_detectors(acting: Sequence[str]) -> None:
    """Raise for the first of some fields: what they hold acts before classifiers alone."""
    for name in acting:
        raise FieldError(
            f"{{{name}}} acts on classifiers alone: leave it out, or train against classifiers without detectors", {}
        )


def load_networks(
    models: Sequence[str] | None, weights: Sequence[Path] | None, device: str = "auto", folder: Path | None = None,
    may_mix: bool = False,
) -> Sequence[Classifier | DetectorNetwork]:  # fmt: skip
    """What boosters are trained against: classifiers or detectors by name; see `load_classifiers`, `load_detector`.

    Args:
        models, weights, device, folder: as for these; the name of a set stands for its networks.
        may_mix: whether classifiers and detectors may be mixed, as judges; no training uses both.

    Raises:
        ToolkitError: as these, two of the same name, or a mixture that is not allowed.
    """
    if not may_mix:  # a left-out network is a mixture by itself, and no checkpoint of those that train
        models = expand_sets(models, folder)
    networks = _load_each(models, weights, device, folder, may_mix)
    names = [network.name for network in networks]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        expected = f"several are called '{twice}': name each once; one of two files may have another 'name' in its TOML"
        raise FieldError(expected, {"model": names})
    return networks


def _load_each(
    models: Sequence[str] | None, weights: Sequence[Path] | None, device: str, folder: Path | None, may_mix: bool
) -> Sequence[Classifier | DetectorNetwork]:
    from toolkit.models.load import load_classifier, load_classifiers

    named = list(models or [])
    if any(map(may_be_detector, named)):
        from toolkit.models.load_detector import is_detector, load_detector

        # detectors may be mixed with classifiers only as judges
        kinds = [is_detector(name) for name in named]
        if any(kinds):
            if not (all(kinds) or may_mix):
                raise FieldError("expected classifiers or detectors, not both", {"model": " ".join(named)})
            pairs = zip(named, (file for _, file in pair_weights(named, weights, folder)), kinds, strict=True)
            return [
                DetectorNetwork(load_detector(name, file, device))
                if kind
                else load_classifier(name, file, device, folder)
                for name, file, kind in pairs
            ]
    return load_classifiers(named, weights, device, folder)


def judge_detectors(photos: torch.Tensor, targets: Sequence[Target], boxes: np.ndarray) -> tuple[torch.Tensor, float]:
    """The detectors' losses of photographs of the object, mean over the batch and summed, and the share that they see.

    Args:
        photos: (b, 3, m, m) sRGB-encoded in [0, 1]; of several processes each judges its part.
        targets: whose networks are `DetectorNetwork`s.
        boxes: (b, 4) x1, y1, x2, y2 of the object, in pixels of the photographs.
    """
    photos, boxes = current().share(photos), current().share(boxes)
    loss, seen, side = photos.new_zeros(()), 0.0, photos.shape[-1]
    # a box may reach out of the cut that the detector is shown
    places = torch.from_numpy(np.asarray(boxes, np.float32)).clamp(0, side).to(photos.device)
    for target in targets:
        network = target.classifier
        assert isinstance(network, DetectorNetwork)
        wanted = network.preprocessing.crop_px
        scaled = resize_photos(photos, wanted)
        loss = loss + network.detector.losses(scaled, places * (wanted / side), target.class_index).mean()
        seen += target.count_hits(photos.detach()) / len(photos)
    return loss, seen / len(targets)


def box_of_coverage(coverage: np.ndarray) -> tuple[int, int, int, int]:
    """x1, y1, x2, y2 round the pixels of (h, w) that an object covers by half; all 0 where there are none."""
    rows, columns = (np.flatnonzero((coverage > 0.5).any(axis)) for axis in (1, 0))
    if not len(rows):
        return 0, 0, 0, 0
    # the far edge of the last pixel: a box counts in edges, a pixel in its index
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
