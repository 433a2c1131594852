"""Which pose a photograph shows; what is in doubt is said, never guessed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.workspace import Workspace
from toolkit.photos.importing.evidence import Evidence, Target
from toolkit.photos.importing.settings import FOLDER_NAME, ImportSettings
from toolkit.photos.match_pose import PoseMatch, match_pose
from toolkit.rig.plan import CapturePlan
from toolkit.rig.variants import VARIANTS

FOLLOWED_SHARE = 0.75
"""Share of the photographs with a board or a telling name that must agree with the order before it is believed."""
FAR_AND_NAMED_DEG = 30.0
"""A camera so far from the pose that order or name say was not meant to stand there."""


@dataclass(frozen=True)
class Decision:
    """What a photograph shows.

    Attributes:
        target: object, variant and pose.
        matched_by: board, name, order, render, or user.
        match: how far the camera stood from that pose, where a board says so.
    """

    target: Target
    matched_by: str
    match: PoseMatch | None = None


@dataclass(frozen=True)
class Doubt:
    """Why no pose was chosen, and between which targets a person could choose."""

    reason: str
    choices: tuple[Target, ...] = ()


def decide(
    evidence: Evidence, plan: CapturePlan, how: str = "auto", why_no_order: str = "",
    by_render: Callable[[tuple[str, str]], "Decision | Doubt"] | None = None,
) -> Decision | Doubt:  # fmt: skip
    """Choose the pose of one photograph.

    The board is believed first, then the name, then the order, then the nearest render. With `auto`, those that speak
    must not contradict each other: what is less believed may decide between two poses that are about equally near, and
    turns a photograph into a doubt where it names another pose than the board shows.

    Args:
        evidence: of the photograph.
        plan: holds the poses.
        how: `ImportSettings.match`; any but `auto` asks for that evidence alone.
        why_no_order: why `evidence.ordered` is missing, for the doubt's words.
        by_render: (object, variant) -> what the nearest render says; slow, and asked last.
    """
    ordered = evidence.ordered
    group = evidence.group or ((ordered.object, ordered.variant) if ordered else None)
    if group is None:
        missing = "nothing says which object and variant it shows"
        return Doubt(f"{missing}: {why_no_order}" if why_no_order else missing)
    claims = _collect_claims(evidence, how)
    match = match_pose(evidence.located.T_world_camera, plan.objects[group[0]]) if evidence.located else None
    if how == "render" or (how == "auto" and match is None and not claims and by_render):
        return by_render(group) if by_render else Doubt("matching by render needs the object's mesh")
    if how in ("name", "order") or match is None:
        return _decide_by_claims(group, claims, evidence, plan, how, why_no_order)
    return _decide_by_board(group, claims, match)


def is_followed(evidence: Sequence[Evidence], plan: CapturePlan) -> bool:
    """Whether photographs whose pose a board or a name says follow the order of shooting; yes where none says it."""
    agreements = []
    for one in evidence:
        if one.ordered is None:
            continue
        if one.located is not None:
            match = match_pose(one.located.T_world_camera, plan.objects[one.ordered.object])
            agreements.append(one.ordered.pose_id in _possible(match))
        elif one.named is not None:
            agreements.append(one.ordered.pose_id == one.named)
    return sum(agreements) >= FOLLOWED_SHARE * len(agreements)


def measure_match(evidence: Evidence, target: Target, plan: CapturePlan) -> PoseMatch | None:
    """How far the camera stood from the pose that was chosen; None without a board."""
    if evidence.located is None:
        return None
    poses = [pose for pose in plan.objects[target.object] if pose.id == target.pose_id]
    return match_pose(evidence.located.T_world_camera, poses)


def _collect_claims(evidence: Evidence, how: str) -> dict[str, int]:
    claims = {}
    if how in ("auto", "name") and evidence.named is not None:
        claims["name"] = evidence.named
    if how in ("auto", "order") and evidence.ordered is not None:
        claims["order"] = evidence.ordered.pose_id
    return claims


def _decide_by_claims(
    group: tuple[str, str], claims: dict[str, int], evidence: Evidence, plan, how: str, why: str
) -> Decision | Doubt:
    poses = sorted(set(claims.values()))
    if not poses:
        reasons = {
            "auto": f"{evidence.no_board}, its name says no pose" + (f", and {why}" if why else ""),
            "board": evidence.no_board,
            "name": "its name holds no pose of the plan: expected one such as pose_07",
            "order": why or "its place in the order is not known",
        }
        return Doubt(reasons[how])
    if len(poses) > 1:
        said = " and ".join(f"its {what} says pose {pose}" for what, pose in claims.items())
        return Doubt(said, tuple(Target(*group, pose) for pose in poses))
    target = Target(*group, poses[0])
    return Decision(target, next(iter(claims)), measure_match(evidence, target, plan))


def _decide_by_board(group: tuple[str, str], claims: dict[str, int], match: PoseMatch) -> Decision | Doubt:
    possible = _possible(match)
    choices = tuple(Target(*group, pose) for pose in dict.fromkeys((*possible, *claims.values())))
    against = [f"its {what} says pose {pose}" for what, pose in claims.items() if pose not in possible]
    if against:
        return Doubt(f"the board shows {match.describe()}, but {' and '.join(against)}", choices)
    claimed = set(claims.values())
    if len(claimed) > 1:
        return Doubt(f"the board shows {match.describe()}; name and order disagree", choices)
    chosen = next(iter(claimed)) if claimed else match.pose_id
    vouched = claimed and chosen == match.pose_id and match.error_deg <= FAR_AND_NAMED_DEG
    if (match.ambiguous and not claimed) or (match.far and not vouched):
        return Doubt(f"the board shows {match.describe()}", choices)
    return Decision(Target(*group, chosen), "board", match)


def _possible(match: PoseMatch) -> tuple[int, ...]:
    """The poses that a camera may have been meant for: the nearest, and the next where it is about as near."""
    if match.ambiguous and match.runner_up is not None:
        return match.pose_id, match.runner_up
    return (match.pose_id,)


def check_settings(workspace: Workspace, settings: ImportSettings) -> list[str]:
    """Check names; returns notes for the user.

    Raises:
        ToolkitError: an unknown object, or a variant that is a misspelling of a known one.
    """
    if settings.object is not None:
        workspace.object_spec(settings.object)
    variant = settings.variant
    if variant is None or variant in VARIANTS:
        return []
    if not FOLDER_NAME.fullmatch(variant):
        raise FieldError("expected a name of letters, digits, '-', '_' and '.'", {"variant": variant})
    known = [*VARIANTS, *workspace.patches(), *workspace.textures()]
    if variant not in known and get_close_matches(variant, known, n=1, cutoff=0.8):
        raise one_of("variant", variant, known)
    return [f"variant '{variant}' is none that the kit knows: nothing is recorded of what is on the object"]


def refuse_captures(workspace: Workspace, paths: list[Path]) -> None:
    """Check that no photograph would be imported from the captures themselves.

    Raises:
        ToolkitError: a path lies in the workspace's captures/, or holds it.
    """
    captures = workspace.captures_dir.resolve()
    for path in paths:
        real = Path(path).resolve()
        if real.is_relative_to(captures) or captures.is_relative_to(real):
            raise ToolkitError(
                f"{path} is, holds or lies in {captures}: name the folder that the camera's photos are in"
            )
