"""A training image of each class as its patch: the one the classifier knows best, or any (the paper, D.2.2, D.2.3)."""

import os
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from PIL import Image

from toolkit.boosters.baselines.drawn import Advance, Baseline, Choice
from toolkit.boosters.pixels import record_network
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.imaging.read import UnreadableImage
from toolkit.models.network import Classifier
from toolkit.objects.records import PatchRecord
from toolkit.training.images import ImageSet, LabelledImage

BATCH = 64
MAX_DECODERS = 8
Skipped = list[tuple[str, str]]


class _Photos(Baseline):
    def __init__(self, images: ImageSet, classifier: Classifier) -> None:
        self.images, self.classifier = images, classifier
        self.networks = []
        self.settings = {"filter": classifier.preprocessing.filter_name.lower()}
        self.by_class: dict[int, list[LabelledImage]] = defaultdict(list)
        for image in images.images:
            self.by_class[image.class_index].append(image)

    def list_inputs(self, index: int) -> list[str]:
        """Which images the class has."""
        return [image.id for image in self.by_class[index]]

    def is_current(self, record: PatchRecord) -> bool:
        """Whether the chosen image is as it was; the others, which may be millions, are not read again."""
        chosen = LabelledImage(str(record.data.get("image")), record.class_index)
        try:
            return chosen in self.by_class[chosen.class_index] and (
                self.images.hash_image(chosen.id) == record.data.get("image_sha256")
            )
        except OSError:
            return False  # a file that may not be read is met again, and listed, when the class is done anew

    def _choose(self, image: LabelledImage | None, index: int, skipped: Skipped, **figures: Any) -> Choice:
        if image is None:
            return Choice(None, passed_over=tuple(skipped))
        data = {
            "source": self.images.name,
            "image": image.id,
            "image_sha256": self.images.hash_image(image.id),
            "found": len(self.by_class[index]),
        }
        passed_over = [{"path": path, "reason": reason} for path, reason in skipped]
        compared = {key: figures[key] for key in figures if key != "loss"}
        return Choice(
            partial(self._draw, image),
            data=data | compared | {"passed_over": passed_over},
            final={"loss": figures["loss"]} if "loss" in figures else {},
            passed_over=tuple(skipped),
        )

    def _draw(self, image: LabelledImage, size_px: int) -> np.ndarray:
        picture = Image.fromarray(self.images.read_pixels(image.id, size_px))
        side = min(picture.size)
        left, top = (picture.width - side) / 2, (picture.height - side) / 2
        filter_name = self.classifier.preprocessing.filter_name  # Pillow's are antialiased
        square = (left, top, left + side, top + side)
        return np.asarray(picture.resize((size_px, size_px), Image.Resampling[filter_name], box=square))


class BestImages(_Photos):
    """Of each class the image with the lowest cross-entropy loss, as the classifier is shown it."""

    method = "training image with the lowest loss"

    def __init__(self, images: ImageSet, classifier: Classifier) -> None:
        super().__init__(images, classifier)
        self.networks = [record_network(classifier)]

    def count_work(self, index: int) -> int:
        """All images of the class are looked at."""
        return len(self.by_class[index])

    def choose(self, index: int, advance: Advance) -> Choice:
        """The best of a class; of several equally good ones the first by name.

        Raises:
            ToolkitError: the network's output is not finite.
        """
        best, least, compared = None, np.inf, 0
        skipped: Skipped = []
        for images, pixels in self._read(self.by_class[index], skipped, advance):
            losses = measure_losses(self.classifier, pixels, index)
            compared += len(losses)
            # strictly less: of equally good images the first stays
            if losses.min() < least:
                best, least = images[int(losses.argmin())], float(losses.min())
        return self._choose(best, index, skipped, compared=compared, loss=least)

    def _read(
        self, images: list[LabelledImage], skipped: Skipped, advance: Advance
    ) -> Iterator[tuple[list[LabelledImage], np.ndarray]]:
        """One batch after the other, so that memory does not grow with the class; decoded in threads."""

        def load(image: LabelledImage) -> np.ndarray | str:
            try:
                return self.images.load(image, self.classifier.preprocessing)
            except UnreadableImage as error:
                return error.reason

        with ThreadPoolExecutor(min(MAX_DECODERS, os.cpu_count() or 1), thread_name_prefix="decode") as pool:
            for first in range(0, len(images), BATCH):
                part = images[first : first + BATCH]
                loaded = list(pool.map(load, part))
                skipped += [(one.id, what) for one, what in zip(part, loaded, strict=True) if isinstance(what, str)]
                usable = [pair for pair in zip(part, loaded, strict=True) if not isinstance(pair[1], str)]
                if usable:
                    yield [one for one, _ in usable], np.stack([pixels for _, pixels in usable])
                advance(len(part))


class RandomImages(_Photos):
    """Of each class one image, drawn by seed and class; where it cannot be read, another."""

    method = "random training image"

    def __init__(self, images: ImageSet, classifier: Classifier, seed: int) -> None:
        super().__init__(images, classifier)
        self.seed = seed

    def choose(self, index: int, advance: Advance) -> Choice:
        """One of a class."""
        images, skipped = self.by_class[index], Skipped()
        chosen = None
        # an order of all, so that the next one takes the place of an image that cannot be read
        for k in Draws(self.seed, index, "random image").of("order").permutation(len(images)):
            try:
                self.images.load(images[k], self.classifier.preprocessing)
            except UnreadableImage as error:
                skipped.append((images[k].id, error.reason))
                continue
            chosen = images[k]
            break
        advance(1)
        return self._choose(chosen, index, skipped)


def measure_losses(classifier: Classifier, pixels: np.ndarray, index: int) -> np.ndarray:
    """Cross-entropy of each image with class `index`, natural logarithm.

    Args:
        classifier: the network.
        pixels: (b, crop, crop, 3) uint8 sRGB, as the network is shown them.
        index: of the class that they show.

    Returns:
        (b,) float64.

    Raises:
        ToolkitError: the network's output is not finite.
    """
    import torch

    batch = torch.from_numpy(pixels).to(classifier.device).permute(0, 3, 1, 2).float().div_(255)
    with torch.inference_mode():
        # double precision: the best of many images may differ from the next by little
        losses = -classifier.logits(batch).double().log_softmax(dim=1)[:, index].cpu().numpy()
    if not np.isfinite(losses).all():
        raise ToolkitError(f"{classifier.weights.name}: the network's output is not a number: its weights are damaged")
    return losses
