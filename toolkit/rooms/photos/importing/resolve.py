"""What is open once every photograph was looked at alone: doubts, two of a pose, retakes."""

from collections.abc import Callable, Collection, Sequence
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
from toolkit.rooms.photos.photo import Photo

Ask = Callable[[str, Sequence[str]], "str | None"]
"""(question, answers that are possible) -> the answer, None for leaving the photograph out."""
Resolved = tuple[Evidence, Decision]
"""A photograph that is to be stored."""
MOST_LISTED = 10
"""Other photographs of a pose that a line names."""


def resolve_photos(
    evidence: Sequence[Evidence], plan: CapturePlan, index: SourceIndex, settings: ImportSettings,
    ask: Ask | None = None, by_render: MatchRender | None = None,
) -> tuple[list[Resolved], list[tuple[str, str]]]:  # fmt: skip
    """Decide for all photographs; what stays open is asked, and refused where nobody answers.

    Returns:
        Photographs to store in that order, and (label, reason) of those that are refused.
    """
    resolved: list[Resolved] = []
    refused: list[tuple[str, str]] = []
    for item in evidence:
        outcome = _decide_one(item, plan, settings, by_render)
        if isinstance(outcome, Doubt) and ask is not None and item.unusable is None:
            outcome = _ask_pose(item, outcome, plan, ask)
        if isinstance(outcome, Doubt):
            refused.append((item.candidate.label, outcome.reason))
        else:
            resolved.append((item, outcome))
    # "replace" says that the latest counts, so two photographs of a pose need no question
    if not settings.replace:
        resolved = _resolve_doubles(resolved, refused, ask)
    return resolve_occupied(resolved, refused, index, settings, ask), refused


def _decide_one(
    item: Evidence, plan: CapturePlan, settings: ImportSettings, by_render: MatchRender | None
) -> Decision | Doubt:
    if item.unusable is not None:
        return Doubt(item.unusable)
    if settings.pose is not None and settings.object and settings.variant:
        key = CaptureKey(settings.object, settings.variant, settings.pose)
        return Decision(key, "user", measure_match(item, key, plan))
    return decide_pose(item, plan, settings.match, by_render)


def _ask_pose(item: Evidence, doubt: Doubt, plan: CapturePlan, ask: Ask) -> Decision | Doubt:
    group = item.find_group()
    if group is None and doubt.choices:
        listed = ", ".join(f"{number} {choice}" for number, choice in enumerate(doubt.choices, 1))
        numbers = [str(number) for number in range(1, len(doubt.choices) + 1)]
        answer = ask(f"{item.candidate.label}: {doubt.reason}. Which is it: {listed}?", numbers)
        if answer is None:
            return doubt
        key = doubt.choices[int(answer) - 1]
        return Decision(key, "user", measure_match(item, key, plan))
    if group is None:
        return doubt
    poses = [str(pose.id) for pose in plan.objects[group[0]]]
    likely = [str(choice.pose_id) for choice in doubt.choices]
    hint = f"; likely {' or '.join(likely)}" if likely else ""
    answer = ask(f"{item.candidate.label}: {doubt.reason}. Which pose of {'/'.join(group)} is it{hint}?", poses)
    if answer is None:
        return doubt
    key = CaptureKey(*group, int(answer))
    return Decision(key, "user", measure_match(item, key, plan))


def _resolve_doubles(resolved: list[Resolved], refused: list[tuple[str, str]], ask: Ask | None) -> list[Resolved]:
    """Keep the photograph that a person chooses among several of the same pose, or none of them."""
    by_key: dict[CaptureKey, list[Evidence]] = {}
    for item, decision in resolved:
        by_key.setdefault(decision.key, []).append(item)
    kept = {key: ones[0] for key, ones in by_key.items() if len(ones) == 1}
    for key, ones in by_key.items():
        if key in kept:
            continue
        labels = [rival.candidate.label for rival in ones]
        listed = ", ".join(f"{i} {label}" for i, label in enumerate(labels, 1))
        numbers = [str(i) for i in range(1, len(ones) + 1)]
        answer = ask(f"{len(ones)} photographs show {key}: {listed}. Which one counts?", numbers) if ask else None
        for number, item in zip(numbers, ones, strict=True):
            if number == answer:
                kept[key] = item
                continue
            label = item.candidate.label
            if answer:
                reason = f"{key}: {labels[int(answer) - 1]} was chosen"
            else:
                others = list_some([other for other in labels if other != label], MOST_LISTED)
                reason = f"{key} is shown as well by {others}: take one away, or let the latest count (replace)"
            refused.append((label, reason))
    return [(item, decision) for item, decision in resolved if kept.get(decision.key) is item]


def resolve_occupied(
    resolved: list[Resolved], refused: list[tuple[str, str]], index: SourceIndex, settings: ImportSettings,
    ask: Ask | None, leaving: Collection[str] = (),
) -> list[Resolved]:  # fmt: skip
    """Photographs for poses that have an image replace it only when they are later, and when that was asked for.

    Images whose paths are among those `leaving` are in nobody's way.
    """
    kept = []
    for item, decision in resolved:
        candidate, key = item.candidate, decision.key
        there = _find_other(candidate.photo, key, index, leaving)
        if there is None:
            kept.append((item, decision))
            continue
        path, record_taken, original = there
        came = f" (from {original})" if original else ""
        taken = candidate.photo.taken
        # wall clocks, since either may have no zone
        if taken and record_taken and _wall(taken) < _wall(record_taken):
            refused.append((candidate.label, f"{key} has the later photograph {path}{came}"))
        elif settings.replace or (
            ask and ask(f"{candidate.label}: {key} has {path}{came}. Replace it, and keep it aside?", ["y"]) == "y"
        ):
            kept.append((item, decision))
        else:
            asked = "a retake replaces it only where that is asked for (replace)"
            refused.append((candidate.label, f"{key} has {path}{came}: {asked}"))
    return kept


def _find_other(
    photo: Photo, key: CaptureKey, index: SourceIndex, leaving: Collection[str]
) -> tuple[str, datetime | None, str | None] | None:
    """Path, time and original name of another image that is there for the same pose."""
    for file in find_images(index, key):
        path = show_path(file.relative_to(index.source_dir).parts)
        if path in leaving:
            continue
        record = index.records.get(path)
        if record is None or record.image_sha256 != sha256_file(file):
            # a run that was killed between image and record left this photograph itself
            # bytes are compared, not names: the image is there and its line is not
            if sha256_file(file) == sha256_bytes(encode_photo(photo)):
                continue
            return path, None, None
        return path, _read_time(record.made.get("taken")), record.made.get("original_name")
    return None


def _read_time(text: object) -> datetime | None:
    try:
        return datetime.fromisoformat(text) if isinstance(text, str) else None
    except ValueError:
        return None


def _wall(taken: datetime) -> datetime:
    return taken.replace(tzinfo=None)
