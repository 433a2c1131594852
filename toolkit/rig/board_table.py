"""The printed board on the studio's table, for pictures of a scene as a session photographs it."""

from dataclasses import replace

import cv2
import numpy as np

from toolkit.colour import linear_to_srgb, srgb_to_linear
from toolkit.rig.board import Sheet
from toolkit.rig.studio import Studio

INK, PAPER = 28, 236
"""sRGB of a laser printer's black and of office paper."""
PAPER_EDGE_MM = 9.0
"""White paper round the board."""
FINE_PX_PER_MM = 3.0
MOST_PX = 4200
"""Longer side of the table's picture at most: it is kept in float while a scene is shot."""


def lay_board(studio: Studio, board: Sheet, px_per_mm: float | None = None) -> Studio:
    """The same studio with a board in the middle of its table, its edge marked FRONT to +x, its right to +y.

    Args:
        studio: whose table is large enough for the board.
        board: as it was printed.
        px_per_mm: of the table's picture; by default as fine as the markers need and the memory allows.
    """
    wide_mm, high_mm = studio.table_mm
    fine = px_per_mm or min(FINE_PX_PER_MM, MOST_PX / max(wide_mm, high_mm))
    page = np.pad(board.paint(fine), round(PAPER_EDGE_MM * fine), constant_values=255)
    sheet = np.rot90(page)  # rows run down the page, which is +x; in the table's picture x runs right and y up
    # an even margin on both sides keeps the sheet's middle in the picture's
    wide, high = (
        side + 2 * max(0, round((mm * fine - side) / 2))
        for mm, side in zip(studio.table_mm, sheet.shape[::-1], strict=True)
    )
    table = cv2.resize(studio.table, (wide, high), interpolation=cv2.INTER_CUBIC)
    ink, paper = srgb_to_linear(np.array([INK, PAPER]) / 255)
    shades = np.round(linear_to_srgb(ink + srgb_to_linear(np.arange(256) / 255) * (paper - ink)) * 255).astype(np.uint8)
    top, left = (high - sheet.shape[0]) // 2, (wide - sheet.shape[1]) // 2
    table[top : top + sheet.shape[0], left : left + sheet.shape[1]] = shades[sheet][..., None]
    return replace(studio, name=f"{studio.name}/board", table=table, table_mm=(wide / fine, high / fine))
