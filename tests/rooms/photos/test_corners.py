"""Corners of an outline, where the lines through its sides meet."""

import cv2
import numpy as np

from toolkit.rooms.photos.corners import refine_outline

CORNERS = np.array([[40.3, 42.6], [158.9, 48.2], [151.7, 160.4], [36.1, 150.8]])


def draw_square(scale: int = 16) -> np.ndarray:
    """(200, 200) uint8: a dark quadrangle on white, its edge a soft step as a camera sees it."""
    grey = np.full((200 * scale, 200 * scale), 230, np.uint8)
    # pixel centres at integers
    cv2.fillPoly(grey, [np.round((CORNERS + 0.5) * scale - 0.5).astype(np.int32)], 20)
    return cv2.GaussianBlur(cv2.resize(grey, (200, 200), interpolation=cv2.INTER_AREA), (0, 0), 0.8)


def test_a_corner_is_found_to_a_twentieth_of_a_pixel():
    rough = CORNERS + np.random.default_rng(0).uniform(-1, 1, (4, 2))
    assert np.abs(refine_outline(draw_square(), rough, 4) - CORNERS).max() < 0.05


def test_something_that_lies_over_a_twelfth_of_a_side_does_not_pull_the_corner_along():
    """There the edge lies four pixels farther out. With Huber's weights the corner is 1.3 pixels off."""
    grey = draw_square()
    cv2.rectangle(grey, (60, 40), (68, 52), 20, -1)
    assert np.abs(refine_outline(grey, CORNERS, 5) - CORNERS).max() < 0.2
