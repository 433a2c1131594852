"""Runs: the `summary.json` of every experiment, all rows as a table, and filters of rows."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from math import isnan
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError
from rich.table import Table

from toolkit.captures.capture import UNPATCHED
from toolkit.captures.read import POOLED
from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import explain_validation, load_json, walk_folders
from toolkit.core.statistics import Interval
from toolkit.core.tables import NONE, build_table, format_interval, format_p, format_percent
from toolkit.core.workspace import Workspace
from toolkit.evaluation.run_files import DETECTIONS, PREDICTIONS, SUMMARY, check_run
from toolkit.models.identity import describe_network
from toolkit.models.network import AnyNetwork, Classifier

SCHEMA_VERSION = 1
"""Newest version of `summary.json` that is read here."""
CLEAR, MEAN = "clear", "mean of corruptions"
"""Condition of uncorrupted images, and of a mean over several conditions."""
Content = TypeVar("Content", bound=BaseModel)
Kind = Literal["eval", "detection", "world-eval", "sweep", "benchmark", "landing"]
KINDS: tuple[Kind, ...] = get_args(Kind)
Metric = Literal["top1", "success", "found"]
METRICS: Mapping[str, Metric] = {"detection": "found", "landing": "success"}
SOURCES = {"landing": "flights"}
"""Source of the rows of a kind without a source in its summary."""


@dataclass(frozen=True)
class ResultRow:
    """A group of images, or of landings, in a run.

    Attributes:
        run: path of the run's folder below `eval/`.
        source: source of the images; in a sweep the value, in a benchmark the data set.
        object: name of the object; `all` for pooled rows.
        variant: booster on the object; the pad of landings.
        condition: weather or corruption, or `clear`.
        severity: severity of the condition, 0 without; None for a mean.
        world, place: world and place, or place `all`; None without a world.
        n, failed: number of images classified, and of images that could not be read; None for a mean of shares.
        metric: meaning of `share`: correct, landed, or found by a detector.
        share, ci95: share and its 95 % interval; None without images.
        gained, lost, p: changed pairs against `unpatched` (for landings the first pad), and the exact McNemar test;
            None without pairs.
        n_pairs, n_bare: number of pairs, and of correct `unpatched` images in them; None in older summaries.
        has_pooled: whether there is a pooled row that this row is a part of.
        is_part: whether some images, with or without the booster, are in no pair.
        network_id: hash of architecture, weights, labels and preprocessing; empty in older summaries.
    """

    run: str
    kind: Kind
    network: str
    source: str
    object: str
    variant: str
    condition: str = CLEAR
    severity: int | None = 0
    world: str | None = None
    place: str | None = None
    n: int | None = None
    failed: int = 0
    metric: Metric = "top1"
    share: float | None = None
    ci95: Interval | None = None
    gained: int | None = None
    lost: int | None = None
    p: float | None = None
    has_pooled: bool = True
    network_id: str = ""
    n_pairs: int | None = None
    n_bare: int | None = None
    is_part: bool = False

    @property
    def details(self) -> set[str]:
        """Fields in which the row is a part of another row; it is shown if a filter names them."""
        found = {"object"} if self.object != POOLED and self.has_pooled else set()
        if self.place not in (None, POOLED):
            found.add("place")
        if self.kind == "benchmark" and self.condition not in (CLEAR, MEAN):
            found.add("condition")
        return found

    def as_json(self) -> dict[str, Any]:
        """Return the fields as `toolkit runs --json` prints them."""
        fields = {key: value for key, value in vars(self).items() if key not in ("has_pooled", "is_part")}
        return fields | {"ci95": None if self.ci95 is None else list(self.ci95)}


def begin_summary(kind: str, network: AnyNetwork) -> dict[str, Any]:
    """Return the first fields of every summary."""
    model = describe_network(network)
    if isinstance(network, Classifier):
        model["description"] = network.describe()
    return {"schema_version": SCHEMA_VERSION, "kind": kind, "model": model}


def list_reasons(items: Sequence[tuple[str, str]]) -> list[dict[str, str]]:
    """Return (path, reason) pairs as summaries hold them."""
    return [{"path": path, "reason": reason} for path, reason in items]


Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0)]


class _Part(BaseModel):
    """A part of a summary; other fields are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class _Where(_Part):
    """Fields of `ResultRow`, by any name that a kind of summary has for them."""

    network: str = Field("", validation_alias=AliasChoices("answerer", "regressor"))
    source: str = ""
    object: str = POOLED
    variant: str = Field("", validation_alias=AliasChoices("variant", "pad"))
    world: str | None = None
    place: str | None = None
    condition: str | None = Field(None, validation_alias=AliasChoices("weather", "corruption"))
    severity: Count | None = None
    gains: str | None = Field(None, exclude=True)

    @property
    def key(self) -> tuple[str | int | None, ...]:
        """Key of a row and its pair."""
        return tuple(getattr(self, name) for name in _Where.model_fields)

    @property
    def key_without_variant(self) -> tuple[str | int | None, ...]:
        """Key of all variants of the same images."""
        return tuple(getattr(self, name) for name in _Where.model_fields if name != "variant")

    @property
    def name(self) -> str:
        """Name of a cell in the pairs of landings."""
        air = f"{self.condition}:{self.severity}" if self.severity else self.condition
        return "/".join(map(str, (self.variant, self.network, self.world, air, self.gains)))


class _Mean(_Where):
    variant: str = Field(validation_alias=AliasChoices("variant", "pad"))
    share: Share | None = Field(validation_alias=AliasChoices("top1", "success", "found"))
    ci95: tuple[Share, Share] | None = Field(validation_alias=AliasChoices("top1_ci95", "success_ci95", "found_ci95"))


class _Group(_Mean):
    n: Count
    failed: Count = 0
    gained: Count | None = None
    lost: Count | None = None
    p: Share | None = Field(None, validation_alias="mcnemar_p")


class _Pair(_Where):
    """A variant against `unpatched`; for landings a cell against another."""

    cell: str = ""
    against: str = ""
    gained: Count
    lost: Count
    p: Share = Field(validation_alias="mcnemar_p")
    n_pairs: Count | None = None
    n_bare: Count | None = Field(None, validation_alias="n_first")

    @property
    def is_of_variants(self) -> bool:
        """Whether the two differ in the variant alone; for landings, in the pad."""
        # cells are named pad/regressor/world/air: everything after the pad must be equal
        return self.cell.partition("/")[2] == self.against.partition("/")[2]


class _Corrupted(_Part):
    source: str
    corruption: str
    severity: Count


class RunNetwork(_Part):
    """Network of a run; fields that an older summary lacks are empty."""

    name: str = ""
    arch: str = ""
    sha256: str | None = ""
    labels_sha256: str = ""
    preprocessing: str | None = ""
    network_id: str = ""


UNKNOWN = RunNetwork()


class _About(_Part):
    data: str = ""
    model: RunNetwork = RunNetwork()


class _Summary(_Part):
    """A summary of any kind: it has groups, or cells."""

    model: RunNetwork = RunNetwork()
    about: _About = _About()
    groups: list[_Group] = []
    cells: list[_Group] = []
    means: list[_Mean] = Field([], validation_alias="variants")
    pairs: list[_Pair] = []
    corrupted: list[_Corrupted] = []

    @property
    def network(self) -> RunNetwork:
        """Network of the run, which benchmarks keep in `about`."""
        return self.model if self.model.name or self.model.arch else self.about.model


def name_kind(content: Mapping[str, Any], run: str) -> str:
    """Return the kind of a summary; for an older summary without this field, by its content and folder."""
    said, groups = content.get("kind"), content.get("groups")
    if said is not None:
        return "detection" if said == "detections" else str(said)
    if "cells" in content:
        return "benchmark" if "variants" in content else "landing"
    if isinstance(groups, list) and any("weather" in group for group in groups if isinstance(group, dict)):
        return "world-eval"
    return "sweep" if run.startswith("sweeps/") else "eval"


def load_summary(folder: Path) -> dict[str, Any]:
    """Return the content of a run's `summary.json`.

    Raises:
        ToolkitError: the file is missing, of a newer toolkit or of another program, or it or a table of the run was
            changed afterwards.
    """
    file = folder / SUMMARY
    content = load_json(file)
    version = content.get("schema_version") if isinstance(content, dict) else None
    # True is an int in Python
    if not isinstance(version, int) or isinstance(version, bool):
        raise ToolkitError(f"{file} is not a result of toolkit: expected a schema_version in it")
    if version > SCHEMA_VERSION:
        raise ToolkitError(
            f"{file} was written by a newer toolkit (schema_version {version}, expected at most {SCHEMA_VERSION}): "
            "update toolkit"
        )
    # files of the run must be unchanged
    check_run(folder, content)
    return content


def validate_summary(folder: Path, content: Mapping[str, Any], model: type[Content]) -> Content:
    """Return the fields that a model names in `load_summary`; a `ToolkitError` if they are damaged."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise ToolkitError(f"{folder / SUMMARY} is damaged ({explain_validation(error)}): make the run again") from None


def read_run(folder: Path, name: str) -> "Run":
    """Return a run from its `summary.json`; a `ToolkitError` as `load_summary`, or if the file is damaged."""
    file, content = folder / SUMMARY, load_summary(folder)
    if "groups" not in content and "cells" not in content:
        raise ToolkitError(f"{file} is not a result of toolkit: expected groups or cells in it")
    said = name_kind(content, name)
    kind = next((known for known in KINDS if known == said), None)
    if kind is None:
        raise ToolkitError(f"{file} has an unknown kind {said!r}: expected one of {', '.join(KINDS)}: update toolkit")
    found = validate_summary(folder, content, _Summary)
    return Run(name, folder, kind, tuple(_list_rows(name, kind, found)), found.network)


def _list_rows(run: str, kind: Kind, found: _Summary) -> Iterator[ResultRow]:
    # landings name their cells; otherwise the fields of a row are its key
    changes = {pair.cell or pair.key: pair for pair in found.pairs if pair.is_of_variants}
    corrupted = {copy.source: (copy.corruption, copy.severity) for copy in found.corrupted}
    groups, own = (*found.groups, *found.cells), found.network
    pooled = {group.source for group in groups if group.object == POOLED}
    # the number of unmodified images of each group, to see whether all have a partner
    unpatched = {group.key_without_variant: group.n for group in found.groups if group.variant == UNPATCHED}
    for group in groups:
        # older summaries lack some fields, or keep them elsewhere
        condition, severity = corrupted.get(group.source, (group.condition, group.severity))
        # a row of another network than the run's own has no identity
        is_own = group.network in ("", own.name)
        row = replace(
            ResultRow(run, kind, **group.model_dump()),
            network=group.network or own.name or own.arch, network_id=own.network_id if is_own else "",
            source=group.source or SOURCES.get(kind) or found.about.data,
            condition=CLEAR if condition in (None, "clean") else condition, severity=severity or 0,
            ci95=group.ci95 if group.n else None, metric=METRICS.get(kind, "top1"), has_pooled=group.source in pooled,
        )  # fmt: skip
        change = changes.get(group.key) or changes.get(group.name)
        if change is not None:
            numbers = {name: getattr(change, name) for name in ("gained", "lost", "p", "n_pairs", "n_bare")}
            counts = {row.n, unpatched.get(group.key_without_variant, row.n)}
            row = replace(row, **numbers, is_part=change.n_pairs is not None and counts != {change.n_pairs})
        yield row
    # a benchmark's means come as rows of their own
    for mean in found.means if kind == "benchmark" else ():
        if mean.share is not None:
            yield ResultRow(run, kind, **mean.model_dump() | {"source": found.about.data, "condition": MEAN})


OPERATORS = ("!=", ">=", "<=", "=", ">", "<")
NUMBERS = ("severity", "n", "failed", "share", "gained", "lost", "p", "n_pairs", "n_bare")
FIELDS = tuple(name for name in ResultRow.__dataclass_fields__ if name not in ("ci95", "has_pooled", "is_part"))
ALIASES: Mapping[str, str] = {
    "weather": "condition", "corruption": "condition", "model": "network",
    "top1": "share", "success": "share", "found": "share",
}  # fmt: skip


@dataclass(frozen=True)
class Run:
    """A run."""

    name: str
    folder: Path
    kind: Kind
    rows: tuple[ResultRow, ...]
    network: RunNetwork = UNKNOWN

    @property
    def has_predictions(self) -> bool:
        """Whether the run has a table of predictions."""
        return any((self.folder / name).is_file() for name in (PREDICTIONS, DETECTIONS))


def find_runs(workspace: Workspace) -> tuple[list[Run], list[tuple[str, str]]]:
    """Return every run below the workspace's `eval/`, by name, and (path, reason) of each that cannot be read."""
    runs, refused = [], []
    for name in list_run_names(workspace.eval_dir):
        try:
            runs.append(open_run(workspace, name))
        except ToolkitError as error:
            refused.append((name, str(error)))
    return runs, refused


def open_run(workspace: Workspace, name: str | Path) -> Run:
    """Return a run by its name below `eval/`, or by its folder; a `ToolkitError` as `read_run` or if there is none."""
    # by its name in the workspace, or by a path
    folder = workspace.eval_dir / name
    if not folder.is_dir():
        folder = Path(name)
    if not folder.is_dir():
        known = list_run_names(workspace.eval_dir)
        if not known:
            raise ToolkitError(f"{workspace.eval_dir} holds no run: make one with 'toolkit eval'")
        raise one_of("run", str(name), known)
    if not (folder / SUMMARY).is_file():
        raise ToolkitError(f"{folder} is not a finished run: it has no {SUMMARY}")
    # runs elsewhere are shown by the path that was typed
    home, place = workspace.eval_dir.resolve(), folder.resolve()
    shown = place.relative_to(home).as_posix() if place.is_relative_to(home) else str(name)
    return read_run(folder, shown)


def list_run_names(eval_dir: Path) -> list[str]:
    """Return the names of all folders with a summary below a folder."""
    found = sorted(folder for folder, _, names in walk_folders(eval_dir) if SUMMARY in names and folder != eval_dir)
    return [folder.relative_to(eval_dir).as_posix() for folder in found if (folder / SUMMARY).is_file()]


@dataclass(frozen=True)
class Where:
    """Condition on a row: `object=racer`, `share>=0.5`, `run=resnet*`."""

    field: str
    operator: str
    value: str

    def is_met(self, row: ResultRow) -> bool:
        """Whether a row meets the condition; a missing field meets `!=` alone."""
        found = getattr(row, self.field)
        if self.operator in ("=", "!="):
            # as it is typed: 0.5
            text = f"{found:g}" if isinstance(found, float) else str(found)
            return (found is not None and fnmatchcase(text, self.value)) == (self.operator == "=")
        if found is None:
            return False
        number = float(self.value)
        return {">": found > number, ">=": found >= number, "<": found < number, "<=": found <= number}[self.operator]


def parse_where(text: str) -> Where:
    """Parse `FIELD=VALUE`, with `*` and `?` in VALUE, or `FIELD!=VALUE`; for numbers also `>`, `>=`, `<` and `<=`.

    `weather` and `corruption` mean the field `condition`, `model` means `network`, `top1` and `success` mean `share`.

    Raises:
        ToolkitError: there is no such field, or the operator does not suit it.
    """
    found = [sign for sign in OPERATORS if sign in text]
    if not found:
        raise ToolkitError(f"'{text}' is not a condition: expected FIELD=VALUE, such as object=racer or p<0.05")
    # the first operator in the text, and `>=` before `>`
    operator = min(found, key=lambda sign: (text.index(sign), -len(sign)))
    name, _, value = (part.strip() for part in text.partition(operator))
    field = ALIASES.get(name, name)
    if field not in FIELDS:
        raise one_of("field of a run", name, [*FIELDS, *ALIASES])
    if operator not in ("=", "!=") and not (field in NUMBERS and _is_number(value)):
        raise ToolkitError(f"'{text}' is not a condition: {operator} compares numbers: {', '.join(NUMBERS)}")
    # the benchmark's files call clear `clean`
    return Where(field, operator, CLEAR if (field, value) == ("condition", "clean") else value)


def _is_number(text: str) -> bool:
    try:
        return not isnan(float(text))
    except ValueError:
        return False


def pick_rows(rows: Sequence[ResultRow], wanted: Sequence[Where] = (), everything: bool = False) -> list[ResultRow]:
    """Return the rows that meet all conditions.

    Args:
        rows: rows of any runs.
        wanted: conditions from `parse_where`.
        everything: whether to return rows that are parts of pooled rows or means too; else only if a condition names
            the field, see `ResultRow.details`.
    """
    named = {where.field for where in wanted}
    shown = [row for row in rows if everything or row.details <= named]
    return [row for row in shown if all(where.is_met(row) for where in wanted)]


def describe_condition(row: ResultRow) -> str:
    """Return `clear`, `fog 3` or `mean of corruptions`."""
    return f"{row.condition} {row.severity}" if row.severity else row.condition


def tell_networks_apart(rows: Sequence[ResultRow]) -> list[ResultRow]:
    """Return the rows, with the hash after the name of each network if two networks share the name."""
    known: dict[str, set[str]] = {}
    for row in rows:
        known.setdefault(row.network, set()).update({row.network_id} - {""})
    shared = {name for name, own in known.items() if len(own) > 1}
    names = [f"{row.network} {row.network_id or '(older)'}" if row.network in shared else row.network for row in rows]
    return [replace(row, network=name) for row, name in zip(rows, names, strict=True)]


def build_runs_table(rows: Sequence[ResultRow]) -> Table:
    """Return a table with a line for each row, without empty columns or columns that repeat the run's name."""
    rows = tell_networks_apart(rows)
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
    return build_table("", tuple(texts), ("n", "correct % (95 %)", "+/−", "p"), cells)


def _format_numbers(row: ResultRow) -> list[str]:
    n = NONE if row.n is None else str(row.n)
    right = f"{format_percent(row.share)} ({format_interval(row.ci95)})" if row.ci95 else format_percent(row.share)
    change = "" if row.gained is None else f"{row.gained}/{row.lost}"
    # if some images have no pair, the shares of all images are not those of the pairs
    if row.is_part and row.n_pairs and row.n_bare is not None:
        change += f" of {row.n_pairs}, unmodified {format_percent(row.n_bare / row.n_pairs)} %"
    return [n, right, change, format_p(row.p)]
