"""`toolkit plan --shot-list`: from a workspace to `print/shot_list.pdf` and `rig/shots.json`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from toolkit import __version__
from toolkit.core.console import Ticker, progress
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import write_bytes
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject, load_object
from toolkit.printing.canvas import BOLD, CAMERA, FAINT, INK, SHEET, SOFT, TICK_MM, WHITE, Colour, Pdf
from toolkit.printing.document import is_same_size, read_page, say_sizes
from toolkit.printing.page import Paper, Rect, parse_paper
from toolkit.rig import ShotListConfig
from toolkit.rig.applied.base import AppliedBooster
from toolkit.rig.board_file import read_board
from toolkit.rig.plan import CapturePlan, check_poses
from toolkit.rig.variants import VARIANTS, find_booster
from toolkit.rooms.photos.shot_list.mounting import MountDrawing
from toolkit.rooms.photos.shot_list.session import (
    SHEETS_A_PAGE,
    ObjectSession,
    Papers,
    draw_first_page,
    draw_sheets_page,
    prepare_session,
)
from toolkit.rooms.photos.shot_list.tour import Stop, draw_from_above, draw_from_side, find_legs, name_change
from toolkit.rooms.photos.shot_order import (
    ShotList,
    list_shots,
    measure_travel_mm,
    order_shots,
    read_shots,
    write_shots,
)

NUMBER_MM = 14.0
ABOVE_MM = 35.0
NOTES_MM = 5.5
PAD_MM = 1.6
CAPTION_MM = 5.2
GAP_MM = 2.0


def draw_card(pdf: Pdf, area: Rect, session: ObjectSession, stop: Stop, last: bool) -> None:
    """Draw a place into its area, with a line below it unless it is the last."""
    if not last:
        pdf.ink(FAINT, 0.2)
        pdf.line(area.x, area.y, area.right, area.y)
    inside = Rect(area.x, area.y + PAD_MM, area.width, area.height - 2 * PAD_MM)
    # number and roll of the pose on the left
    middle, room = inside.x + NUMBER_MM / 2 - 1.0, NUMBER_MM - 2
    pdf.write("pose", middle, inside.top - 3.2, 2.3, room_mm=NUMBER_MM, align="centre", colour=SOFT)
    pdf.write(str(stop.pose.id), middle, inside.top - 12.0, 9.5, room_mm=room - 0.5, font=BOLD, align="centre")
    if abs(stop.place.roll_deg) > 0.05:
        roll = f"roll {stop.place.roll_deg:+.0f}°"
        pdf.write(roll, middle, inside.top - 16.6, 2.5, room_mm=room, align="centre", colour=CAMERA)
    # its pictures, the drawings from above and from the side, and a line for notes
    # what number, drawings and gaps leave is for the pictures
    side_mm = min(0.285 * area.width, 56.0)
    width = inside.width - NUMBER_MM - ABOVE_MM - side_mm - 2
    pictures = Rect(inside.x + NUMBER_MM, inside.y, width, inside.height)
    _draw_pictures(pdf, pictures, session, stop)
    drawn = inside.height - NOTES_MM
    draw_from_above(pdf, Rect(pictures.right + 2, inside.top - drawn, ABOVE_MM, drawn), session.around, stop.place)
    draw_from_side(pdf, Rect(area.right - side_mm, inside.top - drawn, side_mm, drawn), session.around, stop.place)
    taken = pdf.write("notes", pictures.right + 3, inside.y + 1.0, 2.3, room_mm=12, colour=SOFT)
    pdf.ink(FAINT, 0.2)
    pdf.line(pictures.right + 4.5 + taken, inside.y + 0.6, area.right, inside.y + 0.6)


def _draw_pictures(pdf: Pdf, room: Rect, session: ObjectSession, stop: Stop) -> None:
    """Draw a picture per variant, always in the same places, with a tick box and the number of its shot below."""
    shots = {shot.variant: shot for shot in stop.shots}
    # `unpatched` first, so that pictures of the same kind stand below each other on every card
    order = sorted(shots, key=lambda variant: (variant != "unpatched", variant))
    # a single picture keeps the size that it has beside another
    cells = fit_grid(max(len(order), 2), room, session.camera.width / session.camera.height)
    for variant, cell in zip(order, cells, strict=False):
        picture = Rect(room.x + cell.x, room.top + cell.y, cell.width, cell.height)
        pdf.picture(session.views[variant, stop.pose.id], picture)
        _draw_cross(pdf, picture)
        row = picture.y - CAPTION_MM + 0.7
        pdf.tick_box(picture.x, row)
        text = picture.x + TICK_MM + 1.2
        colour = INK if variant == "unpatched" else SHEET
        words = f"shot {shots[variant].number}"
        taken = pdf.write(words, picture.right, row + 0.8, 2.4, room_mm=0.6 * picture.width, align="right")
        pdf.write(variant, text, row + 0.8, 2.7, room_mm=picture.right - text - taken - 1, font=BOLD, colour=colour)


def _draw_cross(pdf: Pdf, picture: Rect) -> None:
    """Draw a small cross at the picture's middle, to aim with: white under dark, so that it shows on both."""
    x, y = picture.x + picture.width / 2, picture.y + picture.height / 2
    for colour, line in ((WHITE, 0.45), (INK, 0.15)):
        pdf.ink(colour, line)
        pdf.line(x - 1.3, y, x + 1.3, y)
        pdf.line(x, y - 1.3, x, y + 1.3)


def fit_grid(count: int, room: Rect, aspect: float) -> list[Rect]:
    """Arrange pictures of an aspect in rows, with captions, as large as fit a room; places are from its upper left."""
    # every number of columns is tried; the largest picture wins
    best: tuple[float, int] = (0.0, 1)
    for columns in range(1, count + 1):
        rows = -(-count // columns)
        width = (room.width - (columns - 1) * GAP_MM) / columns
        height = (room.height - (rows - 1) * GAP_MM) / rows - CAPTION_MM
        # rounded, so that of equal widths the same number of columns wins everywhere
        best = max(best, (min(width, height * aspect), columns), key=lambda pair: round(pair[0], 6))
    width, columns = best
    height = width / aspect
    return [
        Rect(i % columns * (width + GAP_MM), -height - i // columns * (height + CAPTION_MM + GAP_MM), width, height)
        for i in range(count)
    ]


MARGIN_MM = 10.0
HEADER_MM = 13.0
FOOTER_MM = 6.0
BAND_MM = 6.4
BAND: Colour = (0.985, 0.925, 0.895)
LEAST_CARD_MM = 36.0  # lower cards have pictures too small to aim by
HASH_DIGITS = 12


@dataclass(frozen=True)
class CardsPage:
    """Some stops of an object, and the words of the band that follows each, empty for none."""

    stops: tuple[Stop, ...]
    bands: tuple[str, ...]


def build_shot_list(
    sessions: Sequence[ObjectSession], paper: Paper, seed: int, order: str, bar: Ticker
) -> tuple[bytes, int]:
    """Draw the PDF of a whole session, on upright paper; returns it with its number of pages, reproducibly.

    The footer states `seed` and `order` of the shots. `bar` advances by 1 for each object.
    """
    paper = paper.turn("portrait")
    names = ", ".join(session.item.name for session in sessions)
    plans: dict[str, object] = {f"plan_{session.item.name}": session.poses_sha256 for session in sessions}
    pdf = Pdf(paper, f"Shot list: {names}", f"order {order}, seed {seed}", plans)
    area = Rect(
        MARGIN_MM, MARGIN_MM + FOOTER_MM, paper.width_mm - 2 * MARGIN_MM,
        paper.height_mm - 2 * MARGIN_MM - FOOTER_MM - HEADER_MM,
    )  # fmt: skip
    # all pages are laid out first: each footer states the total
    layouts = [lay_out_pages(session, area.height) for session in sessions]
    number, total = 0, sum(map(len, layouts))
    for session, pages in zip(sessions, layouts, strict=True):
        name, plan = session.item.name, session.poses_sha256[:HASH_DIGITS]
        for index, page in enumerate(pages, 1):
            number += 1
            # seed and order stand on the page, so that a printed list differs from a later list
            made = f"order {order}, seed {seed}   ·   toolkit {__version__}   ·   {number}/{total}"
            with pdf.page():
                _draw_header(pdf, area, session, page)
                _draw_footer(pdf, area, f"{name}, page {index} of {len(pages)}   ·   plan {plan}", made)
                if index == 1:
                    pdf.bookmarkPage(name)
                    pdf.addOutlineEntry(name, name)
                    draw_first_page(pdf, area, session)
                elif isinstance(page, CardsPage):
                    _draw_cards(pdf, area, session, page)
                else:
                    draw_sheets_page(pdf, area, session, page)
        bar.advance(note=f"{name}: pages")
    return pdf.finish(), total


def count_cards(height_mm: float) -> int:
    """Number of cards on a page."""
    return max(1, int((height_mm - BAND_MM) // LEAST_CARD_MM))


def lay_out_pages(session: ObjectSession, height_mm: float) -> list[CardsPage | Sequence[MountDrawing]]:
    """The pages of an object: the first page, with its first sheet, then the other sheets, then its places."""
    more = session.mountings[1:]
    sheets = [more[i : i + SHEETS_A_PAGE] for i in range(0, len(more), SHEETS_A_PAGE)]
    return [session.mountings[:1], *sheets, *lay_out_cards(session, height_mm)]


def lay_out_cards(session: ObjectSession, height_mm: float) -> list[CardsPage]:
    """Spread the places of an object over pages."""
    many, stops, bands = count_cards(height_mm), session.stops, name_bands(session)
    return [CardsPage(stops[i : i + many], tuple(bands[i : i + many])) for i in range(0, len(stops), many)]


def name_bands(session: ObjectSession) -> list[str]:
    """Name the sheet's changes after each place and the end of a round; empty if nothing changes."""
    words: list[list[str]] = [[] for _ in session.stops]
    # without rounds the sheet changes at every pose: the first page says so once
    if not session.rounds:
        return ["" for _ in words]
    legs = find_legs(session.stops)
    for before, after in zip(legs, [*legs[1:], None], strict=True):
        change = name_change(before.variant, after.variant if after else "unpatched", session.sheets)
        onward = "" if after else "done"
        # the next round begins elsewhere than where the last round ended: you have to walk
        if after is not None and after.stops[0] != before.stops[1] + 1:
            onward = f"continue with pose {session.stops[after.stops[0] - 1].pose.id}"
        if next_steps := ", ".join(filter(None, (change, onward))):
            words[before.stops[1] - 1].append(f"after shot {before.shots[1]}: {next_steps}")
    return ["   ·   ".join(parts) for parts in words]


def _draw_cards(pdf: Pdf, area: Rect, session: ObjectSession, page: CardsPage) -> None:
    """Draw the cards of a page, and between two of them the changes."""
    # all pages of an object have cards of the same height, by the page with most bands
    most_bands = max(sum(map(bool, other.bands)) for other in lay_out_cards(session, area.height))
    height = (area.height - most_bands * BAND_MM) / count_cards(area.height)
    top = area.top
    for stop, band in zip(page.stops, page.bands, strict=True):
        last = stop is page.stops[-1] or bool(band)
        draw_card(pdf, Rect(area.x, top - height, area.width, height), session, stop, last)
        top -= height
        if band:
            top -= BAND_MM
            pdf.panel(Rect(area.x, top + 0.6, area.width, BAND_MM - 1.2), BAND)
            x, y = area.x + area.width / 2, top + BAND_MM / 2 - 1.0
            pdf.write(band, x, y, 2.8, room_mm=area.width - 6, font=BOLD, align="centre", colour=SHEET)


def _draw_header(pdf: Pdf, area: Rect, session: ObjectSession, page: CardsPage | Sequence[MountDrawing]) -> None:
    top = area.top + HEADER_MM
    name = session.item.name
    taken = pdf.write(name, area.x, top - 6.2, 7.0, room_mm=0.55 * area.width, font=BOLD)
    label = str(session.item.spec.class_name)
    words, right = f"class {label}" if label != name else "", "shot list"
    if isinstance(page, CardsPage):
        poses = " ".join(str(stop.pose.id) for stop in page.stops)
        words, right = "", f"pose{'s' if len(page.stops) > 1 else ''} {poses}"
    pdf.write(words, area.x + taken + 3, top - 6.2, 3.2, room_mm=0.3 * area.width, colour=SOFT)
    pdf.write(right, area.right, top - 6.2, 4.2, room_mm=0.4 * area.width, font=BOLD, align="right")
    pdf.ink(INK, 0.5)
    pdf.line(area.x, top - 9.2, area.right, top - 9.2)


def _draw_footer(pdf: Pdf, area: Rect, left: str, right: str) -> None:
    y = area.y - FOOTER_MM
    pdf.ink(FAINT, 0.2)
    pdf.line(area.x, y + 3.6, area.right, y + 3.6)
    pdf.write(left, area.x, y, 2.4, room_mm=0.55 * area.width, colour=SOFT)
    pdf.write(right, area.right, y, 2.4, room_mm=0.44 * area.width, align="right", colour=SOFT)


NARROWEST_MM, LOWEST_MM = 180.0, 250.0


@dataclass(frozen=True)
class WrittenShotList:
    """Files of a shot list, their numbers of pages and shots, and the objects in the order of shooting.

    Attributes:
        pdf_file, shots_file: the pages to take along, and the order for `toolkit import` and `toolkit studio`.
        travel_m: distance that the camera moves, metres.
        without_patch: objects with nothing to stick on, and why.
        replaced: whether an earlier list had other shots, or another order.
        notes: pages of another size or another patch than the object's spec asks for.
    """

    pdf_file: str
    shots_file: str
    pages: int
    shots: int
    objects: list[str]
    travel_m: float
    without_patch: dict[str, str]
    replaced: bool
    notes: tuple[str, ...] = ()


def write_shot_list(
    workspace: Workspace, plan: CapturePlan, objects: Sequence[str], config: ShotListConfig, seed: int = 0
) -> WrittenShotList:
    """Order the shots of some objects, draw them on upright paper, and write both files, the PDF first.

    Variants that need a patch are left out of an object without a patch.

    Raises:
        ToolkitError: an object or variant is unknown, a patch's files do not match, a pose cannot be shot, nothing is
            left to shoot, or the paper is too small.
    """
    for variant in config.variants:
        if variant not in VARIANTS:
            raise one_of("variant", variant, list(VARIANTS))
    paper, order = parse_paper(config.paper).turn("portrait"), config.order
    # before objects are loaded and rendered: a paper that is too small fails at once
    if paper.width_mm < NARROWEST_MM or paper.height_mm < LOWEST_MM:
        raise FieldError(
            f"expected at least {NARROWEST_MM:.0f} × {LOWEST_MM:.0f} mm for a shot list: choose a4 or letter",
            {"paper": config.paper},
        )
    items: dict[str, TableObject] = {}
    with progress("reading the objects", len(set(objects))) as bar:
        for name in dict.fromkeys(objects):
            items[name] = load_object(workspace.object_spec(name))
            bar.advance(note=name)
    boosters: dict[str, dict[str, AppliedBooster | None]] = {}
    # what an object wears in each variant, and which objects have no patch
    missing: dict[str, str] = {}
    for name, item in items.items():
        boosters[name] = _find_boosters(workspace, item, config.variants, missing)
    steps = order_shots(plan, list(items), {name: tuple(boosters[name]) for name in items}, seed, order)
    # every pose must be possible before hours of drawing
    for name, item in items.items():
        check_poses(item, plan.camera, plan.objects[name])
    board, sessions = read_board(workspace), []
    printed = {name: _find_page(workspace, name, boosters[name]) for name in items}
    with progress("drawing the shot list", len(steps) + 2 * len(items)) as bar:
        for name, item in items.items():
            own = [step for step in steps if step.object == name]
            papers = Papers(board, printed[name][0], missing.get(name))
            sessions.append(prepare_session(item, plan, own, boosters[name], papers, bar))
        content, pages = build_shot_list(sessions, paper, seed, order, bar)
    # the PDF first: if it cannot be written, the order in use stays as it is
    pdf_file = write_bytes(workspace.print_dir / "shot_list.pdf", content)
    shots_file = workspace.root / "rig" / "shots.json"
    shots = list_shots(plan, steps, seed, order)
    # compared before the earlier file is replaced
    replaced = _is_other(shots_file, shots)
    write_shots(shots_file, shots)
    return WrittenShotList(
        str(pdf_file), str(shots_file), pages, len(steps), list(items), replaced=replaced, without_patch=missing,
        travel_m=round(measure_travel_mm(plan, steps) / 1000, 2),
        notes=tuple(note for _, note in printed.values() if note),
    )  # fmt: skip


def _find_boosters(
    workspace: Workspace, item: TableObject, variants: Sequence[str], missing: dict[str, str]
) -> dict[str, AppliedBooster | None]:
    """Find the booster of each variant; an object without a patch keeps `unpatched`, and `missing` gets the reason."""
    found: dict[str, AppliedBooster | None] = {}
    for variant in dict.fromkeys(variants):
        try:
            found[variant] = find_booster(workspace, item, variant)
        except ToolkitError as error:
            # a patch that is there and broken must be put right, not left out
            if item.name in workspace.patches() or "unpatched" not in variants:
                raise
            missing[item.name] = str(error)
    return found


def _find_page(
    workspace: Workspace, name: str, boosters: dict[str, AppliedBooster | None]
) -> tuple[str | None, str | None]:
    """The page of an object's patch, relative to the workspace; else the fault of the page that is there."""
    patch = boosters.get("patched")
    wrong: str | None = None
    if patch is None or not patch.sizes_mm:
        return None, None
    # the object's own page first, as it has the object's own size
    for file in (workspace.print_dir / f"{name}.pdf", workspace.print_dir / f"{patch.name}.pdf"):
        stated, shown = read_page(file), str(file.relative_to(workspace.root))
        if stated is None:
            continue
        sizes_mm, sha256 = stated
        if sha256 == patch.sha256 and is_same_size(sizes_mm, patch.sizes_mm):
            return shown, None
        what = say_sizes(sizes_mm) if sha256 == patch.sha256 else "of another patch"
        wrong = wrong or (
            f"{shown} is {what}, the rig mounts {patch.name} on {name} at {say_sizes(patch.sizes_mm)}: print it again "
            f"with 'toolkit print --object {name}'"
        )
    return None, wrong


def _is_other(file: Path, shots: ShotList) -> bool:
    """Whether another list lies there; a broken list counts as another."""
    try:
        return file.is_file() and read_shots(file).steps != shots.steps
    except ToolkitError:
        return True
