"""Choose the pose that a photograph shows; doubts are reported, never guessed."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from toolkit.core.errors import ToolkitError
from toolkit.core.text import join_words
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import UnreadableImage
from toolkit.objects.load import load_object
from toolkit.rig.plan import CapturePlan, hash_pose
from toolkit.rig.variants import VARIANTS, apply_booster, find_booster
from toolkit.rooms.photos.importing.evidence import Evidence, Group, possible_poses
from toolkit.rooms.photos.importing.gather import CaptureKey
from toolkit.rooms.photos.locate import PoseMatch, match_pose
from toolkit.rooms.photos.photo import load_pixels

if TYPE_CHECKING:
    from toolkit.rooms.photos.match_render import PoseTemplates, RenderMatch

MOST_NAMED = 2
FAR_AND_NAMED_DEG = 30.0
"""Largest angle between a camera and the pose of its order or name at which it was meant for that pose."""


@dataclass(frozen=True)
class Decision:
    """Object, variant and pose of a photograph.

    Attributes:
        matched_by: board, name, order, render, pairs, or user.
        match: distance of the camera from that pose by the board.
        class_name, pose_name, row: class and name of the pose in a table of pairs, and its file and line.
        pose_sha256: `hash_pose` of the plan's pose and camera; empty without a plan.
    """

    key: CaptureKey
    matched_by: str
    match: PoseMatch | None = None
    class_name: str = ""
    pose_name: str = ""
    row: str = ""
    pose_sha256: str = ""


def name_pose(decision: Decision, plan: CapturePlan) -> Decision:
    """Add the hash of the plan's pose: another plan may use the same numbers."""
    poses = [pose for pose in plan.objects.get(decision.key.object, ()) if pose.id == decision.key.pose_id]
    return replace(decision, pose_sha256=hash_pose(plan.camera, poses[0])) if poses else decision


@dataclass(frozen=True)
class Doubt:
    """Why no pose was chosen, and the keys from which a person could choose."""

    reason: str
    choices: tuple[CaptureKey, ...] = ()


MatchRender = Callable[[Evidence, Group], Decision | Doubt]
"""(photograph, its object and variant) -> the pose of the nearest render."""


def decide_pose(
    evidence: Evidence, plan: CapturePlan, how: str = "auto", by_render: MatchRender | None = None
) -> Decision | Doubt:
    """Choose the pose of a photograph by `how`, as in `ImportSettings.match`.

    With `auto` the board counts first, then the name, then the order, then the nearest render. Weaker evidence may
    decide between two poses that are about equally near. If it contradicts the board, the pose is in doubt.
    """
    group = evidence.find_group()
    if group is None:
        if evidence.between:
            reason = evidence.no_order
            if len(evidence.between) <= MOST_NAMED:
                reason = f"could be {' or '.join(map(str, evidence.between))}: {reason}"
            return Doubt(reason, evidence.between)
        missing = "nothing says which object and variant it shows"
        return Doubt(f"{missing}: {evidence.no_order}" if evidence.no_order else missing)
    # name and order, and the nearest pose by the board
    claims = _collect_claims(evidence, how)
    match = match_pose(evidence.located.T_world_camera, plan.objects[group[0]]) if evidence.located else None
    # renders decide only where nothing else does, or where that is asked for
    if how == "render" or (how == "auto" and match is None and not claims and by_render):
        return by_render(evidence, group) if by_render else Doubt("matching by render needs the object's mesh")
    if how in ("name", "order") or match is None:
        return _decide_by_claims(group, claims, evidence, plan, how)
    return _decide_by_board(group, claims, match)


def measure_match(evidence: Evidence, key: CaptureKey, plan: CapturePlan) -> PoseMatch | None:
    """Compare the camera with the chosen pose; None without a board."""
    if evidence.located is None:
        return None
    poses = [pose for pose in plan.objects[key.object] if pose.id == key.pose_id]
    return match_pose(evidence.located.T_world_camera, poses)


def _collect_claims(evidence: Evidence, how: str) -> dict[str, int]:
    claims = {}
    if how in ("auto", "name") and evidence.named is not None:
        claims["name"] = evidence.named
    if how in ("auto", "order") and evidence.ordered is not None:
        claims["order"] = evidence.ordered.pose_id
    if how == "auto" and "order" in claims and evidence.looks is not None:
        claims["likeness to the renders"] = evidence.looks
    return claims


def _decide_by_claims(
    group: Group, claims: dict[str, int], evidence: Evidence, plan: CapturePlan, how: str
) -> Decision | Doubt:
    poses = sorted(set(claims.values()))
    if not poses:
        why = evidence.no_order
        # a reason for each way that may be asked for
        reasons = {
            "auto": f"{evidence.no_board}, its name says no pose" + (f", and {why}" if why else ""),
            "board": evidence.no_board,
            "name": "its name gives no pose of the plan: expected a name such as pose_07",
            "order": why or "its place in the order is not known",
        }
        return Doubt(reasons[how])
    # evidence that contradicts itself is a doubt, however many agree
    if len(poses) > 1:
        said = join_words(f"its {what} says pose {pose}" for what, pose in claims.items())
        return Doubt(said, tuple(CaptureKey(*group, pose) for pose in poses))
    key = CaptureKey(*group, poses[0])
    return Decision(key, next(iter(claims)), measure_match(evidence, key, plan))


def _decide_by_board(group: Group, claims: dict[str, int], match: PoseMatch) -> Decision | Doubt:
    possible = possible_poses(match)
    choices = tuple(CaptureKey(*group, pose) for pose in dict.fromkeys((*possible, *claims.values())))
    # a board that contradicts the name is a swap, which only the user can resolve
    against = [f"its {what} says pose {pose}" for what, pose in claims.items() if pose not in possible]
    if against:
        return Doubt(f"the board shows {match.describe()}, but {join_words(against)}", choices)
    claimed = set(claims.values())
    if len(claimed) > 1:
        return Doubt(f"the board shows {match.describe()}; name and order disagree", choices)
    chosen = next(iter(claimed)) if claimed else match.pose_id
    # a camera far from every pose counts if name or order give the same pose: the user meant it
    confirmed = claimed and chosen == match.pose_id and match.error_deg <= FAR_AND_NAMED_DEG
    if (match.ambiguous and not claimed) or (match.far and not confirmed):
        return Doubt(f"the board shows {match.describe()}", choices)
    return Decision(CaptureKey(*group, chosen), "board", match)


class RenderMatcher:
    """Compares photographs with renders of their objects, which are made once per object and variant."""

    def __init__(self, workspace: Workspace, plan: CapturePlan) -> None:
        self._workspace, self._plan = workspace, plan
        self._made: dict[Group, PoseTemplates | str] = {}

    def rank(self, evidence: Evidence, group: Group) -> "RenderMatch | str":
        """Compare a photograph with each pose of an object's variant, or say why no render can be made."""
        from toolkit.rooms.photos.match_render import make_templates, match_by_render

        if group not in self._made:
            # rendered with the booster of the variant, once
            try:
                item = load_object(self._workspace.object_spec(group[0]))
                booster = find_booster(self._workspace, item, group[1]) if group[1] in VARIANTS else None
                self._made[group] = make_templates(
                    apply_booster(item, booster), self._plan.camera, self._plan.objects[group[0]]
                )
            except ToolkitError as error:
                self._made[group] = str(error)
        # an error is kept as well, so that it is found out once
        templates = self._made[group]
        if isinstance(templates, str):
            return templates
        return match_by_render(load_pixels(evidence.candidate.photo), templates)

    def __call__(self, evidence: Evidence, group: Group) -> Decision | Doubt:
        """Choose the pose of the nearest render, as a `MatchRender`."""
        why = evidence.no_board
        try:
            found = self.rank(evidence, group)
        except UnreadableImage as error:
            return Doubt(error.reason)
        if isinstance(found, str):
            return Doubt(f"{why}, and no render can be made: {found}")
        best = CaptureKey(*group, found.pose_id)
        # two poses that look alike: a person decides
        if not found.ambiguous:
            return Decision(best, "render")
        if found.runner_up is None:
            return Doubt(f"{why}, and it does not look like the render of its pose", (best,))
        first, other = f"{found.pose_id} ({found.score:.2f})", f"{found.runner_up} ({found.ranking[1][1]:.2f})"
        reason = f"{why}, and it looks about as much like the render of pose {first} as of pose {other}"
        return Doubt(reason, (best, CaptureKey(*group, found.runner_up)))
