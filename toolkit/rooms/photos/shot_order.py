"""Order of the photographs: little camera travel, and no drift of the light that looks like a patch's effect."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import read_json, sha256_json, write_json
from toolkit.core.text import FileName, FolderName
from toolkit.rig import PAIR, Order
from toolkit.rig.plan import CapturePlan, PoseId

STARTS = 8
LONGEST_RUN = 3
MOST_SHOTS = 10_000
MOST_POLISHED = 200
"""Largest number of points for or-opt; 2-opt alone takes seconds for more."""


def find_tour(points: np.ndarray) -> np.ndarray:
    """(n,) indices of points (n, 3) along a closed tour, mostly the shortest for a plan's size; no randomness.

    The best of a few starts is taken, and the tour starts at point 0 towards the lower of its neighbours' indices.
    """
    points = np.asarray(points, float)
    n = len(points)
    if n < 4:
        return np.arange(n)
    apart = np.linalg.norm(points[:, None] - points, axis=-1)
    starts = np.unique(np.linspace(0, n - 1, min(n, STARTS)).round().astype(int))
    tours = [_improve(_go_to_nearest(apart, int(start)), apart) for start in starts]
    # rounded: the last bit, which differs between machines, must not choose between equal tours
    best = min(tours, key=lambda tour: round(_length(tour, apart), 6))
    best = np.roll(best, -int(np.flatnonzero(best == 0)[0]))
    # of the two directions of a closed tour, that with the lower second point
    return best if best[1] < best[-1] else np.r_[best[:1], best[:0:-1]]


def _length(tour: np.ndarray, apart: np.ndarray) -> float:
    return float(apart[tour, np.roll(tour, -1)].sum())


def _go_to_nearest(apart: np.ndarray, start: int) -> np.ndarray:
    # nearest neighbour: a start that 2-opt then mends
    free = np.ones(len(apart), bool)
    tour = [start]
    free[start] = False
    while free.any():
        tour.append(int(np.where(free, apart[tour[-1]], np.inf).argmin()))
        free[tour[-1]] = False
    return np.array(tour)


def _improve(tour: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """Reverse stretches and move short runs until neither helps; every step shortens the tour, so it ends."""
    slack = 1e-9 * float(apart.max())
    while True:
        better = _reverse_best(tour, apart, slack)
        if better is None and len(tour) <= MOST_POLISHED:
            better = _move_first(tour, apart, slack)
        if better is None:
            return tour
        tour = better


def _reverse_best(tour: np.ndarray, apart: np.ndarray, slack: float) -> np.ndarray | None:
    """2-opt: the reversal of a stretch that shortens the tour most, None if no reversal does."""
    after = np.roll(tour, -1)
    kept = apart[tour, after]
    # what the tour gains or loses where the stretch between two of its legs is turned round
    change = apart[np.ix_(tour, tour)] + apart[np.ix_(after, after)] - kept[:, None] - kept
    i, j = np.unravel_index(np.triu(change, 1).argmin(), change.shape)
    if change[i, j] >= -slack or i >= j:
        return None
    return np.r_[tour[: i + 1], tour[i + 1 : j + 1][::-1], tour[j + 1 :]]


def _move_first(tour: np.ndarray, apart: np.ndarray, slack: float) -> np.ndarray | None:
    """Or-opt: the first run of up to three points that is better off elsewhere, either way round; else None."""
    n = len(tour)
    for length in range(1, min(LONGEST_RUN, n - 3) + 1):
        for start in range(n):
            turned = np.roll(tour, -start)
            run, rest = turned[:length], turned[length:]
            # what the tour saves by closing the gap that the run leaves
            gain = apart[rest[-1], run[0]] + apart[run[-1], rest[0]] - apart[rest[-1], rest[0]]
            before, behind = rest[:-1], rest[1:]
            # the run may go back into the tour turned round
            for piece in (run, run[::-1]):
                # what the tour loses by opening a gap for it
                cost = apart[before, piece[0]] + apart[piece[-1], behind] - apart[before, behind]
                place = int(cost.argmin())
                if cost[place] < gain - slack:
                    return np.r_[rest[: place + 1], piece, rest[place + 1 :]]
    return None


ORDERS: tuple[Order, ...] = get_args(Order)
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


@dataclass(frozen=True)
class ShotStep:
    """A photograph to take: its number from 1 over the whole session, and what it shows from which pose."""

    __pydantic_config__ = ConfigDict(extra="forbid")
    number: Annotated[int, Field(ge=1)]
    object: FileName
    variant: FolderName
    pose_id: PoseId


class ShotList(BaseModel):
    """`rig/shots.json`: the session's photographs in order.

    Attributes:
        seed: seed of the order.
        order: pattern of the order.
        plan_sha256: for each object, `hash_poses` of the plan.
        steps: all photographs, numbered from 1.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: Literal[1] = 1
    seed: int = Field(0, ge=0)
    order: Order = "aba"
    plan_sha256: dict[FileName, Sha256]
    steps: list[ShotStep] = Field(min_length=1, max_length=MOST_SHOTS)

    @model_validator(mode="after")
    def _whole(self) -> "ShotList":
        seen: dict[tuple[str, str, int], int] = {}
        for expected, step in enumerate(self.steps, 1):
            if step.number != expected:
                raise ValueError(f"steps: expected number {expected} in place {expected}, found {step.number}")
            if step.object not in self.plan_sha256:
                raise ValueError(f"step {step.number}: object '{step.object}' is not in plan_sha256")
            key = (step.object, step.variant, step.pose_id)
            if key in seen:
                raise ValueError(f"step {step.number} repeats step {seen[key]}: {' '.join(map(str, key))}")
            seen[key] = step.number
        return self


def order_shots(
    plan: CapturePlan, objects: Sequence[str], variants: Sequence[str] | Mapping[str, Sequence[str]] = PAIR,
    seed: int = 0, order: str = "aba",
) -> list[ShotStep]:  # fmt: skip
    """List every pose of every object in every variant once, object after object, each along a short closed tour.

    Light and camera drift in the hour that a session takes.

    - `aba`: half a tour unpatched, a whole tour patched, the other half unpatched. The sheet is stuck on once, and a
      steady drift cancels over the pairs.
    - `blocks`: a tour per variant, in random order, for a sheet that cannot be taken off again. Drift counts as the
      patch's effect.
    - `alternate`: all variants at each camera position, in alternating order. A pair's cameras match best, but every
      pose needs a change of the sheet.

    Start and direction of an object's tour are random and depend on (seed, object) alone. `variants` are for all
    objects, or per object.

    Raises:
        ToolkitError: an unknown order, an object that is not in the plan or named twice, or no variant.
    """
    if order not in ORDERS:
        raise one_of("order of shots", order, list(ORDERS))
    if len(set(objects)) < len(objects):
        raise ToolkitError(f"objects {', '.join(objects)}: expected each once in a session")
    steps: list[ShotStep] = []
    for name in objects:
        if name not in plan.objects:
            raise one_of("object of the plan", name, sorted(plan.objects))
        wanted = tuple(dict.fromkeys(variants[name] if isinstance(variants, Mapping) else variants))
        if not wanted:
            raise ToolkitError(f"object '{name}': expected at least one variant to shoot")
        rng = np.random.default_rng([seed, *name.encode()])
        for variant, pose_id in _visit(_walk(plan, name, rng), wanted, order, rng):
            steps.append(ShotStep(len(steps) + 1, name, variant, pose_id))
    return steps


def _walk(plan: CapturePlan, name: str, rng: np.random.Generator) -> list[int]:
    """Pose ids along the object's tour, from a random start in a random direction."""
    poses = plan.objects[name]
    tour = find_tour(np.stack([pose.matrix()[:3, 3] for pose in poses]))
    tour = np.roll(tour, int(rng.integers(len(tour))))
    return [poses[i].id for i in (tour[::-1] if rng.integers(2) else tour)]


def _visit(walk: list[int], variants: tuple[str, ...], order: str, rng: np.random.Generator) -> list[tuple[str, int]]:
    """(variant, pose id) in the order of shooting."""
    if order == "alternate":
        # the first variant alternates too, so that neither always has the older light
        first = int(rng.integers(2))
        return [(v, pose) for i, pose in enumerate(walk) for v in (variants[::-1] if (i + first) % 2 else variants)]
    if order == "blocks" or len(variants) == 1:
        return [(variants[i], pose) for i in rng.permutation(len(variants)) for pose in walk]
    bare = "unpatched" if "unpatched" in variants else variants[0]
    others = [variant for variant in variants if variant != bare]
    half = len(walk) // 2
    # the others begin where the first half ended: the camera need not go back
    turned = walk[half:] + walk[:half]
    middle = [(others[i], pose) for i in rng.permutation(len(others)) for pose in turned]
    return [(bare, pose) for pose in walk[:half]] + middle + [(bare, pose) for pose in walk[half:]]


def measure_travel_mm(plan: CapturePlan, steps: Sequence[ShotStep]) -> float:
    """How far the camera moves from shot to shot, in straight lines; the way to another object's place is left out."""
    places = {(name, pose.id): pose.matrix()[:3, 3] for name, poses in plan.objects.items() for pose in poses}
    moves = (
        places[b.object, b.pose_id] - places[a.object, a.pose_id] for a, b in pairwise(steps) if a.object == b.object
    )
    return float(sum(map(np.linalg.norm, moves)))


def hash_poses(plan: CapturePlan, name: str) -> str:
    """SHA-256 of the plan's camera and an object's poses, whatever else the plan holds; 64 hex digits."""
    camera = plan.model_dump(mode="json", include={"camera"})["camera"]
    return sha256_json([camera, [pose.model_dump(mode="json") for pose in plan.objects[name]]])


def list_shots(plan: CapturePlan, steps: Sequence[ShotStep], seed: int = 0, order: Order = "aba") -> ShotList:
    """The steps with what they follow from, ready for `write_shots`."""
    hashes = {name: hash_poses(plan, name) for name in dict.fromkeys(step.object for step in steps)}
    return ShotList(seed=seed, order=order, plan_sha256=hashes, steps=list(steps))


def write_shots(file: Path, shots: ShotList) -> Path:
    """Write `rig/shots.json`."""
    return write_json(file, shots.model_dump(mode="json"))


def read_shots(file: Path, plan: CapturePlan | None = None) -> ShotList:
    """Read and validate `rig/shots.json`; with a plan, also that the list was made from its poses.

    Raises:
        ToolkitError: the file is missing or broken (the message names file and field), or the plan has changed since.
    """
    shots = read_json(file, ShotList)
    if plan is None:
        return shots
    # by hash: the numbers of poses may stay while their places change
    for name, sha256 in shots.plan_sha256.items():
        if name not in plan.objects or hash_poses(plan, name) != sha256:
            raise ToolkitError(
                f"{file}: field 'plan_sha256.{name}': the plan of '{name}' has changed since the list was made: "
                "make it again with 'toolkit plan --shot-list'"
            )
    return shots
