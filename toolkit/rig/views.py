"""Views to train on: a setting that is drawn, ranges for its cameras, and what is drawn of each view.

Never the poses of a plan. Block b of a run is `Draws(seed, b, kind)`, see `toolkit.core.draws`. Its setting and its
views have separate draws, so that a view depends on its number alone.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from types import TracebackType
from typing import Any, Protocol

import cv2
import numpy as np

from toolkit.core.child import count_cores
from toolkit.core.draws import Draws
from toolkit.core.threads import map_ahead
from toolkit.objects.mesh import Mesh
from toolkit.rig.camera import Camera, distance_to_fill, orbit_pose, pixel_rays
from toolkit.rig.lighting import BakeDetail
from toolkit.rig.renderer import Renderer
from toolkit.rig.renderers import RAYCAST, make_renderer
from toolkit.rig.scene import Scene, Stand
from toolkit.rig.shading import DepthBuffer, LinearView, tone_map
from toolkit.rig.studio import TRAINED_LIGHTS, make_studio

FOV_DEG = 30.5
"""Field of view of the square picture, degrees: what the middle of a 4:3 frame of 40° shows."""
PER_STUDIO = 24
"""Views of a setting: lighting it costs about as much as they do."""
TRAIN, HELD_OUT, PICTURES = "train", "held out", "pictures"
"""Kinds of blocks, which share no draw: what is trained on, what is held out, and pictures of the object as it is."""
DETAIL = BakeDetail(key_rays=16, room_rays=64, surface_spacing=0.022, table_spacing=0.02)
"""Light for pictures of a few hundred pixels."""
THUMBNAIL_DETAIL = BakeDetail(key_rays=10, room_rays=40, surface_spacing=0.035, table_spacing=0.03)
"""Light for pictures of up to 256 px, in which finer shade is not seen; about eight times as fast as in full detail."""
THUMBNAIL_TABLE_PX, THUMBNAIL_ROOM_PX = 640, 256


@dataclass(frozen=True)
class ViewRanges:
    """Ranges of random cameras, lowest and highest; the azimuth is anywhere."""

    elevation_deg: tuple[float, float] = (20.0, 70.0)  # above the table
    roll_deg: tuple[float, float] = (-8.0, 8.0)  # about the line of sight
    # share of the frame's shorter side that the object reaches; above 1 it is cut off
    fill: tuple[float, float] = (0.6, 0.95)
    # the object's middle is shifted by up to this share of the half frame even where it fills it
    off_centre: float = 0.0
    evenly: bool = False  # elevations are drawn evenly over the sphere's area, not over the angle

    def draw(self, rng: np.random.Generator) -> tuple[float, float, float, float]:
        """Azimuth, elevation and roll in degrees, and how much of the frame is filled."""
        azimuth = rng.uniform(0, 360)
        if self.evenly:  # rings of a sphere between equal steps of height have equal areas (Archimedes)
            elevation = float(np.degrees(np.arcsin(rng.uniform(*np.sin(np.radians(self.elevation_deg))))))
        else:
            elevation = rng.uniform(*self.elevation_deg)
        return azimuth, elevation, rng.uniform(*self.roll_deg), rng.uniform(*self.fill)


NEAR_VIEWS = ViewRanges()
WIDE_VIEWS = ViewRanges((5.0, 80.0), (-20.0, 20.0), (0.35, 1.05), 0.15)


def random_pose(
    rng: np.random.Generator, points: np.ndarray, camera: Camera, ranges: ViewRanges = NEAR_VIEWS
) -> np.ndarray:
    """(4, 4) `T_world_camera` somewhere around an object of these points (n, 3) that stands on the table.

    Within `ranges`; the camera looks a little beside the object.
    """
    # the order of the draws is part of the scheme: another order gives other views of the same seed
    azimuth, elevation, roll, fill = ranges.draw(rng)
    target = np.array([0.0, 0.0, np.ptp(points[:, 2]) / 2])
    distance = distance_to_fill(camera, points, target, azimuth, elevation, fill=fill, roll_deg=roll)
    # an object that leaves room is moved aside within it, on the ground: it still stands upright in the picture
    free = max((1 - fill) * 0.5, ranges.off_centre) * distance * camera.height / 2 / camera.fx
    return orbit_pose(target + rng.uniform(-free, free, 3) * [1, 1, 0], azimuth, elevation, distance, roll)


@dataclass(frozen=True)
class PaintableObject:
    """An object whose texture is left out."""

    mesh: Mesh  # on the table, some of its materials sharing the texture to be left out, none of these metallic
    material: int  # index of any of them
    bare: Mesh  # the object in its own paint, for comparison

    def for_block(self, draws: Draws) -> "PaintableObject":
        """As a block of views shows it; an object that looks another way in each takes it from the block's draws."""
        return self


@dataclass(frozen=True)
class ViewSettings:
    """How views are drawn."""

    ranges: ViewRanges = NEAR_VIEWS  # where the camera may stand
    image_px: int = 224  # side of the square pictures
    studios: int = 4  # blocks that are used together; successive blocks show successive subjects
    per_studio: int = PER_STUDIO  # views of each


class Setting(Protocol):
    """The surroundings of views: studios, or a world."""

    @property
    def detail(self) -> BakeDetail:
        """How finely light on the object is worked out."""
        ...

    def set_up(self, mesh: Mesh, draws: Draws) -> tuple[Scene, Stand]:
        """Scene and place of a block of views of a mesh; `HELD_OUT` has other places than the rest."""
        ...

    def aim(
        self, renderer: Renderer, stand: Stand, rng: np.random.Generator, settings: ViewSettings
    ) -> tuple[Camera, np.ndarray]:
        """A camera of `settings.image_px` a side that sees the object on its stand, and its `T_world_camera`."""
        ...


class OutdoorSetting(Setting, Protocol):
    """A world as the room of worlds opens it: it can say which of its places were trained on, and which held out."""

    def record(self, meshes: Sequence[Mesh]) -> dict[str, Any]:
        """The places and skies of the training views, for a booster's record."""
        ...

    def describe(self, meshes: Sequence[Mesh]) -> str:
        """The same in a line."""
        ...


@dataclass(frozen=True)
class StudioSetting:
    """Any backdrop, any light, the object turned at will, the camera anywhere in its ranges."""

    detail: BakeDetail = DETAIL  # see `Setting`
    is_coarse: bool = False  # the pictures of table and room are no finer than a thumbnail shows

    def set_up(self, mesh: Mesh, draws: Draws) -> tuple[Scene, Stand]:
        """Another studio for each block."""
        rng = draws.of("setting")
        light, stand = str(rng.choice(TRAINED_LIGHTS)), Stand(turn_deg=float(rng.uniform(0, 360)))
        studio = make_studio(draws.key("studio"), float(mesh.size_mm.max()), light=light)
        return _coarsen_studio(studio) if self.is_coarse else studio, stand

    def aim(
        self, renderer: Renderer, stand: Stand, rng: np.random.Generator, settings: ViewSettings
    ) -> tuple[Camera, np.ndarray]:
        """See `random_pose`."""
        camera = Camera.from_fov(settings.image_px, settings.image_px, FOV_DEG)
        return camera, random_pose(rng, renderer.outline, camera, settings.ranges)


def _coarsen_studio(studio: Scene) -> Scene:
    top = studio.need_table()
    h, w = top.picture.shape[:2]
    scale = min(1.0, THUMBNAIL_TABLE_PX / w)
    table = cv2.resize(top.picture, (round(w * scale), round(h * scale)), interpolation=cv2.INTER_AREA)
    room_size = (THUMBNAIL_ROOM_PX, THUMBNAIL_ROOM_PX // 2)
    room = cv2.resize(studio.environment, room_size, interpolation=cv2.INTER_AREA)
    return replace(studio, table=replace(top, picture=np.asarray(table)), environment=np.asarray(room))


IN_STUDIO = StudioSetting()
THUMBNAIL_STUDIO = StudioSetting(THUMBNAIL_DETAIL, is_coarse=True)


class ViewBlock:
    """A mesh in a setting, and cameras around it: view i depends on the block's draws and on i alone."""

    def __init__(self, mesh: Mesh, settings: ViewSettings, draws: Draws, setting: Setting = IN_STUDIO) -> None:
        """Draw the setting and light it."""
        self._settings, self._draws, self._setting = settings, draws, setting
        self.scene, self.stand = setting.set_up(mesh, draws)
        self.renderer = self.place(mesh)

    def place(self, mesh: Mesh) -> Renderer:
        """Another mesh in the same place and light."""
        return make_renderer(RAYCAST, mesh, self.scene, self._setting.detail, self.stand)

    def aim(self, number: int) -> tuple[Camera, np.ndarray]:
        """The camera of a view, and its `T_world_camera`."""
        rng = self._draws.of(f"camera {number}")
        return self._setting.aim(self.renderer, self.stand, rng, self._settings)

    def take(self, number: int) -> np.ndarray:
        """(s, s, 3) uint8 sRGB of the mesh in its own paint."""
        return self.develop(self.renderer.render(*self.aim(number)), number)

    def develop(self, light: np.ndarray, number: int) -> np.ndarray:
        """(s, s, 3) uint8 sRGB of the light of a view, with the grain that is drawn for it."""
        return tone_map(light, self._draws.key(f"grain {number}"))


def render_pictures(
    mesh: Mesh, count: int, settings: ViewSettings, seed: int | tuple[int, ...], *,
    setting: Setting = IN_STUDIO, threads: int | None = None,
) -> Iterator[np.ndarray]:  # fmt: skip
    """Yield `count` pictures of a mesh in its own paint, (s, s, 3) uint8 sRGB; picture i depends on (seed, i) alone.

    Args:
        settings: how they are drawn; each `per_studio` share a setting.
    """
    for start in range(0, count, settings.per_studio):
        block = ViewBlock(mesh, settings, Draws(seed, start // settings.per_studio, PICTURES), setting)
        yield from map_ahead(block.take, range(min(settings.per_studio, count - start)), threads)


@dataclass(frozen=True)
class RenderedView:
    """A view of a block."""

    subject: int  # number of the object that it shows
    view: LinearView  # what is seen, linear in the colours of the object's texture
    bare: np.ndarray | None  # (s, s, 3) uint8 sRGB, the object in its own paint, where that was asked for


def render_block(
    subjects: tuple[PaintableObject, ...], settings: ViewSettings, seed: int, kind: str, block: int, *,
    setting: Setting = IN_STUDIO, with_depth: bool = False, with_bare: bool = False, threads: int | None = 1,
    renderer: str = RAYCAST,
) -> list[RenderedView]:  # fmt: skip
    """The views of a block; those held out with the object's own paint beside them.

    Args:
        subjects: block number `block` shows the next of them.
        kind: `TRAIN` or `HELD_OUT`.
        with_depth: whether views shall have their depth, for weather.
        with_bare: whether views for training have the light of the object in its own paint beside them too.
        threads: see `map_ahead`; 1 if blocks are spread over the cores.
        renderer: name of the renderer of training images; if it is not the ray caster, views have their `repaint`.
    """
    draws = Draws(seed, block, kind)
    subject = subjects[block % len(subjects)].for_block(draws)
    shown = ViewBlock(subject.mesh, settings, draws, setting)
    # a second renderer is half of the work
    own_paint = shown.place(subject.bare) if with_bare or kind == HELD_OUT else None
    # the texture that is trained: a view is linear in it
    texture = subject.mesh.materials[subject.material].texture

    def render(number: int) -> RenderedView:
        camera, pose = shown.aim(number)
        view = shown.renderer.render_linear(camera, pose, texture).packed()
        if with_depth:
            view = replace(view, depth=find_depth(shown.renderer, shown.scene, camera, pose))
        # a second renderer paints when the texels are known, as it has no linear view
        if renderer != RAYCAST:
            view = replace(view, repaint=partial(_repaint, renderer, subject, shown.scene, shown.stand, camera, pose))
        if own_paint is None:
            return RenderedView(block % len(subjects), view, None)
        light = own_paint.render(camera, pose)
        # weather acts on light, so the light is kept; half precision, as in `LinearView.packed`
        if with_depth or with_bare:
            view = replace(view, bare=light.astype(np.float16))
        return RenderedView(block % len(subjects), view, shown.develop(light, number))

    return list(map_ahead(render, range(settings.per_studio), threads))


def _repaint(
    renderer: str, subject: PaintableObject, scene: Scene, stand: Stand, camera: Camera, T_world_camera: np.ndarray,
    pixels: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """(h, w, 3) float32 light of a view by a named renderer, with the texels (n, n, 3) uint8 sRGB on the object."""
    left_out = subject.mesh.materials[subject.material].texture
    painted = (replace(one, texture=pixels) if one.texture is left_out else one for one in subject.mesh.materials)
    mesh = replace(subject.mesh, materials=tuple(painted))
    return make_renderer(renderer, mesh, scene, stand=stand).render(camera, T_world_camera)


def find_depth(renderer: Renderer, scene: Scene, camera: Camera, T_world_camera: np.ndarray) -> DepthBuffer:
    """How far away everything in a view is: the object, what stands around it, the table; a room is endlessly far."""
    depth = renderer.buffers(camera, T_world_camera)["depth"]
    if scene.table is not None:
        x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        rays = pixel_rays(camera, T_world_camera, np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float32))
        # the table is no mesh: where a ray falls to z = 0 is worked out, and whether that is on the table top
        fall = np.minimum(rays[:, 5], -1e-6)
        reach = -rays[:, 2] / fall
        on_table = np.abs(rays[:, :2] + reach[:, None] * rays[:, 3:5]) <= np.array(scene.table.size_mm) / 2
        to_table = np.where(on_table.all(axis=1) & (reach > 0), reach, np.inf).reshape(depth.shape)
        depth = np.minimum(depth, to_table.astype(np.float32))
    return DepthBuffer(depth, camera, T_world_camera)


class ViewStream:
    """Groups of `settings.studios` blocks, in order, each rendered while the previous group is used.

    A context manager: leaving it ends the threads. Outside it the blocks are rendered when they are asked for.
    """

    def __init__(
        self, subjects: list[PaintableObject], settings: ViewSettings, seed: int, groups: int,
        workers: int | None = None, *, setting: Setting = IN_STUDIO, with_depth: bool = False,
        renderer: str = RAYCAST,
    ) -> None:  # fmt: skip
        """Prepare `groups` groups of training views.

        Args:
            groups: how many there are; none is rendered beyond.
            workers: threads that render ahead, by default as many as cores; 0: whoever asks for a group renders it.
            setting: where views are taken; it raises when its views are asked for if it cannot be used.
            with_depth: whether views shall have their depth, for weather.
            renderer: of the training views, see `render_block`; held-out views are the ray caster's.
        """
        self._setting, self._with_depth, self._renderer = setting, with_depth, renderer
        self._subjects, self.settings, self._seed, self._groups = tuple(subjects), settings, seed, groups
        self._workers = count_cores() if workers is None else workers
        self._pool: ThreadPoolExecutor | None = None
        # by group; at most the current group and the next
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

    def group(self, number: int) -> list[RenderedView]:
        """The views of a group, and a beginning made with the next."""
        if self._current is None or self._current[0] != number:
            self._current = None  # frees the group before
            # a run that resumes from a checkpoint may skip groups that were begun
            for stale in [n for n in self._waiting if n < number]:
                for future in self._waiting.pop(stale):
                    future.cancel()
            # with the next group begun, rendering goes on while this group is trained on
            for n in range(number, min(number + 2, self._groups) if self._pool is not None else number + 1):
                if n not in self._waiting:
                    count = self.settings.studios
                    self._waiting[n] = self._start(TRAIN, range(n * count, (n + 1) * count))
            views = [view for future in self._waiting.pop(number) for view in future.result()]
            self._current = number, views
        return self._current[1]

    def held_out(self, blocks: int, first: int = 0) -> list[RenderedView]:
        """Views that no group holds, each beside the object in its own paint; `first` numbers the first block."""
        self._current = None  # frees the group that was used last
        return [view for future in self._start(HELD_OUT, range(first, first + blocks)) for view in future.result()]

    def _start(self, kind: str, blocks: range) -> "list[Future[list[RenderedView]]]":
        """The views of blocks, as they will be rendered; they are at once where there are no threads."""
        render = partial(
            render_block, self._subjects, self.settings, self._seed, kind,
            setting=self._setting, with_depth=self._with_depth, renderer=self._renderer if kind == TRAIN else RAYCAST,
        )  # fmt: skip
        if self._pool is not None:
            return [self._pool.submit(render, block) for block in blocks]
        # futures that are done already look the same to whoever waits for them
        futures = []
        for block in blocks:
            future: Future[list[RenderedView]] = Future()
            future.set_result(render(block))
            futures.append(future)
        return futures
