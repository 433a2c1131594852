"""From a capture folder to a run folder: read the images, predict, compare, write."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolkit.captures.corrupt import Corruption
from toolkit.captures.read import Selection
from toolkit.core.errors import ToolkitError
from toolkit.core.files import write_json
from toolkit.core.workspace import Workspace
from toolkit.evaluation.dataset import read_dataset
from toolkit.evaluation.predict import predict_captures
from toolkit.evaluation.report import write_report
from toolkit.evaluation.results import Findings, compare_predictions, summarise, write_predictions
from toolkit.evaluation.saliency import draw_saliency
from toolkit.models.network import Classifier

RUN_NAME = re.compile(r"^[A-Za-z0-9][A-Za-z0-9._-]*$")


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
    captures_dir: Path,
    workspace: Workspace,
    classifier: Classifier,
    run_name: str | None = None,
    quiet: bool = False,
    selection: Selection | None = None,
    batch_size: int | None = None,
    saliency: bool | None = None,
    corruptions: Sequence[Corruption] = (),
) -> Evaluation:
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
    folder, classes = read_dataset(captures_dir, workspace, classifier, selection, corruptions)
    predictions = predict_captures(folder.captures, classes, classifier, batch_size, quiet)
    findings = compare_predictions(classifier.name, predictions, folder.refused_folders)
    return write_evaluation(run_dir, classifier, findings, folder.notes, saliency, batch_size, quiet)


def write_evaluation(
    run_dir: Path,
    classifier: Classifier,
    findings: Findings,
    notes: Sequence[str],
    saliency: bool | None = None,
    batch_size: int | None = None,
    quiet: bool = False,
) -> Evaluation:
    """Write what was found; arguments as in `evaluate_captures`.

    Raises:
        ToolkitError: `run_dir` cannot be written.
    """
    maps = draw_saliency(findings.flips, classifier, saliency, batch_size, quiet)
    notes = (*notes, *([f"no saliency maps: {maps.reason}"] if saliency and maps.reason else []))
    write_predictions(run_dir / "predictions.csv", findings.predictions)
    summary = summarise(classifier, findings, notes)
    write_json(run_dir / "summary.json", summary)
    done = Evaluation(**vars(findings), run_dir=run_dir, notes=notes, summary=summary)
    write_report(done.report_file, classifier, findings, notes, maps)
    return done


def check_run_name(name: str) -> str:
    """The name of a run, if it can be that of a folder.

    Raises:
        ToolkitError: it cannot.
    """
    if not RUN_NAME.match(name):
        raise ToolkitError(f"--run '{name}': expected letters, digits, '.', '_' and '-', such as 'resnet18-tuesday'")
    return name
