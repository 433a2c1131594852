"""Detectors that give a box and scores for every place of a grid: YOLOX and FastestDet, from ONNX files."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch import nn
from torchvision.ops import batched_nms, box_iou, generalized_box_iou_loss

from toolkit.models.detector import LEAST_SCORE, MOST_BOXES, Detections
from toolkit.models.weights import WeightsFile

Dense = tuple[torch.Tensor, torch.Tensor]
"""(b, n, 4) boxes x1, y1, x2, y2 in the network's pixels, and (b, n, classes) scores in [0, 1]."""


def decode_yolox(outputs: torch.Tensor, size: int, strides: Sequence[int] = (8, 16, 32)) -> Dense:
    """YOLOX's own (Ge et al. 2021): offsets from a grid's corners, logarithms of the sides, all in strides.

    Args:
        outputs: (b, n, 5 + classes): x, y, log w, log h, objectness and class scores after the sigmoid.
        size: side of the network's images.
        strides: of its grids, in the outputs' order.
    """
    corners, steps = [], []
    for stride in strides:
        line = torch.arange(size // stride, device=outputs.device, dtype=outputs.dtype)
        y, x = torch.meshgrid(line, line, indexing="ij")
        corners.append(torch.stack([x, y], -1).reshape(-1, 2))
        steps.append(torch.full((len(corners[-1]), 1), float(stride), device=outputs.device, dtype=outputs.dtype))
    corner, step = torch.cat(corners), torch.cat(steps)
    centre = (outputs[..., :2] + corner) * step
    half = outputs[..., 2:4].clamp(max=20).exp() * step / 2
    return torch.cat([centre - half, centre + half], -1), outputs[..., 4:5] * outputs[..., 5:]


def decode_fastestdet(outputs: torch.Tensor, size: int) -> Dense:
    """FastestDet's own: one grid; score = objectness^0.6 × class^0.4.

    Args:
        outputs: (b, 5 + classes, h, w): objectness after the sigmoid, x, y, w, h before theirs, classes after softmax.
        size: side of the network's images.
    """
    _, _, height, width = outputs.shape
    flat = outputs.flatten(2).transpose(1, 2)
    y, x = torch.meshgrid(*(torch.arange(n, device=outputs.device) for n in (height, width)), indexing="ij")
    corner = torch.stack([x, y], -1).reshape(-1, 2).to(outputs.dtype)
    cells = torch.tensor([width, height], device=outputs.device, dtype=outputs.dtype)
    centre = (flat[..., 1:3].tanh() + corner) / cells * size
    half = flat[..., 3:5].sigmoid() * size / 2
    # a power has no finite slope at zero
    scores = flat[..., :1].clamp_min(1e-6) ** 0.6 * flat[..., 5:].clamp_min(1e-6) ** 0.4
    return torch.cat([centre - half, centre + half], -1), scores


@dataclass(frozen=True)
class Decoder:
    """How one family of detectors sees and speaks.

    Attributes:
        decode: (outputs, size) -> `Dense`.
        pad: grey of 255 that fills the square beside a picture, which keeps its shape; None: it is stretched.
        mean, std, channels: of the network's input, as in `Preprocessing`.
        nms_iou: from which overlap on the weaker of two boxes of a class is dropped.
    """

    decode: Callable[[torch.Tensor, int], Dense]
    pad: int | None
    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    channels: str
    nms_iou: float


DECODERS = {
    "yolox": Decoder(decode_yolox, 114, (0, 0, 0), (1 / 255, 1 / 255, 1 / 255), "BGR", 0.45),
    "fastestdet": Decoder(decode_fastestdet, None, (0, 0, 0), (1, 1, 1), "BGR", 0.45),
}


@dataclass(frozen=True)
class DenseDetector:
    """A detector whose outputs a `Decoder` reads; see `Detector` for the attributes that all have.

    Attributes:
        module: the network, for normalised images.
        decoder: its family.
    """

    arch: str
    name: str
    module: nn.Module
    decoder: Decoder
    labels: list[str]
    weights: WeightsFile
    device: str
    image_px: int
    untrainable: str = ""

    def predict(self, batch: torch.Tensor) -> Dense:
        """Boxes and scores of every place, for (b, 3, size, size) sRGB-encoded in [0, 1]; differentiable."""
        batch = batch.to(self.device)
        return self._answer(batch.flip(1) if self.decoder.channels == "BGR" else batch)

    def _answer(self, batch: torch.Tensor) -> Dense:
        """`predict` for channels in the network's own order."""
        mean, std = (
            torch.tensor(values, dtype=batch.dtype, device=batch.device).view(1, 3, 1, 1)
            for values in (self.decoder.mean, self.decoder.std)
        )
        # what would change no number costs as much time as what does
        batch = batch if not any(self.decoder.mean) else batch - mean
        batch = batch if set(self.decoder.std) == {1} else batch / std
        return self.decoder.decode(self.module(batch), self.image_px)

    def detect(self, images: Sequence[np.ndarray]) -> list[Detections]:
        """What it sees in (h, w, 3) uint8 sRGB images of any sizes."""
        fitted = [self._fit(image) for image in images]
        with torch.inference_mode():
            order = -1 if self.decoder.channels == "BGR" else 1
            planes = np.stack([plane for pixels, _ in fitted for plane in cv2.split(pixels)[::order]])
            planes = planes.reshape(len(images), 3, self.image_px, self.image_px)
            boxes, scores = self._answer(torch.from_numpy(planes).to(self.device).float().div_(255))
            return [
                self._keep(boxes[k], scores[k], scale, image.shape[:2])
                for k, (image, (_, scale)) in enumerate(zip(images, fitted, strict=True))
            ]

    def _fit(self, image: np.ndarray) -> tuple[np.ndarray, tuple[float, float]]:
        """The image in the network's square, and how much x and y were scaled."""
        side, (height, width) = self.image_px, image.shape[:2]
        if self.decoder.pad is None:
            return cv2.resize(image, (side, side)), (side / width, side / height)
        scale = min(side / width, side / height)
        square = np.full((side, side, 3), self.decoder.pad, np.uint8)
        small = cv2.resize(image, (max(1, int(width * scale)), max(1, int(height * scale))))
        square[: small.shape[0], : small.shape[1]] = small
        return square, (scale, scale)

    def _keep(
        self, boxes: torch.Tensor, scores: torch.Tensor, scale: tuple[float, float], shape: tuple[int, int]
    ) -> Detections:
        best, classes = scores.max(1)
        kept = best > LEAST_SCORE
        boxes, best, classes = boxes[kept], best[kept], classes[kept]
        order = batched_nms(boxes, best, classes, self.decoder.nms_iou)[:MOST_BOXES]
        found = boxes[order].cpu().numpy() / np.array([*scale, *scale], np.float32)
        found = np.clip(found, 0, np.array([shape[1], shape[0]] * 2, np.float32))
        return Detections(found.astype(np.float32), classes[order].cpu().numpy(), best[order].float().cpu().numpy())

    def losses(self, batch: torch.Tensor, boxes: torch.Tensor, class_index: int) -> torch.Tensor:
        """(b,) minus the logarithm of the class's score, and how badly the box fits, at the best places.

        The places are the ten whose boxes fit the object best, weighted by how well; the gradient raises the true
        class's score there, and pulls the boxes to the object (Angelic Patches, CVPR 2023, for dense detectors).
        """
        found, scores = self.predict(batch)
        boxes = boxes.to(found)
        terms = []
        for k in range(len(batch)):
            fit = box_iou(found[k].detach(), boxes[k : k + 1])[:, 0]
            weight, places = fit.topk(min(10, len(fit)))
            weight = (weight + 1e-3) / (weight + 1e-3).sum()
            score = scores[k, places, class_index].clamp_min(1e-6)
            misfit = generalized_box_iou_loss(found[k, places], boxes[k].expand(len(places), 4))
            terms.append((weight * (misfit - score.log())).sum())
        return torch.stack(terms)
