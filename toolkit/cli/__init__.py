"""The command line: parse, call one function, print."""

import sys
from collections.abc import Callable

import typer

from toolkit.cli.add import add
from toolkit.cli.baseline import baseline
from toolkit.cli.calibrate import calibrate
from toolkit.cli.capture_sim import capture_sim
from toolkit.cli.check import check
from toolkit.cli.corrupt import corrupt
from toolkit.cli.corrupt_eval import corrupt_eval
from toolkit.cli.demo import demo
from toolkit.cli.eval_ import evaluate
from toolkit.cli.health import doctor
from toolkit.cli.import_ import import_
from toolkit.cli.init import init
from toolkit.cli.objects import list_objects
from toolkit.cli.plan import plan
from toolkit.cli.print_ import print_patches
from toolkit.cli.print_profile import print_profile
from toolkit.cli.studio import studio
from toolkit.cli.sweep import sweep
from toolkit.cli.train_classifier import train_classifier
from toolkit.cli.train_patch import train_patch
from toolkit.cli.train_patches import train_patches
from toolkit.cli.train_texture import train_texture
from toolkit.core.errors import ToolkitError

INTERRUPTED = 130
app = typer.Typer(
    no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Boost physical objects for a neural network, and prove it: train, print, plan, shoot, evaluate.",
)  # fmt: skip
COMMANDS: dict[str, Callable[..., None]] = {
    "demo": demo,
    "init": init,
    "add": add,
    "doctor": doctor,
    "objects": list_objects,
    "train-classifier": train_classifier,
    "train-patch": train_patch,
    "train-patches": train_patches,
    "baseline": baseline,
    "train-texture": train_texture,
    "print": print_patches,
    "print-profile": print_profile,
    "plan": plan,
    "calibrate": calibrate,
    "capture-sim": capture_sim,
    "import": import_,
    "check": check,
    "studio": studio,
    "eval": evaluate,
    "corrupt": corrupt,
    "corrupt-eval": corrupt_eval,
    "sweep": sweep,
}
for name, command in COMMANDS.items():
    app.command(name)(command)


def main() -> None:
    """Run the command line; a `ToolkitError` becomes one line and exit code 2, Ctrl-C exit code 130."""
    from toolkit.core.console import errors

    try:
        app()
    except ToolkitError as error:
        errors.print(f"error: {error}", style="red", markup=False, soft_wrap=True)
        sys.exit(2)
    except SystemExit as ended:
        if ended.code == INTERRUPTED:  # Typer has turned the interrupt into this
            errors.print("stopped: what is finished is kept; the same command goes on from here")
        raise
