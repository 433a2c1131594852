"""What a finished run said of each image: its `predictions.csv` read back, and the images where they still are."""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from toolkit.captures.corrupted_copy import name_source
from toolkit.captures.manifest import CaptureRecord, read_manifest
from toolkit.captures.read import Capture
from toolkit.core.errors import ToolkitError
from toolkit.core.files import inside, open_plain, sha256_file
from toolkit.core.workspace import Workspace
from toolkit.evaluation.detections_csv import COLUMNS, make_detected, read_detection
from toolkit.evaluation.predict import OK, Prediction
from toolkit.evaluation.predictions_csv import NEEDED
from toolkit.evaluation.runs import DETECTIONS, PREDICTIONS, Run


def find_captures_dir(workspace: Workspace, run: Run) -> Path:
    """The folder that the images of a run lie in: sweeps and worlds have their own, others the workspace's captures."""
    if run.kind == "world-eval":
        return run.folder / "frames"
    if run.kind != "sweep":
        return workspace.captures_dir
    axis = run.folder.resolve().parent
    of_sets = [one for one in axis.glob("captures-*") if run.folder.name.endswith(one.name.removeprefix("captures"))]
    return max(of_sets, key=lambda one: len(one.name), default=axis / "captures")


def read_predictions(run: Run, captures_dir: Path) -> list[Prediction]:
    """Read `predictions.csv` of a run, or a detector's `detections.csv`, where right means found.

    An image that was corrupted when it was read has no file of its own: its capture names the file before that.

    Args:
        run: whose.
        captures_dir: where the images lie; those that are gone have captures all the same.

    Raises:
        ToolkitError: there is no such file (a benchmark's and landing's runs have none), or it is damaged.
    """
    file = run.folder / (DETECTIONS if run.kind == "detection" else PREDICTIONS)
    if not file.is_file():
        raise ToolkitError(
            f"{run.name} holds no {file.name}: a run of kind '{run.kind}' cannot be taken apart by image"
        )
    sources = {row.source: _find_uncorrupted(row.source, row.condition, row.severity) for row in run.rows}
    try:
        with open_plain(file) as stream:
            text = io.StringIO(stream.read().decode("utf-8"), newline="")
        lines = csv.DictReader(text, strict=True)
        needed = COLUMNS if run.kind == "detection" else NEEDED
        missing = [name for name in needed if name not in (lines.fieldnames or ())]
        if missing:
            raise ToolkitError(f"{file}: no column '{missing[0]}': evaluate the captures again")
        return [_read_line(line, captures_dir, sources) for line in lines]
    except (OSError, csv.Error, TypeError, ValueError) as error:
        raise ToolkitError(f"{file} is damaged ({error}): evaluate the captures again") from None


def _find_uncorrupted(source: str, condition: str, severity: int | None) -> str:
    """`sim` of `sim-fog-3`."""
    return source.removesuffix(name_source("", (condition, severity or 0)))


def _read_line(line: Mapping[str, str], captures_dir: Path, sources: Mapping[str, str]) -> Prediction:
    path, source = line["path"], line["source"]
    file = inside(captures_dir, path)
    if not file.is_file():
        head, _, rest = path.partition("/")
        file = inside(captures_dir, f"{sources.get(head, head)}/{rest}")
    gates = tuple(filter(None, (line.get("failed_gates") or "").split("; ")))
    pose_id = int(line["pose_id"]) if line["pose_id"] else None
    corruption = None
    if line.get("weather"):  # of a world: a camera has one number at each place, and many weathers
        corruption = (line["weather"], int(line["severity"]))
        source = " ".join([line["world"], line["place"], *map(str, corruption)])
    capture = Capture(
        source, line["object"], line["variant"], pose_id, file, path, corruption=corruption, failed_gates=gates
    )
    if "found" in line:
        return make_detected(capture, line["true_label"], read_detection(line), line["status"])
    if line["status"] != OK:
        return Prediction(capture, int(line["true_index"]), line["true_label"], status=line["status"])
    return Prediction(
        capture, int(line["true_index"]), line["true_label"], int(line["top1_index"]), line["top1_label"],
        float(line["top1_prob"]), float(line["true_prob"]), int(line["true_rank"]),
    )  # fmt: skip


def has_own_file(one: Prediction, captures_dir: Path) -> bool:
    """Whether the image is there as it was judged; one that was corrupted when it was read is not."""
    return one.capture.file == inside(captures_dir, one.capture.path) and one.capture.file.is_file()


def hash_images(predictions: Sequence[Prediction], captures_dir: Path) -> Iterator[str | None]:
    """SHA-256 of each image's file, from its source's manifest where that has it; None of a file that is gone."""
    known: dict[Path, dict[str, CaptureRecord]] = {}
    for one in predictions:
        capture = one.capture
        source_dir = captures_dir / capture.source
        if source_dir not in known:
            known[source_dir] = read_manifest(source_dir)
        record = known[source_dir].get(capture.path_in_source)
        try:
            yield (record and record.image_sha256) or sha256_file(capture.file)
        except (OSError, ValueError):
            yield None
