"""A place outdoors: its geometry, what each face is, where an object may stand, what is inside a wall.

Frame: right-handed, z up, metres; the origin is near the middle, on the ground.
"""

from dataclasses import dataclass, fields
from enum import IntEnum
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from toolkit.objects.mesh import Mesh, cast_rays, hash_mesh, load_open3d

if TYPE_CHECKING:
    from open3d.t.geometry import RaycastingScene

    from toolkit.rig.lighting import Shape


CHUNK = 4096
# three directions along no axis: a ray that grazes a wall or an edge may miss, two of three do not
RAYS = np.array([(0.31, 0.17, 0.94), (-0.83, 0.29, 0.48), (0.23, -0.88, 0.41)])


class SceneClass(IntEnum):
    """Class of a face; 0 is what no world names."""

    OTHER = 0
    GROUND = 1
    ROAD = 2
    PAVEMENT = 3
    GRASS = 4
    WATER = 5
    BUILDING = 6
    ROOF = 7
    VEHICLE = 8
    TREE = 9
    FURNITURE = 10
    SIGN = 11
    PAD = 12
    SKYLINE = 13


STANDING = (SceneClass.GROUND, SceneClass.ROAD, SceneClass.PAVEMENT, SceneClass.GRASS, SceneClass.WATER)
"""Classes of the ground: what lies under everything else."""


@dataclass(frozen=True)
class Spot:
    """A place where an object may stand, free of everything else."""

    name: str  # of the place, unique in its world
    place: str  # what it is: street, crossing, square, grass, roof, apron, quay, water
    position: tuple[float, float, float]  # (x, y, z) of the ground there, metres
    free_radius_m: float  # nothing taller than a kerb stands within this, from the ground up to the sky
    yaw_deg: float  # how an object is turned there, counter-clockwise from +x: along the street
    kind: Literal["ground", "roof", "water"]  # what the object stands on


@dataclass(frozen=True)
class World:
    """Geometry of a place and what is known of it."""

    name: str  # `city`, `grass`, `apron`, `harbour`, or that of a user's file
    seed: int  # it was made from
    mesh: Mesh  # in metres; a `Mesh` in all else
    face_class: np.ndarray  # (m,) uint8 `SceneClass` of each face
    spots: tuple[Spot, ...]  # where an object may stand; `pads` are those of them with a landing pad
    # (k, 6) low and high corners of the boxes that buildings fill, metres; None where only the triangles are known, as
    # of a user's file
    solids: np.ndarray | None
    core: np.ndarray  # (2, 2) low and high (x, y) of the part that is made to be looked at from within
    pads: tuple[Spot, ...] = ()

    def __getstate__(self) -> dict[str, object]:
        """Without the scenes that rays are cast at: another process makes its own."""
        own = {field.name for field in fields(self)} | {"sha256"}
        return {name: value for name, value in self.__dict__.items() if name in own}

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) lowest and highest coordinates, metres."""
        return self.mesh.bounds

    @cached_property
    def sha256(self) -> str:
        """`hash_mesh` of its mesh."""
        return hash_mesh(self.mesh)

    @cached_property
    def shape(self) -> "Shape":
        """Its triangles as rays meet them; renderers in this world share it."""
        from toolkit.rig.lighting import Shape

        return Shape.of(self.mesh)

    @cached_property
    def _ground(self) -> "RaycastingScene":
        standing = np.isin(self.face_class, [int(kind) for kind in STANDING])
        return _scene_of(self.mesh, standing)

    @cached_property
    def _buildings(self) -> "RaycastingScene":
        standing = np.isin(self.face_class, [int(kind) for kind in STANDING])
        return _scene_of(self.mesh, ~standing)

    def ground_height(self, points: np.ndarray) -> np.ndarray:
        """(n,) float32 height of ground or water under points (n, 2) or (n, 3), metres; NaN where there is none."""
        points = np.asarray(points, np.float64)
        high = float(self.bounds[1, 2]) + 1.0
        rays = np.zeros((len(points), 6), np.float32)
        rays[:, :2], rays[:, 2], rays[:, 5] = points[:, :2], high, -1.0
        # from above everything, at ground and water alone: roofs and trees are not in this scene
        fall = cast_rays(self._ground, rays)
        return np.where(np.isfinite(fall), high - fall, np.nan).astype(np.float32)

    def inside_building(self, points: np.ndarray) -> np.ndarray:
        """(n,) bool: whether points (n, 3) in metres lie within a building.

        Without solids, a point is inside if most of three rays meet the back of a face first.
        """
        points = np.asarray(points, np.float64).reshape(-1, 3)
        # without known boxes, as in a user's file, rays decide
        if self.solids is None:
            return self._inside_by_rays(points)
        low, high = self.solids[:, :3], self.solids[:, 3:]
        found = np.zeros(len(points), bool)
        # points by thousands, as every point is compared with every box
        for start in range(0, len(points), CHUNK):
            chunk = points[start : start + CHUNK, None]
            within = np.all((chunk > low) & (chunk < high), axis=2)
            found[start : start + CHUNK] = np.any(within, axis=1)
        return found

    def _inside_by_rays(self, points: np.ndarray) -> np.ndarray:
        o3d = load_open3d()

        votes = np.zeros(len(points), int)
        for direction in RAYS:
            rays = np.concatenate([points, np.broadcast_to(direction, points.shape)], axis=1).astype(np.float32)
            hit = self._buildings.cast_rays(o3d.core.Tensor(rays))
            normals = hit["primitive_normals"].numpy()
            # within a closed surface the first face that is met is seen from its back
            votes += np.isfinite(hit["t_hit"].numpy()) & (normals @ direction > 0)
        return votes >= 2


def _scene_of(mesh: Mesh, chosen: np.ndarray) -> "RaycastingScene":
    o3d = load_open3d()

    scene = o3d.t.geometry.RaycastingScene()
    if chosen.any():
        faces = np.ascontiguousarray(mesh.faces[chosen].astype(np.uint32))
        scene.add_triangles(o3d.core.Tensor(np.ascontiguousarray(mesh.vertices)), o3d.core.Tensor(faces))
    return scene
