"""Pictures of a plan of flat pieces: numbered on the object from all sides, and how far each part is stretched."""

from colorsys import hsv_to_rgb
from dataclasses import replace
from io import BytesIO

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from toolkit.objects.flatten import edge_changes
from toolkit.objects.load import TableObject
from toolkit.objects.wrap import Wrap, dress_mesh
from toolkit.rig.camera import Camera, distance_to_fill
from toolkit.rig.plan import Pose
from toolkit.rig.plan_pictures import draw_contact_sheet
from toolkit.rig.scene import Scene

SIDES = ((30, 25), (120, 25), (210, 25), (300, 25), (0, 75), (180, 5))
"""Azimuths and elevations that an object is shown from, degrees."""
CANVAS_PX = 2048
LETTER_MM = (5.0, 22.0)
"""Heights of numbers, least and greatest."""


def draw_pieces(item: TableObject, wrap: Wrap, studio: Scene) -> bytes:
    """PNG of an object with its pieces in colours, numbered from the best, from six sides."""
    camera = Camera.from_fov(640, 480, 40.0)
    target = (0.0, 0.0, float(item.mesh.size_mm[2]) / 2)
    poses = [
        Pose(
            id=number, azimuth_deg=azimuth, elevation_deg=elevation, target_mm=target,
            distance_mm=distance_to_fill(
                camera, item.mesh.vertices, np.array(target), azimuth, elevation, fill=0.9, roll_deg=0
            ),
        )
        for number, (azimuth, elevation) in enumerate(SIDES, 1)
    ]  # fmt: skip
    mesh = dress_mesh(item.mesh, wrap, _colour_pieces(wrap))
    return draw_contact_sheet(replace(item, mesh=mesh), camera, poses, studio, columns=3, tile_px=480)


def draw_stretch(item: TableObject, wrap: Wrap) -> bytes:
    """PNG of all pieces as they lie flat, from white where nothing is stretched to red at what is allowed."""
    canvas = Image.new("RGB", (CANVAS_PX, CANVAS_PX), (90, 90, 90))
    draw = ImageDraw.Draw(canvas)
    corners, places = item.mesh.vertices[item.mesh.faces].astype(np.float64), _places(wrap, len(item.mesh.faces))
    allowed = wrap.record.stretch_allowed
    for number, piece in enumerate(wrap.pieces, 1):
        change = edge_changes(corners[piece.faces], piece.flat_mm).max(axis=1) / allowed
        fade = np.round(255 * (1 - np.clip(change, 0, 1))).astype(int)
        for place, level, far in zip(places[piece.faces], fade.tolist(), change > 1, strict=True):
            draw.polygon([tuple(point) for point in place], (120, 0, 90) if far else (255, level, level))
        _write_number(draw, wrap, number, "black")
    buffer = BytesIO()
    canvas.save(buffer, "PNG")
    return buffer.getvalue()


def _colour_pieces(wrap: Wrap) -> np.ndarray:
    """(n, n, 3) uint8 canvas on which each piece has its colour and number, with a dark edge."""
    canvas = Image.new("RGB", (CANVAS_PX, CANVAS_PX), "white")
    draw = ImageDraw.Draw(canvas)
    scale = _scale(wrap)
    for number, (piece, at) in enumerate(zip(wrap.pieces, wrap.record.pieces, strict=True), 1):
        # neighbours in the list lie a golden section of the colour circle apart
        shade = hsv_to_rgb(number * 0.618 % 1, 0.55 + 0.2 * (number % 2), 0.85)
        colour = (round(255 * shade[0]), round(255 * shade[1]), round(255 * shade[2]))
        origin = np.array(at.origin_px) * wrap.record.texel_mm
        outline = piece.outline()
        for k, ring in enumerate([outline.exterior, *outline.interiors]):
            points = [tuple(point) for point in _flip((np.array(ring.coords) + origin) * scale)]
            if k == 0:
                bleed = max(2, round(wrap.record.bleed_px * wrap.record.texel_mm * scale / 2))
                draw.polygon(points, colour, outline=colour, width=bleed)
            draw.line(points, fill=(30, 30, 30), width=max(1, round(0.6 * scale)))
        _write_number(draw, wrap, number, "white")
    return np.asarray(canvas)


def _write_number(draw: ImageDraw.ImageDraw, wrap: Wrap, number: int, colour: str) -> None:
    """Write a piece's number where it is widest."""
    import shapely

    piece, at, scale = wrap.pieces[number - 1], wrap.record.pieces[number - 1], _scale(wrap)
    circle = shapely.maximum_inscribed_circle(piece.outline(), 0.5)
    middle = np.array(circle.coords[0]) + np.array(at.origin_px) * wrap.record.texel_mm
    height_mm = float(np.clip(1.1 * circle.length, *LETTER_MM))
    font = ImageFont.load_default(size=max(8, round(height_mm * scale)))
    draw.text(tuple(_flip(middle * scale)), str(number), fill=colour, font=font, anchor="mm")


def _scale(wrap: Wrap) -> float:
    """Pixels of a drawn canvas for a millimetre."""
    return CANVAS_PX / (wrap.record.n_px * wrap.record.texel_mm)


def _flip(points: np.ndarray) -> np.ndarray:
    """Points (…, 2), y up, in the pixels of a drawn canvas, y down."""
    return points * [1, -1] + [0, CANVAS_PX]


def _places(wrap: Wrap, faces_count: int) -> np.ndarray:
    """(m, 3, 2) where faces lie on a drawn canvas, pixels; NaN off the pieces."""
    return _flip(wrap.corner_uv(faces_count).astype(np.float64) * CANVAS_PX)
