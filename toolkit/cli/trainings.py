"""Commands that train: patches, textures, classifiers."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from pydantic import Field

from toolkit.boosters.patch_config import RECIPES as PATCH_RECIPES
from toolkit.boosters.pixel_config import DataConfig
from toolkit.boosters.texture_config import RECIPES as TEXTURE_RECIPES
from toolkit.boosters.texture_config import make_config as make_texture_config
from toolkit.cli import options
from toolkit.cli.options import Overrides, from_config
from toolkit.cli.output import show_result, warn
from toolkit.core.child import count_cores
from toolkit.core.config import Flag
from toolkit.core.errors import FieldError
from toolkit.core.rooms import ask_room
from toolkit.core.text import quote
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.training.classifier_config import ClassifierConfig
from toolkit.training.refine_config import RefineConfig

if TYPE_CHECKING:
    from toolkit.boosters.mounted import MountedViews
    from toolkit.boosters.pixels import Network
    from toolkit.boosters.train import PreparedPatch
    from toolkit.models.find import HeldOut
    from toolkit.training.classifier import TrainedClassifier


class AskedData(DataConfig):
    """Training data that may be left out, because an object is named."""

    sources: Annotated[tuple[str, ...], Flag("--data", metavar="FOLDER|rig")] = Field(
        (), description=DataConfig.model_fields["sources"].description
    )


FOUND = "Printed patch in the photographs of --data, by name or PNG; the new patch takes its place."


@from_config(data=AskedData, overrides=PATCH_RECIPES)
def train_patch(
    *,
    object_name: Annotated[
        str | None,
        typer.Option(
            "--object",
            metavar="NAME",
            help="Object with its class, patch size and renders, from its spec. Default: --class and --data.",
        ),
    ] = None,
    class_name: Annotated[
        str | None,
        typer.Option("--class", metavar="NAME", help="Class to be predicted: a label, index or WordNet id."),
    ] = None,
    data: AskedData,
    found: Annotated[list[str] | None, typer.Option(metavar="PATCH", help=FOUND)] = None,
    overrides: Overrides,
    recipe: str,
    networks: options.NamedNetworks,
    print_profile: options.PrintProfile = None,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="File name, without suffix. Default: the object's, or its class.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Default: print/patches.")] = None,
    restart: options.Restart = False,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    verbose: options.Verbose = False,
    as_json: options.Json = False,
) -> None:
    """Train a patch that makes a classifier predict a class, or a detector find an object. Interrupted runs resume."""
    from toolkit.boosters.detectors import load_networks
    from toolkit.boosters.patch import train_patch as run
    from toolkit.boosters.train import prepare_patch

    space = open_workspace(workspace)
    # photographs show the patch in place, as renders of an object do
    if found and overrides.get("mounted_share") is None:
        overrides = {**overrides, "mounted_share": PATCH_RECIPES["default"].mounted_share}
    asked = prepare_patch(
        space, recipe, overrides, data, object_name=object_name, class_name=class_name, print_profile=print_profile,
        seed=seed,
    )  # fmt: skip
    if asked.misfit:
        warn(asked.misfit)
    # networks load last: bad settings fail at once
    loaded = load_networks(*networks, space.classifiers_dir)
    trained = run(
        asked.config, asked.class_name, loaded, asked.data, space, name=name or object_name, out=out,
        restart=restart, views=_view_photos(space, asked, found, loaded[0]) if found else None,
    )  # fmt: skip
    show_result(trained, as_json, trained.lines(object_name))


def _view_photos(space: Workspace, asked: "PreparedPatch", found: list[str], network: "Network") -> "MountedViews":
    """Find the printed patch in the photographs of `--data`; list photographs without it as skipped."""
    from toolkit.core.console import list_skipped
    from toolkit.objects.records import printed_size_mm

    # renders know where their patch is; only photographs are searched for it
    if asked.data.rig_source is not None:
        raise FieldError(
            "expected folders of photographs with {found}, and no renders", {"sources": asked.data.sources}
        )
    config, photos = asked.config, [Path(source) for source in asked.data.sources]
    # the room of photographs finds the patch, and makes views for training of them
    views, skipped = ask_room("found patches")(
        space, photos, found, size_px=config.size_px, size_mm=config.size_mm or printed_size_mm(config.size_px),
        count=config.mounted_views, image_px=network.preprocessing.resize_px, seed=config.seed, device=network.device,
    )  # fmt: skip
    list_skipped(skipped)
    return views


@from_config(overrides=TEXTURE_RECIPES)
def train_texture(
    *,
    overrides: Overrides,
    recipe: str,
    class_name: options.TrueClass = None,
    networks: options.NamedNetworks,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="File name, without suffix. Default: the object's, or its class.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Default: rig/textures.")] = None,
    workers: options.RenderThreads = None,
    restart: options.Restart = False,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    verbose: options.Verbose = False,
    as_json: options.Json = False,
) -> None:
    """Train a texture that makes a network predict an object's class. Interrupted runs resume."""
    from toolkit.boosters.detectors import load_networks
    from toolkit.boosters.texture import train_texture as run

    config = make_texture_config(recipe, {**overrides, "seed": seed})
    place = open_workspace(workspace)
    loaded = load_networks(*networks, place.classifiers_dir)
    trained = run(config, loaded, place, class_name=class_name, name=name, out=out, restart=restart, workers=workers)
    show_result(trained, as_json)


@from_config(config=ClassifierConfig)
def train_classifier(
    config: ClassifierConfig,
    patches: Annotated[
        str | None, typer.Option(metavar="SET", help="Put the patch of its class from this set on every image.")
    ] = None,
    download: options.Download = False,
    workers: options.RenderProcesses = None,
    out: options.ClassifierFolder = None,
    keep_data: Annotated[
        bool, typer.Option("--keep-data", help="Keep the rendered images, for another training under this name.")
    ] = False,
    restart: options.Restart = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Train a classifier of your own classes, from renders or images. Interrupted runs resume."""
    from toolkit.training.classifier import train_classifier as run

    space = open_workspace(workspace)
    # the core trains without patches; a room puts them on images
    pictures = None if patches is None else ask_room("patches in training")(space, patches)
    trained = run(
        config.with_overrides(seed=seed), space, pictures, out=out, device=device,
        workers=workers or count_cores(), download=download, restart=restart, keep_data=keep_data,
    )  # fmt: skip
    show_result(trained, as_json, describe_classifier(trained, out))


def describe_classifier(trained: "TrainedClassifier", out: Path | None) -> Iterator[str]:
    """Yield what was made, its accuracy, and the next commands."""
    record = trained.record
    yield from trained.lines()
    yield from describe_held_out(record.held_out)
    model = f"--model {record.name if out is None else quote(trained.file)}"
    yield (
        f"next: toolkit eval captures/ {model}, and to train its patches "
        f"toolkit train-patch {model} --class CLASS --data rig --out print/patches/{record.name}"
    )


def describe_held_out(held_out: "HeldOut") -> list[str]:
    """Return lines: accuracy with its interval, the weakest classes and the commonest mistakes."""
    if not held_out.n:
        return ["held-out images: none, so the accuracy is not known"]
    low, high = held_out.ci95
    lines = [
        f"held-out images: {held_out.correct} of {held_out.n} correct ({held_out.correct / held_out.n:.1%}, 95 % "
        f"interval {low:.1%} to {high:.1%}); {held_out.what}"
    ]
    if (hit := held_out.under_attack) is not None:
        low, high = hit.ci95
        lines.append(
            f"under attack ({hit.norm} {hit.eps:.4g}, {hit.steps} steps): {hit.correct} of {hit.n} correct "
            f"({hit.accuracy:.1%}, {low:.1%} to {high:.1%})"
        )
    # classes with the lowest accuracy first
    shares = sorted((tally.correct / tally.n, label) for label, tally in held_out.per_class.items() if tally.n)
    if shares[0][0] < 1:
        lines.append("weakest classes: " + ", ".join(f"{label} {share:.0%}" for share, label in shares[:5]))
        lines.append(
            "commonest mistakes: "
            + ", ".join(f"{true} taken for {answer} ({count})" for true, answer, count in held_out.confusions[:5])
        )
    return lines


@from_config(config=RefineConfig)
def refine_network(
    *,
    config: RefineConfig,
    network: options.NamedNetwork,
    out: options.ClassifierFolder = None,
    restart: options.Restart = False,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Refine a network by its own predictions, so that boosters for it transfer better. Interrupted runs resume."""
    from toolkit.models.load import load_classifier
    from toolkit.training.refine import refine_network as run

    space = open_workspace(workspace)
    teacher = load_classifier(*network, space.classifiers_dir)
    made = run(config.with_overrides(seed=seed), space, teacher, out=out, restart=restart)
    show_result(made, as_json)
