"""The command line: parse, call one function, print."""

import sys

from toolkit.cli.app import make_app
from toolkit.core.errors import ToolkitError

INTERRUPTED = 130
app = make_app()


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
