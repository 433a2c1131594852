"""The rig's renderer: Embree finds what each ray meets (Open3D's ray scene), one compiled kernel makes light of it.

Light that does not change with the camera is baked once; what is left per frame is which surface each pixel sees, its
texture at the right level of detail, and the gloss. Silhouettes, creases and printed sheets get four samples a pixel.
"""

import os
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Lock
from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import Material, Mesh
from toolkit.rig.camera import Camera, orbit_direction, orbit_pose, project
from toolkit.rig.kernel import compiled
from toolkit.rig.kernel.frame import (
    NOTHING,
    Hits,
    Linear,
    Part,
    fill_pixel_rays,
    fill_sample_rays,
    mark_edges,
    paint_background,
    paint_object,
)
from toolkit.rig.kernel.light import LightMap
from toolkit.rig.kernel.scene import ROUGHNESS_LEVELS, LitMesh, Surround, View, find_table_edges
from toolkit.rig.kernel.textures import Texels, fill_colours
from toolkit.rig.lighting import FULL_DETAIL, BakeDetail, Lighting, Shape, bake_lighting
from toolkit.rig.linear_view import LinearView
from toolkit.rig.mount import PAPER_MATERIAL
from toolkit.rig.scene import KeyLight, Scene, Table
from toolkit.rig.textures import blur_directions, pack_textures

LIGHT_MAP_ZOOM = 2
"""The table's light is kept so many times as fine as it was baked, smoothly filled in."""
FARTHEST = 1e9
"""Coordinates of a camera at most; float32 holds them to some tens of units."""


class _Paint(NamedTuple):
    """What is painted on a mesh, ready for the kernel; the mesh itself keeps its arrays alive."""

    mesh: Mesh
    texels: Texels
    texture: np.ndarray
    density: np.ndarray
    mean_colour: np.ndarray


class RaycastRenderer:
    """Renders one object in one scene from any camera.

    What is worked out of a shape or a texture is kept for the next renderer that has the same.
    """

    def __init__(self, mesh: Mesh, scene: Scene, detail: BakeDetail = FULL_DETAIL, turn_deg: float = 0.0) -> None:
        """Bake the light.

        Args:
            mesh: on the table.
            scene: what it stands in.
            detail: how finely light is worked out.
            turn_deg: by how much the object stands turned about the vertical, counter-clockwise from above.
        """
        compiled.prepare(_compile_all)
        self._mesh, self._scene = mesh, scene
        self._shape, self._paint = Shape.of(mesh), _paint_of(mesh)
        lighting = bake_lighting(self._shape, self._paint.mean_colour, scene, detail, turn_deg)
        angle = np.radians(turn_deg)
        self._turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        self._lit = _light_mesh(self._paint, lighting, self._turn)
        self._around = _surround(scene, lighting, self._turn)

    def render(self, camera: Camera, T_world_camera: np.ndarray) -> np.ndarray:
        """(height, width, 3) float32 linear light times the scene's exposure; not clipped.

        Raises:
            ToolkitError: a camera that is nowhere.
        """
        view = _view(camera, T_world_camera)
        picture = self._paint_background(view)
        part = self._trace(camera, view, T_world_camera)
        if part is not None:
            paint_object(self._around, self._lit, view, part, picture, _make_linear(view, 0))
        return picture

    def render_many(self, views: Iterable[tuple[Camera, np.ndarray]]) -> Iterator[np.ndarray]:
        """`render` of each (camera, `T_world_camera`), in order, on all cores; the same pictures."""
        return map_frames(lambda view: self.render(*view), views)

    def render_linear_many(
        self, camera: Camera, poses: Iterable[np.ndarray], texture: np.ndarray
    ) -> Iterator[LinearView]:
        """`render_linear` from each pose, in order, on all cores; the same views."""
        return map_frames(lambda pose: self.render_linear(camera, pose, texture), poses)

    def render_linear(self, camera: Camera, T_world_camera: np.ndarray, texture: np.ndarray) -> LinearView:
        """What `render` shows, linear in the colours of those of the mesh's materials that share a texture.

        Args:
            camera, T_world_camera: as for `render`.
            texture: the one of the materials' textures (the array itself) that is left out; its materials must not be
                metallic, for their gloss has their colour. What bounces off the table has the texture's mean colour.
        """
        left_out = np.array([m.texture is texture for m in self._mesh.materials])
        view = _view(camera, T_world_camera)
        behind, dark = self._paint_background(view), np.zeros((camera.height, camera.width, 3), np.float32)
        part = self._trace(camera, view, T_world_camera)
        if part is None:
            return LinearView.of_nothing(behind)
        out = _make_linear(view, len(part.hits.face) + 4 * len(part.refine))
        count = paint_object(self._around, self._lit._replace(left_out=left_out), view, part, dark, out)
        samples = {name: getattr(out, name)[:count].copy() for name in ("pixel", "uv", "lod", "gain")}
        return LinearView(behind=behind, dark=dark, coverage=out.coverage, **samples)

    def buffers(self, camera: Camera, T_world_camera: np.ndarray) -> dict[str, np.ndarray]:
        """Exact float buffers at pixel centres: depth along the ray, mm (inf: none), material (-1: none), uv (NaN)."""
        shape = camera.height, camera.width
        rays = np.empty((camera.height * camera.width, 6), np.float32)
        fill_pixel_rays(_view(camera, T_world_camera), 0, 0, camera.width, camera.height, rays)
        hits = self._cast(rays)
        seen = hits.face != NOTHING
        face, weights = hits.face[seen].astype(np.int64), hits.uv[seen]
        material = np.full(seen.shape, -1, np.int32)
        material[seen] = self._mesh.face_material[face]
        corner_uv = self._mesh.uv[self._mesh.faces[face]]
        texture_uv = np.full((*seen.shape, 2), np.nan, np.float32)
        u, v = weights[:, :1], weights[:, 1:]
        texture_uv[seen] = corner_uv[:, 0] * (1 - u - v) + corner_uv[:, 1] * u + corner_uv[:, 2] * v
        return {
            "depth": hits.distance.reshape(shape), "material": material.reshape(shape),
            "uv": texture_uv.reshape(*shape, 2),
        }  # fmt: skip

    def _paint_background(self, view: View) -> np.ndarray:
        picture, edges = np.empty((view.height, view.width, 3), np.float32), np.empty((4, 3))
        find_table_edges(self._around, view, edges)
        paint_background(self._around, view, edges, picture)
        return picture

    def _trace(self, camera: Camera, view: View, T_world_camera: np.ndarray) -> Part | None:
        """Trace the pixels that can show the object; None where none can."""
        left, top, right, bottom = self._region(camera, T_world_camera)
        if right <= left or bottom <= top:
            return None
        count = (right - left) * (bottom - top)
        rays, normal = np.empty((count, 6), np.float32), np.empty((count, 3), np.float32)
        material, needed = np.empty(count, np.int32), np.empty(count, bool)
        fill_pixel_rays(view, left, top, right, bottom, rays)
        hits = self._cast(rays)
        mark_edges(self._lit, hits, rays, right - left, material, normal, needed)
        refine = np.flatnonzero(needed).astype(np.int32)
        rays = np.empty((4 * len(refine), 6), np.float32)
        fill_sample_rays(view, left, top, right - left, refine, rays)
        fine = self._cast(rays)
        return Part(left, top, right, bottom, hits, refine, fine)

    def _cast(self, rays: np.ndarray) -> Hits:
        """First hits of rays (n, 6) in the world; frames are what is spread over the cores."""
        import open3d as o3d

        local = rays
        if self._turn[1, 0]:
            local = np.concatenate([rays[:, :3] @ self._turn, rays[:, 3:] @ self._turn], axis=1).astype(np.float32)
        found = self._shape.rays.cast_rays(o3d.core.Tensor(local), nthreads=1)
        return Hits(*(found[key].numpy() for key in ("t_hit", "primitive_ids", "primitive_uvs")))

    def _region(self, camera: Camera, T_world_camera: np.ndarray) -> tuple[int, int, int, int]:
        """Left, top, right, bottom of the pixels that can show the object."""
        low, high = self._shape.bounds
        box = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        pixels, depth = project(camera, T_world_camera, self._shape.outline @ self._turn.T)
        if (project(camera, T_world_camera, box @ self._turn.T)[1] <= 1e-3 * self._shape.size).any():
            return 0, 0, camera.width, camera.height
        margin = 6 + 0.01 * camera.width
        left, top = np.floor(pixels[depth > 0].min(axis=0) - margin).clip(-1, 1e6).astype(int)
        right, bottom = np.ceil(pixels[depth > 0].max(axis=0) + margin).clip(-1, 1e6).astype(int)
        return max(left, 0), max(top, 0), min(right, camera.width), min(bottom, camera.height)


def count_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


V = TypeVar("V")
F = TypeVar("F")


def map_frames(make: Callable[[V], F], views: Iterable[V], threads: int | None = None) -> Iterator[F]:
    """`make` of each view, in order, on `threads` threads (by default one for each core); a few are made ahead."""
    threads = threads or count_cores()
    waiting: deque[Future[F]] = deque()
    with ThreadPoolExecutor(threads, "frames") as pool:
        try:
            for view in views:
                waiting.append(pool.submit(make, view))
                if len(waiting) > 2 * threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def _view(camera: Camera, T_world_camera: np.ndarray) -> View:
    """A camera in its place, for the kernel."""
    pose = np.asarray(T_world_camera, np.float64)
    if not np.isfinite(pose).all() or np.abs(pose[:3, 3]).max() > FARTHEST:
        raise ToolkitError(
            f"the camera stands at {pose[:3, 3].tolist()}: expected numbers within {FARTHEST:g}: check the pose"
        )
    return View(
        np.ascontiguousarray(pose[:3, :3]), np.ascontiguousarray(pose[:3, 3]), float(camera.fx), float(camera.fy),
        float(camera.cx), float(camera.cy), camera.width, camera.height,
    )  # fmt: skip


def _make_linear(view: View, samples: int) -> Linear:
    """Room for so many samples of a linear view."""
    return Linear(
        coverage=np.zeros((view.height, view.width), np.float32), pixel=np.empty(samples, np.int32),
        uv=np.empty((samples, 2), np.float32), lod=np.empty(samples, np.float32),
        gain=np.empty((samples, 3), np.float32),
    )  # fmt: skip


_painted: OrderedDict[int, _Paint] = OrderedDict()
MOST_KEPT = 3
"""Meshes whose textures are kept."""
_keeping = Lock()


def _paint_of(mesh: Mesh) -> _Paint:
    """Pyramids and densities of a mesh, kept for the next renderer of the same mesh."""
    with _keeping:
        found = _painted.pop(id(mesh), None) or _prepare_paint(mesh)
        _painted[id(mesh)] = found
        while len(_painted) > MOST_KEPT:
            _painted.popitem(last=False)
        return found


def _prepare_paint(mesh: Mesh) -> _Paint:
    distinct = list({id(m.texture): m.texture for m in mesh.materials}.values())
    number = {id(texture): index for index, texture in enumerate(distinct)}
    texture = np.array([number[id(m.texture)] for m in mesh.materials], np.int32)
    texels = pack_textures(distinct)
    corners, corner_uv = mesh.vertices[mesh.faces], mesh.uv[mesh.faces]
    surface = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    a, b = corner_uv[:, 1] - corner_uv[:, 0], corner_uv[:, 2] - corner_uv[:, 0]
    chart = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    counts = np.array([picture.shape[0] * picture.shape[1] for picture in distinct])
    of_face = texture[mesh.face_material]
    density = np.sqrt(chart * counts[of_face] / np.maximum(surface, 1e-12)).astype(np.float32)
    colour = np.empty((len(of_face), 3), np.float32)
    fill_colours(texels, of_face, corner_uv.mean(axis=1), np.zeros(len(of_face), np.float32), colour)
    mean = (colour * surface[:, None]).sum(axis=0) / max(float(surface.sum()), 1e-9)
    return _Paint(mesh, texels, texture, density, mean)


def _light_mesh(paint: _Paint, lighting: Lighting, turn: np.ndarray) -> LitMesh:
    mesh, materials = paint.mesh, paint.mesh.materials
    return LitMesh(
        faces=np.ascontiguousarray(mesh.faces, np.int32), normals=np.ascontiguousarray(mesh.normals, np.float32),
        uv=np.ascontiguousarray(mesh.uv, np.float32), material=np.ascontiguousarray(mesh.face_material, np.int32),
        density=paint.density, texture=paint.texture,
        roughness=np.array([m.roughness for m in materials], np.float32),
        metallic=np.array([m.metallic for m in materials], np.float32),
        finely=np.array([m.name == PAPER_MATERIAL for m in materials]),
        left_out=np.zeros(len(materials), bool), texels=paint.texels,
        steps=lighting.grid.steps, first=lighting.grid.first, stored=lighting.stored, turn=turn,
    )  # fmt: skip


def _surround(scene: Scene, lighting: Lighting, turn: np.ndarray) -> Surround:
    side = lighting.table.shape[0] * LIGHT_MAP_ZOOM
    light = cv2.resize(lighting.table, (side, side), interpolation=cv2.INTER_CUBIC)
    table = scene.table
    mirrored = _kept(scene.environment, _blur_environment)
    texels = _kept(table.picture if table else NO_PICTURE, _pack_one)
    return Surround(
        # a room is out of focus behind a table top; the sky is as sharp as it was given
        backdrop=mirrored[0] if table is not None else np.ascontiguousarray(scene.environment, np.float32),
        mirrored=mirrored, key=orbit_direction(scene.key.azimuth_deg, scene.key.elevation_deg),
        key_spread=float(np.tan(np.radians(scene.key.radius_deg)) / 2),
        key_irradiance=np.array(scene.key.irradiance, float), exposure=float(scene.exposure),
        has_table=table is not None,
        table=texels, table_size=np.array(table.size_mm if table else (1.0, 1.0), float),
        table_roughness=float(table.roughness if table else 1.0),
        table_light=LightMap(light, float(lighting.table_side_mm), 0.0, 0.0, float(turn[0, 0]), float(turn[1, 0])),
    )  # fmt: skip


_around: OrderedDict[int, tuple[np.ndarray, Any]] = OrderedDict()


def _kept(picture: np.ndarray, make: Callable[[np.ndarray], F]) -> F:
    """`make` of a picture, worked out once for those that are in use."""
    with _keeping:
        found = _around.pop(id(picture), None) or (picture, make(picture))
        _around[id(picture)] = found
        while len(_around) > 2 * MOST_KEPT:
            _around.popitem(last=False)
    return found[1]


NO_PICTURE = np.zeros((1, 1, 3), np.uint8)


def _pack_one(picture: np.ndarray) -> Texels:
    return pack_textures([picture])


def _blur_environment(environment: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A picture of all directions as surfaces of each of `ROUGHNESS_LEVELS` mirror it."""
    width = environment.shape[1]
    a, b, c, d = (blur_directions(environment, width * (0.004 + 0.13 * r**1.5)) for r in ROUGHNESS_LEVELS)
    return a, b, c, d


def _compile_all() -> None:
    """Render a triangle in every way."""
    corners = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 1]], np.float32)
    up, faces = np.repeat(np.array([[0, 0, 1]], np.float32), 3, axis=0), np.array([[0, 1, 2]], np.int32)
    texture = np.full((8, 8, 3), 128, np.uint8)
    mesh = Mesh(corners, up, corners[:, :2] / 9, faces, np.zeros(1, np.int32), (Material("", texture),))
    room = np.ones((32, 64, 3), np.float32)
    renderer = RaycastRenderer(mesh, Scene("", KeyLight(), room, 1.0, Table(texture, (40.0, 30.0), 0.5)))
    pose = orbit_pose(np.zeros(3), 0, 60, 30)
    renderer.render(Camera.from_fov(16, 16), pose)
    renderer.render_linear(Camera.from_fov(16, 16), pose, texture)
