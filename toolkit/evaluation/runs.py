"""The runs of a workspace: what each found, as rows of one table, whatever experiment made it."""

from dataclasses import dataclass
from pathlib import Path

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.workspace import Workspace
from toolkit.evaluation.summaries import SUMMARY, Kind, ResultRow, read_rows

PREDICTIONS, DETECTIONS = "predictions.csv", "detections.csv"


@dataclass(frozen=True)
class Run:
    """One run's folder.

    Attributes:
        name: its path below `eval/`.
        folder: where it is.
        kind: which experiment made it.
        rows: what it found.
    """

    name: str
    folder: Path
    kind: Kind
    rows: tuple[ResultRow, ...]

    @property
    def has_predictions(self) -> bool:
        """Whether it says what was answered image by image."""
        return any((self.folder / name).is_file() for name in (PREDICTIONS, DETECTIONS))


def find_runs(workspace: Workspace) -> tuple[list[Run], list[tuple[str, str]]]:
    """Every run below the workspace's `eval/`, by name, and (path, reason) of each that cannot be read."""
    runs, refused = [], []
    for name in _list_names(workspace.eval_dir):
        try:
            runs.append(open_run(workspace, name))
        except ToolkitError as error:
            refused.append((name, str(error)))
    return runs, refused


def open_run(workspace: Workspace, name: str | Path) -> Run:
    """A run by its name below `eval/`, or by its folder.

    Raises:
        ToolkitError: there is none of that name, or its `summary.json` is damaged, of a newer toolkit or of another
            program.
    """
    folder = workspace.eval_dir / name
    if not folder.is_dir():
        folder = Path(name)
    if not folder.is_dir():
        known = _list_names(workspace.eval_dir)
        if not known:
            raise ToolkitError(f"{workspace.eval_dir} holds no run: make one with 'toolkit eval'")
        raise one_of("run", str(name), known)
    file = folder / SUMMARY
    if not file.is_file():
        raise ToolkitError(f"{folder} is no finished run: it holds no {SUMMARY}")
    home, place = workspace.eval_dir.resolve(), folder.resolve()
    shown = place.relative_to(home).as_posix() if place.is_relative_to(home) else str(name)
    kind, rows = read_rows(file, shown)
    return Run(shown, folder, kind, tuple(rows))


def _list_names(eval_dir: Path) -> list[str]:
    found = sorted(file.parent for file in eval_dir.rglob(SUMMARY) if file.is_file())
    return [folder.relative_to(eval_dir).as_posix() for folder in found if folder != eval_dir]
