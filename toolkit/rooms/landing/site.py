"""Pads and their place in a world: what is painted on them, where they may lie, what a camera above sees there.

Frame: as in `toolkit.rooms.worlds.world`, metres. The pad's own: its middle is the origin, x and y lie in its plane.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np

from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import sha256_bytes
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import read_image
from toolkit.objects.mesh import Material, Mesh, cast_rays
from toolkit.rig.bake_cache import BakedLight, keep_light, light_surroundings
from toolkit.rig.lighting import BakeDetail
from toolkit.rig.markers import get_dictionary
from toolkit.rig.mount import PAPER_MATERIAL
from toolkit.rig.renderers import make_renderer
from toolkit.rig.scene import Stand
from toolkit.rig.shading import tone_map
from toolkit.rooms.landing.config import CameraConfig, Ground
from toolkit.rooms.worlds.conditions import CLEAR
from toolkit.rooms.worlds.depth_weather import make_weather, weather_rng
from toolkit.rooms.worlds.own import WORLDS, build_world, load_world
from toolkit.rooms.worlds.particles import DepthView
from toolkit.rooms.worlds.picture import find_depths
from toolkit.rooms.worlds.place import make_scene
from toolkit.rooms.worlds.sky import Sky, make_sky
from toolkit.rooms.worlds.world import Spot, World

KINDS = ("plain", "apriltag", "grey", "noise")
PICTURE_PX = 512
NOISE_CELLS = 64
TAG_FAMILY, TAG = "DICT_APRILTAG_36h11", 7
SMALLEST_M, LARGEST_M = 0.2, 5.0
ROUGHNESS = 0.9
TAG_SHARE = 0.8
"""Side of the tag within its white edge, as a share of the pad's."""
SHEET_M = 0.01
"""The sheet lies so far above what is under it."""
FLAT_M = 0.03
"""Largest difference in height of the ground under a pad."""
LEAST_ROOM_M = 0.2
SKY_PX = 256
DETAIL = BakeDetail(key_rays=16, room_rays=64, surface_spacing=0.1, table_spacing=0.1)


@dataclass(frozen=True)
class Pad:
    """A square sheet with a picture."""

    name: str  # `plain`, `apriltag`, `grey`, `noise`, or that of a trained pad
    picture: np.ndarray  # (n, n, 3) uint8 sRGB; its top is the pad's +y
    size_m: float = 2.0  # side of the sheet, metres

    def __post_init__(self) -> None:
        if not SMALLEST_M <= self.size_m <= LARGEST_M:
            raise FieldError(f"expected {SMALLEST_M:g} to {LARGEST_M:g} m", {"size_m": self.size_m})

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of picture and size."""
        return sha256_bytes(repr((self.picture.shape, self.size_m)).encode() + self.picture.tobytes())

    @cached_property
    def mesh(self) -> Mesh:
        """The sheet in its own frame, metres: its middle is the origin, it faces up; the same for all places."""
        half = self.size_m / 2
        corners = np.array([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], np.float32)
        return Mesh(
            corners, np.tile(np.array([[0, 0, 1]], np.float32), (4, 1)),
            np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32), np.array([(0, 1, 2), (0, 2, 3)], np.int32),
            np.zeros(2, np.int32), (Material(PAPER_MATERIAL, self.picture, ROUGHNESS, sheet="glued"),),
        )  # fmt: skip


def draw_pad(kind: str, size_m: float = 2.0, seed: int = 0) -> Pad:
    """One of `KINDS`; `noise` is drawn by the seed; raises a `ToolkitError` if there is no such pad."""
    if kind not in KINDS:
        raise one_of("pad", kind, list(KINDS))
    if kind == "grey":
        return Pad(kind, np.full((64, 64, 3), 128, np.uint8), size_m)
    if kind == "noise":
        rng = np.random.default_rng([seed, 61])
        return Pad(kind, rng.integers(0, 256, (NOISE_CELLS, NOISE_CELLS, 3), np.uint8), size_m)
    return Pad(kind, _draw_tag() if kind == "apriltag" else _draw_plain(), size_m)


def find_pad(space: Workspace, word: str, size_m: float = 2.0, seed: int = 0) -> Pad:
    """One of `KINDS`, a trained pad `print/pads/NAME.png` of the workspace, or a picture file.

    Raises:
        ToolkitError: there is no such pad, or the picture is not square.
    """
    if word in KINDS:
        return draw_pad(word, size_m, seed)
    folder = space.print_dir / "pads"
    # a trained pad of the workspace comes before a file
    own = {file.stem: file for file in sorted(folder.glob("*.png"))}
    file = own.get(word) or Path(word)
    if not file.is_file():
        raise one_of("pad", word, [*KINDS, *own])
    picture = read_image(file)
    if picture.shape[0] != picture.shape[1]:
        size = f"{picture.shape[1]} × {picture.shape[0]}"
        raise ToolkitError(f"{file}: a picture of {size} pixels, expected a square: crop it")
    return Pad(file.stem, picture, size_m)


def _draw_plain() -> np.ndarray:
    """White H in a white ring on slate, with a pale edge (paper, Figure 10d)."""
    n, zoom = PICTURE_PX, 4
    side = n * zoom
    canvas = np.full((side, side, 3), (62, 70, 76), np.uint8)
    pale = (232, 232, 226)
    # edge, ring, and the H as two posts and a bar; drawn four times as large and averaged
    cv2.rectangle(canvas, (0, 0), (side - 1, side - 1), pale, side // 20)
    cv2.circle(canvas, (side // 2, side // 2), round(side * 0.37), pale, side // 16)
    for x in (0.36, 0.64):
        cv2.rectangle(canvas, _at(side, x - 0.04, 0.29), _at(side, x + 0.04, 0.71), pale, -1)
    cv2.rectangle(canvas, _at(side, 0.36, 0.46), _at(side, 0.64, 0.54), pale, -1)
    return cv2.resize(canvas, (n, n), interpolation=cv2.INTER_AREA)


def _at(side: int, x: float, y: float) -> tuple[int, int]:
    return round(side * x), round(side * y)


def _draw_tag() -> np.ndarray:
    """Tag 7 of AprilTag's family 36h11 with a white edge a cell wide."""
    cell = PICTURE_PX // 10
    bordered = np.pad(
        cv2.aruco.generateImageMarker(get_dictionary(TAG_FAMILY), TAG, 8 * cell), cell, constant_values=255
    )
    return np.repeat(bordered[..., None], 3, axis=2)


@dataclass(frozen=True)
class PadPlace:
    """The place of a pad."""

    name: str  # the spot's with a number
    centre: tuple[float, float, float]  # (x, y, z) of the sheet's middle, metres
    turn_deg: float  # of the pad, counter-clockwise from above


def find_world(word: str, seed: int = 0) -> World:
    """A built-in world by its name, or a user's file; raises as `build_world` and `load_world`."""
    path = Path(word)
    if word not in WORLDS and path.suffix and path.is_file():
        return load_world(path, seed=seed)
    return build_world(word, seed)


@lru_cache(maxsize=6)
def find_sky(time: str) -> Sky:
    """The sky over landings; the same object for the same time, so that a world is lit once under it."""
    return make_sky(time, height_px=SKY_PX)


def plan_places(
    world: World, size_m: float, count: int, seed: int = 0, ground: Ground = "both", without: Collection[str] = ()
) -> tuple[PadPlace, ...]:
    """Places for a pad, its spots in turn, each somewhere on its spot and turned by the seed.

    A pad is not in the middle of a deck, so that the deck's picture does not tell where it is.

    Args:
        seed: of the draws; place k depends on (seed, k) alone.
        ground: on decks (`pads`), on grass (`bare`), or both in turn.
        without: names of spots that are not meant, such as those that were trained on.

    Raises:
        ToolkitError: the world has no such spot, or the pad is larger than all of them.
    """
    # the spot of a landing pad is no bare ground, whatever lies under it
    bare = [spot for spot in world.spots if spot.place == "grass" and spot not in world.pads]
    spots = {"pads": list(world.pads), "bare": bare, "both": [*world.pads, *bare]}[ground]
    spots = [spot for spot in spots if spot.name not in without]
    if not spots:
        words = {"pads": "landing pad", "bare": "grass", "both": "landing pad or grass"}[ground]
        raise ToolkitError(f"{world.name} has no {words} that a pad could lie on: take another world")
    # half a diagonal: the pad may be turned any way
    reach = size_m / 2**0.5
    wide = [spot for spot in spots if spot.free_radius_m >= reach + LEAST_ROOM_M]
    if not wide:
        widest = max(spots, key=lambda spot: spot.free_radius_m)
        raise FieldError(
            f"larger than every place of {world.name}: the widest, '{widest.name}', is free for "
            f"{widest.free_radius_m:.3g} m around its middle",
            {"size_m": size_m},
        )
    return tuple(_draw_place(world, wide[k % len(wide)], size_m, Draws(seed, k, "landing"), k) for k in range(count))


def _draw_place(world: World, spot: Spot, size_m: float, draws: Draws, number: int) -> PadPlace:
    rng, room = draws.of("place"), spot.free_radius_m - size_m / 2**0.5
    for _ in range(30):
        # the root spreads points evenly over the disc
        distance, around, turn = room * rng.uniform() ** 0.5, rng.uniform(0, 2 * np.pi), rng.uniform(0, 360)
        x, y = spot.position[0] + distance * np.cos(around), spot.position[1] + distance * np.sin(around)
        # a pad that would hang over an edge or lie on a step is drawn again
        height = _flat_height(world, (x, y, spot.position[2]), size_m, turn)
        if height is not None:
            centre = (round(float(x), 4), round(float(y), 4), round(height + SHEET_M, 4))
            return PadPlace(f"{spot.name}-{number + 1}", centre, round(turn, 2))
    raise FieldError(
        f"'{spot.name}' of {world.name} has no level area for a pad of this side: take a smaller pad, or another world",
        {"size_m": size_m},
    )


def place_at(world: World, x: float, y: float, size_m: float, turn_deg: float = 0.0) -> PadPlace:
    """A place of the user's own: the highest surface there.

    Raises:
        ToolkitError: it is outside the world, or the pad is larger than what it would lie on.
    """
    low, high = world.bounds
    if not (low[0] < x < high[0] and low[1] < y < high[1]):
        raise FieldError(
            f"outside {world.name}, which goes from {low[0]:.0f} {low[1]:.0f} to {high[0]:.0f} {high[1]:.0f} m",
            {"at": (x, y)},
        )
    # the ray starts above everything in the world
    fall = _cast_down(world, np.array([[x, y, high[2] + 1.0]]))[0]
    height = _flat_height(world, (x, y, high[2] + 1.0 - fall), size_m, turn_deg) if np.isfinite(fall) else None
    if height is None:
        raise FieldError(
            f"a pad of {size_m:g} m is larger than the roof or ground at this place, or that is not level: make it "
            "smaller, or move it",
            {"at": (x, y)},
        )
    return PadPlace("own", (x, y, round(height + SHEET_M, 4)), turn_deg)


def _flat_height(world: World, middle: tuple[float, float, float], size_m: float, turn_deg: float) -> float | None:
    """Height of what lies under a pad, None where that is not level or something stands on it."""
    # 7 × 7 rays from 2 m above, the pad's corners and middle among them
    across = np.linspace(-size_m / 2, size_m / 2, 7)
    x, y = (grid.reshape(-1) for grid in np.meshgrid(across, across))
    local = np.stack([x, y, np.zeros(len(x))], axis=1)
    points = Stand(middle, turn_deg).to_world(local) + np.array([0, 0, 2.0])
    heights = points[:, 2] - _cast_down(world, points)
    if not np.isfinite(heights).all() or np.ptp(heights) > FLAT_M:
        return None
    return float(heights.max())


def _cast_down(world: World, points: np.ndarray) -> np.ndarray:
    """(n,) way down from points (n, 3) to the first surface; inf where there is none."""
    rays = np.zeros((len(points), 6), np.float32)
    rays[:, :3], rays[:, 5] = points, -1.0
    return cast_rays(world.shape.rays, rays)


@dataclass(frozen=True)
class SiteView:
    """Camera, noise and weather of a photograph."""

    T_world_camera: np.ndarray  # (4, 4) pose, metres
    seed: int  # of noise and weather, with `item`
    item: int  # number of the photograph among those of the seed
    weather: tuple[str, int] = CLEAR  # (name, severity)


class PadSite:
    """A pad on a place under a sky, ready to be photographed from above.

    Attributes:
        world, place, sky, pad: what it is made of.
        stand: the sheet's place for the renderer.
        renderer: of the pad with the world around it.
    """

    def __init__(self, world: World, place: PadPlace, sky: Sky, pad: Pad, optics: CameraConfig | None = None) -> None:
        """Light the pad."""
        self.world, self.place, self.sky, self.pad = world, place, sky, pad
        self.optics = optics or CameraConfig()
        self.camera = self.optics.camera
        self.stand = Stand(place.centre, place.turn_deg)
        self.mesh = pad.mesh
        self.renderer = make_renderer(self.optics.renderer, self.mesh, make_scene(world, sky), DETAIL, self.stand)

    @property
    def centre(self) -> np.ndarray:
        """(3,) of the pad, metres."""
        return np.array(self.place.centre)

    @cached_property
    def ground(self) -> "WorldGround":
        """The ground and obstacles here; the drone stands on the sheet."""
        return WorldGround(self.world)

    def truth(self, T_world_camera: np.ndarray) -> np.ndarray:
        """(3,) the pad's centre in the camera's frame, metres: x right, y down in the picture, z ahead."""
        return (self.centre - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]

    def look(self, T_world_camera: np.ndarray) -> tuple[DepthView, np.ndarray]:
        """Depth for weather, and (h, w) bool where the pad is seen."""
        found = self.renderer.buffers(self.camera, T_world_camera)
        return self._depth_view(T_world_camera, found, ("snow", 1)), found["mesh"] == 0

    def _depth_view(
        self, T_world_camera: np.ndarray, found: dict[str, np.ndarray], weather: tuple[str, int]
    ) -> DepthView:
        through = find_depths(self.world, self.sky, (self.camera, T_world_camera), found, [weather])
        if through.normals is not None:
            through.normals[found["mesh"] == 0] = (0, 0, 1)  # the sheet lies flat: snow covers it too
        return through

    def photograph(self, view: SiteView) -> np.ndarray:
        """(h, w, 3) uint8 sRGB through weather and sensor."""
        return self.photograph_with_mask(view)[0]

    def photograph_with_mask(self, view: SiteView) -> tuple[np.ndarray, np.ndarray]:
        """`photograph`, and (h, w) bool where the pad is seen, from the same rays."""
        light, found = self.renderer.render_with_depth(self.camera, view.T_world_camera)
        if view.weather != CLEAR:
            depth = self._depth_view(view.T_world_camera, found, view.weather)
            rng = weather_rng(view.seed, view.item, *view.weather)
            # on linear light, before the camera develops it
            light = make_weather(*view.weather).change_light(depth, self.sky.airlight, rng).apply(light)
        picture = tone_map(light.astype(np.float32), (view.seed, view.item), self.optics.noise)
        return picture, found["mesh"] == 0

    def with_pad(self, pad: Pad) -> "PadSite":
        """Another pad in the same place and light."""
        return PadSite(self.world, self.place, self.sky, pad, self.optics)


class WorldGround:
    """A world's surfaces, for `toolkit.rooms.landing.episodes`."""

    def __init__(self, world: World) -> None:
        self._world = world

    def height_below(self, points: np.ndarray) -> np.ndarray:
        """(n,) height of the first surface under points (n, 3); -inf where there is none."""
        fall = _cast_down(self._world, points)
        return np.where(np.isfinite(fall), points[:, 2] - fall, -np.inf)

    def is_hit(self, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
        """(n,) bool whether a surface lies between points."""
        # directions are not unit: a way of 1 is the end of the stretch
        rays = np.concatenate([start, stop - start], axis=1)
        return cast_rays(self._world.shape.rays, rays) <= 1.0


class Sites:
    """Pads on the places of a world, each lit when it is first asked for; they can be sent to another process.

    Attributes:
        world, places: where.
        optics: of the camera.
    """

    def __init__(self, world: World, places: Sequence[PadPlace], times: Sequence[str], optics: CameraConfig) -> None:
        """Not lit yet; places have the times of day in turn, two with each time, as decks and grass alternate."""
        self.world, self.places, self.optics = world, tuple(places), optics
        self._skies, self._lit = tuple(find_sky(time) for time in times), dict[tuple[str, int], PadSite]()
        self._light: tuple[BakedLight, ...] = ()

    def light_world(self) -> None:
        """Work out each sky's light on the world, for all processes that these are sent to."""
        self._light = tuple(light_surroundings(make_scene(self.world, sky)) for sky in self._skies)

    def __getstate__(self) -> dict[str, object]:
        """Without pads that are lit: another process lights its own, in the same light of the world."""
        return self.__dict__ | {"_lit": {}}

    def site(self, pad: Pad, number: int) -> PadSite:
        """A pad on a place by its number."""
        # by the picture, not by the name: two pads may be called alike
        key = pad.sha256, number
        if key not in self._lit:
            time = self._time(number)
            if self._light:
                keep_light(make_scene(self.world, self._skies[time]), self._light[time])
            self._lit[key] = PadSite(self.world, self.places[number], self._skies[time], pad, self.optics)
        return self._lit[key]

    def light_pads(self, pad: Pad, numbers: Iterable[int]) -> None:
        """Light a pad on some places, sky by sky: what is worked out of a sky is kept for few of them."""
        for number in sorted(set(numbers), key=lambda number: (self._time(number), number)):
            self.site(pad, number)

    def _time(self, number: int) -> int:
        return number // 2 % len(self._skies)
