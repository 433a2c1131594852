"""Collect what speaks for the pose of each photograph: group, order, name, board."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from toolkit.core.console import progress
from toolkit.core.errors import FieldError
from toolkit.imaging.read import UnreadableImage
from toolkit.photos.importing.decide import is_followed
from toolkit.photos.importing.evidence import (
    Evidence,
    Locate,
    Target,
    believe_names,
    find_group,
    group_by,
    order_group,
    order_session,
)
from toolkit.photos.importing.gather import Candidate
from toolkit.photos.importing.settings import ImportSettings
from toolkit.photos.importing.store import Ledger, describe_before
from toolkit.photos.photo import load_pixels
from toolkit.rig.plan import CapturePlan
from toolkit.rig.shot_order import ShotStep
from toolkit.rig.variants import VARIANTS

NOT_FOLLOWED = "the boards or names of the photographs show that they were not taken in this order"


@dataclass(frozen=True)
class Studied:
    """One photograph that was not imported before, and what speaks for its pose.

    Attributes:
        candidate: it.
        evidence: what is known.
        why_no_order: why the order says nothing of it.
        trouble: why it cannot be imported at all.
    """

    candidate: Candidate
    evidence: Evidence = field(default_factory=Evidence)
    why_no_order: str = ""
    trouble: str | None = None


def study_photos(
    candidates: Sequence[Candidate], plan: CapturePlan, steps: Sequence[ShotStep], ledger: Ledger,
    settings: ImportSettings, locate: Locate, quiet: bool = False,
) -> list[Studied]:  # fmt: skip
    """Everything but the decision, for the photographs that were not imported before.

    Those that were still count for the order: it is of all that were taken.

    Args:
        candidates: in the order in which they were taken.
        plan: holds the poses.
        steps: the shot list, empty where there is none.
        ledger: what was imported before.
        settings: what was asked for.
        locate: finds the camera by the board.
        quiet: no progress bar.

    Raises:
        ToolkitError: nothing says which object and variant the photographs show.
    """
    groups, troubles = _group_all(candidates, plan, steps, ledger, settings)
    ungrouped = [i for i in range(len(candidates)) if i not in groups and i not in troubles]
    ungrouped = [i for i in ungrouped if candidates[i].photo.identity not in ledger.replaced]
    new = [i for i, one in enumerate(candidates) if describe_before(ledger, one.photo) is None]
    if not steps and new and not groups and not troubles:
        raise FieldError(
            "nothing says what the photographs show: give {object} and {variant}, sort them into folders "
            "OBJECT/VARIANT, or write a shot list with 'toolkit plan --shot-list' and follow it",
            {},
        )
    ordered, why, named = _order_all(candidates, groups, ungrouped, plan, steps, settings)
    studied = {i: Studied(candidates[i], trouble=troubles.get(i)) for i in new}
    waiting = [i for i in new if i not in troubles]
    with progress("finding the board", len(waiting), quiet) as bar:
        for i in waiting:
            one = candidates[i]
            evidence = Evidence(groups.get(i), named.get(i), ordered.get(i))
            try:
                found = locate(one.photo, load_pixels(one.photo))
                if isinstance(found, str):
                    evidence = replace(evidence, no_board=found)
                else:
                    evidence = replace(evidence, located=found)
                studied[i] = Studied(one, evidence, why.get(i, ""))
            except UnreadableImage as error:
                studied[i] = Studied(one, evidence, trouble=error.reason)
            bar.advance(note=one.label)
    if settings.match == "auto":
        _doubt_order([*group_by(candidates, groups).values(), ungrouped], studied, plan)
    return [studied[i] for i in new]


def _group_all(candidates, plan, steps, ledger: Ledger, settings) -> tuple[dict[int, tuple[str, str]], dict[int, str]]:
    """Groups by index, and why a photograph cannot be imported, by index."""
    variants = {*VARIANTS, *(step.variant for step in steps), *([settings.variant] if settings.variant else [])}
    groups: dict[int, tuple[str, str]] = {}
    troubles: dict[int, str] = {}
    for i, one in enumerate(candidates):
        if one.photo.identity in ledger.replaced:
            continue
        record = ledger.current.get(one.photo.identity)
        found = find_group(one, plan.objects, variants, (settings.object, settings.variant))
        if record is not None:
            # what lies elsewhere is no part of this group's order
            if found is None or found == (record.object, record.variant):
                groups |= {i: found} if isinstance(found, tuple) else {}
        elif isinstance(found, str):
            troubles[i] = found
        elif found is not None:
            groups[i] = found
    return groups, troubles


def _order_all(candidates, groups, ungrouped: list[int], plan, steps, settings: ImportSettings):
    """By index: the target that the order says, why it says none, and the pose in the name."""
    ordered: dict[int, Target] = {}
    why: dict[int, str] = {}
    named: dict[int, int | None] = {}

    def take(indices: list[int], found: list[Target] | str) -> None:
        if isinstance(found, str):
            why.update(dict.fromkeys(indices, found))
        else:
            ordered.update(zip(indices, found, strict=True))

    for group, indices in group_by(candidates, groups).items():
        members = [candidates[i] for i in indices]
        pose_ids = {pose.id for pose in plan.objects[group[0]]}
        named.update(zip(indices, believe_names(members, pose_ids, settings.match == "name"), strict=True))
        take(indices, order_group(len(indices), group, plan, steps))
    if ungrouped and steps:
        take(ungrouped, order_session(len(ungrouped), steps, settings.first_shot))
    elif ungrouped:
        why.update(dict.fromkeys(ungrouped, "there is no shot list: say object and variant"))
    return ordered, why, named


def _doubt_order(parts: list[list[int]], studied: dict[int, Studied], plan: CapturePlan) -> None:
    """Take the order's word away where boards and names show that the photographs do not follow it."""
    for part in parts:
        known = [i for i in part if i in studied]
        if not is_followed([studied[i].evidence for i in known], plan):
            for i in known:
                evidence = replace(studied[i].evidence, ordered=None)
                studied[i] = replace(studied[i], evidence=evidence, why_no_order=NOT_FOLLOWED)
