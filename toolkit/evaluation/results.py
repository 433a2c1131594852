"""Everything that follows from the predictions, and its `predictions.csv` and `summary.json`."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from toolkit import __version__
from toolkit.captures.read import Capture
from toolkit.core.files import write_text
from toolkit.evaluation.gates import describe_both
from toolkit.evaluation.metrics import (
    Comparison,
    FlipList,
    Group,
    compare_controls,
    compare_unpatched,
    explain_unpaired,
    group_predictions,
    index_poses,
    list_flips,
)
from toolkit.evaluation.predict import Prediction
from toolkit.evaluation.seen import Training
from toolkit.evaluation.sim_real import SimReal, compare_sim_real, explain_apart, write_sim_real
from toolkit.evaluation.verdict import Headline, write_headlines
from toolkit.models.network import Classifier


@dataclass(frozen=True)
class Findings:
    """Everything that follows from the predictions.

    Attributes:
        predictions: one per image.
        groups: accuracy by source, object and variant.
        pairs: each variant against `unpatched`.
        comparisons: the boosters against their controls and each other.
        headlines: the result in words.
        flips: pairs gained, and lost.
        failed: (path, reason) of what could not be read.
        unpaired: (path, reason) of images without a partner.
        sim_real: rendered sources against photographs of the same poses.
        passed: the same without the photographs that failed a gate; None where none did.
        training: of the boosters, where their records are known.
    """

    predictions: tuple[Prediction, ...]
    groups: tuple[Group, ...]
    pairs: tuple[Comparison, ...]
    comparisons: tuple[Comparison, ...]
    headlines: tuple[Headline, ...]
    flips: tuple[FlipList, FlipList]
    failed: tuple[tuple[str, str], ...]
    unpaired: tuple[tuple[str, str], ...]
    sim_real: tuple[SimReal, ...]
    passed: "Findings | None"
    training: tuple[Training, ...] = field(default=(), kw_only=True)

    @property
    def gated(self) -> list[Prediction]:
        """Of the photographs that failed a gate."""
        return [one for one in self.predictions if one.capture.failed_gates]

    @property
    def gate_lines(self) -> list[str]:
        """What the failed photographs change, in words, for each source and variant."""
        counts = Counter(one.capture.source for one in self.gated)
        return describe_both(self.pairs, self.passed.pairs if self.passed else (), counts)


def compare_predictions(
    network: str, predictions: Sequence[Prediction], refused_folders: Sequence[tuple[str, str]] = ()
) -> Findings:
    """Count, pair, test and put into words what the network of that name said."""
    poses = index_poses(predictions)
    groups = group_predictions(predictions)
    pairs, comparisons = compare_unpatched(poses), compare_controls(poses)
    sim_real = compare_sim_real(predictions)
    headlines = write_headlines(network, groups, [*pairs, *comparisons]) + write_sim_real(network, sim_real)
    good = [one for one in predictions if not one.capture.failed_gates]
    unread = [(one.capture.path, one.status) for one in predictions if not one.is_read]
    return Findings(
        tuple(predictions),
        groups=tuple(groups),
        pairs=tuple(pairs),
        comparisons=tuple(comparisons),
        headlines=tuple(headlines),
        flips=list_flips(poses),
        failed=(*unread, *refused_folders),
        unpaired=(*explain_unpaired(predictions, poses), *explain_apart(predictions)),
        sim_real=tuple(sim_real),
        passed=compare_predictions(network, good, refused_folders) if 0 < len(good) < len(predictions) else None,
    )


SCHEMA_VERSION = 1
COLUMNS = (
    *("source", "object", "variant", "pose_id", "path", "true_index", "true_label"),
    *(
        "top1_index",
        "top1_label",
        "top1_prob",
        "true_prob",
        "true_rank",
        "correct_top1",
        "correct_top5",
        "status",
        "failed_gates",
    ),
)


def write_predictions(path: Path, predictions: Sequence[Prediction]) -> Path:
    """One row per image; right or wrong as 1 or 0, fields that are unknown left empty."""
    return write_text(path, encode_predictions(predictions))


def encode_predictions(predictions: Sequence[Prediction]) -> str:
    """The text of `predictions.csv`."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for one in predictions:
        table.writerow("" if value is None else value for value in _row(one))
    return text.getvalue()


def _row(one: Prediction) -> list[object]:
    capture = one.capture
    gates = "; ".join(capture.failed_gates)
    head = [capture.source, capture.object, capture.variant, capture.pose_id, capture.path, one.true_index]
    if not one.is_read:
        return [*head, one.true_label, *[None] * 7, one.status, gates]
    guess = [one.top1_index, one.top1_label, f"{one.top1_prob:.6f}", f"{one.true_prob:.6g}", one.true_rank]
    return [*head, one.true_label, *guess, int(one.correct_top1), int(one.correct_top5), one.status, gates]


def summarise(classifier: Classifier, findings: Findings, notes: Sequence[str], kind: str = "eval") -> dict[str, Any]:
    """What `summary.json` of an evaluation, or of a sweep's, holds.

    `controls` has `comparisons` (the fields of `Comparison` and both intervals: each booster against those of its
    controls that were shot, and patch against texture, on the same poses, by object and pooled) and `answers` {source,
    question, tone, verdict, sentence}. Both are empty without controls and with one booster.

    `gates` lists the photographs that failed one, and has `groups` and `pairs` once more without them.

    `boosters` lists what is known of the training of each patch and texture that the manifests name {source, object,
    variant, booster, booster_sha256, networks, seen}: whether it was trained on the network that judges.

    `corrupted` names the sources whose images are corrupted {source, corruption, severity}.

    `sim_real` has an entry for each rendered source and source of photographs of the same poses: `rows` by object and
    variant (the gap, its interval and test, the rank correlation), `gains` (which poses a booster gains), `wrong` (the
    poses that the rig predicted wrongly) and what was not compared. It is empty without both kinds of sources.
    """
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": kind,
        "model": {
            "name": classifier.name,
            "arch": classifier.arch,
            "description": classifier.describe(),
            "weights": classifier.weights.name,
            "sha256": classifier.weights.sha256,
            "preprocessing": classifier.preprocessing.describe(),
        },
        "groups": [group.as_json() for group in findings.groups],
        "pairs": [pair.as_pair() for pair in findings.pairs],
        "controls": {
            "comparisons": [row.as_json() for row in findings.comparisons],
            "answers": [headline.as_json() for headline in findings.headlines if headline.question],
        },
        "boosters": [one.as_json() for one in findings.training],
        "corrupted": list_corrupted(one.capture for one in findings.predictions),
        "sim_real": [one.as_json() for one in findings.sim_real],
        "gates": {
            "failed": [{"path": one.capture.path, "gates": list(one.capture.failed_gates)} for one in findings.gated],
            "groups_without": [group.as_json() for group in findings.passed.groups] if findings.passed else [],
            "pairs_without": [pair.as_pair() for pair in findings.passed.pairs] if findings.passed else [],
        },
        "failed": [{"path": path, "reason": reason} for path, reason in findings.failed],
        "unpaired": [{"path": path, "reason": reason} for path, reason in findings.unpaired],
        "notes": list(notes),
        "toolkit_version": __version__,
    }


def list_corrupted(captures: Iterable[Capture]) -> list[dict[str, str | int]]:
    """Source, corruption and severity of each source that is corrupted, sorted, as `summary.json` has them."""
    found = sorted({(one.source, *one.corruption) for one in captures if one.corruption is not None})
    return [{"source": source, "corruption": name, "severity": severity} for source, name, severity in found]
