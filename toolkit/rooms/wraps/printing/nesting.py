"""Shapes nested into each other on as few pages as can be, and their outlines as files for cutting machines."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import StringIO
from typing import TYPE_CHECKING

import numpy as np

from toolkit.core.lazy import scipy, shapely
from toolkit.printing.page import Rect

if TYPE_CHECKING:
    from shapely import Polygon


CELL_MM = 1.0
TOUCHED_MM = 0.75 * CELL_MM
"""A cell that a shape touches has its middle within half a diagonal, 0.71 cells, of it."""


@dataclass(frozen=True)
class Nested:
    """A shape on a page.

    Attributes:
        index: which of the shapes.
        x_mm, y_mm: place of the shape's origin on the page.
        quarters: turns by 90 degrees about it, counter-clockwise.
    """

    index: int
    x_mm: float
    y_mm: float
    quarters: int


@dataclass(frozen=True)
class _Mask:
    """A turned shape on a grid: cells (rows upwards, columns) that it touches, and the place of its box's corner."""

    cells: np.ndarray
    low_mm: tuple[float, float]
    quarters: int


def fits(shape: "Polygon", room: Rect) -> bool:
    """Whether a shape's box fits on a page, turned or not."""
    # sorted: a shape that fits when turned is tried turned
    sides, page = sorted(_count_cells(shape)), sorted((int(room.height / CELL_MM), int(room.width / CELL_MM)))
    return sides[0] <= page[0] and sides[1] <= page[1]


def _count_cells(shape: "Polygon") -> tuple[int, int]:
    """Rows and columns of a shape's box."""
    left, low, right, high = shape.bounds
    return int(np.ceil((high - low) / CELL_MM)), int(np.ceil((right - left) / CELL_MM))


def nest(shapes: "Sequence[Polygon]", room: Rect) -> list[list[Nested]]:
    """Place shapes on pages, each turned by quarters; each `fits` on a page.

    Larger shapes come first, at the topmost, then leftmost free place of the first page with room (bottom-left fill:
    Chazelle 1983; Burke et al. 2006). The best of several orders is taken.
    """
    masks = [list(_draw_turns(shape)) for shape in shapes]
    boxes = np.array([np.subtract(shape.bounds[2:], shape.bounds[:2]) for shape in shapes])
    area = np.array([shape.area for shape in shapes])
    # no order is best for all sets: four usual ones are tried, and the best result is taken
    orders = (-boxes.max(axis=1), -area, -boxes.prod(axis=1), -boxes.min(axis=1))
    # stable, so that equal shapes keep their order and the pages are the same on every machine
    found = [_fill(masks, np.argsort(order, kind="stable"), room) for order in orders]
    # fewest pages, then the least use of the last page: the rest of it stays whole
    return min(found, key=lambda packing: (len(packing[0]), packing[1]))[0]


def _draw_turns(shape: "Polygon") -> Iterator[_Mask]:
    """Turn the shape by each quarter."""
    # fattened, so that every cell that the shape touches counts as taken
    fat = shape.buffer(TOUCHED_MM, quad_segs=4)
    low_x, low_y, _, _ = shape.bounds
    rows, columns = _count_cells(shape)
    x, y = np.meshgrid(low_x + (np.arange(columns) + 0.5) * CELL_MM, low_y + (np.arange(rows) + 0.5) * CELL_MM)
    shapely.prepare(fat)
    cells = shapely.contains_xy(fat, x, y)
    for quarters in range(4):
        turned = np.rot90(cells, -quarters)  # rows run upwards, so that NumPy's turn is the other way round
        # the corner that is lowest and leftmost after the turn; the grid may reach beyond the shape's far sides
        right, top = low_x + columns * CELL_MM, low_y + rows * CELL_MM
        low = ((low_x, low_y), (-top, low_x), (-right, -top), (low_y, -right))[quarters]
        yield _Mask(turned, low, quarters)


def _fill(
    masks: Sequence[Sequence[_Mask]], order: Sequence[int] | np.ndarray, room: Rect
) -> tuple[list[list[Nested]], int]:
    """Return pages of shapes in this order, and the number of rows of the last page in use."""
    rows, columns = int(room.height / CELL_MM), int(room.width / CELL_MM)
    taken: list[np.ndarray] = []
    pages: list[list[Nested]] = []
    for index in np.asarray(order).tolist():
        for number in range(len(taken) + 1):
            # the page after the last is empty, and every shape `fits` there
            if number == len(taken):
                taken.append(np.zeros((rows, columns), bool))
                pages.append([])
            spots = [(*spot, mask) for mask in masks[index] if (spot := _find_spot(taken[number], mask.cells))]
            if spots:
                # the turn that reaches least far down
                row, column, mask = min(spots, key=lambda spot: (spot[0] + len(spot[2].cells), spot[1], spot[0]))
                break
        height, width = mask.cells.shape
        taken[number][row : row + height, column : column + width] |= mask.cells[::-1]
        x, y = room.x + column * CELL_MM, room.top - (row + height) * CELL_MM
        pages[number].append(Nested(index, x - mask.low_mm[0], y - mask.low_mm[1], mask.quarters))
    return pages, int(taken[-1].any(axis=1).sum())


def _find_spot(taken: np.ndarray, cells: np.ndarray) -> tuple[int, int] | None:
    """Return row from the top and column of the topmost, then leftmost place of a page where no cell is taken."""
    if cells.shape[0] > taken.shape[0] or cells.shape[1] > taken.shape[1]:
        return None
    # correlation; the page's rows run downwards, the shape's upwards, so that a single flip is left
    shared = scipy.signal.fftconvolve(taken.astype(np.float32), cells[:, ::-1].astype(np.float32), mode="valid")
    # the sums are whole numbers but for the transform's rounding
    free = np.flatnonzero(shared < 0.5)
    if not len(free):
        return None
    row, column = divmod(int(free[0]), shared.shape[1])
    return row, column


@dataclass(frozen=True)
class CutSheet:
    """The outlines of a sheet.

    Attributes:
        width_mm, height_mm: size of the sheet.
        rings_mm: by number of a piece, its closed rings (k, 2), the outer ring first, from the sheet's lower left.
    """

    width_mm: float
    height_mm: float
    rings_mm: dict[int, list[np.ndarray]]


def write_svg(sheet: CutSheet, layer: str) -> bytes:
    """An SVG of the sheet's size; a path for each piece, called `piece-NUMBER`, in a group of the layer's name."""
    width, height = f"{sheet.width_mm:g}", f"{sheet.height_mm:g}"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="0 0 {width} {height}">',
        f'<g id="{layer}" fill="none" stroke="#f0f" stroke-width="0.09">',
    ]
    for number, rings in sheet.rings_mm.items():
        # SVG counts downwards
        # the last point of a ring repeats the first: the path closes itself
        turns = (" L".join(f"{x:.4f},{sheet.height_mm - y:.4f}" for x, y in ring[:-1].tolist()) for ring in rings)
        lines.append(f'<path id="piece-{number}" d="{" ".join(f"M{turn} Z" for turn in turns)}"/>')
    return "\n".join([*lines, "</g>", "</svg>", ""]).encode()


def write_dxf(sheet: CutSheet, layer: str) -> bytes:
    """A DXF (R2010) in millimetres: closed polylines on the layer, those of a piece in a group `piece-NUMBER`."""
    import ezdxf
    from ezdxf import units

    ezdxf.options.write_fixed_meta_data_for_testing = True  # else it writes the time of day and a random number
    document = ezdxf.new("R2010", units=units.MM)
    document.layers.add(layer, color=6)
    space = document.modelspace()
    for number, rings in sheet.rings_mm.items():
        lines = [space.add_lwpolyline(ring[:-1].tolist(), close=True, dxfattribs={"layer": layer}) for ring in rings]
        document.groups.new(f"piece-{number}").extend(lines)
    text = StringIO()
    document.write(text)
    return text.getvalue().encode()
