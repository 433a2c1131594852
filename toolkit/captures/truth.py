"""Mask and box of the object in each image, by its mesh and the manifest's camera, and COCO's file of them."""

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

MARGIN_PX = 2
"""Margin around the projected vertices, which rounding may move."""


@dataclass(frozen=True)
class ObjectMask:
    """Mask and box of the object in an image.

    Attributes:
        mask: (h, w) bool, pixels whose centres the object covers, without an overhanging sheet.
        box: x1, y1, x2, y2 around the mask, in pixels from the image's corner.
    """

    mask: np.ndarray
    box: tuple[float, float, float, float]


def outline_object(item: TableObject, camera: Camera, T_world_camera: np.ndarray) -> ObjectMask | None:
    """Return the object's mask by rays through the pixels' centres; None if the object is not in the image.

    Args:
        item: object from `load_object`, on the table at the origin.
        camera: camera of the image, with its distortion.
        T_world_camera: 4×4, millimetres.
    """
    T_world_camera = np.asarray(T_world_camera, float)
    corners = camera.project(T_world_camera, item.mesh.vertices)
    # rays only within the box of the projected vertices, or everywhere if a vertex is behind the camera
    if np.isnan(corners).any():
        low, high = np.zeros(2, int), np.array([camera.width, camera.height])
    else:
        low = np.clip(np.floor(corners.min(0)).astype(int) - MARGIN_PX, 0, (camera.width, camera.height))
        high = np.clip(np.ceil(corners.max(0)).astype(int) + MARGIN_PX, 0, (camera.width, camera.height))
    mask = np.zeros((camera.height, camera.width), bool)
    columns, rows = np.arange(low[0], high[0]), np.arange(low[1], high[1])
    if len(columns) and len(rows):
        centres = np.stack(np.meshgrid(columns + 0.5, rows + 0.5), -1).reshape(-1, 2)
        hits = _cast(item, camera, T_world_camera, centres)
        mask[low[1] : high[1], low[0] : high[0]] = hits.reshape(len(rows), len(columns))
    # behind the camera or beside its image
    if not mask.any():
        return None
    # columns and rows that the mask touches: the box ends after its last pixel
    y, x = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return ObjectMask(mask, (float(x[0]), float(y[0]), float(x[-1] + 1), float(y[-1] + 1)))


def _cast(item: TableObject, camera: Camera, T_world_camera: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    o3d = load_open3d()

    # depth 1 in the camera's axes: rays need no unit length
    local = np.concatenate([camera.undistort(pixels), np.ones((len(pixels), 1))], 1)
    directions = local @ T_world_camera[:3, :3].T
    rays = np.concatenate([np.broadcast_to(T_world_camera[:3, 3], directions.shape), directions], 1)
    hits = make_ray_scene(item.mesh).test_occlusions(o3d.core.Tensor(rays.astype(np.float32)))
    return hits.numpy()


def outline_captures(
    captures: Sequence[Capture], workspace: Workspace
) -> tuple[dict[str, ObjectMask], list[tuple[str, str]]]:
    """Return the mask of each image by its path, and (path, reason) of images without a known mask.

    Raises:
        ToolkitError: a spec, a mesh or a manifest is broken.
    """
    # a mesh is loaded once, a manifest is read once
    specs, items = workspace.object_specs(), {}
    manifests: dict[Path, dict[str, CaptureRecord]] = {}
    seen: dict[tuple[object, ...], ObjectMask | None] = {}
    found, unknown = {}, []
    for capture in captures:
        source = capture.source_dir
        # the record is found by the path below its source
        if source not in manifests:
            manifests[source] = read_manifest(source)
        record = manifests[source].get(capture.file.absolute().relative_to(source).as_posix())
        camera = record.camera if record is not None else None
        # an image needs a camera, and an object of known shape
        if record is None or camera is None or record.T_world_camera is None:
            unknown.append((capture.path, "the manifest has no camera pose for it"))
            continue
        if capture.object not in specs:
            unknown.append((capture.path, f"there is no spec of '{capture.object}', so its shape is not known"))
            continue
        if not read_spec(specs[capture.object]).mesh:
            unknown.append((capture.path, f"the spec of '{capture.object}' has no mesh, so its shape is not known"))
            continue
        if capture.object not in items:
            items[capture.object] = load_object(specs[capture.object])
        # the length is in the hash of the mesh, as a longer object has another mask
        if record.made.get("mesh_sha256", items[capture.object].mesh_sha256) != items[capture.object].mesh_sha256:
            unknown.append((capture.path, f"{specs[capture.object]} has another shape or length than when it was shot"))
            continue
        # the variants of a pose share a mask
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
    """Write `instances.json`; return the number of images, and (path, reason) of images left out.

    `file_name` is relative to the file's folder if the image is in it. Annotations also have `object`, `variant` and
    `pose_id`.

    Args:
        names: object -> category; by default the class of its spec.

    Raises:
        ToolkitError: no mask is known, or the file cannot be written.
    """
    masks, unknown = outline_captures(captures, workspace)
    # the first reason stands for all
    if not masks:
        why = f"{unknown[0][0]}: {unknown[0][1]}" if unknown else "there are no images"
        raise ToolkitError(f"no box is known: {why}")
    specs = workspace.object_specs()
    objects = sorted({capture.object for capture in captures if capture.path in masks})
    # a name that was given comes first, such as COCO's own
    category = {name: (names or {}).get(name) or str(read_spec(specs[name]).class_name) for name in objects}
    categories = sorted(set(category.values()))
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    # an annotation for each image
    for capture in captures:
        if capture.path not in masks:
            continue
        truth, number = masks[capture.path], len(images) + 1
        height, width = truth.mask.shape
        # COCO's readers look for images below the file's own folder
        folder, path = real_path(file).parent, real_path(capture.file)
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
    """Return corner and sides, as in COCO, of x1, y1, x2, y2."""
    x1, y1, x2, y2 = box
    return [x1, y1, round(x2 - x1, 3), round(y2 - y1, 3)]


def encode_mask(mask: np.ndarray) -> dict[str, list[int]]:
    """Return COCO's uncompressed run lengths of an (h, w) bool mask: down the columns, zeros first."""
    # a zero before the first pixel, so that the first run counts zeros
    flat = np.concatenate([[False], mask.ravel(order="F")])
    changes = np.flatnonzero(flat[1:] != flat[:-1])
    counts = np.diff(np.concatenate([[0], changes, [mask.size]]))
    return {"size": [int(side) for side in mask.shape], "counts": [int(count) for count in counts]}
