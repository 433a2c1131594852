"""Landing pads: what is painted on them, and the sheet that carries it."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import sha256_bytes
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import read_image
from toolkit.objects.mesh import Material, Mesh
from toolkit.rig.mount import PAPER_MATERIAL

KINDS = ("plain", "apriltag", "grey", "noise")
PICTURE_PX = 512
NOISE_CELLS = 64
TAG = 7
SMALLEST_M, LARGEST_M = 0.2, 5.0
ROUGHNESS = 0.9


@dataclass(frozen=True)
class Pad:
    """A square sheet with a picture.

    Attributes:
        name: `plain`, `apriltag`, `grey`, `noise`, or that of a trained one.
        picture: (n, n, 3) uint8 sRGB; its top is the pad's +y.
        size_m: side of the sheet, metres.
    """

    name: str
    picture: np.ndarray
    size_m: float = 2.0

    def __post_init__(self) -> None:
        if not SMALLEST_M <= self.size_m <= LARGEST_M:
            raise FieldError(f"expected {SMALLEST_M:g} to {LARGEST_M:g} m", {"size_m": self.size_m})

    @cached_property
    def sha256(self) -> str:
        """Of picture and size."""
        return sha256_bytes(repr((self.picture.shape, self.size_m)).encode() + self.picture.tobytes())

    @cached_property
    def mesh(self) -> Mesh:
        """The sheet in its own frame, metres: its middle is the origin, it faces up; one for all places."""
        half = self.size_m / 2
        corners = np.array([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], np.float32)
        return Mesh(
            corners, np.tile(np.array([[0, 0, 1]], np.float32), (4, 1)),
            np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32), np.array([(0, 1, 2), (0, 2, 3)], np.int32),
            np.zeros(2, np.int32), (Material(PAPER_MATERIAL, self.picture, ROUGHNESS),),
        )  # fmt: skip


def draw_pad(kind: str, size_m: float = 2.0, seed: int = 0) -> Pad:
    """One of `KINDS`; `noise` is drawn by the seed.

    Raises:
        ToolkitError: there is no such pad.
    """
    if kind not in KINDS:
        raise one_of("pad", kind, list(KINDS))
    if kind == "grey":
        return Pad(kind, np.full((64, 64, 3), 128, np.uint8), size_m)
    if kind == "noise":
        rng = np.random.default_rng([seed, 61])
        return Pad(kind, rng.integers(0, 256, (NOISE_CELLS, NOISE_CELLS, 3), np.uint8), size_m)
    return Pad(kind, _draw_tag() if kind == "apriltag" else _draw_plain(), size_m)


def find_pad(space: Workspace, word: str, size_m: float = 2.0, seed: int = 0) -> Pad:
    """One of `KINDS`, a trained pad `print/pads/NAME.png` of the workspace, or a picture file.

    Raises:
        ToolkitError: there is no such pad, or the picture is not square.
    """
    if word in KINDS:
        return draw_pad(word, size_m, seed)
    folder = space.print_dir / "pads"
    own = {file.stem: file for file in sorted(folder.glob("*.png"))}
    file = own.get(word) or Path(word)
    if not file.is_file():
        raise one_of("pad", word, [*KINDS, *own])
    picture = read_image(file)
    if picture.shape[0] != picture.shape[1]:
        size = f"{picture.shape[1]} × {picture.shape[0]}"
        raise ToolkitError(f"{file}: a picture of {size} pixels, expected a square: crop it")
    return Pad(file.stem, picture, size_m)


def _draw_plain() -> np.ndarray:
    """White H in a white ring on slate, with a pale edge (paper, Figure 10d)."""
    n, zoom = PICTURE_PX, 4
    side = n * zoom
    canvas = np.full((side, side, 3), (62, 70, 76), np.uint8)
    pale = (232, 232, 226)
    cv2.rectangle(canvas, (0, 0), (side - 1, side - 1), pale, side // 20)
    cv2.circle(canvas, (side // 2, side // 2), round(side * 0.37), pale, side // 16)
    for x in (0.36, 0.64):
        cv2.rectangle(canvas, _at(side, x - 0.04, 0.29), _at(side, x + 0.04, 0.71), pale, -1)
    cv2.rectangle(canvas, _at(side, 0.36, 0.46), _at(side, 0.64, 0.54), pale, -1)
    return cv2.resize(canvas, (n, n), interpolation=cv2.INTER_AREA)


def _at(side: int, x: float, y: float) -> tuple[int, int]:
    return round(side * x), round(side * y)


def _draw_tag() -> np.ndarray:
    """Tag 7 of AprilTag's family 36h11 with a white edge one cell wide."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    cell = PICTURE_PX // 10
    tag = cv2.aruco.generateImageMarker(family, TAG, 8 * cell)
    bordered = np.pad(tag, cell, constant_values=255)
    return np.repeat(bordered[..., None], 3, axis=2)


TAG_SHARE = 0.8
"""Side of the tag within its white edge, as a share of the pad's."""
