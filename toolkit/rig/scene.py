"""Everything in the picture but the object: light, what stands around, and the table or ground it stands on.

Textures are looked up without aliasing: a pyramid of averages, linear between texels and between levels.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.imaging.colour import LINEAR_OF_CODE
from toolkit.objects.mesh import Mesh
from toolkit.rig.kernel.textures import Texels

WHITE = 65535
SMALLEST = 4
"""Shorter side of the coarsest level, texels."""
_LINEAR = np.round(LINEAR_OF_CODE * WHITE).astype(np.uint16)


def build_pyramid(linear: np.ndarray) -> list[np.ndarray]:
    """Halve (h, w, 3) linear values, float32 or uint16, by area average until one side is 4; level 0 is the input."""
    levels: list[np.ndarray] = [np.ascontiguousarray(linear)]
    while min(levels[-1].shape[:2]) > SMALLEST:
        h, w = levels[-1].shape[:2]
        # each level is made of the one before, in linear light: averages of codes would be too dark
        levels.append(cv2.resize(levels[-1], (max(w // 2, 1), max(h // 2, 1)), interpolation=cv2.INTER_AREA))
    return levels


def texture_pyramid(encoded: np.ndarray) -> list[np.ndarray]:
    """`build_pyramid` of an sRGB-encoded uint8 texture, in linear light, uint16: 65535 is 1."""
    return build_pyramid(_LINEAR[encoded])


def pack_textures(textures: list[np.ndarray]) -> Texels:
    """Pyramids of sRGB-encoded uint8 textures (h, w, 3) for the kernel."""
    pyramids = [texture_pyramid(texture) for texture in textures]
    levels = [level for pyramid in pyramids for level in pyramid]
    sizes = np.array([level.shape[:2] for level in levels], np.int32)
    counts = np.array([len(pyramid) for pyramid in pyramids], np.int32)
    texels = sizes.astype(np.int64).prod(axis=1)
    return Texels(
        # one texel more: the kernel reads four numbers at once, past the last texel's three
        values=np.concatenate([*(level.reshape(-1, 3) for level in levels), np.zeros((1, 3), np.uint16)]),
        start=np.cumsum(texels) - texels, width=sizes[:, 1].copy(), height=sizes[:, 0].copy(),
        first=(np.cumsum(counts) - counts).astype(np.int32), levels=counts,
    )  # fmt: skip


def pad_channels(picture: np.ndarray) -> np.ndarray:
    """(h, w, 4) float32 of (h, w, 3), as the kernel reads pictures: four numbers at once."""
    padded = np.zeros((*picture.shape[:2], 4), np.float32)
    padded[..., :3] = picture
    return padded


def equirectangular(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(u, v) in [0, 1] of directions (n, 3) on a picture of all directions: see `Scene.environment`."""
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    elevation = np.arcsin(np.clip(directions[:, 2], -1, 1))
    return 0.5 - azimuth / np.float32(2 * np.pi), 0.5 + elevation / np.float32(np.pi)


def sample_directions(picture: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Bilinear values (n, 3) of a picture of all directions at unit `directions` (n, 3); its poles do not wrap."""
    u, v = equirectangular(directions)
    h, w = picture.shape[:2]
    x, y = u * w - 0.5, ((1 - v) * h - 0.5).clip(0, h - 1)
    left, top = np.floor(x).astype(int), np.minimum(y.astype(int), h - 2)
    fx, fy = (x - left)[:, None], (y - top)[:, None]
    upper = picture[top, left % w] * (1 - fx) + picture[top, (left + 1) % w] * fx
    lower = picture[top + 1, left % w] * (1 - fx) + picture[top + 1, (left + 1) % w] * fx
    return (upper * (1 - fy) + lower * fy).astype(np.float32)


def blur_directions(picture: np.ndarray, sigma_px: float) -> np.ndarray:
    """A picture of all directions (h, w, 3), blurred across its seam; smaller where what is left fits fewer pixels."""
    shrink = 1
    # a wide blur leaves no fine detail: on a smaller picture it costs the square of `shrink` less
    while sigma_px / shrink >= 8 and min(picture.shape[:2]) // (2 * shrink) >= 16:
        shrink *= 2
    h, w = (side // shrink for side in picture.shape[:2])
    small = cv2.resize(picture, (w, h), interpolation=cv2.INTER_AREA) if shrink > 1 else picture
    # azimuth runs round: what lies beyond one edge is copied to the other before the blur; 4 sigma hold all of it
    margin = min(w, int(np.ceil(4 * sigma_px / shrink)))
    wide = np.concatenate([small[:, w - margin :], small, small[:, :margin]], axis=1)
    blurred = cv2.GaussianBlur(wide, (0, 0), sigma_px / shrink)[:, margin : margin + w]
    return np.ascontiguousarray(blurred, np.float32)


@dataclass(frozen=True)
class KeyLight:
    """The main light, a soft box or the sun; far enough away to shine evenly.

    Attributes:
        azimuth_deg, elevation_deg: where it stands.
        radius_deg: half of its apparent size; larger is softer.
        irradiance: (3,) linear RGB on a surface that faces it.
    """

    azimuth_deg: float = 40.0
    elevation_deg: float = 52.0
    radius_deg: float = 7.0
    irradiance: tuple[float, float, float] = (2.2, 2.15, 2.05)


@dataclass(frozen=True)
class Table:
    """A table top at z = 0.

    Attributes:
        picture: (h, w, 3) uint8 sRGB; its middle is the origin, image right +x, image up +y.
        size_mm: (width along x, height along y).
        roughness: 0 mirror … 1 matte.
    """

    picture: np.ndarray
    size_mm: tuple[float, float]
    roughness: float

    @property
    def px_per_mm(self) -> float:
        """Of the picture."""
        return self.picture.shape[1] / self.size_mm[0]


@dataclass(frozen=True)
class Stand:
    """Where an object stands: its base's centre in the world, and its turn, counter-clockwise from above."""

    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_deg: float = 0.0

    @property
    def turn(self) -> np.ndarray:
        """(3, 3) rotation from the object's frame to the world's."""
        cosine, sine = np.cos(np.radians(self.turn_deg)), np.sin(np.radians(self.turn_deg))
        return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])

    def to_world(self, points: np.ndarray) -> np.ndarray:
        """(n, 3) points of the object's frame in the world."""
        return points @ self.turn.T + self.place


AT_ORIGIN = Stand()


def illuminate(environment: np.ndarray, key: KeyLight) -> np.ndarray:
    """(3,) irradiance of open level ground by the upper half of a picture of all directions and a key light."""
    height = environment.shape[0]
    # of the middles of the rows, from the zenith to the horizon
    elevation = np.pi / 2 - (np.arange(height // 2) + 0.5) * np.pi / height
    weight = np.sin(elevation) * np.cos(elevation)  # Lambert's law, and rows that shrink towards the zenith
    # an even sky of radiance 1 gives pi: the weights are scaled to sum to that
    above = np.pi * (environment[: height // 2].mean(axis=1) * weight[:, None]).sum(axis=0) / weight.sum()
    # on level ground the cosine of the angle to the light is the sine of its elevation
    return above + max(float(np.sin(np.radians(key.elevation_deg))), 0.0) * np.array(key.irradiance)


@dataclass(frozen=True)
class Scene:
    """What an object is put into: the table-top studio, or a world out of doors.

    Attributes:
        name: for the manifest.
        key: the main light.
        environment: (h, w, 3) float32 linear radiance of room or sky in all directions, equirectangular: row 0 is
            straight up, the middle column azimuth 0, azimuth grows to the left.
        exposure: factor from radiance to the picture's linear values.
        table: what the object stands on in a studio.
        surroundings: what stands around it out of doors, in the units of the object's mesh.
        lamps: radiance of a surface whose `Material.emission` is 1; 0 where lamps are off.

    Raises:
        ToolkitError: both a table and surroundings.
    """

    name: str
    key: KeyLight
    environment: np.ndarray
    exposure: float
    table: Table | None = None
    surroundings: Mesh | None = None
    lamps: float = 0.0

    def __post_init__(self) -> None:
        if self.table is not None and self.surroundings is not None:
            raise ToolkitError(
                f"the scene {self.name} has a table and surroundings: expected one of them, leave one out"
            )

    def need_table(self) -> Table:
        """The table.

        Raises:
            ToolkitError: there is none.
        """
        if self.table is None:
            raise ToolkitError(f"the scene {self.name} has no table: take a studio's")
        return self.table
