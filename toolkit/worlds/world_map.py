"""A map of a world: seen from straight above, with its places, its pads and the cameras of its pictures."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from toolkit.imaging.plots import read_font
from toolkit.rig.camera import Camera, look_at, project
from toolkit.worlds.viewpoints import Viewpoint
from toolkit.worlds.world import World

Ink = tuple[int, int, int]
ALTITUDE = 10
"""Of the map's camera, in sides of the map: what stands up leans outwards by a twentieth of its height at the edge."""
MARGIN = 1.06
KINDS: dict[str, Ink] = {"ground": (255, 214, 64), "roof": (255, 120, 200), "water": (90, 210, 255)}
PAD: Ink = (120, 255, 120)
CAMERA: Ink = (255, 70, 60)
PATH: Ink = (255, 255, 255)
INK_EDGE: Ink = (20, 20, 20)
LABEL_PX = 17
BARS_M = (5, 10, 20, 50, 100, 200, 500, 1000)


@dataclass(frozen=True)
class MapSheet:
    """The camera of a map, straight above a world's core; north, +y, is up."""

    camera: Camera
    T_world_camera: np.ndarray

    @classmethod
    def over(cls, world: World, side_px: int) -> "MapSheet":
        """Over the whole core."""
        middle = np.append(world.core.mean(axis=0), 0.0)
        side = MARGIN * float(np.ptp(world.core, axis=0).max())
        camera = Camera.from_fov(side_px, side_px, 2 * float(np.degrees(np.arctan(0.5 / ALTITUDE))))
        return cls(camera, look_at(middle + [0, 0, ALTITUDE * side], middle, azimuth_deg=-90.0))

    def place(self, points: np.ndarray) -> list[tuple[float, float]]:
        """Pixels of points (n, 3), metres."""
        pixels, _ = project(self.camera, self.T_world_camera, points)
        return [(float(x), float(y)) for x, y in pixels]

    @property
    def px_per_m(self) -> float:
        """On the ground."""
        return self.camera.fx / float(self.T_world_camera[2, 3])


def draw_map(
    picture: np.ndarray, sheet: MapSheet, world: World, viewpoints: Sequence[Viewpoint], path: np.ndarray | None = None
) -> np.ndarray:
    """(h, w, 3) uint8 a picture from above with all that is known of a world drawn on it.

    Args:
        picture: (h, w, 3) uint8 sRGB, seen by the sheet's camera.
        sheet: of the map.
        world: its spots are drawn as far as they are free, its pads green.
        viewpoints: cameras, as arrows.
        path: (n, 3) of a flight.
    """
    image = Image.fromarray((picture * np.float32(0.8)).astype(np.uint8))
    draw = ImageDraw.Draw(image)
    pads = {pad.name for pad in world.pads}
    if path is not None:
        draw.line(sheet.place(path), fill=PATH, width=2)
    labels: list[tuple[float, float, str, Ink]] = []
    for spot in world.spots:
        ink = PAD if spot.name in pads else KINDS[spot.kind]
        x, y = sheet.place(np.array([spot.position]))[0]
        radius = max(spot.free_radius_m * sheet.px_per_m, 4)
        draw.ellipse((x - radius, y - radius, x + radius, y + radius), outline=ink, width=3)
        labels.append((x, y, spot.name, ink))
    for one in viewpoints:
        labels.append((*_draw_camera(draw, sheet, one), one.name, CAMERA))
    font = read_font("sans", LABEL_PX)
    sizes = [(draw.textlength(name, font) + 6, LABEL_PX + 4.0) for _, _, name, _ in labels]
    middles = spread_labels([(x, y) for x, y, *_ in labels], sizes, (image.width, image.height))
    for (x, y, _, ink), middle in zip(labels, middles, strict=True):
        draw.line((x, y, *middle), fill=ink, width=1)
    for (_, _, name, ink), middle in zip(labels, middles, strict=True):
        draw.text(middle, name, ink, font, anchor="mm", stroke_width=2, stroke_fill=INK_EDGE)
    _draw_scale(draw, sheet, world)
    return np.asarray(image)


def spread_labels(
    wanted: Sequence[tuple[float, float]], sizes: Sequence[tuple[float, float]], within: tuple[int, int]
) -> list[tuple[float, float]]:
    """Middles of labels that do not overlap, each as near as may be to where it is wanted.

    Each label in turn takes the nearest free place on rings about the wanted one; where none is free, the wanted one.

    Args:
        wanted: (x, y) of the middles, pixels.
        sizes: (width, height) of each label, pixels.
        within: width and height of the picture, which no label leaves.
    """
    turns = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    circle = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    rings = np.concatenate([np.zeros((1, 2)), *(radius * circle for radius in range(8, 200, 8))])
    middles, halves = np.zeros((0, 2)), np.array(sizes).reshape(-1, 2) / 2
    for (x, y), half in zip(wanted, halves, strict=True):
        tried = np.clip(rings + (x, y), half, np.maximum(np.array(within) - half, half))
        apart = np.abs(tried[:, None] - middles) >= halves[: len(middles)] + half
        free = apart.any(axis=2).all(axis=1)
        middles = np.vstack([middles, tried[int(np.argmax(free))]])
    return [(float(x), float(y)) for x, y in middles]


def _draw_camera(draw: ImageDraw.ImageDraw, sheet: MapSheet, one: Viewpoint) -> tuple[float, float]:
    """An arrow the way a camera looks; returns where its name goes."""
    ahead = one.T_world_camera[:3, 2] * [1, 1, 0]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    foot = one.position * [1, 1, 0]
    aside = np.array([-ahead[1], ahead[0], 0.0])
    unit = 14 / sheet.px_per_m
    corners = [foot + 2.2 * unit * ahead, foot + 0.8 * unit * aside, foot - 0.8 * unit * aside]
    draw.polygon(sheet.place(np.array(corners)), fill=CAMERA, outline=INK_EDGE)
    x, y = sheet.place(np.array([foot - 1.2 * unit * ahead]))[0]
    return x, y


def _draw_scale(draw: ImageDraw.ImageDraw, sheet: MapSheet, world: World) -> None:
    """A bar of round length, north, and what the marks mean."""
    side = sheet.camera.width
    length = max((one for one in BARS_M if one * sheet.px_per_m < 0.3 * side), default=BARS_M[0])
    font, left, low = read_font("sans", 20), 30, side - 34
    right = left + length * sheet.px_per_m
    draw.line((left, low, right, low), fill=PATH, width=5)
    draw.text((left, low - 8), f"{length} m", PATH, font, anchor="ld", stroke_width=2, stroke_fill=INK_EDGE)
    draw.text((side - 30, 30), "N ↑", PATH, font, anchor="rt", stroke_width=2, stroke_fill=INK_EDGE)
    kinds = {spot.kind for spot in world.spots}
    rows: list[tuple[str, Ink]] = [(f"free {kind}", ink) for kind, ink in KINDS.items() if kind in kinds]
    rows += [("landing pad", PAD)] if world.pads else []
    for k, (words, ink) in enumerate([*rows, ("camera", CAMERA), ("flythrough", PATH)]):
        draw.text((30, 30 + 26 * k), words, ink, font, anchor="lt", stroke_width=2, stroke_fill=INK_EDGE)
