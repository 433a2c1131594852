"""The second renderer: Open3D's Filament rasteriser through EGL, for comparison with the ray-cast one.

The scene is built once and only the camera moves. Post-processing is off, as it costs most of a frame on a software
driver; the picture comes back in linear 8 bit, so that its dark parts are coarser than the ray-cast renderer's.

EGL is asked for a display first, in another process: where it cannot start, Filament ends the one that asked.
"""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from toolkit.core.child import run_python
from toolkit.objects.mesh import Material, Mesh, load_open3d
from toolkit.rig.camera import Camera, orbit_direction
from toolkit.rig.renderer import Renderer
from toolkit.rig.scene import AT_ORIGIN, Scene, Stand, illuminate

if TYPE_CHECKING:
    from open3d.visualization.rendering import OffscreenRenderer


EGL_PLATFORM_SURFACELESS_MESA = 0x31DD


@lru_cache(maxsize=1)
def egl_trouble() -> str | None:
    """None where an EGL display opens without a screen, else the reason in a few words.

    Asked in a process of its own: a graphics driver that is loaded here would meet torch's libraries, and one that
    fails may end the process that asked.
    """
    # in a process of its own: a driver that crashes takes only that one down
    done = run_python("from toolkit.rig.filament import _probe; print(_probe())")
    if done.returncode < 0:
        return f"EGL's driver crashed (signal {-done.returncode})"
    return done.stdout.decode("utf-8", "replace").strip() or None


def go_surfaceless() -> None:
    """Tell Open3D's EGL to do without a display; has no effect once a renderer exists."""
    os.environ.setdefault("EGL_PLATFORM", "surfaceless")


def _probe() -> str:
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return "libEGL.so.1 is missing"
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    address = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    if not address:
        return "EGL has no platform displays"
    prototype = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)
    display = prototype(address)(EGL_PLATFORM_SURFACELESS_MESA, None, None)
    if not display:
        return "EGL has no surfaceless display"
    egl.eglInitialize.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
    if not egl.eglInitialize(display, None, None):
        return "EGL found no driver (is libgl1-mesa-dri installed?)"
    return ""


SUN_LUX, ROOM_LUX = 79_000, 27_000
"""Lux for an irradiance of 1 at exposure 1, from the key light and from the room: with these a matt box is as bright as
the ray caster shows it. Filament's own camera keeps its default exposure."""


class FilamentRenderer(Renderer):
    """Renders one object in one studio from any camera; hard-edged shadows, and silhouettes in steps.

    Filament antialiases in its post-processing alone, which is off here. `make_renderer` asks `egl_trouble` before.
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
        view.set_shadowing(True, rendering.View.ShadowType.PCF)
        strength = max(key.irradiance)
        direction = -orbit_direction(key.azimuth_deg, key.elevation_deg)
        tint = [c / strength for c in key.irradiance]
        lights.set_sun_light(direction.tolist(), tint, SUN_LUX * strength * exposure)
        lights.enable_sun_light(True)
        lights.enable_indirect_light(True)
        room = float(illuminate(self._scene.environment, replace(key, irradiance=(0, 0, 0))).mean())
        lights.set_indirect_light_intensity(ROOM_LUX * room * exposure)
        return renderer

    @staticmethod
    def _add(renderer: "OffscreenRenderer", name: str, mesh: Mesh, faces: np.ndarray, material: Material) -> None:
        o3d = load_open3d()

        used, inverse = np.unique(faces, return_inverse=True)
        local = inverse.reshape(-1, 3).astype(np.int32)
        shape = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(mesh.vertices[used].astype(float)), o3d.utility.Vector3iVector(local)
        )
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
    sys.stdout.flush()
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
