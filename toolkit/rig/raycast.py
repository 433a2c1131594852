"""The rig's renderer: Embree finds what each ray meets (Open3D's ray scene), one compiled kernel makes light of it.

Light that does not change with the camera is baked once; what is left per frame is which surface each pixel sees, its
texture at the right level of detail, and the gloss. Silhouettes, creases and printed sheets get four samples a pixel.
"""

from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from threading import RLock
from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np

from toolkit.core.cores import count_cores
from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import Material, Mesh
from toolkit.rig.camera import Camera, orbit_direction, orbit_pose, project
from toolkit.rig.kernel import compiled
from toolkit.rig.kernel.frame import NOTHING, Hits, Linear, Samples, paint_background, paint_meshes
from toolkit.rig.kernel.light import LightMap
from toolkit.rig.kernel.scene import (
    ROUGHNESS_LEVELS,
    TILE,
    LitMesh,
    Surround,
    View,
    fill_sheen,
    find_table_edges,
)
from toolkit.rig.kernel.textures import Texels, fill_colours
from toolkit.rig.lighting import FULL_DETAIL, BakeDetail, Lighting, Shape, bake_lighting, bake_surroundings
from toolkit.rig.linear_view import LinearView
from toolkit.rig.mount import PAPER_MATERIAL
from toolkit.rig.scene import AT_ORIGIN, KeyLight, Scene, Stand, Table
from toolkit.rig.shading import tone_map
from toolkit.rig.textures import blur_directions, pack_textures, pad_channels
from toolkit.rig.trace import CENTRE, Body, Tracer

LIGHT_MAP_ZOOM = 2
"""The table's light is kept so many times as fine as it was baked, smoothly filled in."""
GROUND_REACH = 0.02
"""Height differences within which ground has the object's shade, as a share of the side of the map of it."""
FARTHEST = 1e9
"""Coordinates of a camera at most; float32 holds them to some tens of units."""


class _Paint(NamedTuple):
    """What is painted on a mesh, ready for the kernel."""

    texels: Texels
    texture: np.ndarray
    density: np.ndarray
    mean_colour: np.ndarray


class _Glow(NamedTuple):
    """What a mesh's materials give off; the fields of `LitMesh`."""

    glow: np.ndarray
    glow_lod: np.ndarray
    glow_texels: Texels


def _with_lamps(body: Body, mesh: Mesh) -> Body:
    """The same with what its materials give off; the light on it is not baked anew."""
    return replace(body, lit=body.lit._replace(**_kept(_prepare_glow, mesh)._asdict()))


def _surroundings_of(scene: Scene) -> Body:
    """What stands around the object and never moves; kept for the next renderer in the same sky."""

    def make(mesh: Mesh, *_: object) -> Body:
        shape, paint = Shape.of(mesh), _paint_of(mesh)
        lighting = bake_surroundings(shape, paint.mean_colour, scene)
        return Body(shape, _light_mesh(mesh, paint, lighting, AT_ORIGIN), is_moved=False, number=1)

    return _kept(make, scene.surroundings, scene.environment, scene.key)


class RaycastRenderer:
    """Renders one object in one scene from any camera.

    What is worked out of a shape or a texture is kept for the next renderer that has the same, so that another place,
    light or paint costs little.
    """

    def __init__(self, mesh: Mesh, scene: Scene, detail: BakeDetail = FULL_DETAIL, stand: Stand = AT_ORIGIN) -> None:
        """Bake the light.

        Args:
            mesh: on the table.
            scene: what it stands in.
            detail: how finely light is worked out.
            stand: where in it.
        """
        compiled.prepare(_compile_all)
        self._mesh, self._scene, self._stand = mesh, scene, stand
        shape, paint = Shape.of(mesh), _paint_of(mesh)
        self._others, around, albedo = None, None, paint.mean_colour
        if scene.surroundings is not None:
            self._others = _surroundings_of(scene)
            around = self._others.shape
            albedo = (albedo + _paint_of(scene.surroundings).mean_colour) / 2
        lighting = bake_lighting(shape, albedo, scene, detail, stand, around)
        lit = _light_mesh(mesh, paint, lighting, stand)
        self._object = Body(shape, lit, is_moved=stand != AT_ORIGIN, number=0)
        if scene.lamps:
            self._object = _with_lamps(self._object, mesh)
            if self._others is not None and scene.surroundings is not None:
                self._others = _with_lamps(self._others, scene.surroundings)
        self._around = _surround(scene, lighting, stand)
        self._tracer = Tracer(self._object, self._others, self._around.key)

    @cached_property
    def outline(self) -> np.ndarray:
        """(k, 3) points in the world that bound every picture of the object."""
        return self._stand.to_world(self._object.shape.outline)

    def render(self, camera: Camera, T_world_camera: np.ndarray) -> np.ndarray:
        """(height, width, 3) float32 linear light times the scene's exposure; not clipped.

        Raises:
            ToolkitError: a camera that is nowhere.
        """
        return self._render(camera, T_world_camera)[0]

    def render_with_depth(self, camera: Camera, T_world_camera: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """`render`, and `depth`, `mesh` and `face` of `buffers` from the same rays; for scenes with surroundings."""
        picture, hits = self._render(camera, T_world_camera)
        shape = camera.height, camera.width
        met = np.where(hits.face == NOTHING, np.uint8(255), hits.mesh)
        found = {"depth": hits.distance, "mesh": met, "face": hits.face}
        return picture, {name: values.reshape(shape) for name, values in found.items()}

    def _render(self, camera: Camera, T_world_camera: np.ndarray) -> tuple[np.ndarray, Hits]:
        picture, out, hits = self._paint_meshes(camera, T_world_camera, self._object.lit, linear=False)
        self._paint_background(camera, T_world_camera, out.coverage, picture, apart=False)
        return picture, hits

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
        lit = self._object.lit._replace(left_out=left_out)
        dark, out, _ = self._paint_meshes(camera, T_world_camera, lit, linear=True)
        behind = np.zeros_like(dark)
        self._paint_background(camera, T_world_camera, out.coverage, behind, apart=True)
        return LinearView(behind=behind, dark=dark, **out._asdict())

    def buffers(self, camera: Camera, T_world_camera: np.ndarray) -> dict[str, np.ndarray]:
        """Exact buffers (h, w) at pixel centres.

        Returns:
            `depth` along the ray, in the mesh's units (inf: nothing is met); `material` of the object (-1: it is not
            seen) and `uv` (h, w, 2) on it (NaN); `mesh`: 0 the object, 1 its surroundings, 255 neither; `face` of
            that mesh.
        """
        shape = camera.height, camera.width
        pixels = np.arange(camera.height * camera.width, dtype=np.int32)
        samples = Samples(0, 0, camera.width, camera.height, pixels, CENTRE)
        hits = self._tracer.see(_view(camera, T_world_camera), samples, np.ones(len(pixels), bool))
        seen = (hits.face != NOTHING) & (hits.mesh == 0)
        face, weights = hits.face[seen].astype(np.int64), hits.uv[seen]
        material = np.full(seen.shape, -1, np.int32)
        material[seen] = self._mesh.face_material[face]
        corner_uv = self._mesh.uv[self._mesh.faces[face]]
        texture_uv = np.full((*seen.shape, 2), np.nan, np.float32)
        u, v = weights[:, :1], weights[:, 1:]
        texture_uv[seen] = corner_uv[:, 0] * (1 - u - v) + corner_uv[:, 1] * u + corner_uv[:, 2] * v
        met = np.where(hits.face == NOTHING, np.uint8(255), hits.mesh)
        return {
            "depth": hits.distance.reshape(shape), "material": material.reshape(shape),
            "uv": texture_uv.reshape(*shape, 2), "mesh": met.reshape(shape), "face": hits.face.reshape(shape),
        }  # fmt: skip

    def _paint_meshes(
        self, camera: Camera, T_world_camera: np.ndarray, lit: LitMesh, linear: bool
    ) -> tuple[np.ndarray, Linear, Hits]:
        """(h, w, 3) float32 what rays met before black, samples of a linear view where one is asked for, first hits."""
        view = _view(camera, T_world_camera)
        part = self._tracer.trace(view, self._region(camera, T_world_camera))
        most = len(part.hits.face) + 4 * len(part.refine) if linear else 0
        picture = np.zeros((camera.height, camera.width, 3), np.float32)
        out = Linear(
            coverage=np.zeros((camera.height, camera.width), np.float32), pixel=np.empty(most, np.int32),
            uv=np.empty((most, 2), np.float32), lod=np.empty(most, np.float32), gain=np.empty((most, 3), np.float32),
        )  # fmt: skip
        others = self._object.lit if self._others is None else self._others.lit
        count = paint_meshes(self._around, lit, others, view, part, picture, out)
        return picture, Linear(out.coverage, *(array[:count].copy() for array in out[1:])), part.hits

    def _paint_background(
        self, camera: Camera, T_world_camera: np.ndarray, coverage: np.ndarray, picture: np.ndarray, apart: bool
    ) -> None:
        view, edges = _view(camera, T_world_camera), np.empty((4, 3))
        sheen = np.zeros((camera.height // TILE + 2, camera.width // TILE + 2, 4), np.float32)
        find_table_edges(self._around, view, edges)
        if self._around.has_table:
            fill_sheen(self._around, view, sheen)
        paint_background(self._around, view, edges, sheen, coverage, picture, apart)

    def _region(self, camera: Camera, T_world_camera: np.ndarray) -> tuple[int, int, int, int]:
        """Left, top, right, bottom of the pixels that can show the object."""
        shape = self._object.shape
        low, high = shape.bounds
        box = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        pixels, depth = project(camera, T_world_camera, self.outline)
        depths = project(camera, T_world_camera, self._stand.to_world(box))[1]
        if (depths <= 0).all():
            return 0, 0, 0, 0
        if (depths <= 1e-3 * shape.size).any():
            return 0, 0, camera.width, camera.height
        margin = 6 + 0.01 * camera.width
        left, top = np.floor(pixels[depth > 0].min(axis=0) - margin).clip(-1, 1e6).astype(int)
        right, bottom = np.ceil(pixels[depth > 0].max(axis=0) + margin).clip(-1, 1e6).astype(int)
        left, top = max(left, 0), max(top, 0)
        return left, top, max(min(right, camera.width), left), max(min(bottom, camera.height), top)


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


def _paint_of(mesh: Mesh) -> _Paint:
    """Pyramids and densities of a mesh."""
    return _kept(_prepare_paint, mesh)


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
    return _Paint(texels, texture, density, mean)


def _prepare_glow(mesh: Mesh) -> _Glow:
    """Pyramids of what the materials of a mesh give off."""
    lit = [material.emission for material in mesh.materials if material.emission is not None]
    distinct = list({id(emission): emission for emission in lit}.values())
    number = {id(emission): index for index, emission in enumerate(distinct)}
    glow = np.array([-1 if m.emission is None else number[id(m.emission)] for m in mesh.materials], np.int32)
    finer = [1.0 if m.emission is None else m.emission.shape[1] / m.texture.shape[1] for m in mesh.materials]
    return _Glow(glow, np.log2(finer).astype(np.float32), pack_textures(distinct or [NO_PICTURE]))


def _light_mesh(mesh: Mesh, paint: _Paint, lighting: Lighting, stand: Stand) -> LitMesh:
    materials = mesh.materials
    return LitMesh(
        faces=np.ascontiguousarray(mesh.faces, np.int32),
        normals=np.ascontiguousarray(np.nan_to_num(mesh.normals), np.float32),
        uv=np.ascontiguousarray(np.nan_to_num(mesh.uv).clip(-1e6, 1e6), np.float32),
        material=np.ascontiguousarray(mesh.face_material, np.int32),
        density=paint.density, texture=paint.texture,
        roughness=np.array([m.roughness for m in materials], np.float32),
        metallic=np.array([m.metallic for m in materials], np.float32),
        finely=np.array([m.name == PAPER_MATERIAL for m in materials]),
        left_out=np.zeros(len(materials), bool), texels=paint.texels,
        glow=np.full(len(materials), -1, np.int32), glow_lod=np.zeros(len(materials), np.float32),
        glow_texels=_kept(_pack_one, NO_PICTURE),
        steps=lighting.grid.steps, first=lighting.grid.first, stored=lighting.stored, turn=stand.turn,
        place=np.array(stand.place, float),
    )  # fmt: skip


def _surround(scene: Scene, lighting: Lighting, stand: Stand) -> Surround:
    side = lighting.table.shape[0] * LIGHT_MAP_ZOOM
    light = cv2.resize(lighting.table, (side, side), interpolation=cv2.INTER_CUBIC)
    table = scene.table
    mirrored = _kept(_blur_environment, scene.environment)
    texels = _kept(_pack_one, table.picture if table else NO_PICTURE)
    return Surround(
        # a room is out of focus behind a table top; the sky is as sharp as it was given
        backdrop=mirrored[0] if table is not None else _kept(pad_channels, scene.environment),
        mirrored=mirrored, key=orbit_direction(scene.key.azimuth_deg, scene.key.elevation_deg),
        key_spread=float(np.tan(np.radians(scene.key.radius_deg)) / 2),
        key_irradiance=np.array(scene.key.irradiance, float), exposure=float(scene.exposure),
        lamps=float(scene.lamps), has_table=table is not None,
        table=texels, table_size=np.array(table.size_mm if table else (1.0, 1.0), float),
        table_roughness=float(table.roughness if table else 1.0),
        ground_light=LightMap(
            pad_channels(light), float(lighting.table_side_mm), float(stand.place[0]), float(stand.place[1]),
            float(stand.turn[0, 0]), float(stand.turn[1, 0]),
        ),
        ground_z=float(stand.place[2]),
        ground_reach=0.0 if scene.surroundings is None else GROUND_REACH * lighting.table_side_mm,
    )  # fmt: skip


_in_use: OrderedDict[tuple[object, ...], tuple[tuple[object, ...], Any]] = OrderedDict()
_keeping = RLock()
MOST_KEPT = 10


def _kept(make: Callable[..., F], *sources: object) -> F:
    """`make` of meshes or pictures, worked out once for those that were used last."""
    key = make.__qualname__, *map(id, sources)
    with _keeping:
        found = _in_use.pop(key, None) or (sources, make(*sources))
        _in_use[key] = found
        while len(_in_use) > MOST_KEPT:
            _in_use.popitem(last=False)
    return found[1]


NO_PICTURE = np.zeros((1, 1, 3), np.uint8)


def _pack_one(picture: np.ndarray) -> Texels:
    return pack_textures([picture])


def _blur_environment(environment: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A picture of all directions as surfaces of each of `ROUGHNESS_LEVELS` mirror it."""
    width = environment.shape[1]
    a, b, c, d = (pad_channels(blur_directions(environment, width * (0.004 + 0.13 * r**1.5))) for r in ROUGHNESS_LEVELS)
    return a, b, c, d


def _compile_all() -> None:
    """Render a triangle in every way."""
    corners = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 1]], np.float32)
    up, faces = np.repeat(np.array([[0, 0, 1]], np.float32), 3, axis=0), np.array([[0, 1, 2]], np.int32)
    texture = np.full((8, 8, 3), 128, np.uint8)
    mesh = Mesh(corners, up, corners[:, :2] / 9, faces, np.zeros(1, np.int32), (Material("", texture),))
    room = np.ones((32, 64, 3), np.float32)
    studio = Scene("", KeyLight(), room, 1.0, Table(texture, (40.0, 30.0), 0.5))
    camera, pose = Camera.from_fov(16, 16), orbit_pose(np.zeros(3), 0, 60, 30)
    RaycastRenderer(mesh, studio).render_linear(camera, pose, texture)
    world = replace(studio, table=None, surroundings=mesh)
    tone_map(RaycastRenderer(mesh, world, stand=Stand((0.0, 0.0, 2.0))).render(camera, pose), (0,))
