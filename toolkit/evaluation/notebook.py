"""What a notebook works with: captures as a torch `Dataset`, predictions as a pandas table."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from toolkit.core.errors import ToolkitError
from toolkit.core.tables import decode_cell
from toolkit.core.workspace import Workspace
from toolkit.evaluation.eval_config import EvalConfig
from toolkit.evaluation.ground_truth import read_labelled_captures
from toolkit.evaluation.predictions_csv import COLUMNS, NEEDED
from toolkit.models.network import Classifier

if TYPE_CHECKING:
    import pandas
    import torch

    from toolkit.captures.dataset import CaptureDataset
    from toolkit.evaluation.evaluate import Evaluation

PANDAS = {str: "string", int: "Int64", float: "Float64", bool: "boolean"}
"""Types of pandas that know `NA`."""


def load_captures(
    workspace: Workspace,
    classifier: Classifier,
    captures_dir: Path | str | None = None,
    *,
    sources: Sequence[str] = (),
    objects: Sequence[str] = (),
    variants: Sequence[str] = (),
    transform: "Callable[[torch.Tensor], torch.Tensor] | None" = None,
) -> "CaptureDataset":
    """Captures as a `torch.utils.data.Dataset` of `(image, target, info)`, for a `DataLoader` with any workers.

    `image` is (3, s, s) float32, sRGB-encoded in [0, 1], resized and cut as the classifier wants it, not normalised;
    `target` the index of the object's class among the classifier's; `info` a dict of path, source, object, variant,
    pose_id and T_world_camera. An object whose class the classifier does not have is left out.

    Args:
        workspace: whose object specs say what each object is.
        classifier: whose classes and preprocessing are meant.
        captures_dir: a folder of images, SOURCE/OBJECT/VARIANT/FILE; by default the workspace's `captures/`.
        sources: only these; all by default, as for the next two.
        objects: only these.
        variants: only these.
        transform: of each finished image; with workers it must be picklable.

    Raises:
        ToolkitError: no images, a name that is not there, an object that is neither known nor named for a class, or
            none whose class the classifier has.
    """
    from toolkit.captures.dataset import CaptureDataset

    config = EvalConfig(sources=tuple(sources), objects=tuple(objects), variants=tuple(variants))
    root = Path(captures_dir or workspace.captures_dir)
    folder, targets = read_labelled_captures(root, workspace, classifier, config)
    return CaptureDataset(folder, targets, classifier.preprocessing, transform)


def predictions_table(run: "Evaluation | Path | str") -> "pandas.DataFrame":
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
