"""Photographs of a shot list with gaps: each is assigned to a shot, in order, by what the pictures show.

A missing or surplus photograph shifts all that come after it. So every photograph is compared with its possible shots:
by the board, the name, the patch on the object, and the likeness to renders. Dynamic programming (Needleman and Wunsch,
1970) finds the cheapest assignment. A photograph is placed if every other place, or none, is dearer by `SURE`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from toolkit.core.console import progress
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import UnreadableImage
from toolkit.rig.camera import project
from toolkit.rig.plan import CapturePlan
from toolkit.rig.variants import IN_PIECES
from toolkit.rooms.photos.gates.check_photo import ExpectationBuilder
from toolkit.rooms.photos.gates.objects import KnownObjects
from toolkit.rooms.photos.gates.patch import ExpectedPatch
from toolkit.rooms.photos.gates.pieces import look_for_pieces
from toolkit.rooms.photos.importing.evidence import NOT_FOLLOWED, Evidence, Group
from toolkit.rooms.photos.importing.gather import CaptureKey, SourceIndex
from toolkit.rooms.photos.importing.match import RenderMatcher
from toolkit.rooms.photos.locate import match_pose
from toolkit.rooms.photos.match_render import LEAST_SCORE
from toolkit.rooms.photos.photo import load_pixels
from toolkit.rooms.photos.posed_camera import PosedCamera
from toolkit.rooms.photos.prints.find import SearchedPhoto, find_patch, search_photo
from toolkit.rooms.photos.shot_order import ShotStep

WRONG = 6.0
"""Cost of plain evidence against a shot: another name, a wrong patch, a board far off. All costs are negative
logarithms of likelihoods: a difference of 1 is a factor of e."""
LIKE = 100.0
"""Cost of a likeness to a shot's render that is less by 1. In rehearsed shots of racer and coffeepot, the correct
neighbour leads by 0.32 ± 0.065 and 0.14 ± 0.053. For normal distributions, the cost is twice the mean over the
variance: 150 and 100."""
SURE = 4.0
"""Lead in cost over every other place of a photograph: these are a fiftieth as likely. At 3, pictures without an object
were placed by likenesses that differ by 0.034."""
DEG = 0.4
"""Cost of a degree between the camera that the board shows and the pose: 15° are `WRONG`."""
TURN_DEG, SHAPE = 10.0, 0.1
"""Tolerances of a patch's corners against those from the pose: their turn, and their misfit as a share of their
distance. Beyond, costs grow slowly, as a Cauchy distribution's do. A sheet bent round an edge is off by 10 to 27° and
0.2 at its own pose, by 20 to 130° and more at others."""
UNSEEN = 2.0
"""Cost of a patch that should be there and is not seen: it may be turned away."""
EXTRA = 7.0
"""Cost of a photograph that is no shot of the list."""
GAP = 0.25
"""Cost of a shot without a photograph."""
DRIFT = 1
"""Number of surplus or missing photographs, beyond the difference of the counts, that is considered."""
NO_SHOT = -1
MOST_SHOTS = 60
"""Largest number of possible shots of a photograph for which renders are compared; more would take minutes."""


def align_shots(costs: np.ndarray) -> list[tuple[int, ...]]:
    """Return for each of n photographs, in order, its possible shots with `NO_SHOT`; a single shot if it is sure.

    `costs` (n, m) are of photograph i being shot j, infinite where it cannot be.
    """
    n, m = costs.shape
    # the cheapest way through (i, j) is the cheapest up to it plus the cheapest from it on, found backwards
    before, behind = _accumulate(costs), _accumulate(costs[::-1, ::-1])[::-1, ::-1]
    through = before[:n, :m] + costs + behind[1:, 1:]
    # a photograph that belongs to no shot costs EXTRA
    without = np.array([float((before[i] + EXTRA + behind[i + 1]).min()) for i in range(n)])
    # every assignment up to SURE dearer than the cheapest stays possible
    limit = before[n, m] + SURE
    return [
        tuple(np.flatnonzero(through[i] <= limit).tolist()) + ((NO_SHOT,) if without[i] <= limit else ())
        for i in range(n)
    ]


def _accumulate(costs: np.ndarray) -> np.ndarray:
    """(n + 1, m + 1) least cost of laying the first i photographs on the first j shots."""
    n, m = costs.shape
    least = np.full((n + 1, m + 1), np.inf)
    least[0] = GAP * np.arange(m + 1)
    for i in range(1, n + 1):
        least[i, 0] = i * EXTRA
        for j in range(1, m + 1):
            # the three steps of Needleman and Wunsch: a match, a surplus photograph, a shot without a photograph
            least[i, j] = min(least[i - 1, j - 1] + costs[i - 1, j - 1], least[i - 1, j] + EXTRA, least[i, j - 1] + GAP)
    return least


class Clues:
    """Compares pictures with the shots that they may be; renders and patches are made ready once."""

    def __init__(self, workspace: Workspace, plan: CapturePlan, matcher: RenderMatcher) -> None:
        self._plan, self._matcher = plan, matcher
        self._known, self._expecter = KnownObjects(workspace), ExpectationBuilder(workspace)

    def weigh(self, item: Evidence, shots: Sequence[CaptureKey]) -> np.ndarray:
        """(m,) cost of a photograph being each of the shots; 0 for all without evidence."""
        costs = np.zeros(len(shots))
        if item.unusable is not None:
            return costs
        groups = list(dict.fromkeys((shot.object, shot.variant) for shot in shots))
        # evidence adds up: each source of it costs where it speaks against a shot
        if item.named is not None:
            costs += [0.0 if shot.pose_id == item.named else WRONG for shot in shots]
        if item.located is not None:
            costs += [self._off(item, shot) for shot in shots]
        try:
            costs += self._weigh_objects(item, shots)
            costs += self._weigh_patches(item, shots, groups)
            # wraps need the camera, likeness is for photographs without it
            if item.located is not None:
                costs += self._weigh_wraps(item, shots, item.located)
            # renders are compared only for small groups, since each takes time
            if item.located is None and len(shots) <= MOST_SHOTS:
                costs += self._weigh_likeness(item, shots, groups)
        except UnreadableImage:
            pass  # storing it reports the fault
        return costs

    def _weigh_objects(self, item: Evidence, shots: Sequence[CaptureKey]) -> np.ndarray:
        """Cost of a photograph that plainly shows another object: it is surplus."""
        pixels = load_pixels(item.candidate.photo)
        is_wrong = {name: self._known.check(pixels, name).failed for name in {shot.object for shot in shots}}
        # dearer than to leave it out: the photograph takes no shot from another photograph
        return np.array([WRONG + EXTRA if is_wrong[shot.object] else 0.0 for shot in shots])

    def _off(self, item: Evidence, shot: CaptureKey) -> float:
        assert item.located is not None
        poses = [pose for pose in self._plan.objects[shot.object] if pose.id == shot.pose_id]
        return min(DEG * match_pose(item.located.T_world_camera, poses).error_deg, WRONG)

    def _weigh_likeness(self, item: Evidence, shots: Sequence[CaptureKey], groups: Sequence[Group]) -> np.ndarray:
        scores: dict[CaptureKey, float] = {}
        for group in groups:
            ranked = self._matcher.rank(item, group)
            if not isinstance(ranked, str):
                scores |= {CaptureKey(*group, pose): score for pose, score in ranked.ranking}
        found = np.array([scores.get(shot, np.nan) for shot in shots])
        if np.isnan(found).all() or np.nanmax(found) < LEAST_SCORE:
            return np.zeros(len(shots))
        # against the best of these shots: how alike any picture is depends on light and backdrop
        return np.minimum(LIKE * (np.nanmax(found) - np.nan_to_num(found, nan=-1)), WRONG)

    def _weigh_patches(self, item: Evidence, shots: Sequence[CaptureKey], groups: Sequence[Group]) -> np.ndarray:
        """Cost of another variant's patch, or of a patch that lies otherwise than from its pose, or is not seen."""
        photo: SearchedPhoto | None = None
        seen: dict[Group, np.ndarray | None] = {}
        # the patch of each group is looked for once
        for group in groups:
            patch = self._find_patch(group)
            if patch is not None:
                photo = photo or search_photo(load_pixels(item.candidate.photo))
                sighting = find_patch(photo, patch.patches[str(patch.own)])
                seen[group] = None if sighting is None else sighting.corners_px
        if not seen:
            return np.zeros(len(shots))
        # a patch that is nowhere seen speaks against all variants that have a patch
        if all(corners is None for corners in seen.values()):
            return np.array([UNSEEN if (shot.object, shot.variant) in seen else 0.0 for shot in shots])
        return np.array([self._compare_corners(shot, seen.get((shot.object, shot.variant))) for shot in shots])

    def _weigh_wraps(self, item: Evidence, shots: Sequence[CaptureKey], view: PosedCamera) -> np.ndarray:
        """Cost of a wrap that is missing, or should not be there; the board gives the places of its pieces."""
        is_on: dict[str, bool] = {}
        for name, variant in {(shot.object, shot.variant) for shot in shots if shot.variant in IN_PIECES}:
            expected = self._expecter.expect(name, variant)
            if expected.wrap is not None and expected.solid is not None:
                seen = look_for_pieces(load_pixels(item.candidate.photo), expected.wrap, expected.solid, view)
                if seen.is_judged:
                    is_on[name] = seen.is_on
        belongs = [shot.variant in IN_PIECES for shot in shots]
        wrong = [is_on.get(shot.object, wanted) != wanted for shot, wanted in zip(shots, belongs, strict=True)]
        return np.where(wrong, WRONG, 0.0)

    def _compare_corners(self, shot: CaptureKey, seen_px: np.ndarray | None) -> float:
        patch = self._find_patch((shot.object, shot.variant))
        if seen_px is None or patch is None:
            return WRONG
        (pose,) = [pose for pose in self._plan.objects[shot.object] if pose.id == shot.pose_id]
        cost = WRONG
        for sheet in patch.sheets:  # any of the sheets may have been found
            expected_px, depth = project(self._plan.camera, pose.matrix(), sheet.corners_mm)
            if (depth > 0).all():
                cost = min(cost, rate_corners(seen_px, expected_px))
        return cost

    def _find_patch(self, group: Group) -> ExpectedPatch | None:
        """The patch that an object's variant should wear, if its places are known."""
        patch = self._expecter.expect(*group).patch
        return patch if patch is not None and patch.own is not None and patch.sheets else None


def rate_corners(first_px: np.ndarray, other_px: np.ndarray) -> float:
    """Cost of corners (4, 2) that should lie as others: of their turn, and of the misfit that is left.

    Place and size are eliminated: least squares over similarities (Umeyama, 1991).
    """
    # corners as complex numbers: a turn is then a factor
    first, other = (corners[:, 0] + 1j * corners[:, 1] for corners in (first_px, other_px))
    first, other = first - first.mean(), other - other.mean()
    first, other = first / max(np.abs(first).mean(), 1e-9), other / max(np.abs(other).mean(), 1e-9)
    # the least-squares turn of two centred shapes is the angle of their inner product
    turn = np.angle((first * other.conj()).sum())
    off = np.sqrt((np.abs(first - other * np.exp(1j * turn)) ** 2).mean())
    # log(1 + x²): about squared within the tolerance, and slow beyond, as a Cauchy distribution has it
    return float(np.log1p((np.degrees(turn) / TURN_DEG) ** 2) + np.log1p((off / SHAPE) ** 2))


def place_with_gaps(
    evidence: Sequence[Evidence], plan: CapturePlan, steps: Sequence[ShotStep], index: SourceIndex, clues: Clues,
    again: bool = False,
) -> list[Evidence]:  # fmt: skip
    """Place photographs whose order fails only because photographs are missing or too many.

    Shots that have an image are no gaps, unless `again`.
    """
    every = list(evidence)
    taken = set() if again else {(image.object, image.variant, image.pose_id) for image in index.current.values()}
    parts: dict[Group | None, list[int]] = {}
    # photographs that need a place, by what they show if that is known
    for i, item in enumerate(every):
        if item.ordered is None and item.no_order and (item.no_order != NOT_FOLLOWED or taken):
            parts.setdefault(item.group, []).append(i)
    for group, members in parts.items():
        # the shots that they may be, in the order of the list
        shots = [CaptureKey(step.object, step.variant, step.pose_id) for step in steps]
        if group is not None:
            own = [shot for shot in shots if (shot.object, shot.variant) == group]
            shots = own or [CaptureKey(*group, pose.id) for pose in plan.objects[group[0]]]
        shots = [shot for shot in shots if (shot.object, shot.variant, shot.pose_id) not in taken]
        if not shots or not members:
            continue
        # the cheapest alignment in order; only a single candidate is a decision
        costs = _weigh_all(every, members, shots, clues)
        for i, places in zip(members, align_shots(costs), strict=True):
            found = tuple(shots[place] for place in places if place != NO_SHOT)
            if len(found) == len(places) == 1:
                every[i] = replace(every[i], ordered=found[0], no_order="")
            elif group is None:
                every[i] = replace(every[i], between=found)
    return every


def _weigh_all(every: Sequence[Evidence], members: Sequence[int], shots: list[CaptureKey], clues: Clues) -> np.ndarray:
    """(n, m) costs, infinite for shots that are farther on, or back, than the number of gaps allows."""
    n, m = len(members), len(shots)
    costs = np.full((n, m), np.inf)
    with progress("comparing with the shot list", n) as bar:
        for row, i in enumerate(members):
            # a photograph lies at most so many shots off its place as photographs or shots are missing
            first, last = max(0, row - max(n - m, 0) - DRIFT), min(m, row + max(m - n, 0) + DRIFT + 1)
            if first < last:
                costs[row, first:last] = clues.weigh(every[i], shots[first:last])
            bar.advance(note=every[i].candidate.label)
    return costs
