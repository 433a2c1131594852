"""`toolkit train-patch`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.boosters.data import DataConfig
from toolkit.boosters.patch_config import RECIPES, make_config, use_printer
from toolkit.boosters.pixel_config import MEETS
from toolkit.cli import options
from toolkit.cli.options import Overrides, from_config
from toolkit.cli.output import show_json

if TYPE_CHECKING:
    from toolkit.boosters.patch import TrainedPatch


@from_config(data=DataConfig, overrides=RECIPES)
def train_patch(
    class_name: Annotated[
        str,
        typer.Option("--class", metavar="NAME", help="What it shall be recognised as: a label, index or WordNet id."),
    ],
    data: DataConfig,
    overrides: Overrides,
    recipe: str,
    model: options.Models = None,
    weights: options.WeightFiles = None,
    print_profile: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            rich_help_panel=MEETS,
            help="In place of --print-process: your own printer, as 'toolkit print-profile' measured it.",
        ),
    ] = None,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="File name of the patch, without suffix. Default: its class.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FOLDER", help="For the patch. Default: print/patches.")] = None,
    restart: Annotated[bool, typer.Option("--restart", help="Begin anew, forget an unfinished run.")] = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Train a patch that makes a classifier see a class; an interrupted run goes on where it stopped."""
    from toolkit.boosters.patch import train_patch as run
    from toolkit.core.workspace import open_workspace
    from toolkit.models.load import load_classifiers

    if print_profile is not None:
        overrides = use_printer(overrides, print_profile)
    data = data.with_overrides(seed=seed)
    config = make_config(recipe, {**overrides, "seed": seed}, data)
    place = open_workspace(workspace)
    networks = load_classifiers(model, weights, device, place.classifiers_dir)
    trained = run(config, class_name, networks, data, place, name=name, out=out, restart=restart)
    _report(trained, as_json)
    if trained.skipped:
        raise typer.Exit(1)


def _report(trained: "TrainedPatch", as_json: bool) -> None:
    from toolkit.core.console import console, list_skipped
    from toolkit.imaging.printer import PrintScores

    list_skipped(trained.skipped)
    record = trained.patch.record
    if as_json:
        result = {
            "patch": str(trained.files.png),
            "preview": str(trained.files.preview),
            "was_finished": trained.was_finished,
            "resumed_from": trained.resumed_from,
            "skipped": [{"path": path, "reason": reason} for path, reason in trained.skipped],
            "record": record.model_dump(),
        }
        show_json(result)
        return

    def tell(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True)

    if trained.was_finished:
        tell(f"{trained.files.png} was trained with these inputs before: nothing to do; --restart trains it again")
    else:
        tell(f"{trained.files.png}: {record.n_px} px, {record.size_mm:.0f} mm on paper at 250 %")
        tell(f"{trained.files.preview}: the patch on training images")
        tell(PrintScores(record.final["total_variation"], record.final["non_printability"]).describe(record.name))
        where = "held-out images" if record.data["held_out"] else "its training images"
        for answer in trained.validations:
            tell(f"{answer.network} on {where}: {answer.patched} with the patch, {answer.bare} bare")
            share = record.final.get(f"{answer.network}_corrupted_patched_top1")
            if share is not None:
                bare = record.final[f"{answer.network}_corrupted_bare_top1"]
                tell(f"{answer.network} on them corrupted: {share:.0%} with the patch, {bare:.0%} bare")
        for answer in trained.on_object:
            where = f"{answer.network} on the object, held-out views"
            tell(f"{where}: {answer.patched} with it, {answer.bare} with grey paper")
    tell(f"next: toolkit print --class {record.name}, toolkit capture-sim")
