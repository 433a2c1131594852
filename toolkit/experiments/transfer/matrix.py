"""The result of leaving one network out after the other: a row for each that judged."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.core.files import write_json, write_text
from toolkit.core.statistics import wilson_interval
from toolkit.core.tables import format_interval, format_p
from toolkit.evaluation.detect import DetectionRun
from toolkit.evaluation.evaluate import Evaluation
from toolkit.evaluation.metrics import describe_change
from toolkit.evaluation.summaries import SCHEMA_VERSION

BOOSTED = {"patched": "patch", "textured": "texture"}


class JudgedRow(BaseModel):
    """What one network says of one object in one booster, pooled rows among them.

    Attributes:
        left_out: the network that the boosters were not trained on, or `classifiers` or `detectors`.
        trained_on: the others.
        judge, judge_sha256: which network spoke, and the hash of its weights.
        seen: whether the boosters were trained on it.
        source: `sim`, or `sim-fog-3` and the like for corrupted captures.
        object: or `all`.
        kind: patch or texture.
        n, bare, boosted: poses seen both ways, and how many of them are right bare and in the booster; of a detector
            those in which it finds the object: a box of its class that overlaps by half.
        gained, lost, mcnemar_p: of the pairs.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    left_out: str
    trained_on: list[str]
    judge: str
    judge_sha256: str
    seen: bool
    source: str
    object: str
    kind: str
    n: int
    bare: int
    boosted: int
    gained: int
    lost: int
    mcnemar_p: float


class JudgedCell(BaseModel):
    """What one network says of the boosters that were trained without one network.

    Attributes:
        key: hash of all that it depends on.
        rows: by source, object and kind.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    key: str
    rows: list[JudgedRow]


def collect_rows(done: Evaluation | DetectionRun, left_out: str, trained_on: Sequence[str]) -> list[JudgedRow]:
    """The pairs against `unpatched` of an evaluation."""
    judge, sha256 = done.summary["model"]["name"], done.summary["model"]["sha256"]
    rows = []
    for pair in done.pairs:
        if pair.first != UNPATCHED or pair.second not in BOOSTED:
            continue
        found = pair.outcomes
        rows.append(JudgedRow(
            left_out=left_out, trained_on=list(trained_on), judge=judge, judge_sha256=sha256, seen=judge in trained_on,
            source=pair.source, object=pair.object, kind=BOOSTED[pair.second], n=found.n, bare=found.n_first,
            boosted=found.n_second, **describe_change(found),
        ))  # fmt: skip
    return rows


def write_matrix(folder: Path, rows: Sequence[JudgedRow], about: dict[str, Any]) -> tuple[Path, Path]:
    """Write `matrix.json` and `matrix.md`."""
    head = {"schema_version": SCHEMA_VERSION, "kind": "transfer", **about}
    content = head | {"rows": [row.model_dump() for row in rows]}
    text = "\n\n".join(["\n".join(_as_markdown(rows, seen)) for seen in (False, True)]) + "\n"
    return write_json(folder / "matrix.json", content), write_text(folder / "matrix.md", text)


def tabulate(rows: Sequence[JudgedRow], seen: bool) -> list[tuple[str, ...]]:
    """Cells of a table: on networks that were left out, each object; on those that were not, the pooled rows."""
    cells: list[tuple[str, ...]] = []
    several = len({row.object for row in rows} - {POOLED}) > 1
    for row in rows:
        if (
            row.seen is not seen
            or (row.object == POOLED and not several)
            or (seen and several != (row.object == POOLED))
        ):
            continue
        low_high = format_interval(wilson_interval(row.boosted, row.n))
        cells.append((
            row.left_out, row.judge, row.kind, row.source, row.object, f"{row.bare} of {row.n}",
            f"{row.boosted} of {row.n} ({low_high})", str(row.gained), str(row.lost), format_p(row.mcnemar_p),
        ))  # fmt: skip
    return cells


HEADS = ("left out", "judged by", "booster", "source", "object", "bare", "boosted (95 %)", "gained", "lost", "p")


def _as_markdown(rows: Sequence[JudgedRow], seen: bool) -> list[str]:
    title = "Judged by networks that were trained on" if seen else "Judged by the network that was left out"
    table = [HEADS, ("---",) * len(HEADS), *tabulate(rows, seen)]
    lines = [" | ".join(cells) for cells in table]
    return [f"{title}:", "", *(f"| {line} |" for line in lines)]
