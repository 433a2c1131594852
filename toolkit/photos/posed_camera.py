"""A photograph's camera and where it stood."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from toolkit.rig.camera import Camera


@dataclass(frozen=True)
class PosedCamera:
    """A photograph's camera and where it stood.

    Attributes:
        T_world_camera: (4, 4), OpenCV axes, millimetres.
        camera: of the upright photograph.
        details: how it was measured, for the record: lens, reprojection error, corners found.
    """

    T_world_camera: np.ndarray
    camera: Camera
    details: Mapping[str, float | int | str] = field(default_factory=dict)

    @property
    def position_mm(self) -> np.ndarray:
        """(3,) where it stood."""
        return self.T_world_camera[:3, 3]

    def project(self, points_mm: np.ndarray) -> np.ndarray:
        """(n, 2) pixels of world points (n, 3), see `Camera.project`."""
        return self.camera.project(self.T_world_camera, points_mm)

    def sees(self, points_mm: np.ndarray) -> np.ndarray:
        """(n,) which world points (n, 3) lie in the frame, whatever stands before them."""
        pixels = self.project(points_mm)
        return np.all((pixels >= 0) & (pixels < (self.camera.width, self.camera.height)), axis=1)

    def rays(self, directions: np.ndarray) -> np.ndarray:
        """(n, 3) unit vectors in the world of directions x/z, y/z (n, 2) in camera axes."""
        local = np.c_[directions, np.ones(len(directions))]
        turned = local @ self.T_world_camera[:3, :3].T
        return turned / np.linalg.norm(turned, axis=1, keepdims=True)
