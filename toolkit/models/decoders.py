"""Decode the outputs of detectors: boxes and scores by the family, and the family by the shapes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import torch

from toolkit.core.errors import ToolkitError
from toolkit.models.vision import torchvision

Dense = tuple[torch.Tensor, torch.Tensor]
"""(b, n, 4) boxes x1, y1, x2, y2 in the network's pixels, and (b, n, classes) scores in [0, 1]."""


def decode_yolox(outputs: torch.Tensor, size: int, strides: Sequence[int] = (8, 16, 32)) -> Dense:
    """YOLOX's own (Ge et al. 2021): offsets from a grid's corners, logarithms of the sides, all in strides.

    Args:
        outputs: (b, n, 5 + classes): x, y, log w, log h, objectness and class scores after the sigmoid.
        size: side of the network's images.
        strides: strides of its grids, in the outputs' order.
    """
    # the corner of each cell of the grids, in the order of the outputs, and the cell's side in pixels
    corners, steps = [], []
    for stride in strides:
        line = torch.arange(size // stride, device=outputs.device, dtype=outputs.dtype)
        y, x = torch.meshgrid(line, line, indexing="ij")
        corners.append(torch.stack([x, y], -1).reshape(-1, 2))
        steps.append(torch.full((len(corners[-1]), 1), float(stride), device=outputs.device, dtype=outputs.dtype))
    corner, step = torch.cat(corners), torch.cat(steps)
    centre = (outputs[..., :2] + corner) * step
    # an exponent that no trained network gives would overflow, and its gradient with it
    half = outputs[..., 2:4].clamp(max=20).exp() * step / 2
    return torch.cat([centre - half, centre + half], -1), outputs[..., 4:5] * outputs[..., 5:]


def decode_fastestdet(outputs: torch.Tensor, size: int) -> Dense:
    """FastestDet's own: one grid; score = objectness^0.6 × class^0.4.

    Args:
        outputs: (b, 5 + classes, h, w): objectness after the sigmoid, x, y, w, h before theirs, classes after softmax.
        size: side of the network's images.
    """
    _, _, height, width = outputs.shape
    # a row for each place, as the other families give them
    flat = outputs.flatten(2).transpose(1, 2)
    y, x = torch.meshgrid(*(torch.arange(n, device=outputs.device) for n in (height, width)), indexing="ij")
    corner = torch.stack([x, y], -1).reshape(-1, 2).to(outputs.dtype)
    # offsets within a cell, in cells, become pixels
    cells = torch.tensor([width, height], device=outputs.device, dtype=outputs.dtype)
    centre = (flat[..., 1:3].tanh() + corner) / cells * size
    half = flat[..., 3:5].sigmoid() * size / 2
    # a power has no finite slope at zero
    scores = flat[..., :1].clamp_min(1e-6) ** 0.6 * flat[..., 5:].clamp_min(1e-6) ** 0.4
    return torch.cat([centre - half, centre + half], -1), scores


def decode_yolov8(outputs: torch.Tensor, size: int) -> Dense:
    """YOLOv8's, 11's and 12's: centre boxes in pixels, class scores after the sigmoid.

    Args:
        outputs: (b, 4 + classes, n): x, y, w, h and the scores.
        size: side of the network's images; the boxes are in its pixels already.
    """
    del size
    flat = outputs.transpose(1, 2)
    return _corners(flat[..., :4]), flat[..., 4:]


def decode_end2end(outputs: torch.Tensor, size: int, classes: int) -> Dense:
    """YOLOv10's and YOLO26's: the best boxes, already selected by the graph.

    Args:
        outputs: (b, n, 6): x1, y1, x2, y2 in pixels, score, class.
        size: side of the network's images; the boxes are in its pixels already.
        classes: number of labels.

    Raises:
        ToolkitError: an output has a class that the labels do not name.
    """
    del size
    index = outputs[..., 5].round().long().clamp_min(0)  # unused rows may hold -1
    if index.numel() and index.max() >= classes:
        raise ToolkitError(
            f"the detector gives class {int(index.max())}, and its labels name {classes}: write all of its 'labels', "
            "in order, into the TOML beside it"
        )
    # boxes have a single class each: a dense row of scores with all others at 0
    scores = outputs.new_zeros(*index.shape, classes)
    return outputs[..., :4], scores.scatter(2, index[..., None], outputs[..., 4:5])


def decode_detr(outputs: tuple[torch.Tensor, torch.Tensor], size: int) -> Dense:
    """RT-DETR's, D-FINE's and RF-DETR's: a pair of class logits and normalised boxes, in either order.

    Args:
        outputs: (b, n, classes) before the sigmoid and (b, n, 4) x, y, w, h as shares of the image.
        size: side of the network's images.
    """
    boxes, logits = outputs if outputs[0].shape[-1] == 4 else outputs[::-1]
    return _corners(boxes) * size, logits.sigmoid()


def _corners(boxes: torch.Tensor) -> torch.Tensor:
    centre, half = boxes[..., :2], boxes[..., 2:] / 2
    return torch.cat([centre - half, centre + half], -1)


Letterbox = Literal["corner", "centre", "stretch"]
"""Place of a picture in the network's square: upper left, in the middle, or stretched to fill it."""


@dataclass(frozen=True)
class Decoder:
    """Preprocessing and output format of a family of detectors.

    Attributes:
        family: key of `DECODERS`.
        decode: (outputs, size) -> `Dense`.
        letterbox: place of a picture in the network's square.
        fill: grey beside the picture, 0 to 255.
        mean, std, channels: preprocessing, as in `Preprocessing`.
        nms_iou: least IoU at which the weaker of two boxes of a class is dropped; None: the network drops them.
    """

    family: str
    decode: Callable[..., Dense]
    letterbox: Letterbox
    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    channels: str
    nms_iou: float | None
    fill: int = 114

    def describe(self) -> str:
        """Describe the preprocessing; the letterbox only if it is not the family's own."""
        words, usual = f"mean {self.mean}, deviation {self.std}, {self.channels}", DECODERS[self.family]
        is_usual = (self.letterbox, self.fill) == (usual.letterbox, usual.fill)
        return words if is_usual else f"{words}, letterbox {self.letterbox}, fill {self.fill}"


PLAIN, LEVELS = ((0, 0, 0), (1, 1, 1)), ((0, 0, 0), (1 / 255, 1 / 255, 1 / 255))
IMAGENET = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
"""Means and standard deviations: values in 0 to 1, in 0 to 255, and ImageNet's."""
DECODERS = {
    "yolox": Decoder("yolox", decode_yolox, "corner", *LEVELS, "BGR", 0.45),
    "fastestdet": Decoder("fastestdet", decode_fastestdet, "stretch", *PLAIN, "BGR", 0.45),
    "yolov8": Decoder("yolov8", decode_yolov8, "centre", *PLAIN, "RGB", 0.7),
    "end2end": Decoder("end2end", decode_end2end, "centre", *PLAIN, "RGB", None),
    "detr": Decoder("detr", decode_detr, "stretch", *PLAIN, "RGB", None),
}
"""Each as its authors publish it."""
Shape = tuple[int | None, ...]
"""Shape of an output; None is an axis of any length."""
STRIDES = ((8, 16, 32), (4, 8, 16, 32), (8, 16, 32, 64))
MOST_SELECTED = 1000
"""Boxes that a graph selects by itself; the usual number is 300."""


def count_places(size: int) -> list[int]:
    """Count the places in the grids of a detector, for each of the usual sets of strides."""
    return [sum((size // stride) ** 2 for stride in strides) for strides in STRIDES]


def guess_decoder(shapes: Sequence[Shape], size: int | None) -> str | None:
    """Return the family with outputs of these shapes, if there is any."""
    places = [] if size is None else count_places(size)
    # DETR: two outputs with a row for each query, boxes of four numbers and scores
    if [len(shape) for shape in shapes] == [3, 3]:
        is_pair = shapes[0][1] == shapes[1][1] and shapes[0][1] not in places
        return "detr" if is_pair and [shape[2] for shape in shapes].count(4) == 1 else None
    if len(shapes) != 1:
        return None
    shape = shapes[0]
    # a grid of 16 px cells, with channels first
    if len(shape) == 4:
        is_grid = size is not None and shape[2] == shape[3] == size // 16 and (shape[1] or 0) > 5
        return "fastestdet" if is_grid else None
    if len(shape) != 3:
        return None
    # YOLOX has a row for each place, YOLOv8 a column
    if shape[1] in places[:1] and (shape[2] or 6) > 5:
        return "yolox"
    if (shape[2] in places or shape[2] is None) and (shape[1] or 0) > 4:
        return "yolov8"
    # few rows of six numbers: selected boxes with score and class
    return "end2end" if shape[2] == 6 and (shape[1] or 1) <= MOST_SELECTED else None


def count_classes(family: str, shapes: Sequence[Shape]) -> int | None:
    """Return the number of classes of the outputs, if their shapes show it."""
    if family == "end2end":
        return None
    if family == "detr":
        return next(shape[2] for shape in shapes if shape[2] != 4)
    axis, ahead = {"yolox": (2, 5), "fastestdet": (1, 5), "yolov8": (1, 4)}[family]
    return (shapes[0][axis] or 0) - ahead


def choose_decoder(family: str, classes: int) -> Decoder:
    """Return the family's decoder for a number of classes."""
    decoder = DECODERS[family]
    if family == "end2end":
        return replace(decoder, decode=partial(decode_end2end, classes=classes))
    # RF-DETR counts COCO's 90 numbers and wants ImageNet's colours
    return replace(decoder, mean=IMAGENET[0], std=IMAGENET[1]) if (family, classes) == ("detr", 91) else decoder


def published_labels(classes: int | None) -> list[str]:
    """COCO's names for a detector's outputs: 80 in a row, or 91 by COCO's own numbers."""
    names = torchvision.models.detection.FasterRCNN_ResNet50_FPN_Weights.DEFAULT.meta["categories"]
    return [name for name in names if classes == 91 or name not in ("__background__", "N/A")]


def describe_expected(size: int) -> str:
    """Describe the known shapes."""
    places, side = count_places(size)[0], size // 16
    yolo = f"b×{places}×(5 + classes) of YOLOX, b×(4 + classes)×{places} of YOLOv8, b×300×6 of YOLO26"
    return f"{yolo}, b×(5 + classes)×{side}×{side} of FastestDet, or b×queries×classes and b×queries×4 of RT-DETR"
