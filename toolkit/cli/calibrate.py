"""`toolkit calibrate`."""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options


def calibrate(
    photos: Annotated[Path, typer.Argument(help="Folder with photos of the printed board, from several sides.")],
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Measure the lens of a camera from photos of the printed board and keep it in rig/lens.json."""
    from toolkit.core.console import console, list_skipped
    from toolkit.core.errors import ToolkitError
    from toolkit.core.workspace import open_workspace
    from toolkit.photos.calibrate import calibrate_folder
    from toolkit.photos.lens import write_lenses
    from toolkit.rig.board import read_board

    space = open_workspace(workspace)
    board = read_board(space)
    run = calibrate_folder(photos, board, quiet or as_json)
    list_skipped(run.unreadable)
    list_skipped((name, f"no {board.describe()} found in it") for name in run.without_board)
    records = [record for result in run.lenses if (record := result.record()) is not None]
    for result in run.lenses:
        if result.calibration is None:
            list_skipped([(_describe(result), result.why)])
        else:
            list_skipped((result.names[index], why) for index, why in result.calibration.refused)
    if not records:
        why = run.lenses[0].why if run.lenses else f"the {board.describe()} was found in none of the photos"
        raise ToolkitError(f"{photos}: no lens could be calibrated: {why}")
    file = write_lenses(space, records)
    if as_json:
        typer.echo(_to_json(run))
    else:
        _print_table(run)
        console.print(f"wrote {file}; next: toolkit import PHOTOS/", soft_wrap=True)
    if run.unreadable:
        raise typer.Exit(1)


def _describe(result) -> str:
    focal = f" at {result.focal_35mm_mm:g} mm" if result.focal_35mm_mm else ""
    return f"{result.camera or 'camera without a name'}{focal}, {result.size[0]}x{result.size[1]}"


def _print_table(run) -> None:
    from rich.markup import escape
    from rich.table import Table

    from toolkit.core.console import console

    table = Table("lens", "photos", "error, px", "field of view", "focal length, px", "frame covered")
    notes = []
    for result in run.lenses:
        found = result.calibration
        if found is None:
            continue
        table.add_row(
            escape(_describe(result)), f"{len(found.used)} of {len(result.names)}", f"{found.reprojection_px:.2f}",
            f"{found.lens.fov_deg:.1f}°", f"{found.lens.fx:.1f} ± {found.focal_sigma_px:.1f}", f"{found.coverage:.0%}",
        )  # fmt: skip
        notes += [f"{_describe(result)}: {line}" for line in found.advice()]
    console.print(table)
    for note in notes:
        console.print(note, style="yellow", markup=False, soft_wrap=True)


def _to_json(run) -> str:
    import json

    lenses = []
    for result in run.lenses:
        record = result.record()
        lenses.append({
            "camera": result.camera, "size": list(result.size), "why_not": result.why or None,
            "lens": record.model_dump(mode="json") if record else None,
            "fov_deg": round(result.calibration.lens.fov_deg, 3) if result.calibration else None,
            "advice": result.calibration.advice() if result.calibration else [],
        })  # fmt: skip
    skipped = [*run.unreadable, *((name, "no board found") for name in run.without_board)]
    return json.dumps({"lenses": lenses, "skipped": [list(pair) for pair in skipped]}, indent=2, ensure_ascii=False)
