"""`toolkit capture-sim`."""

from typing import Annotated

import typer

from toolkit.cli import options


def capture_sim(
    objects: Annotated[
        list[str] | None, typer.Option("--object", help="Object to shoot; repeat for more. Default: all in the plan.")
    ] = None,
    variants: Annotated[
        list[str] | None,
        typer.Option(
            "--variant",
            help="unpatched, patched, wrong-patch, random-patch, grey-patch or patch-alone; repeat for more. "
            "Default: unpatched and patched.",
        ),
    ] = None,
    backdrop: Annotated[
        str | None, typer.Option(help="Table top: oak, walnut, white, concrete, linen, slate, birch. Default: by seed.")
    ] = None,
    light: Annotated[str, typer.Option(help="studio, side, warm or dim.")] = "studio",
    renderer: Annotated[str, typer.Option(help="raycast or filament.")] = "raycast",
    image_format: Annotated[str, typer.Option("--format", help="jpg or png.")] = "jpg",
    source: Annotated[
        str | None, typer.Option(help="Folder below captures/. Default: sim, or sim-PATCHES with --patches.")
    ] = None,
    patches: options.Patches = None,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Shoot every object at every pose of the plan, unpatched and patched, in the virtual rig."""
    import json

    from toolkit.captures.shoot import ShootSettings, shoot_plan
    from toolkit.captures.variants import PAIR
    from toolkit.console import console, errors
    from toolkit.rig.plan import open_plan
    from toolkit.workspace import open_workspace

    space = open_workspace(workspace).with_patches(patches)
    plan = open_plan(space, objects)
    settings = ShootSettings(seed, backdrop, light, renderer, image_format)
    source = source or (f"sim-{patches}" if patches else "sim")
    result = shoot_plan(
        space, plan, objects or list(plan.objects), variants or PAIR, settings, source, quiet or as_json
    )  # fmt: skip
    if result.stale:
        errors.print(
            f"note: {len(result.stale)} images are not of this plan and were left in {result.source_dir} "
            f"(first: {result.stale[0]}); 'toolkit eval' counts them: delete them if you do not want that",
            soft_wrap=True,
        )
    if as_json:
        typer.echo(json.dumps({"folder": str(result.source_dir), "shot": result.shot, "kept": result.kept}))
        return
    kept = f", {result.kept} kept from before" if result.kept else ""
    console.print(f"shot {result.shot} images{kept}: {result.source_dir}", soft_wrap=True)
    console.print(f"next: toolkit eval {space.captures_dir}", soft_wrap=True)
