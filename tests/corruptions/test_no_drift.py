"""Statistics of every corruption on one fixed picture, so that a change of what is drawn or computed is seen.

Statistics with a tolerance and not a hash: exponentials, FFTs and matrix products differ in the last bits from one
processor to the next, and so would a hash. Noise that is drawn otherwise changes the projection by far more than the
tolerance. Written by `python tests/corruptions/test_no_drift.py`, which is to be run when a change is meant.
"""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from toolkit.corruptions.batch import corrupt
from toolkit.corruptions.catalogue import CORRUPTIONS

GOLDEN = Path(__file__).with_name("drift.json")
SEED = 2024
TOLERANCE = 2e-4
FROST_TOLERANCE = 2e-3
"""Its panes are drawn with antialiased lines, which OpenCV's versions shade differently by a level or two."""


def draw_scene(side: int) -> torch.Tensor:
    """(1, 3, side, side), from whole numbers: a chequer of colours with ramps and fine texture."""
    y, x = np.mgrid[:side, :side]
    planes = [
        ((x // 7 * (31 + 20 * c) + y // 9 * 53) % 97 / 96 + (x * 5 + y * 3 * (c + 1)) % 41 / 40) / 2 for c in range(3)
    ]
    return torch.from_numpy(np.stack(planes).astype(np.float32))[None]


def measure(name: str, parameters: str) -> list[list[float]]:
    """Per severity: mean, standard deviation, and the projection onto a fixed pattern, per pixel."""
    scene = draw_scene(224 if parameters == "imagenet" else 32)
    y, x = np.mgrid[: scene.shape[2], : scene.shape[3]]
    pattern = torch.from_numpy(((x * x * 3 + y * y * 5 + x * y) % 17 / 8 - 1).astype(np.float32))
    rows = []
    for severity in range(1, 6):
        spoilt = corrupt(scene, name, severity, [SEED], parameters)
        # times the root of the pixels' number: of the size of a deviation, whatever the picture's size
        projection = (spoilt * pattern).mean() * spoilt.numel() ** 0.5
        rows.append([round(value.item(), 5) for value in (spoilt.mean(), spoilt.std(), projection)])
    return rows


@pytest.mark.parametrize("parameters", ["imagenet", "cifar"])
@pytest.mark.parametrize("name", CORRUPTIONS)
def test_statistics_are_those_of_the_first_release(name, parameters):
    golden = np.array(json.loads(GOLDEN.read_text())[name][parameters])
    tolerance = FROST_TOLERANCE if name == "frost" else TOLERANCE
    difference = np.abs(np.array(measure(name, parameters)) - golden)
    assert difference[:, :2].max() < tolerance
    assert difference[:, 2].max() < 40 * tolerance  # a projection adds up what a mean averages


if __name__ == "__main__":
    table = {name: {p: measure(name, p) for p in ("imagenet", "cifar")} for name in CORRUPTIONS}
    lines = (f"  {json.dumps(name)}: {json.dumps(table[name])}" for name in table)
    GOLDEN.write_text("{\n" + ",\n".join(lines) + "\n}\n")
