"""Renders of an object to train on: random camera, light and backdrop, never the poses of a plan."""

from collections.abc import Iterator

import numpy as np

from toolkit.console import progress
from toolkit.objects.load import load_object
from toolkit.objects.mesh import Mesh
from toolkit.rig.camera import Camera, distance_to_fill, orbit_pose
from toolkit.rig.finish import develop
from toolkit.rig.renderer import make_renderer
from toolkit.rig.studio import LIGHTS, Studio, make_studio
from toolkit.workspace import Workspace

PER_STUDIO = 24
CAMERA = Camera(width=320, height=288, fov_deg=40.0)


def render_training_images(
    workspace: Workspace, object_name: str, count: int, seed: int, quiet: bool = False
) -> Iterator[np.ndarray]:
    """Yield `count` renders of the bare object, (288, 320, 3) uint8 sRGB.

    Azimuth is anywhere, elevation 15-75°, the object fills 50-95 % of the shorter side, roll within ±8°, and the camera
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


def random_studio(seed: int, start: int, size_mm: float) -> Studio:
    """The studio of the images from number `start` on: any backdrop, any light."""
    light = str(np.random.default_rng([seed, start, 1]).choice(list(LIGHTS)))
    return make_studio((seed, start), size_mm, light=light)


def random_pose(rng: np.random.Generator, mesh: Mesh, camera: Camera) -> np.ndarray:
    """(4, 4) `T_world_camera` somewhere around an object, within the ranges of `render_training_images`."""
    azimuth, elevation, roll = rng.uniform(0, 360), rng.uniform(15, 75), rng.uniform(-8, 8)
    target = np.array([0.0, 0.0, mesh.size_mm[2] / 2])
    fill = rng.uniform(0.5, 0.95)
    distance = distance_to_fill(camera, mesh.vertices, target, azimuth, elevation, fill, roll)
    free = (1 - fill) * 0.5 * distance * camera.height / 2 / camera.focal_px
    return orbit_pose(target + rng.uniform(-free, free, 3) * [1, 1, 0], azimuth, elevation, distance, roll)
