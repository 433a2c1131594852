"""The runs of a workspace: what each found, as rows of one table; which of them are meant."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

from toolkit.captures.read import POOLED
from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.tables import NONE, build_table, format_interval, format_p, format_percent
from toolkit.core.workspace import Workspace
from toolkit.evaluation.summaries import CLEAR, SUMMARY, Kind, ResultRow, read_rows

if TYPE_CHECKING:
    from rich.table import Table

PREDICTIONS, DETECTIONS = "predictions.csv", "detections.csv"
OPERATORS = ("!=", ">=", "<=", "=", ">", "<")
NUMBERS = ("severity", "n", "failed", "share", "gained", "lost", "p")
FIELDS = tuple(name for name in ResultRow.__dataclass_fields__ if name not in ("ci95", "has_pooled"))
ALIASES: Mapping[str, str] = {
    "weather": "condition", "corruption": "condition", "model": "network",
    "top1": "share", "success": "share", "found": "share",
}  # fmt: skip


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
        raise ToolkitError(f"{folder} is not a finished run: it has no {SUMMARY}")
    home, place = workspace.eval_dir.resolve(), folder.resolve()
    shown = place.relative_to(home).as_posix() if place.is_relative_to(home) else str(name)
    kind, rows = read_rows(file, shown)
    return Run(shown, folder, kind, tuple(rows))


def _list_names(eval_dir: Path) -> list[str]:
    found = sorted(file.parent for file in eval_dir.rglob(SUMMARY) if file.is_file())
    return [folder.relative_to(eval_dir).as_posix() for folder in found if folder != eval_dir]


@dataclass(frozen=True)
class Where:
    """What a row must be: `object=racer`, `share>=0.5`, `run=resnet*`."""

    field: str
    operator: str
    value: str

    def is_met(self, row: ResultRow) -> bool:
        """Whether the row is so; a field that it lacks meets `!=` alone."""
        found = getattr(row, self.field)
        if self.operator in ("=", "!="):
            # as people type it: 0.5
            text = f"{found:g}" if isinstance(found, float) else str(found)
            return (found is not None and fnmatchcase(text, self.value)) == (self.operator == "=")
        if found is None:
            return False
        number = float(self.value)
        return {">": found > number, ">=": found >= number, "<": found < number, "<=": found <= number}[self.operator]


def parse_where(text: str) -> Where:
    """`FIELD=VALUE`, with `*` and `?` in VALUE, or `FIELD!=VALUE`; of numbers also `>`, `>=`, `<` and `<=`.

    `weather` and `corruption` mean the field `condition`, `model` means `network`, `top1` and `success` mean `share`.

    Raises:
        ToolkitError: there is no such field, or it cannot be compared so.
    """
    found = [one for one in OPERATORS if one in text]
    if not found:
        raise ToolkitError(f"'{text}' is not a condition: expected FIELD=VALUE, such as object=racer or p<0.05")
    # the first in the text, and of two that begin there the longer: `>=` before `>`
    operator = min(found, key=lambda one: (text.index(one), -len(one)))
    name, _, value = (part.strip() for part in text.partition(operator))
    field = ALIASES.get(name, name)
    if field not in FIELDS:
        raise one_of("field of a run", name, [*FIELDS, *ALIASES])
    if operator not in ("=", "!=") and not (field in NUMBERS and _is_number(value)):
        raise ToolkitError(f"'{text}' is not a condition: {operator} compares numbers: {', '.join(NUMBERS)}")
    # rows say `clear` where the benchmark's files say `clean`
    return Where(field, operator, CLEAR if (field, value) == ("condition", "clean") else value)


def _is_number(text: str) -> bool:
    try:
        # NaN is not equal to itself
        return float(text) == float(text)
    except ValueError:
        return False


def pick_rows(rows: Sequence[ResultRow], wanted: Sequence[Where] = (), everything: bool = False) -> list[ResultRow]:
    """The rows that are as wanted in every way.

    Args:
        rows: of any runs.
        wanted: from `parse_where`.
        everything: also the rows that are parts of other rows (one object of all, one corruption of a mean); else
            those are there only where `wanted` names what they are a part by.
    """
    named = {one.field for one in wanted}
    shown = [row for row in rows if everything or row.details <= named]
    return [row for row in shown if all(one.is_met(row) for one in wanted)]


def describe_condition(row: ResultRow) -> str:
    """`clear`, `fog 3`, `mean of corruptions`."""
    return f"{row.condition} {row.severity}" if row.severity else row.condition


def build_runs_table(rows: Sequence[ResultRow]) -> "Table":
    """A line for each row; columns that say nothing, or what the run's name says, are left out."""
    columns = {
        "run": [row.run for row in rows],
        "network": ["" if row.network in row.run else row.network for row in rows],
        "source": ["" if row.kind == "benchmark" and row.source in row.run else row.source for row in rows],
        "object": ["" if row.object == POOLED else row.object for row in rows],
        "world": ["/".join(part for part in (row.world, row.place) if part) for row in rows],
        "condition": ["" if row.condition == CLEAR else describe_condition(row) for row in rows],
        "variant": [row.variant for row in rows],
    }
    texts = {name: cells for name, cells in columns.items() if any(cells)}
    cells = [[*(own[at] for own in texts.values()), *_format_numbers(row)] for at, row in enumerate(rows)]
    return build_table("", tuple(texts), ("n", "right % (95 %)", "+/−", "p"), cells)


def _format_numbers(row: ResultRow) -> list[str]:
    n = NONE if row.n is None else str(row.n)
    right = f"{format_percent(row.share)} ({format_interval(row.ci95)})" if row.ci95 else format_percent(row.share)
    return [n, right, "" if row.gained is None else f"{row.gained}/{row.lost}", format_p(row.p)]
