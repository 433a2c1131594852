"""`toolkit train-patch`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from pydantic import Field

from toolkit.boosters.data import DataConfig
from toolkit.boosters.patch_config import RECIPES, limit_renders, make_config, size_by_spec, use_printer
from toolkit.boosters.pixel_config import MEETS
from toolkit.cli import options
from toolkit.cli.options import Overrides, from_config
from toolkit.cli.output import show_json, warn
from toolkit.core.config import Flag
from toolkit.core.errors import FieldError

if TYPE_CHECKING:
    from toolkit.boosters.patch import TrainedPatch


class AskedData(DataConfig):
    """The same where `--data` may be left out, because an object is named."""

    sources: Annotated[tuple[str, ...], Flag("--data", metavar="FOLDER|rig")] = Field(
        (), description=DataConfig.model_fields["sources"].description
    )


@from_config(data=AskedData, overrides=RECIPES)
def train_patch(
    *,
    context: typer.Context,
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
        typer.Option("--class", metavar="NAME", help="What it shall be recognised as: a label, index or WordNet id."),
    ] = None,
    data: AskedData,
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
        str | None,
        typer.Option(
            metavar="NAME", help="File name of the patch, without suffix. Default: the object's, else its class."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FOLDER", help="For the patch. Default: print/patches.")] = None,
    restart: Annotated[bool, typer.Option("--restart", help="Begin anew, forget an unfinished run.")] = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Train a patch that makes a classifier see a class, or a detector find its object; goes on where it stopped."""
    from toolkit.boosters.detectors import load_networks
    from toolkit.boosters.patch import train_patch as run
    from toolkit.core.workspace import open_workspace
    from toolkit.objects.spec import read_spec

    if print_profile is not None:
        overrides = use_printer(overrides, print_profile)
    place = None
    sources = data.sources
    wanted: str | int | None = class_name
    if object_name is not None:
        place = open_workspace(workspace)
        spec = read_spec(place.object_spec(object_name))
        wanted, name = (spec.class_name if class_name is None else class_name), name or object_name
        sources = sources if data.rig_source else (*sources, f"rig:{object_name}")
        overrides = size_by_spec(overrides, spec)
        asked_mm = overrides.get("size_mm")
        others_mm = [f"{one.size_mm:g}" for one in spec.mounts if one.size_mm not in (None, asked_mm)]
        if asked_mm and others_mm:
            warn(
                f"{object_name}: trained for {asked_mm:g} mm, but the rig mounts its patch at "
                f"{' and '.join(others_mm)} mm: set size_mm under [patch] in its spec"
            )
    if wanted is None:
        raise FieldError("{class_name} is missing: name it, or the object with {object_name}", {})
    if not sources:
        raise FieldError("{sources} is missing: expected a folder of images, or 'rig' for renders of the object", {})
    images = DataConfig(sources=sources, backgrounds=data.backgrounds, images=data.images, seed=seed)
    config = make_config(recipe, {**overrides, "seed": seed}, images)
    if images.rig_source is not None:
        fewer_views, fewer_images = limit_renders(config, images)
        config = config if _is_typed(context, "mounted_views") else fewer_views
        images = images if _is_typed(context, "images") else fewer_images
    place = place or open_workspace(workspace)
    networks = load_networks(model, weights, device, place.classifiers_dir)
    trained = run(config, wanted, networks, images, place, name=name, out=out, restart=restart)
    _report(trained, object_name, as_json)
    if trained.skipped:
        raise typer.Exit(1)


def _is_typed(context: typer.Context, option: str) -> bool:
    source = context.get_parameter_source(option)
    return source is not None and source.name != "DEFAULT"


def _report(trained: "TrainedPatch", object_name: str | None, as_json: bool) -> None:
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
        tell(f"{trained.files.png}: {record.n_px} px, {record.size_mm:.0f} mm on paper")
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
            share = record.final.get(f"{answer.network}_mounted_weather_patched_top1")
            if share is not None:
                grey = record.final[f"{answer.network}_mounted_weather_bare_top1"]
                tell(f"{where} in its weather: {share:.0%} with it, {grey:.0%} with grey paper")
        if any(answer.falls_short for answer in trained.on_object):
            warn(
                "note: on the object it is no sure gain over grey paper: before you print it, try a larger sheet or "
                "another place ('toolkit place'), more --steps, or paint all of the object ('toolkit train-texture')"
            )
    if object_name is not None:
        tell(f"next: toolkit print --object {object_name}, toolkit capture-sim --object {object_name}")
    else:
        tell(f"next: toolkit print --class {record.name}, toolkit capture-sim")
