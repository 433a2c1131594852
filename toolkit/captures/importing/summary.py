"""What a capture folder holds after an import: per object and variant, and what should be taken again."""

from collections.abc import Sequence
from dataclasses import dataclass

from toolkit.captures.importing.ledger import Ledger, list_poses
from toolkit.captures.manifest import CaptureRecord
from toolkit.captures.variants import PAIR
from toolkit.rig.plan import CapturePlan


@dataclass(frozen=True)
class Coverage:
    """What there is of one object in one variant.

    Attributes:
        object, variant: which.
        imported: photographs that came now.
        there: poses that have an image.
        missing: poses of the plan that have none.
        mean_error_deg, mean_error_mm: of the cameras that a board located, against their poses; None without.
    """

    object: str
    variant: str
    imported: int
    there: int
    missing: tuple[int, ...]
    mean_error_deg: float | None
    mean_error_mm: float | None


def measure_coverage(
    ledger: Ledger, whole: Sequence[CaptureRecord], plan: CapturePlan, imported: Sequence[CaptureRecord],
    name: str | None = None,
) -> tuple[Coverage, ...]:  # fmt: skip
    """Count poses of each object that has images in the source, in each variant that it has and in the pair.

    Args:
        ledger: of the source.
        whole: records of its images.
        plan: says which poses there should be.
        imported: records that came now.
        name: an object to count though it has no image.
    """
    variants: dict[str, list[str]] = {name: []} if name else {}
    for record in whole:
        known = variants.setdefault(record.object, [])
        if record.variant not in known:
            known.append(record.variant)
    rows = []
    for object_name, found in sorted(variants.items()):
        if object_name not in plan.objects:
            continue
        ids = [pose.id for pose in plan.objects[object_name]]
        for variant in (*PAIR, *sorted(set(found) - set(PAIR))):
            there = list_poses(ledger, object_name, variant, ids)
            own = [record for record in whole if (record.object, record.variant) == (object_name, variant)]
            now = [record for record in imported if (record.object, record.variant) == (object_name, variant)]
            rows.append(
                Coverage(
                    object_name, variant, len(now), len(there), tuple(pose for pose in ids if pose not in there),
                    _mean(own, "pose_error_deg"), _mean(own, "pose_error_mm"),
                )
            )  # fmt: skip
    return tuple(rows)


def list_retakes(whole: Sequence[CaptureRecord]) -> tuple[tuple[str, str], ...]:
    """(path, advice) of the images that a gate found wanting when they were imported."""
    found = []
    for record in whole:
        advice = record.made.get("retake")
        if isinstance(advice, list) and advice:
            found.append((record.path, "; ".join(str(line) for line in advice)))
    return tuple(found)


def _mean(records: Sequence[CaptureRecord], key: str) -> float | None:
    values = [float(value) for record in records if isinstance(value := record.made.get(key), int | float)]
    return sum(values) / len(values) if values else None
