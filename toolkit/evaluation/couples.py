"""A rendered image and a photograph of the same thing from the same pose."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

from toolkit.evaluation.order import rank_variant
from toolkit.evaluation.predict import Prediction

Poses = dict[tuple[str, str, int], list[Prediction]]
Reasons = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Couple:
    """A rendered image and a photograph of the same object, variant and pose, both read."""

    sim: Prediction
    real: Prediction

    @property
    def differs(self) -> bool:
        """Whether one is right and the other wrong: the rig predicted this pose wrongly."""
        return self.sim.correct_top1 != self.real.correct_top1

    @property
    def place(self) -> tuple[str, str, int | None]:
        """Object, variant and pose."""
        return self.real.capture.object, self.real.capture.variant, self.real.capture.pose_id

    def as_json(self) -> dict[str, Any]:
        """The fields of `summary.json`."""
        name, variant, pose_id = self.place
        head: dict[str, Any] = {"object": name, "variant": variant, "pose_id": pose_id}
        for key, one in (("sim", self.sim), ("real", self.real)):
            head |= {
                f"{key}_path": one.capture.path, f"{key}_right": one.correct_top1, f"{key}_says": one.top1_label,
                f"{key}_true_prob": one.true_prob,
            }  # fmt: skip
        return head


def couple_images(
    sims: Sequence[Prediction], reals: Sequence[Prediction]
) -> tuple[tuple[Couple, ...], Reasons, Reasons]:
    """Couple the images of two sources by object, variant and pose.

    Images whose manifests name different boosters are no couple. Of several images of one pose, those of one name are
    coupled, each once; where none are, the first that fit.

    Returns:
        The couples by object, variant and pose; and (path, reason) of the images of either source that were read and
        are in none.
    """
    sim_poses, real_poses = _index(sims), _index(reals)
    couples: list[Couple] = []
    for key in sorted(sim_poses.keys() & real_poses.keys(), key=lambda key: (key[0], rank_variant(key[1]), key[2])):
        fitting = [
            Couple(one, other) for one in sim_poses[key] for other in real_poses[key] if _same_booster(one, other)
        ]  # fmt: skip
        couples += _take_once(fitting) or fitting[:1]
    used = {id(one) for couple in couples for one in (couple.sim, couple.real)}
    return tuple(couples), _explain(sims, used, reals, real_poses), _explain(reals, used, sims, sim_poses)


def _index(members: Iterable[Prediction]) -> Poses:
    poses: Poses = defaultdict(list)
    for one in members:
        capture = one.capture
        if one.is_read and capture.pose_id is not None:
            poses[(capture.object, capture.variant, capture.pose_id)].append(one)
    return poses


def _same_booster(one: Prediction, other: Prediction) -> bool:
    known = {one.capture.booster_sha256, other.capture.booster_sha256} - {None}
    return len(known) < 2


def _take_once(candidates: Iterable[Couple]) -> list[Couple]:
    """Those that name each other, by their files, each image once."""
    taken: set[int] = set()
    chosen = []
    # pose_01.heic.jpg is the image like pose_01.heic, where there is a pose_01.jpg beside it
    for kind in ("name", "stem"):
        for couple in candidates:
            sim, real = PurePosixPath(couple.sim.capture.path), PurePosixPath(couple.real.capture.path)
            ids = {id(couple.sim), id(couple.real)}
            if sim.stem == getattr(real, kind) and not ids & taken:
                taken |= ids
                chosen.append(couple)
    return chosen


def _explain(
    members: Sequence[Prediction], used: set[int], others: Sequence[Prediction], poses: Poses
) -> tuple[tuple[str, str], ...]:
    """(path, reason) of the images of one source that were read and are in no couple."""
    other, left = others[0].capture.source if others else "the other", []
    for one in members:
        capture = one.capture
        if id(one) in used or not one.is_read:
            continue
        if capture.pose_id is None:
            left.append((capture.path, "no pose number in its name"))
            continue
        partners = poses.get((capture.object, capture.variant, capture.pose_id), [])
        reason = f"another image of pose {capture.pose_id} is compared"
        if not partners:
            reason = f"{other} has no image of {capture.object}, {capture.variant}, pose {capture.pose_id}"
        elif not any(_same_booster(one, partner) for partner in partners):
            reason = f"{other} has another patch or texture there, by the manifests' SHA-256"
        left.append((capture.path, reason))
    return tuple(left)
