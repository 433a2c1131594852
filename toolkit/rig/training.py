"""Renders to train on: random camera, light and backdrop, never the poses of a plan."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from toolkit.console import progress
from toolkit.objects.load import load_object
from toolkit.objects.mesh import Mesh
from toolkit.rig.camera import Camera, distance_to_fill, orbit_pose
from toolkit.rig.finish import develop
from toolkit.rig.lighting import BakeDetail
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.renderer import make_renderer
from toolkit.rig.studio import LIGHTS, Studio, make_studio
from toolkit.workspace import Workspace

PER_STUDIO = 24
CAMERA = Camera(width=320, height=288, fov_deg=40.0)


@dataclass(frozen=True)
class ViewRanges:
    """Where a random camera may stand, lowest and highest; the azimuth is anywhere.

    Attributes:
        elevation_deg: above the table.
        roll_deg: about the line of sight.
        fill: share of the frame's shorter side that the object reaches; above 1 it is cut off.
        off_centre: the object's middle is shifted by up to this share of the half frame even where it fills it.
        evenly: elevations are drawn evenly over the sphere's area, not over the angle.
    """

    elevation_deg: tuple[float, float] = (20.0, 70.0)
    roll_deg: tuple[float, float] = (-8.0, 8.0)
    fill: tuple[float, float] = (0.6, 0.95)
    off_centre: float = 0.0
    evenly: bool = False

    def draw_elevation(self, rng: np.random.Generator) -> float:
        """Degrees above the table."""
        if not self.evenly:
            return rng.uniform(*self.elevation_deg)
        return float(np.degrees(np.arcsin(rng.uniform(*np.sin(np.radians(self.elevation_deg))))))


NEAR_VIEWS = ViewRanges()
WHOLE_SPHERE = ViewRanges((-90.0, 90.0), (-180.0, 180.0), (0.35, 0.95), 0.15, evenly=True)
WIDE_VIEWS = ViewRanges((5.0, 80.0), (-20.0, 20.0), (0.35, 1.05), 0.15)
THUMBNAIL_DETAIL = BakeDetail(key_rays=10, room_rays=40, surface_spacing=0.035, table_spacing=0.03)
"""Light for small pictures, in which finer shade is not seen."""
THUMBNAIL_TABLE_PX = 640
THUMBNAIL_ROOM_PX = 256


def render_training_images(
    workspace: Workspace, object_name: str, count: int, seed: int, quiet: bool = False
) -> Iterator[np.ndarray]:
    """Yield `count` renders of the bare object, (288, 320, 3) uint8 sRGB.

    Azimuth is anywhere, elevation 20-70°, the object fills 60-95 % of the shorter side, roll within ±8°, and the camera
    looks a little beside the object. Each `PER_STUDIO` images share a studio with its own backdrop and light. Image i
    depends on (seed, i) alone.

    Raises:
        ToolkitError: an unknown object, or a mesh that cannot be used.
    """
    item = load_object(workspace.object_spec(object_name))
    size = float(item.mesh.size_mm.max())
    with progress(f"rendering {object_name} to train on", count, quiet) as bar:
        for start in range(0, count, PER_STUDIO):
            renderer = make_renderer("raycast", item.mesh, random_studio(seed, start, size))
            for i in range(start, min(start + PER_STUDIO, count)):
                T_world_camera = random_pose(np.random.default_rng([seed, i, 2]), item.mesh, CAMERA)
                yield develop(renderer.render(CAMERA, T_world_camera), (seed, i))
                bar.advance()


def render_thumbnails(mesh: Mesh, count: int, seed: tuple[int, ...], camera: Camera) -> np.ndarray:
    """(count, height, width, 3) uint8 sRGB: small pictures of a mesh in one studio, from wide-ranging poses.

    Backdrop, light and the object's turn towards the light are drawn once, the camera for each picture. Light is worked
    out more coarsely than elsewhere, about eight times as fast. All depends on `seed` alone.

    Args:
        mesh: on the table.
        count: how many pictures.
        seed: of all draws.
        camera: of the pictures, up to about 256 px a side.
    """
    turned = turn_mesh(mesh, float(np.random.default_rng([*seed, 3]).uniform(0, 360)))
    light = str(np.random.default_rng([*seed, 1]).choice(list(LIGHTS)))
    studio = make_studio(seed, float(mesh.size_mm.max()), light=light)
    renderer = RaycastRenderer(turned, _coarsen_studio(studio), THUMBNAIL_DETAIL)
    pictures = np.empty((count, camera.height, camera.width, 3), np.uint8)
    for i in range(count):
        pose = random_pose(np.random.default_rng([*seed, 2, i]), turned, camera, WIDE_VIEWS)
        pictures[i] = develop(renderer.render(camera, pose), (*seed, 2, i))
    return pictures


def turn_mesh(mesh: Mesh, degrees: float) -> Mesh:
    """The mesh turned about the vertical axis, counter-clockwise from above."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]], np.float32)
    return replace(mesh, vertices=mesh.vertices @ rotation.T, normals=mesh.normals @ rotation.T)


def _coarsen_studio(studio: Studio) -> Studio:
    """The studio with pictures of table and room no finer than a thumbnail shows."""
    h, w = studio.table.shape[:2]
    scale = min(1.0, THUMBNAIL_TABLE_PX / w)
    table = cv2.resize(studio.table, (round(w * scale), round(h * scale)), interpolation=cv2.INTER_AREA)
    room_size = (THUMBNAIL_ROOM_PX, THUMBNAIL_ROOM_PX // 2)
    room = cv2.resize(studio.environment, room_size, interpolation=cv2.INTER_AREA)
    return replace(studio, table=np.asarray(table), environment=np.asarray(room))


def random_studio(seed: int, start: int, size_mm: float) -> Studio:
    """The studio of the images from number `start` on: any backdrop, any light."""
    light = str(np.random.default_rng([seed, start, 1]).choice(list(LIGHTS)))
    return make_studio((seed, start), size_mm, light=light)


def random_pose(rng: np.random.Generator, mesh: Mesh, camera: Camera, ranges: ViewRanges = NEAR_VIEWS) -> np.ndarray:
    """(4, 4) `T_world_camera` somewhere around an object, within `ranges`: by default `render_training_images`'s."""
    azimuth, elevation, roll = rng.uniform(0, 360), ranges.draw_elevation(rng), rng.uniform(*ranges.roll_deg)
    target = np.array([0.0, 0.0, mesh.size_mm[2] / 2])
    fill = rng.uniform(*ranges.fill)
    distance = distance_to_fill(camera, mesh.vertices, target, azimuth, elevation, fill, roll)
    free = max((1 - fill) * 0.5, ranges.off_centre) * distance * camera.height / 2 / camera.focal_px
    return orbit_pose(target + rng.uniform(-free, free, 3) * [1, 1, 0], azimuth, elevation, distance, roll)
