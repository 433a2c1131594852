"""Where the object is in each image: its mask and box, by its mesh and the manifest's camera, and as COCO's file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolkit import __version__
from toolkit.captures.capture import Capture
from toolkit.captures.manifest import CaptureRecord, read_manifest
from toolkit.core.errors import ToolkitError
from toolkit.core.files import real_path, write_json
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.mesh import load_open3d, make_ray_scene
from toolkit.objects.spec import read_spec
from toolkit.rig.camera import Camera

# beyond the projected vertices, which rounding may move
MARGIN_PX = 2


@dataclass(frozen=True)
class ObjectMask:
    """What one image shows of its object.

    Attributes:
        mask: (h, w) bool, the pixels whose centres the object covers; a sheet that overhangs it is not of it.
        box: x1, y1, x2, y2 round the mask, in pixels from the image's corner.
    """

    mask: np.ndarray
    box: tuple[float, float, float, float]


def outline_object(item: TableObject, camera: Camera, T_world_camera: np.ndarray) -> ObjectMask | None:
    """The object's mask by rays through the pixels' centres; None where the image does not show it.

    Args:
        item: from `load_object`, on the table at the origin.
        camera: of the image, with its distortion.
        T_world_camera: 4×4, millimetres.
    """
    T_world_camera = np.asarray(T_world_camera, float)
    corners = camera.project(T_world_camera, item.mesh.vertices)
    # rays are cast only within the box of the projected vertices; where one is behind the camera, everywhere
    if np.isnan(corners).any():
        low, high = np.zeros(2, int), np.array([camera.width, camera.height])
    else:
        low = np.clip(np.floor(corners.min(0)).astype(int) - MARGIN_PX, 0, (camera.width, camera.height))
        high = np.clip(np.ceil(corners.max(0)).astype(int) + MARGIN_PX, 0, (camera.width, camera.height))
    mask = np.zeros((camera.height, camera.width), bool)
    columns, rows = np.arange(low[0], high[0]), np.arange(low[1], high[1])
    if len(columns) and len(rows):
        centres = np.stack(np.meshgrid(columns + 0.5, rows + 0.5), -1).reshape(-1, 2)
        mask[low[1] : high[1], low[0] : high[0]] = _cast(item, camera, T_world_camera, centres).reshape(
            len(rows), len(columns)
        )
    if not mask.any():
        return None
    y, x = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return ObjectMask(mask, (float(x[0]), float(y[0]), float(x[-1] + 1), float(y[-1] + 1)))


def _cast(item: TableObject, camera: Camera, T_world_camera: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    o3d = load_open3d()

    # depth 1 in the camera's axes: a ray needs no unit length to hit or miss
    local = np.concatenate([camera.undistort(pixels), np.ones((len(pixels), 1))], 1)
    directions = local @ T_world_camera[:3, :3].T
    rays = np.concatenate([np.broadcast_to(T_world_camera[:3, 3], directions.shape), directions], 1)
    hits = make_ray_scene(item.mesh).test_occlusions(o3d.core.Tensor(rays.astype(np.float32)))
    return hits.numpy()


def outline_captures(
    captures: Sequence[Capture], workspace: Workspace
) -> tuple[dict[str, ObjectMask], list[tuple[str, str]]]:
    """The mask in each image by its path, and (path, reason) of the images whose mask is not known.

    Args:
        captures: from `read_captures`.
        workspace: whose object specs say what the objects look like.

    Raises:
        ToolkitError: a spec, a mesh or a manifest is broken.
    """
    specs, items = workspace.object_specs(), {}
    manifests: dict[Path, dict[str, CaptureRecord]] = {}
    seen: dict[tuple[object, ...], ObjectMask | None] = {}
    found, unknown = {}, []
    for capture in captures:
        source = capture.source_dir
        if source not in manifests:
            manifests[source] = read_manifest(source)
        record = manifests[source].get(capture.file.absolute().relative_to(source).as_posix())
        camera = record.camera if record is not None else None
        if record is None or camera is None or record.T_world_camera is None:
            unknown.append((capture.path, "the manifest does not say where the camera stood"))
            continue
        if capture.object not in specs:
            unknown.append((capture.path, f"there is no spec of '{capture.object}', so its shape is not known"))
            continue
        if not read_spec(specs[capture.object]).mesh:
            unknown.append((capture.path, f"the spec of '{capture.object}' has no mesh, so its shape is not known"))
            continue
        if capture.object not in items:
            items[capture.object] = load_object(specs[capture.object])
        if record.made.get("mesh_sha256", items[capture.object].mesh_sha256) != items[capture.object].mesh_sha256:
            unknown.append((capture.path, f"{specs[capture.object]} has another shape or length than when it was shot"))
            continue
        # the variants of a pose show one mesh: a mask is cast once for all of them
        pose = tuple(np.ravel(record.T_world_camera).tolist())
        key = (capture.object, pose, tuple(camera.intrinsics.items()), tuple(camera.coefficients.ravel().tolist()))
        if key not in seen:
            seen[key] = outline_object(items[capture.object], camera, np.array(record.T_world_camera))
        if (mask := seen[key]) is None:
            unknown.append((capture.path, "the object is not in the image"))
        else:
            found[capture.path] = mask
    return found, unknown


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
    objects = sorted({capture.object for capture in captures if capture.path in masks})
    category = {name: (names or {}).get(name) or str(read_spec(specs[name]).class_name) for name in objects}
    categories = sorted(set(category.values()))
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for capture in captures:
        if capture.path not in masks:
            continue
        truth, number = masks[capture.path], len(images) + 1
        height, width = truth.mask.shape
        folder = real_path(file).parent
        path = real_path(capture.file)
        # COCO's readers look for images below the file's own folder
        name = path.relative_to(folder).as_posix() if path.is_relative_to(folder) else capture.path
        images.append({"id": number, "file_name": name, "width": width, "height": height})
        annotations.append(
            {
                "id": number, "image_id": number, "category_id": categories.index(category[capture.object]) + 1,
                "bbox": as_bbox(truth.box), "area": int(truth.mask.sum()), "iscrowd": 0,
                "segmentation": encode_mask(truth.mask), "object": capture.object, "variant": capture.variant,
                "pose_id": capture.pose_id,
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
    # a zero before the first pixel, so that the first run counts zeros, as COCO wants it
    flat = np.concatenate([[False], mask.ravel(order="F")])
    changes = np.flatnonzero(flat[1:] != flat[:-1])
    counts = np.diff(np.concatenate([[0], changes, [mask.size]]))
    return {"size": [int(side) for side in mask.shape], "counts": [int(one) for one in counts]}
