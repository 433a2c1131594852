"""Find variants of a source that were shot with another spec, booster, scene or plan than the images of now."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toolkit.captures.capture import SETTINGS, find_difference
from toolkit.captures.manifest import LEFT_OUT, CaptureRecord, read_manifest
from toolkit.captures.read import read_settings
from toolkit.captures.shoot import ShootSettings, Shot, describe_made, plan_scene
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject, load_object
from toolkit.rig.plan import CapturePlan


@dataclass(frozen=True)
class StaleVariant:
    """A variant of an object whose images would look different if they were shot now."""

    object: str
    variant: str
    reason: str
    paths: tuple[str, ...]
    can_shoot: bool


def find_stale(
    workspace: Workspace, plan: CapturePlan, objects: Iterable[str], variants: Sequence[str], settings: ShootSettings,
    source_dir: Path,
) -> list[StaleVariant]:  # fmt: skip
    """Return the stale variants of these objects in a source; `variants` are shot in any case.

    Raises:
        ToolkitError: the manifest, a spec or a mesh is broken.
    """
    # by object and variant
    groups: dict[tuple[str, str], dict[str, CaptureRecord]] = {}
    wanted = set(objects)
    # images of other variants in the folder
    for path, record in read_manifest(source_dir).items():
        if record.object in wanted and record.variant not in variants and (source_dir / path).is_file():
            groups.setdefault((record.object, record.variant), {})[path] = record
    stale = []
    items = {name: load_object(workspace.object_spec(name)) for name in dict.fromkeys(name for name, _ in groups)}
    # compare with shots as they would be now
    for (name, variant), records in groups.items():
        counted = {path: record for path, record in records.items() if LEFT_OUT not in record.made}
        try:
            shots = {shot.path: shot for shot in plan_scene(workspace, plan, items[name], variant, settings)}
            reason = _explain(counted, shots, items[name], settings, workspace)
        except ToolkitError as error:
            stale.append(StaleVariant(name, variant, str(error), tuple(counted), can_shoot=False))
            continue
        if reason:
            stale.append(StaleVariant(name, variant, reason, tuple(counted), can_shoot=True))
    return stale


def _explain(
    records: Mapping[str, CaptureRecord], shots: Mapping[str, Shot], item: TableObject, settings: ShootSettings,
    workspace: Workspace,
) -> str | None:  # fmt: skip
    """Return how the images differ from images that would be shot now, in words; None if they do not."""
    for path, record in records.items():
        shot = shots.get(path)
        if shot is None:
            # a pose that the plan has no more
            return SETTINGS["pose_sha256"]
        if shot.key == record.inputs_sha256:
            continue
        booster = settings.find_booster(workspace, item, record.variant)
        # the first difference that the manifests state, from the most telling: settings, booster, camera
        difference = find_difference(read_settings(record.made), read_settings(describe_made(item, booster, settings)))
        if difference:
            return difference
        # settings are the same: it is the booster or the camera
        if record.booster_sha256 != (booster.sha256 if booster else None):
            return "another booster"
        # the camera, as far as the manifest states it
        pose = record.T_world_camera
        is_near = pose is None or np.allclose(pose, shot.T_world_camera, rtol=0, atol=1e-5)
        has_camera = pose is None or (is_near and record.intrinsics == shot.camera.intrinsics)
        return "other inputs" if has_camera else SETTINGS["pose_sha256"]
    return None
