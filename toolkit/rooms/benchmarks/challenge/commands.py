"""`toolkit challenge init`, `check`, `run` and `board`: enter a booster, check, score and rank entries."""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import say, show_json, show_table, warn
from toolkit.core.text import count_of, quote
from toolkit.core.workspace import open_workspace
from toolkit.engine import EngineConfig
from toolkit.rooms.benchmarks.challenge import JUDGES, EntryConfig

EntryFolder = Annotated[Path, typer.Argument(metavar="ENTRY", help="Folder of the entry.")]


@from_config(config=EntryConfig)
def init(
    entry: EntryFolder, *, config: EntryConfig, patches: options.Patches = None,
    workspace: options.Workspace = None, as_json: options.Json = False,
) -> None:  # fmt: skip
    """Make an entry from this workspace's boosters: their files, and an entry.json for you to complete."""
    from toolkit.rooms.benchmarks.challenge.entry import ENTRY, init_entry

    made = init_entry(open_workspace(workspace).with_patches(patches), entry, config)
    if as_json:
        show_json({"folder": str(made.folder), "objects": list(made.objects), "networks": len(made.record.networks)})
        return
    say(f"{made.folder}: {len(made.objects)} boosters, trained on {len(made.record.networks)} networks")
    say(f"next: write authors and method into {made.folder / ENTRY}; toolkit challenge check {quote(made.folder)}")


def check(
    entry: EntryFolder,
    again: Annotated[bool, typer.Option("--rescore", help="Compute its score again from its own files.")] = False,
    as_json: options.Json = False,
) -> None:
    """Check an entry against every rule, a line for each fault; nothing is changed."""
    from toolkit.rooms.benchmarks.challenge.entry import check_entry, list_score_folders
    from toolkit.rooms.benchmarks.challenge.score import check_scores, rescore

    # an entry that cannot be read is a single fault
    scores = [rescore(place) for place in list_score_folders(entry) or [entry]] if again else [check_scores(entry)]
    faults = list(dict.fromkeys(sum(scores, check_entry(entry))))
    if as_json:
        show_json({"entry": str(entry), "faults": faults})
    else:
        for fault in faults:
            warn(fault)
        found = count_of(len(faults), "fault") if faults else f"no fault; next: toolkit challenge run {quote(entry)}"
        say(f"{entry}: {found}")
    if faults:
        raise typer.Exit(1)


@from_config(engine=EngineConfig)
def run(
    entry: EntryFolder,
    *,
    engine: EngineConfig,
    judge: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Network that judges; repeat for more. Default: the division's."),
    ] = None,
    controls: Annotated[bool, typer.Option(help="Noise, grey and wrong boosters beside it.")] = True,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Render an entry and score it: score/score.json, outcomes.csv and a page in its folder."""
    from toolkit.core.console import console
    from toolkit.core.tables import format_points, format_points_interval
    from toolkit.models.load import load_classifier
    from toolkit.rooms.benchmarks.challenge.board import write_board
    from toolkit.rooms.benchmarks.challenge.entry import read_entry
    from toolkit.rooms.benchmarks.challenge.score import CONDITIONS, SCORE, build_score_table, run_entry

    space = open_workspace(workspace)
    read = read_entry(entry)
    networks = [load_classifier(name, None, device, space.classifiers_dir) for name in judge or JUDGES]
    with engine.open() as workers:
        judged = run_entry(read, networks, space, workers, with_controls=controls)
    score = judged.score
    # a board of this entry alone: the page to look at before others join
    page = judged.folder / "page"
    write_board([judged.folder], page)
    if as_json:
        show_json(score.model_dump(mode="json"))
        return
    console.print(build_score_table(score))
    if score.rank_gain is None:
        warn("every judge is a network that the entry was trained on, so it has no rank")
    else:
        interval = format_points_interval(score.rank_ci95)
        points = format_points(score.rank_gain) + (f" (95 % {interval})" if interval else "")
        say(f"gain on unseen networks, mean of {len(CONDITIONS)} conditions: {points} points")
    say(f"score: {judged.folder}; page: {page / 'index.html'}")
    # other judges have a folder of their own, which the board must be told
    shown = entry if judged.folder.name == SCORE else judged.folder
    say(f"next: toolkit challenge board {quote(shown)} OTHERS… --out FOLDER")


def board(
    entries: Annotated[list[Path], typer.Argument(metavar="ENTRY…", help="Folders of entries that were scored.")],
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder of the leaderboard.")] = Path("challenge"),
    renderers: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FOLDER",
            help="Evaluation of images by several renderers, such as eval/RUN: the board says whether the gain of an "
            "entry holds in each. Repeat for more.",
        ),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Rank entries: write index.html, board.csv and a JSON file for each score that agrees with its own files."""
    from toolkit.core.console import list_skipped
    from toolkit.core.tables import format_p, format_points, format_points_interval
    from toolkit.rooms.benchmarks.challenge.board import write_board

    places, refused = write_board(entries, out, renderers or ())
    list_skipped(refused)
    rows = [place.as_json() for place in places]
    if as_json:
        show_json(rows)
    else:
        show_table(("rank", "entry", "budget", "gain", "95 %", "p to next"), [
            (
                row["rank"] or "–", row["entry"], row["budget"],
                "–" if row["rank_gain"] is None else format_points(row["rank_gain"]),
                format_points_interval(place.score.rank_ci95), format_p(row["p_next"]),
            )
            for row, place in zip(rows, places, strict=True)
        ])  # fmt: skip
        say(f"page: {out / 'index.html'}")
    if refused:
        raise typer.Exit(1)
