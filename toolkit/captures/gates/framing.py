"""Is the object in the photograph, whole, where it should be, and in the part that a classifier looks at?"""

import numpy as np

from toolkit.captures.camera.board_pose import BoardSighting
from toolkit.captures.gates.result import Gate, GateResult
from toolkit.captures.gates.solid import Solid, View
from toolkit.rig.board import BoardSpec, RingSpec

CUT_OFF = Gate(
    "cut off", 2.0, "% of the object", "the object reaches over the picture's edge: step back, or aim at its middle"
)
"""2 %: a classifier does not miss the tip of an aerial. The silhouette that a board and a mesh predict is about as
sure: 5 mm that a 270 mm object stands beside the board's middle are 2 % of it."""
CROP_SHARE = 0.875
"""Classifiers look at the middle square of a photograph, 224 of 256 pixels of its shorter side."""
OFF_CENTRE = Gate(
    "off centre", 10.0, "% of the object",
    "a part of the object lies outside the middle square that classifiers look at: aim at its middle, or step back",
)  # fmt: skip
"""10 %: at the plan's fill (80 % of the shorter side) an aim that is 3 % of the frame off loses nothing yet; from a
tenth of the object on, what is lost can be what it was recognised by, and a pair is no longer compared on the same
part."""
MISSING = Gate(
    "object missing", 25.0, "% of the board's corners that it should hide",
    "the board is seen where the object should stand: put the object on the board's middle, its front to FRONT",
)  # fmt: skip
"""25 %: with the object in place none is seen, and 12 % at most where it stands 14 mm and 6° beside its place.
Without it all are seen."""
PLACE_SLACK_MM = 10.0
"""A corner counts as hidden where it stays hidden if the object is moved by so much."""
LEAST_HIDDEN = 4


def measure_outside(pixels: np.ndarray, low: tuple[float, float], high: tuple[float, float]) -> float:
    """Share in % of points (n, 2) that lie outside a rectangle given by two corners; NaN counts as outside."""
    inside = ((pixels >= low) & (pixels < high)).all(axis=1)
    return 100.0 * float((~inside).mean())


def check_cut_off(silhouette: np.ndarray, size: tuple[int, int]) -> GateResult:
    """Share of the object's silhouette outside the frame.

    Args:
        silhouette: (n, 2) pixels, from `silhouette_px`.
        size: (width, height) of the photograph.
    """
    if len(silhouette) == 0:
        return CUT_OFF.judge(100.0, "the object is behind the camera: check that the board lies under the object")
    return CUT_OFF.judge(measure_outside(silhouette, (0, 0), size))


def check_centred(silhouette: np.ndarray, size: tuple[int, int]) -> GateResult:
    """Share of the object's silhouette outside the middle square that classifiers see; arguments as above."""
    side = CROP_SHARE * min(size)
    low = ((size[0] - side) / 2, (size[1] - side) / 2)
    return OFF_CENTRE.judge(measure_outside(silhouette, low, (low[0] + side, low[1] + side)))


def check_there(
    solid: Solid, view: View, board: BoardSpec | RingSpec, sighting: BoardSighting
) -> GateResult:  # fmt: skip
    """Share of the board's corners behind the object that are seen all the same.

    Args:
        solid: the object in its place.
        view: of the photograph.
        board: that it stands on.
        sighting: of it, in pixels of the same photograph.
    """
    hidden = find_hidden_corners(solid, view, board)
    if len(hidden) < LEAST_HIDDEN:
        return MISSING.skip("from here the object hides too little of the board to tell")
    seen = np.isin(hidden, sighting.ids)
    return MISSING.judge(100.0 * float(seen.mean()))


def find_hidden_corners(solid: Solid, view: View, board: BoardSpec | RingSpec) -> np.ndarray:
    """(k,) numbers of the board's corners that are in the frame and behind the object, safely so."""
    points = board.object_points()
    pixels = view.lens.project(view.T_world_camera, points)
    framed = ((pixels >= 0) & (pixels < (view.lens.width, view.lens.height))).all(axis=1)
    hidden = framed
    for x, y in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
        hidden = hidden & solid.hides(view, points + PLACE_SLACK_MM * np.array([x, y, 0.0]))
    return np.flatnonzero(hidden)
