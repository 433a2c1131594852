"""`toolkit`, and `python -m toolkit`."""
# ruff: noqa: PTH100, PTH109, PTH120

import gc
import os
import sys


def main() -> None:
    """Run the command line."""
    try:
        _leave_current_folder()
        from toolkit.cli import main as run_command_line

        run_command_line()
    except KeyboardInterrupt:  # before the command line could answer it
        sys.exit(130)
    finally:
        # Python's end looks for garbage among all objects of all libraries, several times; these two print what is left
        if sys.modules.keys().isdisjoint(("triton", "drjit")):
            gc.freeze()


def _leave_current_folder() -> None:
    """Import nothing from the current folder from here on, nor let the processes of libraries do so.

    `-m` and an empty entry of PYTHONPATH, such as `PYTHONPATH=$PYTHONPATH:/mine` makes, put it before Python's own
    modules. What Python itself loaded before this line may be from there: `toolkit`, without such an entry, loads none.
    """
    try:  # without pathlib, which is not loaded yet
        here = os.getcwd()
    except OSError:  # it was deleted, and holds nothing
        return
    if here == os.path.dirname(os.path.dirname(os.path.abspath(__file__))):  # a source tree that was not installed
        return
    library = os.path.dirname(os.__file__)
    first = sys.path.index(library) if library in sys.path else len(sys.path)
    sys.path[:first] = [place for place in sys.path[:first] if os.path.abspath(place) != here]
    given = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    kept = [place for place in given if os.path.abspath(place) != here]
    os.environ |= {"PYTHONPATH": os.pathsep.join(kept), "PYTHONSAFEPATH": "1"}


if __name__ == "__main__":
    main()
