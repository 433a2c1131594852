"""Settle what is open after every photograph was looked at alone: doubts, two photographs of a pose, retakes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime

from toolkit.core.files import sha256_bytes, sha256_file
from toolkit.imaging.folder import show_path
from toolkit.photos.importing.decide import Decision, Doubt, decide, measure_match
from toolkit.photos.importing.evidence import Target
from toolkit.photos.importing.settings import ImportSettings
from toolkit.photos.importing.store import Ledger, encode_photo, find_occupants
from toolkit.photos.importing.study import Studied
from toolkit.rig.plan import CapturePlan

Ask = Callable[[str, Sequence[str]], "str | None"]
"""(question, answers that are possible) -> the answer, None for leaving the photograph out."""
ByRender = Callable[[Studied, tuple[str, str]], "Decision | Doubt"]
"""(photograph, its object and variant) -> what the nearest render says."""


@dataclass(frozen=True)
class Settled:
    """A photograph that is to be stored."""

    studied: Studied
    decision: Decision


def settle_photos(
    studied: Sequence[Studied], plan: CapturePlan, ledger: Ledger, settings: ImportSettings, ask: Ask | None = None,
    by_render: ByRender | None = None,
) -> tuple[list[Settled], list[tuple[str, str]]]:  # fmt: skip
    """Decide for all photographs; what stays open is asked, and refused where nobody answers.

    Args:
        studied: in the order in which they were taken.
        plan: holds the poses.
        ledger: what is there.
        settings: what was asked for.
        ask: puts a question to a person; None where there is none.
        by_render: what the nearest render says of a photograph.

    Returns:
        Photographs to store in that order, and (label, reason) of those that are refused.
    """
    settled: list[Settled] = []
    refused: list[tuple[str, str]] = []
    for one in studied:
        outcome = _decide_one(one, plan, settings, by_render)
        if isinstance(outcome, Doubt) and ask is not None and one.trouble is None:
            outcome = _ask_pose(one, outcome, plan, ask)
        if isinstance(outcome, Doubt):
            refused.append((one.candidate.label, outcome.reason))
        else:
            settled.append(Settled(one, outcome))
    if not settings.replace:
        settled = _settle_doubles(settled, refused, ask)
    return _settle_occupied(settled, refused, ledger, settings, ask), refused


def _decide_one(one: Studied, plan: CapturePlan, settings: ImportSettings, by_render) -> Decision | Doubt:
    if one.trouble is not None:
        return Doubt(one.trouble)
    if settings.pose is not None and settings.object and settings.variant:
        target = Target(settings.object, settings.variant, settings.pose)
        return Decision(target, "user", measure_match(one.evidence, target, plan))
    render = (lambda group: by_render(one, group)) if by_render else None
    return decide(one.evidence, plan, settings.match, one.why_no_order, render)


def _ask_pose(one: Studied, doubt: Doubt, plan: CapturePlan, ask: Ask) -> Decision | Doubt:
    ordered = one.evidence.ordered
    group = one.evidence.group or ((ordered.object, ordered.variant) if ordered else None)
    if group is None:
        return doubt
    poses = [str(pose.id) for pose in plan.objects[group[0]]]
    likely = [str(choice.pose_id) for choice in doubt.choices]
    hint = f"; likely {' or '.join(likely)}" if likely else ""
    answer = ask(f"{one.candidate.label}: {doubt.reason}. Which pose of {'/'.join(group)} is it{hint}?", poses)
    if answer is None:
        return doubt
    target = Target(*group, int(answer))
    return Decision(target, "user", measure_match(one.evidence, target, plan))


def _settle_doubles(settled: list[Settled], refused: list[tuple[str, str]], ask: Ask | None) -> list[Settled]:
    """Of several photographs of one pose keep the one that a person chooses, or none."""
    by_target: dict[Target, list[Settled]] = {}
    for one in settled:
        by_target.setdefault(one.decision.target, []).append(one)
    kept = {target: ones[0] for target, ones in by_target.items() if len(ones) == 1}
    for target, ones in by_target.items():
        if target in kept:
            continue
        labels = [one.studied.candidate.label for one in ones]
        listed = ", ".join(f"{i} {label}" for i, label in enumerate(labels, 1))
        numbers = [str(i) for i in range(1, len(ones) + 1)]
        answer = ask(f"{len(ones)} photographs show {target}: {listed}. Which one counts?", numbers) if ask else None
        for number, one in zip(numbers, ones, strict=True):
            if number == answer:
                kept[target] = one
                continue
            label = one.studied.candidate.label
            if answer:
                reason = f"{target}: {labels[int(answer) - 1]} was chosen"
            else:
                others = ", ".join(other for other in labels if other != label)
                reason = f"{target} is shown as well by {others}: take one away, or let the latest count (replace)"
            refused.append((label, reason))
    return [one for one in settled if kept.get(one.decision.target) is one]


def _settle_occupied(
    settled: list[Settled], refused: list[tuple[str, str]], ledger: Ledger, settings: ImportSettings, ask: Ask | None
) -> list[Settled]:
    """Photographs for poses that have an image replace it only when they are later, and when that was asked for."""
    kept = []
    for one in settled:
        candidate, target = one.studied.candidate, one.decision.target
        there = _find_other(one, ledger)
        if there is None:
            kept.append(one)
            continue
        path, record_taken, original = there
        came = f" (from {original})" if original else ""
        taken = candidate.photo.taken
        if taken and record_taken and _wall(taken) < _wall(record_taken):
            refused.append((candidate.label, f"{target} has the later photograph {path}{came}"))
        elif settings.replace or (
            ask and ask(f"{candidate.label}: {target} has {path}{came}. Replace it, and keep it aside?", ["y"]) == "y"
        ):
            kept.append(one)
        else:
            refused.append(
                (
                    candidate.label,
                    f"{target} has {path}{came}: a retake replaces it only where that is asked for (replace)",
                )
            )
    return kept


def _find_other(one: Settled, ledger: Ledger) -> tuple[str, datetime | None, str | None] | None:
    """Path, time and original name of another image that is there for the same pose."""
    for file in find_occupants(ledger, one.decision.target):
        path = show_path(file.relative_to(ledger.source_dir).parts)
        record = ledger.records.get(path)
        if record is None or record.image_sha256 != sha256_file(file):
            # a run that was killed between image and record left this photograph itself
            if sha256_file(file) == sha256_bytes(encode_photo(one.studied.candidate.photo)):
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
