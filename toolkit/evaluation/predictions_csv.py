"""Write and read `predictions.csv` and `detections.csv`, a row for each image, and find the images again."""

import csv
import io
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from sys import intern
from typing import TYPE_CHECKING, Any, Protocol

from toolkit.captures.capture import Capture
from toolkit.captures.corrupted_copy import name_source
from toolkit.core.child import without_collector
from toolkit.core.errors import ToolkitError
from toolkit.core.extras import import_package
from toolkit.core.files import MOST_NAME_BYTES, inside, open_plain, sha256_file
from toolkit.core.tables import FormattedNumber, decode_cell, encode_csv
from toolkit.core.text import shorten
from toolkit.core.workspace import Workspace
from toolkit.evaluation.prediction import OK, Detection, Prediction
from toolkit.evaluation.run_files import DETECTIONS, PREDICTIONS
from toolkit.evaluation.summaries import Run

if TYPE_CHECKING:
    import pandas

COLUMNS: dict[str, type] = {
    "source": str, "object": str, "variant": str, "pose_id": int, "path": str, "true_index": int, "true_label": str,
    "top1_index": int, "top1_label": str, "top1_prob": float, "true_prob": float, "true_rank": int,
    "correct_top1": bool, "correct_top5": bool, "status": str, "failed_gates": str,
}  # fmt: skip
NEEDED = [name for name in COLUMNS if name != "failed_gates"]
"""Columns of older runs too."""


def encode_predictions(predictions: Iterable[Prediction]) -> str:
    """Return the text of `predictions.csv`."""
    return encode_csv(list(COLUMNS), map(_row, predictions))


def _row(prediction: Prediction) -> Iterator[object]:
    capture = prediction.capture
    yield from (capture.source, capture.object, capture.variant, capture.pose_id, capture.path)
    yield from (prediction.true_index, prediction.true_label, prediction.top1_index, prediction.top1_label)
    # the true class's probability may be tiny: six significant digits in place of six decimals
    yield from (
        (f"{prediction.top1_prob:.6f}", f"{prediction.true_prob:.6g}", prediction.true_rank)
        if prediction.is_read
        else (None,) * 3
    )
    yield from (int(prediction.correct_top1), int(prediction.correct_top5)) if prediction.is_read else (None,) * 2
    yield from (prediction.status, "; ".join(capture.failed_gates))


DETECTION_COLUMNS: dict[str, type] = {
    "source": str, "object": str, "variant": str, "pose_id": int, "path": str, "true_label": str, "true_box": tuple,
    "found": bool, "score": float, "iou": float, "box": tuple, "strongest_label": str, "strongest_score": float,
    "status": str,
}  # fmt: skip
MOST_LEVELS = 20
"""Depth to which folders are listed once each; deeper files are looked up one by one."""
FILE, FOLDER, LINK = "file", "folder", "link"


def make_detected(capture: Capture, true_label: str, detection: Detection, status: str = OK) -> Prediction:
    """Return a detection as a prediction for pairs and tests, correct if the object is found, without ranks."""
    if status != OK:
        return Prediction(capture, -1, true_label, status=status, detection=detection)
    # the score takes the place of a classifier's probability: flips are sorted by it
    strongest, score = detection.strongest_label, detection.score or 0.0
    # a wrong answer of the true class would look correct: it is called not found
    wrong = strongest if strongest and strongest != true_label else "not found"
    return Prediction(
        capture, -1, true_label, top1_label=true_label if detection.found else wrong, top1_prob=score, true_prob=score,
        true_rank=1 if detection.found else None, detection=detection,
    )  # fmt: skip


def encode_detections(predictions: Iterable[Prediction]) -> str:
    """Return the text of `detections.csv`."""
    rows = []
    for prediction in predictions:
        capture, said = prediction.capture, prediction.detection or Detection()
        rows.append([
            capture.source, capture.object, capture.variant, capture.pose_id, capture.path,
            prediction.true_label, format_box(said.true_box), None if said.found is None else int(said.found),
            _round(said.score), _round(said.iou), format_box(said.box),
            said.strongest_label, _round(said.strongest_score), prediction.status,
        ])  # fmt: skip
    return encode_csv(list(DETECTION_COLUMNS), rows)


def _round(share: float | None) -> str | None:
    return None if share is None else f"{share:.4f}"


def format_box(box: Iterable[float] | None) -> FormattedNumber | None:
    """Return a box as a cell, with a decimal each."""
    return None if box is None else FormattedNumber(" ".join(f"{float(side):.1f}" for side in box))


def read_detection(line: Mapping[str, str]) -> Detection:
    """Return the detection of a row; a `ValueError` if a cell is no number or box."""
    names = [field.name for field in fields(Detection)]
    return Detection(**{name: _parse(line[name], DETECTION_COLUMNS[name]) for name in names})


def _parse(cell: str, kind: type) -> Any:
    if not cell:
        return None
    if kind is bool:
        if cell not in ("0", "1"):
            raise ValueError(f"'{shorten(cell, MOST_SHOWN)}': expected 0 or 1")
        return cell == "1"
    if kind is str:
        return cell
    # a box is four numbers, any other cell a single number
    numbers = tuple(map(float, cell.split()))
    if len(numbers) != (4 if kind is tuple else 1) or not all(map(math.isfinite, numbers)):
        raise ValueError(f"'{shorten(cell, MOST_SHOWN)}' is no {'box' if kind is tuple else 'number'}")
    return numbers if kind is tuple else numbers[0]


MOST_SHOWN, MOST_NUMBER = 40, 2**31 - 1
"""Letters of a wrong cell in a message; largest class or pose number, 32 bits as in Parquet."""


@lru_cache(maxsize=1 << 14)  # poses, classes and ranks repeat
def _read_number(cell: str, least: int) -> int:
    # Python refuses very long numbers
    number = int(cell) if len(cell) < 20 else MOST_NUMBER + 1
    if not least <= number <= MOST_NUMBER:
        raise ValueError(f"'{shorten(cell, MOST_SHOWN)}': expected a whole number from {least} to {MOST_NUMBER}")
    return number


def _read_share(cell: str) -> float:
    share = float(cell)
    if not 0 <= share <= 1:  # also NaN
        raise ValueError(f"'{shorten(cell, MOST_SHOWN)}': expected a probability from 0 to 1")
    return share


REPEATED = ("source", "object", "variant", "true_label", "top1_label", "status")
"""Columns with few different texts, each kept once in memory."""


def find_captures_dir(workspace: Workspace, run: Run) -> Path:
    """Return the folder of a run's images: sweeps and worlds have their own, others the workspace's captures."""
    if run.kind == "world-eval":
        return run.folder / "frames"
    if run.kind != "sweep":
        return workspace.captures_dir
    axis = run.folder.resolve().parent
    # `captures-SET` holds the images of runs whose name ends in -SET, or in -SET-2 for another result of that name
    names = (run.folder.name, re.sub(r"-\d+$", "", run.folder.name))
    ends = [(folder, folder.name.removeprefix("captures")) for folder in axis.glob("captures-*")]
    of_sets = [folder for folder, end in ends if any(name.endswith(end) for name in names)]
    # the longest: a set's name may be the end of another's
    return max(of_sets, key=lambda folder: len(folder.name), default=axis / "captures")


def read_predictions(run: Run, captures_dir: Path) -> list[Prediction]:
    """Read `predictions.csv` of a run, or a detector's `detections.csv`, in which correct means found.

    The capture of an image that was corrupted when it was read names the original file.

    Raises:
        ToolkitError: there is no such file (benchmarks and landings have none), or it is damaged.
    """
    file = run.folder / (DETECTIONS if run.kind == "detection" else PREDICTIONS)
    if not file.is_file():
        raise ToolkitError(f"{run.name} holds no {file.name}: a run of kind '{run.kind}' has no results by image")
    # `sim` of `sim-fog-3`
    ends = {row.source: name_source("", (row.condition, row.severity or 0)) for row in run.rows}
    sources = {source: source.removesuffix(end) for source, end in ends.items()}
    try:
        with open_plain(file) as stream:
            text = io.StringIO(stream.read().decode("utf-8"), newline="")
        lines = csv.reader(text, strict=True)
        # older files may lack columns that are not needed
        names = next(lines, [])
        needed = DETECTION_COLUMNS if run.kind == "detection" else NEEDED
        missing = [name for name in needed if name not in names]
        if missing:
            raise ToolkitError(f"{file}: no column '{missing[0]}': run 'toolkit eval' again")
        # most files hold no quote, and need no decoding of cells
        find, is_escaped = _within(captures_dir), "'" in text.getvalue()
        with without_collector():
            cells = (map(decode_cell, line) if is_escaped else line for line in lines if line)
            return [_read_line(dict(zip(names, line, strict=False)), find, sources) for line in cells]
    except (OSError, csv.Error, LookupError, TypeError, ValueError) as error:
        raise ToolkitError(f"{file} is damaged ({error}): run 'toolkit eval' again") from None


Find = Callable[[str], tuple[Path, str]]


def _within(root: Path) -> Find:
    """Return a function: `inside` and the kind of a path, for many paths; each folder is listed once."""
    folders = {"": (there := inside(root, ""), _list_kinds(there))}

    def look(path: str) -> tuple[Path, str]:
        head, _, name = path.rpartition("/")
        # a plain path cannot lead elsewhere, and needs no further check
        is_plain = path.isascii() and path.isprintable() and path[:1] != "/" and "\\" not in path
        if is_plain and name not in ("", ".", "..") and len(name) <= MOST_NAME_BYTES and path.count("/") < MOST_LEVELS:
            if head not in folders:
                there, kind = look(head)
                folders[head] = there, _list_kinds(there) if kind == FOLDER else {}
            folder, kinds = folders[head]
            # a link, or a path that is not plain, goes through the full check
            if kinds.get(name) != LINK:
                return folder / name, kinds.get(name, "")
        place = inside(root, path)
        return place, FILE if place.is_file() else FOLDER if place.is_dir() else ""

    return look


def _list_kinds(folder: Path) -> dict[str, str]:
    """Return the kind of each file, folder and link in a folder, by name."""
    try:
        with os.scandir(folder) as found:
            return {
                entry.name: LINK if entry.is_symlink() else FILE if entry.is_file() else FOLDER
                for entry in found if entry.is_symlink() or entry.is_file() or entry.is_dir()
            }  # fmt: skip
    except OSError:  # it is not there
        return {}


def _read_line(line: dict[str, str], find: Find, sources: Mapping[str, str]) -> Prediction:
    # interned: a single copy of each text for all lines
    for name in REPEATED:
        if name in line:
            line[name] = intern(line[name])
    path, source = line["path"], line["source"]
    file, kind = find(path)
    head, _, rest = path.partition("/")
    # not under its own path: it was corrupted when it was read, so take the original file
    if kind != FILE and sources.get(head, head) != head:
        file, _ = find(f"{sources[head]}/{rest}")
    gates = tuple(filter(None, (line.get("failed_gates") or "").split("; ")))
    pose_id = _read_number(line["pose_id"], 0) if line["pose_id"] else None
    corruption = None
    if line.get("weather"):  # of a world: a camera has the same number in all weathers
        corruption = (line["weather"], _read_number(line["severity"], 0))
        source = " ".join([line["world"], line["place"], *map(str, corruption)])
    capture = Capture(
        source, line["object"], line["variant"], pose_id, file, path, corruption=corruption, failed_gates=gates
    )
    if "found" in line:
        return make_detected(capture, line["true_label"], read_detection(line), line["status"])
    # -1 where the truth is not known
    true_index = _read_number(line["true_index"], -1)
    if line["status"] != OK:
        return Prediction(capture, true_index, line["true_label"], status=line["status"])
    return Prediction(
        capture, true_index, line["true_label"], top1_index=_read_number(line["top1_index"], 0),
        top1_label=line["top1_label"], top1_prob=_read_share(line["top1_prob"]),
        true_prob=_read_share(line["true_prob"]), true_rank=_read_number(line["true_rank"], 1),
    )  # fmt: skip


def has_own_file(prediction: Prediction, captures_dir: Path) -> bool:
    """Whether the image has its own file; an image that was corrupted when it was read has none."""
    file = prediction.capture.file
    return file == inside(captures_dir, prediction.capture.path) and file.is_file()


def hash_images(predictions: Sequence[Prediction]) -> Iterator[str | None]:
    """Yield the SHA-256 of each image's file as it is now; None if the file is gone."""
    for prediction in predictions:
        try:
            yield sha256_file(prediction.capture.file)
        except (OSError, ValueError):
            yield None


PANDAS = {str: "string", int: "Int64", float: "Float64", bool: "boolean"}
"""pandas types with `NA`."""


class Written(Protocol):
    """A result with a folder `eval/RUN`, such as that of `evaluate_captures`."""

    @property
    def run_dir(self) -> Path:
        """Folder of the run."""


def predictions_table(run: Written | Path | str) -> "pandas.DataFrame":
    """Return the predictions of an evaluation as a pandas `DataFrame`, a row for each image.

    Columns: source, object, variant, pose_id, path, true_index, true_label, top1_index, top1_label, top1_prob,
    true_prob (both in [0, 1]), true_rank (from 1), correct_top1, correct_top5, status (`ok`, or why the image was not
    read), failed_gates (empty for none). Unknown values are `NA`.

    `predictions_table(result).groupby(["object", "variant"]).correct_top1.mean()` is the accuracy of each variant.

    Args:
        run: result of `evaluate_captures`, or a folder `eval/RUN`.

    Raises:
        ToolkitError: pandas is not installed, or the folder holds no predictions.
    """
    pandas = import_package("pandas", "pandas", "predictions_table")
    folder = Path(run) if isinstance(run, str | Path) else run.run_dir
    file = folder / "predictions.csv"
    if not file.is_file():
        raise ToolkitError(f"{folder} holds no predictions.csv: expected the folder of an evaluation, eval/RUN")
    # an object may be called "null" or "NA": only empty cells are unknown
    table = pandas.read_csv(file, dtype="string", keep_default_na=False, na_values=[""])
    missing = [name for name in NEEDED if name not in table.columns]
    if missing:
        raise ToolkitError(f"{file}: no column '{missing[0]}': run 'toolkit eval' again")
    # cells as they were before they were quoted for spreadsheets
    for name in table.columns:
        table[name] = table[name].map(decode_cell, na_action="ignore").astype("string")
    if "failed_gates" in table.columns:
        table["failed_gates"] = table["failed_gates"].fillna("")
    for name in ("correct_top1", "correct_top5"):
        # empty if the image was not read: neither right nor wrong
        table[name] = table[name].map({"1": True, "0": False})
    return table.astype({name: PANDAS[COLUMNS[name]] for name in NEEDED})
