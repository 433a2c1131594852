"""`toolkit add`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast, get_args

import typer

from toolkit.cli import options
from toolkit.cli.output import show_json

if TYPE_CHECKING:
    from toolkit.core.workspace import Workspace
    from toolkit.objects.load import TableObject

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
        typer.Option(metavar="X", help="Longest side of the real object; default: as a glTF says, else 200."),
    ] = None,
    print_side: Annotated[
        str, typer.Option(metavar="SIDE", help="Where its patch goes: top, front, back, left or right.")
    ] = "top",
    up: Annotated[
        str | None, typer.Option(metavar="AXIS", help=f"The mesh's axis that points up: {AXES}; default: by format.")
    ] = None,
    front: Annotated[
        str | None, typer.Option(metavar="AXIS", help="The mesh's axis that points to the front; likewise.")
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Replace the object of that name.")] = False,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Make an object of a mesh: copy it into the workspace, write its spec, draw a preview.

    Up and front are y and z for glTF, by its specification; by custom y and z for obj, z and -y for ply, stl and off.
    """
    from toolkit.core.console import console
    from toolkit.core.workspace import open_workspace
    from toolkit.objects.add import ObjectRequest, add_object
    from toolkit.objects.spec import Axis, Side

    space = open_workspace(workspace)
    for option, value, known in (("--print-side", print_side, Side), ("--up", up, Axis), ("--front", front, Axis)):
        if value is not None and value not in get_args(known):
            raise typer.BadParameter(f"expected {', '.join(get_args(known))}, found {value}", param_hint=option)
    request = ObjectRequest(
        _find_class(space, class_name), name, length_mm, cast(Side, print_side), cast(Axis | None, up),
        cast(Axis | None, front), replace,
    )  # fmt: skip
    made = add_object(space, mesh, request)
    preview, page, trouble = _draw(space, made.item, quiet or as_json)
    if as_json:
        files = [str(file) for file in made.mesh_files]
        size = [round(float(side), 1) for side in made.item.mesh.size_mm]
        result = {
            "name": made.item.name, "class": made.item.spec.class_name, "spec": str(made.spec_file), "files": files,
            "preview": str(preview), "page": str(page) if page else None, "scale": made.ask_scale(),
            "size_mm": size, "length_is_guessed": made.length_is_guessed,
        }  # fmt: skip
        show_json(result)
        return

    def say(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True)

    item = made.item
    size_mm = " × ".join(f"{side:.0f}" for side in item.mesh.size_mm)
    say(f"added {item.name}, {item.spec.class_name}: {size_mm} mm, {len(item.mesh.faces):,} triangles")
    named = ", ".join(file.name for file in made.mesh_files[1:])
    say(f"wrote {made.spec_file}; the mesh is {made.mesh_files[0]}{f' with {named}' if named else ''}")
    say(
        f"drew {preview}: its front must show at azimuth 0°, upright (else give --up and --front, with --replace); "
        f"the checks are where the patch goes"
    )
    if page is not None:
        say(f"{page}: open it in a browser to turn the object, patch and all")
    if trouble:
        say(f"note: {trouble}")
    if (asked := made.ask_scale()) is not None:
        say(f"note: {asked}: measure the longest side and set length_mm in {made.spec_file.name}")
    say(f"next: toolkit plan --object {item.name}, then toolkit train-patch --object {item.name}")


def _find_class(space: "Workspace", given: str) -> str:
    """The label that is meant, as it is spelt, from a name in any case or an index."""
    from toolkit.core.errors import ToolkitError
    from toolkit.models.architectures import imagenet_labels
    from toolkit.models.find import list_own
    from toolkit.models.labels import index_of_label, read_labels_file

    for weights in list_own(space.classifiers_dir).values():
        labels = read_labels_file(weights).labels or []
        if given in labels:
            return given
    labels = imagenet_labels()
    try:
        return labels[index_of_label(labels, given)]
    except ToolkitError as error:
        raise ToolkitError(
            f"--class: {error} (ImageNet's names count, and the labels of the classifiers in {space.classifiers_dir})"
        ) from None


def _draw(space: "Workspace", item: "TableObject", quiet: bool) -> tuple[Path, Path | None, str]:
    """Draw the object with a chequered sheet for its patch: from eight sides, and as a page to turn it.

    Returns:
        The picture, the page, None for a mesh too large for one, and what is wrong with the sheet's place.
    """
    from dataclasses import replace

    import numpy as np

    from toolkit.captures.shoot import ShootSettings, studio_for
    from toolkit.core.console import progress
    from toolkit.core.errors import ToolkitError
    from toolkit.core.files import write_bytes, write_text
    from toolkit.objects.add import DEFAULT_PATCH_MM
    from toolkit.objects.turntable import make_turntable
    from toolkit.rig.camera import Camera
    from toolkit.rig.fit import describe_misfits
    from toolkit.rig.mount import attach, mount_sheets
    from toolkit.rig.pattern import Pattern
    from toolkit.rig.plan import plan_poses
    from toolkit.rig.preview import draw_contact_sheet

    checks = np.where(np.indices((8, 8)).sum(0)[..., None] % 2, [40, 90, 200], [250, 250, 250]).astype(np.uint8)
    shown, trouble = item, ""
    try:
        sizes_mm = item.spec.sizes_mm(DEFAULT_PATCH_MM)
        trouble = "; ".join(describe_misfits(item, sizes_mm))
        sheets = mount_sheets(item.mesh, checks, item.spec.mounts, sizes_mm, item.name)
        shown = replace(item, mesh=attach(item.mesh, *sheets))
    except ToolkitError as error:
        trouble = f"no place for the patch yet: {error}"
    camera = Camera.from_fov()
    poses = plan_poses(item, camera, Pattern(name="grid", count=8, elevation_deg=(20.0, 60.0)))
    file = space.root / "rig" / "preview" / f"{item.name}-sheet.png"
    with progress("drawing the preview", 1, quiet) as bar:
        write_bytes(file, draw_contact_sheet(shown, camera, poses, studio_for(item, ShootSettings()), columns=4))
        bar.advance()
    long = max(float(side) for side in item.mesh.size_mm)
    words = f"{item.name}, {item.spec.class_name}: {long:.0f} mm long; the patch goes where the checks are. Drag it."
    html = make_turntable(shown.mesh, item.name, words)
    page = None if html is None else write_text(file.with_name(f"{item.name}.html"), html)
    return file, page, trouble
