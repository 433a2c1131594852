"""The third renderer: Mitsuba 3, a path tracer, whose light no booster was trained in; pictures are denoised.

The ray caster bakes light and leaves out what bounces between surfaces. A path tracer follows it, and is far too slow
to train in. The noise of few samples alone makes networks err. So every picture goes through Open Image Denoise, guided
by colour and normals of what is seen (https://www.openimagedenoise.org).
"""

import os
from functools import cached_property, lru_cache
from importlib.metadata import version
from importlib.util import find_spec
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from toolkit.core.child import count_cores, run_python
from toolkit.core.errors import ToolkitError
from toolkit.imaging.colour import srgb_to_linear
from toolkit.objects.mesh import Material, Mesh
from toolkit.rig.camera import Camera, orbit_direction
from toolkit.rig.renderer import Renderer, view_from
from toolkit.rig.scene import AT_ORIGIN, Scene, Stand

if TYPE_CHECKING:
    import mitsuba

VARIANTS = ("llvm_ad_rgb", "scalar_rgb")
"""The first that starts is used. LLVM's takes a sixth of the time; `scalar_rgb` needs nothing beside the wheel."""
CUDA = "cuda_ad_rgb"
VARIABLE = "TOOLKIT_MITSUBA"
"""Names the variant, of `VARIANTS` or `CUDA`, which wants an NVIDIA GPU."""
LLVM_FIX = "sudo apt-get install libllvm19 && export DRJIT_LIBLLVM_PATH=/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1"
# a picture of a few pixels: with LLVM 15 and AVX-512, compiling its kernel ends the process
PROBE = """
import mitsuba
mitsuba.set_variant({!r})
box = mitsuba.cornell_box()
box["sensor"]["film"] |= dict(width=4, height=4)
print(mitsuba.render(mitsuba.load_dict(box), spp=1).array[0])
"""
SAMPLES = 16
"""Rays of a pixel. A square, as the sampler stratifies them in a grid, and a power of two: LLVM's threads then share no
pixel, so that sums have one order. `docs/how/renderers.md` compares the answers with those of 1,024 samples."""
BOUNCES = 8
KEY_AWAY = 60.0
"""Distance of the key light's disc in sizes of the scene: its rays then are parallel to a degree."""
SQUARE = 1e-3
"""Difference of a camera's two focal lengths, as a share, up to which its pixels count as square."""
Z_UP = [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
"""From Mitsuba's frame of pictures of all directions, y up and z in the middle, to the world's, z up and x there."""

_ONE_AT_A_TIME = Lock()


@lru_cache(maxsize=1)
def mitsuba_trouble() -> str | None:
    """None if Mitsuba and the denoiser start in other processes, else the reason in a few words."""
    missing = [name for name in ("mitsuba", "pyoidn") if find_spec(name) is None]
    if missing:
        return f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} not installed"
    chosen, known = choose_variant(), (*VARIANTS, CUDA)
    if chosen not in known:
        return f"{VARIABLE} is {chosen!r}: expected {', '.join(known)}"
    return probe_variant(chosen) or _probe("import pyoidn; pyoidn.Device().commit()")


@lru_cache
def choose_variant() -> str:
    """The variant that `VARIABLE` names, else the first of `VARIANTS` that starts here."""
    asked = os.environ.get(VARIABLE)
    return asked or next((name for name in VARIANTS if probe_variant(name) is None), VARIANTS[-1])


@lru_cache
def probe_variant(name: str) -> str | None:
    """None where a variant of Mitsuba starts and computes, else the reason in a few words."""
    return _probe(PROBE.format(name))


def _probe(code: str) -> str | None:
    # a shared library that crashes takes only that process down
    done = run_python(code)
    if done.returncode == 0:
        return None
    # what LLVM prints before it aborts is its own code
    lines = done.stderr.decode("utf-8", "replace").strip().splitlines() if done.returncode > 0 else []
    return lines[-1][:120] if lines else f"it ended with code {done.returncode}"


def describe_mitsuba() -> tuple[str, str]:
    """Version and variant, as manifests have them, and the line that brings a faster variant; empty if none is.

    Both are empty where Mitsuba does not start.
    """
    if mitsuba_trouble() is not None:
        return "", ""
    chosen = choose_variant()
    fix = LLVM_FIX if chosen == VARIANTS[-1] and not os.environ.get(VARIABLE) else ""
    return f"mitsuba {version('mitsuba')} {chosen}", fix


class MitsubaRenderer(Renderer):
    """Renders an object in a scene by path tracing; the same inputs give the same bytes on one machine."""

    def __init__(self, mesh: Mesh, scene: Scene, stand: Stand = AT_ORIGIN, samples: int = SAMPLES) -> None:
        """Keep what is rendered; `samples` are the rays of a pixel. `make_renderer` asks `mitsuba_trouble` before."""
        super().__init__(mesh, scene, stand)
        self._samples = samples

    def render(self, camera: Camera, T_world_camera: np.ndarray) -> np.ndarray:
        """(height, width, 3) float32 linear light times the scene's exposure, denoised.

        Raises:
            ToolkitError: the camera's pixels are not square, or it stands nowhere.
        """
        # each picture takes all cores by itself, also where callers ask from several threads
        with _ONE_AT_A_TIME:
            light, albedo, normal = self.trace(camera, T_world_camera)
            return denoise(light * np.float32(self._scene.exposure), albedo, normal)

    def trace(self, camera: Camera, T_world_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(h, w, 3) float32 noisy radiance, colour and normal of what each pixel shows; raises as `render`."""
        mi = _load()
        view_from(camera, T_world_camera)  # refuses a camera that is nowhere
        aovs = {"type": "aov", "aovs": "albedo:albedo,normal:sh_normal", "path": {"type": "path", "max_depth": BOUNCES}}
        picture = mi.render(
            self._built, sensor=_make_sensor(camera, T_world_camera), integrator=mi.load_dict(aovs), spp=self._samples,
            seed=0,
        )  # fmt: skip
        channels = np.asarray(picture, np.float32)
        light, albedo, normal = (np.ascontiguousarray(channels[..., k : k + 3]) for k in (0, 3, 6))
        return light, albedo, normal

    @cached_property
    def _built(self) -> "mitsuba.Scene":
        mi, scene = _load(), self._scene
        parts: dict[str, Any] = {"type": "scene", "room": _make_environment(scene.environment)}
        bodies = [self._mesh_in_world, *([scene.surroundings] if scene.surroundings is not None else [])]
        # a shape has a single material, so each material of a mesh becomes a shape
        for body, mesh in enumerate(bodies):
            for index, material in enumerate(mesh.materials):
                faces = mesh.faces[mesh.face_material == index]
                if len(faces):
                    parts[f"body{body}_{index}"] = _make_shape(mesh, faces, material, scene.lamps)
        # the key light stands away by the size of what it lights
        size = max(float(mesh.size_mm.max()) for mesh in bodies)
        if scene.table is not None:
            parts["table"] = self._make_table()
            size = max(size, *scene.table.size_mm)
        if max(scene.key.irradiance) > 0:
            parts["key"] = self._make_key(size)
        return mi.load_dict(parts)

    def _make_table(self) -> dict[str, Any]:
        top = self._scene.need_table()
        # Mitsuba's rectangle goes from -1 to 1
        scale = _load().ScalarTransform4f().scale([top.size_mm[0] / 2, top.size_mm[1] / 2, 1])
        return {
            "type": "rectangle", "to_world": scale,
            "bsdf": _make_bsdf(Material("table", top.picture[::-1], top.roughness)),
        }  # fmt: skip

    def _make_key(self, size: float) -> dict[str, Any]:
        mi, key = _load(), self._scene.key
        direction = orbit_direction(key.azimuth_deg, key.elevation_deg)
        target = self._mesh_in_world.bounds.mean(axis=0)
        away, radius = KEY_AWAY * size, np.tan(np.radians(key.radius_deg))
        # a disc of even radiance L that looks this large has the irradiance L pi sin² of its angle
        radiance = np.array(key.irradiance) / (np.pi * np.sin(np.radians(key.radius_deg)) ** 2)
        # any direction will do, but for the light's own
        up = [0, 0, 1] if abs(direction[2]) < 0.9 else [1, 0, 0]
        place = mi.ScalarTransform4f().look_at(
            origin=(target + away * direction).tolist(), target=target.tolist(), up=up
        ) @ mi.ScalarTransform4f().scale([away * radius, away * radius, 1])  # fmt: skip
        return {
            "type": "disk", "to_world": place,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance.tolist()}},
        }  # fmt: skip


def denoise(light: np.ndarray, albedo: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(h, w, 3) float32 light without its noise, guided by the colour and the normal of what is seen."""
    import pyoidn

    return np.asarray(pyoidn.denoise(light, albedo=albedo, normal=normal, hdr=True), np.float32)


def _load() -> Any:
    """Mitsuba, with the variant chosen in this thread: loaded where it is used."""
    import drjit
    import mitsuba as mi

    variant = choose_variant()
    if mi.variant() != variant:
        mi.set_variant(variant)
        drjit.set_thread_count(count_cores())
    return mi


def _make_sensor(camera: Camera, T_world_camera: np.ndarray) -> "mitsuba.Sensor":
    if abs(camera.fx / camera.fy - 1) > SQUARE:
        raise ToolkitError(
            f"the renderer mitsuba wants square pixels, and the camera has fx {camera.fx:g} and fy {camera.fy:g}: "
            "use the renderer raycast"
        )
    mi = _load()
    # its camera looks along z as OpenCV's does, but x points left and y up
    pose = np.asarray(T_world_camera, np.float64) @ np.diag([-1.0, -1, 1, 1])
    film = {
        "type": "hdrfilm", "width": camera.width, "height": camera.height, "pixel_format": "rgb",
        "component_format": "float32", "rfilter": {"type": "box"},
    }  # fmt: skip
    return mi.load_dict({
        "type": "perspective", "fov": float(np.degrees(2 * np.arctan(camera.width / 2 / camera.fx))), "fov_axis": "x",
        "principal_point_offset_x": 0.5 - camera.cx / camera.width,
        "principal_point_offset_y": 0.5 - camera.cy / camera.height,
        "near_clip": 1e-3, "far_clip": 1e7, "to_world": mi.ScalarTransform4f(pose.tolist()), "film": film,
        "sampler": {"type": "multijitter"},
    })  # fmt: skip


def _make_environment(environment: np.ndarray) -> dict[str, Any]:
    mi = _load()
    bitmap = mi.Bitmap(np.ascontiguousarray(environment, np.float32))
    return {"type": "envmap", "bitmap": bitmap, "to_world": mi.ScalarTransform4f(Z_UP)}


def _make_texture(picture: np.ndarray) -> dict[str, Any]:
    """A texture of (h, w, 3) uint8 sRGB pixels, row 0 at v = 0."""
    return {"type": "bitmap", "bitmap": _load().Bitmap(np.array(picture, np.uint8, order="C")), "raw": False}


def _make_bsdf(material: Material) -> dict[str, Any]:
    return {
        "type": "twosided",
        "nested": {
            "type": "principled", "base_color": _make_texture(material.texture), "roughness": float(material.roughness),
            "metallic": float(material.metallic), "specular": 0.5,  # 0.04 at normal incidence, as glTF has it
        },
    }  # fmt: skip


def _make_shape(mesh: Mesh, faces: np.ndarray, material: Material, lamps: float) -> "mitsuba.Mesh":
    mi = _load()
    used, inverse = np.unique(faces, return_inverse=True)
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(_make_bsdf(material))
    # what a lamp gives off is its picture in linear light, times how brightly lamps burn
    if material.emission is not None and lamps > 0:
        glow = srgb_to_linear(material.emission / np.float32(255)) * np.float32(lamps)
        radiance = {"type": "bitmap", "bitmap": mi.Bitmap(np.ascontiguousarray(glow, np.float32)), "raw": True}
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": radiance})
    shape = mi.Mesh(
        material.name, len(used), len(faces), properties, has_vertex_normals=True, has_vertex_texcoords=True
    )
    # its arrays are flat, and filled by their names
    values = mi.traverse(shape)
    # its pictures have row 0 at v = 0, ours at v = 1
    uv = np.nan_to_num(mesh.uv[used]) * [1, -1] + [0, 1]
    for name, array in (
        ("vertex_positions", mesh.vertices[used]), ("vertex_normals", np.nan_to_num(mesh.normals[used])),
        ("vertex_texcoords", uv),
    ):  # fmt: skip
        values[name] = np.ascontiguousarray(array, np.float32).ravel()
    values["faces"] = inverse.astype(np.uint32).ravel()
    values.update()
    return shape
