"""The rig's renderer: drawing or Embree (Open3D's ray scene) finds what is seen, one compiled kernel makes light of it.

Light that does not change with the camera is baked once; what is left per frame is which surface each pixel sees, its
texture at the right level of detail, and the gloss. Silhouettes, creases and printed sheets get four samples a pixel.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import cv2
import numpy as np

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
from toolkit.rig.kernel.frame import Hits, Linear, paint_background, paint_mesh
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
from toolkit.rig.trace import LitBody, Tracer

LIGHT_MAP_ZOOM = 2
"""The table's light is kept so many times as fine as it was baked, smoothly filled in."""
GROUND_REACH = 0.02
"""Height differences within which ground has the object's shade, as a share of the side of the map of it."""


class RaycastRenderer(Renderer):
    """Renders one object in one scene from any camera.

    What is worked out of a shape or a texture is kept for the next renderer that has the same, so that another place,
    light or paint costs little.
    """

    def __init__(
        self, mesh: Mesh, scene: Scene, detail: BakeDetail = FULL_DETAIL, stand: Stand = AT_ORIGIN, *,
        keep_light: bool = False,
    ) -> None:  # fmt: skip
        """Bake the light.

        Args:
            mesh: on the table.
            scene: what it stands in.
            detail: how finely light is worked out.
            stand: where in it.
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
            camera, T_world_camera: as for `render`.
            texture: the one of the materials' textures (the array itself) that is left out; its materials must not be
                metallic, for their gloss has their colour. What bounces off the table has the texture's mean colour.
        """
        # the array itself is compared: two materials may look alike and only one be trained
        left_out = np.array([m.texture is texture for m in self._mesh.materials])
        lit = self._object.lit._replace(left_out=left_out)
        dark, out, _ = self._paint_meshes(camera, T_world_camera, lit, linear=True)
        behind = np.zeros_like(dark)
        self._paint_background(camera, T_world_camera, out.coverage, behind, apart=True)
        out = out._replace(coverage=out.coverage.reshape(behind.shape[:2]))
        return LinearView(behind=behind, dark=dark, **out._asdict())

    def _paint_meshes(
        self, camera: Camera, T_world_camera: np.ndarray, lit: LitMesh, linear: bool
    ) -> tuple[np.ndarray, Linear, Hits]:
        """(h, w, 3) float32 what rays met before black, samples of a linear view where one is asked for, first hits."""
        view = view_from(camera, T_world_camera)
        part = self._tracer.trace(view, self._region(camera, T_world_camera))
        # a pixel is one sample, or the one and four finer ones
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
        return picture, Linear(out.coverage, *(array[:count].copy() for array in out[1:])), part.hits

    def _paint_background(
        self, camera: Camera, T_world_camera: np.ndarray, coverage: np.ndarray, picture: np.ndarray, apart: bool
    ) -> None:
        view, edges = view_from(camera, T_world_camera), np.empty((4, 3))
        # one tile beyond the picture's rim: values are interpolated between a tile's corners
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


def compile_ahead() -> None:
    """Compile the renderer for this machine if its machine code is not on disk; the first image does so otherwise."""
    compiled.prepare(_compile_all)


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
    """Render a triangle in every way."""
    # the smallest scene that goes through every kernel, once in a studio and once out of doors
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
