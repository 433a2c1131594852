"""Find photographs that are copies of one another: in another format or size, or in two folders."""

from collections.abc import Sequence

import numpy as np

from toolkit.captures.capture import UNPATCHED, Capture
from toolkit.captures.reconcile import SetAside
from toolkit.evaluation.prediction import Prediction

SIDE = 16
"""Images are compared as SIDE × SIDE block means of the network's input."""
MOST_MEAN, MOST_ANY = 1.5, 10.0
"""Largest mean and largest single difference of two copies' block means, in codes of 255.

Measured on 175 photographs. Copies (JPEG of quality 75, or 200 px) differ by at most 1.2 and 9.9, different
photographs by at least 6.6 and 145.
"""
FLAT = 2.0
"""Standard deviation of block means, in codes, below which an image is too uniform to compare."""


class TwinFinder:
    """Finds photographs that are copies, from the network's input; renders are skipped, as a booster may be hidden."""

    def __init__(self) -> None:
        self._looks: dict[str, np.ndarray] = {}

    def look(self, capture: Capture, pixels: np.ndarray) -> None:
        """Keep the block means of a photograph; `pixels` are (n, n, 3) uint8 sRGB."""
        if capture.is_rendered or capture.corruption is not None:
            return
        side = len(pixels) // SIDE * SIDE
        if side:
            blocks = pixels[:side, :side].reshape(SIDE, side // SIDE, SIDE, side // SIDE, 3)
            self._looks[capture.path] = blocks.mean((1, 3), dtype=np.float32).ravel()

    def drop(self, predictions: Sequence[Prediction]) -> tuple[list[Prediction], list[SetAside]]:
        """Return the predictions that count, and the images that do not.

        The first by name counts of copies within a variant. If copies have different objects, or are unpatched and
        boosted, an image is in the wrong folder, and neither counts.
        """
        # copies are looked for within a source
        groups: dict[str, list[Prediction]] = {}
        for prediction in sorted(predictions, key=lambda item: item.capture.path):
            if prediction.capture.path in self._looks:
                groups.setdefault(prediction.capture.source, []).append(prediction)
        aside: dict[str, SetAside] = {}
        for group in groups.values():
            for first, second in self._find_pairs(group):
                for why in _judge(first.capture, second.capture):
                    aside.setdefault(why.path, why)
        return [prediction for prediction in predictions if prediction.capture.path not in aside], list(aside.values())

    def _find_pairs(self, group: Sequence[Prediction]) -> list[tuple[Prediction, Prediction]]:
        """Return the pairs of images that are copies, by name."""
        # small pictures of all images, and their mean brightness
        looks = np.stack([self._looks[prediction.capture.path] for prediction in group])
        means = looks.mean(1)
        order = np.argsort(means, kind="stable")
        found = []
        for place, at in enumerate(order):
            # copies differ by less than MOST_MEAN on average, so they are close in this order
            end = place + 1 + np.searchsorted(means[order[place + 1 :]], means[at] + MOST_MEAN, "right")
            others = order[place + 1 : end]
            apart = np.abs(looks[others] - looks[at])
            alike = others[(apart.mean(1) <= MOST_MEAN) & (apart.max(1, initial=0) <= MOST_ANY)]
            # flat pictures, such as a white wall, resemble each other without being copies
            if len(alike) and looks[at].std() > FLAT:
                found += [(group[min(at, k)], group[max(at, k)]) for k in alike]
        return sorted(found, key=lambda pair: (pair[0].capture.path, pair[1].capture.path))


def _judge(first: Capture, second: Capture) -> list[SetAside]:
    """Return the images that do not count, of two copies."""
    path_a, path_b = (capture.path for capture in (first, second))
    if first.object != second.object:
        why = "the same picture as one of another object: {}. One of them lies in the wrong folder"
        return [SetAside(path_a, why.format(path_b)), SetAside(path_b, why.format(path_a))]
    if first.variant == second.variant:
        return [SetAside(path_b, f"a copy of a photograph that counts once: {path_a}", is_fault=False)]
    if UNPATCHED in (first.variant, second.variant):
        why = "unpatched and boosted are the same picture: {}. One of them lies in the wrong folder"
        return [SetAside(path_a, why.format(path_b)), SetAside(path_b, why.format(path_a))]
    return []
