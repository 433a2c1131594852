"""What a finished run said of each image: its `predictions.csv` read back, and the images where they still are."""

import csv
import io
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from sys import intern

from toolkit.captures.corrupted_copy import name_source
from toolkit.captures.manifest import CaptureRecord, read_manifest
from toolkit.captures.read import Capture
from toolkit.core.errors import ToolkitError
from toolkit.core.files import MOST_NAME_BYTES, inside, open_plain, sha256_file
from toolkit.core.limits import without_collector
from toolkit.core.tables import decode_cell
from toolkit.core.workspace import Workspace
from toolkit.evaluation.predict import OK, Prediction
from toolkit.evaluation.predictions_csv import DETECTION_COLUMNS, NEEDED, make_detected, read_detection
from toolkit.evaluation.runs import DETECTIONS, PREDICTIONS, Run

REPEATED = ("source", "object", "variant", "true_label", "top1_label", "status")
"""Few texts in very many lines: each is kept once."""


def find_captures_dir(workspace: Workspace, run: Run) -> Path:
    """The folder that the images of a run lie in: sweeps and worlds have their own, others the workspace's captures."""
    if run.kind == "world-eval":
        return run.folder / "frames"
    if run.kind != "sweep":
        return workspace.captures_dir
    axis = run.folder.resolve().parent
    # `captures-SET` holds the images of runs whose name ends in -SET
    of_sets = [one for one in axis.glob("captures-*") if run.folder.name.endswith(one.name.removeprefix("captures"))]
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
    sources = {row.source: _find_uncorrupted(row.source, row.condition, row.severity) for row in run.rows}
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


def _find_uncorrupted(source: str, condition: str, severity: int | None) -> str:
    """`sim` of `sim-fog-3`."""
    return source.removesuffix(name_source("", (condition, severity or 0)))


Find = Callable[[str], tuple[Path, bool]]


def _within(root: Path) -> Find:
    """`inside`, and whether a file is there, for very many files of few folders: each folder is listed once."""
    folders: dict[str, tuple[Path, set[str], set[str]]] = {}

    def find(path: str) -> tuple[Path, bool]:
        head, _, name = path.rpartition("/")
        if head not in folders:
            there = inside(root, head)
            folders[head] = there, *_list_files(there)
        folder, files, links = folders[head]
        # what can lead nowhere else needs no check of its own
        is_plain = path.isascii() and path.isprintable() and path[:1] != "/" and "\\" not in path
        if name in links or not is_plain or name in ("", ".", "..") or len(name) > MOST_NAME_BYTES:
            file = inside(root, path)
            return file, file.is_file()
        return folder / name, name in files

    return find


def _list_files(folder: Path) -> tuple[set[str], set[str]]:
    """The names of a folder's plain files, and of the links there."""
    try:
        with os.scandir(folder) as found:
            entries = list(found)
    except OSError:  # it is not there
        return set(), set()
    links = {one.name for one in entries if one.is_symlink()}
    return {one.name for one in entries if one.name not in links and one.is_file()}, links


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
        capture, int(line["true_index"]), line["true_label"], top1_index=int(line["top1_index"]),
        top1_label=line["top1_label"], top1_prob=float(line["top1_prob"]), true_prob=float(line["true_prob"]),
        true_rank=int(line["true_rank"]),
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
