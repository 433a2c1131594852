"""A detector by hand that finds what is red."""

from pathlib import Path

import torch
from torch import nn

from toolkit.models.decoders import DECODERS
from toolkit.models.load_detector import DenseDetector
from toolkit.models.weights import WeightsFile

PX = 64


class RedSeeker(nn.Module):
    """FastestDet's outputs on a grid of 4 × 4: the redder a cell, the surer of a car that fills half the picture."""

    def forward(self, batch):  # BGR in [0, 1]
        red = nn.functional.adaptive_avg_pool2d(batch[:, 2:] - batch[:, :1], 4)
        sure = torch.sigmoid(8 * red - 2)
        classes = torch.cat([1 - sure, sure], 1)
        return torch.cat([sure, torch.zeros_like(red).expand(-1, 4, -1, -1), classes], 1)


def red_seeker(untrainable=""):
    weights = WeightsFile(Path("red.onnx"), "ab" * 32, "red.onnx")
    return DenseDetector(
        "onnx:red.onnx", "red", RedSeeker(), DECODERS["fastestdet"], ["cup", "car"], weights, "cpu", PX, untrainable
    )
