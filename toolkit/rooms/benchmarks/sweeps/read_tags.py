"""What OpenCV's reader of tags says of pictures: its answers stand where a network's stand for other variants."""

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
    """One answer for each image of a tag: the object's class where its tag is read, else none of the classes.

    The reader has every pixel of the camera, where a network has its own resized picture. Fog and blur are ImageNet-C's
    on that picture; their lengths in pixels are the same, so they are milder for the reader.

    Args:
        captures: of variants that are tags.
        true_classes: index of each object's class.
        labels: of the network.
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
