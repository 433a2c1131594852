"""The coffeepot's speckled enamel."""

from collections.abc import Callable

import numpy as np
from PIL import Image

from toolkit.objects.modelling import Colour

NAVY: Colour = (24, 40, 84)
CREAM_SPECKS: Colour = (226, 232, 240)
TRIM: Colour = (14, 15, 20)


def enamel_paint(ground: Colour, specks: Colour, seed: int) -> Callable[[int, int, float], Image.Image]:
    """Paint for a chart: the ground strewn with irregular specks of about a millimetre, the same for the same seed."""

    def paint(width: int, height: int, px_per_mm: float) -> Image.Image:
        from scipy.ndimage import gaussian_filter

        noise = gaussian_filter(
            np.random.default_rng(seed).standard_normal((height, width)), 0.45 * px_per_mm, mode="wrap"
        )
        weight = np.clip((noise / max(float(noise.std()), 1e-9) - 1.75) * 4, 0, 1)[..., None]
        colour = np.array(ground) * (1 - weight) + np.array(specks) * weight
        return Image.fromarray(colour.round().astype(np.uint8))

    return paint
