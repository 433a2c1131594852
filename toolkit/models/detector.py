"""Networks that say where things are, in pixels of the image that was given; COCO's names for things."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.lazy import torch
from toolkit.models.labels import index_of_label
from toolkit.models.network import AnyNetwork

COCO_OF_IMAGENET = {
    "airliner": "airplane", "warplane": "airplane", "racer": "car", "sports car": "car", "convertible": "car",
    "minivan": "car", "cab": "car", "limousine": "car", "jeep": "car", "beach wagon": "car", "Model T": "car",
    "beer bottle": "bottle", "wine bottle": "bottle", "pop bottle": "bottle", "water bottle": "bottle",
    "coffee mug": "cup", "cup": "cup", "school bus": "bus", "trolleybus": "bus", "minibus": "bus",
    "mountain bike": "bicycle", "bicycle-built-for-two": "bicycle", "motor scooter": "motorcycle",
    "moped": "motorcycle",
    "garbage truck": "truck", "tow truck": "truck", "moving van": "truck", "trailer truck": "truck",
    "fire engine": "truck", "pickup": "truck", "traffic light": "traffic light", "parking meter": "parking meter",
    "park bench": "bench", "folding chair": "chair", "rocking chair": "chair", "studio couch": "couch",
    "dining table": "dining table", "toilet seat": "toilet", "television": "tv", "laptop": "laptop",
    "notebook": "laptop", "mouse": "mouse", "remote control": "remote", "computer keyboard": "keyboard",
    "cellular telephone": "cell phone", "microwave": "microwave", "toaster": "toaster", "refrigerator": "refrigerator",
    "analog clock": "clock", "wall clock": "clock", "vase": "vase", "teddy": "teddy bear", "backpack": "backpack",
    "umbrella": "umbrella", "soccer ball": "sports ball", "basketball": "sports ball", "tennis ball": "sports ball",
    "banana": "banana", "orange": "orange", "Granny Smith": "apple", "broccoli": "broccoli", "pizza": "pizza",
    "hotdog": "hot dog", "soup bowl": "bowl", "mixing bowl": "bowl", "red wine": "wine glass", "goblet": "wine glass",
    "speedboat": "boat", "fireboat": "boat", "lifeboat": "boat", "gondola": "boat", "yawl": "boat",
}  # fmt: skip
"""ImageNet's name -> COCO's more general name."""


def coco_names(label: str) -> list[str]:
    """Return COCO's possible names of a class: its own, then the more general name."""
    plain = label.replace("_", " ")
    kind = COCO_OF_IMAGENET.get(plain)
    return [plain] if kind is None else [plain, kind]


LEAST_SCORE = 0.01
"""Least score that is kept: average precision counts weak boxes too."""
MOST_BOXES = 100
"""Most boxes of an image, as in COCO's evaluation."""


@dataclass(frozen=True)
class Detections:
    """Boxes in an image, by falling score.

    Attributes:
        boxes: (n, 4) float32, x1, y1, x2, y2 in pixels of the image; pixel centres lie at half integers.
        classes: (n,) int64, indices of the detector's labels.
        scores: (n,) float32 in [0, 1].
    """

    boxes: np.ndarray
    classes: np.ndarray
    scores: np.ndarray

    def __len__(self) -> int:
        return len(self.scores)


class Detector(AnyNetwork, Protocol):
    """A frozen network that finds things; the counterpart of `Classifier`."""

    @property
    def image_px(self) -> int:
        """Side of the squares that `losses` takes; 0: any."""

    def detect(self, images: Sequence[np.ndarray]) -> list[Detections]:
        """Find objects in (h, w, 3) uint8 sRGB images of any sizes."""

    def losses(self, batch: "torch.Tensor", boxes: "torch.Tensor", class_index: int | None) -> "torch.Tensor":
        """(b,) how badly it finds the class at the place: small where score and box fit; differentiable.

        Args:
            batch: (b, 3, h, w) sRGB-encoded in [0, 1], square, of `image_px`.
            boxes: (b, 4) x1, y1, x2, y2 of the object, in pixels of the batch.
            class_index: class of the object; None: any class counts.
        """


def detector_class(detector: Detector, name: str | int) -> int:
    """Index of a class by its label, its index, or the name of an ImageNet class that is a kind of it.

    Raises:
        ToolkitError: there is no such class; the nearest names are listed.
    """
    if isinstance(name, int):
        raise ToolkitError(f"class index {name} is of ImageNet: a detector's class is given by its name")
    known = [label.lower() for label in detector.labels]
    for spelling in coco_names(name):
        if spelling.lower() in known:
            return known.index(spelling.lower())
    return index_of_label(detector.labels, name)


def box_iou(boxes: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(n,) intersection over union of (n, 4) boxes with a single (4,) box, x1, y1, x2, y2."""
    corners = np.maximum(boxes[:, :2], other[:2]), np.minimum(boxes[:, 2:], other[2:])
    inside = np.prod(np.clip(corners[1] - corners[0], 0, None), axis=1)
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1) + np.prod(other[2:] - other[:2])
    # union = sum of both areas - intersection; a box without area has none with anything
    return inside / np.maximum(areas - inside, 1e-9)
