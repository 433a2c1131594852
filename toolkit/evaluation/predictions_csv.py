"""`predictions.csv` and `detections.csv`, a row an image: written, read back, and the images where they still are."""

import csv
import io
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from sys import intern
from typing import TYPE_CHECKING, Any, Protocol

from toolkit.captures.capture import Capture
from toolkit.captures.corrupted_copy import name_source
from toolkit.core.child import without_collector
from toolkit.core.errors import ToolkitError
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
"""Runs from before there were gates lack that one."""


def encode_predictions(predictions: Iterable[Prediction]) -> str:
    """The text of the file."""
    return encode_csv(list(COLUMNS), map(_row, predictions))


def _row(one: Prediction) -> Iterator[object]:
    capture = one.capture
    yield from (capture.source, capture.object, capture.variant, capture.pose_id, capture.path)
    yield from (one.true_index, one.true_label, one.top1_index, one.top1_label)
    # the truth's probability may be tiny: six significant digits, where the first guess's has six decimals
    yield from (f"{one.top1_prob:.6f}", f"{one.true_prob:.6g}", one.true_rank) if one.is_read else (None,) * 3
    yield from (int(one.correct_top1), int(one.correct_top5)) if one.is_read else (None,) * 2
    yield from (one.status, "; ".join(capture.failed_gates))


DETECTION_COLUMNS: dict[str, type] = {
    "source": str, "object": str, "variant": str, "pose_id": int, "path": str, "true_label": str, "true_box": tuple,
    "found": bool, "score": float, "iou": float, "box": tuple, "strongest_label": str, "strongest_score": float,
    "status": str,
}  # fmt: skip
MOST_LEVELS = 20
"""Depth of folders that are listed once each; a deeper file is looked up by itself."""
FILE, FOLDER, LINK = "file", "folder", "link"


def make_detected(capture: Capture, true_label: str, detection: Detection, status: str = OK) -> Prediction:
    """A detector's answer as a prediction, right where the object is found: what pairs and tests take.

    Nothing is ranked: a wrong answer has no rank, and no class has a number.
    """
    if status != OK:
        return Prediction(capture, -1, true_label, status=status, detection=detection)
    # the score stands where a classifier has a probability: flips are sorted by it
    strongest, score = detection.strongest_label, detection.score or 0.0
    # a wrong answer of the true class would look right: it is called not found
    wrong = strongest if strongest and strongest != true_label else "not found"
    return Prediction(
        capture, -1, true_label, top1_label=true_label if detection.found else wrong, top1_prob=score, true_prob=score,
        true_rank=1 if detection.found else None, detection=detection,
    )  # fmt: skip


def encode_detections(predictions: Iterable[Prediction]) -> str:
    """The text of the file, of predictions that have a `detection`."""
    return encode_csv(list(DETECTION_COLUMNS), map(_write_detection, predictions))


def _write_detection(one: Prediction) -> Iterator[object]:
    capture, said = one.capture, one.detection or Detection()
    yield from (capture.source, capture.object, capture.variant, capture.pose_id, capture.path)
    yield from (one.true_label, format_box(said.true_box), None if said.found is None else int(said.found))
    yield from (_round(said.score), _round(said.iou), format_box(said.box))
    yield from (said.strongest_label, _round(said.strongest_score), one.status)


def _round(share: float | None) -> str | None:
    return None if share is None else f"{share:.4f}"


def format_box(box: Iterable[float] | None) -> FormattedNumber | None:
    """`10.0 20.0 30.0 40.0`."""
    return None if box is None else FormattedNumber(" ".join(f"{float(side):.1f}" for side in box))


def read_detection(line: Mapping[str, str]) -> Detection:
    """What a row of the file says; a `ValueError` where a cell is no number or box."""
    return Detection(
        **{field.name: _parse(line[field.name], DETECTION_COLUMNS[field.name]) for field in fields(Detection)}
    )


def _parse(cell: str, kind: type) -> Any:
    if not cell:
        return None
    if kind is bool:
        return cell == "1"
    if kind is str:
        return cell
    numbers = tuple(map(float, cell.split()))
    if len(numbers) != (4 if kind is tuple else 1) or not all(map(math.isfinite, numbers)):
        raise ValueError(f"'{shorten(cell, MOST_SHOWN)}' is no {'box' if kind is tuple else 'number'}")
    return numbers if kind is tuple else numbers[0]


MOST_SHOWN, MOST_NUMBER = 40, 2**31 - 1
"""Letters of a wrong cell in a message; numbers of classes and poses are whole ones of 32 bits, as in Parquet."""


def _read_number(cell: str, least: int) -> int:
    # very many digits are no number to Python, and take long
    number = int(cell) if len(cell) < 20 else MOST_NUMBER + 1
    if not least <= number <= MOST_NUMBER:
        raise ValueError(f"'{shorten(cell, MOST_SHOWN)}': expected a whole number from {least} to {MOST_NUMBER}")
    return number


def _read_share(cell: str) -> float:
    share = float(cell)
    if not 0 <= share <= 1:  # neither is NaN
        raise ValueError(f"'{shorten(cell, MOST_SHOWN)}': expected a probability from 0 to 1")
    return share


REPEATED = ("source", "object", "variant", "true_label", "top1_label", "status")
"""Few texts in very many lines: each is kept once."""


def find_captures_dir(workspace: Workspace, run: Run) -> Path:
    """The folder that the images of a run lie in: sweeps and worlds have their own, others the workspace's captures."""
    if run.kind == "world-eval":
        return run.folder / "frames"
    if run.kind != "sweep":
        return workspace.captures_dir
    axis = run.folder.resolve().parent
    # `captures-SET` holds the images of runs whose name ends in -SET, or in -SET-2 for another result of that name
    names = (run.folder.name, re.sub(r"-\d+$", "", run.folder.name))
    of_sets = [
        file
        for file in axis.glob("captures-*")
        if any(name.endswith(file.name.removeprefix("captures")) for name in names)
    ]
    # the longest: one set's name may be the end of another's
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
    # `sim` of `sim-fog-3`
    ends = {row.source: name_source("", (row.condition, row.severity or 0)) for row in run.rows}
    sources = {source: source.removesuffix(end) for source, end in ends.items()}
    try:
        with open_plain(file) as stream:
            text = io.StringIO(stream.read().decode("utf-8"), newline="")
        lines = csv.reader(text, strict=True)
        names = next(lines, [])
        needed = DETECTION_COLUMNS if run.kind == "detection" else NEEDED
        missing = [name for name in needed if name not in names]
        if missing:
            raise ToolkitError(f"{file}: no column '{missing[0]}': run 'toolkit eval' again")
        # most files hold no quote, and need no cell looked at
        find, is_escaped = _within(captures_dir), "'" in text.getvalue()
        with without_collector():
            cells = (map(decode_cell, line) if is_escaped else line for line in lines if line)
            return [_read_line(dict(zip(names, line, strict=False)), find, sources) for line in cells]
    except (OSError, csv.Error, LookupError, TypeError, ValueError) as error:
        raise ToolkitError(f"{file} is damaged ({error}): run 'toolkit eval' again") from None


Find = Callable[[str], tuple[Path, bool]]


def _within(root: Path) -> Find:
    """`inside`, and whether a file is there, for very many files and folders: each folder is listed once."""
    folders = {"": (there := inside(root, ""), _list_kinds(there))}

    def look(path: str) -> tuple[Path, str]:
        head, _, name = path.rpartition("/")
        # what can lead nowhere else needs no check of its own
        is_plain = path.isascii() and path.isprintable() and path[:1] != "/" and "\\" not in path
        if is_plain and name not in ("", ".", "..") and len(name) <= MOST_NAME_BYTES and path.count("/") < MOST_LEVELS:
            if head not in folders:
                there, kind = look(head)
                folders[head] = there, _list_kinds(there) if kind == FOLDER else {}
            folder, kinds = folders[head]
            if kinds.get(name) != LINK:
                return folder / name, kinds.get(name, "")
        place = inside(root, path)
        return place, FILE if place.is_file() else FOLDER if place.is_dir() else ""

    def find(path: str) -> tuple[Path, bool]:
        place, kind = look(path)
        return place, kind == FILE

    return find


def _list_kinds(folder: Path) -> dict[str, str]:
    """What lies in a folder by name, but for what is neither a file, a folder nor a link."""
    try:
        with os.scandir(folder) as found:
            return {
                one.name: LINK if one.is_symlink() else FILE if one.is_file() else FOLDER
                for one in found if one.is_symlink() or one.is_file() or one.is_dir()
            }  # fmt: skip
    except OSError:  # it is not there
        return {}


def _read_line(line: dict[str, str], find: Find, sources: Mapping[str, str]) -> Prediction:
    # interned: one copy of each text instead of one a line
    for name in REPEATED:
        if name in line:
            line[name] = intern(line[name])
    path, source = line["path"], line["source"]
    file, is_there = find(path)
    head, _, rest = path.partition("/")
    # not there under its own path: it was corrupted when it was read, and the file before that is meant
    if not is_there and sources.get(head, head) != head:
        file, _ = find(f"{sources[head]}/{rest}")
    gates = tuple(filter(None, (line.get("failed_gates") or "").split("; ")))
    pose_id = _read_number(line["pose_id"], 0) if line["pose_id"] else None
    corruption = None
    if line.get("weather"):  # of a world: a camera has one number at each place, and many weathers
        corruption = (line["weather"], _read_number(line["severity"], 0))
        source = " ".join([line["world"], line["place"], *map(str, corruption)])
    capture = Capture(
        source, line["object"], line["variant"], pose_id, file, path, corruption=corruption, failed_gates=gates
    )
    if "found" in line:
        return make_detected(capture, line["true_label"], read_detection(line), line["status"])
    true_index = _read_number(line["true_index"], -1)
    if line["status"] != OK:
        return Prediction(capture, true_index, line["true_label"], status=line["status"])
    return Prediction(
        capture, true_index, line["true_label"], top1_index=_read_number(line["top1_index"], 0),
        top1_label=line["top1_label"], top1_prob=_read_share(line["top1_prob"]),
        true_prob=_read_share(line["true_prob"]), true_rank=_read_number(line["true_rank"], 1),
    )  # fmt: skip


def has_own_file(one: Prediction, captures_dir: Path) -> bool:
    """Whether the image is there as it was judged; one that was corrupted when it was read is not."""
    return one.capture.file == inside(captures_dir, one.capture.path) and one.capture.file.is_file()


def hash_images(predictions: Sequence[Prediction], captures_dir: Path) -> Iterator[str | None]:
    """SHA-256 of each image's file as it is now; None of a file that is gone."""
    for prediction in predictions:
        try:
            yield sha256_file(prediction.capture.file)
        except (OSError, ValueError):
            yield None


PANDAS = {str: "string", int: "Int64", float: "Float64", bool: "boolean"}
"""Types of pandas that know `NA`."""


class Written(Protocol):
    """What was written into a folder `eval/RUN`, such as the result of `evaluate_captures`."""

    @property
    def run_dir(self) -> Path:
        """The folder."""


def predictions_table(run: Written | Path | str) -> "pandas.DataFrame":
    """The predictions of an evaluation as a pandas `DataFrame`, one row per image, as in its `predictions.csv`.

    Columns: source, object, variant, pose_id, path, true_index, true_label, top1_index, top1_label, top1_prob,
    true_prob (both in [0, 1]), true_rank (from 1), correct_top1, correct_top5, status (`ok`, or why the image was not
    read), failed_gates (empty for none). What is not known of an image is `NA`.

    `predictions_table(result).groupby(["object", "variant"]).correct_top1.mean()` is the accuracy of each variant.

    Args:
        run: what `evaluate_captures` returned, or a folder `eval/RUN`.

    Raises:
        ToolkitError: pandas is not installed, or the folder holds no predictions.
    """
    try:
        import pandas
    except ImportError:
        raise ToolkitError(
            "predictions_table needs pandas, which is not installed: pip install '.[pandas]' in the kit's folder"
        ) from None
    folder = Path(run) if isinstance(run, str | Path) else run.run_dir
    file = folder / "predictions.csv"
    if not file.is_file():
        raise ToolkitError(f"{folder} holds no predictions.csv: expected the folder of an evaluation, eval/RUN")
    # an object may be called "null" or "NA": only an empty field is unknown
    table = pandas.read_csv(file, dtype="string", keep_default_na=False, na_values=[""])
    missing = [name for name in NEEDED if name not in table.columns]
    if missing:
        raise ToolkitError(f"{file}: no column '{missing[0]}': run 'toolkit eval' again")
    for name in table.columns:
        table[name] = table[name].map(decode_cell, na_action="ignore").astype("string")
    if "failed_gates" in table.columns:
        table["failed_gates"] = table["failed_gates"].fillna("")
    for name in ("correct_top1", "correct_top5"):
        # empty where nothing was said: neither right nor wrong
        table[name] = table[name].map({"1": True, "0": False})
    return table.astype({name: PANDAS[COLUMNS[name]] for name in NEEDED})
