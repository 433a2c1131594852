"""`toolkit baseline`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.boosters.baselines.baseline_config import FIXED_PATTERN, NEED_DATA, BaselineConfig
from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import show_json

if TYPE_CHECKING:
    from toolkit.boosters.baselines.make import MadeBaseline


@from_config(config=BaselineConfig)
def baseline(
    config: BaselineConfig,
    model: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Classifier whose classes they are; best-image compares its losses. Default: resnet18."
        ),
    ] = None,
    weights: Annotated[
        Path | None,
        typer.Option(
            "--weights", metavar="FILE", help="State dict, .pth, .ckpt or .safetensors; FILE.json may hold its labels."
        ),
    ] = None,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Make what patches are compared with: codes, training images or noise as pictures, one for each class."""
    from toolkit.boosters.baselines.make import make_baseline
    from toolkit.core.workspace import open_workspace
    from toolkit.models.load import load_classifier

    place = open_workspace(workspace)
    classifier = load_classifier(model, weights, device, place.classifiers_dir)
    made = make_baseline(config.with_overrides(seed=seed), classifier, place)
    _report(made, config.kind, config.data, as_json)
    if made.skipped:
        raise typer.Exit(1)


def _report(made: "MadeBaseline", kind: str, data: str | None, as_json: bool) -> None:
    from dataclasses import asdict

    from toolkit.core.console import console, list_skipped

    list_skipped(made.skipped)
    if as_json:
        sets = [asdict(one) | {"folder": str(one.folder)} for one in made.sets]
        skipped = [{"path": path, "reason": reason} for path, reason in made.skipped]
        show_json({"sets": sets, "skipped": skipped})
        return

    def tell(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True)

    for one in made.sets:
        if one.made:
            before = f", {one.found} made before" if one.found else ""
            tell(f"{one.folder}: {one.made} {'picture' if one.made == 1 else 'pictures'} of {one.size_px} px{before}")
        elif one.found:
            tell(f"{one.folder}: its {one.found} pictures were made from these inputs before: nothing to do")
        else:
            tell(f"{one.folder}: nothing made")
    names = [one.name for one in made.sets if one.made or one.found]
    if names:
        command = "train-classifier" if kind == FIXED_PATTERN else "corrupt-eval"
        others = kind in NEED_DATA
        where = "FOLDER" if others or data is None else data
        why = ": FOLDER with other images than these were chosen from" if others else ""
        tell(f"next: toolkit {command} --data {where} --patches {names[0]}{why}")
