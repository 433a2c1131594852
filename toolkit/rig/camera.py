"""A pinhole camera in OpenCV's convention.

Convention: camera axes are x right, y down, z forward. The centre of the upper left pixel is (0.5, 0.5).
`T_world_camera` maps camera points to the world, millimetres.
"""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace

import numpy as np

Distortion = tuple[float, float, float, float, float]
NO_DISTORTION: Distortion = (0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Camera:
    """Intrinsics of pictures of a size, as OpenCV has them; the renderers leave distortion out.

    Attributes:
        width, height: pixels.
        fx, fy: focal lengths, pixels.
        cx, cy: principal point, pixels.
        distortion: k1, k2, p1, p2, k3.
    """

    width: int
    height: int
    _: KW_ONLY
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Distortion = NO_DISTORTION

    @classmethod
    def from_fov(cls, width: int = 640, height: int = 480, fov_deg: float = 40.0) -> "Camera":
        """Square pixels and a centred lens of this horizontal field of view."""
        return cls.from_focal_px(width, height, width / 2 / float(np.tan(np.radians(fov_deg) / 2)))

    @classmethod
    def from_focal_mm(cls, width: int, height: int, focal_mm: float, sensor_width_mm: float) -> "Camera":
        """Square pixels and a centred lens of this focal length over a sensor as wide as the picture."""
        return cls.from_fov(width, height, 2 * float(np.degrees(np.arctan(sensor_width_mm / 2 / focal_mm))))

    @classmethod
    def from_focal_px(cls, width: int, height: int, focal_px: float) -> "Camera":
        """Square pixels and a centred lens of this focal length in pixels."""
        return cls(width, height, fx=focal_px, fy=focal_px, cx=width / 2, cy=height / 2)

    @classmethod
    def from_intrinsics(cls, intrinsics: Mapping[str, float], distortion: Sequence[float] = ()) -> "Camera":
        """The camera of a manifest's line: width, height, fx, fy, cx, cy in pixels; missing coefficients are 0."""
        fx, fy, cx, cy = (float(intrinsics[name]) for name in ("fx", "fy", "cx", "cy"))
        # OpenCV's order, in which the third radial term comes last
        k1, k2, p1, p2, k3 = [*distortion, *NO_DISTORTION][:5]
        width, height = round(intrinsics["width"]), round(intrinsics["height"])
        return cls(width, height, fx=fx, fy=fy, cx=cx, cy=cy, distortion=(k1, k2, p1, p2, k3))

    @property
    def intrinsics(self) -> dict[str, float]:
        """Width, height, fx, fy, cx, cy in pixels, as a manifest holds them; distortion left out."""
        return {
            "width": self.width, "height": self.height, "fx": self.fx, "fy": self.fy, "cx": self.cx, "cy": self.cy,
        }  # fmt: skip

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
        """Horizontal field of view, distortion left out; rounded, so that 40 degrees in are 40 degrees out."""
        # both halves apart: the centre need not lie in the middle
        return round(float(np.degrees(np.arctan(self.cx / self.fx) + np.arctan((self.width - self.cx) / self.fx))), 12)

    def scaled(self, width: int, height: int) -> "Camera":
        """The same lens in pictures of another size: x and y each scale by what the size does."""
        across, down = width / self.width, height / self.height
        return replace(
            self, width=width, height=height, fx=self.fx * across, fy=self.fy * down, cx=self.cx * across,
            cy=self.cy * down,
        )  # fmt: skip

    def cropped(self, left: float, top: float, width: int, height: int) -> "Camera":
        """The same lens in a part of its pictures, whose corner lies `left` and `top` pixels from theirs."""
        return replace(self, width=width, height=height, cx=self.cx - left, cy=self.cy - top)

    def rotated(self, quarter_turns: int = 1) -> "Camera":
        """The same lens in pictures turned clockwise by so many quarter turns; EXIF's orientation 6 is 1 turn."""
        turned = self
        for _ in range(quarter_turns % 4):
            k1, k2, p1, p2, k3 = turned.distortion
            # the tangential part (p2, p1) is a vector in the picture and turns with it
            turned = Camera(
                turned.height, turned.width, fx=turned.fy, fy=turned.fx, cx=turned.height - turned.cy, cy=turned.cx,
                distortion=(k1, k2, p2, -p1, k3),
            )  # fmt: skip
        return turned

    def project(self, T_world_camera: np.ndarray, points_mm: np.ndarray) -> np.ndarray:
        """(n, 2) pixels of world points (n, 3), distortion included; points behind the camera give NaN."""
        import cv2

        local = (np.asarray(points_mm, float).reshape(-1, 3) - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
        pixels = np.full((len(local), 2), np.nan)
        # OpenCV would mirror points behind the camera into the picture
        ahead = local[:, 2] > 1e-6
        if ahead.any():
            found, _ = cv2.projectPoints(local[ahead], np.zeros(3), np.zeros(3), self.matrix, self.coefficients)
            pixels[ahead] = found.reshape(-1, 2)
        return pixels

    def undistort(self, pixels: np.ndarray) -> np.ndarray:
        """(n, 2) directions x/z, y/z in camera axes of pixels (n, 2)."""
        import cv2

        points = np.ascontiguousarray(pixels, float).reshape(-1, 1, 2)
        found = cv2.undistortPoints(points, self.matrix, self.coefficients)
        return found.reshape(-1, 2)


def as_quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return (4,) w x y z of a rotation matrix (3, 3), w not negative."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(rotation).as_quat(canonical=True), 1)


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
    # straight down or up no direction in the picture is "up": the azimuth says which
    upright = abs(forward[2]) < 1 - 1e-9
    up = np.array([0.0, 0.0, 1.0]) if upright else np.sign(forward[2]) * orbit_direction(azimuth_deg, 0)
    # OpenCV's axes: x right, y down, z forward
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
    """Pixel coordinates (n, 2), without distortion, and depths (n,) in mm of world points (n, 3).

    Points behind the camera have depth <= 0.
    """
    local = (np.asarray(points_mm, float) - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    depth = local[:, 2]
    safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
    pixels = local[:, :2] / safe[:, None] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    return pixels, depth


def pixel_rays(camera: Camera, T_world_camera: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(n, 6) float32 rays, origin and unit direction in the world, through undistorted pixel coordinates (n, 2)."""
    local = np.empty((len(pixels), 3), np.float32)
    centre, focal = np.array([[camera.cx, camera.cy], [camera.fx, camera.fy]], np.float32)
    local[:, :2] = (pixels - centre) / focal
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

    The shorter side is what a classifier's square centre crop keeps; distortion is left out. Closed form: a point at
    (X, Y, z) from the target in camera axes stays inside the square of side S where d >= f·max(|X|, |Y|) / (fill·S/2)
    - z, with the room on each side of the principal point in place of S/2 where the lens is not centred.

    Args:
        points_mm: (n, 3) of the object.
        target_mm: (3,) what the camera looks at.
        fill: in (0, 1).
    """
    rotation = orbit_pose(np.zeros(3), azimuth_deg, elevation_deg, 1.0, roll_deg)[:3, :3]
    # in camera axes about the target: at distance d a point lies at depth d + z, its image at f |x| / (d + z)
    x, y, z = ((np.asarray(points_mm, float) - target_mm) @ rotation).T
    half = min(camera.width, camera.height) / 2
    # solved for d where the image reaches fill * half; the point that asks for the most decides
    depth = np.zeros_like(z)
    for side, focal_px, aside in (
        (x, camera.fx, camera.cx - camera.width / 2), (y, camera.fy, camera.cy - camera.height / 2),
    ):  # fmt: skip
        for sign in (1, -1):
            room = max(fill * half - sign * aside, 1e-6)  # none where the target itself lies outside the square
            depth = np.maximum(depth, sign * side * focal_px / room)
    return float((depth - z).max())
