"""The second renderer: Open3D's Filament rasteriser, for comparison with the ray caster.

The scene is built once and only the camera moves. Post-processing is off, as it costs most of a frame on a software
driver. The picture comes back in linear 8 bit: its dark parts are coarser than the ray-cast renderer's.
"""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from toolkit.objects.mesh import Material, Mesh, load_open3d
from toolkit.rig.camera import Camera, orbit_direction
from toolkit.rig.graphics import go_surfaceless
from toolkit.rig.renderer import Renderer
from toolkit.rig.scene import AT_ORIGIN, Scene, Stand, illuminate

if TYPE_CHECKING:
    from open3d.visualization.rendering import OffscreenRenderer


SUN_LUX, ROOM_LUX = 79_000, 27_000
"""Lux for an irradiance of 1 at exposure 1, from the key light and from the room. A matt box is then as bright as in
the ray caster. Filament's own camera keeps its default exposure."""


class FilamentRenderer(Renderer):
    """Renders an object in a studio from any camera; hard-edged shadows, and silhouettes in steps.

    Filament antialiases in its post-processing alone, which is off here. `make_renderer` asks
    `graphics_trouble` before.
    """

    def __init__(self, mesh: Mesh, studio: Scene, stand: Stand = AT_ORIGIN) -> None:
        with contextlib.suppress(ImportError):  # torch's compiler, loaded after Mesa's, would end the process
            import triton  # noqa: F401
        go_surfaceless()
        super().__init__(mesh, studio, stand)
        self._renderer: OffscreenRenderer | None = None
        self._size = (0, 0)

    def render(self, camera: Camera, T_world_camera: np.ndarray) -> np.ndarray:
        """(height, width, 3) float32 linear light, in steps of 1/255."""
        if self._renderer is None or self._size != (camera.width, camera.height):
            self._renderer = None  # Filament keeps one scene at a time
            with _on_stderr():
                self._renderer = self._build(camera.width, camera.height)
            self._size = (camera.width, camera.height)
        # Open3D asks for the extrinsics, world to camera
        T_camera_world = np.linalg.inv(T_world_camera)
        self._renderer.setup_camera(camera.matrix, T_camera_world, camera.width, camera.height)
        return np.asarray(self._renderer.render_to_image()).astype(np.float32) / 255

    def _build(self, width: int, height: int) -> "OffscreenRenderer":
        o3d = load_open3d()

        rendering = o3d.visualization.rendering
        renderer = rendering.OffscreenRenderer(width, height)
        key, exposure = self._scene.key, self._scene.exposure
        # Filament has no room of its own: its background is the room's mean colour
        mean_room = self._scene.environment.mean(axis=(0, 1)) * exposure
        renderer.scene.set_background([*np.clip(mean_room, 0, 1).tolist(), 1.0])
        mesh = self._mesh_in_world
        for index, material in enumerate(mesh.materials):
            faces = mesh.faces[mesh.face_material == index]
            if len(faces):
                self._add(renderer, f"part{index}", mesh, faces, material)
        self._add_table(renderer)
        view, lights = renderer.scene.view, renderer.scene.scene
        view.set_post_processing(False)
        view.set_sample_count(1)  # Open3D 0.20 takes four, and its silhouettes would grow by a third of a pixel
        view.set_shadowing(True, rendering.View.ShadowType.PCF)
        # lux and colour apart: the strongest channel carries the intensity
        strength = max(key.irradiance)
        direction = -orbit_direction(key.azimuth_deg, key.elevation_deg)
        tint = [c / strength for c in key.irradiance]
        lights.set_sun_light(direction.tolist(), tint, SUN_LUX * strength * exposure)
        lights.enable_sun_light(True)
        lights.enable_indirect_light(True)
        # the room's light is what is left of the irradiance without the key light
        room = float(illuminate(self._scene.environment, replace(key, irradiance=(0, 0, 0))).mean())
        lights.set_indirect_light_intensity(ROOM_LUX * room * exposure)
        return renderer

    @staticmethod
    def _add(renderer: "OffscreenRenderer", name: str, mesh: Mesh, faces: np.ndarray, material: Material) -> None:
        o3d = load_open3d()

        # the faces of a material become a mesh of their own, with the vertices that they use
        used, inverse = np.unique(faces, return_inverse=True)
        local = inverse.reshape(-1, 3).astype(np.int32)
        shape = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(mesh.vertices[used].astype(float)), o3d.utility.Vector3iVector(local)
        )
        # a face brings its own three texture coordinates, as seams need
        shape.vertex_normals = o3d.utility.Vector3dVector(mesh.normals[used].astype(float))
        shape.triangle_uvs = o3d.utility.Vector2dVector(mesh.uv[faces].reshape(-1, 2).astype(float))
        look = o3d.visualization.rendering.MaterialRecord()
        look.shader = "defaultLit"
        look.albedo_img = o3d.geometry.Image(np.ascontiguousarray(material.texture))
        look.base_roughness, look.base_metallic = float(material.roughness), float(material.metallic)
        renderer.scene.add_geometry(name, shape, look)

    def _add_table(self, renderer: "OffscreenRenderer") -> None:
        top = self._scene.need_table()
        x, y = (side / 2 for side in top.size_mm)
        corners = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]], np.float32)
        uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
        material = Material("table", top.picture, top.roughness)
        up = np.repeat(np.array([[0, 0, 1]], np.float32), 4, axis=0)
        faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
        table = Mesh(
            vertices=corners, normals=up, uv=uv, faces=faces, face_material=np.zeros(2, np.int32), materials=(material,)
        )
        self._add(renderer, "table", table, faces, material)


@contextlib.contextmanager
def _on_stderr() -> Iterator[None]:
    """Within, what libraries write to standard output goes to standard error.

    Open3D says hello there through Python, Filament through C.
    """
    # what Python still holds would come out in the wrong place later
    sys.stdout.flush()
    # by descriptor, since C's output does not go through Python
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        # before the descriptor is put back, or it would come out on standard output after all
        ctypes.CDLL(None).fflush(None)  # what C's streams still hold
        os.dup2(kept, 1)
        os.close(kept)
