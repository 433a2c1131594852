"""Tables, pages made from them, and the figures of a finished workspace: python docs/scripts/make.py [WORKSPACE]."""

import sys
from pathlib import Path

from figures import draw_figures
from findings import write_pages
from plots import main as draw_plots
from tables import DOCS, write_evaluation_tables, write_record_tables

from toolkit.core.workspace import open_workspace


def main(folder: str | None = None, run: str = "resnet18") -> None:
    """Write docs/results/*.csv, and the pages with numbers from them.

    Args:
        folder: a workspace in which `run-results` has run, for figures and evaluations; without it, both stay as they
            are, and only the tables are written that come from records in the repository.
        run: the evaluation that the figures show.
    """
    space = open_workspace(Path(folder) if folder else DOCS.parent)
    if folder:
        draw_figures(space, DOCS / "figures", run)
        write_evaluation_tables(space)
    write_record_tables(space)
    draw_plots()
    write_pages()


if __name__ == "__main__":
    main(*sys.argv[1:])
