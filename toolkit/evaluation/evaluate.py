"""From a capture folder to a run folder: read the images, predict, compare, write."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from toolkit.core.files import write_json, write_text
from toolkit.core.workspace import Workspace
from toolkit.evaluation.eval_config import EvalConfig
from toolkit.evaluation.ground_truth import read_labelled_captures
from toolkit.evaluation.predict import predict_captures
from toolkit.evaluation.predictions_csv import encode_predictions
from toolkit.evaluation.report import write_report
from toolkit.evaluation.results import Findings, compare_predictions, summarise
from toolkit.evaluation.saliency import draw_saliency
from toolkit.evaluation.seen import find_training
from toolkit.evaluation.summaries import Kind
from toolkit.models.detector import Detector
from toolkit.models.network import Classifier

DEFAULT = EvalConfig()
MOST_SOURCES, LONGEST_PART = 3, 40


@dataclass(frozen=True)
class Evaluation(Findings):
    """What an evaluation found, and where it is written.

    Attributes:
        run_dir: the folder `eval/RUN`.
        notes: what else the reader should know.
        summary: what `summary.json` holds.
    """

    run_dir: Path
    notes: tuple[str, ...]
    summary: dict[str, Any]

    @property
    def report_file(self) -> Path:
        """The page to open."""
        return self.run_dir / "report.html"


def evaluate_captures(
    captures_dir: Path, workspace: Workspace, classifier: Classifier, config: EvalConfig = DEFAULT
) -> Evaluation:
    """Classify every image of a capture folder and write `eval/RUN`: predictions.csv, summary.json, report.html.

    An image that cannot be read is listed with its reason, and the others are evaluated. Where a folder of that name
    holds another result, this one goes beside it as RUN-2, unless it shall be replaced. An object whose spec names a
    class that the network does not have is left out with a note.

    Args:
        captures_dir: `captures/`, one of its sources, one object's folder, or an ImageFolder.
        workspace: whose object specs say what each object is, and whose `eval/` is written to.
        classifier: from `load_classifier`.
        config: the name of the run, by default after network, weights and sources, and what is evaluated.

    Raises:
        ToolkitError: no images, no object whose class the network knows, a folder that is no object, a broken manifest,
            or a folder that cannot be written.
    """
    folder, classes = read_labelled_captures(captures_dir, workspace, classifier, config)
    predictions = predict_captures(folder.captures, classes, classifier, config.batch_size)
    findings = compare_predictions(classifier.name, predictions, folder.refused_folders)
    training = find_training(folder.captures, workspace, classifier.weights.sha256)
    findings = replace(findings, training=training)
    name = config.run or name_run(classifier, [one.source for one in folder.captures if one.corruption is None])
    run_dir = choose_run_dir(workspace.eval_dir / name, findings, config.replace)
    done = write_evaluation(run_dir, classifier, findings, folder.notes, config)
    if run_dir.name == name:
        return done
    return replace(done, notes=(*done.notes, f"{run_dir.with_name(name)} holds another result, and stays as it is"))


def name_run(classifier: Classifier | Detector, sources: Sequence[str]) -> str:
    """Network, weights and sources, such as `resnet18-imagenet-sim`; more than three sources are counted."""
    # weights are mostly called after their network, whose name stands before them already
    weights = Path(classifier.weights.name).stem.removeprefix(classifier.arch).removeprefix(classifier.name)
    names = list(dict.fromkeys(sources))
    parts = [classifier.name, weights, "+".join(names) if len(names) <= MOST_SOURCES else f"{len(names)}-sources"]
    slugs = [re.sub(r"[^A-Za-z0-9._+-]+", "-", part).strip("-._+")[:LONGEST_PART].replace("+", "-") for part in parts]
    return "-".join(slug for slug in slugs if slug)


def choose_run_dir(wanted: Path, findings: Findings, overwrite: bool = False) -> Path:
    """`wanted`, or the first of RUN-2, RUN-3 … that is free or holds these very predictions."""
    # predictions decide whether it is the same result: all else follows from them
    return find_run_dir(wanted, "predictions.csv", encode_predictions(findings.predictions).encode(), overwrite)


def find_run_dir(wanted: Path, name: str, content: bytes, overwrite: bool = False) -> Path:
    """`wanted`, or the first of RUN-2, RUN-3 … that has no file `name`, or one of this very content."""
    number, folder = 1, wanted
    while not overwrite and _holds_other(folder / name, content):
        number += 1
        folder = wanted.with_name(f"{wanted.name}-{number}")
    return folder


def _holds_other(file: Path, content: bytes) -> bool:
    return file.is_file() and file.read_bytes() != content


def write_evaluation(
    run_dir: Path, classifier: Classifier, findings: Findings, notes: Sequence[str], config: EvalConfig = DEFAULT,
    kind: Kind = "eval",
) -> Evaluation:  # fmt: skip
    """Write what was found; see `evaluate_captures`. `kind` is of the experiment that the evaluation is a part of.

    Raises:
        ToolkitError: `run_dir` cannot be written.
    """
    maps = draw_saliency(findings.flips, classifier, config.saliency, config.batch_size)
    why = [f"no saliency maps: {maps.reason}"] if config.saliency and maps.reason else []
    notes, summary = (*notes, *why), summarise(classifier, findings, (*notes, *why), kind)
    done = Evaluation(**vars(findings), run_dir=run_dir, notes=notes, summary=summary)
    write_text(run_dir / "predictions.csv", encode_predictions(findings.predictions))
    write_json(run_dir / "summary.json", summary)
    write_report(done.report_file, classifier, findings, notes, maps)
    return done
