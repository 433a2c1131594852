"""What `toolkit print` does with `--board`, `--ring` and `--colour-strip`."""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from toolkit.errors import ToolkitError

if TYPE_CHECKING:
    from toolkit.printing.paper import Paper
    from toolkit.printing.sheet_job import PrintedSheet
    from toolkit.workspace import Workspace


@dataclass(frozen=True)
class SheetWish:
    """The options of the command that are about a sheet; checked when it is made.

    Raises:
        ToolkitError: two sheets at once, or an option of another sheet or of none.
    """

    board: bool
    board_squares: str | None
    square_mm: float | None
    ring: bool
    ring_mm: float | None
    marker_mm: float | None
    ink_percent: float | None
    colour_strip: bool

    def __post_init__(self) -> None:
        asked = [kind for kind in ("board", "ring", "colour_strip") if getattr(self, kind)]
        if len(asked) > 1:
            named = " and ".join(f"--{kind.replace('_', '-')}" for kind in asked)
            raise ToolkitError(f"{named}: expected one of them: print the others by calls of their own")
        belongs = {
            "board_squares": ["board"], "square_mm": ["board"], "ring_mm": ["ring"], "marker_mm": ["board", "ring"],
            "ink_percent": ["board", "ring"],
        }  # fmt: skip
        for option, kinds in belongs.items():
            if getattr(self, option) is not None and not set(asked) & set(kinds):
                wanted = " or ".join(f"--{kind}" for kind in kinds)
                option = "ink" if option == "ink_percent" else option
                raise ToolkitError(f"--{option.replace('_', '-')} goes with {wanted}: add that, or leave it out")

    @property
    def kind(self) -> str | None:
        """`board`, `ring`, `colour-strip`, or None where no sheet is asked for."""
        kinds = {"board": self.board, "ring": self.ring, "colour-strip": self.colour_strip}
        return next((kind for kind, asked in kinds.items() if asked), None)


def print_wish(
    wish: SheetWish, place: "Workspace", paper: "Paper", orientation: str, out: Path | None
) -> "PrintedSheet":
    """Print the sheet into the workspace's `print/`, a folder, or the .pdf file named.

    Raises:
        ToolkitError: the sheet cannot be, or a file cannot be written.
    """
    from toolkit.printing.board_page import choose_board
    from toolkit.printing.settings import check_orientation
    from toolkit.printing.sheet_job import parse_squares, print_sheet, print_strip
    from toolkit.rig.board import Sheet
    from toolkit.rig.markers import PALE_PERCENT
    from toolkit.rig.ring import RingSpec, choose_ring

    check_orientation(orientation)
    name = f"{(wish.kind or '').replace('-', '_')}.pdf"
    folder = out or place.root / "print"
    pdf_file = folder if folder.suffix.lower() == ".pdf" else folder / name
    if wish.colour_strip:
        return print_strip(paper, orientation, pdf_file)
    spec: Sheet
    if wish.ring:
        inner_mm = RingSpec.inner_mm if wish.ring_mm is None else wish.ring_mm
        spec = choose_ring(inner_mm, wish.marker_mm)
    else:
        squares = None if wish.board_squares is None else parse_squares(wish.board_squares)
        spec = choose_board(paper, orientation, squares, wish.square_mm, wish.marker_mm)
    spec = replace(spec, ink_percent=PALE_PERCENT if wish.ink_percent is None else wish.ink_percent)
    return print_sheet(place, spec, paper, orientation, pdf_file)


def report_sheet(printed: "PrintedSheet", as_json: bool) -> None:
    """Say what was made and what to do with it."""
    from toolkit.console import console
    from toolkit.printing.job import shorten

    if as_json:
        content = {"printed": [asdict(printed)], "failed": [], "notes": [printed.note] if printed.note else []}
        typer.echo(json.dumps(content, indent=2, ensure_ascii=False))
        return
    console.print(printed.describe(), markup=False, soft_wrap=True)
    if printed.spec_file is not None:
        console.print(f"{shorten(printed.spec_file)}: its spec, by which photographs are read", soft_wrap=True)
    if printed.note:
        console.print(f"note: {printed.note}", markup=False, soft_wrap=True)
    if printed.kind == "colour-strip":
        then = "cut it out with a white border and photograph it beside the object"
    else:
        then = "join the tiles as page 1 shows, " if printed.tiles != (1, 1) else ""
        then += "lay it flat and stand the object on its middle, the front to the edge marked FRONT"
    console.print(
        f'next: print at 100 % ("actual size"), measure both check bars (100 mm), {then}', markup=False, soft_wrap=True
    )
