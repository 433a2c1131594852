"""Two tables of predictions from any program: paired by image, and compared as two runs are."""

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

from toolkit.captures.read import POOLED, Capture
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import inside, open_plain
from toolkit.core.memory import without_collector
from toolkit.core.tables import decode_cell
from toolkit.evaluation.compare import RunComparison
from toolkit.evaluation.metrics import Comparison, Pair
from toolkit.evaluation.predict import Prediction
from toolkit.evaluation.runs import Run

IMAGE = ("image", "path", "file", "filename", "file_name", "image_path", "image_id", "name", "id")
RIGHT = ("correct", "correct_top1", "is_correct", "right")
TRUTH = ("true_index", "true_label", "true", "label", "target", "ground_truth", "gt", "y_true")
GUESS = ("top1_index", "top1_label", "predicted", "prediction", "pred", "y_pred")
"""Names of columns, in any case, that other programs write; the first that is there is taken."""
CLUSTER = ("cluster", "group")
YES, NO = ("1", "true", "yes", "right", "1.0"), ("0", "false", "no", "wrong", "0.0")


def compare_tables(first: Path, second: Path, images: Path | None = None, cluster: str | None = None) -> RunComparison:
    """Compare two CSV files line by line, an image being the same where it bears the same name in both.

    Args:
        first, second: with a column that names the image, and one that says whether the answer is right, or two with
            the true and the predicted label. Their heads may be those of `IMAGE`, `RIGHT`, `TRUTH` and `GUESS`.
        images: folder that the names are relative to, for the pictures of what flipped; None: each table's own.
        cluster: column, of the first table, of what images share; None: `cluster` or `group`, where there is one.

    Raises:
        ToolkitError: a file cannot be read, lacks a column, names an image twice, or says neither right nor wrong; or
            the tables share no image.
    """
    said = [_read_table(Path(file), images, cluster if file is first else None) for file in (first, second)]
    names = [name for name in said[0] if name in said[1]]
    if not names:
        raise ToolkitError(f"{first} and {second} share no image: expected the same names in both")
    pairs = tuple(Pair(said[0][name][0], said[1][name][0]) for name in names)
    clusters = tuple(said[0][name][1] for name in names)
    stems = [Path(file).stem for file in (first, second)]
    labels = stems if stems[0] != stems[1] else [str(first), str(second)]
    one, other = (
        Run(label, Path(file).parent, "eval", ()) for label, file in zip(labels, (first, second), strict=True)
    )
    return RunComparison(
        one, other, pairs, (Comparison(POOLED, POOLED, POOLED, POOLED, pairs),),
        (len(said[0]) - len(pairs), len(said[1]) - len(pairs)), clusters if any(clusters) else (),
    )  # fmt: skip


def _read_table(file: Path, images: Path | None, cluster: str | None) -> dict[str, tuple[Prediction, str]]:
    """By image, what was said of it and its cluster."""
    try:
        with open_plain(file) as stream:
            lines = csv.reader(stream.read().decode("utf-8-sig").splitlines(), strict=True)
            heads = next(lines, [])
            at = {head.strip().lower(): k for k, head in enumerate(heads)}
            with without_collector():
                return _read_lines(file, lines, at, images, cluster)
    except (OSError, csv.Error, UnicodeDecodeError) as error:
        raise ToolkitError(f"{file}: not a readable CSV table ({error})") from None


def _read_lines(
    file: Path, lines: Iterator[list[str]], at: dict[str, int], images: Path | None, cluster: str | None
) -> dict[str, tuple[Prediction, str]]:  # fmt: skip
    name_at, right_at = _need(file, at, IMAGE, "names the image"), _find(at, RIGHT)
    truth_at, guess_at = _find(at, TRUTH), _find(at, GUESS)
    if right_at is None and (truth_at is None or guess_at is None):
        raise ToolkitError(
            f"{file}: expected a column {_some(RIGHT)}, or one of the truth ({_some(TRUTH)}) and one of the prediction "
            f"({_some(GUESS)}); found {_some(list(at))}"
        )
    if cluster is not None and cluster.lower() not in at:
        raise FieldError(f"{file} has no such column: expected one of {_some(list(at), 12)}", {"cluster": cluster})
    cluster_at = _find(at, CLUSTER if cluster is None else (cluster.lower(),))
    found: dict[str, tuple[Prediction, str]] = {}
    for number, cells in enumerate(lines, 2):
        if not cells:
            continue
        if len(cells) <= max(at.values()):
            raise ToolkitError(f"{file}, line {number}: {len(cells)} cells: expected {max(at.values()) + 1}")
        name, guess = decode_cell(cells[name_at]), "" if guess_at is None else decode_cell(cells[guess_at])
        if name in found:
            raise ToolkitError(f"{file}, line {number}: image '{name}' appears twice: expected each once")
        if right_at is not None:
            is_right = _read_right(file, number, cells[right_at])
        else:
            assert truth_at is not None
            assert guess_at is not None
            is_right = cells[truth_at] == cells[guess_at]
        capture = Capture("table", POOLED, POOLED, None, _locate(images or file.parent, name), name)
        said = Prediction(capture, 0, "", top1_label=guess or None, true_rank=1 if is_right else 2)
        found[name] = said, "" if cluster_at is None else cells[cluster_at]
    return found


def _locate(folder: Path, name: str) -> Path:
    """Where an image lies; the folder itself, which is no image, for a name that leads out of it."""
    try:
        return inside(folder, name)
    except ToolkitError:
        return folder


def _read_right(file: Path, number: int, cell: str) -> bool:
    value = cell.strip().lower()
    if value not in YES + NO:
        raise ToolkitError(f"{file}, line {number}: expected 1 or 0, or true or false, found '{cell[:40]}'")
    return value in YES


def _find(at: dict[str, int], names: Sequence[str]) -> int | None:
    return next((at[name] for name in names if name in at), None)


def _need(file: Path, at: dict[str, int], names: Sequence[str], what: str) -> int:
    found = _find(at, names)
    if found is None:
        raise ToolkitError(f"{file}: no column that {what}: expected one of {_some(names)}; found {_some(list(at))}")
    return found


def _some(names: Sequence[str], most: int = 6) -> str:
    return ", ".join(names[:most]) + ("…" if len(names) > most else "")
