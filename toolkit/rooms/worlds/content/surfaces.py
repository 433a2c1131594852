"""What walls, windows and grounds show, painted to repeat: brick, stone and render, panes, asphalt, grass, water."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from toolkit.rooms.worlds.content.drawing import (
    Canvas,
    Colour,
    Rng,
    finish,
    flat,
    fractal,
    grain,
    hex_name,
    noise,
    stains,
)
from toolkit.rooms.worlds.content.pieces import Looks, Skin, painted

SIDE_PX = 512
SQUARE = (SIDE_PX, SIDE_PX)
BRICKS: tuple[Colour, ...] = (
    (138, 66, 50), (112, 54, 44), (158, 92, 66), (176, 134, 98), (122, 84, 66), (96, 60, 52), (148, 74, 62),
    (188, 160, 128), (110, 104, 98), (164, 104, 84),
)  # fmt: skip
STONES: tuple[Colour, ...] = (
    (196, 184, 160), (176, 170, 158), (206, 192, 164), (158, 152, 144), (186, 164, 136), (208, 204, 194),
)  # fmt: skip
RENDERS: tuple[Colour, ...] = (
    (214, 190, 140), (208, 168, 128), (196, 200, 188), (222, 208, 182), (186, 198, 204), (206, 150, 124),
    (226, 222, 210), (172, 186, 164), (216, 196, 196), (190, 124, 96),
)  # fmt: skip
COLUMNS, ROWS = 8, 2
GLOW_SHRINK = 2
WARM: Colour = (255, 204, 128)
Span = tuple[float, float]
STREET_M, AVENUE_M = 13.0, 20.0
"""Widths of the carriageways."""
CROSSING_M = 4.5
JUNCTION_TILE_M = 14.0
MARK_M = 0.004
"""Height of marks that are laid on the ground as separate faces."""
WHITE_PAINT, YELLOW_PAINT = (214, 214, 208), (214, 164, 44)
PARKING_M = 2.3
TRACKS_M = (-2.4, -0.96, 0.96, 2.4)
"""Places of the tram's rails, from the middle of an avenue."""


def _masonry(rng: Rng, colour: Colour, rows: int, columns: int, *, joint_px: float, spread: float) -> np.ndarray:
    """(n, n, 3) courses of blocks, every second course set off by half, each block of another shade."""
    n = SIDE_PX
    y, x = np.mgrid[0:n, 0:n].astype(np.float32) + 0.5
    row = (y * rows / n).astype(int)
    # running bond: every other course is set off by half a block
    across = x * columns / n + 0.5 * (row % 2)
    # the last block of a course is the other half of the first: the texture repeats
    column = across.astype(int) % columns
    shade = rng.normal(1, spread, (rows, columns)) + rng.choice([0, 0, 0, -2 * spread], (rows, columns))
    hue = rng.normal(0, 5 * spread / 0.1, (rows, columns, 3))
    colours = np.array(colour) * shade[row, column][..., None] + hue[row, column]
    edge_y = np.abs((y * rows / n) % 1 - 0.5) * n / rows
    edge_x = np.abs(across % 1 - 0.5) * n / columns
    # pixels inside of the nearest edge of the block
    inset = np.minimum(n / rows / 2 - edge_y, n / columns / 2 - edge_x)
    joint = np.clip((inset - joint_px / 2) / 1.2 + 0.5, 0, 1)[..., None]
    mortar = np.array(colour, np.float32) * 0.45 + np.array((172, 166, 156)) * 0.45
    # upper rims catch the light, lower ones lie in shade
    lit = 1 + 0.07 * np.clip(2.5 - inset, 0, 2.5)[..., None] * (((y * rows / n) % 1 < 0.5)[..., None] * 2 - 1)
    return (colours * lit * joint + mortar * (1 - joint)).astype(np.float32)


def paint_brick(rng: Rng, colour: Colour) -> np.ndarray:
    """Brickwork, 2.88 m square."""
    bricks = _masonry(rng, colour, 38, 12, joint_px=2.2, spread=0.11)
    shape = bricks.shape[:2]
    return finish(bricks * stains(rng, shape, 0.1) + grain(rng, shape, 5))


def paint_ashlar(rng: Rng, colour: Colour) -> np.ndarray:
    """Dressed stone in courses of 45 cm, 3.6 m square."""
    stone = _masonry(rng, colour, 8, 5, joint_px=3.0, spread=0.045)
    shape = stone.shape[:2]
    weathered = stone * stains(rng, shape, 0.13) * (1 + 0.05 * fractal(rng, shape, 24, 4))[..., None]
    return finish(weathered + grain(rng, shape, 4))


def paint_render(rng: Rng, colour: Colour) -> np.ndarray:
    """Painted stucco with rain streaks, 4 m square."""
    wall = flat(SQUARE, colour) * stains(rng, SQUARE, 0.12) * (1 + 0.03 * fractal(rng, SQUARE, 40, 4))[..., None]
    return finish(wall + grain(rng, SQUARE, 3))


def paint_concrete(rng: Rng, colour: Colour) -> np.ndarray:
    """Board-marked concrete panels with tie holes, 4 m square."""
    wall = flat(SQUARE, colour) * stains(rng, SQUARE, 0.2) * (1 + 0.05 * fractal(rng, SQUARE, 16, 5))[..., None]
    wall[:4] *= 0.62
    wall[:, :3] *= 0.66
    wall[SIDE_PX // 2 : SIDE_PX // 2 + 3] *= 0.74
    for x in (64, 192, 320, 448):
        for y in (64, 192, 320, 448):
            cv2.circle(wall, (x, y), 4, tuple(float(c) * 0.45 for c in colour), -1, cv2.LINE_AA)
    return finish(wall + grain(rng, SQUARE, 4))


def paint_cladding(rng: Rng, colour: Colour) -> np.ndarray:
    """Ribbed sheet metal with rust runs, 3 m square."""
    x = np.arange(SIDE_PX)
    rib = 1 + 0.16 * np.sign(np.sin(2 * np.pi * x * 16 / SIDE_PX)) * np.abs(np.sin(2 * np.pi * x * 16 / SIDE_PX)) ** 0.3
    wall = flat(SQUARE, colour) * rib[None, :, None] * stains(rng, SQUARE, 0.12)
    wall[::170] *= 0.8
    rust = np.clip(noise(rng, SQUARE, (3, 40)) * 1.4 - 0.75, 0, 1)[..., None]
    return finish(wall * (1 - rust) + np.array((120, 72, 44)) * rust + grain(rng, SQUARE, 3))


def paint_roofing(rng: Rng, colour: Colour) -> np.ndarray:
    """Roofing felt or gravel with seams, patches and puddle rims, 6 m square."""
    roof = flat(SQUARE, colour) * (1 + 0.1 * fractal(rng, SQUARE, 4, 5))[..., None] + grain(rng, SQUARE, 9)
    for row in range(0, SIDE_PX, 128):
        roof[row : row + 3] *= 0.74
        roof[row + 3 : row + 5] *= 1.1
    for _ in range(5):
        y, x, h, w = rng.integers(0, 400), rng.integers(0, 400), rng.integers(30, 100), rng.integers(30, 110)
        roof[y : y + h, x : x + w] *= rng.uniform(0.84, 1.08)
    puddle = np.abs(fractal(rng, SQUARE, 3, 3) - 0.55) < 0.05
    return finish(roof * (1 - 0.12 * puddle[..., None]))


def paint_tiles(rng: Rng, colour: Colour) -> np.ndarray:
    """Roof tiles in courses of 30 cm, 3 m square."""
    tiles = _masonry(rng, colour, 10, 14, joint_px=1.2, spread=0.1)
    y = (np.arange(SIDE_PX) * 10 / SIDE_PX) % 1
    shape = tiles.shape[:2]
    return finish(tiles * (1.12 - 0.36 * y**3)[:, None, None] * stains(rng, shape, 0.14) + grain(rng, shape, 4))


PAINTERS: dict[str, tuple[Callable[[Rng, Colour], np.ndarray], float, float]] = {
    "brick": (paint_brick, 2.88, 0.9), "ashlar": (paint_ashlar, 3.6, 0.85), "render": (paint_render, 4.0, 0.9),
    "concrete": (paint_concrete, 4.0, 0.9), "cladding": (paint_cladding, 3.0, 0.5),
    "roofing": (paint_roofing, 6.0, 0.95), "tiles": (paint_tiles, 3.0, 0.8),
}  # fmt: skip


def wall(looks: Looks, kind: str, colour: Colour) -> Skin:
    """The skin of a wall or roof of a kind and colour."""
    paint, tile_m, roughness = PAINTERS[kind]
    return looks.paint(f"{kind}-{hex_name(colour)}", lambda rng: paint(rng, colour), roughness, (tile_m, tile_m))


@dataclass(frozen=True)
class PaneStyle:
    """How a kind of window is made."""

    frame: Colour  # colour of its frame
    glass: Colour = (150, 170, 188)  # colour of what it mirrors, at its upper edge
    bars: tuple[int, int] = (1, 1)  # glazing bars across and up
    frame_m: float = 0.07  # frame_m, bar_m: their widths
    bar_m: float = 0.035
    size_m: tuple[float, float] = (1.1, 1.7)  # of a pane
    curtains: float = 0.7  # share of the panes with curtains or blinds
    arched: bool = False  # whether its head is round


STYLES = {
    "sash-white": PaneStyle((226, 224, 216), bars=(1, 1)),
    "sash-grid": PaneStyle((236, 234, 228), bars=(2, 3), bar_m=0.03),
    "sash-green": PaneStyle((44, 62, 52), bars=(1, 1)),
    "casement": PaneStyle((92, 64, 44), bars=(1, 0), size_m=(1.3, 1.6)),
    "modern": PaneStyle((52, 54, 58), bars=(1, 0), frame_m=0.05, size_m=(1.8, 1.6)),
    "band": PaneStyle((190, 192, 194), bars=(2, 0), frame_m=0.05, size_m=(3.0, 1.7), curtains=0.5),
    "arched": PaneStyle((70, 60, 52), bars=(1, 3), size_m=(1.2, 2.4), curtains=0.2, arched=True),
    "tall": PaneStyle((206, 198, 182), bars=(1, 2), size_m=(1.2, 2.3)),
    "factory": PaneStyle((60, 74, 72), bars=(4, 4), size_m=(2.6, 2.4), curtains=0.1, bar_m=0.03),
    "curtain-blue": PaneStyle((96, 106, 116), (128, 172, 206), (0, 0), 0.04, size_m=(1.5, 2.6), curtains=0.35),
    "curtain-green": PaneStyle((60, 72, 70), (120, 168, 160), (0, 0), 0.04, size_m=(1.5, 2.6), curtains=0.35),
    "curtain-bronze": PaneStyle((64, 52, 42), (172, 146, 116), (0, 0), 0.04, size_m=(1.5, 2.6), curtains=0.35),
    "curtain-dark": PaneStyle((40, 42, 46), (116, 130, 146), (0, 0), 0.04, size_m=(1.5, 2.6), curtains=0.4),
}


def pane_sheet(looks: Looks, style: str) -> Skin:
    """The skin of a sheet of `COLUMNS` by `ROWS` panes; see `pane_uv`."""

    def paint(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
        cells = [_paint_pane(STYLES[style], rng) for _ in range(COLUMNS * ROWS)]
        rows = [cells[r * COLUMNS : (r + 1) * COLUMNS] for r in range(ROWS)]
        day, glow = (np.concatenate([np.concatenate([c[k] for c in row], 1) for row in rows]) for k in (0, 1))
        return day, glow

    return looks.paint(f"window-{style}", paint, 0.12)


def pane_uv(rng: Rng, count: int, mirror: bool = False) -> np.ndarray:
    """(n, 4, 2) corners of a pane chosen for each of n windows."""
    cell = rng.integers(0, COLUMNS * ROWS, count)
    column, row = cell % COLUMNS, cell // COLUMNS
    edge = 0.004  # a filtered look-up stays inside its pane
    x0, x1 = (column + edge) / COLUMNS, (column + 1 - edge) / COLUMNS
    y0, y1 = 1 - (row + 1 - edge) / ROWS, 1 - (row + edge) / ROWS
    if mirror:
        flip = rng.random(count) < 0.5
        x0, x1 = np.where(flip, x1, x0), np.where(flip, x0, x1)
    return np.stack([np.stack([x0, x1, x1, x0], 1), np.stack([y0, y0, y1, y1], 1)], 2)


def _paint_pane(style: PaneStyle, rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """A window by day, and the light it gives off in the evening."""
    width, height = style.size_m
    # the wider of window and 1 m has 96 texels
    px_per_m = 96 / max(width, 1.0)
    canvas = Canvas(width, height, px_per_m, (0, 0, 0))
    w, h = canvas.size
    day = _glass(style, rng, w, h)
    # less than half of the windows are lit, warmly or a little cooler
    lit = rng.random() < 0.45
    room = (
        np.array(WARM, np.float32)
        * rng.uniform(0.55, 1.0)
        * np.array([1, rng.uniform(0.9, 1.1), rng.uniform(0.7, 1.3)])
    )
    glow = np.broadcast_to(room.astype(np.float32) if lit else np.zeros(3, np.float32), (h, w, 3)).copy()
    glow *= np.linspace(1.0, 0.6, h, dtype=np.float32)[:, None, None]
    # curtains darken the room by day, and dim its light
    if rng.random() < style.curtains:
        _hang(style, rng, day, glow)
    # frame and bars, over glass, curtain and light
    frame = _frame(style, canvas)
    day = np.where(frame[..., None] > 0, day * (1 - frame[..., None]) + np.array(style.frame) * frame[..., None], day)
    edge = max(1, round(0.03 * px_per_m))
    day[:edge] *= 0.6  # the lintel's shade
    glow *= 1 - frame[..., None]
    small = glow[: h // GLOW_SHRINK * GLOW_SHRINK, : w // GLOW_SHRINK * GLOW_SHRINK]
    # means of square groups; a lit window has no fine detail
    small = small.reshape(h // GLOW_SHRINK, GLOW_SHRINK, w // GLOW_SHRINK, GLOW_SHRINK, 3).mean((1, 3))
    return finish(day), finish(small)


def _glass(style: PaneStyle, rng: Rng, w: int, h: int) -> np.ndarray:
    """The pane's reflection: sky above, the other side of the street below, and a dark room behind."""
    up = np.linspace(1, 0, h, dtype=np.float32)[:, None, None]
    dark = np.array((38, 42, 46), np.float32) * rng.uniform(0.7, 1.3)
    sky = np.array(style.glass, np.float32) * rng.uniform(0.75, 1.15)
    tilt = rng.uniform(-0.3, 0.3) * np.linspace(-1, 1, w, dtype=np.float32)[None, :, None]
    share = np.clip((up - rng.uniform(0.15, 0.6) + tilt) * rng.uniform(1.2, 4) + 0.35, 0.05, 1) * rng.uniform(
        0.45, 0.95
    )
    wavy = 1 + 0.1 * fractal(rng, (256, 256), 4, 3)[:h, :w, None]
    return (dark * (1 - share) + sky * share) * wavy


def _hang(style: PaneStyle, rng: Rng, day: np.ndarray, glow: np.ndarray) -> None:
    h, w = day.shape[:2]
    cloth = np.array(
        [(214, 208, 196), (196, 182, 158), (168, 120, 104), (126, 140, 160), (224, 222, 218)][rng.integers(5)], float
    )
    kind = rng.integers(3)
    if kind == 0:
        # curtains at both sides, wider towards the lower end
        x = np.abs(np.linspace(-1, 1, w))[None, :] + 0.12 * np.linspace(-1, 1, h)[:, None]
        cover = (x > rng.uniform(0.4, 0.8)).astype(np.float32)[..., None]
        folds = 1 + 0.16 * np.sin(np.linspace(0, 60, w))[None, :, None]
    elif kind == 1:
        cover = np.zeros((h, w, 1), np.float32)
        # a roller blind from the top
        cover[: int(h * rng.uniform(0.2, 0.8))] = 1
        folds = np.ones((1, 1, 1))
    else:
        cover = np.zeros((h, w, 1), np.float32)
        # a venetian blind, with gaps between its slats
        cover[: int(h * rng.uniform(0.4, 1.0))] = 0.85
        folds = 1 + 0.25 * np.sign(np.sin(np.linspace(0, h * 0.9, h)))[:, None, None]
    # cloth over the pane by day; by night it dims the lit room
    opacity = cover * rng.uniform(0.75, 0.95)
    day *= 1 - opacity
    day += opacity * cloth * folds * 0.72
    glow *= 1 - 0.45 * cover


def _frame(style: PaneStyle, canvas: Canvas) -> np.ndarray:
    width, height = style.size_m
    drawn = Canvas(width, height, canvas.size[0] / width, (0, 0, 0))
    # outer frame, then bars
    white, f = (255, 255, 255), style.frame_m
    for x0, y0, x1, y1 in (
        (0, 0, width, f), (0, height - f, width, height), (0, 0, f, height), (width - f, 0, width, height),
    ):  # fmt: skip
        drawn.rect(x0, y0, x1, y1, white)
    across, up = style.bars
    for k in range(1, across + 1):
        x = width * k / (across + 1)
        drawn.rect(x - style.bar_m / 2, 0, x + style.bar_m / 2, height, white)
    for k in range(1, up + 1):
        y = height * k / (up + 1)
        thick = style.frame_m if up == 1 else style.bar_m
        drawn.rect(0, y - thick / 2, width, y + thick / 2, white)
    # the mask has the size of the window's own canvas
    mask = drawn.texture()[..., 0].astype(np.float32) / 255
    if mask.shape != canvas.size[::-1]:
        mask = mask[: canvas.size[1], : canvas.size[0]]
    # an arched window is filled outside of its half circle
    if style.arched:
        h, w = mask.shape
        y, x = np.mgrid[0:h, 0:w].astype(np.float32)
        radius = w / 2
        outside = ((x - radius) ** 2 + (y - radius) ** 2 > (radius - 2) ** 2) & (y < radius)
        mask = np.maximum(mask, outside)
    return mask


def _asphalt(rng: Rng, shape: tuple[int, int], px_per_m: float) -> np.ndarray:
    base = flat(shape, (92, 92, 94)) * (1 + 0.06 * fractal(rng, shape, 4, 6))[..., None]
    for _ in range(4):
        h, w = (rng.uniform(0.6, 3.2, 2) * px_per_m).astype(int)
        y, x = rng.integers(0, max(1, shape[0] - h)), rng.integers(0, max(1, shape[1] - w))
        base[y : y + h, x : x + w] *= rng.uniform(0.78, 1.08)
        cv2.rectangle(base, (int(x), int(y)), (int(x + w), int(y + h)), (56.0, 56.0, 58.0), 2)
    crack = np.abs(noise(rng, shape, (7, 7)) + 0.4 * noise(rng, shape, (24, 24)))
    base *= (1 - 0.4 * np.clip(1 - crack / 0.018, 0, 1) * (noise(rng, shape, (3, 3)) > 0.1))[..., None]
    oil = np.clip(fractal(rng, shape, 6, 3) - 1.0, 0, 1)[..., None]
    return base * (1 - 0.35 * oil) + grain(rng, shape, 5)


def _mark(road: np.ndarray, x: Span, y: Span, colour: Colour, worn: np.ndarray) -> None:
    """A painted mark over part of a texture, in shares of its width and height; worn away in places."""
    h, w = road.shape[:2]
    area = slice(max(0, round(y[0] * h)), round(y[1] * h)), slice(max(0, round(x[0] * w)), round(x[1] * w))
    share = worn[area][..., None]
    road[area] = road[area] * (1 - share) + np.array(colour, np.float32) * share


def _manhole(road: np.ndarray, x: float, y: float, radius: float) -> None:
    centre = (round(x), round(y))
    cv2.circle(road, centre, round(radius), (58.0, 56.0, 54.0), -1, cv2.LINE_AA)
    cv2.circle(road, centre, round(radius), (34.0, 33.0, 32.0), 2, cv2.LINE_AA)
    step = max(4, round(radius / 3.5))
    for dy in range(-3, 4):
        for dx in range(-3, 4):
            if dx * dx + dy * dy < 9:
                at = (centre[0] + dx * step, centre[1] + dy * step)
                cv2.circle(road, at, max(1, step // 4), (92.0, 88.0, 84.0), -1, cv2.LINE_AA)


def road(looks: Looks, avenue: bool) -> Skin:
    """A carriageway as wide as the texture, as long as it is wide: u across, v along."""
    width = AVENUE_M if avenue else STREET_M
    name = "avenue" if avenue else "street"
    return looks.paint(name, lambda rng: _paint_road(rng, avenue, width), 0.85, (width, width))


def _paint_road(rng: Rng, avenue: bool, width: float) -> np.ndarray:
    # asphalt, darker where wheels run
    n = 1024
    px = n / width
    base = _asphalt(rng, (n, n), px)
    worn = np.clip(0.86 + 0.3 * fractal(rng, (n, n), 10, 4), 0.25, 0.95).astype(np.float32)
    lanes = np.abs((np.arange(n) + 0.5) / px - width / 2)
    wheel = sum(np.exp(-(((lanes - at) / 0.35) ** 2)) for at in ((4.2, 5.9) if avenue else (1.3, 2.9)))
    base *= (1 - 0.09 * wheel)[None, :, None].astype(np.float32)
    # lane marks, worn in places
    middle, edge = 0.5, PARKING_M / width
    if avenue:
        _tram_tracks(base, px)
        for at in (3.1, 7.0):
            for side in (-1, 1):
                x = middle + side * at / width
                dashes = ((0, 1),) if at < 4 else ((0.02, 0.22), (0.36, 0.56), (0.7, 0.9))
                for y0, y1 in dashes:
                    _mark(
                        base, (x - 0.06 / width, x + 0.06 / width), (y0, y1), YELLOW_PAINT if at < 4 else WHITE_PAINT,
                        worn,
                    )  # fmt: skip
    else:
        for x in (middle - 0.16 / width, middle + 0.16 / width):
            _mark(base, (x - 0.055 / width, x + 0.055 / width), (0, 1), YELLOW_PAINT, worn)
    # parking bays along both kerbs
    for x, far in ((edge, 0.0), (1 - edge, 1.0)):
        for y in (0.02, 0.5):
            _mark(base, (min(x, far), max(x, far)), (y, y + 0.1 / width), WHITE_PAINT, worn)
        for y in np.linspace(0.0, 0.9, 7):
            _mark(base, (x - 0.05 / width, x + 0.05 / width), (y, y + 0.07), WHITE_PAINT, worn)
    # manholes, and dirt in the gutters
    _manhole(base, n * (0.3 if avenue else 0.36), n * 0.72, 0.36 * px)
    _manhole(base, n * 0.7, n * 0.2, 0.3 * px)
    gutter = np.clip(1 - np.minimum(np.arange(n), np.arange(n)[::-1]) / (0.35 * px), 0, 1)
    base *= (1 - 0.28 * gutter)[None, :, None].astype(np.float32)
    return finish(base)


def _tram_tracks(base: np.ndarray, px: float) -> None:
    n = base.shape[0]
    for at in TRACKS_M:
        x = n / 2 + at * px
        for offset, wide, tone in (
            (0.0, 0.16, (70, 70, 72)), (-0.02, 0.05, (150, 150, 152)), (0.03, 0.035, (24, 24, 26)),
        ):  # fmt: skip
            left = round(x + (offset - wide / 2) * px)
            base[:, left : left + max(1, round(wide * px))] = tone


def crossing(looks: Looks, avenue: bool) -> Skin:
    """A zebra crossing over a carriageway with a stop line on its lower edge's far side; fitted."""
    return looks.paint("zebra-avenue" if avenue else "zebra", lambda rng: _paint_crossing(rng, avenue), 0.85)


def _paint_crossing(rng: Rng, avenue: bool) -> np.ndarray:
    width, shape = AVENUE_M if avenue else STREET_M, (360, 1040)
    px = shape[1] / width
    base = _asphalt(rng, shape, px)
    worn = np.clip(0.85 + 0.35 * fractal(rng, shape, 12, 4), 0.2, 0.97).astype(np.float32)
    # a bar and a gap for each 1.1 m
    bars = int(width / 1.1)
    for k in range(bars):
        # bars as wide as the gaps between them
        x = (k + 0.25) / bars
        _mark(base, (x, x + 0.5 / bars), (0.1, 0.72), WHITE_PAINT, worn)
    # a line to stop at, on the right half
    _mark(base, (0.5, 1 - PARKING_M / width), (0.86, 0.95), WHITE_PAINT, worn)
    if avenue:
        _tram_tracks(base, px)
    return finish(base)


@painted("junction", 0.85, (JUNCTION_TILE_M, JUNCTION_TILE_M))
def junction(rng: Rng) -> np.ndarray:
    """Plain asphalt where streets meet."""
    n = 896
    base = _asphalt(rng, (n, n), n / JUNCTION_TILE_M)
    _manhole(base, 0.4 * n, 0.55 * n, 0.36 * n / JUNCTION_TILE_M)
    _manhole(base, 0.8 * n, 0.16 * n, 0.3 * n / JUNCTION_TILE_M)
    return finish(base)


def _slabs(rng: Rng, colour: Colour, rows: int, columns: int, *, joint: int, spread: float) -> np.ndarray:
    n = 512
    shade = rng.normal(1, spread, (rows, columns))
    y, x = np.mgrid[0:n, 0:n]
    row, column = y * rows // n, x * columns // n
    base = np.array(colour, np.float32) * shade[row, column][..., None].astype(np.float32)
    inset = np.minimum(
        np.minimum(y % (n / rows), n / rows - y % (n / rows)),
        np.minimum(x % (n / columns), n / columns - x % (n / columns)),
    )
    base *= np.where(inset < joint, 0.68, 1.0)[..., None]
    base *= stains(rng, (n, n), 0.1)
    return base + grain(rng, (n, n), 5)


@painted("pavement", 0.9, (3.6, 3.6))
def pavement(rng: Rng) -> np.ndarray:
    """Concrete slabs with chewing gum and stains, 3.6 m square."""
    base = _slabs(rng, (164, 160, 152), 4, 4, joint=2, spread=0.05)
    for x, y in rng.integers(0, 512, (60, 2)):
        cv2.circle(base, (int(x), int(y)), int(rng.integers(1, 4)), (104.0, 102.0, 98.0), -1, cv2.LINE_AA)
    return finish(base)


@painted("plaza", 0.85, (4.0, 4.0))
def plaza(rng: Rng) -> np.ndarray:
    """Two-tone paving of a square, 4 m square."""
    base = _slabs(rng, (176, 158, 138), 8, 8, joint=2, spread=0.06)
    base[:64] *= 0.74
    base[:, :64] *= 0.74
    return finish(base)


@painted("kerb", 0.85, (2.0, 1.0))
def kerb(rng: Rng) -> np.ndarray:
    """Granite, 2 m long."""
    shape = (128, 256)
    base = flat(shape, (168, 166, 160)) * (1 + 0.08 * fractal(rng, shape, 16, 4))[..., None] + grain(rng, shape, 8)
    base[:, :3] *= 0.6
    base[:, 128:131] *= 0.6
    return finish(base)


def grass(looks: Looks, meadow: bool = False) -> Skin:
    """Turf: a lawn 6 m square, or a rough meadow 24 m square."""
    name, tile = ("meadow", 24.0) if meadow else ("lawn", 6.0)
    return looks.paint(name, lambda rng: _paint_grass(rng, meadow), 0.95, (tile, tile))


def _paint_grass(rng: Rng, meadow: bool) -> np.ndarray:
    n = 1024 if meadow else 512
    shape = (n, n)
    # long waves, short waves, and blades
    broad, fine = fractal(rng, shape, 3, 4), fractal(rng, shape, 48, 4)
    blade = noise(rng, shape, (n // 3, n // 5))
    base = flat(shape, (82, 112, 44)) * (1 + 0.16 * broad + 0.22 * fine + 0.2 * blade)[..., None]
    # dry patches, more of them in a meadow, and its flowers
    dry = np.clip(fractal(rng, shape, 5, 4) - 0.35, 0, 1)[..., None] * (0.8 if meadow else 0.35)
    base = base * (1 - dry) + np.array((156, 140, 84), np.float32) * (1 + 0.3 * blade[..., None]) * dry
    if meadow:
        # flowers, a texel wide
        for x, y in rng.integers(0, n, (420, 2)):
            tone = ((236, 232, 220), (240, 206, 60), (200, 120, 160))[int(rng.integers(3))]
            cv2.circle(base, (int(x), int(y)), 1, tuple(float(c) for c in tone), -1)
    return finish(base)


@painted("apron", 0.9, (15.0, 15.0))
def concrete_apron(rng: Rng) -> np.ndarray:
    """An airfield's slabs with sealed joints, rubber and oil, 15 m square (four slabs)."""
    n = 1024
    shape = (n, n)
    base = flat(shape, (168, 166, 158)) * (1 + 0.05 * fractal(rng, shape, 4, 6))[..., None]
    # four slabs, each of its own tone, with dark joints
    for k in range(2):
        for m in range(2):
            base[k * n // 2 : (k + 1) * n // 2, m * n // 2 : (m + 1) * n // 2] *= rng.uniform(0.93, 1.05)
    for k in (0, n // 2):
        base[k : k + 4] = (62, 60, 58)
        base[:, k : k + 4] = (62, 60, 58)
    # oil in patches, rubber in streaks
    oil = np.clip(fractal(rng, shape, 6, 4) - 0.85, 0, 1)[..., None]
    rubber = np.clip(noise(rng, shape, (90, 3)) - 0.7, 0, 1)[..., None]
    base = base * (1 - 0.5 * oil) * (1 - 0.35 * rubber) + grain(rng, shape, 4)
    return finish(base)


@painted("water", 0.1, (20.0, 20.0))
def water(rng: Rng) -> np.ndarray:
    """Harbour water with ripples and reflections, 20 m square."""
    shape = (1024, 1024)
    wave = fractal(rng, shape, 8, 6, 0.72)
    slope = wave - np.roll(wave, 3, axis=0)
    base = flat(shape, (42, 74, 82)) * (1 + 0.18 * wave)[..., None]
    glint = np.clip(slope * 2.2, 0, 1)[..., None]
    base = base * (1 - glint) + np.array((150, 178, 190), np.float32) * glint
    return finish(base)
