"""`toolkit print`."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import say, show_json, warn
from toolkit.core.errors import FieldError
from toolkit.core.rooms import ask_room
from toolkit.core.workspace import open_workspace
from toolkit.printing import OwnSettings, PrintSettings, SheetSettings, WrapSettings

if TYPE_CHECKING:
    from toolkit.printing.print_boards import PrintedBoard
    from toolkit.printing.print_patches import PrintedPatch

AT_TRUE_SIZE = 'print at 100 % ("actual size"), measure both check bars (100 mm)'
JOIN = "join the tiles as page 1 shows"


@from_config(settings=PrintSettings, sheet=SheetSettings, cut=WrapSettings, own=OwnSettings)
def print_patches(
    *,
    classes: Annotated[
        list[str] | None,
        typer.Option("--class", metavar="NAME", help="Patch by file name or by class; may be given several times."),
    ] = None,
    objects: Annotated[
        list[str] | None,
        typer.Option("--object", metavar="NAME", help="The patch of this object, in its spec's size; repeat for more."),
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="Every known patch.")] = False,
    files: Annotated[
        list[Path] | None,
        typer.Option("--patch-file", metavar="PNG", help="A patch file anywhere, with its record beside it."),
    ] = None,
    wrap: Annotated[str | None, typer.Option(metavar="NAME", help="The pieces of a wrap, and a map of them.")] = None,
    settings: PrintSettings,
    sheet: SheetSettings,
    cut: WrapSettings,
    own: OwnSettings,
    out: Annotated[
        Path | None, typer.Option(metavar="PATH", help="Folder, or a .pdf for a patch. Default: print/[PATCHES].")
    ] = None,
    patches: options.Patches = None,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Make print-ready PDFs at true size: patches, a wrap, the board under the object, tags, or any picture."""
    place = open_workspace(workspace, is_needed=out is None or sheet.kind is not None).with_patches(patches)
    # a sheet with a page size of its own is printed alone
    kinds: dict[str, object] = {"tag": own.tag, "picture": own.picture, "wrap": wrap}
    kinds |= {sheet.kind.replace("-", "_"): True} if sheet.kind is not None else {}
    alone = {name: value for name, value in kinds.items() if value is not None}
    if alone and (len(alone) > 1 or objects or classes or everything or files):
        raise FieldError(
            "cannot be printed together with others: print it in a call of its own", dict([alone.popitem()])
        )
    if own.tag is not None or own.picture is not None:
        from toolkit.printing.own import print_picture, print_tags

        _report_sheet((print_tags if own.tag else print_picture)(own, settings, out or place.root / "print"), as_json)
    elif sheet.kind is not None:
        from toolkit.printing.print_boards import print_board

        _report_sheet(print_board(place, sheet, settings, out), as_json)
    elif wrap is not None:
        ask_room("printed wrap")(place, wrap, settings, cut, out, as_json)
    elif cut != WrapSettings():
        given = {"cut": cut.cut} if cut.roll_mm is None else {"roll_mm": cut.roll_mm}
        raise FieldError("goes with {wrap}: add that, or leave it out", given)
    else:
        from toolkit.printing.print_patches import print_chosen

        printed, failed, notes = print_chosen(
            place, out or place.print_dir, settings, objects=objects or [], classes=classes or [],
            everything=everything, files=files or [],
        )  # fmt: skip
        _report_patches(printed, failed, notes, as_json)


def _report_patches(
    printed: list["PrintedPatch"], failed: list[dict[str, str]], notes: list[str], as_json: bool
) -> None:
    # failures first, so that they are not lost above many lines
    for failure in failed:
        warn(f"not printed: {failure['reason']}", style="red")
    if as_json:
        show_json({"printed": [sheet.as_json() for sheet in printed], "failed": failed, "notes": notes})
    else:
        for sheet in printed:
            say(sheet.describe_scores())
            say(sheet.describe())
        for note in notes:
            say(f"note: {note}")
        # how to cut and stick them
        if any(not sheet.colour_strip for sheet in printed):
            say("note: no room for the colour strip beside the patch: print it with 'toolkit print --colour-strip'")
        if printed:
            # tiles are joined before they are cut out
            tiled = any(sheet.pages > 1 and sheet.tiles != (1, 1) for sheet in printed)
            tape = "tape" if all(sheet.margin == "white" for sheet in printed) else "stick (with clear tape)"
            cut = f"cut at the corner marks and {tape} the patch on as its arrow shows"
            say(f"next: {', '.join([AT_TRUE_SIZE, *([JOIN] if tiled else []), cut])}")
    # 2 where nothing was printed, as for bad input
    if failed:
        raise typer.Exit(1 if printed else 2)


def _report_sheet(printed: "PrintedBoard", as_json: bool) -> None:
    from toolkit.printing.print_patches import shorten

    if as_json:
        show_json({"printed": [asdict(printed)], "failed": [], "notes": [printed.note] if printed.note else []})
        return
    say(printed.describe())
    if printed.spec_file is not None:
        say(f"{shorten(printed.spec_file)}: the spec by which photographs are read")
    if printed.note:
        say(f"note: {printed.note}")
    # next steps depend on the kind of sheet
    if printed.kind in ("tags", "picture"):
        then = [*([JOIN] if printed.tiles != (1, 1) else []), "cut at the corner marks"]
    elif printed.kind == "colour-strip":
        then = ["cut it out with a white border and photograph it beside the object"]
    else:
        stand = "lay it flat and stand the object on its middle, the front to the edge marked FRONT"
        then = [*([JOIN] if printed.tiles != (1, 1) else []), stand]
    say(f"next: {', '.join([AT_TRUE_SIZE, *then])}")
