"""Pictures of plans: camera positions around an object and what each sees; flat pieces on it and their stretch."""

from colorsys import hsv_to_rgb
from dataclasses import replace

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.imaging.read import encode_image
from toolkit.objects.flatten import edge_changes
from toolkit.objects.load import TableObject
from toolkit.objects.wrap import Wrap, dress_mesh
from toolkit.rig.camera import Camera, distance_to_fill
from toolkit.rig.plan import Pose
from toolkit.rig.renderers import RAYCAST, make_renderer
from toolkit.rig.scene import Scene
from toolkit.rig.shading import tone_map

SIDES = ((30, 25), (120, 25), (210, 25), (300, 25), (0, 75), (180, 5))
"""Azimuths and elevations that an object is shown from, degrees."""
CANVAS_PX = 2048
LETTER_MM = (5.0, 22.0)
"""Heights of numbers, least and greatest."""


@with_default_style
def draw_positions(item: TableObject, poses: list[Pose]) -> bytes:
    """PNG of the camera positions from above, with the object and its front, and their heights over their azimuths."""
    # centimetres, and at most 3,000 points: the object is only a backdrop
    positions = np.stack([pose.matrix()[:3, 3] for pose in poses]) / 10
    vertices = item.mesh.vertices[:: max(1, len(item.mesh.vertices) // 3000)] / 10
    azimuths, elevations = ([getattr(pose, name) for pose in poses] for name in ("azimuth_deg", "elevation_deg"))
    reach = 1.1 * float(max(np.abs(positions[:, :2]).max(), np.abs(vertices[:, :2]).max()))
    figure = make_figure(12, 5.6)
    # left: the table from above, the object's front along +x
    above, aside = figure.subplots(1, 2)
    above.scatter(vertices[:, 0], vertices[:, 1], s=0.5, c="0.6", linewidths=0)
    front = float(vertices[:, 0].max())
    above.annotate(
        "", (front + 0.2 * reach, 0), (front + 0.04 * reach, 0), arrowprops={"arrowstyle": "->"}, va="center"
    )
    above.text(front + 0.04 * reach, 0.03 * reach, "front", fontsize=9)
    above.set(xlabel="x, towards the object's front (cm)", ylabel="y, to the object's left (cm)", title="from above")
    above.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach))
    # right: heights over azimuths, past both ends so that dots at 0° and 360° are whole
    aside.set(xlabel="azimuth (degrees): 0 front, 90 left, 180 back, 270 right", ylabel="height above the table (cm)")
    aside.set(title="heights", xlim=(-20, 380), xticks=range(0, 361, 45), ylim=(0, 1.15 * positions[:, 2].max()))
    # dots are coloured by elevation; their numbers stay readable on dark ones
    for panel, x, y in ((above, positions[:, 0], positions[:, 1]), (aside, np.mod(azimuths, 360), positions[:, 2])):
        dots = panel.scatter(x, y, c=elevations, cmap="cividis", s=150, zorder=3)
        for pose, *at in zip(poses, x, y, strict=True):
            colour = "white" if dots.norm(pose.elevation_deg) < 0.6 else "black"
            panel.annotate(str(pose.id), at, ha="center", va="center", fontsize=8, color=colour, zorder=4)
        panel.grid(alpha=0.3)
    figure.colorbar(dots, ax=aside, label="elevation (degrees)", shrink=0.7)
    figure.suptitle(f"{item.name}: {len(poses)} camera positions")
    return encode_figure(figure, dpi=110)


def draw_contact_sheet(
    item: TableObject, camera: Camera, poses: list[Pose], studio: Scene, columns: int = 6, tile_px: int = 320
) -> bytes:
    """PNG of what every pose sees, with its number and angles."""
    small = camera.scaled(tile_px, round(tile_px * camera.height / camera.width))
    renderer = make_renderer(RAYCAST, item.mesh, studio)
    columns = min(columns, len(poses))
    rows = -(-len(poses) // columns)
    sheet = Image.new("RGB", (columns * small.width, rows * small.height), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=14)
    for i, pose in enumerate(poses):
        tile = tone_map(renderer.render(small, pose.matrix()), (0, pose.id))
        left, top = i % columns * small.width, i // columns * small.height
        sheet.paste(Image.fromarray(tile), (left, top))
        label = f"{pose.id}: azimuth {pose.azimuth_deg:.0f}°, elevation {pose.elevation_deg:.0f}°"
        # on white, as the picture behind may be dark
        box = draw.textbbox((left + 6, top + 4), label, font=font)
        draw.rectangle((box[0] - 3, box[1] - 2, box[2] + 3, box[3] + 2), fill="white")
        draw.text((left + 6, top + 4), label, font=font, fill="black")
    return encode_image(sheet, "PNG")


def draw_pieces(item: TableObject, wrap: Wrap, studio: Scene) -> bytes:
    """PNG of an object with its pieces in colours, numbered from the best, from six sides."""
    camera = Camera.from_fov(640, 480, 40.0)
    target = (0.0, 0.0, float(item.mesh.size_mm[2]) / 2)
    # from so far away that the object fills nine tenths of the picture
    poses = [
        Pose(
            id=number, azimuth_deg=azimuth, elevation_deg=elevation, target_mm=target,
            distance_mm=distance_to_fill(
                camera, item.mesh.vertices, np.array(target), azimuth, elevation, fill=0.9, roll_deg=0
            ),
        )
        for number, (azimuth, elevation) in enumerate(SIDES, 1)
    ]  # fmt: skip
    # worn as a wrap is, with a canvas of colours in place of its picture
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
    return encode_image(canvas, "PNG")


def _colour_pieces(wrap: Wrap) -> np.ndarray:
    """(n, n, 3) uint8 canvas on which each piece has its colour and number, with a dark edge."""
    canvas = Image.new("RGB", (CANVAS_PX, CANVAS_PX), "white")
    draw = ImageDraw.Draw(canvas)
    scale = _scale(wrap)
    for number, (piece, at) in enumerate(zip(wrap.pieces, wrap.record.pieces, strict=True), 1):
        # neighbours in the list lie a golden section of the colour circle apart
        shade = hsv_to_rgb(number * 0.618 % 1, 0.55 + 0.2 * (number % 2), 0.85)
        colour = (round(255 * shade[0]), round(255 * shade[1]), round(255 * shade[2]))
        # from the piece's own millimetres to its place on the canvas
        origin = np.array(at.origin_px) * wrap.record.texel_mm
        outline = piece.outline()
        for k, ring in enumerate([outline.exterior, *outline.interiors]):
            points = [tuple(point) for point in _flip((np.array(ring.coords) + origin) * scale)]
            # the outline is filled, the rings of holes are only drawn
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
