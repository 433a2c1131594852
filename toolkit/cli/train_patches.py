"""`toolkit train-patches`."""

from typing import Annotated

import typer

from toolkit.boosters.patch_config import RECIPES
from toolkit.boosters.patch_sets import ASKED_OF_FLAT, ClassPatchesConfig, make_flat_config
from toolkit.boosters.transforms.placement import Placement
from toolkit.cli import options
from toolkit.cli.options import Only, Overrides, from_config
from toolkit.cli.output import show_result
from toolkit.engine.config import EngineConfig


@from_config(
    config=ClassPatchesConfig, placement=Placement, overrides=Only(RECIPES, ASKED_OF_FLAT), engine=EngineConfig
)
def train_patches(
    *,
    data: Annotated[
        str,
        typer.Option(
            metavar="FOLDER",
            help="Folder with one folder per class (train/ in it, where there is one), or cifar10:FOLDER.",
        ),
    ],
    config: ClassPatchesConfig,
    placement: Placement,
    engine: EngineConfig,
    classes: Annotated[
        list[str] | None,
        typer.Option("--class", metavar="NAME", help="Label, index or WordNet id; default: all that have images."),
    ] = None,
    model: Annotated[
        str | None, typer.Option("--model", metavar="NAME", help="The classifier. Default: resnet18.")
    ] = None,
    weights: options.WeightsFile = None,
    overrides: Overrides,
    recipe: str,
    download: options.Download = False,
    restart: Annotated[bool, typer.Option("--restart", help="Begin again; discard what an earlier run made.")] = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Train a patch for each of many classes, to be laid on images; a stopped run goes on where it was."""
    from toolkit.boosters.class_patches import train_class_patches
    from toolkit.core.console import quietly
    from toolkit.core.workspace import open_workspace
    from toolkit.models.load import load_classifier
    from toolkit.training.images import choose_classes, open_images

    space = open_workspace(workspace)
    classifier = load_classifier(model, weights, device, space.classifiers_dir)
    found = open_images(data, classifier, "train", download)
    chosen = choose_classes(found, classes or [], classifier).classes
    config = config.with_overrides(seed=seed)
    patch = make_flat_config(recipe, overrides, placement, config)
    with quietly(as_json):
        made = train_class_patches(config, patch, found, chosen, classifier, space, restart=restart, engine=engine)
    flags = {"--model": model, "--weights": weights}
    typed = [f"{flag} {value}" for flag, value in flags.items() if value is not None]
    words = " ".join(["toolkit corrupt-eval --data", data, *typed, *(f"--patches {name}" for name in made.sets)])
    show_result(made, as_json, [*made.lines(), f"next: {words}"])
