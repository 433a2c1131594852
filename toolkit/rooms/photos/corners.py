"""Corners of a board in a picture, to a fraction of a pixel."""

import cv2
import numpy as np

from toolkit.rig.board import CharucoBoard

ANCHORS = 16
"""Known points nearest to a corner, from which it is predicted; so few that a lens's distortion matters little."""
REACH_SQUARES = 3.0
"""A corner is predicted from no farther than this."""
MOST_SHIFT = 0.15
"""How far a corner may lie from its prediction, in squares."""
LEAST_CONTRAST_SHARE = 0.35
LEAST_CONTRAST = 8.0
"""Least contrast of a corner: grey levels from the lighter of its two dark squares to the darker of its two light
squares, and that as a share of the board's usual contrast."""
PASSES = 3
STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)


def grow_corners(
    grey: np.ndarray, board: CharucoBoard, found: dict[int, np.ndarray], markers: dict[int, np.ndarray]
) -> dict[int, np.ndarray]:
    """Add to the `found` corners (2,) by number all others of the board that can be seen near them.

    `grey` is (h, w) uint8; `markers` has the corners (4, 2) of the markers that were read, by number.
    """
    world = board.object_points()[:, :2]
    marker_mm = board.marker_points(sorted(markers))[..., :2].reshape(-1, 2)
    marker_px = np.concatenate([markers[number] for number in sorted(markers)]).reshape(-1, 2)
    corners = dict(found)
    # each pass predicts from the corners of the pass before, so that the known region grows outwards
    for _ in range(PASSES):
        known = sorted(corners)
        anchors_mm = np.concatenate([marker_mm, world[known]])
        anchors_px = np.concatenate([marker_px, np.array([corners[i] for i in known]).reshape(-1, 2)])
        # known corners too: they tell what contrast is usual
        tried = ((i, _see_corner(grey, board, i, anchors_mm, anchors_px)) for i in range(len(world)))
        seen = {i: sight for i, sight in tried if sight is not None}
        if not seen:
            break
        # most corners are true, so the upper quartile is the usual contrast of this photograph's board
        usual = float(np.percentile([contrast for _, contrast in seen.values()], 75))
        limit = max(LEAST_CONTRAST, LEAST_CONTRAST_SHARE * usual)
        new = {i: place for i, (place, contrast) in seen.items() if contrast >= limit and i not in corners}
        corners |= new
        if not new:
            break
    return corners


def _see_corner(
    grey: np.ndarray, board: CharucoBoard, number: int, anchors_mm: np.ndarray, anchors_px: np.ndarray
) -> tuple[np.ndarray, float] | None:
    """Return a corner's place and the contrast of its squares; None if it cannot be predicted or is no crossing."""
    at_mm = board.object_points([number])[0, :2]
    away = np.linalg.norm(anchors_mm - at_mm, axis=1)
    # a homography has no distortion: it is fitted to near anchors alone
    near = np.argsort(away, kind="stable")[:ANCHORS]
    if len(near) < 4 or away[near[0]] > REACH_SQUARES * board.square_mm:
        return None
    homography, _ = cv2.findHomography(anchors_mm[near], anchors_px[near])
    if homography is None:
        return None
    square, gap = board.square_mm, (board.square_mm - board.marker_mm) / 2
    around = np.array([[0, 0], [square, 0], [0, square], [-square, 0], [0, -square]]) + at_mm
    places = cv2.perspectiveTransform(around[None], homography)[0]
    if not np.isfinite(places).all():
        return None
    side = float(np.linalg.norm(places[1:] - places[0], axis=1).min())
    # between the corner and the nearest marker lies the white gap; a window inside of it sees no marker
    window = int(np.clip(0.9 * side * gap / square, 2, 10))
    rim = window + 3
    h, w = grey.shape
    if side < 6 or not (rim <= places[0, 0] < w - rim and rim <= places[0, 1] < h - rim):
        return None
    start = places[:1].astype(np.float32).reshape(1, 1, 2)
    place = cv2.cornerSubPix(grey, start, (window, window), (-1, -1), STOP).reshape(2)
    # `cornerSubPix` walks off to a stronger corner where there is none: what it returns far away is not this corner
    if np.linalg.norm(place - places[0]) > max(MOST_SHIFT * side, 1.0):
        return None
    return place, _contrast(grey, board, number, homography, place - places[0])


def _contrast(grey: np.ndarray, board: CharucoBoard, number: int, homography: np.ndarray, shift: np.ndarray) -> float:
    """Grey levels from the lightest dark square round a corner to its darkest light square."""
    at_mm, gap = board.object_points([number])[0, :2], (board.square_mm - board.marker_mm) / 2
    steps = np.array([(s, t) for s in (0.35, 0.8) for t in (0.35, 0.8)]) * gap
    # by world axes: down the page is +x, to its right +y
    quadrants = np.array([(-1, -1), (1, 1), (-1, 1), (1, -1)])
    points = (quadrants[:, None] * steps[None] + at_mm).reshape(1, -1, 2)
    places = (cv2.perspectiveTransform(points, homography)[0] + shift).astype(np.float32)
    values = cv2.remap(
        grey, places[:, 0].copy(), places[:, 1].copy(), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    means = values.reshape(4, len(steps)).astype(float).mean(axis=1)
    # the square to the upper left of a corner has the corner's own row and column
    starts_black = board.is_black(*divmod(number, board.columns - 1))
    black, white = (means[:2], means[2:]) if starts_black else (means[2:], means[:2])
    return float(white.min() - black.max())


MODULES_IN_REACH = 0.6
"""How far to both sides of a marker's outline its edge is looked for, in modules: white paper and black border are
wider than that."""
ALONG = np.linspace(0.12, 0.88, 24)
"""Places along a side, away from its corners, where blur rounds the outline."""
STEP_PX = 0.25
LEAST_REACH_PX, MOST_REACH_PX = 1.5, 12.0
LINE_ROUNDS = 3
STRAY_PX = 0.3
"""An edge that lies farther from its side's line counts the less."""


def refine_marker(grey: np.ndarray, corners: np.ndarray, modules: int) -> np.ndarray:
    """(4, 2) corners of a marker, see `refine_outline`, which is `modules` wide, its black border included."""
    # the shortest side has the smallest modules; the same reach then fits all four
    shortest = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).min()
    reach = float(np.clip(MODULES_IN_REACH * shortest / modules, LEAST_REACH_PX, MOST_REACH_PX))
    return refine_outline(grey, corners, reach)


def refine_outline(grey: np.ndarray, corners: np.ndarray, reach: float) -> np.ndarray:
    """(4, 2) corners of something dark on something light: where the straight lines through its four sides meet.

    `cv2.cornerSubPix` may drift to a corner of a neighbour or a module. The sides are long and lie alone; AprilTag's
    detector refines in the same way (Wang and Olson, 2016).

    Args:
        grey: (h, w) uint8.
        corners: (4, 2) roughly, clockwise, pixel centres at integers; returned as they are if no outline is seen.
        reach: how far to both sides of the outline its edge is looked for, pixels.
    """
    # the sides from each corner to the next
    corners = np.asarray(corners, float)
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(sides, axis=1)
    # places in pixels along lines across each side, at several points of it
    steps = np.arange(-reach, reach + STEP_PX / 2, STEP_PX)
    # clockwise in an image, so this normal points outwards
    outwards = np.stack([sides[:, 1], -sides[:, 0]], axis=1) / np.maximum(lengths, 1e-9)[:, None]
    places = corners[:, None, None] + ALONG[:, None, None] * sides[:, None, None]
    places = (places + steps[:, None] * outwards[:, None, None]).astype(np.float32)
    flat = np.ascontiguousarray(places.reshape(4 * len(ALONG), len(steps), 2))
    x, y = flat[..., 0].copy(), flat[..., 1].copy()
    light = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(float)
    # outwards it gets lighter; the centroid of the squared rise is the edge
    # squared, so that the steepest place counts and the noise of many small rises does not
    rise = np.diff(light.reshape(4, len(ALONG), len(steps)), axis=2).clip(0) ** 2
    weight = rise.sum(axis=2)
    offset = (rise * (steps[1:] + steps[:-1]) / 2).sum(axis=2) / np.maximum(weight, 1e-9)
    # a side without any rise has no edge to find
    if (weight.sum(axis=1) <= 0).any():
        return corners
    # a line through each side's edge points, as offsets at both of its ends
    ends = np.stack([_fit_line(edge, by) for edge, by in zip(offset, weight, strict=True)])
    starts = corners + ends[:, :1] * outwards
    stops = corners + sides + ends[:, 1:] * outwards
    # corners are where neighbouring lines meet
    return _meet(np.roll(starts, 1, axis=0), np.roll(stops, 1, axis=0), starts, stops, corners)


def _fit_line(offset: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(2,) offsets at both ends of a side, by weighted least squares that trust stray edges less."""
    design = np.stack([1 - ALONG, ALONG], axis=1)
    root = np.sqrt(weight)
    for _ in range(LINE_ROUNDS):
        # Iteratively reweighted least squares. Beyond `STRAY_PX` the weight falls with the square of the distance, so
        # that far edges pull less. Huber's weight has two to five times the error if every eighth edge strays.
        ends = np.linalg.lstsq(design * root[:, None], offset * root, rcond=None)[0]
        stray = np.abs(offset - design @ ends)
        root = np.sqrt(weight) * np.minimum(1, STRAY_PX / np.maximum(stray, 1e-9))
    return ends


def _meet(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    """(4, 2) where the lines a-b and c-d cross; `otherwise` where they are parallel."""
    first, second, gap = b - a, d - c, c - a
    turn = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    if (np.abs(turn) < 1e-9).any():
        return otherwise
    share = (gap[:, 0] * second[:, 1] - gap[:, 1] * second[:, 0]) / turn
    return a + share[:, None] * first
