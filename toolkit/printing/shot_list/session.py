"""All that the pages of one object show, worked out before anything is drawn, and where the camera stands."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import cv2
import numpy as np

from toolkit.core.console import Ticker
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh
from toolkit.printing.canvas import BOLD
from toolkit.printing.page import Rect
from toolkit.printing.shot_list.drawings import (
    CAMERA,
    FAINT,
    INK,
    OBJECT,
    SOFT,
    WASH,
    WHITE,
    Point,
    draw_arc,
    draw_arrow,
    draw_camera,
    draw_dimension,
    draw_head,
    draw_shapes,
    set_ink,
    write,
    write_on_white,
)
from toolkit.printing.shot_list.mounting import MountDrawing, draw_mountings, draw_views
from toolkit.printing.shot_list.places import CameraPlace, Stop, find_stops
from toolkit.rig.board import Board
from toolkit.rig.camera import Camera, orbit_direction
from toolkit.rig.plan import Pose
from toolkit.rig.shot_order import ShotStep
from toolkit.rig.variants import Paint, Print

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

SAMPLES = 420
"""Pixels along the longer side of the mask that outlines are traced on."""
FINEST = 1.2
"""Corners within so many of these pixels of a straight line are left out."""


def trace_outline(mesh: Mesh, right: np.ndarray, up: np.ndarray) -> list[np.ndarray]:
    """Closed outlines (k, 2), millimetres along `right` and `up` from the world's origin; holes are outlines too.

    Args:
        mesh: on the table.
        right, up: (3,) unit vectors of the drawing.
    """
    points = mesh.vertices @ np.stack([right, up], axis=1).astype(np.float32)
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    step = max(float(size.max()) / SAMPLES, 1e-6)
    shape = np.ceil(size / step).astype(int) + 5
    mask = np.zeros((shape[1], shape[0]), np.uint8)
    pixels = np.round(((points - low) / step + 2) * 16).astype(np.int32)
    for triangle in pixels[mesh.faces]:  # one by one: fillPoly of all at once leaves out what two of them cover
        cv2.fillConvexPoly(mask, triangle, 255, cv2.LINE_8, 4)
    contours, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    traced = [cv2.approxPolyDP(contour, FINEST, True)[:, 0] for contour in contours]
    return [(outline - 2.0) * step + low for outline in traced if len(outline) >= 3]


FRONT_DEG = -90.0
"""On the page, azimuth 0 is downwards: the board lies like that before the photographer, FRONT at its lower edge."""


@dataclass(frozen=True)
class Surroundings:
    """What all drawings of one object share, so that they are of one scale.

    Attributes:
        mesh: the object.
        above: its outlines from above, millimetres on the page, the front downwards.
        sides: its outlines by azimuth, millimetres: away from the object's middle towards the camera, and up.
        places: of all its poses.
    """

    mesh: Mesh
    above: list[np.ndarray]
    sides: dict[float, list[np.ndarray]]
    places: tuple[CameraPlace, ...]

    @property
    def farthest_mm(self) -> float:
        """Greatest distance along the table of camera or object."""
        return max(*(place.out_mm for place in self.places), float(max(np.abs(o).max() for o in self.above)))

    @property
    def highest_mm(self) -> float:
        """Greatest height of camera or object."""
        return max(*(place.height_mm for place in self.places), float(self.mesh.size_mm[2]))

    @property
    def reach_mm(self) -> float:
        """How far the object reaches from its middle, along the table."""
        return float(np.hypot(*self.mesh.vertices[:, :2].T).max())


def survey(mesh: Mesh, places: Sequence[CameraPlace]) -> Surroundings:
    """Trace the object from above and from the side of each place."""
    up = np.array([0.0, 0.0, 1.0])
    sides = {
        azimuth: trace_outline(mesh, orbit_direction(azimuth, 0.0), up)
        for azimuth in dict.fromkeys(place.azimuth_deg for place in places)
    }
    above = trace_outline(mesh, np.array([0.0, 1.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    return Surroundings(mesh, above, sides, tuple(places))


def page_angle(azimuth_deg: float) -> float:
    """The direction on the page of an azimuth, counter-clockwise from the right."""
    return azimuth_deg + FRONT_DEG


def _towards(angle_deg: float, length: float, centre: Point) -> Point:
    angle = np.radians(angle_deg)
    return centre[0] + length * float(np.cos(angle)), centre[1] + length * float(np.sin(angle))


def draw_from_above(canvas: "Canvas", area: Rect, around: Surroundings, place: CameraPlace) -> None:
    """The object, the camera beside it, and the angle between its front and the camera."""
    centre = (area.x + area.width / 2, area.y + area.height / 2)
    radius = min(area.width, area.height) / 2 - 4.4
    scale = radius / around.farthest_mm
    set_ink(canvas, FAINT, 0.18)
    canvas.setDash(0.6, 0.8)
    canvas.circle(*centre, place.out_mm * scale, stroke=1, fill=0)
    canvas.setDash()
    set_ink(canvas, OBJECT)
    draw_shapes(canvas, around.above, scale, *centre)
    set_ink(canvas, SOFT, 0.2)
    canvas.line(*centre, centre[0], centre[1] - radius)
    beside = 6.0 if min(place.azimuth_deg, 360 - place.azimuth_deg) < 25 else 0.0  # the camera stands there
    write_on_white(canvas, "front", centre[0] - beside, centre[1] - radius - (0.0 if beside else 1.4), 2.1, colour=SOFT)
    angle = page_angle(place.azimuth_deg)
    at = _towards(angle, place.out_mm * scale, centre)
    set_ink(canvas, CAMERA, 0.25)
    canvas.line(*centre, *at)
    arc = max(0.36 * radius, 5.5)
    if place.azimuth_deg > 0.5:
        canvas.setLineWidth(0.3)
        draw_arc(canvas, centre, arc, FRONT_DEG, place.azimuth_deg)
        draw_head(canvas, _towards(angle, arc, centre), angle + 90 - np.degrees(0.8 / arc), 1.7)
    draw_camera(canvas, at, angle + 180)
    middle = FRONT_DEG + (place.azimuth_deg / 2 if place.azimuth_deg > 50 else place.azimuth_deg + 42)
    write_on_white(canvas, f"{place.azimuth_deg:.0f}°", *_towards(middle, arc, centre), 3.0, BOLD, CAMERA)


def draw_from_side(canvas: "Canvas", area: Rect, around: Surroundings, place: CameraPlace) -> None:
    """The object on the table, the camera on the right of it, and the four numbers of its place."""
    left_mm, right_mm = around.reach_mm, around.farthest_mm
    below, above, beside = 5.2, 4.6, 11.0
    scale = min((area.width - beside - 3.5) / (left_mm + right_mm), (area.height - below - above) / around.highest_mm)
    spare = area.width - beside - 3.5 - (left_mm + right_mm) * scale
    x, y = area.x + left_mm * scale + 0.5 + spare / 2, area.y + below  # the object's middle on the table
    set_ink(canvas, OBJECT)
    draw_shapes(canvas, around.sides[place.azimuth_deg], scale, x, y)
    at = (x + place.out_mm * scale, y + place.height_mm * scale)
    target = (x, y + place.target_height_mm * scale)
    end = max(at[0], x + left_mm * scale) + 2.5
    set_ink(canvas, INK, 0.35)
    canvas.line(x - left_mm * scale - 0.5, y, max(end, at[0] + 4.0), y)
    set_ink(canvas, SOFT, 0.15)
    canvas.setDash(0.5, 0.7)
    canvas.line(x, target[1], at[0], target[1])
    canvas.line(x, y, x, y - 3.2)
    canvas.line(at[0], at[1], at[0], y - 3.2)
    canvas.setDash()
    set_ink(canvas, CAMERA, 0.3)
    canvas.line(*target, *at)
    draw_camera(canvas, at, 180 + place.tilt_deg)
    _mark_tilt(canvas, target, place, scale)
    upright = at[0] + 2.0
    draw_dimension(canvas, (upright, y), (upright, at[1]), "", colour=INK)
    label = f"{place.height_mm / 10:.1f} cm"
    write(canvas, label, upright + 0.9, (y + at[1]) / 2 - 1.0, 2.9, room_mm=12, font=BOLD)
    draw_dimension(canvas, (x, y - 2.6), (at[0], y - 2.6), f"{place.out_mm / 10:.1f} cm", 2.9)
    middle = (target[0] + 0.66 * (at[0] - target[0]), target[1] + 0.66 * (at[1] - target[1]))
    write_on_white(canvas, f"{place.distance_mm / 10:.1f} cm", *middle, 2.9, colour=CAMERA)


def _mark_tilt(canvas: "Canvas", target: Point, place: CameraPlace, scale: float) -> None:
    """The angle between table and line of sight, at the point that is looked at."""
    radius = max(0.3 * place.distance_mm * scale, 6.0)
    set_ink(canvas, CAMERA, 0.25)
    if abs(place.tilt_deg) > 1:
        draw_arc(canvas, target, radius, 0, place.tilt_deg)
    where = _towards(place.tilt_deg / 2, radius, target)
    write_on_white(canvas, f"{place.tilt_deg:.0f}°", *where, 2.7, BOLD, CAMERA)


def draw_walk(canvas: "Canvas", area: Rect, around: Surroundings, stops: Sequence[Stop]) -> None:
    """All places numbered along the tour, on a map of directions: the middle is straight above the object."""
    centre = (area.x + area.width / 2, area.y + area.height / 2 + 1.8)
    radius = min(area.width, area.height - 3.6) / 2
    lowest = min(stop.place.tilt_deg for stop in stops)
    per_degree = (radius - 4.6) / max(90 - lowest, 1)
    at = [
        _towards(page_angle(stop.place.azimuth_deg), (90 - stop.place.tilt_deg) * per_degree, centre) for stop in stops
    ]
    apart = [float(np.hypot(a[0] - b[0], a[1] - b[1])) for i, a in enumerate(at) for b in at[:i]]
    size = float(np.clip(0.42 * min(apart, default=9.0), 1.2, 3.1))
    set_ink(canvas, WASH)
    canvas.circle(*centre, radius, stroke=0, fill=1)
    tilts = sorted({round(stop.place.tilt_deg) for stop in stops})
    tilts = tilts if len(tilts) <= 4 else []
    for tilt in tilts:
        set_ink(canvas, FAINT, 0.2)
        canvas.circle(*centre, (90 - tilt) * per_degree, stroke=1, fill=0)
    inner = np.clip(
        (90 - max(stop.place.tilt_deg for stop in stops)) * per_degree - size - 1.5, 0.16 * radius, 0.5 * radius
    )
    set_ink(canvas, OBJECT)
    draw_shapes(canvas, around.above, float(inner) / around.reach_mm, *centre)
    set_ink(canvas, CAMERA, 0.35)
    for a, b in zip(at, at[1:] + at[:1], strict=True):
        way = np.subtract(b, a)
        length = float(np.hypot(*way))
        if length > 2 * size + 0.8:
            unit = way / length * size
            draw_arrow(canvas, tuple(np.add(a, unit)), tuple(np.subtract(b, unit * 1.12)), 1.7)
    _name_rings(canvas, centre, per_degree, tilts, at)
    for stop, (x, y) in zip(stops, at, strict=True):
        first = stop.number == 1
        canvas.setFillColorRGB(*(CAMERA if first else WHITE))
        canvas.setStrokeColorRGB(*CAMERA)
        canvas.setLineWidth(0.35)
        canvas.circle(x, y, size, stroke=1, fill=1)
        write(canvas, str(stop.number), x, y - 0.38 * size, 1.05 * size, room_mm=1.75 * size, font=BOLD, align="centre",
              colour=WHITE if first else CAMERA)  # fmt: skip
    write(canvas, "front", centre[0], area.y - 0.6, 2.6, room_mm=20, font=BOLD, align="centre", colour=SOFT)


def _name_rings(
    canvas: "Canvas", centre: Point, per_degree: float, tilts: Sequence[int], at: Sequence[Point]
) -> None:  # fmt: skip
    """The elevation of each ring, written where places and the walk between them are farthest."""
    for tilt in tilts:
        spots = [_towards(angle, (90 - tilt) * per_degree, centre) for angle in range(0, 360, 5)]
        where = max(spots, key=lambda spot: min(_distance(spot, a, b) for a, b in pairwise([*at, at[0]])))
        write_on_white(canvas, f"{tilt}° up", *where, 2.2, colour=SOFT, plate=WASH)


def _distance(point: Point, start: Point, end: Point) -> float:
    """From a point to a line between two others."""
    way, off = np.subtract(end, start), np.subtract(point, start)
    share = float(np.clip(off @ way / max(float(way @ way), 1e-9), 0, 1))
    return round(float(np.hypot(*(off - share * way))), 6)


@dataclass(frozen=True)
class ObjectSession:
    """One object's part of the list.

    Attributes:
        item, camera: the object and the plan's camera.
        stops: its places along the tour.
        booster: what is on the sheets; None where nothing is stuck on.
        mountings: where each sheet goes.
        note: why nothing is, where it should have been.
        patch_pdf: name of the sheets' printed page, where there is one.
        board: what it stands on.
        around: what its drawings share.
        views: JPEGs by (variant, pose id).
        poses_sha256: `hash_poses` of the plan.
    """

    item: TableObject
    camera: Camera
    stops: tuple[Stop, ...]
    booster: Print | None
    mountings: tuple[MountDrawing, ...]
    note: str | None
    patch_pdf: str | None
    board: Board | None
    around: Surroundings
    views: dict[tuple[str, int], bytes]
    poses_sha256: str

    @property
    def sheets(self) -> int:
        """How many go on at once."""
        return len(self.item.spec.mounts)

    @property
    def places(self) -> list[CameraPlace]:
        """Of all stops."""
        return [stop.place for stop in self.stops]


def prepare_session(
    item: TableObject, camera: Camera, poses: list[Pose], steps: list[ShotStep],
    boosters: dict[str, Print | Paint | None], poses_sha256: str, bar: Ticker, board: Board | None = None,
    patch_pdf: str | None = None, note: str | None = None,
) -> ObjectSession:  # fmt: skip
    """Render and measure one object's part of the list.

    Args:
        item: the object.
        camera: the plan's.
        poses: of the object.
        steps: of the object, in order.
        boosters: by variant.
        poses_sha256: `hash_poses` of the plan.
        bar: counts one per picture, and one for the mounting.
        board, patch_pdf, note: as in `ObjectSession`.

    Raises:
        ToolkitError: the sheet cannot be mounted on the object.
    """
    stops = find_stops(poses, steps)
    views = draw_views(item, camera, poses, boosters, board, bar=bar)
    stuck = [b for b in (boosters.get("patched"), *boosters.values()) if isinstance(b, Print) and not b.alone]
    mountings = draw_mountings(item, stuck[0]) if stuck else []
    bar.advance(note=f"{item.name}: where the patch goes")
    around = survey(item.mesh, [stop.place for stop in stops])
    return ObjectSession(
        item, camera, tuple(stops), stuck[0] if stuck else None, tuple(mountings), note=note, patch_pdf=patch_pdf,
        board=board, around=around, views=views, poses_sha256=poses_sha256,
    )  # fmt: skip
