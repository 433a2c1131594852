"""What speaks for an object, a variant and a pose in a photograph: order, name, folder, and the printed board."""

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from toolkit.captures.read import read_pose_id
from toolkit.core.workspace import Workspace
from toolkit.photos.importing.gather import Candidate
from toolkit.photos.photo import Photo
from toolkit.rig.camera import Camera

if TYPE_CHECKING:
    from toolkit.photos.board_pose import BoardSighting
    from toolkit.photos.lens import LensRecord
    from toolkit.rig.plan import CapturePlan
    from toolkit.rig.shot_order import ShotStep


@dataclass(frozen=True)
class Target:
    """What a photograph shows: an object, a variant, a pose of the plan."""

    object: str
    variant: str
    pose_id: int

    def __str__(self) -> str:
        return f"{self.object}/{self.variant} pose {self.pose_id}"


@dataclass(frozen=True)
class Located:
    """Where a photograph's camera stood, from the board in it.

    Attributes:
        T_world_camera: (4, 4), OpenCV axes, millimetres.
        camera: of the upright photograph.
        details: what else was measured, for the record: reprojection error, corners found.
    """

    T_world_camera: np.ndarray
    camera: Camera
    details: Mapping[str, float | int | str] = field(default_factory=dict)


@dataclass(frozen=True)
class Evidence:
    """What is known of one photograph before a pose is chosen.

    Attributes:
        group: object and variant, from the command line or from folder and file names.
        named: the pose in the file's name, if names are to be believed here.
        ordered: what its place in the order of shooting says.
        located: where the board says the camera stood.
        no_board: why there is no `located`.
    """

    group: tuple[str, str] | None = None
    named: int | None = None
    ordered: Target | None = None
    located: Located | None = None
    no_board: str = "no board is seen"


def find_group(
    candidate: Candidate, objects: Collection[str], variants: Collection[str], forced: tuple[str | None, str | None]
) -> tuple[str, str] | str | None:  # fmt: skip
    """Object and variant of a photograph.

    Args:
        candidate: whose folders and file name may hold them, as in racer/patched/IMG_1.jpg or racer_patched_07.jpg.
        objects, variants: known names.
        forced: object and variant from the command line, None where it says none.

    Returns:
        (object, variant); None where one of them is unknown; a sentence where what was said and the names disagree.
    """
    words = [*candidate.folders, *re.split(r"[\s_.]+", candidate.photo.path.stem)]
    group = []
    for kind, known, said in (("object", objects, forced[0]), ("variant", variants, forced[1])):
        # the innermost folder, or the file's own name, says it best
        named = next((word for word in reversed(words) if word in known), None)
        if said and named and named != said:
            return f"its name or folder says {kind} '{named}', the command says '{said}'"
        group.append(said or named)
    return (group[0], group[1]) if group[0] and group[1] else None


def believe_names(candidates: Sequence[Candidate], pose_ids: Collection[int], always: bool) -> list[int | None]:
    """The pose in each name, where names are to be believed.

    A camera's own counter (IMG_0007) says nothing of poses. A number counts after the word `pose`; otherwise only when
    the numbers of all names together are the plan's poses, each once.

    Args:
        candidates: of one object and variant.
        pose_ids: of the plan.
        always: believe every number that is a pose of the plan, as `match` = `name` asks for.
    """
    numbers = [read_pose_id(one.photo.path.name) if one.photo.frame is None else None for one in candidates]
    whole = Counter(numbers) == Counter(pose_ids)
    believed: list[int | None] = []
    for one, number in zip(candidates, numbers, strict=True):
        said = always or whole or re.search(r"pose[\s_-]*\d", one.photo.path.stem, re.IGNORECASE) is not None
        believed.append(number if said and number in pose_ids else None)
    return believed


def order_group(
    count: int, group: tuple[str, str], plan: "CapturePlan", steps: Sequence["ShotStep"]
) -> list[Target] | str:  # fmt: skip
    """What `count` photographs of one object and variant show if they follow the order of shooting.

    That is the shot list's, where it has them, else the plan's.

    Returns:
        One target per photograph, or why the order says nothing.
    """
    pose_ids = [step.pose_id for step in steps if (step.object, step.variant) == group]
    source = "the shot list" if pose_ids else "the plan"
    pose_ids = pose_ids or [pose.id for pose in plan.objects[group[0]]]
    if count != len(pose_ids):
        return f"{count} photographs for the {len(pose_ids)} poses of {source}, so their order says nothing"
    return [Target(*group, pose_id) for pose_id in pose_ids]


def order_session(count: int, steps: Sequence["ShotStep"], first: int | None) -> list[Target] | str:
    """What `count` photographs show if they follow the shot list.

    Args:
        count: of photographs that neither the command nor their names put into a group.
        steps: the shot list.
        first: number of the first photograph's shot, if the list was shot in parts; None: they are the whole list.

    Returns:
        One target per photograph, or why the order says nothing.
    """
    if first is None and count != len(steps):
        return (
            f"{count} photographs for the {len(steps)} shots of rig/shots.json: say the first shot of a part of "
            "the list, or object and variant"
        )
    part = steps[(first or 1) - 1 :][:count]
    if len(part) < count:
        return f"{count} photographs from shot {first} on, the list has {len(steps)} shots"
    return [Target(step.object, step.variant, step.pose_id) for step in part]


def group_by(
    candidates: Sequence[Candidate], groups: Mapping[int, tuple[str, str]]
) -> dict[tuple[str, str], list[int]]:
    """Indices of the candidates of each group, in order."""
    indices: dict[tuple[str, str], list[int]] = {}
    for i in range(len(candidates)):
        if i in groups:
            indices.setdefault(groups[i], []).append(i)
    return indices


Locate = Callable[[Photo, np.ndarray], "Located | str"]
"""(photo, its pixels (h, w, 3) uint8) -> where its camera stood, or in words why that is not known."""


def locate_by_board(workspace: Workspace) -> Locate:
    """A function that finds the workspace's board in a photograph and solves for the camera.

    Raises:
        ToolkitError: `rig/board.json` or `rig/lens.json` is broken.
    """
    from toolkit.photos.board_pose import find_board
    from toolkit.photos.lens import read_lenses
    from toolkit.rig.board import read_board

    board, lenses = read_board(workspace), read_lenses(workspace)

    def locate(photo: Photo, pixels: np.ndarray) -> Located | str:
        return locate_sighting(photo, find_board(pixels, board), lenses)

    return locate


def locate_sighting(photo: Photo, sighting: "BoardSighting | None", lenses: list["LensRecord"]) -> Located | str:
    """Where a photograph's camera stood, from the board that was found in it; in words why that is not known.

    Args:
        photo: whose lens is looked up.
        sighting: of the board in the photograph, None where none was found.
        lenses: that were calibrated.
    """
    from toolkit.photos.board_pose import solve_pose
    from toolkit.photos.lens import choose_lens

    if sighting is None:
        return "no board is seen"
    choice = choose_lens(photo, lenses)
    if choice.lens is None:
        return f"a board is seen, but not the lens known: {choice.note}"
    pose = solve_pose(sighting, choice.lens)
    if pose is None:
        return "a board is seen, but its corners fit no camera above the table"
    if reason := pose.doubt():
        return reason
    details = {
        "lens": choice.source, "board_corners": pose.n_corners, "reprojection_px": round(pose.reprojection_px, 3),
    }  # fmt: skip
    return Located(pose.T_world_camera, choice.lens, details)
