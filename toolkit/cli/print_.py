"""`toolkit print`."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.print_sheet import SheetWish, print_wish, report_sheet
from toolkit.errors import ToolkitError

if TYPE_CHECKING:
    from toolkit.printing.job import PrintedPatch
    from toolkit.printing.settings import PrintSettings


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
    from toolkit.printing.job import compare_with_rig
    from toolkit.printing.paper import parse_paper
    from toolkit.printing.select import select_patches
    from toolkit.printing.settings import PrintSettings, parse_percent
    from toolkit.workspace import open_workspace

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
    from toolkit.console import progress
    from toolkit.printing.job import print_patch

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
    from toolkit.console import console, errors

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
