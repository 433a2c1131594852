"""`toolkit objects` and `toolkit demo`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from toolkit.cli import options
from toolkit.cli.output import say, show_json, show_table

BUNDLED_FILL = 0.32
"""The default plan's 0.8 at two and a half times the distance: near by, rig18 is never wrong about a bare object."""


def list_objects(
    export: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Write every object as a GLB into this folder.")
    ] = None,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """List the objects that can be photographed, built in and your own; --export writes them as GLB."""
    from toolkit.core.files import write_bytes
    from toolkit.core.workspace import open_workspace
    from toolkit.objects.load import load_object

    space = open_workspace(workspace)
    rows: list[dict[str, Any]] = []
    for name, file in space.object_specs().items():
        item = load_object(file)
        sides = [mount.at for mount in item.spec.mounts]
        rows.append(
            {
                "name": name, "class": item.spec.class_name, "mesh": item.spec.mesh,
                "size_mm": [round(float(side), 1) for side in item.mesh.size_mm],
                "triangles": len(item.mesh.faces), "patch_at": sides[0] if len(sides) == 1 else sides,
            }
        )  # fmt: skip
        if export is not None:
            from toolkit.objects.export_mesh import to_glb

            write_bytes(export / f"{name}.glb", to_glb(item.mesh, name))
    if as_json:
        show_json(rows)
        return
    cells = []
    for row in rows:
        size = " × ".join(f"{side:g}" for side in row["size_mm"])
        at = row["patch_at"] if isinstance(row["patch_at"], str) else ", ".join(row["patch_at"])
        cells.append((row["name"], row["class"], row["mesh"], size, f"{row['triangles']:,}", at))
    show_table(("object", "class", "mesh", "size, mm (x × y × z)", "triangles", "patch"), cells)
    if export is not None:
        say(f"wrote {len(rows)} GLB files to {export}")
    say("your own: 'toolkit add MESH --class NAME', then 'toolkit plan --object NAME'")


def demo(
    folder: Annotated[Path, typer.Argument(help="Workspace to make, or to go on with.")] = Path("demo"),
    seed: options.Seed = 0,
    device: options.Device = "auto",
    quiet: options.Quiet = False,
) -> None:
    """Run every step in a new workspace: plan, print, shoot 144 images, evaluate, report.

    With a ResNet-18 of ImageNet where its weights are on this machine or can be downloaded, else with the bundled
    classifier rig18 and the patches for it.
    """
    from toolkit.captures.shoot import ShootSettings, shoot_plan
    from toolkit.cli.plan import what_pairs_can_show
    from toolkit.core.console import console
    from toolkit.core.workspace import make_workspace
    from toolkit.evaluation.evaluate import evaluate_captures
    from toolkit.evaluation.tables import print_tables
    from toolkit.models.find import BUNDLED
    from toolkit.models.load import load_best
    from toolkit.printing.print_patches import print_all
    from toolkit.rig.plan import open_plan
    from toolkit.rig.requests import Pattern

    space = make_workspace(folder)
    classifier, why = load_best(device)
    is_bundled = classifier.name == BUNDLED
    space = space.with_patches(BUNDLED if is_bundled else None)
    say(f"network: {classifier.describe()}: {why}")
    say(f"1/4  plan: where the camera stands ({space.plan_file})")
    plan = open_plan(space, pattern=Pattern(fill=BUNDLED_FILL) if is_bundled else None)
    if is_bundled:
        say(f"     far away: {BUNDLED} recognises these objects from near without a patch")
    say(f"     {what_pairs_can_show(max(map(len, plan.objects.values())))}")
    say(f"2/4  print: the patches as PDF pages, 250 % scale ({space.print_dir})")
    print_all(space)
    say("3/4  shoot: every object at every pose, without and with its patch")
    shot = shoot_plan(space, plan, list(plan.objects), settings=ShootSettings(seed=seed))
    say(f"     {shot.shot} images shot, {shot.kept} kept from before ({shot.source_dir})")
    say(f"4/4  evaluate: what {classifier.name} says about each image")
    result = evaluate_captures(space.captures_dir, space, classifier)
    print_tables(console, result)
    say(f"report: {result.report_file}")
