"""`toolkit coco`: where the objects are in a capture folder, for other tools."""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options
from toolkit.cli.output import say, show_json, warn


def write_boxes(
    captures: Annotated[
        Path | None, typer.Argument(help="Capture folder, or one of its sources; default: captures/.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="File to write; default: instances.json in the folder.")
    ] = None,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Write box and mask of the object in every image as COCO's instances.json, by its mesh and the camera.

    The categories are COCO's where an object is of a kind that COCO has (airplane, car, bottle, cup), else the class of
    its spec.
    """
    from toolkit.captures.read import read_captures
    from toolkit.captures.truth import write_coco
    from toolkit.core.workspace import open_workspace
    from toolkit.evaluation.tables import list_lines
    from toolkit.models.detector import coco_names
    from toolkit.objects.spec import read_spec

    space = open_workspace(workspace)
    folder = read_captures(captures or space.captures_dir)
    specs = space.object_specs()
    names = {name: coco_names(str(read_spec(specs[name]).class_name))[-1] for name in folder.objects if name in specs}
    file = out or folder.root / "instances.json"
    count, left_out = write_coco(file, folder.captures, space, names)
    if as_json:
        show_json({"file": str(file), "images": count, "left_out": left_out})
    else:
        say(f"{file}: {count} images")
        for line in list_lines("left out", left_out):
            warn(line)
    if left_out:
        raise typer.Exit(1)
