"""Gates that need all photographs of an object: has each its partner, and was the patch in the same place?"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from toolkit.captures.gates.moved import LEAST_PHOTOS, MOVED, SIZE, PatchLines, measure_moves, measure_side
from toolkit.captures.gates.result import Gate, GateResult
from toolkit.captures.variants import PAIR

PARTNER = Gate("missing partner", 0.0, "photographs of the pair missing", "take the same pose in the other variant")
"""0: what is compared is the same object from the same pose with and without its patch; a photograph alone is left
out."""


@dataclass(frozen=True)
class CheckedPhoto:
    """One photograph of a set.

    Attributes:
        object, variant, pose_id: what it shows.
        results: of its own gates.
        lines: where its patch was seen; None without pose or patch.
        path: of the image, for people.
    """

    object: str
    variant: str
    pose_id: int | None
    results: tuple[GateResult, ...] = ()
    lines: PatchLines | None = None
    path: str = ""


@dataclass(frozen=True)
class SetFinding:
    """What a gate over a set says of one photograph, which may be one that is not there yet."""

    object: str
    variant: str
    pose_id: int | None
    result: GateResult
    path: str = ""


def check_set(
    photos: Sequence[CheckedPhoto], sides_mm: Mapping[tuple[str, str], float] | None = None
) -> list[SetFinding]:
    """Check pairs and patches over all photographs of a source.

    Args:
        photos: of any objects and variants; the same one may not come twice.
        sides_mm: the side of the patch as it should have been printed, by object and variant, where that is known.
    """
    by_object: dict[str, list[CheckedPhoto]] = defaultdict(list)
    for photo in photos:
        by_object[photo.object].append(photo)
    findings = []
    for name in sorted(by_object):
        findings += find_single_photos(name, by_object[name])
        findings += find_moved_patches(by_object[name])
        findings += find_wrong_sizes(by_object[name], sides_mm or {})
    return findings


def find_single_photos(name: str, photos: Sequence[CheckedPhoto]) -> list[SetFinding]:
    """For each pose of one object that has a photograph in the pair, whether it has both."""
    poses = {
        variant: {photo.pose_id: photo for photo in photos if photo.variant == variant and photo.pose_id is not None}
        for variant in PAIR
    }
    findings = []
    for variant, other in (PAIR, PAIR[::-1]):
        for pose_id, photo in sorted(poses[variant].items(), key=lambda item: item[0] or 0):
            if not poses[other]:
                result = PARTNER.skip(f"'{other}' has no photograph yet")
                findings.append(SetFinding(name, variant, pose_id, result, photo.path))
            elif pose_id not in poses[other]:
                advice = f"pose {pose_id} is there as '{variant}' only: take it as '{other}' as well"
                findings.append(SetFinding(name, other, pose_id, PARTNER.judge(1, advice)))
            elif variant == PAIR[0]:
                findings.append(SetFinding(name, variant, pose_id, PARTNER.judge(0), photo.path))
    for photo in photos:
        if photo.variant in PAIR and photo.pose_id is None:
            result = PARTNER.skip("no pose: it is not known which pose it shows")
            findings.append(SetFinding(name, photo.variant, None, result, photo.path))
    return findings


def find_moved_patches(photos: Sequence[CheckedPhoto]) -> list[SetFinding]:
    """For each photograph of one object whose variant has a patch, how far it lies beside the others'.

    A variant in which no photograph shows its patch has no findings: its own gates say why.
    """
    findings = []
    for variant in sorted({photo.variant for photo in photos if photo.lines is not None}):
        group = [photo for photo in photos if photo.variant == variant]
        seen = [(photo, photo.lines) for photo in group if photo.lines is not None]
        moves = dict(zip((id(photo) for photo, _ in seen), measure_moves([lines for _, lines in seen]), strict=True))
        few = f"it takes {LEAST_PHOTOS} photographs with pose and patch, from different sides"
        for photo in group:
            move = moves.get(id(photo))
            if move is not None:
                result = MOVED.judge(
                    move, f"the patch, or the object on its board, lies {move:.0f} mm beside: {MOVED.advice}"
                )
            else:
                result = MOVED.skip(few if photo.lines is not None else "no pose, or no patch is seen")
            findings.append(SetFinding(photo.object, photo.variant, photo.pose_id, result, photo.path))
    return findings


def find_wrong_sizes(
    photos: Sequence[CheckedPhoto], sides_mm: Mapping[tuple[str, str], float]
) -> list[SetFinding]:  # fmt: skip
    """For each variant of one object with a patch, whether the patch is as large as it should have been printed."""
    findings = []
    for key in sorted({(photo.object, photo.variant) for photo in photos if photo.lines is not None} & set(sides_mm)):
        group = [photo for photo in photos if (photo.object, photo.variant) == key]
        side = measure_side([photo.lines for photo in group if photo.lines is not None])
        if side is None:
            result = SIZE.skip(f"it takes {LEAST_PHOTOS} photographs with pose and patch, from different sides")
        else:
            off = 100 * (side / sides_mm[key] - 1)
            found = f"the patch measures {side:.1f} mm, {off:+.1f} %, where {sides_mm[key]:.1f} mm was meant"
            result = SIZE.judge(abs(off), f"{found}: {SIZE.advice}")
        findings.append(SetFinding(*key, None, result))
    return findings
