"""`toolkit world-eval`: is the object recognised in a city, through fog and dust?"""

from typing import TYPE_CHECKING

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import remark, say
from toolkit.core.text import kept_before
from toolkit.engine.config import EngineConfig
from toolkit.experiments.worlds.world_config import WorldEvalConfig

if TYPE_CHECKING:
    from toolkit.experiments.worlds.world_run import WorldRun


@from_config(config=WorldEvalConfig, engine=EngineConfig)
def world_eval(
    *,
    config: WorldEvalConfig,
    engine: EngineConfig,
    model: options.Model = None,
    weights: options.WeightsFile = None,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Render an object in a world from a grid of cameras, in weather, and classify the pictures.

    Results go to eval/RUN. An answer is computed once, whatever run asks for it.
    """
    from toolkit.core.console import list_skipped
    from toolkit.core.workspace import open_workspace
    from toolkit.experiments.worlds.world_run import evaluate_world
    from toolkit.models.load import load_classifier

    space = open_workspace(workspace)
    classifier = load_classifier(model, weights, device, folder=space.classifiers_dir)
    done = evaluate_world(space, classifier, config, engine)
    list_skipped(done.failed)
    if as_json:
        typer.echo(done.files.summary.read_text(encoding="utf-8"))
    else:
        show_world(done)
    if done.failed:
        raise typer.Exit(1)


def show_world(done: "WorldRun") -> None:
    """Print the weathers in numbers, the cameras, the table, the result in words, and where the report is."""
    from toolkit.core.console import console
    from toolkit.core.files import load_json
    from toolkit.experiments.worlds.world_results import build_world_table, judge_world
    from toolkit.worlds.depth_weather import describe_weathers

    summary = load_json(done.files.summary)
    for line in describe_weathers(done.results.weathers):
        say(line)
    cameras = summary["cameras"][-1]
    left_out = ", ".join(f"{count} {key.partition(': ')[2]}" for key, count in cameras.items() if "left out" in key)
    say(
        f"{cameras['points']} points of the grid: {cameras['standing']} can hold a camera"
        f"{f' (left out: {left_out})' if left_out else ''}; {cameras['shot']} shot, {cameras['in_view']} with the "
        f"object in view, {cameras['hidden']} with it hidden"
    )
    console.print(build_world_table(summary))
    for verdict in judge_world(summary):
        say(verdict.sentence)
    for note in summary["notes"]:
        remark(note)
    say(f"{done.computed} answers{kept_before(done.kept)}; table, figures and report: {done.files.report}")
