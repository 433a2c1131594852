"""`toolkit demo`."""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options

BUNDLED_FILL = 0.32
"""The default plan's 0.8 at two and a half times the distance: near by, rig18 is never wrong about a bare object."""


def demo(
    folder: Annotated[Path, typer.Argument(help="Workspace to make, or to go on with.")] = Path("demo"),
    seed: options.Seed = 0,
    device: options.Device = "auto",
    quiet: options.Quiet = False,
) -> None:
    """Walk the whole road in a new workspace: plan, print, shoot 144 images, evaluate, report.

    With a ResNet-18 of ImageNet where its weights are on this machine or can be downloaded, else with the bundled
    classifier rig18 and the patches for it.
    """
    from toolkit.captures.shoot import ShootSettings, shoot_plan
    from toolkit.cli.plan import what_pairs_can_show
    from toolkit.core.console import console
    from toolkit.core.workspace import make_workspace
    from toolkit.evaluation.evaluate import evaluate_captures
    from toolkit.evaluation.tables import print_tables
    from toolkit.models.bundled import load_best
    from toolkit.models.find import BUNDLED
    from toolkit.printing.print_patches import print_all
    from toolkit.rig.plan import Pattern, open_plan

    space = make_workspace(folder)
    classifier, why = load_best(device)
    is_bundled = classifier.name == BUNDLED
    space = space.with_patches(BUNDLED if is_bundled else None)
    console.print(f"network: {classifier.describe()}: {why}", markup=False, soft_wrap=True)
    console.print(f"1/4  plan: where the camera stands ({space.plan_file})", soft_wrap=True)
    plan = open_plan(space, pattern=Pattern(fill=BUNDLED_FILL) if is_bundled else None)
    if is_bundled:
        console.print(f"     far away: {BUNDLED} knows these objects from near without a patch", soft_wrap=True)
    console.print(f"     {what_pairs_can_show(max(map(len, plan.objects.values())))}", soft_wrap=True)
    console.print(f"2/4  print: the patches as PDF pages, 250 % scale ({space.print_dir})", soft_wrap=True)
    print_all(space)
    console.print("3/4  shoot: every object at every pose, without and with its patch")
    shot = shoot_plan(space, plan, list(plan.objects), settings=ShootSettings(seed=seed))
    console.print(f"     {shot.shot} images shot, {shot.kept} kept from before ({shot.source_dir})", soft_wrap=True)
    console.print(f"4/4  evaluate: what {classifier.name} says about each image")
    result = evaluate_captures(space.captures_dir, space, classifier)
    print_tables(console, result)
    console.print(f"report: {result.report_file}", soft_wrap=True)
