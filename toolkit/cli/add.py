"""`toolkit add`."""

from pathlib import Path
from typing import Annotated, cast, get_args

import typer

from toolkit.cli import options
from toolkit.cli.output import say, show_json

AXES = "x, y, z, -x, -y or -z"


def add(
    mesh: Annotated[Path, typer.Argument(help="glb, gltf, obj, ply, stl or off; the files that it names come along.")],
    class_name: Annotated[
        str,
        typer.Option(
            "--class",
            metavar="NAME",
            help="What it should be recognised as: an ImageNet category, or your classifier's.",
        ),
    ],
    name: Annotated[str | None, typer.Option(metavar="NAME", help="Of the object; default: the file's.")] = None,
    length_mm: Annotated[
        float | None,
        typer.Option(metavar="X", help="Longest side of the real object; default: of a glTF its own size, else 200."),
    ] = None,
    print_side: Annotated[
        str | None,
        typer.Option(
            metavar="SIDE",
            help="Where its patch goes: top, front, back, left or right. Default: top, if it lies there, else where "
            "it lies.",
        ),
    ] = None,
    size_mm: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="Side of its printed patch; default: 88, or a third of a small object. Made smaller where it does "
            "not lie.",
        ),
    ] = None,
    up: Annotated[
        str | None, typer.Option(metavar="AXIS", help=f"The mesh's axis that points up: {AXES}; default: by format.")
    ] = None,
    front: Annotated[
        str | None, typer.Option(metavar="AXIS", help="The mesh's axis that points to the front; default: by format.")
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Replace the object of that name.")] = False,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Make an object of a mesh: copy it into the workspace, write its spec, draw a preview.

    Up and front are y and z for glTF, by its specification; by convention y and z for obj, z and -y for ply,
    stl and off.
    """
    from toolkit.captures.render import preview_object
    from toolkit.captures.suggest_places import move_sheet
    from toolkit.core.workspace import open_workspace
    from toolkit.models.find import find_class
    from toolkit.objects.add import ObjectRequest, add_object
    from toolkit.objects.load import load_object
    from toolkit.objects.spec import Axis, Side

    space = open_workspace(workspace, is_needed=True)
    for option, value, known in (("--print-side", print_side, Side), ("--up", up, Axis), ("--front", front, Axis)):
        if value is not None and value not in get_args(known):
            raise typer.BadParameter(f"expected {', '.join(get_args(known))}, found {value}", param_hint=option)
    request = ObjectRequest(
        find_class(class_name, space.classifiers_dir), name, length_mm, cast(Side, print_side or "top"), size_mm,
        cast(Axis | None, up), cast(Axis | None, front), replace,
    )  # fmt: skip
    made = add_object(space, mesh, request)
    moved = move_sheet(space, made.item.name, get_args(Side) if print_side is None else (cast(Side, print_side),))
    drawn = preview_object(space, load_object(made.spec_file))
    if as_json:
        page = str(drawn.page) if drawn.page else None
        show_json(
            made.as_json() | {"preview": str(drawn.picture), "page": page, "moved": moved, "trouble": drawn.trouble}
        )
        return
    for line in (*made.lines(), *drawn.lines()):
        say(line)
    for note in (moved, drawn.trouble, made.ask_length()):
        if note:
            say(f"note: {note}")
    say(f"next: toolkit plan --object {made.item.name}, then toolkit train-patch --object {made.item.name}")
