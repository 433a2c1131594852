"""`toolkit calibrate` and `toolkit print-profile`: a camera's lens and a printer's colours, from photographs."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from toolkit.cli import options
from toolkit.cli.output import remark, say, show_json, show_table, warn
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.text import is_file_name, quote
from toolkit.core.workspace import Workspace, open_workspace

if TYPE_CHECKING:
    from toolkit.rooms.photos.calibrate import CalibrationRun, LensResult
    from toolkit.rooms.photos.prints.profile_photos import ProfileRun

SHOWN_VIEWS = 3


def calibrate(
    photos: Annotated[Path, typer.Argument(help="Folder with photos of the printed board, from several sides.")],
    board: options.Board = None,
    find_board: Annotated[
        bool,
        typer.Option("--find-board", help="Tell kind, dictionary and layout of a board that others printed instead."),
    ] = False,
    square_mm: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="With --find-board: side of a square; in a grid of markers, from left edge to left edge.",
        ),
    ] = None,
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace a lens in rig/lens.json that was measured better.")
    ] = False,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Measure the lens of a camera from photos of the printed board and keep it in rig/lens.json."""
    from toolkit.rig.board_file import with_board
    from toolkit.rooms.photos.calibrate import write_pictures
    from toolkit.rooms.photos.lens import write_lenses

    space = open_workspace(workspace)
    if find_board:
        _find_board(photos, space, square_mm, as_json)
        return
    if square_mm is not None:
        raise FieldError("goes with {find_board}", {"square_mm": square_mm})
    space = with_board(space, board)
    run = _calibrate(photos, space)
    # lenses that were measured; a better earlier lens stays
    records = [record for result in run.lenses if (record := result.record()) is not None]
    if not records:
        raise ToolkitError(f"{photos}: no lens could be calibrated: {run.lenses[0].why}")
    file, better = write_lenses(space, records, replace)
    pictures = write_pictures(space, run)
    for old, new in better:
        warn(
            f"kept the earlier lens, whose focal length is known to {old.focal_sigma_px} px, that of the new lens to "
            f"{new.focal_sigma_px} px; --replace takes the new lens"
        )
    if as_json:
        show_json(_calibration_json(run) | {"kept_older": len(better), "pictures": list(map(str, pictures))})
    else:
        _report_lenses(run)
        for picture in pictures:
            say(f"where corners were seen, and what was left of their errors: {picture}")
        say(f"wrote {file}; next: toolkit import PHOTOS/")
    if run.unreadable:
        raise typer.Exit(1)


def _calibrate(photos: Path, space: Workspace) -> "CalibrationRun":
    """Calibrate by the printed board, or with its columns and rows exchanged; `ToolkitError` if neither is seen."""
    from toolkit.core.console import list_skipped
    from toolkit.rig.board_file import board_file, read_board, swap_sides
    from toolkit.rooms.photos.calibrate import calibrate_folder

    # a board with exchanged sides is a frequent slip
    printed = read_board(space)
    run = calibrate_folder(photos, printed)
    if not run.lenses and (turned := swap_sides(printed)) is not None:
        other = calibrate_folder(photos, turned)
        if other.lenses:
            run = other
            remark(
                f"the photos show {turned.describe()}; {board_file(space)} has columns and rows the other way round: "
                "exchange them there"
            )
    list_skipped([*run.unreadable, *run.without_board])
    for result in run.lenses:
        found = result.calibration
        pairs = (
            [(_describe(result), result.why)] if found is None else [(result.names[i], why) for i, why in found.refused]
        )
        list_skipped(pairs)
    if not run.lenses:
        # a single reason for all photographs is worth a word
        whys = {why for _, why in run.without_board}
        also = f"; {whys.pop()}" if len(whys) == 1 and "no board is seen" not in whys else ""
        raise ToolkitError(
            f"{photos}: no lens could be calibrated: the {printed.describe()} was found in none of the photos{also}; "
            "'toolkit calibrate --find-board PHOTOS/' tells which board they show"
        )
    return run


def _find_board(photos: Path, space: Workspace, square_mm: float | None, as_json: bool) -> None:
    """Tell which board photographs show, ask for its length, and write it."""
    from toolkit.rig.board_file import boards_dir, write_spec
    from toolkit.rooms.photos.unknown_board import identify_board

    found = identify_board(photos)
    # the length is asked for at a terminal, or left to a second call
    if square_mm is None and not as_json and sys.stdin.isatty():
        say(found.describe())
        square_mm = typer.prompt(f"{found.length_name}, in mm", type=float, err=True)
    if square_mm is None:
        if as_json:
            show_json({"file": None, "photos": found.photos, "of": found.of, "board": found.describe()})
            return
        say(found.describe())
        say(f"next: measure {found.length_name}, then toolkit calibrate {quote(photos)} --find-board --square-mm MM")
        return
    # kind and layout are known from the photographs, and the length from the user: a board file as any other
    spec = found.measured(square_mm)
    file = write_spec(boards_dir(space) / f"{found.name}.toml", spec)
    if as_json:
        show_json({"file": str(file), "photos": found.photos, "of": found.of, **spec.model_dump(exclude_none=True)})
        return
    say(found.describe())
    say(f"wrote {file}; next: toolkit calibrate {quote(photos)} --board {found.name}")


def _describe(result: "LensResult") -> str:
    focal = f" at {result.focal_35mm_mm:g} mm" if result.focal_35mm_mm else ""
    return f"{result.camera or 'camera without a name'}{focal}, {result.size[0]}x{result.size[1]}"


def _report_lenses(run: "CalibrationRun") -> None:
    rows, notes = [], []
    for result in run.lenses:
        found = result.calibration
        if found is None:
            continue
        rows.append((
            _describe(result), f"{len(found.used)} of {len(result.names)}", f"{found.reprojection_px:.2f}",
            f"{found.lens.fov_deg:.1f}°", f"{found.lens.fx:.1f} ± {found.focal_sigma_px:.1f}", f"{found.coverage:.0%}",
        ))  # fmt: skip
        # the views that fit worst may be retaken
        order = sorted(zip(found.view_px, found.used, strict=True), reverse=True)[:SHOWN_VIEWS]
        worst = ", ".join(f"{result.names[index]} {off:.2f}" for off, index in order)
        notes.append(f"{_describe(result)}: farthest off, px: {worst}")
        notes += [f"{_describe(result)}: {line}" for line in found.advice()]
    show_table(("lens", "photos", "error, px", "field of view", "focal length, px", "frame covered"), rows)
    for note in notes:
        say(note)


def _calibration_json(run: "CalibrationRun") -> dict[str, Any]:
    lenses = []
    for result in run.lenses:
        record, found = result.record(), result.calibration
        lenses.append({
            "camera": result.camera, "size": list(result.size), "why_not": result.why or None,
            "lens": record.model_dump(mode="json") if record else None,
            "fov_deg": round(found.lens.fov_deg, 3) if found else None, "advice": found.advice() if found else [],
            "flat_px": round(found.flat_px, 4) if found else None,
            "bend_mm": round(found.bend_mm, 3) if found else None, "photos": _list_views(result),
        })  # fmt: skip
    skipped = [*run.unreadable, *run.without_board]
    return {"lenses": lenses, "skipped": [list(pair) for pair in skipped]}


def _list_views(result: "LensResult") -> list[dict[str, Any]]:
    """Error and tilt of each photograph of the board that was used, and why the others were refused."""
    if (found := result.calibration) is None:
        return []
    used = [
        {"photo": result.names[index], "error_px": round(off, 4), "tilt_deg": round(tilt, 1)}
        for index, off, tilt in zip(found.used, found.view_px, found.tilt_deg, strict=True)
    ]
    return used + [{"photo": result.names[index], "refused": why} for index, why in found.refused]


def print_profile(
    photos: Annotated[list[Path], typer.Argument(help="Photographs of the printed page, or a folder of them.")],
    class_name: Annotated[
        str | None, typer.Option("--class", metavar="NAME", help="The patch on it, by file name or by class.")
    ] = None,
    from_patch: Annotated[
        list[str] | None,
        typer.Option(
            "--from-patch",
            metavar="PATCH",
            help="In place of --class: photographs of this patch, cut out and anywhere; its name, or a PNG of its "
            "texels. Repeat for several: each is then predicted from the others.",
        ),
    ] = None,
    paper: Annotated[
        str,
        typer.Option(metavar="SIZE", help="Size of the page, which shows the print's scale: a4, letter, 200x300mm."),
    ] = "a4",
    size_mm: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Side of the printed patch. Default: as 'toolkit print' makes it.", min=1),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Name of the profile, such as printer and paper. Default: the patch's."),
    ] = None,
    by: Annotated[str | None, typer.Option(metavar="NAME", help="Who measured; written into the profile.")] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="JSON file. Default: print/profiles/NAME.json.")
    ] = None,
    patches: options.Patches = None,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Measure how a printer changes a patch's colours and size, from photos of its page, for 'train-patch'."""
    from toolkit.core.console import list_skipped
    from toolkit.imaging.printer import write_print_profile
    from toolkit.printing.page import parse_paper
    from toolkit.rooms.photos.prints.fitted_photo import read_known
    from toolkit.rooms.photos.prints.profile_photos import choose_printed, profile_patches, profile_photos

    if name is not None and not is_file_name(name):
        raise FieldError("expected letters, digits, '-' and '_', without a suffix", {"name": name})
    space = open_workspace(workspace).with_patches(patches)
    if (class_name is None) == (from_patch is None):
        raise FieldError("give either {class_name} or {from_patch}", {})
    # by known patches cut out and anywhere, or by a printed page with strip and edges
    if from_patch is not None:
        known = [read_known(space, source) for source in from_patch]
        run = profile_patches(photos, known, name or known[0].name, by)
    else:
        patch, size_mm = choose_printed(space, str(class_name), size_mm)
        run = profile_photos(photos, patch, parse_paper(paper), size_mm, name, by)
    list_skipped(run.skipped)
    file = write_print_profile(out or space.root / "print" / "profiles" / f"{run.profile.name}.json", run.profile)
    if as_json:
        show_json(_profile_json(run, file))
    else:
        _report_profile(run, file, size_mm)
    if run.skipped:
        raise typer.Exit(1)


def _profile_json(run: "ProfileRun", file: Path) -> dict[str, Any]:
    photos = [asdict(photo) | {"colour": asdict(photo.colour)} for photo in run.photos]
    for photo in photos:
        photo["colour"]["error"] = photo["colour"]["error"].model_dump()
    return {
        "file": str(file), "profile": run.profile.model_dump(mode="json"), "photos": photos,
        "skipped": [{"path": path, "reason": reason} for path, reason in run.skipped],
        "tried": run.tried, "warnings": list(run.warnings),
    }  # fmt: skip


def _report_profile(run: "ProfileRun", file: Path, expected_mm: float | None) -> None:
    for photo in run.photos:
        # without the page, the patch's size in millimetres is not known
        size = "sheet's edges not seen" if expected_mm is not None else f"side {photo.side_px:.0f} px"
        if photo.size_mm is not None and expected_mm is not None:
            size = f"{photo.size_mm:.1f} mm of {expected_mm:.1f} mm"
        strip = "strip read" if photo.has_strip else "no strip"
        bias = ", ".join(f"{name} {100 * off:+.0f} %" for name, off in zip("RGB", photo.colour.bias, strict=True))
        say(f"{photo.name}: {size}, {strip}, printed colours off by {photo.colour.error}, on average {bias}")
    for warning in run.warnings:
        warn(f"note: {warning}")
    profile = run.profile
    say(
        f"{file}: model '{profile.model}' of {profile.n_samples} samples; print against file {profile.without}, "
        f"against the profile, on parts it was not fitted to, {profile.held_out}"
    )
    name = "NAME" if expected_mm is None else profile.patch
    say(f"next: toolkit train-patch --class {name} --data rig --print-profile {quote(file)}")
