"""Runs: the `summary.json` of every experiment, its rows as one table, and which of them are meant."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

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
"""The newest of `summary.json` that is read here."""
CLEAR, MEAN = "clear", "mean of corruptions"
"""Condition of images as they were taken, and of a mean over several conditions."""
Kind = Literal["eval", "detection", "world-eval", "sweep", "benchmark", "landing"]
KINDS: tuple[Kind, ...] = get_args(Kind)
Metric = Literal["top1", "success", "found"]
METRICS: Mapping[str, Metric] = {"detection": "found", "landing": "success"}
SOURCES = {"landing": "flights"}
"""Source of the rows of a kind whose summary names none."""


@dataclass(frozen=True)
class ResultRow:
    """One group of images, or of landings, in one run.

    Attributes:
        run: path of its folder below `eval/`.
        kind: which experiment made it.
        network: who was asked.
        source: of the images; in a sweep the value; of a benchmark the data set.
        object: `all` for all of them together.
        variant: what was put on the object; of landings the pad.
        condition: weather or corruption; `clear` without.
        severity: of the condition, 0 without; None for a mean.
        world, place: of a world's groups and landings; None elsewhere, place `all` for all places together.
        n, failed: how many were judged, and how many images could not be read; None where it is a mean of shares.
        metric: what `share` is of: right at the first guess, landed, or found by a detector.
        share, ci95: with its 95 % interval; None without images.
        gained, lost, p: pairs that changed against `unpatched` (of landings the first pad), and the exact McNemar test;
            None without pairs.
        n_pairs, n_bare: pairs, and how many of their images without the booster are right; None in older summaries.
        has_pooled: whether there is a row of all objects that it is a part of.
        is_part: whether some of these images, or of those without the booster, are in no pair.
        network_id: of architecture, weights, labels and preprocessing together; empty where a summary has none.
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
        """Names of the fields in which the row is a part of another row: it is shown where they are asked for."""
        found = {"object"} if self.object != POOLED and self.has_pooled else set()
        if self.place not in (None, POOLED):
            found.add("place")
        if self.kind == "benchmark" and self.condition not in (CLEAR, MEAN):
            found.add("condition")
        return found

    def as_json(self) -> dict[str, Any]:
        """The fields, as `toolkit runs --json` has them."""
        fields = {key: value for key, value in vars(self).items() if key not in ("has_pooled", "is_part")}
        return fields | {"ci95": None if self.ci95 is None else list(self.ci95)}


def begin_summary(kind: str, network: AnyNetwork) -> dict[str, Any]:
    """The fields that the summary of what a network said begins with."""
    model = describe_network(network)
    if isinstance(network, Classifier):
        model["description"] = network.describe()
    return {"schema_version": SCHEMA_VERSION, "kind": kind, "model": model}


def list_reasons(items: Sequence[tuple[str, str]]) -> list[dict[str, str]]:
    """(path, reason) of what could not be used, as summaries have it."""
    return [{"path": path, "reason": reason} for path, reason in items]


Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0)]


class _Part(BaseModel):
    """What is read of a part of a summary; other fields are passed over."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class _Where(_Part):
    """What was shown to whom: the fields of `ResultRow`, by any name that a kind of summary has for them."""

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
        """Equal for a row and its pair."""
        return tuple(getattr(self, name) for name in _Where.model_fields)

    @property
    def key_without_variant(self) -> tuple[str | int | None, ...]:
        """Equal for all variants of the same images."""
        return tuple(getattr(self, name) for name in _Where.model_fields if name != "variant")

    @property
    def name(self) -> str:
        """As pairs of landings name their cells."""
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
    """A variant against `unpatched`; of landings, one cell against another."""

    cell: str = ""
    against: str = ""
    gained: Count
    lost: Count
    p: Share = Field(validation_alias="mcnemar_p")
    n_pairs: Count | None = None
    n_bare: Count | None = Field(None, validation_alias="n_first")

    @property
    def is_of_variants(self) -> bool:
        """Whether the two differ in the variant alone; of landings, in the pad."""
        # cells are named pad/regressor/world/air: all behind the pad must be the same
        return self.cell.partition("/")[2] == self.against.partition("/")[2]


class _Corrupted(_Part):
    source: str
    corruption: str
    severity: Count


class RunNetwork(_Part):
    """Who was asked; fields that an older summary lacks are empty."""

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
    """What is read of a summary of any kind: it has groups, or cells."""

    model: RunNetwork = RunNetwork()
    about: _About = _About()
    groups: list[_Group] = []
    cells: list[_Group] = []
    means: list[_Mean] = Field([], validation_alias="variants")
    pairs: list[_Pair] = []
    corrupted: list[_Corrupted] = []

    @property
    def network(self) -> RunNetwork:
        """Who was asked; of a benchmark it stands elsewhere."""
        return self.model if self.model.name or self.model.arch else self.about.model


def name_kind(content: Mapping[str, Any], run: str) -> str:
    """The kind that a summary says it is of; of an older one that does not say, by what it holds and where it lies."""
    said, groups = content.get("kind"), content.get("groups")
    if said is not None:
        return "detection" if said == "detections" else str(said)
    if "cells" in content:
        return "benchmark" if "variants" in content else "landing"
    if isinstance(groups, list) and any("weather" in group for group in groups if isinstance(group, dict)):
        return "world-eval"
    return "sweep" if run.startswith("sweeps/") else "eval"


def read_run(folder: Path, name: str) -> "Run":
    """A run from its `summary.json`.

    Raises:
        ToolkitError: the file is damaged, of a newer toolkit or of another program, or it or a table of the run was
            changed after it was written.
    """
    file = folder / SUMMARY
    content = load_json(file)
    version = content.get("schema_version") if isinstance(content, dict) else None
    # True is an int to Python, and no version
    if not isinstance(version, int) or isinstance(version, bool):
        raise ToolkitError(f"{file} is not a result of toolkit: expected a schema_version in it")
    if version > SCHEMA_VERSION:
        raise ToolkitError(
            f"{file} was written by a newer toolkit (schema_version {version}, this one reads up to {SCHEMA_VERSION}): "
            "update toolkit"
        )
    if "groups" not in content and "cells" not in content:
        raise ToolkitError(f"{file} is not a result of toolkit: expected groups or cells in it")
    said = name_kind(content, name)
    kind = next((known for known in KINDS if known == said), None)
    if kind is None:
        raise ToolkitError(
            f"{file} is of a kind {said!r} that this toolkit does not know: expected one of {', '.join(KINDS)}: "
            "update toolkit"
        )
    check_run(folder, content)
    try:
        found = _Summary.model_validate(content)
        return Run(name, folder, kind, tuple(_list_rows(name, kind, found)), found.network)
    except ValidationError as error:
        raise ToolkitError(f"{file} is damaged ({explain_validation(error)}): make the run again") from None


def _list_rows(run: str, kind: Kind, found: _Summary) -> Iterator[ResultRow]:
    # landings name their cells; elsewhere the fields of a row are its key
    changes = {pair.cell or pair.key: pair for pair in found.pairs if pair.is_of_variants}
    corrupted = {copy.source: (copy.corruption, copy.severity) for copy in found.corrupted}
    pooled = {one.source for one in (*found.groups, *found.cells) if one.object == POOLED}
    bare = {group.key_without_variant: group.n for group in found.groups if group.variant == UNPATCHED}
    for one in (*found.groups, *found.cells):
        condition, severity = corrupted.get(one.source, (one.condition, one.severity))
        row = ResultRow(run, kind, **one.model_dump())
        own = found.network
        is_own = one.network in ("", own.name)
        row = replace(
            row, network=one.network or own.name or own.arch, network_id=own.network_id if is_own else "",
            source=one.source or SOURCES.get(kind) or found.about.data,
            condition=CLEAR if condition in (None, "clean") else condition, severity=severity or 0,
            ci95=one.ci95 if one.n else None, metric=METRICS.get(kind, "top1"), has_pooled=one.source in pooled,
        )  # fmt: skip
        change = changes.get(one.key) or changes.get(one.name)
        if change is not None:
            numbers = {name: getattr(change, name) for name in ("gained", "lost", "p", "n_pairs", "n_bare")}
            counts = {row.n, bare.get(one.key_without_variant, row.n)}
            row = replace(row, **numbers, is_part=change.n_pairs is not None and counts != {change.n_pairs})
        yield row
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
    """One run's folder.

    Attributes:
        name: its path below `eval/`.
        folder: where it is.
        kind: which experiment made it.
        rows: what it found.
        network: who was asked, if it is one network.
    """

    name: str
    folder: Path
    kind: Kind
    rows: tuple[ResultRow, ...]
    network: RunNetwork = UNKNOWN

    @property
    def has_predictions(self) -> bool:
        """Whether it says what was answered image by image."""
        return any((self.folder / name).is_file() for name in (PREDICTIONS, DETECTIONS))


def find_runs(workspace: Workspace) -> tuple[list[Run], list[tuple[str, str]]]:
    """Every run below the workspace's `eval/`, by name, and (path, reason) of each that cannot be read."""
    runs, refused = [], []
    for name in list_run_names(workspace.eval_dir):
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
        known = list_run_names(workspace.eval_dir)
        if not known:
            raise ToolkitError(f"{workspace.eval_dir} holds no run: make one with 'toolkit eval'")
        raise one_of("run", str(name), known)
    if not (folder / SUMMARY).is_file():
        raise ToolkitError(f"{folder} is not a finished run: it has no {SUMMARY}")
    home, place = workspace.eval_dir.resolve(), folder.resolve()
    shown = place.relative_to(home).as_posix() if place.is_relative_to(home) else str(name)
    return read_run(folder, shown)


def list_run_names(eval_dir: Path) -> list[str]:
    """Names of all runs below a folder: the folders that hold a summary."""
    found = sorted(folder for folder, _, names in walk_folders(eval_dir) if SUMMARY in names and folder != eval_dir)
    return [folder.relative_to(eval_dir).as_posix() for folder in found if (folder / SUMMARY).is_file()]


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


def tell_networks_apart(rows: Sequence[ResultRow]) -> list[ResultRow]:
    """The same rows, with the hash behind the name of each network whose name another network has as well."""
    known: dict[str, set[str]] = {}
    for row in rows:
        known.setdefault(row.network, set()).update({row.network_id} - {""})
    shared = {name for name, own in known.items() if len(own) > 1}
    return [
        replace(row, network=f"{row.network} {row.network_id or '(older)'}") if row.network in shared else row
        for row in rows
    ]


def build_runs_table(rows: Sequence[ResultRow]) -> Table:
    """A line for each row; columns that say nothing, or what the run's name says, are left out."""
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
    return build_table("", tuple(texts), ("n", "right % (95 %)", "+/−", "p"), cells)


def _format_numbers(row: ResultRow) -> list[str]:
    n = NONE if row.n is None else str(row.n)
    right = f"{format_percent(row.share)} ({format_interval(row.ci95)})" if row.ci95 else format_percent(row.share)
    change = "" if row.gained is None else f"{row.gained}/{row.lost}"
    # the shares of all images are no before and after of fewer pairs
    if row.is_part and row.n_pairs and row.n_bare is not None:
        change += f" of {row.n_pairs}, bare {format_percent(row.n_bare / row.n_pairs)} %"
    return [n, right, change, format_p(row.p)]
