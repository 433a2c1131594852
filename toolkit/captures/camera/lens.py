"""The lens of a real camera: focal lengths, principal point and distortion, in pixels of its pictures.

Convention: OpenCV's model; pixel (0, 0) is the upper left one and its centre lies at (0.5, 0.5), so that the middle of
a picture is (width / 2, height / 2). OpenCV's own detectors put that centre at (0, 0): add a half to what they find.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from toolkit.errors import ToolkitError
from toolkit.rig.camera import Camera

FULL_FRAME_DIAGONAL_MM = 43.2666
"""Of 36 × 24 mm. A 35 mm-equivalent focal length is taken as the one with the same *diagonal* angle of view, as CIPA's
DCG-001 has it and phones write it."""

SAME_ASPECT = 0.01
"""Relative difference of aspect ratios up to which two pictures are of the same frame at two sizes."""


@dataclass(frozen=True)
class Lens:
    """Intrinsics of pictures of one size.

    Attributes:
        width, height: pixels.
        fx, fy, cx, cy: pixels.
        distortion: OpenCV's k1, k2, p1, p2, k3.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) camera matrix K."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def coefficients(self) -> np.ndarray:
        """(5,) k1, k2, p1, p2, k3, as OpenCV's functions take them."""
        return np.array(self.distortion, float)

    @property
    def fov_deg(self) -> float:
        """Horizontal angle of view in degrees, distortion left out."""
        return float(np.degrees(np.arctan(self.cx / self.fx) + np.arctan((self.width - self.cx) / self.fx)))

    @property
    def intrinsics(self) -> dict[str, float]:
        """Width, height, fx, fy, cx, cy in pixels, as a manifest holds them; distortion left out."""
        return {
            "width": self.width, "height": self.height, "fx": self.fx, "fy": self.fy, "cx": self.cx, "cy": self.cy,
        }  # fmt: skip

    def project(self, T_world_camera: np.ndarray, points_mm: np.ndarray) -> np.ndarray:
        """(n, 2) pixels of world points (n, 3), distortion included; points behind the camera give NaN."""
        local = (np.asarray(points_mm, float).reshape(-1, 3) - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
        pixels = np.full((len(local), 2), np.nan)
        ahead = local[:, 2] > 1e-6
        if ahead.any():
            found, _ = cv2.projectPoints(local[ahead], np.zeros(3), np.zeros(3), self.matrix, self.coefficients)
            pixels[ahead] = found.reshape(-1, 2)
        return pixels

    def undistort(self, pixels: np.ndarray) -> np.ndarray:
        """(n, 2) directions x/z, y/z in camera axes of pixels (n, 2)."""
        points = np.ascontiguousarray(pixels, float).reshape(-1, 1, 2)
        found = cv2.undistortPoints(points, self.matrix, self.coefficients)
        return found.reshape(-1, 2)

    def scaled(self, width: int, height: int) -> "Lens":
        """The same lens in pictures of another size and the same shape.

        Raises:
            ToolkitError: the shapes differ, so that one is a crop of the other in a way that is not known.
        """
        if not same_aspect((self.width, self.height), (width, height)):
            raise ToolkitError(
                f"a lens of {self.width}x{self.height} px says nothing of {width}x{height} px, another shape: "
                f"calibrate with photos of that size"
            )
        across, down = width / self.width, height / self.height
        return replace(
            self, width=width, height=height, fx=self.fx * across, fy=self.fy * down, cx=self.cx * across,
            cy=self.cy * down,
        )  # fmt: skip

    def rotated(self, quarter_turns: int = 1) -> "Lens":
        """The same lens in pictures turned clockwise by so many quarter turns, as EXIF's orientation 6 asks for one."""
        lens = self
        for _ in range(quarter_turns % 4):
            k1, k2, p1, p2, k3 = lens.distortion
            # the tangential part (p2, p1) is a vector in the picture and turns with it
            lens = Lens(
                lens.height, lens.width, lens.fy, lens.fx, lens.height - lens.cy, lens.cx, (k1, k2, p2, -p1, k3)
            )
        return lens


def same_aspect(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two picture sizes (width, height) have the same shape."""
    return abs(one[0] * other[1] / (one[1] * other[0]) - 1) < SAME_ASPECT


def lens_of_camera(camera: Camera) -> Lens:
    """The rig's pinhole camera as a lens."""
    return Lens(camera.width, camera.height, camera.focal_px, camera.focal_px, camera.width / 2, camera.height / 2)


def lens_from_focal(width: int, height: int, focal_35mm_mm: float) -> Lens:
    """A lens without distortion from its 35 mm-equivalent focal length.

    Phones round it to a whole millimetre (2 % at 26 mm, and so are distances), and a picture cropped from the sensor's
    frame, as 16:9 mostly is, may carry the full frame's number: a calibrated lens is better.
    """
    focal_px = focal_35mm_mm / FULL_FRAME_DIAGONAL_MM * float(np.hypot(width, height))
    return Lens(width, height, focal_px, focal_px, width / 2, height / 2)


def lens_from_sensor(width: int, height: int, focal_mm: float, sensor_width_mm: float) -> Lens:
    """A lens without distortion from its true focal length and the sensor's longer side, both in mm."""
    focal_px = focal_mm / sensor_width_mm * max(width, height)
    return Lens(width, height, focal_px, focal_px, width / 2, height / 2)


def lens_from_exif(photo, sensor_width_mm: float | None = None) -> Lens | None:
    """The lens that a photograph's own metadata describes, None where they do not say enough.

    Args:
        photo: a `toolkit.captures.photos.photo.Photo`: upright size, `focal_35mm_mm` and `focal_mm` are read.
        sensor_width_mm: longer side of the sensor; with it the true focal length is used, which is not rounded.
    """
    if sensor_width_mm and photo.focal_mm:
        return lens_from_sensor(photo.width, photo.height, photo.focal_mm, sensor_width_mm)
    if photo.focal_35mm_mm:
        return lens_from_focal(photo.width, photo.height, photo.focal_35mm_mm)
    return None
