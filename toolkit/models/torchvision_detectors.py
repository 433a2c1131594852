"""Torchvision's detectors behind the kit's protocol."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from toolkit.models.detector import LEAST_SCORE, MOST_BOXES, Detections
from toolkit.models.weights import WeightsFile


@dataclass(frozen=True)
class TorchvisionDetector:
    """A detector that takes a list of images and gives dictionaries; see `Detector` for the attributes."""

    arch: str
    name: str
    module: nn.Module
    labels: list[str]
    weights: WeightsFile
    device: str
    image_px: int = 0
    untrainable: str = ""

    def detect(self, images: Sequence[np.ndarray]) -> list[Detections]:
        """What it sees in (h, w, 3) uint8 sRGB images of any sizes."""
        tensors = [torch.from_numpy(one).permute(2, 0, 1).float().div(255).to(self.device) for one in images]
        with torch.inference_mode():
            answers = self.module(tensors)
        found = []
        for one in answers:
            kept = (one["scores"] > LEAST_SCORE).nonzero()[:MOST_BOXES, 0]
            boxes, classes, scores = (one[key][kept].cpu().numpy() for key in ("boxes", "labels", "scores"))
            found.append(Detections(boxes.astype(np.float32), classes, scores.astype(np.float32)))
        return found

    def losses(self, batch: torch.Tensor, boxes: torch.Tensor, class_index: int) -> torch.Tensor:
        """(b,) the network's own training loss for the object as the only truth."""
        terms = []
        self.module.train()
        for layer in self.module.modules():
            if isinstance(layer, nn.BatchNorm2d | nn.Dropout):
                layer.eval()  # the network stays as it is
        try:
            for k in range(len(batch)):
                target = {
                    "boxes": boxes[k : k + 1].to(batch),
                    "labels": torch.tensor([class_index], device=batch.device),
                }
                terms.append(torch.stack(list(self.module([batch[k]], [target]).values())).sum())
        finally:
            self.module.eval()
        return torch.stack(terms)
