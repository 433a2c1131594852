"""The table-top studio: key light, the room around it, the table and its backdrop, all from a seed."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from toolkit.core.cache import keep_arrays
from toolkit.core.errors import one_of
from toolkit.imaging.colour import LINEAR_OF_CODE, linear_to_srgb, srgb_to_linear
from toolkit.rig.scene import KeyLight, Scene, Table, illuminate

if TYPE_CHECKING:
    from toolkit.rig.board import Board

PX_PER_MM = 1.0
MAX_SIDE_PX = 2400


Painter = Callable[[np.random.Generator, tuple[float, float]], np.ndarray]
"""(rng, (width, height) mm) -> (h, w, 3) uint8 sRGB."""


@dataclass(frozen=True)
class TableTop:
    """A surface and its roughness."""

    paint: Painter
    roughness: float


def _size_px(size_mm: tuple[float, float]) -> tuple[int, int]:
    scale = min(PX_PER_MM, MAX_SIDE_PX / max(size_mm))
    return max(8, round(size_mm[0] * scale)), max(8, round(size_mm[1] * scale))


def _noise(rng: np.random.Generator, shape: tuple[int, int], cell: tuple[float, float], octaves: int = 4) -> np.ndarray:
    """(h, w) float32 smooth noise about 0 with unit-ish range; `cell` is the coarsest grain in pixels (x, y)."""
    import cv2

    height, width = shape
    total = np.zeros(shape, np.float32)
    for octave in range(octaves):
        cells = max(2, int(width / cell[0] * 2**octave)), max(2, int(height / cell[1] * 2**octave))
        grid = rng.standard_normal((min(cells[1], height), min(cells[0], width))).astype(np.float32)
        # value noise in octaves: twice as fine each time, and a little more than half as strong
        total += cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC) * 0.55**octave
    return total / 1.6


def _tint(base: tuple[int, int, int], shade: np.ndarray) -> np.ndarray:
    """Base colour times (1 + shade), as uint8."""
    return (np.array(base, np.float32) * (1 + shade[..., None])).clip(0, 255).astype(np.uint8)


def _wood(light: tuple[int, int, int], dark: tuple[int, int, int], plank_mm: float) -> Painter:
    def paint(rng: np.random.Generator, size_mm: tuple[float, float]) -> np.ndarray:
        width, height = _size_px(size_mm)
        scale = width / size_mm[0]
        plank = max(4, round(plank_mm * scale))
        rows = []
        # plank by plank: each has its own grain and shade
        for top in range(0, height, plank):
            h = min(plank, height - top)
            warp = _noise(rng, (h, width), (500 * scale, 60 * scale), 3)
            y = np.arange(h, dtype=np.float32)[:, None] / scale
            # growth rings across the plank, bent by slow noise as the grain of sawn wood is
            rings = np.sin((y / rng.uniform(7, 13) + 1.6 * warp + rng.uniform(0, 9)) * 2 * np.pi) * 0.5 + 0.5
            fibre = _noise(rng, (h, width), (70 * scale, 1.6), 2) * 0.16
            mix = (0.42 * rings**1.5 + 0.18 * warp + fibre + rng.uniform(0.1, 0.34)).clip(0, 1)[..., None]
            board = np.array(light, np.float32) * (1 - mix) + np.array(dark, np.float32) * mix
            # a dark joint to the plank above
            if top:
                board[: max(1, round(0.8 * scale))] *= 0.55
            rows.append(board)
        return np.concatenate(rows).clip(0, 255).astype(np.uint8)

    return paint


def _plain(base: tuple[int, int, int], mottle: float, grain: float) -> Painter:
    def paint(rng: np.random.Generator, size_mm: tuple[float, float]) -> np.ndarray:
        width, height = _size_px(size_mm)
        cloud = _noise(rng, (height, width), (260, 260), 4) * mottle
        return _tint(base, cloud + rng.standard_normal((height, width)).astype(np.float32) * grain)

    return paint


def _linen(base: tuple[int, int, int], stripe: tuple[int, int, int]) -> Painter:
    def paint(rng: np.random.Generator, size_mm: tuple[float, float]) -> np.ndarray:
        width, height = _size_px(size_mm)
        scale = width / size_mm[0]
        weft = _noise(rng, (height, width), (40, 1.5), 2) * 0.05
        warp = _noise(rng, (height, width), (1.5, 40), 2) * 0.05
        cloth = _tint(base, weft + warp).astype(np.float32)
        # stripes of 9 mm every 70 mm, both ways; where they cross their dyes add up
        x, y = np.arange(width) / scale, np.arange(height) / scale
        bands = 0.45 * (x % 70 < 9)[None, :, None] + 0.45 * (y % 70 < 9)[:, None, None]
        return (cloth * (1 - bands) + np.array(stripe, np.float32) * bands).clip(0, 255).astype(np.uint8)

    return paint


TABLES: dict[str, TableTop] = {
    "oak": TableTop(_wood((205, 170, 126), (150, 108, 68), 140), 0.5),
    "walnut": TableTop(_wood((118, 82, 58), (70, 45, 32), 120), 0.45),
    "white": TableTop(_plain((226, 225, 222), 0.012, 0.006), 0.4),
    "concrete": TableTop(_plain((152, 150, 146), 0.07, 0.025), 0.8),
    "linen": TableTop(_linen((214, 206, 190), (150, 60, 56)), 0.95),
    "slate": TableTop(_plain((72, 78, 84), 0.08, 0.03), 0.7),
    "birch": TableTop(_wood((228, 204, 164), (200, 166, 118), 400), 0.5),
}


WALLS = ((226, 221, 210), (205, 212, 214), (222, 214, 196), (196, 201, 190), (214, 205, 205))
FLOORS = ((120, 92, 66), (98, 96, 94), (150, 128, 100), (74, 62, 54))
BOOKS = ((148, 48, 42), (38, 70, 104), (196, 160, 80), (54, 92, 66), (212, 206, 190), (60, 52, 60), (180, 96, 48))


def paint_room(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """(h, w, 3) float32 linear radiance, equirectangular: ceiling, walls with windows, shelves and pictures, floor.

    A white wall in the room's even light has radiance near 0.5; windows are several times brighter.
    """
    import cv2

    height, width = shape
    room = np.empty((height, width, 3), np.float32)
    wall = srgb_to_linear(np.array(WALLS[rng.integers(len(WALLS))]) / 255)
    floor = srgb_to_linear(np.array(FLOORS[rng.integers(len(FLOORS))]) / 255)
    # rows go from straight up to straight down: walls from 41° above the horizon to 22° below it
    horizon, ceiling, skirting = height // 2, round(height * 0.27), round(height * 0.62)
    room[:ceiling] = 0.85 * np.array([1.0, 0.99, 0.97])
    room[ceiling:skirting] = 0.8 * wall
    room[skirting:] = 0.6 * floor
    # walls are lighter below the ceiling than above the skirting
    room[ceiling:skirting] *= np.linspace(1.15, 0.8, skirting - ceiling)[:, None, None]
    # four of six places round the room are furnished
    for azimuth in rng.permutation(np.arange(0, 360, 60))[:4] + rng.uniform(-12, 12, 4):
        furnish = (_window, _shelf, _picture)[rng.integers(3)]
        furnish(room, rng, int(azimuth / 360 * width), horizon)
    _window(room, rng, int(rng.uniform(0.30, 0.44) * width), horizon)  # a room has a window
    # the left edge meets the right edge: three side by side are blurred, the middle is kept
    tiled = np.concatenate([room, room, room], axis=1)  # blur across the seam
    blurred = cv2.GaussianBlur(tiled, (0, 0), width / 110)[:, width : 2 * width]
    return np.ascontiguousarray(blurred, np.float32)


def paint_sky(shape: tuple[int, int]) -> np.ndarray:
    """(h, w, 3) float32 linear radiance, equirectangular: a clear sky without its sun, bright at the horizon; lawn."""
    height, width = shape
    upward = np.sin(np.pi / 2 - (np.arange(height) + 0.5) * np.pi / height)[:, None]
    haze = np.exp(-4 * upward.clip(0))
    sky = haze * [0.62, 0.68, 0.75] + (1 - haze) * [0.14, 0.26, 0.55]
    rows = np.where(upward > 0, sky, [0.11, 0.14, 0.06])
    return np.repeat(rows[:, None].astype(np.float32), width, axis=1)


def _rectangle(room: np.ndarray, box: tuple[int, int, int, int], colour: ArrayLike) -> None:
    """Fill a rectangle (left, top, width, height) that may cross the seam."""
    x, y, w, h = box
    columns = np.arange(x, x + w) % room.shape[1]
    room[max(y, 0) : y + h, columns] = colour


def _window(room: np.ndarray, rng: np.random.Generator, x: int, horizon: int) -> None:
    w, h = int(rng.integers(40, 64)), int(rng.integers(36, 48))
    top = horizon - h - 4
    _rectangle(room, (x - 2, top - 2, w + 4, h + 4), [0.5, 0.49, 0.47])
    pane = w // 2 - 2
    for left in (x, x + w - pane):
        _rectangle(room, (left, top, pane, h), np.array([2.5, 2.65, 2.9]) * rng.uniform(0.9, 1.3))


def _shelf(room: np.ndarray, rng: np.random.Generator, x: int, horizon: int) -> None:
    _rectangle(room, (x, horizon - 46, 54, 72), [0.13, 0.09, 0.06])
    for row in range(4):
        left = x + 2
        while left < x + 48:
            w, h = int(rng.integers(2, 6)), int(rng.integers(10, 15))
            colour = srgb_to_linear(np.array(BOOKS[rng.integers(len(BOOKS))]) / 255) * 0.5
            _rectangle(room, (left, horizon - 44 + 17 * row + (15 - h), w, h), colour)
            left += w


def _picture(room: np.ndarray, rng: np.random.Generator, x: int, horizon: int) -> None:
    w, h = int(rng.integers(18, 34)), int(rng.integers(18, 30))
    _rectangle(room, (x - 2, horizon - 40, w + 4, h + 4), [0.06, 0.05, 0.05])
    for band in range(4):
        _rectangle(room, (x, horizon - 38 + band * h // 4, w, h // 4), srgb_to_linear(rng.uniform(0.2, 0.8, 3)) * 0.6)


ENVIRONMENT_SHAPE = (256, 512)


LIGHTS: dict[str, KeyLight] = {
    "studio": KeyLight(),
    "side": KeyLight(azimuth_deg=95, elevation_deg=24, radius_deg=5, irradiance=(2.9, 2.8, 2.7)),
    "warm": KeyLight(azimuth_deg=-35, elevation_deg=48, irradiance=(2.6, 1.95, 1.25)),
    "dim": KeyLight(elevation_deg=60, radius_deg=12, irradiance=(0.55, 0.55, 0.6)),
    "lamp": KeyLight(azimuth_deg=-50, elevation_deg=38, radius_deg=0.5, irradiance=(3.2, 2.8, 2.2)),
    "sky": KeyLight(azimuth_deg=60, elevation_deg=35, radius_deg=0.27, irradiance=(3.6, 3.3, 2.8)),
}
ROOM_LIGHT = {"studio": 1.0, "side": 0.55, "warm": 0.75, "dim": 0.45, "lamp": 0.12}
TRAINED_LIGHTS = ("studio", "side", "warm", "dim")
"""Lights of training images; the others are for tests: a hard lamp in a dark room, and sun and sky."""
BACKDROPS = tuple(TABLES)


def name_studio(seed: int | tuple[int, ...] = 0, backdrop: str | None = None, light: str = "studio") -> str:
    """The name of the studio that `make_studio` makes; nothing is painted for it. Raises as `make_studio`."""
    if light not in LIGHTS:
        raise one_of("light", light, list(LIGHTS))
    if backdrop is not None and backdrop not in TABLES:
        raise one_of("backdrop", backdrop, list(BACKDROPS))
    drawn = _draw_backdrop(_begin_draws(seed))
    return f"{backdrop or drawn}/{light}/{'-'.join(map(str, _seeds_of(seed)))}"


def _seeds_of(seed: int | tuple[int, ...]) -> tuple[int, ...]:
    return (seed,) if isinstance(seed, int) else seed


def _begin_draws(seed: int | tuple[int, ...]) -> np.random.Generator:
    # a stream of the studio's own: another use of the same seed shares no draw with it
    return np.random.default_rng([*_seeds_of(seed), 0x57D10])


def _draw_backdrop(rng: np.random.Generator) -> str:
    return BACKDROPS[int(rng.integers(len(BACKDROPS)))]


@lru_cache(maxsize=4)
def make_studio(
    seed: int | tuple[int, ...] = 0, scale_mm: float = 270.0, backdrop: str | None = None, light: str = "studio",
    *, keep: bool = False,
) -> Scene:  # fmt: skip
    """A studio whose backdrop, unless named, and details follow from the seed.

    Args:
        scale_mm: longest side of the object; the table is sized to it.
        keep: whether its pictures are kept on disk for other runs.

    Raises:
        ToolkitError: an unknown backdrop or light.
    """
    name = name_studio(seed, backdrop, light)
    kind, key, table_mm = TABLES[name.partition("/")[0]], LIGHTS[light], (6.4 * scale_mm, 4.8 * scale_mm)

    def paint() -> dict[str, np.ndarray]:
        rng = _begin_draws(seed)
        # drawn even where a backdrop is named, so that the rest of the studio is the same either way
        _draw_backdrop(rng)
        table = kind.paint(rng, table_mm)
        # the room takes on the key light's tint
        warmth = np.array([key.irradiance[0], key.irradiance[1], key.irradiance[2]]) / max(key.irradiance)
        if light == "sky":  # it has its own colours
            return {"table": table, "room": paint_sky(ENVIRONMENT_SHAPE)}
        room = paint_room(rng, ENVIRONMENT_SHAPE) * np.float32(ROOM_LIGHT[light]) * warmth.astype(np.float32)
        return {"table": table, "room": room}

    # the name holds backdrop, light and seed: with the table's size, all that is painted
    painted = keep_arrays("studio", [name, table_mm], paint) if keep else paint()
    table, room = painted["table"], painted["room"]
    return Scene(name, key, room, _expose(key, room, table), Table(table, table_mm, kind.roughness))


def _expose(key: KeyLight, environment: np.ndarray, table: np.ndarray) -> float:
    """Meter the open table as a camera would: bright tables stay bright, dark ones dark, dim light a bit dim."""
    irradiance = float(illuminate(environment, key).mean())
    albedo = float(srgb_to_linear(table[::8, ::8] / 255).mean())
    # a power under 1: a white table comes out brighter than a black table, but less than it is
    wanted = 0.62 * albedo**0.65
    # what a matt table of this albedo sends out, brought to the wanted level
    metered = wanted / (albedo * irradiance / np.pi)
    full = 0.9
    # in dim light a camera makes up for half of what is missing, in stops
    return metered * (1 if irradiance > full else (irradiance / full) ** 0.5)


INK, PAPER = 28, 236
"""sRGB of a laser printer's black and of office paper."""
PAPER_EDGE_MM = 9.0
"""White paper round the board."""
FINE_PX_PER_MM = 3.0
MOST_PX = 4200
"""Longer side of the table's picture at most: it is kept in float while a scene is shot."""


def add_board(studio: Scene, board: "Board", px_per_mm: float | None = None) -> Scene:
    """The same studio with a board in the middle of its table, its edge marked FRONT to +x, its right to +y.

    Args:
        studio: whose table is large enough for the board.
        px_per_mm: of the table's picture; by default as fine as the markers need and the memory allows.
    """
    import cv2

    bare = studio.need_table()
    wide_mm, high_mm = bare.size_mm
    fine = px_per_mm or min(FINE_PX_PER_MM, MOST_PX / max(wide_mm, high_mm))
    page = np.pad(board.paint(fine), round(PAPER_EDGE_MM * fine), constant_values=255)
    sheet = np.rot90(page)  # rows run down the page, which is +x; in the table's picture x runs right and y up
    # an even margin on both sides keeps the sheet's middle in the picture's
    wide, high = (
        side + 2 * max(0, round((mm * fine - side) / 2))
        for mm, side in zip(bare.size_mm, sheet.shape[::-1], strict=True)
    )
    # as fine as the sheet that is laid on it
    table = cv2.resize(bare.picture, (wide, high), interpolation=cv2.INTER_CUBIC)
    ink, paper = srgb_to_linear(np.array([INK, PAPER]) / 255)
    # half-covered pixels mix light, not codes
    shades = np.round(linear_to_srgb(ink + LINEAR_OF_CODE * (paper - ink)) * 255).astype(np.uint8)
    top, left = (high - sheet.shape[0]) // 2, (wide - sheet.shape[1]) // 2
    table[top : top + sheet.shape[0], left : left + sheet.shape[1]] = shades[sheet][..., None]
    laid = Table(table, (wide / fine, high / fine), bare.roughness)
    return replace(studio, name=name_with_board(studio.name), table=laid)


def name_with_board(name: str) -> str:
    """The name of a studio on whose table a board lies."""
    return f"{name}/board"
