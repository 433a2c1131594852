"""`toolkit studio`, `import`, `check` and `retexture`: take photographs, sort and check them, exchange patches."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.app import Quiet
from toolkit.cli.options import from_config
from toolkit.cli.output import remark, say, show_json, show_table, warn
from toolkit.core.errors import FieldError
from toolkit.core.text import count_of, list_some, quote
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.corruptions.catalogue import list_spans
from toolkit.rooms.photos.config import ImportSettings, RetextureConfig

if TYPE_CHECKING:
    from toolkit.models.network import Classifier
    from toolkit.rig import ShotListConfig
    from toolkit.rig.plan import CapturePlan
    from toolkit.rooms.photos.gates.check_captures import CheckReport
    from toolkit.rooms.photos.importing.import_photos import ImportResult
    from toolkit.rooms.photos.studio.serve import Listener
    from toolkit.rooms.photos.studio.session import Session


SHOWN_POSES = 6
SHOWN_AGAIN = 10


@from_config(settings=ImportSettings)
def import_(
    photos: Annotated[
        list[Path], typer.Argument(metavar="PHOTOS...", help="Folders, photographs or videos; they stay as they are.")
    ],
    settings: ImportSettings,
    ask: Annotated[
        bool | None,
        typer.Option(
            "--ask/--no-ask", help="Ask about photographs in doubt. Default: only at a terminal.", show_default=False
        ),
    ] = None,
    board: options.Board = None,
    patches: options.Patches = None,
    workspace: options.Workspace = None,
    quiet: Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Import photographs (JPEG, HEIC, PNG, TIFF, WebP, DNG, video): each finds its pose, none is taken twice.

    Object and variant come from the options, from folders OBJECT/VARIANT, or from the shot list that was followed.
    """
    from toolkit.rig.board_file import with_board
    from toolkit.rooms.photos.gates.check_captures import check_captures, make_check
    from toolkit.rooms.photos.importing.import_photos import import_photos

    # a person is asked only at a terminal
    space = with_board(open_workspace(workspace, is_needed=True).with_patches(patches), board)
    asking = ask if ask is not None else sys.stdin.isatty() and not (quiet or as_json)
    check = make_check(space, settings.source)
    result = import_photos(space, photos, settings, check=check, ask=ask_person if asking else None)
    # the gates of the whole set need all photographs that are there
    report = check_captures(space, settings.source) if any(row.there for row in result.coverage) else None
    if as_json:
        show_json(result.to_json() | {"gates": None if report is None else report.to_json()})
    else:
        _report_import(result, report)
    if result.refused:
        raise typer.Exit(1)


def ask_person(question: str, answers: Sequence[str]) -> str | None:
    """Put a question on stderr until the reply is among `answers`, or s or nothing to leave it out."""
    # of many poses, first and last are enough
    shown = "/".join(answers) if len(answers) <= SHOWN_POSES else f"{answers[0]}-{answers[-1]}"
    while True:
        answer = typer.prompt(f"{question} [{shown}, s to leave it out]", default="s", show_default=False, err=True)
        answer = answer.strip().lower()
        if answer in ("s", "n", "skip", "no"):
            return None
        if answer in answers:
            return answer
        typer.echo(f"'{answer}' is none of them", err=True)


def _report_import(result: "ImportResult", report: "CheckReport | None") -> None:
    """Print what was imported, what is missing or to be taken again, and what to do next."""
    rows = []
    for row in result.coverage:
        error = "" if row.mean_error_deg is None else f"{row.mean_error_deg:.1f}°, {row.mean_error_mm:.0f} mm"
        total = f"{row.there} of {row.there + len(row.missing)}"
        missing = " ".join(list_spans(row.missing))  # 1, 2, 3, 7 as "1-3 7"
        rows.append((row.object, row.variant, row.imported, total, missing, error))
    if rows:
        show_table(("object", "variant", "imported", "there", "missing poses", "mean pose error"), rows)
    # photographs that were left out, by reason
    again = (*result.duplicates, *result.before)
    for name, reason in again[:SHOWN_AGAIN]:
        warn(f"not imported again: {name}: {reason}", style="")
    if len(again) > SHOWN_AGAIN:
        warn(f"not imported again: {len(again) - SHOWN_AGAIN} more; --json lists them all", style="")
    causes: dict[str, list[str]] = {}
    for name, reason in result.refused:
        causes.setdefault(reason, []).append(name)
    for reason, names in causes.items():
        warn(f"not imported: {list_some(names, SHOWN_AGAIN)}: {reason}")
    for note in result.notes:
        remark(note)
    before = f", {len(result.before)} imported before" if result.before else ""
    skipped = f", {len(result.refused)} skipped" if result.refused else ""
    say(f"imported {count_of(len(result.imported), 'photograph')}{before}{skipped}: {result.source_dir}")
    if report is not None:
        _report_check(report, result.source_dir)
    if any(row.there for row in result.coverage):
        say(f"next: toolkit eval {quote(result.source_dir.parent)}")


def check(
    source: options.RealSource = "real",
    board: options.Board = None,
    patches: options.Patches = None,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Check photographs: sharp, well exposed, whole, right variant, patch in its place; list what to take again.

    Imported photographs were checked already; photographs sorted into captures/real by hand are checked here.
    """
    from toolkit.rig.board_file import with_board
    from toolkit.rooms.photos.gates.check_captures import check_captures

    space = with_board(open_workspace(workspace).with_patches(patches), board)
    report = check_captures(space, source)
    if as_json:
        show_json(report.to_json())
    else:
        _report_check(report, space.source_dir(source))
        say(f"next: toolkit eval {quote(space.captures_dir)}")
    if report.unreadable:
        raise typer.Exit(1)


def _report_check(report: "CheckReport", folder: Path) -> None:
    """Print what to take again and why, and what could not be checked."""
    from toolkit.rooms.photos.gates.check_captures import RETAKE_FILE

    for path, reason in report.unreadable:
        warn(f"skipped {path}: {reason}")
    for row in report.retakes:
        warn(f"retake {row.describe()}")
    for gate, reason, count in report.unchecked:
        remark(f"{gate} not checked in {count_of(count, 'photograph')}: {reason}")
    # retakes without a path are photographs that are missing
    passed = len(report.photos) - len({row.path for row in report.retakes if row.path})
    say(f"{passed} of {len(report.photos)} photographs pass every gate that was checked")
    if report.retakes:
        say(f"to take again: {folder}/{RETAKE_FILE}")


@from_config(config=RetextureConfig)
def retexture(
    *,
    photos: Annotated[
        list[Path], typer.Argument(metavar="PHOTOS...", help="Photographs of the printed patch, or folders of them.")
    ],
    config: RetextureConfig,
    check: Annotated[
        bool,
        typer.Option("--check", help="Predict true photographs of several known patches from each other, and compare."),
    ] = False,
    networks: options.NamedNetworks,
    patches: options.Patches = None,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Put another patch into photographs of a printed patch, with their paper, inks, light, lens and noise.

    With --check nothing is written: photographs whose names differ only in the patch's name are predicted from each
    other, and networks are asked whether they answer alike.
    """
    from toolkit.core.console import list_skipped
    from toolkit.evaluation.summaries import list_reasons
    from toolkit.rooms.photos.retexture import retexture as run_retexture

    space = open_workspace(workspace).with_patches(patches)
    # the check predicts known photographs, and writes none
    if check:
        _check_retexture(space, photos, config, networks, as_json)
        return
    run = run_retexture(space, photos, config)
    list_skipped(run.skipped)
    if as_json:
        show_json({
            "folder": str(run.folder), "object": run.object, "variants": list(run.variants),
            "photos": [{"name": name, **facts} for name, facts in run.photos],
            "skipped": list_reasons(run.skipped), "bare": run.bare, "paired": run.paired,
        })  # fmt: skip
    else:
        rows = [
            (name, facts["found"], f"{facts['confidence']:.2f}", f"{facts['side_px']:.0f}", f"{facts['delta_e']:.1f}",
             f"{facts['shown']:.0%}")
            for name, facts in run.photos
        ]  # fmt: skip
        show_table(("photograph", "found", "confidence", "side, px", "fit, ΔE00", "shows"), rows)
        bare = f", {run.bare} without a patch {'' if run.paired else 'not '}paired with them" if run.bare else ""
        made = f"retextured {count_of(len(run.photos), 'photograph')}{bare}"
        say(f"{made}: {run.folder / run.object}: {', '.join(run.variants)}")
        say(f"next: toolkit eval {quote(run.folder)}")
    if run.skipped:
        raise typer.Exit(1)


def _check_retexture(
    space: Workspace, photos: list[Path], config: RetextureConfig, networks: options.NamedNetworks, as_json: bool
) -> None:
    """Run and show `retexture --check`."""
    from toolkit.core.console import list_skipped
    from toolkit.models.load import load_classifiers
    from toolkit.rooms.photos.retexture import check_retexture, summarise

    classifiers = load_classifiers(*networks, space.classifiers_dir)
    found = check_retexture(space, photos, config.found, classifiers, config.seed)
    list_skipped(found.skipped)
    if as_json:
        show_json(found.to_json())
        return
    rows = []
    # how near a predicted picture is to the photograph, by texel and by the networks' answers
    for what, part in (("its own patch put back", found.own), ("from another patch's photograph", found.others)):
        short = summarise(part)
        if short["n"]:
            alike = ", ".join(f"{name} {hits} of {n}" for name, (hits, n) in short["alike"].items())
            error = f"{short['delta_e_median']:.1f} (90 % below {short['delta_e_p90']:.1f})"
            rows.append((what, str(short["n"]), error, f"{short['sharpness']:.2f}", f"{short['noise']:.2f}", alike))
    show_table(("predicted", "n", "ΔE00 by texel", "sharpness", "noise", "answered alike"), rows)
    # the scale for this: how often two photographs of the same scene agree
    for name, (hits, n) in found.same_scene.items():
        if n:
            alike, of = summarise(found.others)["alike_there"][name]
            say(f"{name}: a patch drawn again in its place, by another photograph's look: alike in {alike} of {of}")
            say(f"{name}: two photographs of the same place, grey paper in both: alike in {hits} of {n}")
    if not found.others:
        say("no two names differ only in the patch's name: name photographs as PATCH_PLACE.jpg to compare patches")


@from_config()
def studio(
    *,
    lan: Annotated[
        bool, typer.Option("--lan", help="For a phone in the same network: a URL with a token, and its QR code.")
    ] = False,
    port: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=65535, help="Default: 8765, or a free port.", show_default=False),
    ] = None,
    address: Annotated[
        str | None,
        typer.Option(
            "--lan-address", metavar="ADDRESS", help="With --lan: this machine's address. Default: found by itself."
        ),
    ] = None,
    network: options.NamedNetwork,
    source: options.RealSource = "real",
    board: options.Board = None,
    patches: options.Patches = None,
    workspace: options.Workspace = None,
    quiet: Quiet = False,
) -> None:
    """Serve a page to take the photographs with: the next shot as an outline, upload, checks, progress, predictions.

    Each photograph that you keep goes into captures/real at once; stop with Ctrl-C and start again at any time.
    """
    from toolkit.rig.board_file import with_board
    from toolkit.rooms.photos.studio import require_extra

    # imports below need the extra, whose absence is explained first
    require_extra()
    if address is not None and not lan:
        raise FieldError("this machine's address in the local network: say {lan} with it", {"address": address})
    from toolkit.rooms.photos.studio.serve import listen
    from toolkit.rooms.photos.studio.session import open_session

    space = with_board(open_workspace(workspace, is_needed=True).with_patches(patches), board)

    def load() -> "Classifier":
        from toolkit.core.console import quietly
        from toolkit.models.load import load_classifier

        with quietly():
            return load_classifier(*network, space.classifiers_dir)

    serve_session(open_session(space, source), listen(lan, port, address), load, code=lan and not quiet)


def serve_session(session: "Session", door: "Listener", load: "Callable[[], Classifier]", code: bool) -> None:
    """Serve the page until Ctrl-C; `code` shows its address as a QR code."""
    from toolkit.rooms.photos.studio.app import make_app
    from toolkit.rooms.photos.studio.predictor import Predictor
    from toolkit.rooms.photos.studio.serve import end_on_signal, make_server

    # the network loads in the background: photographs may come before it is ready
    predictor = Predictor(session, load)
    server = make_server(make_app(session, door.access, predictor))
    with end_on_signal(server), door.listener:
        show_door(door, code)
        predictor.start()
        Thread(target=warm_up, args=(session,), daemon=True).start()
        server.run(sockets=[door.listener])
        # the page is closed: what still runs in the background ends before the summary
        predictor.stop()
        session.inspector.stop()
        show_summary(session)


def show_door(door: "Listener", code: bool) -> None:
    """Print the page's address; with `code`, also as a QR code."""
    from toolkit.rooms.photos.studio.serve import show_code

    if code:
        show_code(door.url, say)
    lan = door.access.token is not None
    hint = "phone and computer must be in the same network" if lan else "for a phone: toolkit studio --lan"
    say(door.url)
    say(f"Ctrl-C ends it; {hint}")


def warm_up(session: "Session") -> None:
    """Get ready for the shot that comes next, while the page is being opened."""
    from toolkit.rooms.photos.studio.describe import find_next

    number = find_next(session.list_shots())
    if number is not None:
        session.inspector.warm_up(session.find_step(number))


def show_summary(session: "Session") -> None:
    """Print how many shots are done and what to do next."""
    shots = session.list_shots()
    done = sum(1 for shot in shots if shot.path)
    waiting = sum(1 for shot in shots if shot.status == "waiting")
    skipped = sum(1 for shot in shots if shot.status == "skipped")
    parts = [f"{done} of {len(shots)} shots are in {session.source_dir}"]
    parts += [f"{waiting} wait for a yes"] if waiting else []
    parts += [f"{skipped} put off"] if skipped else []
    say("; ".join(parts))
    if done < len(shots):
        say("run the same command again to go on")
    if done:
        say(f"next: toolkit eval {quote(session.workspace.captures_dir)}")


def make_shot_list(
    space: Workspace, plan: "CapturePlan", names: Sequence[str], config: "ShotListConfig", seed: int, as_json: bool
) -> None:
    """Write the shot list of a plan and say what was made: `toolkit plan --shot-list`."""
    from toolkit.rooms.photos.shot_list.job import write_shot_list

    made = write_shot_list(space, plan, names, config, seed)
    for name, reason in made.without_patch.items():
        warn(f"{name}: unpatched only: {reason}")
    if as_json:
        show_json(asdict(made))
        return
    if made.replaced:
        say("note: rig/shots.json was replaced; it held other shots or another order")
    for note in made.notes:
        remark(note)
    say(f"{count_of(made.shots, 'shot')} of {', '.join(made.objects)}; the camera moves {made.travel_m:.1f} m in all")
    wrote = f"wrote {made.pdf_file} ({made.pages} pages) and {made.shots_file}"
    say(f"{wrote}; next: print it, shoot in its order, then toolkit import PHOTOS/")
