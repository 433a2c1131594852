"""Image folders whose classes can be told by colour, or cannot be told at all."""

from pathlib import Path

import numpy as np
from PIL import Image

CHANNELS = {"red": 0, "green": 1, "blue": 2}


def write_colours(root: Path, count: int, px: int = 16, shuffled: bool = False, seed: int = 0) -> Path:
    """`count` noisy images each of red, green and blue; shuffled, the folder says nothing of the colour."""
    rng = np.random.default_rng(seed)
    for label, channel in CHANNELS.items():
        folder = root / label
        folder.mkdir(parents=True, exist_ok=True)
        for k in range(count):
            pixels = rng.integers(0, 130, (px, px, 3))
            pixels[..., rng.integers(3) if shuffled else channel] += rng.integers(60, 120)
            Image.fromarray(pixels.astype(np.uint8)).save(folder / f"{k:03d}.png")
    return root
