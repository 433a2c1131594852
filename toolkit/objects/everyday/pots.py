"""What coffee and tea come from: coffeepots of four builds, teapots, pitchers."""

import numpy as np

from toolkit.objects.everyday.draws import chance, draw, pick, pick_colour, shade
from toolkit.objects.everyday.paints import decorate, scatter
from toolkit.objects.everyday.shapes import (
    arc,
    ball,
    cylinder,
    finish,
    lathe,
    outward,
    push,
    rod,
    slab,
    turned,
    vessel,
)
from toolkit.objects.mesh import Mesh
from toolkit.objects.modelling import Part, revolve, smooth_curve


def make_coffeepot(rng: np.random.Generator) -> Mesh:
    """An enamel pot, a moka pot, a percolator, or a silver pot with a swan's neck."""
    parts = pick(rng, (_enamel_pot, _moka_pot, _percolator, _silver_pot))(rng)
    return finish(turned(parts, "z", draw(rng, -100, -80)))


def _spout(
    root: tuple[float, float], tip: tuple[float, float], radius: tuple[float, float], colour, material: str,
    curl: float = 0.3,
) -> list[Part]:  # fmt: skip
    """A tapering spout to +x with a dark mouth; `curl` bends it into an S."""
    (x0, z0), (x1, z1) = root, tip
    points = [(x0, 0, z0), (x0 + (x1 - x0) * (0.3 + curl * 0.5), 0, z0 + (z1 - z0) * (0.3 - curl * 0.5)),
              (x0 + (x1 - x0) * 0.62, 0, z0 + (z1 - z0) * 0.6), (x1, 0, z1)]  # fmt: skip
    pipe = rod(points, [radius[0], radius[0] * 0.7 + radius[1] * 0.3, radius[1] * 1.1, radius[1]], colour, material)
    ahead = np.array([points[-1][0] - points[-2][0], 0, points[-1][2] - points[-2][2]])
    end = np.array([points[-1], points[-1] + 0.01 * ahead / np.linalg.norm(ahead) * 30])
    return [*pipe, *rod(end, radius[1] * 0.75, (20, 18, 18), material)]


def _knob(rng: np.random.Generator, z: float, radius: float, colour, material: str) -> list[Part]:
    return [
        *cylinder(radius * 0.5, z - radius * 0.4, z + radius * 0.6, colour, material, 12),
        ball(radius, colour, material, 16, 8, (1, 1, draw(rng, 0.6, 1.2))).moved(z=z + radius),
    ]


def _loop(top: tuple[float, float], low: tuple[float, float], reach: float, radius: float, colour, material: str):
    """A handle to -x from a high to a low place."""
    (x0, z0), (x1, z1) = top, low
    points = [(x0, 0, z0), (x0 - reach * 0.8, 0, z0 + 0.05 * (z0 - z1)),
              (min(x0, x1) - reach, 0, z0 - 0.35 * (z0 - z1)),
              (min(x0, x1) - reach * 0.75, 0, z0 - 0.75 * (z0 - z1)), (x1, 0, z1)]  # fmt: skip
    return rod(points, radius, colour, material, 18, flatten=1.4)


def _enamel_pot(rng: np.random.Generator) -> list[Part]:
    base, top, high = draw(rng, 55, 75), draw(rng, 36, 52), draw(rng, 150, 220)
    colour, trim = pick_colour(rng, "ceramic", "bright", "pale"), pick_colour(rng, "dark")
    specks = pick_colour(rng, "pale", "dark")
    paint = scatter(rng, colour, [specks], 160, 0.004) if chance(rng, 0.5) else decorate(rng, colour, "pale", "bright")
    lid = [(top + 3, high), (top + 3, high + 4), (top * 0.6, high + draw(rng, 10, 26)), (top * 0.1, high + 28)]
    middle = (base + top) / 2
    return [
        *cylinder(base, 0, 4, trim, "paint", 32),
        lathe([(base, 4), (base, 10), (middle + 3, high * 0.5), (top, high)], paint, "paint"),
        lathe(lid, colour, "paint", 10),
        *_knob(rng, high + 28, draw(rng, 7, 11), trim, "plastic"),
        *_spout((middle - 2, high * draw(rng, 0.35, 0.5)), (base + draw(rng, 25, 50), high * draw(rng, 0.88, 1.02)),
                (draw(rng, 14, 19), draw(rng, 7, 9)), colour, "paint"),
        *_loop((-top, high * 0.93), (-middle, high * draw(rng, 0.3, 0.45)), draw(rng, 35, 50), draw(rng, 5, 7),
               pick(rng, (trim, colour)), "paint"),
    ]  # fmt: skip


def _moka_pot(rng: np.random.Generator) -> list[Part]:
    """Eight-sided, waisted, with a pouring lip and an angular handle."""
    base, waist, top = draw(rng, 48, 56), draw(rng, 36, 42), draw(rng, 46, 58)
    low, high = draw(rng, 62, 80), draw(rng, 150, 185)
    metal = pick_colour(rng, "steel") if chance(rng, 0.7) else pick_colour(rng, "bright")
    black = pick_colour(rng, "dark") if chance(rng, 0.8) else pick_colour(rng, "bright", "wood")
    sides = pick(rng, (8, 8, 10))
    body = [(0, 0), (base, 0), (base, 4), (waist + 4, low), (waist + 4, low + 10), (waist, low + 10), (waist, low + 14)]
    cone = revolve([*body, (top, high)], sides, metal, "metal")
    lid = revolve([(top + 2, high), (top + 2, high + 3), (top * 0.3, high + 22), (0, high + 24)], sides, metal, "metal")
    lip = slab([(top - 12, high - 34), (top + 20, high - 2), (top - 12, high - 2)], 22, metal, "metal")
    reach = draw(rng, 42, 58)
    grip = [(-top + 4, high - 12), (-top + 4, high - 1), (-top - reach, high - 6), (-top - reach + 6, low + 4),
            (-top - reach + 16, low + 4), (-top - reach + 14, high - 20)]  # fmt: skip
    knob = cylinder(7, high + 23, high + 44, black, "plastic", 12, 10)
    return [cone, lid, *lip, *slab(grip, 13, black, "plastic"), *knob]


def _percolator(rng: np.random.Generator) -> list[Part]:
    """A straight steel pot with a short spout, a black handle and a glass knob."""
    base, top, high = draw(rng, 52, 62), draw(rng, 44, 54), draw(rng, 170, 220)
    metal, black = pick_colour(rng, "steel"), pick_colour(rng, "dark", "wood")
    wall = [(base, 16), (base, 24), (top + 2, high * 0.9), (top, high)]
    out = -top - draw(rng, 42, 58)
    handle = [(-top + 3, 0, high * 0.9), (out, 0, high * 0.92), (out - 4, 0, high * 0.55), (out + 12, 0, high * 0.35)]
    return [
        *cylinder(base + 4, 0, 16, black, "plastic", 32, base),
        lathe(wall, metal, "metal"),
        lathe([(top + 2, high), (top + 2, high + 5), (top * 0.5, high + 14), (14, high + 18)], metal, "metal", 10),
        *cylinder(12, high + 17, high + 36, (196, 206, 204), "glass", 16, 9, bevel=3),
        *_spout((top - 3, high * draw(rng, 0.6, 0.74)), (base + draw(rng, 20, 34), high * draw(rng, 0.9, 0.98)),
                (18, 9), metal, "metal", 0.0),
        *rod(handle, [6, 8, 9, 7], black, "plastic", flatten=1.5),
    ]  # fmt: skip


def _silver_pot(rng: np.random.Generator) -> list[Part]:
    """Pear-shaped on a foot, with a swan-neck spout and a domed lid."""
    belly, neck, high = draw(rng, 52, 64), draw(rng, 24, 32), draw(rng, 175, 215)
    metal = pick_colour(rng, "steel", "brass", "ceramic")
    material = "metal" if max(metal) - min(metal) < 130 else "ceramic"
    wall = [(belly * 0.6, 0), (belly * 0.62, 5), (belly * 0.42, 14), (belly * 0.9, 36), (belly, 62),
            (neck + 8, high * 0.66), (neck, high * 0.86), (neck + 5, high)]  # fmt: skip
    lid = [(neck + 5, high), (neck + 1, high + 8), (neck * 0.6, high + 20), (3, high + 24)]
    handle = pick_colour(rng, "wood", "dark") if chance(rng, 0.5) else metal
    return [
        lathe(wall, metal, material, 34),
        lathe(lid, metal, material, 12),
        *_knob(rng, high + 24, 7, metal, material),
        *_spout((belly - 6, high * 0.3), (belly + draw(rng, 38, 52), high * 0.92), (14, 6), metal, material, 0.5),
        *_loop((-neck - 2, high * 0.92), (-belly + 3, high * 0.4), draw(rng, 34, 46), 5, handle, "plastic"),
    ]


def make_teapot(rng: np.random.Generator) -> Mesh:
    """Round and squat, with a bowed spout, a loop (or a bail over the top) and a lid with a knob."""
    belly, high = draw(rng, 62, 82), draw(rng, 78, 112)
    colour = pick_colour(rng, "ceramic", "pale", "bright")
    trim = pick(rng, (colour, shade(colour, 0.6), pick_colour(rng, "ceramic", "dark")))
    foot, neck = belly * draw(rng, 0.5, 0.68), belly * draw(rng, 0.42, 0.56)
    full = draw(rng, 0.4, 0.55) * high
    wall = [(foot, 0), (foot, 3), (belly * 0.9, full * 0.5), (belly, full), (belly * 0.88, full + (high - full) * 0.6),
            (neck, high)]  # fmt: skip
    lid = [(neck + 2, high), (neck + 1, high + 4), (neck * 0.6, high + 13), (4, high + 17)]
    body = lathe(wall, decorate(rng, colour, "ceramic", "bright"), "ceramic", 24)
    parts = [body, lathe(lid, trim, "ceramic", 10), *_knob(rng, high + 17, draw(rng, 6, 10), trim, "ceramic")]
    tip = belly + draw(rng, 40, 60), high * draw(rng, 0.85, 1.05)
    parts += _spout((belly * 0.86, full * 0.7), tip, (draw(rng, 13, 17), draw(rng, 6, 8)), colour, "ceramic", 0.25)
    if chance(rng, 0.25):
        over = arc((0, high * 0.8), (belly * 0.8, draw(rng, 75, 95)), 8, 172)
        parts += rod(over, 4.5, pick_colour(rng, "wood", "dark", "brass"), "wood")
    else:
        ear = (-belly * 0.86, high * 0.82), (-belly * 0.93, full * 0.6)
        parts += _loop(*ear, draw(rng, 32, 44), draw(rng, 5, 7), trim, "ceramic")
    return finish(turned(parts, "z", draw(rng, -100, -80)))


def make_pitcher(rng: np.random.Generator) -> Mesh:
    """A tall open jug, its rim drawn out into a lip, with a large handle."""
    belly, high = draw(rng, 52, 68), draw(rng, 170, 230)
    neck, mouth = belly * draw(rng, 0.55, 0.95), belly * draw(rng, 0.7, 1.02)
    outline = smooth_curve(
        [(belly * 0.72, 0), (belly * 0.95, high * 0.15), (belly, high * 0.35), (neck, high * 0.78), (mouth, high)], 26
    )
    colour = pick_colour(rng, "ceramic", "pale", "bright", "steel")
    inside = pick(rng, (colour, (238, 234, 226)))
    reach, lift = draw(rng, 24, 40), draw(rng, 4, 16)

    def draw_lip(points: np.ndarray) -> np.ndarray:
        angle = np.arctan2(points[:, 1], points[:, 0])
        high_up = np.clip((points[:, 2] / high - 0.72) / 0.28, 0, 1) ** 2
        share = np.exp(-((angle / 0.42) ** 2)) * high_up * (np.hypot(points[:, 0], points[:, 1]) > mouth * 0.4)
        return points + share[:, None] * np.array([reach, 0, lift])

    paint = decorate(rng, colour, "ceramic", "bright")
    body = [push(part, draw_lip) for part in vessel(outline, 4, paint, inside, "ceramic")]
    ear = (-neck * 0.96, high * 0.86), (-belly + 2, high * draw(rng, 0.3, 0.42))
    handle = _loop(*ear, draw(rng, 36, 54), draw(rng, 6, 8), colour, "ceramic")
    return finish(turned([*body, *outward(handle)], "z", draw(rng, -100, -80)))
