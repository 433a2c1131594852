"""Inspection of a photograph of a shot: results of the gates, and distance of its camera from the plan's pose."""

from collections import OrderedDict
from contextlib import suppress
from dataclasses import dataclass
from threading import Lock

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.rig.applied.base import GREY
from toolkit.rig.camera import Camera
from toolkit.rig.plan import CapturePlan, Pose
from toolkit.rooms.photos.board_pose import find_board
from toolkit.rooms.photos.gates import GateResult
from toolkit.rooms.photos.gates.check_photo import ExpectationBuilder, inspect_photo
from toolkit.rooms.photos.lens import read_lenses
from toolkit.rooms.photos.locate import PoseMatch, locate_sighting, match_pose, view_of
from toolkit.rooms.photos.photo import Photo, load_pixels
from toolkit.rooms.photos.posed_camera import PosedCamera
from toolkit.rooms.photos.shot_order import ShotStep

KEPT = 6


@dataclass(frozen=True)
class Inspection:
    """Measures of a photograph.

    Attributes:
        results: of the gates.
        located: the camera; None without a board, and `no_board` says why.
        match: of the camera with the shot's pose.
        nearest: of the camera with the nearest pose of the plan.
        ghost_scale: size of the object over that in a picture of the plan; None without a board.
    """

    sha256: str
    results: tuple[GateResult, ...]
    located: PosedCamera | None
    no_board: str
    match: PoseMatch | None
    nearest: PoseMatch | None
    ghost_scale: float | None = None

    @property
    def wrong_pose(self) -> str | None:
        """Why the pose is wrong: the board shows another pose, or a camera that is far off."""
        if self.match is None or self.nearest is None:
            return None
        # an ambiguous neighbour is no proof: poses may lie close together
        if self.nearest.pose_id != self.match.pose_id and not self.nearest.ambiguous:
            return f"the board shows that this is nearer to pose {self.nearest.pose_id}"
        return "the board shows that the camera stood far from this pose" if self.match.far else None

    @property
    def checked(self) -> tuple[GateResult, ...]:
        """Results of the gates that measured something: the others are no reason for a retake."""
        return tuple(result for result in self.results if result.status != "not checked")

    @property
    def good(self) -> bool:
        """Whether the pose is right and no gate failed."""
        return self.wrong_pose is None and not any(result.failed for result in self.results)


class Inspector:
    """Inspects photographs by the import's own pose and gates; safe to call from several threads."""

    def __init__(self, workspace: Workspace, plan: CapturePlan) -> None:
        self._workspace, self._plan = workspace, plan
        self._expecter = ExpectationBuilder(workspace)
        self._lock = Lock()
        self._warm: set[tuple[str, str]] = set()
        self._stopped = False
        self._kept: OrderedDict[tuple[str, ShotStep], Inspection] = OrderedDict()

    def inspect(self, photo: Photo, step: ShotStep, pixels: np.ndarray | None = None) -> Inspection:
        """Measure a photograph that should show a step; the last few are kept. `pixels` save decoding it again.

        Raises:
            UnreadableImage: it does not decode.
            ToolkitError: the board's or the lenses' file is broken.
        """
        key = (photo.sha256, step)
        with self._lock:  # two at once would share the processor
            if key not in self._kept:
                self._kept[key] = self._measure(photo, step, load_pixels(photo) if pixels is None else pixels)
            self._kept.move_to_end(key)
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
            return self._kept[key]

    def warm_up(self, step: ShotStep) -> None:
        """Build the object of the next shot and load the gates ahead of its photograph, which then reports faults."""
        with self._lock, suppress(ToolkitError):
            if not self._stopped and (step.object, step.variant) not in self._warm:
                self._warm.add((step.object, step.variant))
                expectation = self._expecter.expect(step.object, step.variant, step.pose_id)
                # a plain grey picture is enough to load all that the gates need
                inspect_photo(np.full((120, 160, 3), GREY, np.uint8), expectation)

    def stop(self) -> None:
        """Wait for the current measurement, and warm up no more: a thread in a renderer must not be cut off."""
        with self._lock:
            self._stopped = True

    def _measure(self, photo: Photo, step: ShotStep, pixels: np.ndarray) -> Inspection:
        sighting = find_board(pixels, self._expecter.board)
        found = locate_sighting(photo, sighting, read_lenses(self._workspace))
        located = None if isinstance(found, str) else found
        why = found if isinstance(found, str) else ""
        match = nearest = scale = None
        # the nearest pose of the plan, and how far the camera is from the pose of this shot
        if located is not None:
            poses = self._plan.objects[step.object]
            nearest = match_pose(located.T_world_camera, poses)
            pose = next(pose for pose in poses if pose.id == step.pose_id)
            match = match_pose(located.T_world_camera, [pose])
            # the object's size in this photograph over that in the plan's picture, for the outline on the page
            scale = _compare_size(located.camera, match, pose, self._plan.camera)
        expectation = self._expecter.expect(step.object, step.variant, step.pose_id, located, why)
        results = inspect_photo(pixels, expectation, sighting).results
        return Inspection(photo.sha256, results, located, why, match, nearest=nearest, ghost_scale=scale)


def _compare_size(lens: Camera, match: PoseMatch, pose: Pose, camera: Camera) -> float:
    """Size of the object in a photograph over that in the plan's picture, both relative to the shorter side."""
    # focal lengths as shares of the shorter side, which is the ghost's width
    zoom = lens.fx / min(lens.width, lens.height) / (camera.fx / min(camera.width, camera.height))
    planned_mm = view_of(pose.matrix(), np.array(pose.target_mm)).distance_mm
    return float(zoom * planned_mm / max(planned_mm + match.distance_mm, 1.0))
