"""Random affine placements: how a flat square may lie in a photograph (Algorithm 1's RandomAffineTransform).

Convention: continuous coordinates, x right and y down, pixel (row i, column j) covers [j, j+1] × [i, i+1], so that
centres are at half integers. `T_image_patch` maps patch texels, [0, n]², to image pixels, [0, m]².
"""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from toolkit.core.config import Config, Flag, Range, Rising

WHERE = "Where the patch lies"


class AffineRanges(Config):
    """What is drawn, uniformly, for each image.

    The defaults span what the rig shows of an 88 mm patch on a 270 mm object that fills 60 % of the frame, seen from
    20-65° above: 45-95 px in the 224 px crop before foreshortening.
    """

    stage: ClassVar = "place"
    rotation_deg: Annotated[Range, Rising(-360, 360), Flag("--rotation", group=WHERE)] = Field(
        (-180.0, 180.0), description="Its turn, degrees, clockwise."
    )
    share: Annotated[Range, Rising(0.02, 2), Flag(group=WHERE)] = Field(
        (0.20, 0.42), description="Its side as a share of the image's, before foreshortening."
    )
    foreshortening: Annotated[Range, Rising(0.05, 1), Flag(group=WHERE)] = Field(
        (0.35, 1.0), description="Compression by an oblique view, 1 is none."
    )
    overhang: Annotated[float, Field(ge=0, lt=0.5)] = Field(
        0.1, description="Share of the placed square's bounding box that may reach over the image's edge."
    )

    def place(self, rng: np.random.Generator, count: int, patch_px: int, image_px: int) -> np.ndarray:
        """Draw `count` placements; (count, 3, 3) float64 `T_image_patch`."""
        rotation = np.radians(rng.uniform(*self.rotation_deg, count))
        scale = rng.uniform(*self.share, count) * image_px / patch_px
        compression = rng.uniform(*self.foreshortening, count)
        direction = rng.uniform(0, np.pi, count)
        linear = _compress(direction, compression) @ _rotate(rotation) * scale[:, None, None]
        centre = _draw_centres(rng, linear, patch_px, image_px, self.overhang)
        return affine_matrices(linear, centre, patch_px)


def affine_matrices(linear: np.ndarray, centre: np.ndarray, patch_px: int) -> np.ndarray:
    """Join (b, 2, 2) linear parts with where the patch's centre goes, (b, 2) image pixels, into (b, 3, 3) matrices."""
    matrices = np.zeros((len(linear), 3, 3))
    matrices[:, :2, :2] = linear
    matrices[:, :2, 2] = centre - linear @ np.full(2, patch_px / 2)
    matrices[:, 2, 2] = 1
    return matrices


def _rotate(angle: np.ndarray) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)


def _compress(direction: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Scale by `length` along `direction`, leave what is perpendicular to it."""
    along = np.stack([np.cos(direction), np.sin(direction)], -1)
    return np.eye(2) - (1 - length)[:, None, None] * along[:, :, None] * along[:, None, :]


def _draw_centres(
    rng: np.random.Generator, linear: np.ndarray, patch_px: int, image_px: int, overhang: float
) -> np.ndarray:
    half_box = np.abs(linear).sum(axis=2) * patch_px / 2
    reach = np.maximum(image_px / 2 - half_box * (1 - 2 * overhang), 0)  # a square too large for the frame is centred
    return image_px / 2 + rng.uniform(-1, 1, reach.shape) * reach
