"""Evidence of a photograph's object, variant and pose: folder and file name, order of shooting, board."""

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from toolkit.captures.read import read_pose_id
from toolkit.core.console import Ticker, progress
from toolkit.core.errors import FieldError
from toolkit.imaging.read import UnreadableImage
from toolkit.rig.plan import CapturePlan
from toolkit.rig.variants import VARIANTS
from toolkit.rooms.photos.config import ImportSettings
from toolkit.rooms.photos.importing.gather import Candidate, CaptureKey, SourceIndex, describe_imported
from toolkit.rooms.photos.locate import Locate, PoseMatch, match_pose
from toolkit.rooms.photos.match_render import LEAST_SCORE, RenderMatch
from toolkit.rooms.photos.photo import load_pixels
from toolkit.rooms.photos.posed_camera import PosedCamera
from toolkit.rooms.photos.shot_order import ShotStep

FOLLOWED_SHARE = 0.75
"""Share of the photographs with a board or a pose's name that must agree with the order."""
NOT_FOLLOWED = "by their boards, names or likeness to renders, the photographs were not taken in this order"
EXCHANGED = 0.1
"""Gain in likeness from which photographs count as exchanged. 144 rehearsed shots of the built-in objects had no false
alarm. Of exchanged neighbours, 101 of 102 pairs were found, but 24 of 34 of the eggnog, whose sides are alike."""
Group = tuple[str, str]
"""Object and variant."""


@dataclass(frozen=True)
class Evidence:
    """A photograph, and the evidence for its pose.

    Attributes:
        group: object and variant, from the settings or from folder and file names.
        named: the pose in the file's name, if names are to be believed here.
        ordered: the shot at its place in the order of shooting, or `no_order` says why not.
        located: the camera by the board, or `no_board` says why not.
        between: shots that it may be, if the order has gaps.
        is_compared: whether the ordered pose was compared with renders.
        looks: the pose that it looks like, if that is not the ordered pose.
        unusable: why it cannot be imported at all.
    """

    candidate: Candidate
    group: Group | None = None
    named: int | None = None
    ordered: CaptureKey | None = None
    located: PosedCamera | None = None
    between: tuple[CaptureKey, ...] = ()
    is_compared: bool = False
    looks: int | None = None
    no_board: str = "no board is seen"
    no_order: str = ""
    unusable: str | None = None

    def find_group(self) -> Group | None:
        """Object and variant by settings and names, else by the order."""
        return self.group or ((self.ordered.object, self.ordered.variant) if self.ordered else None)


Rank = Callable[[Evidence, Group], "RenderMatch | str"]
"""(photograph, its object and variant) -> how much it looks like each pose, or why no render can be made."""


def collect_evidence(
    candidates: Sequence[Candidate], plan: CapturePlan, steps: Sequence[ShotStep], index: SourceIndex,
    settings: ImportSettings, locate: Locate, rank: Rank,
) -> list[Evidence]:  # fmt: skip
    """Collect the evidence of new photographs; `candidates` are all, in the order in which they were taken.

    Raises:
        ToolkitError: nothing names the object and variant that the photographs show.
    """
    # object and variant by settings, folders and names; the shot list places the others
    every = _find_groups(candidates, plan, steps, index, settings)
    # photographs of which nothing names object and variant
    ungrouped = [i for i, item in enumerate(every) if item.group is None and item.unusable is None]
    ungrouped = [i for i in ungrouped if candidates[i].photo.identity not in index.replaced]
    new = [i for i, candidate in enumerate(candidates) if describe_imported(index, candidate.photo) is None]
    if not steps and new and not any(item.group or item.unusable for item in every):
        raise FieldError(
            "nothing says what the photographs show: give {object} and {variant}, sort them into folders "
            "OBJECT/VARIANT, or write a shot list with 'toolkit plan --shot-list' and follow it", {},
        )  # fmt: skip
    # the order is judged group by group
    groups: dict[Group, list[int]] = {}
    for i, item in enumerate(every):
        if item.group is not None:
            groups.setdefault(item.group, []).append(i)
    _match_orders(every, groups, ungrouped, plan, steps, settings=settings)
    # cameras by the board
    waiting = [i for i in new if every[i].unusable is None]
    with progress("finding the board", len(waiting)) as bar:
        for i in waiting:
            photo = candidates[i].photo
            try:
                found = locate(photo, load_pixels(photo))
                every[i] = replace(every[i], **({"no_board": found} if isinstance(found, str) else {"located": found}))
            except UnreadableImage as error:
                every[i] = replace(every[i], unusable=error.reason)
            bar.advance(note=candidates[i].label)
    if settings.match in ("auto", "order"):
        compare_with_renders(every, waiting, rank)
    if settings.match == "auto":
        # if names and boards contradict the order, it does not hold for photographs without either
        for part in (*groups.values(), ungrouped):
            known = [i for i in part if i in set(new)]
            if not is_followed([every[i] for i in known], plan):
                for i in known:
                    every[i] = replace(every[i], ordered=None, no_order=NOT_FOLLOWED)
    return [every[i] for i in new]


def _find_groups(
    candidates: Sequence[Candidate], plan: CapturePlan, steps: Sequence[ShotStep], index: SourceIndex,
    settings: ImportSettings,
) -> list[Evidence]:  # fmt: skip
    """Return the photographs with their groups, or why they cannot be imported."""
    variants = {*VARIANTS, *(step.variant for step in steps), *([settings.variant] if settings.variant else [])}
    every = []
    for candidate in candidates:
        group, unusable = None, None
        # photographs that gave way to others are not taken again
        if candidate.photo.identity not in index.replaced:
            record = index.current.get(candidate.photo.identity)
            found = find_group(candidate, plan.objects, variants, (settings.object, settings.variant))
            # a photograph that was imported elsewhere is no part of this group's order
            if isinstance(found, tuple) and (record is None or found == (record.object, record.variant)):
                group = found
            elif isinstance(found, str) and record is None:
                unusable = found
        every.append(Evidence(candidate, group, unusable=unusable))
    return every


def _match_orders(
    every: list[Evidence], groups: Mapping[Group, list[int]], ungrouped: list[int], plan: CapturePlan,
    steps: Sequence[ShotStep], settings: ImportSettings,
) -> None:  # fmt: skip
    """Add to each photograph the evidence of the order of shooting and of its file name."""

    # an order is a shot for each photograph, or why there is none
    def take(indices: list[int], found: list[CaptureKey] | str) -> None:
        for at, i in enumerate(indices):
            says = {"no_order": found} if isinstance(found, str) else {"ordered": found[at]}
            every[i] = replace(every[i], **says)

    # of a group, object and variant are known: only the pose is open
    for group, indices in groups.items():
        pose_ids = {pose.id for pose in plan.objects[group[0]]}
        named = read_named_poses([every[i].candidate for i in indices], pose_ids, settings.match == "name")
        for i, pose_id in zip(indices, named, strict=True):
            every[i] = replace(every[i], named=pose_id)
        take(indices, match_group_order(len(indices), group, plan, steps))
    # without a group, the shot list gives object and variant as well
    if ungrouped and steps:
        take(ungrouped, match_session_order(len(ungrouped), steps, settings.first_shot))
    elif ungrouped:
        take(ungrouped, "there is no shot list: say object and variant")


def is_followed(evidence: Sequence[Evidence], plan: CapturePlan) -> bool:
    """Whether photographs follow the order of shooting, by boards, names and renders; True without any of these."""
    # the surest evidence of each photograph: board, name, likeness
    agreements = []
    for item in evidence:
        if item.ordered is None:
            continue
        if item.located is not None:
            match = match_pose(item.located.T_world_camera, plan.objects[item.ordered.object])
            agreements.append(item.ordered.pose_id in possible_poses(match))
        elif item.named is not None:
            agreements.append(item.ordered.pose_id == item.named)
        elif item.is_compared:
            agreements.append(item.looks is None)
    return sum(agreements) >= FOLLOWED_SHARE * len(agreements)


def compare_with_renders(every: list[Evidence], chosen: Sequence[int], rank: Rank) -> None:
    """Check poses that rest on the order alone: add the pose that each photograph looks like, if it differs.

    The photographs of an object's variant are assigned to its ordered poses by their likeness to renders. They look
    like other poses if that exchanges photographs and gains `EXCHANGED` or more.
    """
    # only poses that rest on the order alone are compared
    groups: dict[Group, list[int]] = {}
    for i in chosen:
        item = every[i]
        if item.ordered is not None and item.located is None and item.named is None and item.unusable is None:
            groups.setdefault((item.ordered.object, item.ordered.variant), []).append(i)
    with progress("comparing with renders", sum(map(len, groups.values()))) as bar:
        for group, members in groups.items():
            # likeness of each photograph to each ordered pose; unlike photographs do not count
            found = {i: _rank_poses(every[i], group, rank, bar) for i in members}
            seen = [i for i in members if found[i] and max(found[i].values()) >= LEAST_SCORE]
            poses = [item.ordered.pose_id for i in seen if (item := every[i]).ordered is not None]
            scores = np.array([[found[i][pose] for pose in poses] for i in seen]).reshape(len(seen), len(seen))
            for i, other in zip(seen, find_exchanged(scores), strict=True):
                every[i] = replace(every[i], is_compared=True, looks=None if other is None else poses[other])


def _rank_poses(item: Evidence, group: Group, rank: Rank, bar: Ticker) -> dict[int, float]:
    """Likeness to the render of each pose; empty if there is none."""
    bar.advance(note=item.candidate.label)
    with suppress(UnreadableImage):  # storing it reports the fault
        ranked = rank(item, group)
        return {} if isinstance(ranked, str) else dict(ranked.ranking)
    return {}


def find_exchanged(scores: np.ndarray) -> list[int | None]:
    """Return for each of n photographs the place whose render it looks like, None for its own.

    `scores` (n, n) are the likeness of photograph i to the render at the place of photograph j.
    """
    from scipy.optimize import linear_sum_assignment

    n = len(scores)
    found: list[int | None] = [None] * n
    if n == 0:
        return found
    # the assignment of photographs to places with the largest sum of likenesses
    best = linear_sum_assignment(scores, maximize=True)[1]
    for start in range(n):
        # a permutation is cycles: photographs that changed places among themselves
        cycle = [start]
        while best[cycle[-1]] != start:
            cycle.append(int(best[cycle[-1]]))
        gain = sum(scores[i, best[i]] - scores[i, i] for i in cycle)
        if gain >= EXCHANGED:
            found[start] = int(best[start])
    return found


def possible_poses(match: PoseMatch) -> tuple[int, ...]:
    """Return the poses that a camera may have been meant for: the nearest, and the next if it is about as near."""
    if match.ambiguous and match.runner_up is not None:
        return match.pose_id, match.runner_up
    return (match.pose_id,)


def find_group(
    candidate: Candidate, objects: Collection[str], variants: Collection[str], forced: tuple[str | None, str | None]
) -> Group | str | None:  # fmt: skip
    """Return object and variant of a photograph, by its folders and name, as racer/patched/IMG_1.jpg, and the settings.

    Args:
        candidate: the photograph.
        objects, variants: known names.
        forced: object and variant from the settings, or None.

    Returns:
        (object, variant); None if either is unknown; a sentence if the settings and the names disagree.
    """
    # folders, then the words of the file's name
    words = [*candidate.folders, *re.split(r"[\s_.]+", candidate.photo.path.stem)]
    group = []
    for kind, known, said in (("object", objects, forced[0]), ("variant", variants, forced[1])):
        # the innermost folder, or the file's own name, comes first
        named = next((word for word in reversed(words) if word in known), None)
        if said and named and named != said:
            return f"its name or folder names the {kind} '{named}', the command '{said}'"
        group.append(said or named)
    return (group[0], group[1]) if group[0] and group[1] else None


def read_named_poses(candidates: Sequence[Candidate], pose_ids: Collection[int], always: bool) -> list[int | None]:
    """Return the pose in each name, if names are to be believed.

    A camera's own counter (IMG_0007) tells nothing about poses. A number counts after the word `pose`; otherwise only
    if the numbers of all names are the plan's poses, each once. `always` believes every number that is a pose.
    """
    photos = [candidate.photo for candidate in candidates]
    numbers = [read_pose_id(photo.path.name) if photo.frame is None else None for photo in photos]
    whole = Counter(numbers) == Counter(pose_ids)
    believed: list[int | None] = []
    for photo, number in zip(photos, numbers, strict=True):
        said = always or whole or re.search(r"pose[\s_-]*\d", photo.path.stem, re.IGNORECASE) is not None
        believed.append(number if said and number in pose_ids else None)
    return believed


def match_group_order(
    count: int, group: Group, plan: CapturePlan, steps: Sequence[ShotStep]
) -> list[CaptureKey] | str:  # fmt: skip
    """Return the shots of `count` photographs of an object and variant by the shot list, else by the plan.

    The result is a key per photograph, or why the order does not tell.
    """
    pose_ids = [step.pose_id for step in steps if (step.object, step.variant) == group]
    source = "the shot list" if pose_ids else "the plan"
    pose_ids = pose_ids or [pose.id for pose in plan.objects[group[0]]]
    if count != len(pose_ids):
        return f"{count} photographs for the {len(pose_ids)} poses of {source}, so their order says nothing"
    return [CaptureKey(*group, pose_id) for pose_id in pose_ids]


def match_session_order(count: int, steps: Sequence[ShotStep], first: int | None) -> list[CaptureKey] | str:
    """Return the shots of `count` photographs without a group by the shot list, as `match_group_order`.

    `first` is the number of the first photograph's shot, if the list was shot in parts.
    """
    # a count that differs may mean any gap: nothing is guessed
    if first is None and count != len(steps):
        return (
            f"{count} photographs for the {len(steps)} shots of rig/shots.json; for a part of the list, give its first "
            "shot with --first-shot, or say what they show with --object and --variant"
        )
    part = steps[(first or 1) - 1 :][:count]
    if len(part) < count:
        return f"{count} photographs from shot {first} on, the list has {len(steps)} shots"
    return [CaptureKey(step.object, step.variant, step.pose_id) for step in part]
