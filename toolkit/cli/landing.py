"""`toolkit landing collect`, `train`, `boost`, `fly` and `demo`: a drone, a pad, and the network between them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import say, show_json
from toolkit.landing.collect import CollectConfig
from toolkit.landing.train import RECIPES as TRAINING

if TYPE_CHECKING:
    from toolkit.landing.regressor import ErrorRow

Restart = Annotated[bool, typer.Option("--restart", help="Begin anew, forget an unfinished run.")]


@from_config(config=CollectConfig)
def collect(
    config: CollectConfig,
    restart: Restart = False,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Shoot what a drone sees of a pad into captures/landing/NAME; an interrupted run goes on where it stopped."""
    from toolkit.core.workspace import open_workspace
    from toolkit.landing.collect import collect as run
    from toolkit.landing.collect import describe_collected

    collected = run(open_workspace(workspace), config, seed, restart)
    if as_json:
        show_json(describe_collected(collected))
        return
    about = collected.about
    say(
        f"{collected.folder}: {collected.count('train')} frames to train on, {collected.count('held_out')} held out, "
        f"{len(about.shards)} shards" + ("" if collected.made else "; all there before")
    )
    say(f"places: {len(about.places['train'])} to train on, {len(about.places['held_out'])} held out")
    say(f"next: toolkit landing train {collected.folder.name}")


@from_config(overrides=TRAINING)
def train(
    overrides: options.Overrides,
    dataset: Annotated[str, typer.Argument(metavar="DATASET", help="Name below captures/landing, or its folder.")],
    recipe: str,
    baselines: Annotated[
        bool, typer.Option("--baselines", help="Measure features + homography and an AprilTag on held-out frames too.")
    ] = False,
    onnx: Annotated[Path | None, typer.Option(metavar="FILE", help="Export the network as ONNX.")] = None,
    restart: Restart = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Train a network to say where the pad is; an interrupted run goes on where it stopped."""
    from toolkit.core.errors import one_of
    from toolkit.core.workspace import open_workspace
    from toolkit.landing.train import describe_trained, export_onnx, find_dataset, train_regressor

    if recipe not in TRAINING:
        raise one_of("recipe", recipe, list(TRAINING))
    space = open_workspace(workspace)
    config = TRAINING[recipe].with_overrides(overrides)
    trained = train_regressor(space, dataset, config, seed=seed, device=device, restart=restart)
    rows = {trained.regressor.name: trained.regressor.record.held_out}
    if baselines:
        from toolkit.landing.compare import measure_baselines

        rows |= measure_baselines(space, find_dataset(space, dataset))
    if onnx is not None:
        export_onnx(trained.regressor, onnx)
    if as_json:
        errors = {name: [row.model_dump() for row in some] for name, some in rows.items()}
        show_json(describe_trained(trained) | {"errors": errors})
        return
    done = "was trained with these inputs before" if trained.was_finished else "trained"
    say(f"{trained.file}: {done}, from {trained.regressor.record.started_from}")
    show_errors(rows)
    if onnx is not None:
        say(f"{onnx}: the network as ONNX")
    say(f"next: toolkit landing fly {trained.regressor.name}, or toolkit landing boost {trained.regressor.name}")


def show_errors(rows: "Mapping[str, Sequence[ErrorRow]]") -> None:
    """Print the errors on held-out frames, by what they have in common."""
    from toolkit.core.console import console
    from toolkit.core.tables import build_table, format_percent

    cells = [
        (
            name, row.by, row.group, str(row.n), f"{row.found / row.n:.0%}",
            "-" if row.median_cm is None else f"{row.median_cm:.1f}",
            "-" if row.rmse_cm is None else f"{row.rmse_cm:.1f}", format_percent(row.share),
        )
        for name, some in rows.items()
        for row in some
    ]  # fmt: skip
    heads = ("n", "found", "median cm", "rms cm", "of height")
    console.print(build_table("Held-out error", ("regressor", "by", "frames"), heads, cells))
