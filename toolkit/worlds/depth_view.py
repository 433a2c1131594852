"""What weather needs to know of a picture, and what it does to it: a factor and an offset for every pixel."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.rig.camera import Camera, pixel_rays

LOWEST_RISE = 1e-3
"""Of a ray along the horizon: its path through a layer is a thousand times the height, for the earth is round."""


@dataclass(frozen=True)
class DepthView:
    """How far away everything in a picture of h × w pixels is. The world is in metres, z up.

    Attributes:
        depth_m: (h, w) float32 distance along each pixel's ray, inf for the sky.
        camera: of h × w pixels; its distortion is left out.
        T_world_camera: (4, 4) camera's pose, metres.
        ground: (h, w) bool, or share of the pixel in [0, 1], where the ground is seen, which rain wets and snow covers.
        normals: (h, w, 3) unit, in the world, 0 for the sky; snow lies where they point up.
        white: (3,) linear light of a white surface that lies in the open, which snow has; by default the airlight.
    """

    depth_m: np.ndarray
    camera: Camera
    T_world_camera: np.ndarray
    ground: np.ndarray | None = None
    normals: np.ndarray | None = None
    white: np.ndarray | None = None

    def __post_init__(self) -> None:
        shape = (self.camera.height, self.camera.width)
        for name in ("depth_m", "ground", "normals"):
            found = getattr(self, name)
            if found is not None and found.shape[:2] != shape:
                expected = f"expected the camera's {shape[1]} × {shape[0]}"
                raise ToolkitError(f"{name} of {found.shape[1]} × {found.shape[0]} pixels: {expected}")

    @classmethod
    def of_model(
        cls, depth_mm: np.ndarray, camera: Camera, T_world_camera: np.ndarray, metres_per_mm: float
    ) -> "DepthView":
        """A view of a model on a table, in millimetres, as if the model had its real size."""
        pose = T_world_camera.copy()
        pose[:3, 3] *= metres_per_mm
        return cls((depth_mm * metres_per_mm).astype(np.float32), camera, pose)

    def cropped(self, left: int, top: int, side: int) -> "DepthView":
        """A square of the same view."""
        parts = {
            name: whole[top : top + side, left : left + side]
            for name in ("depth_m", "ground", "normals")
            if (whole := getattr(self, name)) is not None
        }
        return replace(self, camera=self.camera.cropped(left, top, side, side), **parts)

    @cached_property
    def directions(self) -> np.ndarray:
        """(h, w, 3) float32 unit rays through the pixels' centres, in the world."""
        height, width = self.depth_m.shape
        x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        pixels = np.stack([x, y], axis=-1).reshape(-1, 2) + np.float32(0.5)
        return pixel_rays(self.camera, self.T_world_camera, pixels)[:, 3:].reshape(height, width, 3)

    def path_m(self, layer_m: float) -> np.ndarray:
        """(h, w) float32 metres of air that light comes through, in a layer of even height above the camera.

        Up to the surface, or where there is only sky up to the layer's top.
        """
        sky = np.isinf(self.depth_m)
        if not sky.any():
            return self.depth_m
        rise = np.maximum(self.directions[sky][:, 2], LOWEST_RISE)
        path = self.depth_m.copy()
        path[sky] = layer_m / rise
        return path

    @property
    def position_m(self) -> np.ndarray:
        """(3,) float32 where the camera is."""
        return self.T_world_camera[:3, 3].astype(np.float32)


@dataclass(frozen=True)
class AffineLight:
    """What weather makes of linear light: `factor · light + offset`, whatever the light; so a gradient is `factor`.

    Attributes:
        factor: (h, w, 1 or 3) float32 in [0, 1].
        offset: (h, w, 3) float32, in the unit of the airlight that it was made with.
    """

    factor: np.ndarray
    offset: np.ndarray

    def apply(self, light: np.ndarray) -> np.ndarray:
        """(h, w, 3) float32 linear light through this weather."""
        return light * self.factor + self.offset

    def then(self, later: "AffineLight") -> "AffineLight":
        """Both, one after the other; what is `later` is nearer to the camera."""
        return AffineLight(self.factor * later.factor, self.offset * later.factor + later.offset)

    @classmethod
    def of_nothing(cls, height: int, width: int) -> "AffineLight":
        """Clear air."""
        return cls(np.ones((height, width, 1), np.float32), np.zeros((height, width, 3), np.float32))
