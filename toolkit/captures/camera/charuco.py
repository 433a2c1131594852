"""Corners of a ChArUco board: those between markers that are read, and from there on those that are only seen.

A corner of the chessboard can be placed where both its markers are hidden, cut or too blurred to be read: it is
predicted from what was found near it, moved to where the edges cross, and kept where the four squares round it are dark
and light as they should be.

Convention: in here pixel centres are at integers, as OpenCV has them.
"""

import cv2
import numpy as np

from toolkit.rig.board import BoardSpec

ANCHORS = 16
"""Known points nearest to a corner, from which it is predicted; so few that a lens's distortion matters little."""
REACH_SQUARES = 3.0
"""A corner is predicted from no farther than this."""
MOST_SHIFT = 0.15
"""How far a corner may lie from its prediction, in squares."""
LEAST_CONTRAST_SHARE = 0.35
LEAST_CONTRAST = 8.0
"""Grey levels between the darker of two light squares and the lighter of two dark ones, and the share of what is usual
on the board, that a corner must have."""
PASSES = 3
STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)


def grow_corners(
    grey: np.ndarray, board: BoardSpec, found: dict[int, np.ndarray], markers: dict[int, np.ndarray]
) -> dict[int, np.ndarray]:
    """Corners (2,) by number: those `found`, and all others of the board that can be seen near them.

    Args:
        grey: (h, w) uint8.
        board: that is in the picture.
        found: corners that are known.
        markers: corners (4, 2) of the markers that were read, by number.
    """
    world = board.object_points()[:, :2]
    marker_mm = board.marker_points(sorted(markers))[..., :2].reshape(-1, 2)
    marker_px = np.concatenate([markers[number] for number in sorted(markers)]).reshape(-1, 2)
    corners = dict(found)
    for _ in range(PASSES):
        known = sorted(corners)
        anchors_mm = np.concatenate([marker_mm, world[known]])
        anchors_px = np.concatenate([marker_px, np.array([corners[i] for i in known]).reshape(-1, 2)])
        tried = {
            i: _see_corner(grey, board, i, world[i], anchors_mm, anchors_px) for i in range(len(world))
        }  # those known before too: they tell what contrast is usual
        seen = {i: one for i, one in tried.items() if one is not None}
        if not seen:
            break
        usual = float(np.percentile([contrast for _, contrast in seen.values()], 75))
        limit = max(LEAST_CONTRAST, LEAST_CONTRAST_SHARE * usual)
        new = {i: place for i, (place, contrast) in seen.items() if contrast >= limit and i not in corners}
        corners |= new
        if not new:
            break
    return corners


def _see_corner(grey, board: BoardSpec, number: int, at_mm, anchors_mm, anchors_px) -> tuple[np.ndarray, float] | None:
    """Where a corner is, and the contrast of its squares; None where it cannot be predicted or is no crossing."""
    away = np.linalg.norm(anchors_mm - at_mm, axis=1)
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
    window = int(np.clip(0.9 * side * gap / square, 2, 10))
    rim = window + 3
    h, w = grey.shape
    if side < 6 or not (rim <= places[0, 0] < w - rim and rim <= places[0, 1] < h - rim):
        return None
    start = places[:1].astype(np.float32).reshape(1, 1, 2)
    place = cv2.cornerSubPix(grey, start, (window, window), (-1, -1), STOP).reshape(2)
    if np.linalg.norm(place - places[0]) > max(MOST_SHIFT * side, 1.0):
        return None
    return place, _contrast(grey, board, number, at_mm, homography, place - places[0])


def _contrast(grey, board: BoardSpec, number: int, at_mm, homography, shift) -> float:
    """Grey levels by which the light squares round a corner are lighter than the dark ones, the worst pair."""
    gap = (board.square_mm - board.marker_mm) / 2
    steps = np.array([(s, t) for s in (0.35, 0.8) for t in (0.35, 0.8)]) * gap
    # by world axes: down the page is +x, to its right +y
    quadrants = np.array([(-1, -1), (1, 1), (-1, 1), (1, -1)])
    points = (quadrants[:, None] * steps[None] + at_mm).reshape(1, -1, 2)
    places = (cv2.perspectiveTransform(points, homography)[0] + shift).astype(np.float32)
    values = cv2.remap(
        grey, places[:, 0].copy(), places[:, 1].copy(), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    means = values.reshape(4, len(steps)).astype(float).mean(axis=1)
    row, column = divmod(number, board.columns - 1)
    # the square to the upper left of a corner is black where row and column are both even or both odd
    black, white = (means[:2], means[2:]) if (row + column) % 2 == 0 else (means[2:], means[:2])
    return float(white.min() - black.max())
