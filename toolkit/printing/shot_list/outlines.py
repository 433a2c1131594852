"""Outlines of a mesh as seen straight along a direction."""

import cv2
import numpy as np

from toolkit.objects.mesh import Mesh

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
