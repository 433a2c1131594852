"""`toolkit objects`."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from toolkit.cli import options


def list_objects(
    export: Annotated[Path | None, typer.Option(help="Write every object as a GLB into this folder.")] = None,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """List the objects that can be photographed, built in and your own; --export writes them as GLB."""
    from rich.table import Table

    from toolkit.core.console import console
    from toolkit.core.files import write_bytes
    from toolkit.core.workspace import open_workspace
    from toolkit.objects.load import load_object

    space = open_workspace(workspace)
    rows: list[dict[str, Any]] = []
    for name, file in space.object_specs().items():
        item = load_object(file)
        rows.append(
            {
                "name": name, "class": item.spec.class_name, "mesh": item.spec.mesh,
                "size_mm": [round(float(side), 1) for side in item.mesh.size_mm],
                "triangles": len(item.mesh.faces), "patch_at": item.spec.patch.at,
            }
        )  # fmt: skip
        if export is not None:
            from toolkit.objects.export import to_glb

            write_bytes(export / f"{name}.glb", to_glb(item.mesh, name))
    if as_json:
        typer.echo(json.dumps(rows, indent=2))
        return
    table = Table("object", "class", "mesh", "size, mm (x × y × z)", "triangles", "patch")
    for row in rows:
        size = " × ".join(f"{side:g}" for side in row["size_mm"])
        table.add_row(row["name"], str(row["class"]), row["mesh"], size, f"{row['triangles']:,}", row["patch_at"])
    console.print(table)
    if export is not None:
        console.print(f"wrote {len(rows)} GLB files to {export}")
    console.print(
        f"your own: put a mesh and NAME.toml into {space.objects_dir}, then 'toolkit plan --object NAME'",
        soft_wrap=True,
    )
