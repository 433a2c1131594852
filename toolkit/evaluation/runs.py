"""Every result in a workspace as rows of one table, whatever experiment made it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from toolkit.captures.read import POOLED
from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import explain_validation, load_json
from toolkit.core.statistics import Interval
from toolkit.core.workspace import Workspace

SUMMARY, PREDICTIONS, DETECTIONS = "summary.json", "predictions.csv", "detections.csv"
SCHEMA_VERSION = 1
"""The newest of `summary.json` that is read here."""
CLEAR, MEAN = "clear", "mean of corruptions"
"""Condition of images as they were taken, and of a mean over several conditions."""
Kind = Literal["eval", "detection", "world-eval", "sweep", "benchmark", "landing"]
Metric = Literal["top1", "success", "found"]


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
        has_pooled: whether there is a row of all objects that it is a part of.
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
        fields = {key: value for key, value in vars(self).items() if key != "has_pooled"}
        return fields | {"ci95": None if self.ci95 is None else list(self.ci95)}


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
    kind, rows = _read_rows(file, shown)
    return Run(shown, folder, kind, tuple(rows))


def _list_names(eval_dir: Path) -> list[str]:
    found = sorted(file.parent for file in eval_dir.rglob(SUMMARY) if file.is_file())
    return [folder.relative_to(eval_dir).as_posix() for folder in found if folder != eval_dir]


class _Part(BaseModel):
    """What is read of a part of a summary; other fields are passed over."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0)]


class _Network(_Part):
    name: str = ""
    arch: str = ""


class _Place(_Part):
    """Where and in what a group was: fields that a world's summary has beside those of an evaluation."""

    source: str
    object: str
    variant: str
    world: str | None = None
    place: str | None = None
    weather: str | None = None
    severity: Count | None = None

    @property
    def key(self) -> tuple[str | int | None, ...]:
        return tuple(getattr(self, name) for name in _Place.model_fields)


class _Group(_Place):
    n: Count
    failed: Count = 0
    top1: Share | None
    top1_ci95: tuple[Share, Share]


class _Pair(_Place):
    gained: Count
    lost: Count
    mcnemar_p: Share


class _Corrupted(_Part):
    source: str
    corruption: str
    severity: Count


class _Evaluation(_Part):
    model: _Network
    groups: list[_Group]
    pairs: list[_Pair]
    corrupted: list[_Corrupted] = []


class _About(_Part):
    data: str
    model: _Network


class _Cell(_Part):
    variant: str
    answerer: str
    corruption: str
    severity: Count
    n: Count
    top1: Share
    top1_ci95: tuple[Share, Share]
    gained: Count | None
    lost: Count | None
    mcnemar_p: Share | None


class _Mean(_Part):
    variant: str
    answerer: str
    top1: Share | None
    top1_ci95: tuple[Share, Share] | None


class _Benchmark(_Part):
    about: _About
    cells: list[_Cell]
    variants: list[_Mean]


class _Flight(_Part):
    pad: str
    regressor: str
    world: str | None = None
    weather: str | None = None
    severity: Count | None = None
    n: Count
    success: Share | None
    success_ci95: tuple[Share, Share] | None
    gains: object = None

    @property
    def key(self) -> str:
        """As `pairs` name it."""
        air = f"{self.weather}:{self.severity}" if self.severity else self.weather
        return "/".join(map(str, (self.pad, self.regressor, self.world, air, self.gains)))


class _FlightPair(_Part):
    cell: str
    against: str
    gained: Count
    lost: Count
    mcnemar_p: Share

    @property
    def is_of_pads(self) -> bool:
        """Whether two pads were flown in otherwise the same cell."""
        return self.cell.partition("/")[2] == self.against.partition("/")[2]


class _Landing(_Part):
    cells: list[_Flight]
    pairs: list[_FlightPair] = []


def _read_rows(file: Path, run: str) -> tuple[Kind, list[ResultRow]]:
    """The kind of a run and its rows, from its `summary.json`.

    Raises:
        ToolkitError: the file is damaged, of a newer toolkit or of another program.
    """
    content = load_json(file)
    version = content.get("schema_version") if isinstance(content, dict) else None
    if not isinstance(version, int) or isinstance(version, bool):
        raise ToolkitError(f"{file} is no result of toolkit: expected a schema_version in it")
    if version > SCHEMA_VERSION:
        raise ToolkitError(
            f"{file} was written by a newer toolkit (schema_version {version}, this one reads up to {SCHEMA_VERSION}): "
            "update toolkit"
        )
    try:
        if "cells" in content and "variants" in content:
            return "benchmark", list(_list_cells(run, _Benchmark.model_validate(content)))
        if content.get("kind") == "detections":
            groups = [_as_group(one) for one in content.get("groups") or []]
            found = _Evaluation.model_validate(content | {"groups": groups})
            return "detection", [replace(row, metric="found") for row in _list_groups(run, "detection", found)]
        if "groups" in content:
            found = _Evaluation.model_validate(content)
            kind: Kind = "sweep" if run.startswith("sweeps/") else "eval"
            if any(group.weather is not None for group in found.groups):
                kind = "world-eval"
            return kind, list(_list_groups(run, kind, found))
        if "cells" in content:
            return "landing", list(_list_flights(run, _Landing.model_validate(content)))
    except ValidationError as error:
        raise ToolkitError(f"{file} is damaged ({explain_validation(error)}): make the run again") from None
    raise ToolkitError(f"{file} is no result of toolkit: expected groups or cells in it")


def _as_group(detected: object) -> object:
    """A detector's group in the fields of a classifier's."""
    if not isinstance(detected, dict):
        return detected
    return detected | {"top1": detected.get("found"), "top1_ci95": detected.get("found_ci95")}


def _list_groups(run: str, kind: Kind, found: _Evaluation) -> Iterator[ResultRow]:
    pairs = {pair.key: pair for pair in found.pairs}
    corrupted = {one.source: one for one in found.corrupted}
    pooled = {one.source for one in found.groups if one.object == POOLED}
    for one in found.groups:
        row = ResultRow(
            run, kind, _name(found.model), one.source, one.object, one.variant, world=one.world, place=one.place,
            condition=one.weather or CLEAR, severity=one.severity or 0, n=one.n, failed=one.failed,
            share=one.top1, ci95=one.top1_ci95 if one.n else None, has_pooled=one.source in pooled,
        )  # fmt: skip
        if one.source in corrupted:
            row = replace(row, condition=corrupted[one.source].corruption, severity=corrupted[one.source].severity)
        pair = pairs.get(one.key)
        yield row if pair is None else replace(row, gained=pair.gained, lost=pair.lost, p=pair.mcnemar_p)


def _list_cells(run: str, found: _Benchmark) -> Iterator[ResultRow]:
    for one in found.cells:
        yield ResultRow(
            run, "benchmark", one.answerer, found.about.data, POOLED, one.variant,
            condition=CLEAR if one.corruption == "clean" else one.corruption, severity=one.severity, n=one.n,
            share=one.top1, ci95=one.top1_ci95, gained=one.gained, lost=one.lost, p=one.mcnemar_p,
        )  # fmt: skip
    for mean in found.variants:
        if mean.top1 is not None:
            yield ResultRow(
                run, "benchmark", mean.answerer, found.about.data, POOLED, mean.variant, condition=MEAN, severity=None,
                share=mean.top1, ci95=mean.top1_ci95,
            )  # fmt: skip


def _list_flights(run: str, found: _Landing) -> Iterator[ResultRow]:
    pairs = {pair.cell: pair for pair in found.pairs if pair.is_of_pads}
    for one in found.cells:
        row = ResultRow(
            run, "landing", one.regressor, "flights", POOLED, one.pad,
            condition=one.weather or CLEAR, severity=one.severity or 0, world=one.world, n=one.n, metric="success",
            share=one.success, ci95=one.success_ci95 if one.n else None,
        )  # fmt: skip
        pair = pairs.get(one.key)
        yield row if pair is None else replace(row, gained=pair.gained, lost=pair.lost, p=pair.mcnemar_p)


def _name(network: _Network) -> str:
    return network.name or network.arch
