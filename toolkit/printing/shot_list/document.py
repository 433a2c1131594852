"""The list's pages: the first page of each object, its further sheets, then a card for every camera place."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

from toolkit import __version__
from toolkit.core.console import Ticker
from toolkit.printing.canvas import BOLD, POINTS_PER_MM, describe_document, open_canvas, register_fonts
from toolkit.printing.page import Paper, Rect
from toolkit.printing.shot_list.drawings import (
    CAMERA,
    FAINT,
    INK,
    SHEET,
    SOFT,
    TICK_MM,
    WHITE,
    draw_panel,
    draw_tick_box,
    fit_grid,
    place_picture,
    set_ink,
    write,
)
from toolkit.printing.shot_list.first_page import SHEETS_A_PAGE, draw_first_page, draw_sheets_page
from toolkit.printing.shot_list.mounting import MountDrawing
from toolkit.printing.shot_list.places import Stop, find_stretches, goes_round, name_change
from toolkit.printing.shot_list.session import ObjectSession, Surroundings, draw_from_above, draw_from_side

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

Views = Mapping[tuple[str, int], bytes]
"""JPEGs by (variant, pose id)."""
NUMBER_MM = 14.0
ABOVE_MM = 35.0
NOTES_MM = 5.5
PAD_MM = 1.6
CAPTION_MM = 5.2


def draw_card(
    canvas: "Canvas", area: Rect, stop: Stop, views: Views, aspect: float,
    around: Surroundings, rounds: bool, last: bool,
) -> None:  # fmt: skip
    """Draw one place into its area.

    Args:
        canvas: in millimetres.
        area: of the card.
        stop: the place and its shots.
        views: JPEGs by (variant, pose id).
        aspect: width over height of the pictures.
        around: what the object's drawings share.
        rounds: name the round of each shot, for orders in which the camera goes round once per variant.
        last: no line below it.
    """
    if not last:
        set_ink(canvas, FAINT, 0.2)
        canvas.line(area.x, area.y, area.right, area.y)
    inside = Rect(area.x, area.y + PAD_MM, area.width, area.height - 2 * PAD_MM)
    _draw_number(canvas, inside, stop)
    side_mm = min(0.285 * area.width, 56.0)
    pictures = Rect(
        inside.x + NUMBER_MM, inside.y, inside.width - NUMBER_MM - ABOVE_MM - side_mm - 2, inside.height
    )  # fmt: skip
    _draw_pictures(canvas, pictures, stop, views, aspect, rounds=rounds)
    drawn = inside.height - NOTES_MM
    draw_from_above(canvas, Rect(pictures.right + 2, inside.top - drawn, ABOVE_MM, drawn), around, stop.place)
    draw_from_side(canvas, Rect(area.right - side_mm, inside.top - drawn, side_mm, drawn), around, stop.place)
    taken = write(canvas, "notes", pictures.right + 3, inside.y + 1.0, 2.3, room_mm=12, colour=SOFT)
    set_ink(canvas, FAINT, 0.2)
    canvas.line(pictures.right + 4.5 + taken, inside.y + 0.6, area.right, inside.y + 0.6)


def _draw_number(canvas: "Canvas", inside: Rect, stop: Stop) -> None:
    middle = inside.x + NUMBER_MM / 2 - 1.0
    write(canvas, "place", middle, inside.top - 3.2, 2.3, room_mm=NUMBER_MM, align="centre", colour=SOFT)
    write(
        canvas,
        str(stop.number),
        middle,
        inside.top - 12.0,
        9.5,
        room_mm=NUMBER_MM - 2.5,
        font=BOLD,
        align="centre",
        colour=INK,
    )
    write(canvas, f"pose {stop.pose.id}", middle, inside.top - 16.6, 2.7, room_mm=NUMBER_MM - 2, align="centre")
    if abs(stop.place.roll_deg) > 0.05:
        words = f"roll {stop.place.roll_deg:+.0f}°"
        write(canvas, words, middle, inside.top - 20.6, 2.5, room_mm=NUMBER_MM - 2, align="centre", colour=CAMERA)


def _draw_pictures(canvas: "Canvas", room: Rect, stop: Stop, views: Views, aspect: float, rounds: bool) -> None:
    """A picture per variant, always in the same places; under each its tick box and the number of its shot."""
    shots = {shot.variant: (turn, shot) for turn, shot in enumerate(stop.shots, 1)}
    order = sorted(shots, key=lambda variant: (variant != "unpatched", variant))
    cells = fit_grid(len(order), (room.width, room.height), aspect, 2.0, CAPTION_MM)
    if len(order) == 1:  # one picture keeps the size that it has beside another
        cells = fit_grid(2, (room.width, room.height), aspect, 2.0, CAPTION_MM)[:1]
    for variant, cell in zip(order, cells, strict=True):
        turn, shot = shots[variant]
        picture = Rect(room.x + cell.x, room.top + cell.y, cell.width, cell.height)
        place_picture(canvas, views[variant, stop.pose.id], picture)
        _draw_cross(canvas, picture)
        row = picture.y - CAPTION_MM + 0.7
        draw_tick_box(canvas, picture.x, row)
        text = picture.x + TICK_MM + 1.2
        colour = INK if variant == "unpatched" else SHEET
        words = f"shot {shot.number}" + (f", round {turn}" if rounds and 1 < len(stop.shots) < 3 else "")
        taken = write(canvas, words, picture.right, row + 0.8, 2.4, room_mm=0.6 * picture.width, align="right")
        write(canvas, variant, text, row + 0.8, 2.7, room_mm=picture.right - text - taken - 1, font=BOLD, colour=colour)


def _draw_cross(canvas: "Canvas", picture: Rect) -> None:
    """A small cross at the picture's middle, to aim with: white under dark, so that it shows on both."""
    x, y = picture.x + picture.width / 2, picture.y + picture.height / 2
    for colour, line in ((WHITE, 0.45), (INK, 0.15)):
        set_ink(canvas, colour, line)
        canvas.line(x - 1.3, y, x + 1.3, y)
        canvas.line(x, y - 1.3, x, y + 1.3)


def draw_band(canvas: "Canvas", area: Rect, words: str) -> None:
    """A line between two cards that says what changes there, and in which round."""
    draw_panel(canvas, Rect(area.x, area.y + 0.6, area.width, area.height - 1.2), (0.985, 0.925, 0.895))
    x, y = area.x + area.width / 2, area.y + area.height / 2 - 1.0
    write(canvas, words, x, y, 2.8, room_mm=area.width - 6, font=BOLD, align="centre", colour=SHEET)


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
    layouts = [lay_out_pages(session, area.height) for session in sessions]
    total = sum(map(len, layouts))
    number = 0
    for session, pages in zip(sessions, layouts, strict=True):
        for index, page in enumerate(pages, 1):
            number += 1
            canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
            _draw_header(canvas, area, session, page)
            _draw_footer(
                canvas, area, session, f"page {index} of {len(pages)}", f"{number}/{total}", seed=seed, order=order
            )
            if index == 1:
                canvas.bookmarkPage(session.item.name)
                canvas.addOutlineEntry(session.item.name, session.item.name)
                draw_first_page(canvas, area, session)
            elif isinstance(page, CardsPage):
                _draw_cards(canvas, area, session, page)
            else:
                draw_sheets_page(canvas, area, session, page)
            canvas.showPage()
        bar.advance(note=f"{session.item.name}: pages")
    canvas.save()
    return buffer.getvalue(), total


def count_cards(height_mm: float) -> int:
    """How many cards a page holds."""
    return max(1, int((height_mm - BAND_MM) // LEAST_CARD_MM))


def lay_out_pages(session: ObjectSession, height_mm: float) -> list[CardsPage | Sequence[MountDrawing]]:
    """The pages of one object: the first one, with its first sheet, then the other sheets, then its places."""
    more = session.mountings[1:]
    sheets = [more[i : i + SHEETS_A_PAGE] for i in range(0, len(more), SHEETS_A_PAGE)]
    return [session.mountings[:1], *sheets, *lay_out_cards(session, height_mm)]


def lay_out_cards(session: ObjectSession, height_mm: float) -> list[CardsPage]:
    """Spread the places of one object over pages."""
    many, stops = count_cards(height_mm), session.stops
    bands = name_bands(stops, session.sheets)
    return [
        CardsPage(tuple(stops[i : i + many]), tuple(bands[i : i + many])) for i in range(0, len(stops), many)
    ]  # fmt: skip


def name_bands(stops: Sequence[Stop], sheets: int) -> list[str]:
    """What happens after each place: the sheet's changes there and the end of a round; empty where one just goes on."""
    words: list[list[str]] = [[] for _ in stops]
    stretches = find_stretches(stops)
    if not goes_round(stretches, stops):
        return ["" for _ in stops]
    for before, after in zip(stretches, [*stretches[1:], None], strict=True):
        change = name_change(before.variant, after.variant if after else "unpatched", sheets)
        onward = ""
        if after is not None and after.stops[0] != before.stops[1] + 1:
            onward = f"go on with place {after.stops[0]}"
        if after is None:
            onward = "done"
        next_steps = ", ".join(part for part in (change, onward) if part)
        if next_steps:
            words[before.stops[1] - 1].append(f"after shot {before.shots[1]}: {next_steps}")
    return ["   ·   ".join(parts) for parts in words]


def _draw_cards(canvas: "Canvas", area: Rect, session: ObjectSession, page: CardsPage) -> None:
    most_bands = max(sum(map(bool, other.bands)) for other in lay_out_cards(session, area.height))
    height = (area.height - most_bands * BAND_MM) / count_cards(area.height)
    rounds = goes_round(find_stretches(session.stops), session.stops)
    aspect = session.camera.width / session.camera.height
    top = area.top
    for stop, band in zip(page.stops, page.bands, strict=True):
        card = Rect(area.x, top - height, area.width, height)
        draw_card(
            canvas,
            card,
            stop,
            session.views,
            aspect,
            around=session.around,
            rounds=rounds,
            last=stop is page.stops[-1] or bool(band),
        )
        top -= height
        if band:
            draw_band(canvas, Rect(area.x, top - BAND_MM, area.width, BAND_MM), band)
            top -= BAND_MM


def _draw_header(
    canvas: "Canvas", area: Rect, session: ObjectSession, page: CardsPage | Sequence[MountDrawing]
) -> None:
    top = area.top + HEADER_MM
    name = session.item.name
    taken = write(canvas, name, area.x, top - 6.2, 7.0, room_mm=0.55 * area.width, font=BOLD)
    label = str(session.item.spec.class_name)
    if not isinstance(page, CardsPage):
        words = f"class {label}" if label != name else ""
        right = "shot list"
    else:
        first, last = page.stops[0].number, page.stops[-1].number
        words = ""
        right = f"places {first}-{last} of {len(session.stops)}" if first != last else f"place {first}"
    write(canvas, words, area.x + taken + 3, top - 6.2, 3.2, room_mm=0.3 * area.width, colour=SOFT)
    write(canvas, right, area.right, top - 6.2, 4.2, room_mm=0.4 * area.width, font=BOLD, align="right")
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
    write(canvas, left, area.x, y, 2.4, room_mm=0.55 * area.width, colour=SOFT)
    write(canvas, right, area.right, y, 2.4, room_mm=0.44 * area.width, align="right", colour=SOFT)
