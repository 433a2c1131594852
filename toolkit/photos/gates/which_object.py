"""Does a photograph show the object that it should? It is compared with renders of every object of the workspace."""

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import cv2
import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.load import load_object
from toolkit.photos.gates.result import Gate, GateResult
from toolkit.rig.plan import read_plan

if TYPE_CHECKING:
    from toolkit.photos.match_render import PoseTemplates

WORK_SIDE_PX = 640
"""Longer side of the photograph that is compared; the object then still is larger than its template."""
LEAST_LIKENESS = 0.68
"""Of the likeliest object. 39 real photographs that show none of the four shipped objects, or another of their class,
are 0.40 to 0.66 like each; a lead alone says nothing, as some objects are like any picture."""
OBJECT = Gate(
    "wrong object", 0.1, "likeness by which another object is ahead",
    "it looks like another object: put the right one there, or sort the photo anew",
)  # fmt: skip


class KnownObjects:
    """What the objects of a workspace's plan look like; they are rendered once, when they are first asked for.

    Args:
        workspace: whose plan and objects are meant.
    """

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._last: tuple[np.ndarray, dict[str, float]] | None = None

    @cached_property
    def _classes(self) -> dict[str, str | int]:
        return {name: load_object(self._workspace.object_spec(name)).spec.class_name for name in self._templates}

    @cached_property
    def _templates(self) -> "dict[str, PoseTemplates]":
        """Of each object of the plan that can be read, bare; none without a plan."""
        from toolkit.photos.match_render import make_templates  # with the renderer, which `eval` needs not

        if not self._workspace.plan_file.is_file():
            return {}
        plan, found = read_plan(self._workspace.plan_file), {}
        for name, poses in plan.objects.items():
            try:
                mesh = load_object(self._workspace.object_spec(name)).mesh
                found[name] = make_templates(mesh, plan.camera, poses)
            except ToolkitError:
                continue  # the command that plans or shoots it says what is wrong
        return found

    def _compare(self, image: np.ndarray) -> dict[str, float]:
        """Scores of one photograph, remembered until the next: it is asked about several objects."""
        from toolkit.photos.match_render import match_objects

        if self._last is None or self._last[0] is not image:
            share = WORK_SIDE_PX / max(image.shape[:2])
            small = cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA) if share < 1 else image
            self._last = image, match_objects(small, self._templates)
        return self._last[1]

    def check(self, image: np.ndarray, name: str) -> GateResult:
        """By how much a photograph (h, w, 3) uint8 sRGB, upright, looks more like an object other than `name`."""
        if name not in self._templates:
            return OBJECT.skip("the plan has no poses of the object to compare with")
        if len(self._templates) < 2:
            return OBJECT.skip("the plan has no other object to compare with")
        scores = self._compare(image)
        rivals = {one: score for one, score in scores.items() if self._classes[one] != self._classes[name]}
        return judge_likeness(name, scores[name], rivals)


def judge_likeness(name: str, own: float, rivals: Mapping[str, float]) -> GateResult:
    """Compare an object's likeness with that of others, by name; `not checked` where none is plainly ahead."""
    if not rivals:
        return OBJECT.skip("the plan has no object of another class to compare with")
    rival = max(rivals, key=lambda one: rivals[one])
    lead = rivals[rival] - own
    if max(own, rivals[rival]) < LEAST_LIKENESS:
        return OBJECT.skip("it looks like none of the plan's objects for sure")
    if abs(lead) < OBJECT.threshold:
        return OBJECT.skip(f"it looks about as much like '{rival}' as like '{name}'")
    return OBJECT.judge(lead, f"it looks like '{rival}', not like '{name}': put '{name}' there, or sort the photo anew")
