"""Every corruption, batch 16 at 224² and severity 3, against the published formula picture by picture, in turns.

The formulas (`corruption_formulas`) start from 8-bit pictures, as published, ours from a float batch. Both end with the
float planes in [0, 1] that a network takes. Both use as many threads as their libraries do by default.
"""

from statistics import geometric_mean, median
from time import perf_counter

import cv2
import numpy as np
import torch

from benchmarks.corruption_formulas import FORMULAS
from toolkit.corruptions.batch import corrupt
from toolkit.corruptions.catalogue import CORRUPTIONS

BATCH, SIDE_PX, SEVERITY, TURNS = 16, 224, 3, 5
SLOW = {"glass_blur": 1}
"""Pictures per turn of a formula that takes most of a second for each."""


def draw_pictures() -> np.ndarray:
    """(BATCH, side, side, 3) uint8 with the smoothness of photographs."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 256, (BATCH, 14, 14, 3), dtype=np.uint8)
    large = np.stack([cv2.resize(one, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_CUBIC) for one in coarse])
    return np.clip(large + rng.normal(0, 6, large.shape), 0, 255).astype(np.uint8)


def to_planes(result: np.ndarray) -> np.ndarray:
    """(h, w, 3) with values in 0…255 to (3, h, w) float32 in [0, 1]; NumPy does it in less time than torch."""
    return np.multiply(result.transpose(2, 0, 1), np.float32(1 / 255), dtype=np.float32, casting="same_kind", order="C")


def measure(name: str, pictures: np.ndarray, images: torch.Tensor) -> tuple[float, float]:
    """(ours, the formula's) images/s: medians over turns, of which the first warms up."""
    given = CORRUPTIONS[name].parameters["imagenet"][SEVERITY - 1]
    few = pictures[: SLOW.get(name, BATCH)]
    ours, theirs = [], []
    for turn in range(TURNS + 1):
        start = perf_counter()
        corrupt(images, name, SEVERITY, range(turn * BATCH, (turn + 1) * BATCH))
        middle = perf_counter()
        for picture in few:
            to_planes(FORMULAS[name](picture, given))
        if turn:
            ours.append(BATCH / (middle - start))
            theirs.append(len(few) / (perf_counter() - middle))
    return median(ours), median(theirs)


def run() -> dict[str, float | str]:
    """Images per second of each, and the ratio; the geometric mean also without glass blur, whose peer is a loop."""
    pictures = draw_pictures()
    images = torch.from_numpy(pictures).permute(0, 3, 1, 2).float().div(255).contiguous()
    report: dict[str, float | str] = {}
    ratios = {}
    for name in CORRUPTIONS:
        ours, theirs = measure(name, pictures, images)
        ratios[name] = ours / theirs
        report[f"{name}: images/s, ours and the formula"] = f"{ours:.0f} {theirs:.0f}"
        report[f"{name}: ratio to the formula"] = ratios[name]
    report["corruptions: geometric mean"] = geometric_mean(ratios.values())
    del ratios["glass_blur"]
    return report | {"corruptions without glass_blur: geometric mean": geometric_mean(ratios.values())}


if __name__ == "__main__":
    import json

    print(json.dumps(run(), indent=2))
