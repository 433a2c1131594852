"""Predictions of many runs for other programs: one Parquet table, or a folder that FiftyOne imports."""

import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from toolkit import __version__
from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_bytes, write_bytes, write_json, write_text
from toolkit.core.workspace import Workspace
from toolkit.evaluation.predict import Prediction
from toolkit.evaluation.runs import Run
from toolkit.evaluation.stored import find_captures_dir, has_own_file, read_predictions

if TYPE_CHECKING:
    import pyarrow

SCHEMA_VERSION = 1
VERSION_KEY = b"toolkit_schema_version"
MOST_PARQUET_BYTES = 1 << 30
TEXTS = ("run", "network", "condition", "source", "object", "variant", "path", "true_label", "top1_label", "status")
INTEGERS = ("severity", "pose_id", "true_index", "top1_index", "true_rank")
NUMBERS, FLAGS = ("top1_prob", "true_prob"), ("correct_top1", "correct_top5")
Row = dict[str, str | int | float | bool | None]


def write_parquet(path: Path, workspace: Workspace, runs: Sequence[Run], captures_dir: Path | None = None) -> int:
    """Write the predictions of runs as one Parquet table, a row per run and image; returns how many.

    Columns are those of `predictions.csv` after run, network, condition and severity; what is not known is null.

    Args:
        path: of the file.
        workspace: that the runs are of.
        runs: with predictions.
        captures_dir: where the images lie; by default of each run's own.

    Raises:
        ToolkitError: pyarrow is not installed, a run has no predictions or damaged ones, or the file cannot be written.
    """
    arrow = _import_arrow()
    from pyarrow import parquet

    rows = [row for run in runs for row in _list_rows(workspace, run, captures_dir)]
    kinds = {
        **dict.fromkeys(TEXTS, arrow.string()), **dict.fromkeys(INTEGERS, arrow.int32()),
        **dict.fromkeys(NUMBERS, arrow.float64()), **dict.fromkeys(FLAGS, arrow.bool_()),
    }  # fmt: skip
    order = [*TEXTS[:3], "severity", *TEXTS[3:6], "pose_id", "path", "true_index", "true_label", *INTEGERS[3:4]]
    order += ["top1_label", *NUMBERS, "true_rank", *FLAGS, "status"]
    about = {VERSION_KEY: str(SCHEMA_VERSION).encode(), b"toolkit_version": __version__.encode()}
    schema = arrow.schema([(name, kinds[name]) for name in order], metadata=about)
    stream = io.BytesIO()
    parquet.write_table(arrow.Table.from_pylist(rows, schema=schema), stream, compression="zstd")
    write_bytes(path, stream.getvalue())
    return len(rows)


def read_parquet(path: Path) -> "pyarrow.Table":
    """The table that `write_parquet` wrote.

    Raises:
        ToolkitError: pyarrow is not installed, or the file is damaged, of a newer toolkit or of another program.
    """
    arrow = _import_arrow()
    from pyarrow import parquet

    content = read_bytes(path, MOST_PARQUET_BYTES)
    try:
        table = parquet.read_table(io.BytesIO(content))
    except (arrow.ArrowException, OSError) as error:
        raise ToolkitError(f"{path} is no Parquet file, or damaged: {str(error).splitlines()[0]}") from None
    version = (table.schema.metadata or {}).get(VERSION_KEY, b"")
    if not version.isdigit():
        raise ToolkitError(f"{path} holds no predictions of toolkit: write it with 'toolkit export --to parquet'")
    if int(version) > SCHEMA_VERSION:
        raise ToolkitError(
            f"{path} was written by a newer toolkit (schema version {int(version)}, this one reads up to "
            f"{SCHEMA_VERSION}): update toolkit"
        )
    return table


def _import_arrow() -> "pyarrow":  # type: ignore[valid-type]
    try:
        import pyarrow
    except ImportError:
        raise ToolkitError(
            "Parquet needs pyarrow, which is not installed: pip install 'toolkit-boost[parquet]'"
        ) from None
    return pyarrow


def _list_rows(workspace: Workspace, run: Run, captures_dir: Path | None) -> list[Row]:
    conditions: dict[str, tuple[str, str | None, int | None]] = {
        row.source: (row.network, row.condition, row.severity) for row in run.rows
    }
    rows: list[Row] = []
    for one in read_predictions(run, captures_dir or find_captures_dir(workspace, run)):
        network, condition, severity = conditions.get(one.capture.source, (run.rows[0].network, None, None))
        if one.capture.corruption is not None:
            condition, severity = one.capture.corruption
        row: Row = {"run": run.name, "network": network, "condition": condition, "severity": severity}
        row |= {name: getattr(one.capture, name) for name in ("source", "object", "variant", "pose_id", "path")}
        names = (
            "true_index",
            "true_label",
            "top1_index",
            "top1_label",
            "top1_prob",
            "true_prob",
            "true_rank",
            "status",
        )
        row |= {name: getattr(one, name) for name in names}
        row |= {name: getattr(one, name) if one.is_read else None for name in FLAGS}
        rows.append(row)
    return rows


LOADER = '''\
"""Import this folder into FiftyOne: python load.py [NAME]."""

import sys
from pathlib import Path

import fiftyone as fo

here = Path(__file__).resolve().parent
dataset = fo.Dataset(sys.argv[1] if len(sys.argv) > 1 else None, persistent=len(sys.argv) > 1)
for labels in sorted((here / "labels").glob("*.json")):
    dataset.merge_dir(
        dataset_type=fo.types.FiftyOneImageClassificationDataset, data_path=str(here / "data.json"),
        labels_path=str(labels), label_field=labels.stem,
    )
print(dataset)
if __name__ == "__main__":
    fo.launch_app(dataset).wait()
'''


def write_fiftyone(
    folder: Path, workspace: Workspace, runs: Sequence[Run], captures_dir: Path | None = None
) -> tuple[int, int]:
    """Write a folder that FiftyOne imports; it need not be installed here, and no image is copied.

    `data.json` says where each image lies; `labels/` has a file in the form of `FiftyOneImageClassificationDataset` for
    each field: `ground_truth`, `object`, `variant`, `source`, and `prediction_RUN` with its confidence for each run.
    `load.py` merges them into one dataset.

    Args:
        folder: where to.
        workspace: that the runs are of.
        runs: with predictions.
        captures_dir: where the images lie; by default of each run's own.

    Returns:
        How many images are in it, and how many answers were left out: of images that are gone, could not be read, or
        were corrupted when they were read and have no file of their own.

    Raises:
        ToolkitError: a run has no predictions or damaged ones, none of its images is there, or the folder cannot be
            written.
    """
    files: dict[str, str] = {}
    fields: dict[str, dict[str, object]] = {name: {} for name in ("ground_truth", "object", "variant", "source")}
    left_out = 0
    for run in runs:
        place = captures_dir or find_captures_dir(workspace, run)
        answers = fields.setdefault(f"prediction_{re.sub(r'[^A-Za-z0-9]+', '_', run.name)}", {})
        for one in read_predictions(run, place):
            if not one.is_read or not has_own_file(one, place):
                left_out += 1
                continue
            key = files.setdefault(str(one.capture.file), f"{len(files):06d}")
            answers[key] = _describe_answer(one)
            fields["ground_truth"][key] = one.true_label
            for name in ("object", "variant", "source"):
                fields[name][key] = getattr(one.capture, name)
    if not files:
        raise ToolkitError(f"none of the images of {', '.join(run.name for run in runs)} is there: say where they lie")
    write_json(folder / "data.json", {key: file for file, key in files.items()})
    for name, labels in fields.items():
        write_json(folder / "labels" / f"{name}.json", {"labels": labels})
    write_text(folder / "load.py", LOADER)
    return len(files), left_out


def _describe_answer(one: Prediction) -> dict[str, object]:
    about = {"correct": one.correct_top1, "true_prob": one.true_prob, "true_rank": one.true_rank}
    return {"label": one.top1_label, "confidence": one.top1_prob, "attributes": about}
