"""What an evaluation found, and its `predictions.csv` and `summary.json`."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolkit import __version__
from toolkit.core.files import write_text
from toolkit.evaluation.metrics import (
    FlipList,
    Group,
    Pair,
    compare_variants,
    group_predictions,
    list_flips,
    match_pairs,
)
from toolkit.evaluation.predict import Prediction, list_corrupted
from toolkit.evaluation.sim_real import SimReal, compare_sim_real
from toolkit.evaluation.sim_real_text import write_sim_real
from toolkit.evaluation.verdict import Comparison, Headline, compare_controls, write_headlines
from toolkit.models.network import Classifier


@dataclass(frozen=True)
class Findings:
    """Everything that follows from the predictions.

    Attributes:
        predictions: one per image.
        groups, pairs: rows of the tables.
        comparisons: the boosters against their controls and each other.
        headlines: the result in words.
        flips: pairs gained, and lost.
        failed: (path, reason) of what could not be read.
        unpaired: (path, reason) of images without a partner.
        sim_real: rendered sources against photographs of the same poses.
    """

    predictions: tuple[Prediction, ...]
    groups: tuple[Group, ...]
    pairs: tuple[Pair, ...]
    comparisons: tuple[Comparison, ...]
    headlines: tuple[Headline, ...]
    flips: tuple[FlipList, FlipList]
    failed: tuple[tuple[str, str], ...]
    unpaired: tuple[tuple[str, str], ...]
    sim_real: tuple[SimReal, ...] = ()


def find_results(
    arch: str, predictions: Sequence[Prediction], refused_folders: Sequence[tuple[str, str]] = ()
) -> Findings:
    """Count, pair, test and put into words."""
    groups = group_predictions(predictions)
    matches, unpaired = match_pairs(predictions)
    pairs = compare_variants(matches)
    comparisons = compare_controls(predictions)
    sim_real = compare_sim_real(predictions)
    return Findings(
        tuple(predictions),
        tuple(groups),
        tuple(pairs),
        tuple(comparisons),
        (*write_headlines(arch, groups, pairs, comparisons), *write_sim_real(arch, sim_real)),
        list_flips(matches),
        (*((one.capture.path, one.status) for one in predictions if not one.is_read), *refused_folders),
        tuple(unpaired),
        tuple(sim_real),
    )


SCHEMA_VERSION = 1
COLUMNS = (
    *("source", "object", "variant", "pose_id", "path", "true_index", "true_label"),
    *("top1_index", "top1_label", "top1_prob", "true_prob", "true_rank", "correct_top1", "correct_top5", "status"),
)


def write_predictions(path: Path, predictions: Sequence[Prediction]) -> Path:
    """One row per image; right or wrong as 1 or 0, fields that are unknown left empty."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for one in predictions:
        table.writerow("" if value is None else value for value in _row(one))
    return write_text(path, text.getvalue())


def _row(one: Prediction) -> list[Any]:
    capture = one.capture
    head = [capture.source, capture.object, capture.variant, capture.pose_id, capture.path, one.true_index]
    if not one.is_read:
        return [*head, one.true_label, *[None] * 7, one.status]
    guess = [one.top1_index, one.top1_label, f"{one.top1_prob:.6f}", f"{one.true_prob:.6g}", one.true_rank]
    return [*head, one.true_label, *guess, int(one.correct_top1), int(one.correct_top5), one.status]


def summarise(classifier: Classifier, findings: Findings, notes: Sequence[str]) -> dict[str, Any]:
    """What `summary.json` holds.

    `controls` has `comparisons` (the fields of `Comparison` and both intervals: each booster against those of its
    controls that were shot, and patch against texture, on the same poses, by object and pooled) and `answers` {source,
    question, tone, verdict, sentence}. Both are empty without controls and with one booster.

    `corrupted` names the sources whose images are corrupted {source, corruption, severity}.

    `sim_real` has an entry for each rendered source and source of photographs of the same poses: `rows` by object and
    variant (the gap, its interval and test, the rank correlation), `gains` (which poses a booster gains), `wrong` (the
    poses that the rig predicted wrongly) and what was not compared. It is empty without both kinds of sources.
    """
    return {
        "schema_version": SCHEMA_VERSION,
        "model": {
            "name": classifier.name,
            "arch": classifier.arch,
            "description": classifier.describe(),
            "weights": classifier.weights.name,
            "sha256": classifier.weights.sha256,
            "preprocessing": classifier.preprocessing.describe(),
        },
        "groups": [group.as_json() for group in findings.groups],
        "pairs": [pair.as_json() for pair in findings.pairs],
        "controls": {
            "comparisons": [row.as_json() for row in findings.comparisons],
            "answers": [headline.as_json() for headline in findings.headlines if headline.question],
        },
        "corrupted": list_corrupted(one.capture for one in findings.predictions),
        "sim_real": [one.as_json() for one in findings.sim_real],
        "failed": [{"path": path, "reason": reason} for path, reason in findings.failed],
        "unpaired": [{"path": path, "reason": reason} for path, reason in findings.unpaired],
        "notes": list(notes),
        "toolkit_version": __version__,
    }


@dataclass(frozen=True)
class EvaluationResult:
    """What an evaluation found, and where it is written.

    Attributes:
        run_dir, report_file: the folder `eval/RUN` and the HTML file in it.
        predictions: one per image.
        groups, pairs: rows of the tables.
        failed: (path, reason) of what could not be read.
        unpaired: (path, reason) of images without a partner.
        notes: what else the reader should know.
        headlines: the result in words.
        summary: what `summary.json` holds.
        sim_real: rendered sources against photographs of the same poses.
    """

    run_dir: Path
    report_file: Path
    predictions: tuple[Prediction, ...]
    groups: tuple[Group, ...]
    pairs: tuple[Pair, ...]
    failed: tuple[tuple[str, str], ...]
    unpaired: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    headlines: tuple[Headline, ...]
    summary: dict[str, Any]
    sim_real: tuple[SimReal, ...] = ()
