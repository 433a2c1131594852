"""`toolkit train-patch`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from pydantic import Field

from toolkit.boosters.patch_config import RECIPES
from toolkit.boosters.pixel_config import AUGMENTATION, DataConfig
from toolkit.cli import options
from toolkit.cli.options import Overrides, from_config
from toolkit.cli.output import show_result, warn
from toolkit.core.config import Flag

if TYPE_CHECKING:
    from toolkit.boosters.mounted import MountedViews
    from toolkit.boosters.pixels import Network
    from toolkit.boosters.train import PreparedPatch
    from toolkit.core.workspace import Workspace


class AskedData(DataConfig):
    """The same where `--data` may be left out, because an object is named."""

    sources: Annotated[tuple[str, ...], Flag("--data", metavar="FOLDER|rig")] = Field(
        (), description=DataConfig.model_fields["sources"].description
    )


Found = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PATCH",
        help="The patch that is printed in the photographs of --data, by name or PNG: the new one takes its place.",
    ),
]

Profile = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        rich_help_panel=AUGMENTATION,
        help="In place of --print-process: your own printer, as 'toolkit print-profile' measured it.",
    ),
]


@from_config(data=AskedData, overrides=RECIPES)
def train_patch(
    *,
    object_name: Annotated[
        str | None,
        typer.Option(
            "--object",
            metavar="NAME",
            help="For this object: its class, its size and renders of it, from its spec. Default: --class and --data.",
        ),
    ] = None,
    class_name: Annotated[
        str | None,
        typer.Option("--class", metavar="NAME", help="What it should be recognised as: a label, index or WordNet id."),
    ] = None,
    data: AskedData,
    found: Found = None,
    overrides: Overrides,
    recipe: str,
    model: options.Models = None,
    weights: options.WeightFiles = None,
    print_profile: Profile = None,
    name: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="File name of the patch, without suffix. Default: the object's, else its class."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder for the patch. Default: print/patches.")
    ] = None,
    restart: Annotated[bool, typer.Option("--restart", help="Begin again; discard an unfinished run.")] = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Train a patch with which a classifier sees a class, or a detector finds its object; a stopped run goes on."""
    from toolkit.boosters.detectors import load_networks
    from toolkit.boosters.patch import train_patch as run
    from toolkit.boosters.train import prepare_patch
    from toolkit.core.workspace import open_workspace

    space = open_workspace(workspace)
    overrides = _mount(overrides) if found else overrides
    asked = prepare_patch(
        space, recipe, overrides, data, object_name=object_name, class_name=class_name, print_profile=print_profile,
        seed=seed,
    )  # fmt: skip
    if asked.misfit:
        warn(asked.misfit)
    networks = load_networks(model, weights, device, space.classifiers_dir)
    trained = run(
        asked.config, asked.class_name, networks, asked.data, space, name=name or object_name, out=out,
        restart=restart, views=_view_photos(space, asked, found, networks[0]) if found else None,
    )  # fmt: skip
    show_result(trained, as_json, trained.lines(object_name))


def _mount(overrides: Overrides) -> Overrides:
    """As in renders of an object, unless it is said."""
    share = overrides.get("mounted_share")
    return {**overrides, "mounted_share": RECIPES["default"].mounted_share if share is None else share}


def _view_photos(
    space: "Workspace", asked: "PreparedPatch", found: list[str], network: "Network"
) -> "MountedViews":  # fmt: skip
    """Where the patch goes in the photographs of `--data`; what shows none of the printed ones is listed."""
    from toolkit.core.console import list_skipped
    from toolkit.core.errors import FieldError
    from toolkit.objects.records import printed_size_mm
    from toolkit.photos.prints.fitted_photo import view_photos

    if asked.data.rig_source is not None:
        raise FieldError(
            "expected folders of photographs with {found}, and no renders", {"sources": asked.data.sources}
        )
    config, photos = asked.config, [Path(source) for source in asked.data.sources]
    views, skipped = view_photos(
        space, photos, found, size_px=config.size_px, size_mm=config.size_mm or printed_size_mm(config.size_px),
        count=config.mounted_views, image_px=network.preprocessing.resize_px, seed=config.seed, device=network.device,
    )  # fmt: skip
    list_skipped(skipped)
    return views
