"""Where a photograph's camera stood, from the printed board in the photograph."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from toolkit.core.workspace import Workspace
from toolkit.photos.photo import Photo
from toolkit.photos.posed_camera import PosedCamera

if TYPE_CHECKING:
    from toolkit.photos.board_pose import BoardSighting
    from toolkit.photos.lens import LensRecord


Locate = Callable[[Photo, np.ndarray], PosedCamera | str]
"""(photo, its pixels (h, w, 3) uint8) -> where its camera stood, or in words why that is not known."""


def locate_by_board(workspace: Workspace) -> Locate:
    """A function that finds the workspace's board in a photograph and solves for the camera.

    Raises:
        ToolkitError: `rig/board.json` or `rig/lens.json` is broken.
    """
    from toolkit.photos.board_pose import explain_absence, find_board, measure_ink
    from toolkit.photos.lens import read_lenses
    from toolkit.rig.board_file import read_board

    board, lenses = read_board(workspace), read_lenses(workspace)

    def locate(photo: Photo, pixels: np.ndarray) -> PosedCamera | str:
        if board.looks_the_same_turned:
            return f"a {board.describe()} looks the same turned half round: use one with an odd and an even count"
        sighting = find_board(pixels, board)
        if sighting is None:
            return explain_absence(pixels, board)
        found = locate_sighting(photo, sighting, lenses)
        if isinstance(found, str):
            return found
        details = {**found.details, "board_ink": round(measure_ink(pixels, sighting), 3)}
        if workspace.board is not None:
            details["board"] = workspace.board.stem
        return replace(found, details=details)

    return locate


def locate_sighting(photo: Photo, sighting: "BoardSighting | None", lenses: list["LensRecord"]) -> PosedCamera | str:
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
    return PosedCamera(pose.T_world_camera, choice.lens, details)
