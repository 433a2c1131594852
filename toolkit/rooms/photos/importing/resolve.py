"""Resolve doubts, several photographs of the same pose, and retakes, once every photograph was judged alone."""

from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from datetime import datetime

from toolkit.core.files import sha256_bytes, sha256_file
from toolkit.core.text import list_some
from toolkit.imaging.read import show_path
from toolkit.rig.plan import CapturePlan
from toolkit.rooms.photos.config import ImportSettings
from toolkit.rooms.photos.importing.evidence import Evidence
from toolkit.rooms.photos.importing.gather import CaptureKey, SourceIndex, find_images
from toolkit.rooms.photos.importing.match import Decision, Doubt, MatchRender, decide_pose, measure_match
from toolkit.rooms.photos.importing.store import encode_photo
from toolkit.rooms.photos.photo import Photo, align_times

Ask = Callable[[str, Sequence[str]], "str | None"]
"""(question, possible answers) -> the answer, None to leave the photograph out."""
Resolved = tuple[Evidence, Decision]
"""A photograph that is to be stored."""
MOST_LISTED = 10
"""Other photographs of a pose that a line names."""


def resolve_photos(
    evidence: Sequence[Evidence], plan: CapturePlan, index: SourceIndex, settings: ImportSettings,
    ask: Ask | None = None, by_render: MatchRender | None = None,
) -> tuple[list[Resolved], list[tuple[str, str]]]:  # fmt: skip
    """Decide for all photographs; doubts are asked about, and refused without an answer.

    Returns:
        Photographs to store in that order, and (label, reason) of refused photographs.
    """
    resolved: list[Resolved] = []
    refused: list[tuple[str, str]] = []
    for item in evidence:
        outcome: Decision | Doubt
        if item.unusable is not None:
            outcome = Doubt(item.unusable)
        # the user's own word settles everything
        elif settings.pose is not None and settings.object and settings.variant:
            key = CaptureKey(settings.object, settings.variant, settings.pose)
            outcome = Decision(key, "user", measure_match(item, key, plan))
        else:
            outcome = decide_pose(item, plan, settings.match, by_render)
        # a person may settle a doubt; a photograph that cannot be used is no doubt
        if isinstance(outcome, Doubt) and ask is not None and item.unusable is None:
            outcome = _ask_pose(item, outcome, plan, ask)
        if isinstance(outcome, Doubt):
            refused.append((item.candidate.label, outcome.reason))
        else:
            resolved.append((item, outcome))
    # with "replace" the latest counts, so two photographs of a pose need no question
    if not settings.replace:
        resolved = _resolve_doubles(resolved, refused, ask)
    return resolve_occupied(resolved, refused, index, settings, ask), refused


def _ask_pose(item: Evidence, doubt: Doubt, plan: CapturePlan, ask: Ask) -> Decision | Doubt:
    group, why = item.find_group(), f"{item.candidate.label}: {doubt.reason}"
    if group is not None:
        likely = " or ".join(str(choice.pose_id) for choice in doubt.choices)
        question = f"{why}. Which pose of {'/'.join(group)} is it{f'; likely {likely}' if likely else ''}?"
        keys = {str(pose.id): CaptureKey(*group, pose.id) for pose in plan.objects[group[0]]}
    else:
        keys = {str(number): choice for number, choice in enumerate(doubt.choices, 1)}
        question = f"{why}. Which is it: {', '.join(f'{number} {choice}' for number, choice in keys.items())}?"
    answer = ask(question, list(keys)) if keys else None
    if answer is None:
        return doubt
    return Decision(keys[answer], "user", measure_match(item, keys[answer], plan))


def _resolve_doubles(resolved: list[Resolved], refused: list[tuple[str, str]], ask: Ask | None) -> list[Resolved]:
    """Keep the photograph that a person chooses among several of the same pose, or none."""
    # a pose with a single photograph needs no choice
    by_key: dict[CaptureKey, list[Evidence]] = {}
    for item, decision in resolved:
        by_key.setdefault(decision.key, []).append(item)
    kept = {key: rivals[0] for key, rivals in by_key.items() if len(rivals) == 1}
    for key, rivals in by_key.items():
        if key in kept:
            continue
        labels = [rival.candidate.label for rival in rivals]
        listed = ", ".join(f"{i} {label}" for i, label in enumerate(labels, 1))
        numbers = [str(i) for i in range(1, len(rivals) + 1)]
        answer = ask(f"{len(rivals)} photographs show {key}: {listed}. Which counts?", numbers) if ask else None
        for number, item in zip(numbers, rivals, strict=True):
            if number == answer:
                kept[key] = item
                continue
            label = item.candidate.label
            if answer:
                reason = f"{key}: {labels[int(answer) - 1]} was chosen"
            else:
                others = list_some([other for other in labels if other != label], MOST_LISTED)
                reason = f"{key} is shown as well by {others}: remove a photograph, or let the latest count (replace)"
            refused.append((label, reason))
    return [(item, decision) for item, decision in resolved if kept.get(decision.key) is item]


def resolve_occupied(
    resolved: list[Resolved], refused: list[tuple[str, str]], index: SourceIndex, settings: ImportSettings,
    ask: Ask | None, leaving: Collection[str] = (),
) -> list[Resolved]:  # fmt: skip
    """Let photographs replace the image of their pose only if they are later, and if the user wants it.

    Images whose paths are among `leaving` are in nobody's way.
    """
    kept = []
    for item, decision in resolved:
        candidate, key = item.candidate, decision.key
        there = _find_other(candidate.photo, key, index, leaving)
        if there is None:
            kept.append((item, decision))
            continue
        # a later image stays; an earlier image gives way on request
        path, record_taken, original = there
        came = f" (from {original})" if original else ""
        taken = candidate.photo.taken
        own, other = align_times([taken, record_taken]) if taken and record_taken else (None, None)
        if own and other and own < other:
            refused.append((candidate.label, f"{key} has the later photograph {path}{came}"))
        elif settings.replace or (
            ask and ask(f"{candidate.label}: {key} has {path}{came}. Replace it, and keep it aside?", ["y"]) == "y"
        ):
            kept.append((item, decision))
        else:
            refused.append((candidate.label, f"{key} has {path}{came}: a retake replaces it only on request (replace)"))
    return kept


def _find_other(
    photo: Photo, key: CaptureKey, index: SourceIndex, leaving: Collection[str]
) -> tuple[str, datetime | None, str | None] | None:
    """Return path, time and original name of another image for the same pose."""
    for file in find_images(index, key):
        path = show_path(file.relative_to(index.source_dir).parts)
        if path in leaving:
            continue
        record = index.records.get(path)
        # put there by hand, or changed since
        if record is None or record.image_sha256 != sha256_file(file):
            # a run that was killed between image and record left this very photograph without a line
            if sha256_file(file) == sha256_bytes(encode_photo(photo)):
                continue
            return path, None, None
        # an older record may have no time
        taken = None
        with suppress(ValueError, TypeError):
            taken = datetime.fromisoformat(record.made.get("taken", ""))
        return path, taken, record.made.get("original_name")
    return None
