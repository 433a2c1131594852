"""The rig's renderer: drawing or Embree (Open3D's ray scene) finds what is seen, a compiled kernel makes light of it.

Light that does not change with the camera is baked once. Per frame there is left which surface each pixel sees, its
texture at the right level of detail, and the gloss. Silhouettes, creases and printed sheets get four samples a pixel.
"""

from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np

from toolkit.core.child import count_cores, run_python
from toolkit.core.threads import map_ahead
from toolkit.objects.mesh import Material, Mesh
from toolkit.rig.bake_cache import (
    NO_PICTURE,
    BakedLight,
    kept,
    light_mesh,
    pack_one,
    paint_of,
    surroundings_of,
    with_lamps,
)
from toolkit.rig.camera import Camera, orbit_direction, orbit_pose, project
from toolkit.rig.kernel import compiled
from toolkit.rig.kernel.frame import Hits, Linear, TracedRegion, paint_background, paint_mesh
from toolkit.rig.kernel.light import LightMap
from toolkit.rig.kernel.scene import (
    ROUGHNESS_LEVELS,
    TILE,
    LitMesh,
    Surround,
    as_triple,
    fill_sheen,
    find_table_edges,
)
from toolkit.rig.lighting import FULL_DETAIL, BakeDetail, Lighting, Shape, bake_lighting, bake_studio_light
from toolkit.rig.renderer import Renderer, name_hits, view_from
from toolkit.rig.scene import AT_ORIGIN, KeyLight, Scene, Stand, Table
from toolkit.rig.shading import LinearView, tone_map
from toolkit.rig.textures import blur_directions, pad_channels
from toolkit.rig.trace import NO_REGION, LitBody, Tracer

LIGHT_MAP_ZOOM = 2
"""The table's light is kept so many times as fine as it was baked, smoothly filled in."""
GROUND_REACH = 0.02
"""Height differences within which ground has the object's shade, as a share of the side of the map of it."""


class RaycastRenderer(Renderer):
    """Renders an object in a scene from any camera.

    Results for a shape or a texture are kept for the next renderer that has the same: another place, light or paint
    costs little.
    """

    def __init__(
        self, mesh: Mesh, scene: Scene, detail: BakeDetail = FULL_DETAIL, stand: Stand = AT_ORIGIN, *,
        keep_light: bool = False,
    ) -> None:  # fmt: skip
        """Bake the light.

        Args:
            keep_light: on disk for other runs, see `bake_studio_light`; for an object on its table, at the origin.
        """
        compile_ahead()
        super().__init__(mesh, scene, stand)
        shape, paint = Shape.of(mesh), paint_of(mesh)
        self._others, around, albedo = None, None, paint.mean_colour
        if scene.surroundings is not None:
            # lit once for a scene: they do not move, whatever object is put among them
            self._others = surroundings_of(scene)
            around = self._others.shape
            # light bounces off both, and how much off which depends on the place: the mean does
            albedo = (albedo + paint_of(scene.surroundings).mean_colour) / 2
        if keep_light and around is None and stand == AT_ORIGIN:
            lighting = bake_studio_light(shape, albedo, scene, detail)
        else:
            lighting = bake_lighting(shape, albedo, scene, detail, stand, around)
        grid = lighting.grid
        # baked in the object's own frame, and turned and moved only when it is read
        lit = light_mesh(mesh, paint, BakedLight(grid.steps, grid.first, lighting.stored), stand)
        self._object = LitBody(shape, lit, is_moved=stand != AT_ORIGIN, number=0)
        if scene.lamps:
            self._object = with_lamps(self._object, mesh)
            if self._others is not None and scene.surroundings is not None:
                self._others = with_lamps(self._others, scene.surroundings)
        self._around = _surround(scene, lighting, stand)
        self._tracer = Tracer(self._object, self._others, self._around.key)

    def render(self, camera: Camera, T_world_camera: np.ndarray) -> np.ndarray:
        """(height, width, 3) float32 linear light times the scene's exposure; not clipped.

        Raises:
            ToolkitError: a camera that is nowhere.
        """
        return self._render(camera, T_world_camera)[0]

    def render_with_depth(self, camera: Camera, T_world_camera: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """`render`, and `depth`, `mesh` and `face` of `buffers` from the same rays; for scenes with surroundings."""
        picture, hits = self._render(camera, T_world_camera)
        return picture, name_hits(hits, (camera.height, camera.width))

    def _render(self, camera: Camera, T_world_camera: np.ndarray) -> tuple[np.ndarray, Hits]:
        picture, out, hits = self._paint_meshes(camera, T_world_camera, self._object.lit, linear=False)
        self._paint_background(camera, T_world_camera, out.coverage, picture, apart=False)
        return picture, hits

    def render_many(self, views: Iterable[tuple[Camera, np.ndarray]]) -> Iterator[np.ndarray]:
        """`render` of each (camera, `T_world_camera`), in order, on all cores; the same pictures."""
        return map_ahead(lambda view: self.render(*view), views)

    def render_linear_many(
        self, camera: Camera, poses: Iterable[np.ndarray], texture: np.ndarray
    ) -> Iterator[LinearView]:
        """`render_linear` from each pose, in order, on all cores; the same views."""
        return map_ahead(lambda pose: self.render_linear(camera, pose, texture), poses)

    def render_linear(self, camera: Camera, T_world_camera: np.ndarray, texture: np.ndarray) -> LinearView:
        """What `render` shows, linear in the colours of those of the mesh's materials that share a texture.

        Args:
            texture: the texture of materials (the array itself) that is left out; its materials must not be
                metallic, for their gloss has their colour. Light that bounces off the table has the texture's mean
                colour.
        """
        # the array itself is compared: of two materials that look alike only a single may be trained
        left_out = np.array([m.texture is texture for m in self._mesh.materials])
        lit = self._object.lit._replace(left_out=left_out)
        # the picture as if the texture were black, and what each sample takes from the texture
        dark, out, _ = self._paint_meshes(camera, T_world_camera, lit, linear=True)
        # table and room as if the object covered nothing, as they are seen behind it
        behind = np.zeros_like(dark)
        self._paint_background(camera, T_world_camera, out.coverage, behind, apart=True)
        out = out._replace(coverage=out.coverage.reshape(behind.shape[:2]))
        return LinearView(behind=behind, dark=dark, **out._asdict())

    def _paint_meshes(
        self, camera: Camera, T_world_camera: np.ndarray, lit: LitMesh, linear: bool
    ) -> tuple[np.ndarray, Linear, Hits]:
        """(h, w, 3) float32 what rays met before black, samples of a linear view if asked for, first hits."""
        part = self._trace(camera, T_world_camera)
        return *self._paint_hits(camera, T_world_camera, lit, part, linear), part.hits

    def _trace(self, camera: Camera, T_world_camera: np.ndarray) -> TracedRegion:
        return self._tracer.trace(view_from(camera, T_world_camera), self._region(camera, T_world_camera))

    def _paint_hits(
        self, camera: Camera, T_world_camera: np.ndarray, lit: LitMesh, part: TracedRegion, linear: bool
    ) -> tuple[np.ndarray, Linear]:
        view = view_from(camera, T_world_camera)
        # a pixel has its centre's sample, and four finer samples if it was refined
        most = len(part.hits.face) + 4 * len(part.refine) if linear else 0
        pixels = camera.height * camera.width
        picture = np.zeros((camera.height, camera.width, 3), np.float32)
        flat = picture.reshape(-1, 3)
        out = Linear(
            coverage=np.zeros(pixels, np.float32), pixel=np.empty(most, np.int32),
            uv=np.empty((most, 2), np.float32), lod=np.empty(most, np.float32), gain=np.empty((most, 3), np.float32),
        )  # fmt: skip
        count = paint_mesh(self._around, lit, 0, view, part, flat, out)
        if self._others is not None:
            # surroundings are never trained: their samples are left out
            paint_mesh(self._around, self._others.lit, 1, view, part, flat, out._replace(pixel=out.pixel[:0]))
        return picture, Linear(out.coverage, *(array[:count].copy() for array in out[1:]))

    def _paint_background(
        self, camera: Camera, T_world_camera: np.ndarray, coverage: np.ndarray, picture: np.ndarray, apart: bool
    ) -> None:
        view, edges = view_from(camera, T_world_camera), np.empty((4, 3))
        # a tile beyond the picture's rim: values are interpolated between a tile's corners
        sheen = np.zeros((camera.height // TILE + 2, camera.width // TILE + 2, 4), np.float32)
        find_table_edges(self._around, view, edges)
        if self._around.has_table:
            fill_sheen(self._around, view, sheen)
        paint_background(self._around, view, edges, sheen, coverage, picture.reshape(-1, 3), apart)

    def _region(self, camera: Camera, T_world_camera: np.ndarray) -> tuple[int, int, int, int]:
        """Left, top, right, bottom of the pixels that can show the object."""
        shape = self._object.shape
        low, high = shape.bounds
        # the box alone says what is behind the camera: the outline's points do not bound what lies between them there
        box = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        pixels, depth = project(camera, T_world_camera, self.outline)
        depths = project(camera, T_world_camera, self._stand.to_world(box))[1]
        if (depths <= 0).all():
            return 0, 0, 0, 0
        # part of it is behind the camera, where a projection says nothing: anywhere may show it
        if (depths <= 1e-3 * shape.size).any():
            return 0, 0, camera.width, camera.height
        # finer samples and rounding reach a little beyond the outline
        margin = 6 + 0.01 * camera.width
        left, top = np.floor(pixels[depth > 0].min(axis=0) - margin).clip(-1, 1e6).astype(int)
        right, bottom = np.ceil(pixels[depth > 0].max(axis=0) + margin).clip(-1, 1e6).astype(int)
        left, top = max(left, 0), max(top, 0)
        return left, top, max(min(right, camera.width), left), max(min(bottom, camera.height), top)


LEAST_VIEW = Camera.from_fov(16, 16), orbit_pose(np.zeros(3), 0, 60, 30)
MOST_COMPILING_S = 120.0
"""CPU seconds of the other process that compiles: ten times what it takes."""


def compile_ahead() -> None:
    """Compile the renderer for this machine, unless its machine code is on disk."""
    compiled.prepare(_compile_all)


def begin_compiling() -> None:
    """Begin `compile_ahead` beside what the caller does next; renderers wait for it."""
    pool = ThreadPoolExecutor(1, "compile")
    pool.submit(compile_ahead)
    pool.shutdown(wait=False)


def _surround(scene: Scene, lighting: Lighting, stand: Stand) -> Surround:
    side = lighting.table.shape[0] * LIGHT_MAP_ZOOM
    # smooth steps between baked samples, of which a straight line would show the grid
    light = cv2.resize(lighting.table, (side, side), interpolation=cv2.INTER_CUBIC)
    table = scene.table
    mirrored = kept(_blur_environment, scene.environment)
    texels = kept(pack_one, table.picture if table else NO_PICTURE)
    return Surround(
        # a room is out of focus behind a table top; the sky is as sharp as it was given
        backdrop=mirrored[0] if table is not None else kept(pad_channels, scene.environment),
        mirrored=mirrored, key=as_triple(orbit_direction(scene.key.azimuth_deg, scene.key.elevation_deg)),
        # half the tangent of the light's radius, added to alpha: see `_gloss`
        key_spread=float(np.tan(np.radians(scene.key.radius_deg)) / 2),
        key_irradiance=as_triple(scene.key.irradiance), exposure=float(scene.exposure),
        lamps=float(scene.lamps), has_table=table is not None,
        table=texels, table_size=(float(table.size_mm[0]), float(table.size_mm[1])) if table else (1.0, 1.0),
        table_roughness=float(table.roughness if table else 1.0),
        ground_light=LightMap(
            pad_channels(light), float(lighting.table_side_mm), float(stand.place[0]), float(stand.place[1]),
            float(stand.turn[0, 0]), float(stand.turn[1, 0]),
        ),
        ground_z=float(stand.place[2]),
        ground_reach=0.0 if scene.surroundings is None else GROUND_REACH * lighting.table_side_mm,
    )  # fmt: skip


def _blur_environment(environment: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A picture of all directions as surfaces of each of `ROUGHNESS_LEVELS` mirror it."""
    width = environment.shape[1]
    a, b, c, d = (pad_channels(blur_directions(environment, width * (0.004 + 0.13 * r**1.5))) for r in ROUGHNESS_LEVELS)
    return a, b, c, d


def _compile_all() -> None:
    """Render a triangle in every way, with half of the compiling in another process where there is a core for it."""
    with ThreadPoolExecutor(1, "compile") as pool:
        is_shared = count_cores() > 1 and compiled.cache_folder() is not None
        code = "from toolkit.rig.raycast import compile_paint; compile_paint()"
        paint = pool.submit(run_python, code, most_s=MOST_COMPILING_S) if is_shared else None
        studio, world = _make_least(is_outdoors=False), _make_least(is_outdoors=True)
        # tracing is compiled here, painting in the other process
        for renderer in (studio, world):
            renderer._trace(*LEAST_VIEW)
        if paint is not None:
            paint.result()
    # of the other process's share, only what it could not compile is compiled here
    studio.render_linear(*LEAST_VIEW, studio._mesh.materials[0].texture)
    tone_map(world.render(*LEAST_VIEW), (0,))


def compile_paint() -> None:
    """Compile what comes after the hits, for a process that is preparing the renderer."""

    def compile_half() -> None:
        renderer, (camera, pose) = _make_least(is_outdoors=False), LEAST_VIEW
        picture, out = renderer._paint_hits(camera, pose, renderer._object.lit, NO_REGION, linear=True)
        renderer._paint_background(camera, pose, out.coverage, picture, apart=False)
        tone_map(picture, (0,))

    compiled.compile_share(compile_half)


def _make_least(is_outdoors: bool) -> RaycastRenderer:
    """The smallest scene that goes through every kernel, in a studio or out of doors."""
    corners = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 1]], np.float32)
    up, faces = np.repeat(np.array([[0, 0, 1]], np.float32), 3, axis=0), np.array([[0, 1, 2]], np.int32)
    texture = np.full((8, 8, 3), 128, np.uint8)
    mesh = Mesh(corners, up, corners[:, :2] / 9, faces, np.zeros(1, np.int32), (Material("", texture),))
    studio = Scene("", KeyLight(), np.ones((32, 64, 3), np.float32), 1.0, Table(texture, (40.0, 30.0), 0.5))
    if not is_outdoors:
        return RaycastRenderer(mesh, studio)
    return RaycastRenderer(mesh, replace(studio, table=None, surroundings=mesh), stand=Stand((0.0, 0.0, 2.0)))
