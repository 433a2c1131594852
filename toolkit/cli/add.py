"""`toolkit add`."""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import show_result
from toolkit.objects.spec import ObjectRequest


@from_config(request=ObjectRequest)
def add(
    mesh: Annotated[Path, typer.Argument(help="glb, gltf, obj, ply, stl or off; the files that it names come along.")],
    *,
    request: ObjectRequest,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Make an object of a mesh: copy it into the workspace, write its spec, draw a preview.

    Up and front are y and z for glTF, by its specification; by convention y and z for obj, z and -y for ply,
    stl and off.
    """
    from toolkit.captures.suggest_places import add_and_place
    from toolkit.core.workspace import open_workspace

    show_result(add_and_place(open_workspace(workspace, is_needed=True), mesh, request), as_json)
