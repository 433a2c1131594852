"""The first page of a sheet that needs several: how its tiles go together."""

from typing import TYPE_CHECKING

from toolkit.printing.frame import Rect
from toolkit.printing.plan import MapPage
from toolkit.printing.text import BOLD, draw_text
from toolkit.printing.tile_page import DrawSheet
from toolkit.printing.tiling import OVERLAP_MM

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

STEPS = (
    "1  Print every page at 100 % and measure both check bars on each.",
    f"2  Rows: cut a tile's left edge, from long mark to long mark; lay it {OVERLAP_MM:g} mm over its left neighbour.",
    "    Its edge meets the short marks, the ringed crosses lie on each other (hold it against the light). Tape.",
    "3  Cut the upper edge of each finished row and lay it over the row above in the same way. Tape.",
    "4  Cut the whole sheet along its four sides: the long marks at its outer corners, the outline of this map.",
)
LINE_HEIGHT_MM = 4.0


def draw_map(canvas: "Canvas", area: Rect, page: MapPage, draw_sheet: DrawSheet) -> Rect:
    """The whole sheet made small, each tile outlined and named, over the steps to put it together.

    Args:
        canvas: in millimetres.
        area: the page's room for it.
        page: the tiles.
        draw_sheet: draws the sheet at its full size.

    Returns:
        Where on the page the small sheet is.
    """
    sheet_width, sheet_height = (max(getattr(tile.area, end) for tile in page.tiles) for end in ("right", "top"))
    steps_mm = LINE_HEIGHT_MM * len(STEPS) + 4
    small = min((area.width - 8) / sheet_width, (area.height - steps_mm - 14) / sheet_height)
    room = Rect(area.x, area.y + steps_mm + 10, area.width, area.height - steps_mm - 14)
    picture = room.centre(sheet_width * small, sheet_height * small)
    canvas.saveState()
    canvas.translate(picture.x, picture.y)
    canvas.scale(small, small)
    draw_sheet(canvas)
    canvas.restoreState()
    for tile in page.tiles:
        here = tile.area
        box = Rect(picture.x + here.x * small, picture.y + here.y * small, here.width * small, here.height * small)
        _draw_tile(canvas, box, tile.name)
    for line, words in enumerate(STEPS):
        draw_text(canvas, words, area.x + 4, area.y + steps_mm - LINE_HEIGHT_MM * (line + 1), 2.6, area.width - 4)
    return picture


def _draw_tile(canvas: "Canvas", box: Rect, name: str) -> None:
    """Outline in white under black, so that it shows on any colour, and the tile's name on a white plate."""
    for width, grey in ((0.7, 1), (0.25, 0)):
        canvas.setLineWidth(width)
        canvas.setStrokeGray(grey)
        canvas.rect(box.x, box.y, box.width, box.height, stroke=1, fill=0)
    size = min(5.0, box.width / 4, box.height / 3)
    plate = box.centre(size * 2.6, size * 1.5)
    canvas.setFillGray(1)
    canvas.roundRect(plate.x, plate.y, plate.width, plate.height, size * 0.3, stroke=0, fill=1)
    canvas.setFillGray(0)
    draw_text(canvas, name, plate.x + plate.width / 2, plate.y + size * 0.39, size, plate.width * 0.9, BOLD, "centre")
