"""What lies in shop windows: books, bottles and bread on shelves, crates of fruit, laid tables, clothes, shoes."""

import numpy as np

from toolkit.content.modelling import Colour
from toolkit.content.paint import Canvas, Point

WHITE, CREAM = (240, 240, 236), (238, 226, 196)
FRUIT = ((214, 40, 36), (240, 150, 30), (246, 214, 60), (96, 164, 50), (150, 60, 120), (236, 110, 60))
BRIGHT = (*FRUIT, (50, 110, 200), (240, 240, 240), (230, 90, 150), (40, 170, 160))


MEAT = ((186, 50, 46), (206, 90, 80), (168, 40, 44), (226, 170, 150))


def lay_out_goods(canvas: Canvas, kind: str, span: tuple[float, float], floor: float, rng: np.random.Generator) -> None:
    """Fill a window between two x and from its floor up with what a shop of that kind shows."""
    if kind in ("books", "boxes", "papers", "bottles", "sweets", "bread"):
        _shelves(canvas, kind, span, floor, rng)
    elif kind in ("fruit", "meat"):
        _crates(canvas, FRUIT if kind == "fruit" else MEAT, span, floor, rng)
    elif kind == "dining":
        _tables(canvas, span, floor)
    elif kind in ("clothes", "barber", "shoes"):
        for x in np.arange(span[0] + 0.3, span[1] - 0.2, 0.62):
            tone = _pick(rng, BRIGHT)
            if kind == "shoes":
                _shoes(canvas, float(x), floor, rng)
            else:
                _mannequin(canvas, float(x), floor, tone)
    else:
        for x in np.arange(span[0] + 0.05, span[1] - 0.5, 0.72):
            for z in (floor + 0.1, floor + 0.95):
                canvas.rect(x, z, x + 0.62, z + 0.78, _pick(rng, BRIGHT))
                canvas.disc(x + 0.31, z + 0.48, 0.18, _pick(rng, BRIGHT))
                canvas.line([(x + 0.08, z + 0.14), (x + 0.54, z + 0.14)], 0.05, (250, 250, 250))


def _pick(rng: np.random.Generator, colours: tuple[Colour, ...]) -> Colour:
    return colours[int(rng.integers(len(colours)))]


def _shelves(canvas: Canvas, kind: str, span: tuple[float, float], floor: float, rng: np.random.Generator) -> None:
    board = (110, 78, 50) if kind != "boxes" else (206, 206, 204)
    pitch = {"bread": 0.42, "bottles": 0.5, "sweets": 0.36}.get(kind, 0.46)
    z = floor
    while z < 2.2:
        canvas.rect(span[0], z, span[1], z + 0.04, board)
        x = span[0] + 0.02
        while x < span[1] - 0.05:
            x += _item(canvas, kind, (x, z + 0.04), pitch, rng)
        z += pitch


def _crates(
    canvas: Canvas, palette: tuple[Colour, ...], span: tuple[float, float], floor: float, rng: np.random.Generator
) -> None:
    for z in (floor, floor + 0.45, floor + 0.9):
        for x in np.arange(span[0], span[1] - 0.3, 0.44):
            canvas.rect(x, z, x + 0.4, z + 0.16, (146, 106, 64))
            tone = _pick(rng, palette)
            for fx, fz in rng.uniform((x + 0.05, z + 0.14), (x + 0.36, z + 0.32), (14, 2)):
                canvas.disc(fx, fz, 0.055, tuple(int(c * rng.uniform(0.75, 1.1)) for c in tone))


def _tables(canvas: Canvas, span: tuple[float, float], floor: float) -> None:
    for x in np.arange(span[0] + 0.35, span[1] - 0.2, 0.75):
        canvas.rect(x - 0.28, floor + 0.5, x + 0.28, floor + 0.56, (236, 230, 220))
        canvas.rect(x - 0.03, floor, x + 0.03, floor + 0.5, (60, 44, 34))
        canvas.disc(x, floor + 1.45, 0.16, (250, 214, 140))
        canvas.line([(x, floor + 1.6), (x, 2.75)], 0.015, (40, 40, 40))
        canvas.rect(x - 0.05, floor + 0.56, x + 0.03, floor + 0.76, (60, 110, 70))


def _shoes(canvas: Canvas, x: float, floor: float, rng: np.random.Generator) -> None:
    outline = [(-0.2, 0.03), (0.2, 0.03), (0.18, 0.1), (0.0, 0.13), (-0.08, 0.2), (-0.2, 0.2)]
    for z in np.arange(floor, 2.0, 0.36):
        canvas.rect(x - 0.28, z, x + 0.28, z + 0.03, (226, 222, 214))
        canvas.fill([(x + dx, z + dz) for dx, dz in outline], _pick(rng, (*BRIGHT[:4], (40, 34, 30), (96, 58, 34))))


def _mannequin(canvas: Canvas, x: float, floor: float, tone: Colour) -> None:
    outline = [(-0.2, 1.4), (0.2, 1.4), (0.13, 0.9), (0.24, 0.3), (-0.24, 0.3), (-0.13, 0.9)]
    canvas.disc(x, floor + 1.55, 0.1, (206, 170, 140))
    canvas.fill([(x + dx, floor + dz) for dx, dz in outline], tone)


def _item(canvas: Canvas, kind: str, at: Point, shelf_m: float, rng: np.random.Generator) -> float:
    """One thing on a shelf, its lower left corner at a point; returns the width it takes."""
    x, z = at
    if kind in ("books", "boxes", "papers"):
        w = float(rng.uniform(0.03, 0.07) if kind == "books" else rng.uniform(0.1, 0.24))
        h = float(rng.uniform(0.6, 0.92)) * (shelf_m - 0.06)
        tone = tuple(int(c * rng.uniform(0.5, 1.0)) for c in _pick(rng, BRIGHT))
        canvas.rect(x, z, x + w, z + h, tone)
        if kind != "books":
            canvas.rect(x + 0.02, z + h * 0.5, x + w - 0.02, z + h * 0.75, WHITE)
        return w + 0.012
    if kind == "bottles":
        tone = _pick(rng, ((30, 70, 40), (90, 50, 20), (150, 30, 30), (220, 200, 140), (40, 60, 90)))
        canvas.rect(x, z, x + 0.08, z + 0.24, tone)
        canvas.rect(x + 0.025, z + 0.24, x + 0.055, z + 0.36, tone)
        canvas.rect(x, z + 0.06, x + 0.08, z + 0.16, CREAM)
        return 0.105
    if kind == "bread":
        tone = tuple(int(c * rng.uniform(0.8, 1.15)) for c in (196, 138, 70))
        w = float(rng.uniform(0.14, 0.34))
        canvas.fill(
            [(x, z), (x + w, z), (x + w * 0.9, z + 0.13), (x + w * 0.5, z + 0.17), (x + w * 0.1, z + 0.13)], tone
        )
        return w + 0.03
    canvas.rect(x, z, x + 0.13, z + 0.2, (226, 232, 236))
    for fx, fz in rng.uniform((x + 0.02, z + 0.02), (x + 0.11, z + 0.16), (7, 2)):
        canvas.disc(fx, fz, 0.026, _pick(rng, BRIGHT))
    canvas.rect(x + 0.01, z + 0.2, x + 0.12, z + 0.24, _pick(rng, BRIGHT))
    return 0.16
