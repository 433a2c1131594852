"""What a renderer is to the rest of the kit, and how to get one by name."""

from collections.abc import Iterable, Iterator
from typing import Protocol

import numpy as np

from toolkit.core.errors import one_of
from toolkit.objects.mesh import Mesh
from toolkit.rig.camera import Camera
from toolkit.rig.scene import Scene

RENDERERS = ("raycast", "filament")


class Renderer(Protocol):
    """One object in one studio, seen from any camera."""

    def render(self, camera: Camera, T_world_camera: np.ndarray) -> np.ndarray:
        """(height, width, 3) float32 linear light in exposure units, 1 is white; not clipped."""
        ...

    def render_many(self, views: Iterable[tuple[Camera, np.ndarray]]) -> Iterator[np.ndarray]:
        """`render` of each (camera, `T_world_camera`), in order; the same pictures, faster where there are cores."""
        ...


def make_renderer(name: str, mesh: Mesh, studio: Scene) -> Renderer:
    """Build a scene for rendering.

    Args:
        name: `raycast` (exact buffers, soft baked light; no graphics driver) or `filament` (Open3D's EGL rasteriser).
        mesh: the object on its table, boosters attached.
        studio: light, table and room.

    Raises:
        ToolkitError: an unknown name, or EGL cannot start.
    """
    if name == "raycast":
        from toolkit.rig.raycast import RaycastRenderer

        return RaycastRenderer(mesh, studio, keep_light=True)
    if name == "filament":
        from toolkit.rig.filament import FilamentRenderer

        return FilamentRenderer(mesh, studio)
    raise one_of("renderer", name, list(RENDERERS))
