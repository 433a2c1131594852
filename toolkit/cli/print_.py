"""`toolkit print`."""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.core.errors import ToolkitError

if TYPE_CHECKING:
    from toolkit.core.workspace import Workspace
    from toolkit.printing.layout import PrintSettings
    from toolkit.printing.page import Paper
    from toolkit.printing.print_boards import PrintedBoard
    from toolkit.printing.print_patches import PrintedPatch


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
) -> "PrintedBoard":
    """Print the sheet into the workspace's `print/`, a folder, or the .pdf file named.

    Raises:
        ToolkitError: the sheet cannot be, or a file cannot be written.
    """
    from toolkit.printing.board_page import choose_board
    from toolkit.printing.layout import check_orientation
    from toolkit.printing.print_boards import parse_squares, print_board, print_strip
    from toolkit.rig.board import Sheet
    from toolkit.rig.markers import PALE_PERCENT, RingSpec, choose_ring

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
    return print_board(place, spec, paper, orientation, pdf_file)


def report_sheet(printed: "PrintedBoard", as_json: bool) -> None:
    """Say what was made and what to do with it."""
    from toolkit.core.console import console
    from toolkit.printing.print_patches import shorten

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


def print_patches(
    classes: Annotated[
        list[str] | None, typer.Option("--class", help="Patch by file name or by class; may be given several times.")
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="Every known patch.")] = False,
    patch_file: Annotated[
        list[Path] | None, typer.Option("--patch-file", help="A patch's PNG anywhere, its record beside it.")
    ] = None,
    paper: Annotated[
        str, typer.Option(help="a0 to a5, b3 to b5, letter, legal, tabloid, or one's own: 200x300mm.")
    ] = "a4",
    orientation: Annotated[str, typer.Option(help="portrait, landscape, or auto: the one with fewer pages.")] = "auto",
    scale: Annotated[str, typer.Option(help="Percent: 250 or 250%. Side = pixels / dpi × scale.")] = "250",
    dpi: Annotated[float, typer.Option(help="Patch pixels per inch at 100 %.")] = 72.0,
    size_mm: Annotated[
        float | None,
        typer.Option(help="Side of the printed patch, without its white margin; overrides --scale and --dpi."),
    ] = None,
    copies: Annotated[int, typer.Option(help="Copies of each patch, packed on a page where they fit.")] = 1,
    margin_mm: Annotated[float, typer.Option(help="White paper round the patch to tape it by, inside the cut.")] = 5.0,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the PDFs, or a .pdf file for one patch; default: print/, or print/PATCHES."),
    ] = None,
    board: Annotated[
        bool, typer.Option("--board", help="The board to stand the object on: its photographs then tell the camera.")
    ] = False,
    board_squares: Annotated[
        str | None, typer.Option(help="Columns x rows of the board, such as 7x10; default: 12x15.")
    ] = None,
    square_mm: Annotated[
        float | None,
        typer.Option(help="Side of the board's squares; default: 26, or with --board-squares what fits on a page."),
    ] = None,
    ring: Annotated[
        bool, typer.Option("--ring", help="A ring of markers for a turntable, in the board's place.")
    ] = False,
    ring_mm: Annotated[float | None, typer.Option(help="Diameter of the free disc in the ring; default: 300.")] = None,
    marker_mm: Annotated[
        float | None,
        typer.Option(help="Side of the markers; default: three quarters of a square, or to suit the ring."),
    ] = None,
    ink_percent: Annotated[
        float | None,
        typer.Option(
            "--ink",
            help="Of board or ring, percent; default: 10. 100 is black, which networks see before the object: "
            "for calibrating without one.",
        ),
    ] = None,
    colour_strip: Annotated[
        bool,
        typer.Option("--colour-strip", help="The strip of known colours alone; a patch's page has it where it fits."),
    ] = False,
    patches: options.Patches = None,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Make print-ready PDFs of patches, or of the board that the object stands on, at true size, with check bars."""
    from toolkit.core.workspace import open_workspace
    from toolkit.printing.layout import PrintSettings, parse_percent
    from toolkit.printing.page import parse_paper
    from toolkit.printing.print_patches import compare_with_rig, select_patches

    place = open_workspace(workspace).with_patches(patches)
    wish = SheetWish(board, board_squares, square_mm, ring, ring_mm, marker_mm, ink_percent, colour_strip)
    if wish.kind is not None:
        if classes or everything or patch_file:
            raise ToolkitError(f"--{wish.kind} is printed alone: print patches by a call of their own")
        report_sheet(print_wish(wish, place, parse_paper(paper), orientation, out), as_json)
        return
    settings = PrintSettings(parse_paper(paper), orientation, parse_percent(scale), dpi, size_mm, copies, margin_mm)
    files = select_patches(place, classes or [], everything, patch_file or [])
    printed, failed = _print_files(_name_targets(files, out or place.print_dir), settings, everything, quiet or as_json)
    notes = [note for one in printed if (note := compare_with_rig(place, one))]
    _report(printed, failed, notes, as_json)
    if failed:
        raise typer.Exit(1 if printed else 2)


def _name_targets(files: list[Path], out: Path) -> list[tuple[Path, Path]]:
    """(patch, PDF) pairs; two patches may not share a PDF."""
    if out.suffix.lower() == ".pdf":
        if len(files) > 1:
            raise ToolkitError(f"--out {out}: one file for {len(files)} patches: name a folder")
        return [(files[0], out)]
    targets = [(file, out / f"{file.stem}.pdf") for file in files]
    names = [pdf_file.name for _, pdf_file in targets]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ToolkitError(
            f"two patches would be written to {out / twice[0]}: print them by calls with different --out"
        )
    return targets


def _print_files(
    targets: list[tuple[Path, Path]], settings: "PrintSettings", go_on: bool, quiet: bool
) -> tuple[list["PrintedPatch"], list[dict[str, str]]]:
    """Print each; with `go_on` (for --all) a bad patch is listed and the others are done, else it ends the run."""
    from toolkit.core.console import progress
    from toolkit.printing.print_patches import print_patch

    printed: list[PrintedPatch] = []
    failed: list[dict[str, str]] = []
    with progress("Printing", len(targets), quiet or len(targets) == 1) as ticker:
        for png_file, pdf_file in targets:
            try:
                printed.append(print_patch(png_file, pdf_file, settings))
            except ToolkitError as error:
                if not go_on or len(targets) == 1:
                    raise
                failed.append({"patch": str(png_file), "reason": str(error)})
            ticker.advance(note=pdf_file.name)
    return printed, failed


def _report(printed: list["PrintedPatch"], failed: list[dict[str, str]], notes: list[str], as_json: bool) -> None:
    from toolkit.core.console import console, errors

    for failure in failed:
        errors.print(f"not printed: {failure['reason']}", style="red", markup=False, soft_wrap=True)
    if as_json:
        content = {"printed": [asdict(one) for one in printed], "failed": failed, "notes": notes}
        typer.echo(json.dumps(content, indent=2, ensure_ascii=False))
        return
    for one in printed:
        console.print(one.describe_scores(), markup=False, soft_wrap=True)
        console.print(one.describe(), markup=False, soft_wrap=True)
    for note in notes:
        console.print(f"note: {note}", markup=False, soft_wrap=True)
    if not printed:
        return
    if any(not one.colour_strip for one in printed):
        console.print(
            "note: no room for the colour strip beside the patch: 'toolkit print --colour-strip' prints it on its own",
            markup=False,
            soft_wrap=True,
        )
    tiled = any(one.pages > 1 and one.tiles != (1, 1) for one in printed)
    console.print(
        'next: print at 100 % ("actual size"), measure both check bars (100 mm), '
        + ("join the tiles as page 1 shows, " if tiled else "")
        + "cut at the corner marks and tape the patch on with its arrow to the object's front",
        markup=False,
        soft_wrap=True,
    )
