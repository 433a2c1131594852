"""`toolkit capture-sim --like captures/real`: shoot from every photograph's measured camera in the virtual rig."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from toolkit.captures.manifest import MANIFEST, CaptureRecord, read_manifest
from toolkit.captures.read import Selection, read_captures
from toolkit.captures.shoot import (
    SHOTS,
    ShootResult,
    ShootSettings,
    Shot,
    check_settings,
    describe_look,
    take_shots,
)
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import real_path
from toolkit.core.workspace import Workspace
from toolkit.engine import EngineConfig
from toolkit.objects.load import TableObject, load_object
from toolkit.rig.board_file import PRINTED
from toolkit.rig.camera import Camera
from toolkit.rig.variants import find_booster

MAX_PX = 1280
"""Far above the input of networks, and a tenth of a phone's 12 megapixels."""
NOT_MEASURED = "its camera was not measured: photograph it with the board in view and import it again"


@dataclass(frozen=True)
class LikeResult:
    """Images that were shot, and (path, reason) of photographs that could not be shot again."""

    shoot: ShootResult
    skipped: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class MeasuredPhoto:
    """A photograph with a measured camera.

    Attributes:
        path: path below the source's folder.
        camera: camera, scaled to the size of the render.
    """

    path: str
    record: CaptureRecord
    camera: Camera
    T_world_camera: np.ndarray


def shoot_like(
    workspace: Workspace, photos_dir: Path, settings: ShootSettings | None = None, source: str | None = None,
    objects: Iterable[str] = (), variants: Iterable[str] = (), max_px: int = MAX_PX,
    engine: EngineConfig | None = None,
) -> LikeResult:  # fmt: skip
    """Shoot object and variant of every photograph with its measured camera.

    An image has the photograph's path below the source and its pose id, so an evaluation pairs the two. The camera is a
    pinhole, without the distortion of the real lens.

    Args:
        photos_dir: a source with a manifest, such as `captures/real`.
        settings: backdrop, light and more; the photograph's own table and light are not known.
        source: folder below `captures/`, by default `sim-like-` and the name of `photos_dir`.
        objects, variants: only these; all by default.
        max_px: largest longer side of the renders, pixels.

    Raises:
        ToolkitError: there is no manifest, no photograph can be shot, an object, variant or setting is unknown, the
            source would overwrite the photographs, or the disk is full or read-only.
    """
    settings, photos_dir = settings or ShootSettings(), Path(photos_dir)
    source = source or f"sim-like-{real_path(photos_dir).name}"
    check_settings(workspace, settings, source)
    # links resolved: another name may lead to the same folder
    if real_path(workspace.source_dir(source)) == real_path(photos_dir):
        raise FieldError(f"would overwrite the photographs in {photos_dir}: name another", {"source": source})
    # photographs with a measured camera
    chosen = Selection(objects=tuple(objects), variants=tuple(variants))
    photos, skipped = read_measured(photos_dir, chosen, max_px)
    # shots of an object and variant are made together: they share a mesh and its baked light
    shots: list[Shot] = []
    members: dict[tuple[str, str], list[MeasuredPhoto]] = defaultdict(list)
    for photo in photos:
        members[(photo.record.object, photo.record.variant)].append(photo)
    # two photographs may differ in nothing but the suffix
    taken: set[str] = set()
    for (name, variant), own in members.items():
        try:
            item = load_object(workspace.object_spec(name))
            look = describe_look(workspace, item, variant, settings)
            booster = find_booster(workspace, item, variant)
        except ToolkitError as error:
            skipped += [(photo.path, str(error)) for photo in own]
            continue
        # a photograph of another sheet or another shape is no pair of the render
        sha256 = booster.sha256 if booster else None
        reasons = [_why_not(photo, item, sha256) for photo in own]
        skipped += [(photo.path, why) for photo, why in zip(own, reasons, strict=True) if why]
        fit = [photo for photo, why in zip(own, reasons, strict=True) if not why]
        shots += [_plan_shot(photo, item, look, photos_dir, settings.image_format, taken=taken) for photo in fit]
    # the first reason stands for all
    if not shots:
        path, reason = skipped[0]
        raise ToolkitError(
            f"none of the {len(skipped)} photographs in {photos_dir} can be shot again; {path}: {reason}"
        )
    with (engine or EngineConfig()).open() as workers:
        result = take_shots(workspace, shots, settings, workspace.source_dir(source), engine=workers)
    return LikeResult(result, tuple(sorted(skipped)))


def board_shown(photos_dir: Path) -> str | None:
    """Return the board in a source's photographs: `printed`, or a name in `rig/boards`; None without a board."""
    # the board of the last import
    made = [record.made for record in read_manifest(photos_dir).values() if "board_corners" in record.made]
    return str(made[-1].get("board", PRINTED)) if made else None


def read_measured(
    photos_dir: Path, chosen: Selection | None = None, max_px: int = MAX_PX
) -> tuple[list[MeasuredPhoto], list[tuple[str, str]]]:
    """Return the photographs of a source with a measured camera, and (path, reason) of the others.

    Raises:
        ToolkitError: there is no manifest or no image, or a selected object or variant does not exist.
    """
    records = read_manifest(photos_dir)
    if not records:
        raise FieldError(
            f"has no {MANIFEST} with measured cameras: expected a source, such as captures/real, of photographs that "
            "were imported with 'toolkit import'",
            {"like": photos_dir},
        )
    folder = read_captures(photos_dir, chosen)
    photos = []
    # without the name of the source, as it is the folder that was asked for
    skipped = [(path.partition("/")[2], reason) for path, reason in folder.faults]
    # a photograph needs camera and pose in its line
    for capture in folder.captures:
        path = capture.file.relative_to(photos_dir).as_posix()
        record = records.get(path)
        if record is None or not record.T_world_camera or not record.intrinsics:
            skipped.append((path, NOT_MEASURED))
            continue
        # written by other programs too, so that it is checked to be a pose
        pose = np.array(record.T_world_camera, float)
        rotation = pose[:3, :3]
        # a rotation is orthonormal and not mirrored
        if np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-3 and np.linalg.det(rotation) > 0:
            camera = scale_camera(Camera.from_intrinsics(record.intrinsics), max_px)
            photos.append(MeasuredPhoto(path, record, camera, pose))
        else:
            why = "T_world_camera is no pose (expected 4x4, a rotation and a place): import it again"
            skipped.append((path, f"{MANIFEST}: {why}"))
    return photos, skipped


def scale_camera(camera: Camera, max_px: int = MAX_PX) -> Camera:
    """Return the camera of a photograph, scaled down to a longer side of `max_px`, with pixel centres at half integers.

    Rounded width and height make slightly different scales of x and y.
    """
    share = min(1.0, max_px / max(camera.width, camera.height))
    return camera.scaled(max(1, round(camera.width * share)), max(1, round(camera.height * share)))


def _why_not(photo: MeasuredPhoto, item: TableObject, booster_sha256: str | None) -> str | None:
    shown = photo.record.booster_sha256
    if shown and booster_sha256 and shown != booster_sha256:
        return (
            f"it shows another patch (SHA-256 {shown[:12]}…) than the patch that is here ({booster_sha256[:12]}…): "
            "name that patch's folder (patches)"
        )
    position = photo.T_world_camera[:3, 3]
    low, high = item.mesh.bounds
    # the table is at z = 0
    if position[2] <= 0 or (np.all(position > low) and np.all(position < high)):
        return "its measured camera is below the table or inside the object: check the board's size and the lens"
    return None


def _plan_shot(
    photo: MeasuredPhoto, item: TableObject, look: dict[str, Any], photos_dir: Path, image_format: str, taken: set[str]
) -> Shot:
    path = str(PurePosixPath(photo.path).with_suffix(f".{image_format}"))
    if path in taken:  # pose_01.jpg beside pose_01.heic
        path = f"{photo.path}.{image_format}"
    taken.add(path)
    # rounded, so that float noise alone makes no new shot
    camera, pose = photo.camera, np.round(photo.T_world_camera, 6)
    key = SHOTS.key(look | {"camera": camera.intrinsics, "T_world_camera": pose.tolist()})
    made = {"like": f"{real_path(photos_dir).name}/{photo.path}", "like_sha256": photo.record.image_sha256 or ""}
    return Shot(item, photo.record.variant, photo.record.pose_id, camera, pose, path=path, key=key, made=made)
