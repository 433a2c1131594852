"""Answers of OpenCV's reader of tags, in place of a network's answers."""

from collections.abc import Sequence

import numpy as np

from toolkit.captures.capture import Capture
from toolkit.core.console import progress
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.read_pixels import read_pixels
from toolkit.rig.applied.tag import Tag, parse_tag
from toolkit.rig.markers import find_markers

NOT_READ = "no tag"


def read_tags(captures: Sequence[Capture], true_classes: dict[str, int], labels: Sequence[str]) -> list[Prediction]:
    """Answer for each image of a tag: the object's class if its tag is read, else none of the network's `labels`.

    The reader has every pixel of the camera, but a network only its resized picture. Fog and blur of ImageNet-C have
    the same lengths in pixels on both, so they are milder for the reader.
    """
    made = []
    with progress("reading tags", len(captures)) as bar:
        for capture in captures:
            tag, index = parse_tag(capture.variant), true_classes[capture.object]
            assert tag is not None, capture.variant
            made.append(_answer(capture, index, labels, tag))
            bar.advance()
    return made


def _answer(capture: Capture, index: int, labels: Sequence[str], tag: Tag) -> Prediction:
    pixels = read_pixels(capture, None)
    if isinstance(pixels, str):
        return Prediction(capture, index, labels[index], status=pixels)
    if tag.id in dict(find_markers(tag.dictionary, pixels.mean(axis=2).astype(np.uint8))):
        return Prediction(capture, index, labels[index], index, labels[index], 1.0, 1.0, 1)
    # after every class, and in no top-5 either
    return Prediction(capture, index, labels[index], len(labels), NOT_READ, 1.0, 0.0, max(len(labels), 5) + 1)
