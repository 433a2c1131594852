"""What a camera should see of an object whose shape and place are known: its silhouette, what it hides, what is cut.

Convention: pixel (0, 0)'s centre lies at (0.5, 0.5); world millimetres; `T_world_camera` as everywhere.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from toolkit.objects.mesh import Mesh, cast_rays, make_ray_scene
from toolkit.photos.posed_camera import PosedCamera

if TYPE_CHECKING:
    from open3d.t.geometry import RaycastingScene

MASK_SIDE_PX = 256
"""Longer side of the silhouettes: a pixel is then about a pixel of what a classifier sees."""
CANVAS_PX = 192
WIDEST = 4.0
"""Tangent of the widest angle from the line of sight at which a part of the object is still counted."""


@dataclass(frozen=True)
class Solid:
    """An object as it stands on the table, with what is stuck on it, ready for rays to be cast at.

    Attributes:
        mesh: in world millimetres.
    """

    mesh: Mesh = field(repr=False)

    @cached_property
    def _scene(self) -> "RaycastingScene":
        return make_ray_scene(self.mesh)

    def hit_mm(self, origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(n,) distance from a point (3,) along unit vectors (n, 3); infinite where the object is missed."""
        rays = np.concatenate([np.broadcast_to(origin, directions.shape), directions], axis=1)
        return cast_rays(self._scene, rays)

    def hides(self, view: PosedCamera, points_mm: np.ndarray, slack_mm: float = 2.0) -> np.ndarray:
        """(n,) which points (n, 3) lie behind the object, more than `slack_mm` behind its surface."""
        away = points_mm - view.position_mm
        length = np.linalg.norm(away, axis=1)
        return self.hit_mm(view.position_mm, away / length[:, None]) < length - slack_mm


def draw_silhouette(solid: Solid, view: PosedCamera) -> np.ndarray:
    """(h, w) bool: where the object is in the photograph, at `MASK_SIDE_PX`."""
    lens = view.camera
    share = MASK_SIDE_PX / max(lens.width, lens.height)
    w, h = max(1, round(lens.width * share)), max(1, round(lens.height * share))
    x, y = np.meshgrid((np.arange(w) + 0.5) * lens.width / w, (np.arange(h) + 0.5) * lens.height / h)
    directions = lens.undistort(np.stack([x.ravel(), y.ravel()], axis=1))
    return np.isfinite(solid.hit_mm(view.position_mm, view.rays(directions))).reshape(h, w)


def silhouette_px(solid: Solid, view: PosedCamera) -> np.ndarray:
    """(n, 2) pixels, evenly spread over the object's whole silhouette, those that lie outside the frame as well.

    Empty where no part of the object is in front of the camera.
    """
    local = (solid.mesh.vertices - view.position_mm) @ view.T_world_camera[:3, :3]
    ahead = local[local[:, 2] > 1e-3 * np.abs(local).max()]
    if len(ahead) == 0:
        return np.zeros((0, 2))
    flat = ahead[:, :2] / ahead[:, 2:]
    low, high = np.clip(flat.min(axis=0), -WIDEST, WIDEST), np.clip(flat.max(axis=0), -WIDEST, WIDEST)
    step = max(float((high - low).max()) / CANVAS_PX, 1e-9)
    x, y = (np.arange(low[axis] + step / 2, high[axis], step) for axis in (0, 1))
    directions = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    rays = view.rays(directions)
    distance = solid.hit_mm(view.position_mm, rays)
    met = np.isfinite(distance)
    points = view.position_mm + rays[met] * distance[met, None]
    return view.project(points)
