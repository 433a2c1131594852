"""The command line: parse, call one function, print."""

import sys

import typer

from toolkit.errors import ToolkitError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Boost physical objects for a neural network, and prove it: train, print, plan, shoot, evaluate.",
)


@app.callback()
def _root() -> None:
    pass


def main() -> None:
    """Run the command line; a `ToolkitError` becomes one line and exit code 2, Ctrl-C exit code 130."""
    from toolkit.console import errors

    try:
        app(standalone_mode=True)
    except ToolkitError as error:
        errors.print(f"error: {error}", style="red", markup=False, soft_wrap=True)
        sys.exit(2)
    except KeyboardInterrupt:
        errors.print("stopped: what is finished is kept; the same command goes on from here")
        sys.exit(130)
