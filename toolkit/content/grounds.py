"""What is walked and driven on, painted: asphalt and its marks, crossings, pavements, grass, water, concrete."""

import cv2
import numpy as np

from toolkit.content.modelling import Colour
from toolkit.content.paint import finish, flat, fractal, grain, noise, stains
from toolkit.content.pieces import Looks, Skin
from toolkit.objects.mesh import Material

Span = tuple[float, float]
STREET_M, AVENUE_M = 13.0, 20.0
"""Widths of the carriageways."""
CROSSING_M = 4.5
JUNCTION_TILE_M = 14.0
MARK_M = 0.004
"""Height of marks that are laid on the ground as faces of their own."""
WHITE_PAINT, YELLOW_PAINT = (214, 214, 208), (214, 164, 44)
PARKING_M = 2.3
TRACKS_M = (-2.4, -0.96, 0.96, 2.4)
"""Where the tram's rails lie, from the middle of an avenue."""


def _asphalt(rng: np.random.Generator, shape: tuple[int, int], px_per_m: float) -> np.ndarray:
    """Asphalt with patches, cracks and oil."""
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
    """A cast-iron cover: a dark ring and a grid of studs."""
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
    name = "avenue" if avenue else "street"
    if found := looks.known(name):
        return found
    rng, width, n = looks.rng(name), AVENUE_M if avenue else STREET_M, 1024
    px = n / width
    base = _asphalt(rng, (n, n), px)
    worn = np.clip(0.86 + 0.3 * fractal(rng, (n, n), 10, 4), 0.25, 0.95).astype(np.float32)
    lanes = np.abs((np.arange(n) + 0.5) / px - width / 2)
    wheel = sum(np.exp(-(((lanes - at) / 0.35) ** 2)) for at in ((4.2, 5.9) if avenue else (1.3, 2.9)))
    base *= (1 - 0.09 * wheel)[None, :, None].astype(np.float32)
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
    for x, far in ((edge, 0.0), (1 - edge, 1.0)):
        for y in (0.02, 0.5):
            _mark(base, (min(x, far), max(x, far)), (y, y + 0.1 / width), WHITE_PAINT, worn)
        for y in np.linspace(0.0, 0.9, 7):
            _mark(base, (x - 0.05 / width, x + 0.05 / width), (y, y + 0.07), WHITE_PAINT, worn)
    _manhole(base, n * (0.3 if avenue else 0.36), n * 0.72, 0.36 * px)
    _manhole(base, n * 0.7, n * 0.2, 0.3 * px)
    gutter = np.clip(1 - np.minimum(np.arange(n), np.arange(n)[::-1]) / (0.35 * px), 0, 1)
    base *= (1 - 0.28 * gutter)[None, :, None].astype(np.float32)
    return looks.add(Material(name, finish(base), 0.85), (width, width))


def _tram_tracks(base: np.ndarray, px: float) -> None:
    """Rails with their grooves in setts."""
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
    name = "zebra-avenue" if avenue else "zebra"
    if found := looks.known(name):
        return found
    rng, width = looks.rng(name), AVENUE_M if avenue else STREET_M
    shape = (360, 1040)
    px = shape[1] / width
    base = _asphalt(rng, shape, px)
    worn = np.clip(0.85 + 0.35 * fractal(rng, shape, 12, 4), 0.2, 0.97).astype(np.float32)
    bars = int(width / 1.1)
    for k in range(bars):
        x = (k + 0.25) / bars
        _mark(base, (x, x + 0.5 / bars), (0.1, 0.72), WHITE_PAINT, worn)
    _mark(base, (0.5, 1 - PARKING_M / width), (0.86, 0.95), WHITE_PAINT, worn)
    if avenue:
        _tram_tracks(base, px)
    return looks.add(Material(name, finish(base), 0.85))


def junction(looks: Looks) -> Skin:
    """Plain asphalt where streets meet."""
    if found := looks.known("junction"):
        return found
    rng, n = looks.rng("junction"), 896
    base = _asphalt(rng, (n, n), n / JUNCTION_TILE_M)
    _manhole(base, 0.4 * n, 0.55 * n, 0.36 * n / JUNCTION_TILE_M)
    _manhole(base, 0.8 * n, 0.16 * n, 0.3 * n / JUNCTION_TILE_M)
    return looks.add(Material("junction", finish(base), 0.85), (JUNCTION_TILE_M, JUNCTION_TILE_M))


def _slabs(
    rng: np.random.Generator, colour: Colour, rows: int, columns: int, *, joint: int, spread: float
) -> np.ndarray:
    """(512, 512, 3) of slabs with dark joints."""
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


def pavement(looks: Looks) -> Skin:
    """Concrete slabs with chewing gum and stains, 3.6 m square."""
    if found := looks.known("pavement"):
        return found
    rng = looks.rng("pavement")
    base = _slabs(rng, (164, 160, 152), 4, 4, joint=2, spread=0.05)
    for x, y in rng.integers(0, 512, (60, 2)):
        cv2.circle(base, (int(x), int(y)), int(rng.integers(1, 4)), (104.0, 102.0, 98.0), -1, cv2.LINE_AA)
    return looks.add(Material("pavement", finish(base), 0.9), (3.6, 3.6))


def plaza(looks: Looks) -> Skin:
    """Two-tone paving of a square, 4 m square."""
    if found := looks.known("plaza"):
        return found
    rng = looks.rng("plaza")
    base = _slabs(rng, (176, 158, 138), 8, 8, joint=2, spread=0.06)
    base[:64] *= 0.74
    base[:, :64] *= 0.74
    return looks.add(Material("plaza", finish(base), 0.85), (4.0, 4.0))


def kerb(looks: Looks) -> Skin:
    """Granite, 2 m long."""
    if found := looks.known("kerb"):
        return found
    rng, shape = looks.rng("kerb"), (128, 256)
    base = flat(shape, (168, 166, 160)) * (1 + 0.08 * fractal(rng, shape, 16, 4))[..., None] + grain(rng, shape, 8)
    base[:, :3] *= 0.6
    base[:, 128:131] *= 0.6
    return looks.add(Material("kerb", finish(base), 0.85), (2.0, 1.0))


def grass(looks: Looks, meadow: bool = False) -> Skin:
    """Turf: a lawn 6 m square, or a rough meadow 24 m square."""
    name, tile = ("meadow", 24.0) if meadow else ("lawn", 6.0)
    if found := looks.known(name):
        return found
    rng, n = looks.rng(name), 1024 if meadow else 512
    shape = (n, n)
    broad, fine = fractal(rng, shape, 3, 4), fractal(rng, shape, 48, 4)
    blade = noise(rng, shape, (n // 3, n // 5))
    base = flat(shape, (82, 112, 44)) * (1 + 0.16 * broad + 0.22 * fine + 0.2 * blade)[..., None]
    dry = np.clip(fractal(rng, shape, 5, 4) - 0.35, 0, 1)[..., None] * (0.8 if meadow else 0.35)
    base = base * (1 - dry) + np.array((156, 140, 84), np.float32) * (1 + 0.3 * blade[..., None]) * dry
    if meadow:
        for x, y in rng.integers(0, n, (420, 2)):
            tone = ((236, 232, 220), (240, 206, 60), (200, 120, 160))[int(rng.integers(3))]
            cv2.circle(base, (int(x), int(y)), 1, tuple(float(c) for c in tone), -1)
    return looks.add(Material(name, finish(base), 0.95), (tile, tile))


def concrete_apron(looks: Looks) -> Skin:
    """An airfield's slabs with sealed joints, rubber and oil, 15 m square (four slabs)."""
    if found := looks.known("apron"):
        return found
    rng, n = looks.rng("apron"), 1024
    shape = (n, n)
    base = flat(shape, (168, 166, 158)) * (1 + 0.05 * fractal(rng, shape, 4, 6))[..., None]
    for k in range(2):
        for m in range(2):
            base[k * n // 2 : (k + 1) * n // 2, m * n // 2 : (m + 1) * n // 2] *= rng.uniform(0.93, 1.05)
    for k in (0, n // 2):
        base[k : k + 4] = (62, 60, 58)
        base[:, k : k + 4] = (62, 60, 58)
    oil = np.clip(fractal(rng, shape, 6, 4) - 0.85, 0, 1)[..., None]
    rubber = np.clip(noise(rng, shape, (90, 3)) - 0.7, 0, 1)[..., None]
    base = base * (1 - 0.5 * oil) * (1 - 0.35 * rubber) + grain(rng, shape, 4)
    return looks.add(Material("apron", finish(base), 0.9), (15.0, 15.0))


def water(looks: Looks) -> Skin:
    """Harbour water with ripples and reflections, 20 m square."""
    if found := looks.known("water"):
        return found
    rng, n = looks.rng("water"), 1024
    shape = (n, n)
    wave = fractal(rng, shape, 8, 6, 0.72)
    slope = wave - np.roll(wave, 3, axis=0)
    base = flat(shape, (42, 74, 82)) * (1 + 0.18 * wave)[..., None]
    glint = np.clip(slope * 2.2, 0, 1)[..., None]
    base = base * (1 - glint) + np.array((150, 178, 190), np.float32) * glint
    return looks.add(Material("water", finish(base), 0.1), (20.0, 20.0))
