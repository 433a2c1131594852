"""Everything in the picture but the object: light, what stands around, and the table or ground it stands on."""

from dataclasses import dataclass, replace

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import Mesh


@dataclass(frozen=True)
class KeyLight:
    """The main light, a soft box or the sun; far enough away to shine evenly."""

    azimuth_deg: float = 40.0  # azimuth_deg, elevation_deg: where it stands
    elevation_deg: float = 52.0
    radius_deg: float = 7.0  # half of its apparent size; larger is softer
    irradiance: tuple[float, float, float] = (2.2, 2.15, 2.05)  # (3,) linear RGB on a surface that faces it


@dataclass(frozen=True)
class Table:
    """A table top at z = 0."""

    picture: np.ndarray  # (h, w, 3) uint8 sRGB; its middle is the origin, image right +x, image up +y
    size_mm: tuple[float, float]  # (width along x, height along y)
    roughness: float  # 0 mirror … 1 matte

    @property
    def px_per_mm(self) -> float:
        """Pixels of the table's picture per millimetre."""
        return self.picture.shape[1] / self.size_mm[0]


@dataclass(frozen=True)
class Stand:
    """The place of an object: its base's centre in the world, and its turn, counter-clockwise from above."""

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

    def put(self, mesh: Mesh) -> Mesh:
        """The mesh in the world's frame."""
        vertices = self.to_world(mesh.vertices).astype(np.float32)
        return replace(mesh, vertices=vertices, normals=mesh.normals @ self.turn.T.astype(np.float32))


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
    """The surroundings of an object: the table-top studio, or a world out of doors.

    Raises:
        ToolkitError: both a table and surroundings.
    """

    name: str  # for the manifest
    key: KeyLight  # the main light
    # (h, w, 3) float32 linear radiance of room or sky in all directions, equirectangular: row 0 is straight up, the
    # middle column azimuth 0, azimuth grows to the left
    environment: np.ndarray
    exposure: float  # factor from radiance to the picture's linear values
    table: Table | None = None  # what the object stands on in a studio
    surroundings: Mesh | None = None  # what stands around it out of doors, in the units of the object's mesh
    lamps: float = 0.0  # radiance of a surface whose `Material.emission` is 1; 0 where lamps are off

    def __post_init__(self) -> None:
        if self.table is not None and self.surroundings is not None:
            raise ToolkitError(
                f"the scene {self.name} has a table and surroundings: expected one of them, leave one out"
            )

    def need_table(self) -> Table:
        """The table; raises a `ToolkitError` if there is none."""
        if self.table is None:
            raise ToolkitError(f"the scene {self.name} has no table: take a studio's")
        return self.table
