"""Is the wrap on the object? Squares of its pieces, looked for where the camera should see them.

A piece may be long, bent round the object, and seen in part. So it is looked for in squares that lie wholly on it. The
map of the piece and the camera's pose give the place of each square.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np

from toolkit.core.text import join_words
from toolkit.objects.atlas import cover_texels
from toolkit.objects.mesh import Mesh, cross_products
from toolkit.objects.wrap import FlatPiece, Wrap
from toolkit.rooms.photos.gates import GateResult
from toolkit.rooms.photos.gates.objects import Solid
from toolkit.rooms.photos.gates.patch import CELLS, VARIANT, PlacedSheet, expect_cells, is_clear
from toolkit.rooms.photos.posed_camera import PosedCamera
from toolkit.rooms.photos.prints.align import FLAT, UNIT_CORNERS, PatchWarp, cell_centres, fit_warp
from toolkit.rooms.photos.prints.find import find_there

LARGEST_SHARE = 0.2
"""Largest side of a square, as a share of the object's longest side; larger squares bend too far."""
SMALLEST_MM = 12.0
MOST_SQUARES = 8
"""Largest number of squares of a piece."""
LEAST_SHOWN = 0.5
"""Share of a square's cells that must face the camera for it to be looked for."""
MOST_LOOKED_AT = 3
"""Largest number of squares of a piece in a photograph."""
LEAST_SQUARES, LEAST_FOUND = 3, 0.25
"""Number of squares that must show to judge the wrap, and share of them that must be found."""
LEAST_OF_PIECE = 2
"""Number of squares of a piece that show, none of them found, from which it counts as missing."""
STIFFNESS = 0.001
"""Stiffness for `fit_warp`; the bend of the surface itself is known."""


@dataclass(frozen=True)
class Square(PlacedSheet):
    """A part of a piece, which `at` names; `pixels` (n, n, 3) uint8 sRGB are printed there."""

    pixels: np.ndarray

    def expect(self, view: PosedCamera) -> PatchWarp | None:
        """Place it in a camera's picture, bent as the surface is; None behind the camera."""
        places = np.concatenate([cell_centres(CELLS), UNIT_CORNERS])
        # a homography by the corners, bent to the cells' pixels
        pixels = view.project(np.concatenate([self.cells_mm, self.corners_mm]))
        if not np.isfinite(pixels).all():
            return None
        corners = pixels[-len(UNIT_CORNERS) :].astype(np.float32)
        flat = cv2.getPerspectiveTransform(UNIT_CORNERS.astype(np.float32), corners).astype(float)
        return fit_warp(places, pixels, PatchWarp(flat, FLAT), STIFFNESS)


@dataclass(frozen=True)
class ExpectedWrap:
    """Name and squares of an object's wrap, and whether it belongs on the object, or may have been left on it."""

    name: str
    is_on: bool
    squares: tuple[Square, ...] = field(repr=False)


@dataclass(frozen=True)
class PiecesSeen:
    """Number of squares that should show, and that were found, by the piece's name."""

    counts: dict[str, tuple[int, int]]

    @property
    def is_judged(self) -> bool:
        """Whether enough of the wrap should show to believe its absence."""
        return sum(shown for shown, _ in self.counts.values()) >= LEAST_SQUARES

    @property
    def is_on(self) -> bool:
        """Whether the wrap is seen on the object."""
        shown, found = (sum(column) for column in zip(*self.counts.values(), strict=True)) if self.counts else (0, 0)
        return self.is_judged and found >= LEAST_FOUND * shown

    @property
    def missing(self) -> list[str]:
        """Pieces of which several squares should show, and none is found."""
        return [name for name, (shown, found) in self.counts.items() if shown >= LEAST_OF_PIECE and found == 0]


def look_for_pieces(image: np.ndarray, wrap: ExpectedWrap, solid: Solid, view: PosedCamera) -> PiecesSeen:
    """Look in (h, w, 3) uint8 sRGB of the view's size for squares that face the camera, unhidden and wide enough."""
    counts: dict[str, tuple[int, int]] = {}
    for square in wrap.squares:  # the largest of a piece first
        shown, found = counts.get(square.at, (0, 0))
        if shown == MOST_LOOKED_AT or not is_clear(square, view):
            continue
        cells, there = expect_cells(square, solid, view), square.expect(view)
        if there is not None and cells is not None and cells.mean() >= LEAST_SHOWN:
            is_found = find_there(image, square.pixels, there) is not None
            counts[square.at] = shown + 1, found + is_found
    return PiecesSeen(counts)


def check_pieces(seen: PiecesSeen, wrap: ExpectedWrap, variant: str) -> GateResult:
    """Count the missing pieces of a wrap that belongs on the object, if enough of it should show."""
    if not seen.is_on:
        missing = f"the wrap '{wrap.name}' is not seen, '{variant}' should show it"
        return VARIANT.judge(1, f"{missing}: stick it on, uncover it, or sort the photo again")
    if not seen.missing:
        return VARIANT.judge(0)
    numbers = join_words(name.removeprefix("piece ") for name in seen.missing)
    which = f"piece {numbers} of the wrap '{wrap.name}' is not seen, '{variant}' should show it"
    return VARIANT.judge(len(seen.missing), f"{which}: stick it on, or uncover it")


def cut_squares(mesh: Mesh, wrap: Wrap, canvas: np.ndarray) -> tuple[Square, ...]:
    """Cut the largest squares out of each piece, side by side, upright on the canvas (n, n, 3) uint8 sRGB, v up."""
    record = wrap.record
    largest_px = LARGEST_SHARE * float(mesh.size_mm.max()) / record.texel_mm
    squares = []
    for piece, at in zip(wrap.pieces, record.pieces, strict=True):
        # texels of the piece; the largest free square is cut out again and again
        uv = (np.array(at.origin_px) + piece.flat_mm / record.texel_mm) / record.n_px
        free = np.pad(cover_texels(uv.astype(np.float32), record.n_px).astype(np.uint8), 1)
        for _ in range(MOST_SQUARES):
            # a texel's chessboard distance from the nearest texel in use: half of the side of the square round it
            reach = np.minimum(cv2.distanceTransform(free, cv2.DIST_C, 3), (largest_px + 1) // 2)
            row, column = np.unravel_index(int(reach.argmax()), reach.shape)
            half = int(reach[row, column]) - 1
            side = 2 * half + 1
            if side * record.texel_mm < SMALLEST_MM:
                break
            free[row - half : row + half + 1, column - half : column + half + 1] = 0
            top, left = int(row) - half - 1, int(column) - half - 1  # less one for the padding
            # cells and corners of the square on the flat piece, then on the object
            corner_mm = (np.array([left, record.n_px - top]) - at.origin_px) * record.texel_mm
            places = corner_mm + np.concatenate([cell_centres(CELLS), UNIT_CORNERS]) * [1, -1] * side * record.texel_mm
            points, outward = _find_on_surface(mesh, piece, places)
            cells, pixels = len(points) - len(UNIT_CORNERS), canvas[top : top + side, left : left + side]
            squares.append(Square(
                f"piece {at.number}", points[:cells], outward[:cells], points[cells:], np.ascontiguousarray(pixels)
            ))  # fmt: skip
    return tuple(squares)


def _find_on_surface(mesh: Mesh, piece: FlatPiece, places_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) points of the object, and its normals there, for places (n, 2) on a flat piece."""
    # edges of each flat triangle, for its barycentric coordinates
    corners = mesh.vertices[mesh.faces[piece.faces]].astype(np.float64)
    sides = piece.flat_mm[:, 1:] - piece.flat_mm[:, :1]
    # triangles without area have no inverse
    solid = np.abs(np.linalg.det(sides)) > 1e-9
    corners, origin, back = corners[solid], piece.flat_mm[solid, 0], np.linalg.inv(sides[solid])
    points, normals = np.zeros((2, len(places_mm), 3))
    for row, place in enumerate(places_mm):
        # barycentric coordinates of the place in every triangle
        second, third = np.einsum("ki,kij->jk", place - origin, back)
        weights = np.stack([1 - second - third, second, third], axis=1)
        best = int(weights.min(axis=1).argmax())  # the triangle that holds the place, or the nearest to it
        points[row] = weights[best] @ corners[best]
        normals[row] = cross_products(corners[best : best + 1])[0]
    return points, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
