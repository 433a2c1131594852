"""A capture folder's truth in COCO's format: boxes and masks that pycocotools and FiftyOne read."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from toolkit import __version__
from toolkit.captures.read import Capture
from toolkit.captures.truth import outline_captures
from toolkit.core.errors import ToolkitError
from toolkit.core.files import write_json
from toolkit.core.workspace import Workspace
from toolkit.objects.spec import read_spec


def write_coco(
    file: Path, captures: Sequence[Capture], workspace: Workspace, names: dict[str, str] | None = None
) -> tuple[int, list[tuple[str, str]]]:
    """Write `instances.json`: how many images it holds, and (path, reason) of those left out.

    `file_name` is the path below `file`'s folder where the image lies there. An annotation also says `object`,
    `variant` and `pose_id`.

    Args:
        file: what to write.
        captures: from `read_captures`.
        workspace: whose object specs say what each object is.
        names: object -> category; by default the class of its spec.

    Raises:
        ToolkitError: no image's mask is known, or the file cannot be written.
    """
    masks, unknown = outline_captures(captures, workspace)
    if not masks:
        why = f"{unknown[0][0]}: {unknown[0][1]}" if unknown else "there are no images"
        raise ToolkitError(f"no box is known: {why}")
    specs = workspace.object_specs()
    objects = sorted({one.object for one in captures if one.path in masks})
    category = {name: (names or {}).get(name) or str(read_spec(specs[name]).class_name) for name in objects}
    categories = sorted(set(category.values()))
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for one in captures:
        if one.path not in masks:
            continue
        truth, number = masks[one.path], len(images) + 1
        height, width = truth.mask.shape
        folder = file.resolve().parent
        path = one.file.resolve()
        name = path.relative_to(folder).as_posix() if path.is_relative_to(folder) else one.path
        images.append({"id": number, "file_name": name, "width": width, "height": height})
        annotations.append(
            {
                "id": number, "image_id": number, "category_id": categories.index(category[one.object]) + 1,
                "bbox": as_bbox(truth.box), "area": int(truth.mask.sum()), "iscrowd": 0,
                "segmentation": encode_mask(truth.mask), "object": one.object, "variant": one.variant,
                "pose_id": one.pose_id,
            }
        )  # fmt: skip
    write_instances(file, images, annotations, categories)
    return len(images), unknown


def write_instances(
    file: Path, images: list[dict[str, Any]], annotations: list[dict[str, Any]], categories: Sequence[str]
) -> None:
    """Write COCO's `instances.json`; a category's id is its place in `categories`, from 1."""
    content = {
        "info": {"description": "where each object is, by its mesh and camera", "version": f"toolkit {__version__}"},
        "licenses": [], "images": images, "annotations": annotations,
        "categories": [{"id": k + 1, "name": name} for k, name in enumerate(categories)],
    }  # fmt: skip
    write_json(file, content)


def as_bbox(box: Sequence[float]) -> list[float]:
    """Corner and sides, as COCO has them, of x1, y1, x2, y2."""
    x1, y1, x2, y2 = box
    return [x1, y1, round(x2 - x1, 3), round(y2 - y1, 3)]


def encode_mask(mask: np.ndarray) -> dict[str, list[int]]:
    """COCO's run lengths of an (h, w) bool mask, not compressed: down the columns, the first of zeros."""
    flat = np.concatenate([[False], mask.ravel(order="F")])
    changes = np.flatnonzero(flat[1:] != flat[:-1])
    counts = np.diff(np.concatenate([[0], changes, [mask.size]]))
    return {"size": [int(side) for side in mask.shape], "counts": [int(one) for one in counts]}
