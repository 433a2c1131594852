"""The silhouette of an object and what it hides from a camera, and whether a photograph shows that object.

Convention: the first pixel's centre lies at (0.5, 0.5); world millimetres; `T_world_camera` as everywhere.
"""

from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import cv2
import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.load import load_object
from toolkit.objects.mesh import Mesh, cast_rays, make_ray_scene
from toolkit.rig.plan import CapturePlan, read_plan
from toolkit.rooms.photos.gates import Gate, GateResult
from toolkit.rooms.photos.posed_camera import PosedCamera

if TYPE_CHECKING:
    from open3d.t.geometry import RaycastingScene

    from toolkit.rooms.photos.match_render import PoseTemplates

MASK_SIDE_PX = 256
"""Longer side of the silhouettes: a pixel is then about a pixel of what a classifier sees."""
CANVAS_PX = 192
SLACK_MM = 2.0
WIDEST = 4.0
"""Tangent of the widest angle from the line of sight at which a part of the object is still counted."""


@dataclass(frozen=True)
class Solid:
    """An object on the table with its boosters, in world millimetres, ready for rays to be cast at."""

    mesh: Mesh = field(repr=False)

    @cached_property
    def _scene(self) -> "RaycastingScene":
        return make_ray_scene(self.mesh)

    def hit_mm(self, origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(n,) distance from a point (3,) along unit vectors (n, 3); infinite if the object is missed."""
        rays = np.concatenate([np.broadcast_to(origin, directions.shape), directions], axis=1)
        return cast_rays(self._scene, rays)

    def hides(self, view: PosedCamera, points_mm: np.ndarray) -> np.ndarray:
        """(n,) which points (n, 3) lie behind the object, more than `SLACK_MM` behind its surface."""
        away = points_mm - view.position_mm
        length = np.linalg.norm(away, axis=1)
        return self.hit_mm(view.position_mm, away / length[:, None]) < length - SLACK_MM


def draw_silhouette(solid: Solid, view: PosedCamera) -> np.ndarray:
    """(h, w) bool: the object's place in the photograph, at `MASK_SIDE_PX`."""
    lens = view.camera
    share = MASK_SIDE_PX / max(lens.width, lens.height)
    w, h = max(1, round(lens.width * share)), max(1, round(lens.height * share))
    x, y = np.meshgrid((np.arange(w) + 0.5) * lens.width / w, (np.arange(h) + 0.5) * lens.height / h)
    directions = lens.undistort(np.stack([x.ravel(), y.ravel()], axis=1))
    return np.isfinite(solid.hit_mm(view.position_mm, view.rays(directions))).reshape(h, w)


def silhouette_px(solid: Solid, view: PosedCamera) -> np.ndarray:
    """(n, 2) pixels, evenly spread over the object's silhouette, also outside the frame; empty behind the camera."""
    # R^T applied from the right: world vectors into the camera's axes
    local = (solid.mesh.vertices - view.position_mm) @ view.T_world_camera[:3, :3]
    ahead = local[local[:, 2] > 1e-3 * np.abs(local).max()]
    if len(ahead) == 0:
        return np.zeros((0, 2))
    flat = ahead[:, :2] / ahead[:, 2:]
    # a point beside the camera would stretch the grid to infinity
    low, high = np.clip(flat.min(axis=0), -WIDEST, WIDEST), np.clip(flat.max(axis=0), -WIDEST, WIDEST)
    step = max(float((high - low).max()) / CANVAS_PX, 1e-9)
    x, y = (np.arange(low[axis] + step / 2, high[axis], step) for axis in (0, 1))
    directions = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    rays = view.rays(directions)
    distance = solid.hit_mm(view.position_mm, rays)
    met = np.isfinite(distance)
    points = view.position_mm + rays[met] * distance[met, None]
    return view.project(points)


WORK_SIDE_PX = 640
"""Longer side of the photograph that is compared; the object then still is larger than its template."""
LEAST_LIKENESS = 0.68
"""Smallest likeness of the likeliest object. 39 real photographs without any of the shipped objects have 0.40 to 0.66.
A lead alone means nothing, as some objects resemble any picture."""
OBJECT = Gate(
    "wrong object", 0.1, "likeness by which another object is ahead",
    "it looks like another object: put the right object there, or sort the photo again",
)  # fmt: skip


class KnownObjects:
    """Renders of the objects of a workspace's plan, made once when they are first needed."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._last: tuple[np.ndarray, dict[str, float]] | None = None

    @cached_property
    def _classes(self) -> dict[str, str | int]:
        return {name: load_object(self._workspace.object_spec(name)).spec.class_name for name in self._templates}

    @cached_property
    def _plan(self) -> CapturePlan | None:
        return read_plan(self._workspace.plan_file) if self._workspace.plan_file.is_file() else None

    @cached_property
    def _templates(self) -> "dict[str, PoseTemplates]":
        """Templates of each readable object of the plan, without a booster; empty without a plan."""
        from toolkit.rooms.photos.match_render import make_templates  # with the renderer, which `eval` needs not

        found: dict[str, PoseTemplates] = {}
        if (plan := self._plan) is None:
            return found
        for name, poses in plan.objects.items():
            with suppress(ToolkitError):  # the command that plans or shoots it names the fault
                mesh = load_object(self._workspace.object_spec(name)).mesh
                found[name] = make_templates(mesh, plan.camera, poses)
        return found

    def _compare(self, image: np.ndarray) -> dict[str, float]:
        """Scores of a photograph, kept until the next, as it is compared with several objects."""
        from toolkit.rooms.photos.match_render import match_objects

        if self._last is None or self._last[0] is not image:
            share = WORK_SIDE_PX / max(image.shape[:2])
            small = cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA) if share < 1 else image
            self._last = image, match_objects(small, self._templates)
        return self._last[1]

    def check(self, image: np.ndarray, name: str) -> GateResult:
        """Judge whether a photograph (h, w, 3) uint8 sRGB, upright, looks more like another object than `name`."""
        known: Collection[str] = self._plan.objects if self._plan else ()
        if len(known) > 1:  # else nothing need be rendered to know the answer
            known = self._templates
        if name not in known:
            return OBJECT.skip("the plan has no poses of the object to compare with")
        if len(known) < 2:
            return OBJECT.skip("the plan has no other object to compare with")
        scores = self._compare(image)
        # an object of the same class is not wrong, and may look the same
        rivals = {rival: score for rival, score in scores.items() if self._classes[rival] != self._classes[name]}
        return judge_likeness(name, scores[name], rivals)


def judge_likeness(name: str, own: float, rivals: Mapping[str, float]) -> GateResult:
    """Compare an object's likeness with that of others, by name; `not checked` if none is plainly ahead."""
    if not rivals:
        return OBJECT.skip("the plan has no object of another class to compare with")
    rival = max(rivals, key=lambda other: rivals[other])
    lead = rivals[rival] - own
    # checked before the lead: among poor likenesses a leader means nothing
    if max(own, rivals[rival]) < LEAST_LIKENESS:
        return OBJECT.skip("it does not clearly look like any of the plan's objects")
    if abs(lead) < OBJECT.threshold:
        return OBJECT.skip(f"it looks about as much like '{rival}' as like '{name}'")
    advice = f"it looks like '{rival}', not like '{name}': put '{name}' there, or sort the photo again"
    return OBJECT.judge(lead, advice)
