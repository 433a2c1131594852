"""The list's pages: the first page of each object, then its cards."""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

from toolkit import __version__
from toolkit.console import Ticker
from toolkit.printing.canvas import POINTS_PER_MM, describe_document, open_canvas
from toolkit.printing.frame import Rect
from toolkit.printing.paper import Paper
from toolkit.printing.shot_list.card import draw_band, draw_card
from toolkit.printing.shot_list.drawings import FAINT, INK, SOFT, set_ink, write
from toolkit.printing.shot_list.first_page import draw_first_page
from toolkit.printing.shot_list.places import Stop, find_stretches, goes_round, name_change
from toolkit.printing.shot_list.session import ObjectSession
from toolkit.printing.text import BOLD, register_fonts

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

MARGIN_MM = 10.0
HEADER_MM = 13.0
FOOTER_MM = 6.0
BAND_MM = 6.4
LEAST_CARD_MM = 36.0
"""Lower cards have pictures too small to aim by."""
HASH_DIGITS = 12


@dataclass(frozen=True)
class CardsPage:
    """Some stops of an object, and the words of the band that follows each, empty for none."""

    stops: tuple[Stop, ...]
    bands: tuple[str, ...]


def build_shot_list(
    sessions: Sequence[ObjectSession], paper: Paper, seed: int, order: str, bar: Ticker
) -> tuple[bytes, int]:
    """The PDF of a whole session and its number of pages; the same arguments give the same bytes.

    Args:
        sessions: of the objects, in the order of shooting.
        paper: taken upright.
        seed, order: what the order of the shots follows from, for the footer.
        bar: counts one per object.
    """
    register_fonts()
    paper = paper.turn("portrait")
    buffer = BytesIO()
    canvas = open_canvas(buffer, paper)
    names = ", ".join(session.item.name for session in sessions)
    plans: dict[str, object] = {f"plan_{session.item.name}": session.poses_sha256 for session in sessions}
    describe_document(canvas, f"Shot list: {names}", f"order {order}, seed {seed}", plans)
    area = Rect(
        MARGIN_MM, MARGIN_MM + FOOTER_MM, paper.width_mm - 2 * MARGIN_MM,
        paper.height_mm - 2 * MARGIN_MM - FOOTER_MM - HEADER_MM,
    )  # fmt: skip
    layouts = [lay_out_cards(session.stops, area.height) for session in sessions]
    total = sum(1 + len(pages) for pages in layouts)
    number = 0
    for session, pages in zip(sessions, layouts, strict=True):
        for index, page in enumerate([None, *pages], 1):
            number += 1
            canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
            _draw_header(canvas, area, session, page)
            _draw_footer(canvas, area, session, f"page {index} of {1 + len(pages)}", f"{number}/{total}", seed, order)
            if page is None:
                canvas.bookmarkPage(session.item.name)
                canvas.addOutlineEntry(session.item.name, session.item.name)
                draw_first_page(canvas, area, session)
            else:
                _draw_cards(canvas, area, session, page)
            canvas.showPage()
        bar.advance(note=f"{session.item.name}: pages")
    canvas.save()
    return buffer.getvalue(), total


def count_cards(height_mm: float) -> int:
    """How many cards a page holds."""
    return max(1, int((height_mm - BAND_MM) // LEAST_CARD_MM))


def lay_out_cards(stops: Sequence[Stop], height_mm: float) -> list[CardsPage]:
    """Spread the places of one object over pages."""
    many = count_cards(height_mm)
    bands = name_bands(stops)
    return [
        CardsPage(tuple(stops[i : i + many]), tuple(bands[i : i + many])) for i in range(0, len(stops), many)
    ]  # fmt: skip


def name_bands(stops: Sequence[Stop]) -> list[str]:
    """What happens after each place: the sheet's changes there and the end of a round; empty where one just goes on."""
    words: list[list[str]] = [[] for _ in stops]
    stretches = find_stretches(stops)
    if not goes_round(stretches, stops):
        return ["" for _ in stops]
    for before, after in zip(stretches, [*stretches[1:], None], strict=True):
        change = name_change(before.variant, after.variant if after else "unpatched")
        onward = ""
        if after is not None and after.stops[0] != before.stops[1] + 1:
            onward = f"go on with place {after.stops[0]}"
        if after is None:
            onward = "done"
        told = ", ".join(part for part in (change, onward) if part)
        if told:
            words[before.stops[1] - 1].append(f"after shot {before.shots[1]}: {told}")
    return ["   ·   ".join(parts) for parts in words]


def _draw_cards(canvas: "Canvas", area: Rect, session: ObjectSession, page: CardsPage) -> None:
    most_bands = max(sum(map(bool, other.bands)) for other in lay_out_cards(session.stops, area.height))
    height = (area.height - most_bands * BAND_MM) / count_cards(area.height)
    rounds = goes_round(find_stretches(session.stops), session.stops)
    aspect = session.camera.width / session.camera.height
    top = area.top
    for stop, band in zip(page.stops, page.bands, strict=True):
        card = Rect(area.x, top - height, area.width, height)
        draw_card(
            canvas, card, stop, session.views, aspect, session.around, rounds, stop is page.stops[-1] or bool(band)
        )
        top -= height
        if band:
            draw_band(canvas, Rect(area.x, top - BAND_MM, area.width, BAND_MM), band)
            top -= BAND_MM


def _draw_header(canvas: "Canvas", area: Rect, session: ObjectSession, page: CardsPage | None) -> None:
    top = area.top + HEADER_MM
    name = session.item.name
    taken = write(canvas, name, area.x, top - 6.2, 7.0, 0.55 * area.width, BOLD)
    label = str(session.item.spec.class_name)
    if page is None:
        words = f"class {label}" if label != name else ""
        right = "shot list"
    else:
        first, last = page.stops[0].number, page.stops[-1].number
        words = ""
        right = f"places {first}-{last} of {len(session.stops)}" if first != last else f"place {first}"
    write(canvas, words, area.x + taken + 3, top - 6.2, 3.2, 0.3 * area.width, colour=SOFT)
    write(canvas, right, area.right, top - 6.2, 4.2, 0.4 * area.width, BOLD, "right")
    set_ink(canvas, INK, 0.5)
    canvas.line(area.x, top - 9.2, area.right, top - 9.2)


def _draw_footer(
    canvas: "Canvas", area: Rect, session: ObjectSession, page: str, whole: str, seed: int, order: str
) -> None:
    y = area.y - FOOTER_MM
    set_ink(canvas, FAINT, 0.2)
    canvas.line(area.x, y + 3.6, area.right, y + 3.6)
    left = f"{session.item.name}, {page}   ·   plan {session.poses_sha256[:HASH_DIGITS]}"
    right = f"order {order}, seed {seed}   ·   toolkit {__version__}   ·   {whole}"
    write(canvas, left, area.x, y, 2.4, 0.55 * area.width, colour=SOFT)
    write(canvas, right, area.right, y, 2.4, 0.44 * area.width, align="right", colour=SOFT)
