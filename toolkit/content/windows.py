"""Windows and doors as painted panes: a sheet of variants, some with curtains or blinds, some lit in the evening."""

from dataclasses import dataclass

import numpy as np

from toolkit.content.modelling import Colour
from toolkit.content.paint import Canvas, finish, fractal
from toolkit.content.pieces import Looks, Skin
from toolkit.objects.mesh import Material

COLUMNS, ROWS = 8, 2
GLOW_SHRINK = 2
WARM: Colour = (255, 204, 128)


@dataclass(frozen=True)
class PaneStyle:
    """How one kind of window is made.

    Attributes:
        frame: colour of its frame.
        glass: colour of what it mirrors, at its upper edge.
        bars: glazing bars across and up.
        frame_m, bar_m: their widths.
        size_m: of one pane.
        curtains: share of the panes with curtains or blinds.
        arched: whether its head is round.
    """

    frame: Colour
    glass: Colour = (150, 170, 188)
    bars: tuple[int, int] = (1, 1)
    frame_m: float = 0.07
    bar_m: float = 0.035
    size_m: tuple[float, float] = (1.1, 1.7)
    curtains: float = 0.7
    arched: bool = False


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
    name = f"window-{style}"
    if found := looks.known(name):
        return found
    rng, made = looks.rng(name), STYLES[style]
    cells = [_paint_pane(made, rng) for _ in range(COLUMNS * ROWS)]
    sheet, glow = (
        np.concatenate([np.concatenate([c[k] for c in cells[r * COLUMNS : (r + 1) * COLUMNS]], 1) for r in range(ROWS)])
        for k in (0, 1)
    )
    return looks.add(Material(name, sheet, 0.12, 0.0, glow))


def pane_uv(rng: np.random.Generator, count: int, mirror: bool = False) -> np.ndarray:
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


def _paint_pane(style: PaneStyle, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """One window by day, and the light it gives off in the evening."""
    width, height = style.size_m
    px_per_m = 96 / max(width, 1.0)
    canvas = Canvas(width, height, px_per_m, (0, 0, 0))
    w, h = canvas.size
    day = _glass(style, rng, w, h)
    lit = rng.random() < 0.45
    room = (
        np.array(WARM, np.float32)
        * rng.uniform(0.55, 1.0)
        * np.array([1, rng.uniform(0.9, 1.1), rng.uniform(0.7, 1.3)])
    )
    glow = np.broadcast_to(room.astype(np.float32) if lit else np.zeros(3, np.float32), (h, w, 3)).copy()
    glow *= np.linspace(1.0, 0.6, h, dtype=np.float32)[:, None, None]
    if rng.random() < style.curtains:
        _hang(style, rng, day, glow)
    frame = _frame(style, canvas)
    day = np.where(frame[..., None] > 0, day * (1 - frame[..., None]) + np.array(style.frame) * frame[..., None], day)
    edge = max(1, round(0.03 * px_per_m))
    day[:edge] *= 0.6  # the lintel's shade
    glow *= 1 - frame[..., None]
    small = glow[: h // GLOW_SHRINK * GLOW_SHRINK, : w // GLOW_SHRINK * GLOW_SHRINK]
    small = small.reshape(h // GLOW_SHRINK, GLOW_SHRINK, w // GLOW_SHRINK, GLOW_SHRINK, 3).mean((1, 3))
    return finish(day), finish(small)


def _glass(style: PaneStyle, rng: np.random.Generator, w: int, h: int) -> np.ndarray:
    """What the pane mirrors: sky above, the other side of the street below; and a dark room behind."""
    up = np.linspace(1, 0, h, dtype=np.float32)[:, None, None]
    dark = np.array((38, 42, 46), np.float32) * rng.uniform(0.7, 1.3)
    sky = np.array(style.glass, np.float32) * rng.uniform(0.75, 1.15)
    tilt = rng.uniform(-0.3, 0.3) * np.linspace(-1, 1, w, dtype=np.float32)[None, :, None]
    share = np.clip((up - rng.uniform(0.15, 0.6) + tilt) * rng.uniform(1.2, 4) + 0.35, 0.05, 1) * rng.uniform(
        0.45, 0.95
    )
    wavy = 1 + 0.1 * fractal(rng, (256, 256), 4, 3)[:h, :w, None]
    return (dark * (1 - share) + sky * share) * wavy


def _hang(style: PaneStyle, rng: np.random.Generator, day: np.ndarray, glow: np.ndarray) -> None:
    """Curtains to both sides, a roller blind, or slats."""
    h, w = day.shape[:2]
    cloth = np.array(
        [(214, 208, 196), (196, 182, 158), (168, 120, 104), (126, 140, 160), (224, 222, 218)][rng.integers(5)], float
    )
    kind = rng.integers(3)
    if kind == 0:
        x = np.abs(np.linspace(-1, 1, w))[None, :] + 0.12 * np.linspace(-1, 1, h)[:, None]
        cover = (x > rng.uniform(0.4, 0.8)).astype(np.float32)[..., None]
        folds = 1 + 0.16 * np.sin(np.linspace(0, 60, w))[None, :, None]
    elif kind == 1:
        cover = np.zeros((h, w, 1), np.float32)
        cover[: int(h * rng.uniform(0.2, 0.8))] = 1
        folds = np.ones((1, 1, 1))
    else:
        cover = np.zeros((h, w, 1), np.float32)
        cover[: int(h * rng.uniform(0.4, 1.0))] = 0.85
        folds = 1 + 0.25 * np.sign(np.sin(np.linspace(0, h * 0.9, h)))[:, None, None]
    opacity = cover * rng.uniform(0.75, 0.95)
    day *= 1 - opacity
    day += opacity * cloth * folds * 0.72
    glow *= 1 - 0.45 * cover


def _frame(style: PaneStyle, canvas: Canvas) -> np.ndarray:
    """(h, w) 1 where the frame is."""
    width, height = style.size_m
    drawn = Canvas(width, height, canvas.size[0] / width, (0, 0, 0))
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
    mask = drawn.texture()[..., 0].astype(np.float32) / 255
    if mask.shape != canvas.size[::-1]:
        mask = mask[: canvas.size[1], : canvas.size[0]]
    if style.arched:
        h, w = mask.shape
        y, x = np.mgrid[0:h, 0:w].astype(np.float32)
        radius = w / 2
        outside = ((x - radius) ** 2 + (y - radius) ** 2 > (radius - 2) ** 2) & (y < radius)
        mask = np.maximum(mask, outside)
    return mask
