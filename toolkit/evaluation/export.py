"""Export predictions of many runs: a table (Parquet, CSV), or a folder for FiftyOne, COCO's tools or the Hub."""

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolkit import __version__
from toolkit.captures.truth import as_bbox, write_instances
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.extras import import_package
from toolkit.core.files import real_path, write_bytes, write_json, write_text
from toolkit.core.tables import encode_csv
from toolkit.core.text import count_of
from toolkit.core.workspace import Workspace
from toolkit.evaluation.imagefolder import check_names, write_imagefolder
from toolkit.evaluation.origin import explain_replaced
from toolkit.evaluation.prediction import Box, Detection, Prediction
from toolkit.evaluation.predictions_csv import (
    COLUMNS,
    DETECTION_COLUMNS,
    find_captures_dir,
    format_box,
    has_own_file,
    read_predictions,
)
from toolkit.evaluation.summaries import Run, find_runs, open_run
from toolkit.imaging.read import read_image

SCHEMA_VERSION = 1
VERSION_KEY = b"toolkit_schema_version"
HEADS: dict[str, type] = {"run": str, "network": str, "condition": str, "severity": int}
FORMS = {
    "parquet": "predictions.parquet", "csv": "predictions.csv", "fiftyone": "fiftyone", "coco": "coco",
    "imagefolder": "imagefolder",
}  # fmt: skip
"""Name of the file or folder below `eval/`."""
Row = dict[str, Any]


@dataclass(frozen=True)
class Exported:
    """Predictions that were written.

    Attributes:
        form: a key of `FORMS`.
        count: rows of a table, else images.
        left_out: number of predictions for images without a file, or that could not be read.
        replaced: a sentence on each run whose images were replaced after the run.
    """

    place: Path
    form: str
    count: int
    runs: tuple[str, ...]
    left_out: int
    skipped: Sequence[tuple[str, str]]
    replaced: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return the result for a script."""
        about = {"file": str(self.place), "format": self.form, "count": self.count}
        return about | {"runs": list(self.runs), "left_out": self.left_out, "notes": [*self.replaced]}

    def lines(self) -> Iterator[str]:
        """Yield what was written, and where."""
        runs = count_of(len(self.runs), "run")
        if self.form == "fiftyone":
            yield f"{self.count} images, {runs}; with FiftyOne: python {self.place / 'load.py'}"
        elif self.form == "coco":
            yield f"{self.count} images, {runs}; {self.place}/RUN/instances.json, results.json"
        elif self.form == "imagefolder":
            yield f"{self.count} images with their labels: {self.place}; README.md and croissant.json describe them"
        else:
            yield f"{self.count} predictions of {runs}: {self.place}"

    def warnings(self) -> Iterator[str]:
        """Yield warnings: replaced images, and what was left out."""
        yield from self.replaced
        if self.left_out and self.form == "imagefolder":
            yield f"left out {self.left_out} images that cannot be read, or contradict their manifest"
        elif self.left_out:
            yield f"left out {self.left_out} answers to images that have no file of their own, or could not be read"


def export_predictions(
    workspace: Workspace, names: Sequence[str] = (), form: str = "parquet", out: Path | None = None,
    captures_dir: Path | None = None,
) -> Exported:  # fmt: skip
    """Write the predictions of runs, by default of all runs that have any, as a table or a folder.

    Args:
        form: `parquet`, `csv`, `fiftyone`, `coco` (detectors), or `imagefolder`: all captures, with the predictions of
            the named runs.
        out: file or folder to write; by default below `eval/`.
        captures_dir: folder of the images; by default each run's own, for an image folder `captures/`.

    Raises:
        ToolkitError: there is no such form or run, predictions are missing or damaged, images are missing, a package is
            not installed, or the place cannot be written.
    """
    if form not in FORMS:
        raise FieldError(f"expected {', '.join(FORMS)}", {"to": form})
    # a name that says another form would mislead other programs
    said = out.suffix.lower().removeprefix(".") if out else ""
    if said != form and said in ("parquet", "csv"):
        raise FieldError(f"{form} would be written under a name of {said}: give {{to}} {said}", {"out": out})
    refused: Sequence[tuple[str, str]] = ()
    # the runs that are named, or all that have predictions
    if names:
        # a run that is named twice, as by name and by folder, is one run
        runs = list({real_path(run.folder): run for run in (open_run(workspace, name) for name in names)}.values())
    elif form == "imagefolder":
        runs = []  # the images need no run
    else:
        found, refused = find_runs(workspace)
        runs = [run for run in found if run.has_predictions and (form != "coco" or run.kind == "detection")]
    if not runs and form != "imagefolder":
        wanted = "of a detector" if form == "coco" else "with predictions"
        raise ToolkitError(f"{workspace.eval_dir} holds no run {wanted}: make one with 'toolkit eval'")
    place, left_out = out or workspace.eval_dir / FORMS[form], 0
    # a table is a single file, the other forms are folders
    if form in ("parquet", "csv"):
        count = (write_parquet if form == "parquet" else write_csv)(place, workspace, runs, captures_dir)
    else:
        write = {"fiftyone": write_fiftyone, "coco": write_coco_results, "imagefolder": write_imagefolder}[form]
        count, left_out = write(place, workspace, runs, captures_dir)
    # a run's images may have been shot again since: the reader is told
    folders = [captures_dir or find_captures_dir(workspace, run) for run in runs]
    replaced = [
        line for run, folder in zip(runs, folders, strict=True)
        for line in explain_replaced(run, read_predictions(run, folder), folder)
    ]  # fmt: skip
    return Exported(place, form, count, tuple(run.name for run in runs), left_out, refused, tuple(replaced))


def write_parquet(path: Path, workspace: Workspace, runs: Sequence[Run], captures_dir: Path | None = None) -> int:
    """Write the predictions of runs as a Parquet table, a row for each run and image; return their number.

    Columns are run, network, condition and severity, then those of `predictions.csv`, or of `detections.csv` with boxes
    as lists; unknown values are null.
    """
    arrow, parquet = (import_package(name, "parquet", "Parquet") for name in ("pyarrow", "pyarrow.parquet"))
    columns, rows = _list_rows(workspace, runs, captures_dir)
    kinds = {
        str: arrow.string(), int: arrow.int32(), float: arrow.float64(), bool: arrow.bool_(),
        tuple: arrow.list_(arrow.float64()),
    }  # fmt: skip
    # the version of the columns stands in the file itself
    about = {VERSION_KEY: str(SCHEMA_VERSION).encode(), b"toolkit_version": __version__.encode()}
    # types are given, not guessed: an empty column keeps its type
    schema = arrow.schema([(name, kinds[kind]) for name, kind in columns.items()], metadata=about)
    stream = io.BytesIO()
    parquet.write_table(arrow.Table.from_pylist(rows, schema=schema), stream, compression="zstd")
    write_bytes(path, stream.getvalue())
    return len(rows)


def write_csv(path: Path, workspace: Workspace, runs: Sequence[Run], captures_dir: Path | None = None) -> int:
    """Write the table of `write_parquet` as CSV: booleans as 1 or 0, a box as x1 y1 x2 y2, unknown cells empty."""
    columns, rows = _list_rows(workspace, runs, captures_dir)

    def encode(value: object) -> object:
        return format_box(value) if isinstance(value, tuple) else int(value) if isinstance(value, bool) else value

    write_text(path, encode_csv(list(columns), ([encode(row.get(name)) for name in columns] for row in rows)))
    return len(rows)


def _list_rows(
    workspace: Workspace, runs: Sequence[Run], captures_dir: Path | None
) -> tuple[dict[str, type], list[Row]]:
    """Return the columns with their types, and a row for each run and image."""
    columns, rows = dict(HEADS), []
    for run in runs:
        # older runs lack the column of failed gates, which only photographs have
        known = DETECTION_COLUMNS if run.kind == "detection" else COLUMNS
        own = {name: kind for name, kind in known.items() if name != "failed_gates"}
        columns |= own
        # the condition of each source, by the run's own rows
        conditions: dict[str, tuple[str, str | None, int | None]] = {
            row.source: (row.network, row.condition, row.severity) for row in run.rows
        }
        for prediction in read_predictions(run, captures_dir or find_captures_dir(workspace, run)):
            network, condition, severity = conditions.get(prediction.capture.source, (run.rows[0].network, None, None))
            # corrupted images state their own condition
            if prediction.capture.corruption is not None:
                condition, severity = prediction.capture.corruption
            row: Row = {"run": run.name, "network": network, "condition": condition, "severity": severity}
            holders = (prediction.capture, prediction.detection, prediction)
            for name in own:
                row[name] = next(getattr(holder, name) for holder in holders if hasattr(holder, name))
            # an image that was not read is neither right nor wrong
            if not prediction.is_read:
                row |= {name: None for name in ("correct_top1", "correct_top5") if name in own}
            rows.append(row)
    return columns, rows


LOADER = '''\
"""Import this folder into FiftyOne: python load.py [NAME]."""

import json
import sys
from pathlib import Path

import fiftyone as fo

here = Path(__file__).resolve().parent
dataset = fo.Dataset(sys.argv[1] if len(sys.argv) > 1 else None, persistent=len(sys.argv) > 1)
# the fields of this export: a file of an earlier export would number other images
for field in FIELDS:
    labels = here / "labels" / f"{field}.json"
    has_boxes = any(isinstance(one, list) for one in json.loads(labels.read_text())["labels"].values())
    kind = "FiftyOneImageDetectionDataset" if has_boxes else "FiftyOneImageClassificationDataset"
    dataset.merge_dir(
        dataset_type=getattr(fo.types, kind), data_path=str(here / "data.json"), labels_path=str(labels),
        label_field=field,
    )
print(dataset)
if __name__ == "__main__":
    fo.launch_app(dataset).wait()
'''


def write_fiftyone(
    folder: Path, workspace: Workspace, runs: Sequence[Run], captures_dir: Path | None = None
) -> tuple[int, int]:
    """Write a folder that FiftyOne imports; FiftyOne need not be installed here, and no image is copied.

    `data.json` holds the path of each image. `labels/` has a file for each field: `ground_truth`, `object`, `variant`,
    `source` and `prediction_RUN` as `FiftyOneImageClassificationDataset`, for detectors `ground_truth_boxes` and
    `prediction_RUN` as `FiftyOneImageDetectionDataset`. `load.py` merges them into a data set.

    Returns:
        Number of images, and number of predictions without a file: of images that are gone, unreadable, or were
        corrupted when they were read.
    """
    files: dict[str, str] = {}
    fields: dict[str, dict[str, object]] = {}
    left_out = 0
    check_names(runs, _as_name)
    for run in runs:
        # images that are gone, unreadable or corrupted in memory have no file to show
        placed, gone = _read_placed(workspace, run, captures_dir)
        left_out += gone
        for prediction in placed:
            # a number for each file, shared by all runs
            key = files.setdefault(str(prediction.capture.file), f"{len(files):06d}")
            labels: dict[str, object] = {
                name: getattr(prediction.capture, name) for name in ("object", "variant", "source")
            }
            said, column = prediction.detection, f"prediction_{_as_name(run)}"
            if said is None:
                names = {"correct": "correct_top1", "true_prob": "true_prob", "true_rank": "true_rank"}
                about = {name: getattr(prediction, field) for name, field in names.items()}
                answer = {"label": prediction.top1_label, "confidence": prediction.top1_prob, "attributes": about}
                labels |= {"ground_truth": prediction.true_label, column: answer}
            else:
                size = _measure_image(prediction)
                about = {"confidence": said.score, "attributes": {"found": said.found, "iou": said.iou}}
                labels["ground_truth_boxes"] = _place_box(prediction.true_label, said.true_box, size)
                labels[column] = _place_box(prediction.true_label, said.box, size, about)
            for name, label in labels.items():
                fields.setdefault(name, {})[key] = label
    # samples by file, and a label file of each field: FiftyOne reads images from where they are
    if not files:
        raise ToolkitError(f"no image of {', '.join(run.name for run in runs)} is there: name their folder")
    write_json(folder / "data.json", {key: file for file, key in files.items()})
    for name, labels in fields.items():
        write_json(folder / "labels" / f"{name}.json", {"labels": labels})
    write_text(folder / "load.py", LOADER.replace("FIELDS", repr(sorted(fields))))
    return len(files), left_out


def _place_box(
    label: str, box: Box | None, size: tuple[int, int], about: Mapping[str, object] | None = None
) -> list[dict[str, object]]:
    """Return a detection or none, its box in shares of the image's width and height."""
    if box is None:
        return []
    # x and width are shares of the image's width, y and height of its height
    shares = [side / size[k % 2] for k, side in enumerate(as_bbox(box))]
    return [{"label": label, "bounding_box": shares, **(about or {})}]


def _as_name(run: Run) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "_", run.name)


def _measure_image(prediction: Prediction) -> tuple[int, int]:
    """Return width and height of the upright image."""
    height, width = read_image(prediction.capture.file).shape[:2]
    return width, height


def _read_placed(workspace: Workspace, run: Run, captures_dir: Path | None) -> tuple[list[Prediction], int]:
    """Return the predictions whose image still has its own file, and the number of others."""
    place = captures_dir or find_captures_dir(workspace, run)
    predictions = read_predictions(run, place)
    placed = [prediction for prediction in predictions if prediction.is_read and has_own_file(prediction, place)]
    return placed, len(predictions) - len(placed)


def write_coco_results(
    folder: Path, workspace: Workspace, runs: Sequence[Run], captures_dir: Path | None = None
) -> tuple[int, int]:
    """Write each detector's run into `folder/RUN/` in COCO's format: `instances.json` and `results.json`.

    The first is the truth, with `file_name` below the captures. The second has the best box of each image, which is
    all that a run keeps: for average precision see its `summary.json`. No image is copied. Returns as `write_fiftyone`.
    """
    total = left_out = 0
    check_names(runs, _as_name)
    for run in runs:
        # only runs of detectors have boxes
        if run.kind != "detection":
            raise ToolkitError(f"{run.name} holds no boxes (kind '{run.kind}'): expected a run of a detector")
        placed, gone = _read_placed(workspace, run, captures_dir)
        if not placed:
            raise ToolkitError(f"no image of {run.name} is there: name their folder")
        categories = sorted({prediction.true_label for prediction in placed})
        images: list[Row] = []
        truths: list[Row] = []
        results: list[Row] = []
        for number, prediction in enumerate(placed, 1):
            said, capture = prediction.detection or Detection(), prediction.capture
            width, height = _measure_image(prediction)
            # COCO counts categories from 1
            of = {"image_id": number, "category_id": categories.index(prediction.true_label) + 1}
            images.append({"id": number, "file_name": capture.path, "width": width, "height": height})
            if said.true_box is not None:
                box = as_bbox(said.true_box)
                about = {"object": capture.object, "variant": capture.variant, "pose_id": capture.pose_id}
                truths.append({"id": number, **of, "bbox": box, "area": box[2] * box[3], "iscrowd": 0, **about})
            if said.box is not None:
                results.append({**of, "bbox": as_bbox(said.box), "score": said.score})
        write_instances(folder / _as_name(run) / "instances.json", images, truths, categories)
        write_json(folder / _as_name(run) / "results.json", results)
        total, left_out = total + len(placed), left_out + gone
    return total, left_out
