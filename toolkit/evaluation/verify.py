"""`toolkit verify`: compute a result again from its images and weights, and compare the two."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolkit.core.errors import ToolkitError
from toolkit.core.files import load_json
from toolkit.core.workspace import Workspace
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.evaluate import ASKED, judge_captures
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.predictions_csv import encode_predictions, read_predictions
from toolkit.evaluation.results import summarise
from toolkit.evaluation.summaries import SUMMARY, Run, begin_summary, open_run
from toolkit.models.network import Classifier

ANSWERS = ("true_index", "top1_index", "correct_top1", "correct_top5", "status")
"""Fields that a result counts; the last digits of probabilities may differ between machines."""
COUNTED = ("groups", "pairs", "controls")
"""Parts of a summary that follow from the predictions."""


@dataclass(frozen=True)
class Verified:
    """A result against its computation now.

    Attributes:
        differing: (path, difference) of images with another prediction, or in one table alone.
        other_digits: number of images with the same prediction and other digits of a probability.
        parts: `images` if their files differ, and parts of the summary that differ.
    """

    run: str
    n: int
    differing: tuple[tuple[str, str], ...]
    other_digits: int
    parts: tuple[str, ...]

    @property
    def is_same(self) -> bool:
        """Whether the result is the same."""
        return not self.differing and not self.parts

    def as_json(self) -> dict[str, Any]:
        """Return the result for a script."""
        differing = [{"path": path, "reason": why} for path, why in self.differing]
        return vars(self) | {"same": self.is_same, "differing": differing, "parts": list(self.parts)}

    def describe(self) -> str:
        """Return the result as a sentence."""
        digits = f", {self.other_digits} with other digits of a probability" if self.other_digits else ""
        if self.is_same:
            return f"{self.run}: the same result, {self.n} of {self.n} answers{digits}"
        parts = f"; {', '.join(self.parts)} of {SUMMARY} differ" if self.parts else ""
        return f"{self.run}: NOT the same result: {len(self.differing)} of {self.n} answers differ{parts}"


def read_asked(workspace: Workspace, name: str | Path) -> tuple[Run, dict[str, Any]]:
    """Return a run and its summary; a `ToolkitError` if the summary does not hold what the run was asked."""
    run = open_run(workspace, name)
    summary = load_json(run.folder / SUMMARY)
    asked = summary.get("asked")
    if not (isinstance(asked, dict) and isinstance(asked.get("captures"), str) and asked.keys() >= set(ASKED)):
        raise ToolkitError(
            f"{run.folder / SUMMARY} does not state from which folder it was made (kind '{run.kind}', or an earlier "
            "version): only results of 'toolkit eval' with a classifier can be verified; run it again"
        )
    return run, summary


def verify_run(workspace: Workspace, name: str | Path, classifier: Classifier) -> Verified:
    """Compute a result of `toolkit eval` again, and compare it with its files; nothing is written.

    Raises:
        ToolkitError: as `read_asked` and `evaluate_captures`, or the network is not the run's.
    """
    run, summary = read_asked(workspace, name)
    asked, model = summary["asked"], summary["model"]
    here = begin_summary("eval", classifier)["model"]
    # weights that were saved again are the same network; older summaries hold only the hash of the file
    field = "network_id" if model.get("network_id") else "sha256"
    if model.get(field) != here[field]:
        raise ToolkitError(
            f"{run.name}: judged by {model.get('name')} with {field} {model.get(field)}, and {classifier.name} here "
            f"has {here[field]}: name the network that judged with --model or --weights"
        )
    # classify again
    captures_dir = workspace.root / asked["captures"]
    config = EvalConfig(**{key: asked[key] for key in ASKED}, saliency=False)
    findings, notes = judge_captures(captures_dir, workspace, classifier, config)
    before = {prediction.capture.path: prediction for prediction in read_predictions(run, captures_dir)}
    now = {prediction.capture.path: prediction for prediction in findings.predictions}
    # compare predictions, image hashes and statistics
    differing = {path: why for path in sorted(before | now) if (why := _compare(before.get(path), now.get(path)))}
    again = summarise(classifier, findings, notes)
    before_sha256 = (summary.get("rests_on") or {}).get("images_sha256")
    images = ["images"] if before_sha256 != again["rests_on"]["images_sha256"] else []
    parts = (*images, *(part for part in COUNTED if _round(again[part]) != _round(summary.get(part))))
    same = [path for path in before if path not in differing]
    other_digits = sum(encode_predictions([before[path]]) != encode_predictions([now[path]]) for path in same)
    return Verified(run.name, len(before), tuple(differing.items()), other_digits, parts)


def _compare(before: Prediction | None, now: Prediction | None) -> str | None:
    """Return how two predictions for an image differ, in words; None if nothing that counts differs."""
    if before is None:
        return "not in the table"
    if now is None:
        return "in the table, and does not count now"
    names = [name for name in ANSWERS if getattr(before, name) != getattr(now, name)]
    was, is_now = (", ".join(f"{name} {getattr(prediction, name)}" for name in names) for prediction in (before, now))
    return f"{was} in the table, {is_now} now" if names else None


def _round(content: Any) -> Any:
    """Return a part of a summary with rounded numbers, as last digits differ between machines."""
    if isinstance(content, float):
        return round(content, 4)
    if isinstance(content, dict):
        return {key: _round(value) for key, value in content.items()}
    return [_round(item) for item in content] if isinstance(content, list | tuple) else content
