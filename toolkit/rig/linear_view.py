"""One view of a scene, linear in the colours of one of its materials: a texture, or the sheet that is stuck on.

Light falls on a surface in proportion to its colour, so that a picture is `dark + gain · colour(uv)` with exact
geometry, occlusion, bending and light in the buffers (`RaycastRenderer.render_linear`).
"""

from dataclasses import dataclass, replace

import numpy as np

from toolkit.core.files import sha256_bytes
from toolkit.rig.camera import Camera


@dataclass(frozen=True)
class DepthBuffer:
    """How far away everything in a view is, for weather that is laid over it.

    Attributes:
        depth: (h, w) float32 distance along the ray through each pixel's centre, in the mesh's unit; inf for the sky.
        camera: of h × w pixels.
        T_world_camera: (4, 4) its pose, in the same unit.
    """

    depth: np.ndarray
    camera: Camera
    T_world_camera: np.ndarray


@dataclass(frozen=True)
class LinearView:
    """One view of h × w pixels; light is linear, in exposure units.

    Attributes:
        behind: (h, w, 3) float32 table and room without the object, its shadow included; 0 where it covers the pixel.
        dark: (h, w, 3) float32 the object with a black material: gloss, and parts that keep their paint.
        coverage: (h, w) float32 share of each pixel that shows the object.
        pixel: (k,) int32 which pixel a sample of the material counts for, row · w + column.
        uv: (k, 2) float32 where it lies on the material's texture, u right and v up; outside [0, 1] that repeats.
        lod: (k,) float32 base-2 logarithm of the texture's texels per pixel there.
        gain: (k, 3) float32 light that white texels bring to the pixel.
        depth: of what is seen, where it was asked for.
    """

    behind: np.ndarray
    dark: np.ndarray
    coverage: np.ndarray
    pixel: np.ndarray
    uv: np.ndarray
    lod: np.ndarray
    gain: np.ndarray
    depth: DepthBuffer | None = None

    @classmethod
    def of_nothing(cls, behind: np.ndarray) -> "LinearView":
        """A view (h, w, 3) in which the object is not seen."""
        return cls(
            behind=behind, dark=np.zeros_like(behind), coverage=np.zeros(behind.shape[:2], np.float32),
            pixel=np.zeros(0, np.int32), uv=np.zeros((0, 2), np.float32), lod=np.zeros(0, np.float32),
            gain=np.zeros((0, 3), np.float32),
        )  # fmt: skip

    @property
    def share(self) -> np.ndarray:
        """(k,) share of its pixel that each sample stands for: those of a pixel divide what the object covers of it."""
        counts = np.bincount(self.pixel, minlength=self.coverage.size)
        return self.coverage.reshape(-1)[self.pixel] / counts[self.pixel]

    @property
    def sha256(self) -> str:
        """Hash of all buffers of light."""
        arrays = (array for name, array in vars(self).items() if name != "depth")
        return sha256_bytes("".join(sha256_bytes(array.tobytes()) for array in arrays).encode())

    def packed(self) -> "LinearView":
        """The same with light and shares in half precision, for views that are kept in memory."""
        half = ("behind", "dark", "coverage", "gain", "lod")
        return replace(self, **{name: getattr(self, name).astype(np.float16) for name in half})
