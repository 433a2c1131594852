"""`toolkit landing collect`, `train`, `boost`, `fly` and `demo`: a drone, a pad, and the network between them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import say, show_json
from toolkit.core.errors import one_of
from toolkit.core.places import is_workspace
from toolkit.core.workspace import make_workspace, open_workspace
from toolkit.engine import EngineConfig
from toolkit.rooms.landing.config import RECIPES as TRAINING
from toolkit.rooms.landing.config import BoostConfig, CollectConfig, DemoConfig, FlyConfig, PadPrintConfig

if TYPE_CHECKING:
    from toolkit.rooms.landing.collect import Collected
    from toolkit.rooms.landing.flight_report import CellResult, PairResult
    from toolkit.rooms.landing.regressor import ErrorRow


@from_config(config=CollectConfig, engine=EngineConfig)
def collect(
    config: CollectConfig,
    engine: EngineConfig,
    restart: options.Restart = False,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Shoot what a drone sees of a pad into captures/landing/NAME. Interrupted runs resume."""
    from toolkit.core.console import list_skipped
    from toolkit.rooms.landing.collect import collect as run

    collected = run(open_workspace(workspace), config, seed, restart, engine)
    list_skipped(collected.failed)
    if as_json:
        about = collected.about
        show_json({
            "folder": str(collected.folder), "train": collected.count("train"), "held_out": collected.count("held_out"),
            "shards": len(about.shards), "made": collected.made, "places": about.places, "complete": about.complete,
        })  # fmt: skip
    else:
        show_collected(collected)
    if collected.failed:
        raise typer.Exit(1)


def show_collected(collected: "Collected") -> None:
    """Print what lies where, and what to do next."""
    about = collected.about
    if not about.complete:
        say(f"{collected.folder}: {collected.made} shards shot, not complete: run the same command again to resume")
        return
    say(
        f"{collected.folder}: {collected.count('train')} frames to train on, {collected.count('held_out')} held out, "
        f"{len(about.shards)} shards" + ("" if collected.made else "; all there before")
    )
    say(f"places: {len(about.places['train'])} to train on, {len(about.places['held_out'])} held out")
    say(f"next: toolkit landing train {collected.folder.name}")


@from_config(overrides=TRAINING)
def train(
    overrides: options.Overrides,
    datasets: Annotated[list[str], typer.Argument(metavar="DATASET...", help="Names in captures/landing, or folders.")],
    recipe: str,
    baselines: Annotated[
        bool, typer.Option("--baselines", help="Measure features + homography and an AprilTag on held-out frames too.")
    ] = False,
    onnx: Annotated[Path | None, typer.Option(metavar="FILE", help="Export the network as ONNX.")] = None,
    saliency: Annotated[
        Path | None,
        typer.Option(
            "--saliency-map",
            metavar="FILE",
            help="Draw what the network looks at in held-out frames of the first set, as a PNG.",
        ),
    ] = None,
    restart: options.Restart = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Train a network to find the pad in pictures. Interrupted runs resume."""
    from toolkit.rooms.landing.regressor import write_saliency
    from toolkit.rooms.landing.train import export_onnx, find_dataset, train_regressor

    if recipe not in TRAINING:
        raise one_of("recipe", recipe, list(TRAINING))
    space = open_workspace(workspace)
    config = TRAINING[recipe].with_overrides(overrides)
    folders = [find_dataset(space, word) for word in datasets]
    trained = train_regressor(space, datasets, config, seed=seed, device=device, restart=restart)
    # errors on held-out images, beside the baselines'
    rows = {trained.regressor.name: trained.regressor.record.held_out}
    if baselines:
        from toolkit.rooms.landing.baselines import measure_baselines

        for folder in folders:
            of_set = "" if len(folders) == 1 else f" on {folder.name}"
            rows |= {f"{name}{of_set}": errors for name, errors in measure_baselines(space, folder).items()}
    if onnx is not None:
        export_onnx(trained.regressor, onnx)
    shares = [] if saliency is None else write_saliency(trained.regressor, folders[0], saliency)
    if as_json:
        errors = {name: [row.model_dump() for row in some] for name, some in rows.items()}
        show_json({
            "regressor": str(trained.file), "was_finished": trained.was_finished, "resumed_from": trained.resumed_from,
            "record": trained.regressor.record.model_dump(mode="json"), "errors": errors, "saliency_on_pad": shares,
        })  # fmt: skip
        return
    done = "was trained with these inputs before" if trained.was_finished else "trained"
    say(f"{trained.file}: {done}, from {trained.regressor.record.started_from}")
    show_errors(rows)
    if onnx is not None:
        say(f"{onnx}: the network as ONNX")
    if saliency is not None:
        on_pad = ", ".join(f"{share:.0%}" for share in shares)
        say(f"{saliency}: what the network looks at; on the pad lies, from low to high, {on_pad}")
    say(f"next: toolkit landing fly {trained.regressor.name}, or toolkit landing boost {trained.regressor.name}")


def show_errors(rows: "Mapping[str, Sequence[ErrorRow]]") -> None:
    """Print the errors on held-out frames, by what they have in common."""
    from toolkit.core.console import console
    from toolkit.core.tables import build_table

    cells = [
        (
            name, row.by, row.group, str(row.n), f"{row.found / row.n:.0%}",
            "-" if row.median_cm is None else f"{row.median_cm:.1f}",
            "-" if row.rmse_cm is None else f"{row.rmse_cm:.1f}",
            "-" if row.share is None else f"{100 * row.share:.1f}",
        )
        for name, some in rows.items()
        for row in some
    ]  # fmt: skip
    heads = ("n", "found", "median cm", "rms cm", "% of height")
    console.print(build_table("Held-out error", ("regressor", "by", "frames"), heads, cells))


@from_config(config=FlyConfig, engine=EngineConfig)
def fly(
    config: FlyConfig,
    engine: EngineConfig,
    film: Annotated[
        bool,
        typer.Option(
            "--film", help="Film the first episode of the first and last cells: MP4 files, and in the report."
        ),
    ] = False,
    restart: options.Restart = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Fly landings with a regressor on every pad in every weather; write rates, tests, report to eval/landing/NAME."""
    from toolkit.core.console import list_skipped
    from toolkit.models.network import choose_device
    from toolkit.rooms.landing.flight_report import (
        describe_success,
        film_episode,
        place_results,
        write_report,
        write_summary,
    )
    from toolkit.rooms.landing.fly import fly_all
    from toolkit.rooms.worlds.depth_weather import describe_weathers

    space = open_workspace(workspace)
    flown = fly_all(space, config, seed=seed, device=choose_device(device), restart=restart, engine=engine)
    list_skipped(flown.failed)
    flown = place_results(config, flown, seed)
    results, pairs = write_summary(flown.folder, config, flown, seed)
    # an episode in clear conditions, and another in the last weather
    filmed = [results[0].records[0], *(last.records[0] for last in results[1:][-1:])] if film else []
    films = [film_episode(space, config, flown, condition, seed) for condition in filmed]
    paths = [
        made.write(flown.folder / f"episode-{condition.pad}-{condition.weather}-{condition.severity}.mp4")
        for made, condition in zip(films, filmed, strict=True)
    ]
    page = write_report(config, flown, results, pairs, space, films)
    if as_json:
        rows = {"cells": [result.as_json() for result in results], "pairs": [pair.as_json() for pair in pairs]}
        show_json(rows | {"folder": str(flown.folder), "made": flown.made, "seconds": flown.seconds})
    else:
        show_flights(results, pairs)
        for line in (describe_success(config.episode), *describe_weathers(config.weathers)):
            say(line)
        if flown.made:
            seconds = flown.seconds
            share = seconds["physics_s"] / max(seconds["whole_s"], 1e-9)
            say(f"{flown.made} episodes flown now, {seconds['whole_s']:.0f} s of work, {share:.1%} physics and control")
        for path in paths:
            say(f"film: {path}")
        say(f"report: {page}")
    if flown.failed:
        raise typer.Exit(1)


def show_flights(results: "Sequence[CellResult]", pairs: "Sequence[PairResult]") -> None:
    """Print success rates, and what changed episode by episode."""
    from toolkit.core.console import console
    from toolkit.core.tables import build_table, format_interval, format_p, format_percent
    from toolkit.rooms.landing.episodes import OUTCOMES

    # columns for the outcomes that occur, the successes aside
    ends = [name for name in OUTCOMES[1:] if any(result.count(name) for result in results)]
    rows = []
    for result in results:
        row = result.as_json()
        error = "-" if row["median_error_m"] is None else f"{row['median_error_m']:.2f}"
        shares = format_percent(result.success), format_interval(result.success_ci95)
        where = result.cell.pad, result.cell.regressor, f"{result.cell.air}, {result.cell.gains}", str(result.n)
        rows.append((*where, *shares, *(str(result.count(name)) for name in ends), error))
    heads = ("n", "success", "95 %", *(name.replace("_", " ") for name in ends), "error m")
    console.print(build_table("Landings", ("pad", "regressor", "air, gains"), heads, rows))
    if pairs:
        found = [(pair.cell.words, pair.other, pair.outcomes) for pair in pairs]
        cells = [
            (*words, str(outcomes.only_second), str(outcomes.only_first), format_p(outcomes.mcnemar_p))
            for *words, outcomes in found
        ]
        console.print(build_table("Episode by episode", ("flown", "against"), ("gained", "lost", "exact p"), cells))


@from_config(config=BoostConfig, printing=PadPrintConfig)
def boost(
    regressor: Annotated[str, typer.Argument(metavar="REGRESSOR", help="Trained by 'toolkit landing train'.")],
    config: BoostConfig,
    printing: PadPrintConfig,
    restart: options.Restart = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Train the pad's picture for a regressor, and print it at true size. Interrupted runs resume."""
    from toolkit.core.tables import build_table, format_percent
    from toolkit.models.network import choose_device
    from toolkit.rooms.landing.boost import boost_pad

    space = open_workspace(workspace)
    made = boost_pad(space, regressor, config, printing, seed=seed, device=choose_device(device), restart=restart)
    if as_json:
        show_json({
            "pad": str(made.file), "pdf": str(made.pdf), "pages": made.pages, "was_finished": made.was_finished,
            "errors": made.errors, "final": made.patch.record.final,
        })  # fmt: skip
        return
    from toolkit.core.console import console

    done = "was trained with these inputs before" if made.was_finished else "trained"
    say(f"{made.file}: {done}")
    heads = list(next(iter(made.errors.values())))
    rows = [(name, *map(format_percent, some.values())) for name, some in made.errors.items()]
    console.print(build_table("Error as a share of the height, on new views", ("pad",), heads, rows))
    say(f"{made.pdf}: {made.pages} pages at true size, with a map of them")
    name = made.file.stem
    say(f"next: toolkit landing fly {regressor} --pad plain --pad {name} --weather clear --weather fog:1-5")
    say(f"or train again on it: toolkit landing collect {name} --pad {name}, then toolkit landing train {name}")


@from_config(config=DemoConfig)
def demo(
    config: DemoConfig,
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="New workspace, or a workspace in which to resume.")
    ] = Path("landing"),
    seed: options.Seed = 0,
    device: options.Device = "auto",
) -> None:
    """Run all steps from an empty folder to the report: collect, train, boost, fly."""
    from toolkit.models.network import choose_device
    from toolkit.rooms.landing.demo import run_demo

    space = open_workspace(folder) if is_workspace(folder) else make_workspace(folder)
    made = run_demo(space, config, seed, choose_device(device))
    say(f"started from {made.trained.regressor.record.started_from}")
    show_errors({made.trained.regressor.name: made.trained.regressor.record.held_out})
    show_flights(made.results, made.pairs)
    say(f"pad: {made.boosted.file}; pages at true size: {made.boosted.pdf}")
    say(f"film: {made.film}")
    say(f"report: {made.report}")
