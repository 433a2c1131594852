"""`toolkit landing collect`, `train`, `boost`, `fly` and `demo`: a drone, a pad, and the network between them."""

from typing import Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import say, show_json
from toolkit.landing.collect import CollectConfig

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
