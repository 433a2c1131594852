"""From a capture folder to a run folder."""

import re
from collections.abc import Sequence
from pathlib import Path

from toolkit.captures.corrupt import Corruption
from toolkit.captures.read import CaptureFolder, Selection, read_captures
from toolkit.core.errors import ToolkitError
from toolkit.core.files import write_json
from toolkit.core.workspace import Workspace
from toolkit.evaluation.predict import Prediction, add_corrupted, find_true_classes, leave_out_unknown, predict_captures
from toolkit.evaluation.report import write_report
from toolkit.evaluation.results import EvaluationResult, find_results, summarise, write_predictions
from toolkit.evaluation.saliency import draw_saliency
from toolkit.models.network import Classifier

RUN_NAME = re.compile(r"^[A-Za-z0-9][A-Za-z0-9._-]*$")


def evaluate_captures(
    captures_dir: Path,
    workspace: Workspace,
    classifier: Classifier,
    run_name: str | None = None,
    quiet: bool = False,
    selection: Selection | None = None,
    batch_size: int | None = None,
    saliency: bool | None = None,
    corruptions: Sequence[Corruption] = (),
) -> EvaluationResult:
    """Classify every image of a capture folder and write `eval/RUN`: predictions.csv, summary.json, report.html.

    An image that cannot be read is listed with its reason, and the others are evaluated. A run of the same name is
    replaced, file by file. An object whose spec names a class that the network does not have is left out with a note.

    Args:
        captures_dir: `captures/`, one of its sources, one object's folder, or an ImageFolder.
        workspace: whose object specs say what each object is, and whose `eval/` is written to.
        classifier: from `load_classifier`.
        run_name: folder under `eval/`; by default the network's name.
        quiet: no progress bar.
        selection: the sources, objects and variants that are meant; all by default.
        batch_size: images per pass of the network; 32 on a CPU and 128 on a GPU by default.
        saliency: whether the report has Grad-CAM maps of the flips it shows; by default when there are at most 200.
        corruptions: (name, severity) of each under which the images are classified once more, in sources of their own.

    Raises:
        ToolkitError: no images, no object whose class the network knows, a folder that is no object, a broken manifest,
            a bad run name, or a folder that cannot be written.
    """
    run_dir = workspace.eval_dir / check_run_name(run_name or classifier.name)
    folder = leave_out_unknown(read_captures(captures_dir, selection), workspace, classifier)
    folder = add_corrupted(folder, corruptions)
    classes = find_true_classes(folder, workspace, classifier)
    predictions = predict_captures(folder.captures, classes, classifier, batch_size, quiet)
    return write_evaluation(run_dir, folder, predictions, classifier, quiet, batch_size, saliency)


def write_evaluation(
    run_dir: Path,
    folder: CaptureFolder,
    predictions: Sequence[Prediction],
    classifier: Classifier,
    quiet: bool = False,
    batch_size: int | None = None,
    saliency: bool | None = None,
) -> EvaluationResult:
    """Write what follows from the predictions of a folder's images; see `evaluate_captures`.

    Raises:
        ToolkitError: `run_dir` cannot be written.
    """
    findings = find_results(classifier.name, predictions, folder.refused_folders)
    write_predictions(run_dir / "predictions.csv", predictions)
    maps = draw_saliency(findings.flips, classifier, saliency, batch_size, quiet)
    why = [f"no saliency maps: {maps.reason}"] if saliency and maps.reason else []
    notes = (*folder.notes, *why)
    summary = summarise(classifier, findings, notes)
    write_json(run_dir / "summary.json", summary)
    report_file = write_report(run_dir / "report.html", run_dir.name, classifier, findings, notes, maps)
    return EvaluationResult(
        run_dir,
        report_file,
        findings.predictions,
        findings.groups,
        findings.pairs,
        findings.failed,
        findings.unpaired,
        notes,
        findings.headlines,
        summary,
        findings.sim_real,
    )


def list_lines(title: str, items: Sequence[tuple[str, str]], limit: int = 20) -> list[str]:
    """`title` and one line per (path, reason), the rest counted."""
    lines = [f"{len(items)} {title}:", *(f"  {path}: {reason}" for path, reason in items[:limit])]
    return lines if len(items) <= limit else [*lines, f"  and {len(items) - limit} more, all in summary.json"]


def check_run_name(name: str) -> str:
    """The name of a run, if it can be that of a folder.

    Raises:
        ToolkitError: it cannot.
    """
    if not RUN_NAME.match(name):
        raise ToolkitError(f"--run '{name}': expected letters, digits, '.', '_' and '-', such as 'resnet18-tuesday'")
    return name
