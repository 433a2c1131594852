"""Renders to train on: random camera, light and backdrop, never the poses of a plan; ahead of who uses them."""

from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from types import TracebackType
from typing import Protocol

import cv2
import numpy as np

from toolkit.core.console import progress
from toolkit.core.cores import count_cores
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.mesh import Mesh
from toolkit.rig.camera import Camera, distance_to_fill, orbit_pose, pixel_rays
from toolkit.rig.lighting import BakeDetail
from toolkit.rig.linear_view import DepthBuffer, LinearView
from toolkit.rig.mount import mount_sheets, wear_sheets
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.renderer import make_renderer
from toolkit.rig.scene import Scene, Stand
from toolkit.rig.shading import tone_map
from toolkit.rig.studio import LIGHTS, make_studio

PER_STUDIO = 24
CAMERA = Camera.from_fov(width=320, height=288, fov_deg=40.0)
FOV_DEG = 30.5
"""Of the square picture: what the middle of a 4:3 frame of 40° shows."""


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


def render_training_images(workspace: Workspace, object_name: str, count: int, seed: int) -> Iterator[np.ndarray]:
    """Yield `count` renders of the bare object, (288, 320, 3) uint8 sRGB.

    Azimuth is anywhere, elevation 20-70°, the object fills 60-95 % of the shorter side, roll within ±8°, and the camera
    looks a little beside the object. Each `PER_STUDIO` images share a studio with its own backdrop and light. Image i
    depends on (seed, i) alone.

    Raises:
        ToolkitError: an unknown object, or a mesh that cannot be used.
    """
    item = load_object(workspace.object_spec(object_name))
    size = float(item.mesh.size_mm.max())
    with progress(f"rendering {object_name} to train on", count) as bar:
        for start in range(0, count, PER_STUDIO):
            renderer = make_renderer("raycast", item.mesh, random_studio(seed, start, size))
            some = range(start, min(start + PER_STUDIO, count))
            poses = (random_pose(np.random.default_rng([seed, i, 2]), item.mesh.vertices, CAMERA) for i in some)
            for i, light in zip(some, renderer.render_many((CAMERA, pose) for pose in poses), strict=True):
                yield tone_map(light, (seed, i))
                bar.advance()


def render_mounted_views(
    item: TableObject,
    sizes_mm: Sequence[float],
    patch_px: int,
    count: int,
    *,
    seed: int,
    image_px: int,
    ranges: ViewRanges = NEAR_VIEWS,
    with_depth: bool = False,
) -> Iterator[LinearView]:
    """Yield `count` views of an object with its printed sheets on it, linear in the colours of their paper.

    Poses, lights and backdrops are as for `render_training_images`; light bounces off the table as from a grey patch.
    View i depends on (seed, i) alone, and none is a pose of a plan.

    Args:
        item: the object.
        sizes_mm: side of the printed patch on each sheet.
        patch_px: texels of its side, of which `lod` counts those that `toolkit.rig.mount.print_on_paper` makes.
        count: how many.
        seed: of all draws.
        image_px: side of the square pictures.
        ranges: where the camera may stand.
        with_depth: whether views shall have their depth, for weather.

    Raises:
        ToolkitError: a sheet that cannot be mounted.
    """
    camera = Camera.from_fov(image_px, image_px, FOV_DEG)
    mesh, paper = mount_grey(item, sizes_mm, patch_px)
    with progress(f"rendering {item.name} with its sheet", count) as bar:
        for start in range(0, count, PER_STUDIO):
            studio = random_studio(seed, start, float(item.mesh.size_mm.max()))
            renderer = RaycastRenderer(mesh, studio)
            draws = (np.random.default_rng([seed, i, 2]) for i in range(start, min(start + PER_STUDIO, count)))
            poses = [random_pose(rng, item.mesh.vertices, camera, ranges) for rng in draws]
            for pose, view in zip(poses, renderer.render_linear_many(camera, poses, paper), strict=True):
                depth = find_depth(renderer, studio, camera, pose) if with_depth else None
                yield replace(view.packed(), depth=depth)
                bar.advance()


def mount_grey(item: TableObject, sizes_mm: Sequence[float], patch_px: int) -> tuple[Mesh, np.ndarray]:
    """An object with a grey patch on each of its sheets, and the texture of the paper that they share.

    Raises:
        ToolkitError: a sheet that cannot be mounted.
    """
    grey = np.full((patch_px, patch_px, 3), 128, np.uint8)
    return wear_sheets(item.mesh, mount_sheets(item.mesh, grey, item.spec.mounts, sizes_mm, item.name))


def find_depth(renderer: RaycastRenderer, scene: Scene, camera: Camera, T_world_camera: np.ndarray) -> DepthBuffer:
    """How far away everything in a view is: the object, what stands around it, the table; a room is endlessly far."""
    depth = renderer.buffers(camera, T_world_camera)["depth"]
    if scene.table is not None:
        x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        rays = pixel_rays(camera, T_world_camera, np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float32))
        fall = np.minimum(rays[:, 5], -1e-6)
        reach = -rays[:, 2] / fall
        on_table = np.abs(rays[:, :2] + reach[:, None] * rays[:, 3:5]) <= np.array(scene.table.size_mm) / 2
        to_table = np.where(on_table.all(axis=1) & (reach > 0), reach, np.inf).reshape(depth.shape)
        depth = np.minimum(depth, to_table.astype(np.float32))
    return DepthBuffer(depth, camera, T_world_camera)


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
        pose = random_pose(np.random.default_rng([*seed, 2, i]), turned.vertices, camera, WIDE_VIEWS)
        pictures[i] = tone_map(renderer.render(camera, pose), (*seed, 2, i))
    return pictures


def turn_mesh(mesh: Mesh, degrees: float) -> Mesh:
    """The mesh turned about the vertical axis, counter-clockwise from above."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]], np.float32)
    return replace(mesh, vertices=mesh.vertices @ rotation.T, normals=mesh.normals @ rotation.T)


def _coarsen_studio(studio: Scene) -> Scene:
    """The studio with pictures of table and room no finer than a thumbnail shows."""
    top = studio.need_table()
    h, w = top.picture.shape[:2]
    scale = min(1.0, THUMBNAIL_TABLE_PX / w)
    table = cv2.resize(top.picture, (round(w * scale), round(h * scale)), interpolation=cv2.INTER_AREA)
    room_size = (THUMBNAIL_ROOM_PX, THUMBNAIL_ROOM_PX // 2)
    room = cv2.resize(studio.environment, room_size, interpolation=cv2.INTER_AREA)
    return replace(studio, table=replace(top, picture=np.asarray(table)), environment=np.asarray(room))


def random_studio(seed: int, start: int, size_mm: float) -> Scene:
    """The studio of the images from number `start` on: any backdrop, any light."""
    light = str(np.random.default_rng([seed, start, 1]).choice(list(LIGHTS)))
    return make_studio((seed, start), size_mm, light=light)


def random_pose(
    rng: np.random.Generator, points: np.ndarray, camera: Camera, ranges: ViewRanges = NEAR_VIEWS
) -> np.ndarray:
    """(4, 4) `T_world_camera` somewhere around an object of these points (n, 3) that stands on the table.

    Within `ranges`: by default `render_training_images`'s.
    """
    azimuth, elevation, roll = rng.uniform(0, 360), ranges.draw_elevation(rng), rng.uniform(*ranges.roll_deg)
    target = np.array([0.0, 0.0, np.ptp(points[:, 2]) / 2])
    fill = rng.uniform(*ranges.fill)
    distance = distance_to_fill(camera, points, target, azimuth, elevation, fill=fill, roll_deg=roll)
    free = max((1 - fill) * 0.5, ranges.off_centre) * distance * camera.height / 2 / camera.fx
    return orbit_pose(target + rng.uniform(-free, free, 3) * [1, 1, 0], azimuth, elevation, distance, roll)


DETAIL = BakeDetail(key_rays=16, room_rays=64, surface_spacing=0.022, table_spacing=0.02)
"""Light for pictures of a few hundred pixels."""
TRAIN, HELD_OUT = 0, 1
"""Kinds of blocks: what is trained on and what is held out share no draw."""


@dataclass(frozen=True)
class PaintableObject:
    """An object whose texture is left out.

    Attributes:
        mesh: on the table, some of its materials sharing the texture to be left out, none of these metallic.
        material: index of one that has it.
        bare: the object in its own paint, for comparison.
    """

    mesh: Mesh
    material: int
    bare: Mesh


@dataclass(frozen=True)
class ViewSettings:
    """How views are drawn.

    Attributes:
        ranges: where the camera may stand.
        image_px: side of the square pictures.
        studios: blocks that are used together; successive blocks show successive subjects.
        per_studio: views of each.
    """

    ranges: ViewRanges = NEAR_VIEWS
    image_px: int = 224
    studios: int = 4
    per_studio: int = 24


@dataclass(frozen=True)
class RenderedView:
    """One view of a block.

    Attributes:
        subject: number of the object that it shows.
        view: what is seen, linear in the colours of the object's texture.
        bare: (s, s, 3) uint8 sRGB, the object in its own paint, where that was asked for.
        bare_light: (s, s, 3) float16 the same in linear light, where depth was asked for as well.
    """

    subject: int
    view: LinearView
    bare: np.ndarray | None
    bare_light: np.ndarray | None = None


class Setting(Protocol):
    """Where views are taken: in studios, or in a world."""

    def set_up(self, mesh: Mesh, draws: np.random.SeedSequence, kind: int) -> tuple[Scene, Stand]:
        """What a block of views of a mesh stands in, and where; `kind` is `TRAIN` or `HELD_OUT`."""
        ...

    def aim(
        self, renderer: RaycastRenderer, stand: Stand, draws: np.random.SeedSequence, settings: ViewSettings
    ) -> tuple[Camera, np.ndarray]:
        """A camera of `settings.image_px` a side that sees the object on its stand, and its `T_world_camera`."""
        ...


class StudioSetting:
    """Any backdrop, any light, the object turned at will, the camera anywhere in its ranges."""

    def set_up(self, mesh: Mesh, draws: np.random.SeedSequence, kind: int) -> tuple[Scene, Stand]:
        """A studio of its own for each block."""
        rng = np.random.default_rng(draws)
        light, stand = str(rng.choice(list(LIGHTS))), Stand(turn_deg=float(rng.uniform(0, 360)))
        seed = tuple(int(n) for n in draws.generate_state(2))
        return make_studio(seed, float(mesh.size_mm.max()), light=light), stand

    def aim(
        self, renderer: RaycastRenderer, stand: Stand, draws: np.random.SeedSequence, settings: ViewSettings
    ) -> tuple[Camera, np.ndarray]:
        """See `random_pose`."""
        camera = Camera.from_fov(settings.image_px, settings.image_px, FOV_DEG)
        return camera, random_pose(np.random.default_rng(draws), renderer.outline, camera, settings.ranges)


IN_STUDIO = StudioSetting()


def render_block(
    subjects: tuple[PaintableObject, ...], settings: ViewSettings, seed: int, kind: int, block: int, *,
    setting: Setting = IN_STUDIO, with_depth: bool = False,
) -> list[RenderedView]:  # fmt: skip
    """The views of one block; those held out with the object's own paint beside them."""
    draws = np.random.SeedSequence(seed, spawn_key=(kind, block))
    of_setting, *of_views = draws.spawn(1 + settings.per_studio)
    subject = subjects[block % len(subjects)]
    scene, stand = setting.set_up(subject.mesh, of_setting, kind)
    renderer = RaycastRenderer(subject.mesh, scene, DETAIL, stand)
    own_paint = RaycastRenderer(subject.bare, scene, DETAIL, stand) if kind == HELD_OUT else None
    texture = subject.mesh.materials[subject.material].texture
    views = []
    for i, of_view in enumerate(of_views):
        camera, pose = setting.aim(renderer, stand, of_view, settings)
        bare = light = None
        if own_paint is not None:
            light = own_paint.render(camera, pose)
            bare, light = tone_map(light, (seed, kind, block, i)), light.astype(np.float16) if with_depth else None
        view = renderer.render_linear(camera, pose, texture).packed()
        depth = find_depth(renderer, scene, camera, pose) if with_depth else None
        views.append(RenderedView(block % len(subjects), replace(view, depth=depth), bare, light))
    return views


class ViewStream:
    """Groups of `settings.studios` blocks, in order, each rendered while the one before it is used.

    A context manager: leaving it ends the threads. Outside it the blocks are rendered when they are asked for.
    """

    def __init__(
        self,
        subjects: list[PaintableObject],
        settings: ViewSettings,
        seed: int,
        groups: int,
        workers: int | None = None,
        *,
        setting: Setting = IN_STUDIO,
        with_depth: bool = False,
    ) -> None:
        """Prepare `groups` groups of training views.

        Args:
            subjects: at least one.
            settings: how views are drawn.
            seed: of all draws.
            groups: how many there are; none is rendered beyond.
            workers: threads that render ahead, by default one for each core; 0: whoever asks for a group renders it.
            setting: where views are taken; one that cannot be used raises when its views are asked for.
            with_depth: whether views shall have their depth, for weather.
        """
        self._setting, self._with_depth = setting, with_depth
        self._subjects, self.settings, self._seed, self._groups = tuple(subjects), settings, seed, groups
        self._workers = count_cores() if workers is None else workers
        self._pool: ThreadPoolExecutor | None = None
        self._waiting: dict[int, list[Future[list[RenderedView]]]] = {}
        self._current: tuple[int, list[RenderedView]] | None = None

    def __enter__(self) -> "ViewStream":
        if self._workers:
            self._pool = ThreadPoolExecutor(self._workers, "views")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = None
        self._waiting.clear()

    @property
    def views_per_group(self) -> int:
        """How many views a group has."""
        return self.settings.studios * self.settings.per_studio

    def group(self, number: int) -> list[RenderedView]:
        """The views of a group, and a beginning made with the next."""
        if self._current is None or self._current[0] != number:
            self._current = None  # frees the group before
            for stale in [n for n in self._waiting if n < number]:
                for future in self._waiting.pop(stale):
                    future.cancel()
            for n in range(number, min(number + 2, self._groups) if self._pool is not None else number + 1):
                if n not in self._waiting:
                    count = self.settings.studios
                    self._waiting[n] = self._start(TRAIN, range(n * count, (n + 1) * count))
            views = [view for future in self._waiting.pop(number) for view in future.result()]
            self._current = number, views
        return self._current[1]

    def held_out(self, blocks: int) -> list[RenderedView]:
        """Views that no group holds, each beside the object in its own paint."""
        return [view for future in self._start(HELD_OUT, range(blocks)) for view in future.result()]

    def _start(self, kind: int, blocks: range) -> "list[Future[list[RenderedView]]]":
        """The views of blocks, as they will be rendered; they are at once where there are no threads."""
        render = partial(
            render_block, self._subjects, self.settings, self._seed, kind,
            setting=self._setting, with_depth=self._with_depth,
        )  # fmt: skip
        if self._pool is not None:
            return [self._pool.submit(render, block) for block in blocks]
        futures = []
        for block in blocks:
            future: Future[list[RenderedView]] = Future()
            future.set_result(render(block))
            futures.append(future)
        return futures
