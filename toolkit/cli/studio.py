"""`toolkit studio`: a web page to photograph with."""

from threading import Thread
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.app import Quiet
from toolkit.cli.output import say
from toolkit.core.errors import FieldError

if TYPE_CHECKING:
    from toolkit.models.network import Classifier
    from toolkit.studio.serve import Listener
    from toolkit.studio.session import Session


def studio(
    lan: Annotated[
        bool, typer.Option("--lan", help="For a phone in the same network: a URL with a token, and its QR code.")
    ] = False,
    port: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Default: 8765, or a free one.", show_default=False)
    ] = None,
    address: Annotated[
        str | None,
        typer.Option(
            "--lan-address",
            metavar="ADDRESS",
            help="With --lan: this machine's address there. Default: the kit finds it.",
        ),
    ] = None,
    model: options.Model = None,
    weights: options.WeightsFile = None,
    source: options.RealSource = "real",
    device: options.Device = "auto",
    board: options.Board = None,
    patches: options.Patches = None,
    workspace: options.Workspace = None,
    quiet: Quiet = False,
) -> None:
    """Serve a page to take the photographs with: the next shot as an outline, upload, checks, progress, predictions.

    Each photograph that you keep goes into captures/real at once; stop with Ctrl-C and start again at any time.
    """
    from toolkit.core.workspace import open_workspace
    from toolkit.rig.board_file import with_board
    from toolkit.studio.serve import listen, require_extra

    require_extra()
    if address is not None and not lan:
        raise FieldError("this machine's address in the local network: say {lan} with it", {"address": address})
    from toolkit.studio.app import make_app
    from toolkit.studio.predictor import Predictor
    from toolkit.studio.serve import end_on_signal, make_server
    from toolkit.studio.session import open_session

    space = with_board(open_workspace(workspace, is_needed=True).with_patches(patches), board)
    session = open_session(space, source)

    def load() -> "Classifier":
        from toolkit.core.console import quietly
        from toolkit.models.load import load_classifier

        with quietly():
            return load_classifier(model, weights, device, space.classifiers_dir)

    door = listen(lan, port, address)
    predictor = Predictor(session, load)
    server = make_server(make_app(session, door.access, predictor))
    with end_on_signal(server), door.listener:
        show_door(door, lan and not quiet)
        predictor.start()
        Thread(target=warm_up, args=(session,), daemon=True).start()
        server.run(sockets=[door.listener])
        predictor.stop()
        session.inspector.stop()
        show_summary(session)


def show_door(door: "Listener", code: bool) -> None:
    """Say where the page is; with `code`, also as a QR code."""
    from toolkit.studio.serve import show_code

    if code:
        show_code(door.url, say)
    lan = door.access.token is not None
    hint = "phone and computer must be in one network" if lan else "for a phone: toolkit studio --lan"
    say(door.url)
    say(f"Ctrl-C ends it; {hint}")


def warm_up(session: "Session") -> None:
    """Get ready for the shot that comes next, while the page is being opened."""
    from toolkit.studio.describe import find_next

    number = find_next(session.list_shots())
    if number is not None:
        session.inspector.warm_up(session.find_step(number))


def show_summary(session: "Session") -> None:
    """Say what is there and what to do next."""
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
        say(f"next: toolkit eval {session.workspace.captures_dir}")
