"""Plan the pieces of an object, draw them on it and as they are stretched, and keep them."""

from collections.abc import Iterator
from colorsys import hsv_to_rgb
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from toolkit.captures.shoot import ShootSettings, studio_for
from toolkit.core.files import write_bytes
from toolkit.core.text import quote
from toolkit.core.workspace import PACKAGE_DATA, Workspace
from toolkit.imaging.read import encode_image
from toolkit.objects.load import TableObject, load_object
from toolkit.rig.camera import Camera, distance_to_fill
from toolkit.rig.plan import Pose
from toolkit.rig.plan_pictures import draw_contact_sheet
from toolkit.rig.scene import Scene
from toolkit.rooms.wraps.config import WrapConfig
from toolkit.rooms.wraps.cutting.flatten import edge_changes
from toolkit.rooms.wraps.wrap import Wrap, dress_mesh, write_wrap
from toolkit.rooms.wraps.wrap_plan import plan_wrap

SIDES = ((30, 25), (120, 25), (210, 25), (300, 25), (0, 75), (180, 5))
"""Azimuths and elevations that an object is shown from, degrees."""
CANVAS_PX = 2048
LETTER_MM = (5.0, 22.0)
"""Heights of numbers, least and greatest."""
PIECE_TITLES = ("piece", "size, mm", "area, cm²", "stretch", "folds", "meets")


@dataclass(frozen=True)
class SuggestedWrap:
    """A plan of pieces."""

    wrap: Wrap
    folder: Path
    preview: Path
    stretch: Path

    def as_json(self) -> dict[str, Any]:
        """Return the result for a script."""
        record, shown = self.wrap.record, {"number", "width_mm", "height_mm", "area_mm2", "stretch"}
        pieces = [piece.model_dump(include=shown) for piece in record.pieces]
        return {
            "object": record.object, "folder": str(self.folder), "preview": str(self.preview),
            "stretch_picture": str(self.stretch), "covered": record.covered,
            "covered_surface": record.covered_surface, "texel_mm": record.texel_mm, "n_px": record.n_px,
            "pieces": pieces,
        }  # fmt: skip

    def rows(self) -> list[tuple[str, ...]]:
        """Return a row under `PIECE_TITLES` for each piece."""
        return [
            (
                str(piece.number), f"{piece.width_mm:.0f} × {piece.height_mm:.0f}", f"{piece.area_mm2 / 100:.1f}",
                f"{piece.stretch:.1%}", str(len(piece.folds_mm)),
                ", ".join(map(str, sorted({seam.piece for seam in piece.seams}))),
            )
            for piece in self.wrap.record.pieces
        ]  # fmt: skip

    def lines(self) -> Iterator[str]:
        """Yield sentences on coverage, files, and the next commands."""
        record = self.wrap.record
        count = "1 piece covers" if len(record.pieces) == 1 else f"{len(record.pieces)} pieces cover"
        yield (
            f"{count} {record.covered:.0%} of the area of {record.object} that random cameras see "
            f"({record.covered_surface:.0%} of its surface); 95 % of each is stretched by {record.stretch_allowed:.1%} "
            "or less"
        )
        yield f"{self.preview}: the pieces on the object; {self.stretch}: their stretch"
        yield f"wrote {self.folder}"
        if (PACKAGE_DATA / "wraps" / record.name).is_dir():
            yield f"these pieces hide the shipped wrap of {record.name}: delete the folder to use that wrap again"
        if record.picture is None:
            yield f"next: toolkit train-wrap --object {record.object}, then toolkit print --wrap {record.name}"
            return
        start = f"toolkit train-wrap --object {record.object} --start {quote(self.folder)}"
        yield f"{record.picture.name} is on the pieces, {record.texel_mm:g} mm a texel"
        yield f"next: toolkit print --wrap {record.name}; to train it further: {start}"


def suggest_wrap(workspace: Workspace, object_name: str, config: WrapConfig, seed: int = 0) -> SuggestedWrap:
    """Plan the pieces of an object, draw them, and write them to `print/wraps/NAME`.

    Raises:
        ToolkitError: the object is unknown, or no part of it can be covered flat.
    """
    item = load_object(workspace.object_spec(object_name))
    wrap = plan_wrap(item, config, seed)
    folder = workspace.wraps_dir / wrap.record.name
    wrap = write_wrap(folder, wrap)
    preview = workspace.root / "rig" / "preview" / f"{object_name}-wrap.png"
    stretch = preview.with_name(f"{object_name}-wrap-stretch.png")
    write_bytes(preview, draw_pieces(item, wrap, studio_for(item, ShootSettings())))
    write_bytes(stretch, draw_stretch(item, wrap))
    return SuggestedWrap(wrap, folder, preview, stretch)


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
