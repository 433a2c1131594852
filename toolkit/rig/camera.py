"""A pinhole camera in OpenCV's convention.

Convention: camera axes x right, y down, z forward; pixel (0, 0) is the upper left one and its centre lies at
(0.5, 0.5); `T_world_camera` maps camera points to the world, millimetres.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Camera:
    """Intrinsics without distortion: square pixels and a centred lens, unless the last two fields say otherwise.

    Attributes:
        width, height: pixels.
        fov_deg: horizontal field of view of a frame of that width with the lens at its middle.
        aspect: focal length in pixels along y over that along x.
        centre_px: (x, y) of the principal point; None is the middle of the frame.
    """

    width: int = 640
    height: int = 480
    fov_deg: float = 40.0
    aspect: float = 1.0
    centre_px: tuple[float, float] | None = None

    @property
    def focal_px(self) -> float:
        """Focal length in pixels along x."""
        return self.width / 2 / float(np.tan(np.radians(self.fov_deg) / 2))

    @property
    def focals_px(self) -> tuple[float, float]:
        """Focal lengths in pixels along x and y."""
        return self.focal_px, self.focal_px * self.aspect

    @property
    def principal_px(self) -> tuple[float, float]:
        """(x, y) of the principal point."""
        return self.centre_px or (self.width / 2, self.height / 2)

    @property
    def intrinsics(self) -> dict[str, float]:
        """Width, height, fx, fy, cx, cy in pixels."""
        (fx, fy), (cx, cy) = self.focals_px, self.principal_px
        return {"width": self.width, "height": self.height, "fx": fx, "fy": fy, "cx": cx, "cy": cy}

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) camera matrix K."""
        (fx, fy), (cx, cy) = self.focals_px, self.principal_px
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def camera_of_intrinsics(width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> Camera:
    """The camera with this matrix, all in pixels."""
    fov_deg = 2 * float(np.degrees(np.arctan(width / 2 / fx)))
    return Camera(int(width), int(height), fov_deg, float(fy / fx), (float(cx), float(cy)))


def orbit_direction(azimuth_deg: float, elevation_deg: float) -> np.ndarray:
    """(3,) unit vector from the object to the camera: azimuth 0 is +x, counter-clockwise from above."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    return np.array(
        [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
    )  # fmt: skip


def look_at(
    position_mm: np.ndarray, target_mm: np.ndarray, roll_deg: float = 0.0, azimuth_deg: float = 0.0
) -> np.ndarray:
    """(4, 4) `T_world_camera` of a camera at `position_mm` that sees `target_mm` at its centre.

    The image's up is the world's; straight above or below it is the way that `azimuth_deg` comes there. A positive roll
    turns the camera clockwise as the photographer feels it, so that the scene turns counter-clockwise in the image.
    """
    forward = np.asarray(target_mm, float) - position_mm
    forward /= np.linalg.norm(forward)
    upright = abs(forward[2]) < 1 - 1e-9
    up = np.array([0.0, 0.0, 1.0]) if upright else np.sign(forward[2]) * orbit_direction(azimuth_deg, 0)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    cosine, sine = np.cos(np.radians(roll_deg)), np.sin(np.radians(roll_deg))
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3] = np.stack([cosine * right + sine * down, cosine * down - sine * right, forward], axis=1)
    T_world_camera[:3, 3] = position_mm
    return T_world_camera


def orbit_pose(
    target_mm: np.ndarray, azimuth_deg: float, elevation_deg: float, distance_mm: float, roll_deg: float = 0.0
) -> np.ndarray:
    """(4, 4) `T_world_camera` of a camera that orbits `target_mm`."""
    position = np.asarray(target_mm, float) + distance_mm * orbit_direction(azimuth_deg, elevation_deg)
    return look_at(position, target_mm, roll_deg, azimuth_deg)


def project(camera: Camera, T_world_camera: np.ndarray, points_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixel coordinates (n, 2) and depths (n,) in mm of world points (n, 3); points behind have depth <= 0."""
    local = (np.asarray(points_mm, float) - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    depth = local[:, 2]
    safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
    pixels = local[:, :2] / safe[:, None] * camera.focals_px + camera.principal_px
    return pixels, depth


def pixel_rays(camera: Camera, T_world_camera: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(n, 6) float32 rays, origin and unit direction in the world, through pixel coordinates (n, 2)."""
    local = np.empty((len(pixels), 3), np.float32)
    local[:, :2] = (pixels - np.array(camera.principal_px, np.float32)) / np.array(camera.focals_px, np.float32)
    local[:, 2] = 1
    directions = local @ T_world_camera[:3, :3].T.astype(np.float32)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origin = np.broadcast_to(T_world_camera[:3, 3].astype(np.float32), directions.shape)
    return np.concatenate([origin, directions], axis=1)


def distance_to_fill(
    camera: Camera, points_mm: np.ndarray, target_mm: np.ndarray, azimuth_deg: float, elevation_deg: float,
    fill: float, roll_deg: float = 0.0,
) -> float:  # fmt: skip
    """The distance at which the points reach `fill` of the frame's shorter side, across or up, and no further.

    For a camera with square pixels and a centred lens, as those of plans are. The shorter side is what a classifier's
    square centre crop keeps. Closed form: a point at (X, Y, z) from the target
    in camera axes stays inside the square of side S where d >= f·max(|X|, |Y|) / (fill·S/2) - z.

    Args:
        camera: gives focal length and frame.
        points_mm: (n, 3) of the object.
        target_mm: (3,) what the camera looks at.
        azimuth_deg, elevation_deg, roll_deg: from where.
        fill: in (0, 1).
    """
    rotation = orbit_pose(np.zeros(3), azimuth_deg, elevation_deg, 1.0, roll_deg)[:3, :3]
    x, y, z = ((np.asarray(points_mm, float) - target_mm) @ rotation).T
    half = min(camera.width, camera.height) / 2
    across = np.maximum(np.abs(x), np.abs(y)) / half * camera.focal_px / fill
    return float((across - z).max())
