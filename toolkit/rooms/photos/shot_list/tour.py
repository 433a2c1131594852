"""Places of a tour: in numbers, with the shots to take at each, and drawn round the object."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from toolkit.objects.mesh import Mesh
from toolkit.printing.canvas import BOLD, CAMERA, FAINT, INK, OBJECT, SOFT, WASH, WHITE, Pdf, Point
from toolkit.printing.page import Rect
from toolkit.rig.camera import orbit_direction
from toolkit.rig.plan import Pose
from toolkit.rig.variants import KIND_OF, NOUNS
from toolkit.rooms.photos.shot_order import ShotStep


@dataclass(frozen=True)
class CameraPlace:
    """A camera's place as a person measures it with a tape and a phone's level.

    Attributes:
        azimuth_deg: round the object from its front, counter-clockwise from above, below 360.
        tilt_deg: of the line of sight, downwards.
        roll_deg: of the plan.
        distance_mm: to the target, the point at the picture's middle.
        height_mm: above the table.
        out_mm: along the table from the object's middle.
        target_height_mm: of the target above the table.
    """

    azimuth_deg: float
    tilt_deg: float
    roll_deg: float
    distance_mm: float
    height_mm: float
    out_mm: float
    target_height_mm: float


def measure_place(pose: Pose) -> CameraPlace:
    """The numbers of a pose, from its `T_world_camera`."""
    T_world_camera = pose.matrix()
    x, y, z = (float(v) for v in T_world_camera[:3, 3])
    out_mm = float(np.hypot(x, y))
    # straight above the object every azimuth is the same place: the plan's is used
    azimuth = np.degrees(np.arctan2(y, x)) if out_mm > 0.01 else pose.azimuth_deg
    target = np.array(pose.target_mm)
    return CameraPlace(
        azimuth_deg=round(float(azimuth), 3) % 360,
        # the third column is the line of sight
        tilt_deg=float(np.degrees(np.arcsin(np.clip(-T_world_camera[2, 2], -1, 1)))), roll_deg=pose.roll_deg,
        distance_mm=float(np.linalg.norm(T_world_camera[:3, 3] - target)), height_mm=z, out_mm=out_mm,
        target_height_mm=float(target[2]),
    )  # fmt: skip


@dataclass(frozen=True)
class Stop:
    """A place of the tour: its number on the tour, its pose, and its shots in the order of shooting."""

    number: int
    pose: Pose
    place: CameraPlace
    shots: tuple[ShotStep, ...]


@dataclass(frozen=True)
class TourLeg:
    """Consecutive shots of a variant at consecutive places."""

    variant: str
    shots: tuple[int, int]
    stops: tuple[int, int]


def find_stops(poses: Sequence[Pose], steps: Sequence[ShotStep]) -> list[Stop]:
    """List the places of an object in the order of the camera's first visit."""
    by_id = {pose.id: pose for pose in poses}
    walk = dict.fromkeys(step.pose_id for step in steps)
    return [
        Stop(number, by_id[id_], measure_place(by_id[id_]), tuple(step for step in steps if step.pose_id == id_))
        for number, id_ in enumerate(walk, 1)
    ]


def find_legs(stops: Sequence[Stop]) -> list[TourLeg]:
    """Split the rounds of an object into legs without a change; a leg also ends with its round."""
    visits = sorted((shot.number, shot.variant, stop.number) for stop in stops for shot in stop.shots)
    starts = [0]
    for i, ((_, variant, stop), (_, next_variant, next_stop)) in enumerate(pairwise(visits), 1):
        if next_variant != variant or next_stop != stop + 1:
            starts.append(i)
    return [
        TourLeg(visits[a][1], (visits[a][0], visits[b - 1][0]), (visits[a][2], visits[b - 1][2]))
        for a, b in pairwise([*starts, len(visits)])
    ]


def goes_round(legs: Sequence[TourLeg], stops: Sequence[Stop]) -> bool:
    """Whether the camera goes round once per variant, with few changes; False if variants alternate."""
    # half before and half after is two legs a variant; alternating variants have a leg a shot
    return len(legs) <= 2 * max(len(stop.shots) for stop in stops)


def name_change(before: str | None, after: str, sheets: int) -> str:
    """Say what to do with an object and its sheets between two legs; empty if nothing changes."""
    if before == after or (before is None and after == "unpatched"):
        return ""
    steps = []
    was_painted, is_painted = (name in KIND_OF and KIND_OF[str(name)].is_painted for name in (before, after))
    # the earlier sheets come off
    if before == "patch-alone":
        steps.append("take the patch away")
    elif before is not None and before != "unpatched" and not was_painted:
        steps.append(f"take the {_name_sheets(before, sheets)} off")
    # the next variant comes on
    if is_painted:
        steps.append(f"put the object as {after.replace('-', ' ')} in its place")
    elif after == "patch-alone":
        steps.append("take the object away, lay the patch flat on the board's middle")
    else:
        steps += ["put the unmodified object back"] if before == "patch-alone" or was_painted else []
        steps += [] if after == "unpatched" else [f"stick the {_name_sheets(after, sheets)} on"]
    return ", ".join(steps)


def _name_sheets(variant: str, sheets: int) -> str:
    name = NOUNS.get(variant, variant.replace("-", " "))
    return name if sheets == 1 else f"{sheets} sheets of the {name}"


SAMPLES = 420
"""Pixels along the longer side of the mask that outlines are traced on."""
FINEST = 1.2
"""Largest distance of a dropped corner from a straight line, in these pixels."""


def trace_outline(mesh: Mesh, right: np.ndarray, up: np.ndarray) -> list[np.ndarray]:
    """Closed outlines (k, 2) of a mesh and its holes, mm along unit vectors `right` and `up` (3,) from the origin."""
    points = mesh.vertices @ np.stack([right, up], axis=1).astype(np.float32)
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    step = max(float(size.max()) / SAMPLES, 1e-6)
    # a rim of two pixels round the outline, and another pixel for rounding
    shape = np.ceil(size / step).astype(int) + 5
    mask = np.zeros((shape[1], shape[0]), np.uint8)
    # OpenCV takes fixed point: 16 parts of a pixel are the 4 bits of fraction below
    pixels = np.round(((points - low) / step + 2) * 16).astype(np.int32)
    for triangle in pixels[mesh.faces]:  # each alone: fillPoly of all at once leaves out where two of them overlap
        cv2.fillConvexPoly(mask, triangle, 255, cv2.LINE_8, 4)
    contours, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    traced = [cv2.approxPolyDP(contour, FINEST, True)[:, 0] for contour in contours]
    return [(outline - 2.0) * step + low for outline in traced if len(outline) >= 3]


FRONT_DEG = -90.0
"""Azimuth 0 points down the page, as FRONT lies at the board's lower edge before the photographer."""


@dataclass(frozen=True)
class Surroundings:
    """Outlines and places of an object for all its drawings, so that they are of the same scale.

    Attributes:
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
        """Largest distance of the object from its middle, along the table."""
        return float(np.hypot(*self.mesh.vertices[:, :2].T).max())


def survey(mesh: Mesh, places: Sequence[CameraPlace]) -> Surroundings:
    """Trace the object from above and from the side of each place."""
    up = np.array([0.0, 0.0, 1.0])
    sides = {
        azimuth: trace_outline(mesh, orbit_direction(azimuth, 0.0), up)
        for azimuth in dict.fromkeys(place.azimuth_deg for place in places)
    }
    # seen from above, the front down the page: right is +y, up is -x
    above = trace_outline(mesh, np.array([0.0, 1.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    return Surroundings(mesh, above, sides, tuple(places))


def page_angle(azimuth_deg: float) -> float:
    """The direction on the page of an azimuth, counter-clockwise from the right."""
    return azimuth_deg + FRONT_DEG


def _towards(angle_deg: float, length: float, centre: Point) -> Point:
    angle = np.radians(angle_deg)
    return centre[0] + length * float(np.cos(angle)), centre[1] + length * float(np.sin(angle))


def draw_from_above(pdf: Pdf, area: Rect, around: Surroundings, place: CameraPlace) -> None:
    """The object, the camera beside it, and the angle between its front and the camera."""
    # the circle of the camera's place, to the scale of the farthest place
    centre = (area.x + area.width / 2, area.y + area.height / 2)
    radius = min(area.width, area.height) / 2 - 4.4
    scale = radius / around.farthest_mm
    pdf.ink(FAINT, 0.18)
    pdf.setDash(0.6, 0.8)
    pdf.circle(*centre, place.out_mm * scale, stroke=1, fill=0)
    pdf.setDash()
    # the object from above, with its front downwards
    pdf.ink(OBJECT)
    pdf.shapes(outline * scale + centre for outline in around.above)
    pdf.ink(SOFT, 0.2)
    pdf.line(*centre, centre[0], centre[1] - radius)
    beside = 6.0 if min(place.azimuth_deg, 360 - place.azimuth_deg) < 25 else 0.0  # the camera stands there
    pdf.write_on_white("front", centre[0] - beside, centre[1] - radius - (0.0 if beside else 1.4), 2.1, colour=SOFT)
    # the camera's direction, and the arc from the front to it
    angle = page_angle(place.azimuth_deg)
    at = _towards(angle, place.out_mm * scale, centre)
    pdf.ink(CAMERA, 0.25)
    pdf.line(*centre, *at)
    arc = max(0.36 * radius, 5.5)
    # at the front there is no angle to draw
    if place.azimuth_deg > 0.5:
        pdf.setLineWidth(0.3)
        pdf.arc_about(centre, arc, FRONT_DEG, place.azimuth_deg)
        pdf.head(_towards(angle, arc, centre), angle + 90 - np.degrees(0.8 / arc), 1.7)
    pdf.camera(at, angle + 180)
    # the number of a narrow angle stands beside the arc, of a wide angle in it
    middle = FRONT_DEG + (place.azimuth_deg / 2 if place.azimuth_deg > 50 else place.azimuth_deg + 42)
    pdf.write_on_white(f"{place.azimuth_deg:.0f}°", *_towards(middle, arc, centre), 3.0, BOLD, CAMERA)


def draw_from_side(pdf: Pdf, area: Rect, around: Surroundings, place: CameraPlace) -> None:
    """The object on the table, the camera on the right of it, and the four numbers of its place."""
    left_mm, right_mm = around.reach_mm, around.farthest_mm
    # room for the dimensions below, above and beside the drawing
    below, above, beside = 5.2, 4.6, 11.0
    # the same scale for all cards of an object, from the farthest and the highest of its places
    scale = min((area.width - beside - 3.5) / (left_mm + right_mm), (area.height - below - above) / around.highest_mm)
    spare = area.width - beside - 3.5 - (left_mm + right_mm) * scale
    x, y = area.x + left_mm * scale + 0.5 + spare / 2, area.y + below  # the object's middle on the table
    # the object from aside, as this azimuth shows it
    pdf.ink(OBJECT)
    pdf.shapes(outline * scale + (x, y) for outline in around.sides[place.azimuth_deg])
    at = (x + place.out_mm * scale, y + place.height_mm * scale)
    target = (x, y + place.target_height_mm * scale)
    end = max(at[0], x + left_mm * scale) + 2.5
    # the table
    pdf.ink(INK, 0.35)
    pdf.line(x - left_mm * scale - 0.5, y, max(end, at[0] + 4.0), y)
    # dashed lines to the dimensions
    pdf.ink(SOFT, 0.15)
    pdf.setDash(0.5, 0.7)
    pdf.line(x, target[1], at[0], target[1])
    pdf.line(x, y, x, y - 3.2)
    pdf.line(at[0], at[1], at[0], y - 3.2)
    pdf.setDash()
    # the camera and its line of sight, with its tilt
    pdf.ink(CAMERA, 0.3)
    pdf.line(*target, *at)
    pdf.camera(at, 180 + place.tilt_deg)
    _mark_tilt(pdf, target, place, scale)
    # height, distance from the middle and length of the line of sight, in centimetres
    upright = at[0] + 2.0
    pdf.dimension((upright, y), (upright, at[1]), "")
    label = f"{place.height_mm / 10:.1f} cm"
    pdf.write(label, upright + 0.9, (y + at[1]) / 2 - 1.0, 2.9, room_mm=12, font=BOLD)
    pdf.dimension((x, y - 2.6), (at[0], y - 2.6), f"{place.out_mm / 10:.1f} cm", 2.9)
    middle = (target[0] + 0.66 * (at[0] - target[0]), target[1] + 0.66 * (at[1] - target[1]))
    pdf.write_on_white(f"{place.distance_mm / 10:.1f} cm", *middle, 2.9, colour=CAMERA)


def _mark_tilt(pdf: Pdf, target: Point, place: CameraPlace, scale: float) -> None:
    """Draw the angle between table and line of sight, at the target."""
    radius = max(0.3 * place.distance_mm * scale, 6.0)
    pdf.ink(CAMERA, 0.25)
    if abs(place.tilt_deg) > 1:
        pdf.arc_about(target, radius, 0, place.tilt_deg)
    where = _towards(place.tilt_deg / 2, radius, target)
    pdf.write_on_white(f"{place.tilt_deg:.0f}°", *where, 2.7, BOLD, CAMERA)


def draw_walk(pdf: Pdf, area: Rect, around: Surroundings, stops: Sequence[Stop]) -> None:
    """Draw the tour from pose to pose, on a map of directions: the middle is straight above the object."""
    from shapely import LineString
    from shapely import Point as Place

    centre = (area.x + area.width / 2, area.y + area.height / 2 + 1.8)
    radius = min(area.width, area.height - 3.6) / 2
    lowest = min(stop.place.tilt_deg for stop in stops)
    # elevation 90° is the middle; the lowest ring leaves room for a place's disc
    per_degree = (radius - 4.6) / max(90 - lowest, 1)
    at = [
        _towards(page_angle(stop.place.azimuth_deg), (90 - stop.place.tilt_deg) * per_degree, centre) for stop in stops
    ]
    apart = [float(np.hypot(a[0] - b[0], a[1] - b[1])) for i, a in enumerate(at) for b in at[:i]]
    # discs of close places shrink, so that they do not cover each other
    size = float(np.clip(0.42 * min(apart, default=9.0), 1.2, 3.1))
    pdf.ink(WASH)
    pdf.circle(*centre, radius, stroke=0, fill=1)
    tilts = sorted({round(stop.place.tilt_deg) for stop in stops})
    # many different elevations are no rings
    tilts = tilts if len(tilts) <= 4 else []
    for tilt in tilts:
        pdf.ink(FAINT, 0.2)
        pdf.circle(*centre, (90 - tilt) * per_degree, stroke=1, fill=0)
    highest = max(stop.place.tilt_deg for stop in stops)
    inner = np.clip((90 - highest) * per_degree - size - 1.5, 0.16 * radius, 0.5 * radius)
    pdf.ink(OBJECT)
    pdf.shapes(outline * (float(inner) / around.reach_mm) + centre for outline in around.above)
    pdf.ink(CAMERA, 0.35)
    for a, b in zip(at, at[1:] + at[:1], strict=True):
        way = np.subtract(b, a)
        length = float(np.hypot(*way))
        # an arrow between discs that touch would be all head
        if length > 2 * size + 0.8:
            unit = way / length * size
            pdf.arrow(tuple(np.add(a, unit)), tuple(np.subtract(b, unit * 1.12)), 1.7)
    # the elevation of each ring, where the walk is farthest; rounded, so that of equals the first counts on any machine
    walk = LineString([*at, at[0]])
    for tilt in tilts:
        spots = [_towards(angle, (90 - tilt) * per_degree, centre) for angle in range(0, 360, 5)]
        where = max(spots, key=lambda spot: round(walk.distance(Place(spot)), 6))
        pdf.write_on_white(f"{tilt}° up", *where, 2.2, colour=SOFT, plate=WASH)
    for stop, (x, y) in zip(stops, at, strict=True):
        first = stop.number == 1
        pdf.setFillColorRGB(*(CAMERA if first else WHITE))
        pdf.setStrokeColorRGB(*CAMERA)
        pdf.setLineWidth(0.35)
        pdf.circle(x, y, size, stroke=1, fill=1)
        pdf.write(str(stop.pose.id), x, y - 0.38 * size, 1.05 * size, room_mm=1.75 * size, font=BOLD, align="centre",
              colour=WHITE if first else CAMERA)  # fmt: skip
    pdf.write("front", centre[0], area.y - 0.6, 2.6, room_mm=20, font=BOLD, align="centre", colour=SOFT)
