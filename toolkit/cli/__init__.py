"""The command line: parse, call one function, print."""

import os
import sys

import typer

from toolkit.cli.app import UsageError, explain_usage, make_app
from toolkit.core.errors import ToolkitError

INTERRUPTED = 130
app = make_app()


def main() -> None:
    """Run the command line; what cannot be used becomes one line and exit code 2, Ctrl-C exit code 130."""
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # it would look into every installed package for some
    try:
        code = app(standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except (ToolkitError, UsageError) as error:
        from toolkit.core.console import errors

        if type(error).__name__ == "NoArgsIsHelpError":  # its message is the help
            typer.echo(error, err=True)
        else:
            line = error if isinstance(error, ToolkitError) else explain_usage(error, sys.argv[1:])
            errors.print(f"error: {line}", style="red", markup=False, soft_wrap=True)
        code = 2
    if code == INTERRUPTED:
        typer.echo("stopped: what is finished is kept; the same command goes on from here", err=True)
    sys.exit(code)
