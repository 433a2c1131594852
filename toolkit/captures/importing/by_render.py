"""What the nearest render says of a photograph that has no board, no telling name and no place in an order."""

from toolkit.captures.importing.decide import Decision, Doubt
from toolkit.captures.importing.evidence import Target
from toolkit.captures.importing.settle import ByRender
from toolkit.captures.importing.study import Studied
from toolkit.captures.photos.photo import load_pixels
from toolkit.captures.variants import VARIANTS, dress, find_booster
from toolkit.errors import ToolkitError
from toolkit.images import UnreadableImage
from toolkit.objects.load import load_object
from toolkit.rig.plan import CapturePlan
from toolkit.workspace import Workspace


def rank_by_render(workspace: Workspace, plan: CapturePlan) -> ByRender:
    """A function that compares a photograph with renders of its object, which are made once per object and variant."""
    from toolkit.captures.camera.match_render import PoseTemplates, make_templates, match_by_render

    made: dict[tuple[str, str], PoseTemplates | str] = {}

    def rank(studied: Studied, group: tuple[str, str]) -> Decision | Doubt:
        if group not in made:
            try:
                made[group] = make_templates(_dressed(workspace, *group), plan.camera.camera(), plan.objects[group[0]])
            except ToolkitError as error:
                made[group] = str(error)
        templates = made[group]
        why = studied.evidence.no_board
        if isinstance(templates, str):
            return Doubt(f"{why}, and no render can be made: {templates}")
        try:
            match = match_by_render(load_pixels(studied.candidate.photo), templates)
        except UnreadableImage as error:
            return Doubt(error.reason)
        best = Target(*group, match.pose_id)
        if not match.ambiguous:
            return Decision(best, "render")
        if match.runner_up is None:
            return Doubt(f"{why}, and it does not look like the render of its pose", (best,))
        reason = (
            f"{why}, and it looks about as much like the render of pose {match.pose_id} ({match.score:.2f}) as of "
            f"pose {match.runner_up} ({match.ranking[1][1]:.2f})"
        )
        return Doubt(reason, (best, Target(*group, match.runner_up)))

    return rank


def _dressed(workspace: Workspace, name: str, variant: str):
    item = load_object(workspace.object_spec(name))
    booster = find_booster(workspace, item, variant) if variant in VARIANTS else None
    return dress(item, booster)
