"""A picture of an object taken apart, so that any texture can be put on the object afterwards.

Light leaves a matt surface in proportion to its colour, so a picture is linear in the texture's linear colours:
`picture = dark + (1 - coverage) · behind + Σ gain · texture(uv, lod)` over the samples of each pixel.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class TexturedView:
    """One view of h × w pixels; light is linear, in exposure units.

    Attributes:
        behind: (h, w, 3) float32 table and room without the object, its shadow included.
        dark: (h, w, 3) float32 the object with a black texture: gloss, and parts that keep their paint.
        coverage: (h, w) float32 share of each pixel that shows the object.
        pixel: (k,) int32 which pixel a sample of the texture counts for, row · w + column.
        uv: (k, 2) float32 where it lies on the texture, u right and v up; outside [0, 1] the texture repeats.
        lod: (k,) float32 base-2 logarithm of the texture's texels per pixel there.
        gain: (k, 3) float32 light that white texels bring to the pixel.
    """

    behind: np.ndarray
    dark: np.ndarray
    coverage: np.ndarray
    pixel: np.ndarray
    uv: np.ndarray
    lod: np.ndarray
    gain: np.ndarray


def view_of_nothing(behind: np.ndarray) -> TexturedView:
    """A view (h, w, 3) in which the object is not seen."""
    none = np.zeros(0, np.float32)
    cover = np.zeros(behind.shape[:2], np.float32)
    uv, gain = none.reshape(0, 2), none.reshape(0, 3)
    return TexturedView(behind, np.zeros_like(behind), cover, none.astype(np.int32), uv, none, gain)
