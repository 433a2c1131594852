"""What walls are made of, painted to repeat: brick, ashlar, render, concrete, cladding, roofing."""

from collections.abc import Callable

import cv2
import numpy as np

from toolkit.content.modelling import Colour
from toolkit.content.paint import finish, flat, fractal, grain, hex_name, noise, stains
from toolkit.content.pieces import Looks, Skin
from toolkit.objects.mesh import Material

SIDE_PX = 512
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


def _masonry(
    rng: np.random.Generator, colour: Colour, rows: int, columns: int, *, joint_px: float, spread: float
) -> np.ndarray:
    """(n, n, 3) courses of blocks, every second one set off by half, each block of its own shade."""
    n = SIDE_PX
    y, x = np.mgrid[0:n, 0:n].astype(np.float32) + 0.5
    row = (y * rows / n).astype(int)
    across = x * columns / n + 0.5 * (row % 2)
    column = across.astype(int) % columns
    shade = rng.normal(1, spread, (rows, columns)) + rng.choice([0, 0, 0, -2 * spread], (rows, columns))
    hue = rng.normal(0, 5 * spread / 0.1, (rows, columns, 3))
    colours = np.array(colour) * shade[row, column][..., None] + hue[row, column]
    edge_y = np.abs((y * rows / n) % 1 - 0.5) * n / rows
    edge_x = np.abs(across % 1 - 0.5) * n / columns
    inset = np.minimum(n / rows / 2 - edge_y, n / columns / 2 - edge_x)
    joint = np.clip((inset - joint_px / 2) / 1.2 + 0.5, 0, 1)[..., None]
    mortar = np.array(colour, np.float32) * 0.45 + np.array((172, 166, 156)) * 0.45
    lit = 1 + 0.07 * np.clip(2.5 - inset, 0, 2.5)[..., None] * (((y * rows / n) % 1 < 0.5)[..., None] * 2 - 1)
    return (colours * lit * joint + mortar * (1 - joint)).astype(np.float32)


def paint_brick(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Brickwork, 2.88 m square."""
    bricks = _masonry(rng, colour, 38, 12, joint_px=2.2, spread=0.11)
    shape = bricks.shape[:2]
    return finish(bricks * stains(rng, shape, 0.1) + grain(rng, shape, 5))


def paint_ashlar(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Dressed stone in courses of 45 cm, 3.6 m square."""
    stone = _masonry(rng, colour, 8, 5, joint_px=3.0, spread=0.045)
    shape = stone.shape[:2]
    weathered = stone * stains(rng, shape, 0.13) * (1 + 0.05 * fractal(rng, shape, 24, 4))[..., None]
    return finish(weathered + grain(rng, shape, 4))


def paint_render(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Painted stucco with rain streaks, 4 m square."""
    shape = (SIDE_PX, SIDE_PX)
    wall = flat(shape, colour) * stains(rng, shape, 0.12) * (1 + 0.03 * fractal(rng, shape, 40, 4))[..., None]
    return finish(wall + grain(rng, shape, 3))


def paint_concrete(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Board-marked concrete panels with tie holes, 4 m square."""
    shape = (SIDE_PX, SIDE_PX)
    wall = flat(shape, colour) * stains(rng, shape, 0.2) * (1 + 0.05 * fractal(rng, shape, 16, 5))[..., None]
    wall[:4] *= 0.62
    wall[:, :3] *= 0.66
    wall[SIDE_PX // 2 : SIDE_PX // 2 + 3] *= 0.74
    for x in (64, 192, 320, 448):
        for y in (64, 192, 320, 448):
            cv2.circle(wall, (x, y), 4, tuple(float(c) * 0.45 for c in colour), -1, cv2.LINE_AA)
    return finish(wall + grain(rng, shape, 4))


def paint_cladding(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Ribbed sheet metal with rust runs, 3 m square."""
    shape = (SIDE_PX, SIDE_PX)
    x = np.arange(SIDE_PX)
    rib = 1 + 0.16 * np.sign(np.sin(2 * np.pi * x * 16 / SIDE_PX)) * np.abs(np.sin(2 * np.pi * x * 16 / SIDE_PX)) ** 0.3
    wall = flat(shape, colour) * rib[None, :, None] * stains(rng, shape, 0.12)
    wall[::170] *= 0.8
    rust = np.clip(noise(rng, shape, (3, 40)) * 1.4 - 0.75, 0, 1)[..., None]
    return finish(wall * (1 - rust) + np.array((120, 72, 44)) * rust + grain(rng, shape, 3))


def paint_roofing(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Roofing felt or gravel with seams, patches and puddle rims, 6 m square."""
    shape = (SIDE_PX, SIDE_PX)
    roof = flat(shape, colour) * (1 + 0.1 * fractal(rng, shape, 4, 5))[..., None] + grain(rng, shape, 9)
    for row in range(0, SIDE_PX, 128):
        roof[row : row + 3] *= 0.74
        roof[row + 3 : row + 5] *= 1.1
    for _ in range(5):
        y, x, h, w = rng.integers(0, 400), rng.integers(0, 400), rng.integers(30, 100), rng.integers(30, 110)
        roof[y : y + h, x : x + w] *= rng.uniform(0.84, 1.08)
    puddle = np.abs(fractal(rng, shape, 3, 3) - 0.55) < 0.05
    return finish(roof * (1 - 0.12 * puddle[..., None]))


def paint_tiles(rng: np.random.Generator, colour: Colour) -> np.ndarray:
    """Roof tiles in courses of 30 cm, 3 m square."""
    tiles = _masonry(rng, colour, 10, 14, joint_px=1.2, spread=0.1)
    y = (np.arange(SIDE_PX) * 10 / SIDE_PX) % 1
    shape = tiles.shape[:2]
    return finish(tiles * (1.12 - 0.36 * y**3)[:, None, None] * stains(rng, shape, 0.14) + grain(rng, shape, 4))


PAINTERS: dict[str, tuple[Callable[[np.random.Generator, Colour], np.ndarray], float, float]] = {
    "brick": (paint_brick, 2.88, 0.9), "ashlar": (paint_ashlar, 3.6, 0.85), "render": (paint_render, 4.0, 0.9),
    "concrete": (paint_concrete, 4.0, 0.9), "cladding": (paint_cladding, 3.0, 0.5),
    "roofing": (paint_roofing, 6.0, 0.95), "tiles": (paint_tiles, 3.0, 0.8),
}  # fmt: skip


def wall(looks: Looks, kind: str, colour: Colour) -> Skin:
    """The skin of a wall or roof of a kind and colour."""
    name = f"{kind}-{hex_name(colour)}"
    if found := looks.known(name):
        return found
    paint, tile_m, roughness = PAINTERS[kind]
    return looks.add(Material(name, paint(looks.rng(name), colour), roughness), (tile_m, tile_m))
