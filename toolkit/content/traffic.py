"""What stands in and along the streets of a plan: vehicles, lamps, signals, signs, trees, furniture."""

from collections import defaultdict

import numpy as np

from toolkit.content.fleet import Fleet
from toolkit.content.grounds import CROSSING_M, PARKING_M
from toolkit.content.pieces import Looks, Piece, bars, merge, place
from toolkit.content.plan import KERB_M, PAVEMENT_M, Plan, Stretch
from toolkit.content.signs import SIGN_KINDS, name_post, sign_post, traffic_light
from toolkit.content.street_furniture import FURNITURE, old_lamp, street_lamp
from toolkit.content.trees import shrub, street_tree
from toolkit.content.vehicles import Vehicle
from toolkit.worlds.classes import SceneClass

Standing = dict[str, list[tuple[float, float, float, float]]]
"""Positions x, y, z and yaw of things by name."""

PARKED_SHARE = 0.42
KERB_SIDE = {
    "meter": 0.3, "hydrant": 0.06, "mailbox": 0.07, "bin": 0.1, "newspapers": 0.07, "phone": 0.05, "bicycle": 0.08,
    "bench": 0.06,
}  # fmt: skip
WALL_SIDE = {
    "cafe": 0.1, "bench": 0.15, "planter": 0.2, "dustbins": 0.16, "bicycle": 0.08, "newspapers": 0.08, "bin": 0.07,
}  # fmt: skip
TREE_VARIANTS = 4


def place_vehicles(plan: Plan, fleet: Fleet, rng: np.random.Generator) -> Piece:
    """Parked along the kerbs, queueing and driving on the right."""
    at: dict[int, list[tuple[float, float, float]]] = defaultdict(list)
    makes: dict[int, Vehicle] = {}

    def put(vehicle: Vehicle, stretch: Stretch, along: float, right: float, turn: float = 0.0) -> None:
        point = stretch.point(along, right)
        if plan.is_free(point, vehicle.length / 2):
            at[id(vehicle)].append((*point, stretch.yaw_deg + turn))
            makes[id(vehicle)] = vehicle

    def pick(shares: list[tuple[tuple[Vehicle, ...], float]]) -> Vehicle:
        kinds = [kind for kind, _ in shares]
        kind = kinds[int(rng.choice(len(kinds), p=np.array([share for _, share in shares])))]
        return kind[int(rng.integers(len(kind)))]

    for stretch in plan.both_ways():
        half, end = stretch.street.half, stretch.length - CROSSING_M - 5.0
        along = CROSSING_M + 6.0
        while along < end:
            vehicle = pick(fleet.parked())
            if rng.random() < PARKED_SHARE and along + vehicle.length < end:
                put(
                    vehicle, stretch, along + vehicle.length / 2, half - PARKING_M / 2 - rng.uniform(-0.1, 0.15),
                    rng.normal(0, 0.8),
                )  # fmt: skip
                along += vehicle.length + rng.uniform(0.7, 1.6)
            else:
                along += 6.0
        lane = 5.0 if stretch.street.avenue else 2.1
        along = stretch.length - CROSSING_M - rng.uniform(0.3, 22.0)
        while along > CROSSING_M + 4:
            vehicle = pick(fleet.moving())
            if along - vehicle.length < CROSSING_M:
                break
            put(vehicle, stretch, along - vehicle.length / 2, lane + rng.uniform(-0.15, 0.15))
            along -= vehicle.length + rng.choice([1.8, 8.0, 18.0, 36.0])
        if stretch.street.avenue and rng.random() < 0.3 and stretch.length > 36:
            tram = fleet.trams[int(rng.integers(len(fleet.trams)))]
            put(tram, stretch, stretch.length / 2 + rng.uniform(-4, 4), 1.68)
    pieces = []
    for key, places in at.items():
        spots = np.array(places)
        pieces.append(place(makes[key].piece, np.column_stack([spots[:, :2], np.zeros(len(spots))]), spots[:, 2]))
    return merge(*pieces)


def furnish_streets(plan: Plan, looks: Looks, rng: np.random.Generator) -> Piece:
    """Everything on the pavements."""
    standing: Standing = defaultdict(list)
    for stretch in plan.both_ways():
        _line_kerb(plan, stretch, standing, rng)
        _line_wall(plan, stretch, standing, rng)
        _signal(plan, stretch, standing, rng)
    return build_standing(standing, looks)


def build_standing(standing: Standing, looks: Looks) -> Piece:
    """Copies of everything at its places."""
    pieces = []
    for name, places in standing.items():
        spots = np.array(places)
        kind, _, rest = name.partition(":")
        scale: float | np.ndarray = 1.0
        if kind == "lamp":
            made = street_lamp(looks)
        elif kind == "old-lamp":
            made = old_lamp(looks)
        elif kind == "tree":
            made = street_tree(looks, int(rest))
            scale = 0.75 + 0.5 * ((spots[:, 0] * 7.13 + spots[:, 1] * 3.7) % 1.0)
        elif kind == "shrub":
            made = shrub(looks, int(rest))
        elif kind == "sign":
            made = sign_post(rest, looks)
        elif kind == "names":
            made = name_post(tuple(rest.split("|")), looks)  # type: ignore[arg-type]
        elif kind == "signal":
            lit, street, arm = rest.split("|")
            made = traffic_light(looks, int(lit), street, float(arm))
        else:
            made = FURNITURE[kind][0](looks)
        pieces.append(place(made, spots[:, :3], spots[:, 3], scale))
    return merge(*pieces)


def _line_kerb(plan: Plan, stretch: Stretch, standing: Standing, rng: np.random.Generator) -> None:
    """Along the right-hand kerb: lamps and trees in turn, and between them what else is found there."""
    right = stretch.street.half + 0.75
    kinds, shares = list(KERB_SIDE), np.array(list(KERB_SIDE.values()))
    shares = shares / shares.sum()
    along, k = CROSSING_M + 2.5, int(rng.integers(4))
    while along < stretch.length - 5.0:
        point = stretch.point(along, right)
        if k % 4 == 0 and plan.is_free(stretch.point(along, right - 2.4), 0.5) and plan.is_free(point, 0.3):
            name = "lamp" if stretch.street.avenue or rng.random() < 0.8 else "old-lamp"
            standing[name].append((*point, KERB_M, stretch.yaw_deg - 180))
        elif k % 4 == 2 and stretch.street.trees and plan.is_free(point, 3.2):
            standing[f"tree:{rng.integers(TREE_VARIANTS)}"].append((*point, KERB_M, rng.uniform(0, 360)))
        elif rng.random() < 0.75:
            kind = kinds[int(rng.choice(len(kinds), p=shares))]
            if plan.is_free(point, FURNITURE[kind][1]):
                turn = 90.0 if kind in ("bicycle",) else 0.0
                standing[kind].append((*point, KERB_M, stretch.yaw_deg + turn))
        if rng.random() < 0.12 and plan.is_free(point, 1.0):
            kind = SIGN_KINDS[1:][int(rng.integers(len(SIGN_KINDS) - 1))]
            standing[f"sign:{kind}"].append((*stretch.point(along + 1.6, right - 0.1), KERB_M, stretch.yaw_deg - 90))
        along += rng.uniform(3.8, 5.6)
        k += 1
    if rng.random() < 0.25 and stretch.length > 40:
        point = stretch.point(stretch.length * 0.5, stretch.street.half + 1.6)
        if plan.is_free(point, FURNITURE["shelter"][1]):
            standing["shelter"].append((*point, KERB_M, stretch.yaw_deg - 180))


def _line_wall(plan: Plan, stretch: Stretch, standing: Standing, rng: np.random.Generator) -> None:
    """Along the houses on the right."""
    right = stretch.street.half + PAVEMENT_M - 0.75
    kinds, shares = list(WALL_SIDE), np.array(list(WALL_SIDE.values()))
    along = CROSSING_M + rng.uniform(4, 10)
    while along < stretch.length - 6.0:
        kind = kinds[int(rng.choice(len(kinds), p=shares / shares.sum()))]
        inward = 0.75 if kind == "cafe" else 0.0
        point = stretch.point(along, right - inward)
        if plan.is_free(point, FURNITURE[kind][1]):
            standing[kind].append((*point, KERB_M, stretch.yaw_deg - 180))
            if kind == "planter":
                standing[f"shrub:{rng.integers(3)}"].append((*point, KERB_M + 0.45, rng.uniform(0, 360)))
            if kind == "cafe" and plan.is_free(stretch.point(along + 2.6, right - inward), 1.4):
                standing[kind].append((*stretch.point(along + 2.6, right - inward), KERB_M, stretch.yaw_deg - 150))
        along += rng.uniform(5, 13)


def _signal(plan: Plan, stretch: Stretch, standing: Standing, rng: np.random.Generator) -> None:
    """At the far right corner of the junction ahead: a signal over the road, or a stop sign before it."""
    inner = (plan.north[0].at, plan.north[-1].at, plan.east[0].at, plan.east[-1].at)
    beyond = stretch.point(stretch.length + 2 * stretch.across.half + 1.0, stretch.street.half + 1.0)
    inside = inner[0] < beyond[0] < inner[1] and inner[2] < beyond[1] < inner[3]
    if inside and (stretch.street.avenue or stretch.across.avenue or rng.random() < 0.7):
        runs_north = abs(stretch.ahead[1]) > 0.5
        arm = 6.5 if stretch.street.avenue else 4.6
        lit = (0 if runs_north else 2) if int(abs(beyond[0] // 7)) % 2 else (2 if runs_north else 0)
        if plan.is_free(beyond, 0.3):
            standing[f"signal:{lit}|{stretch.across.name}|{arm}"].append((*beyond, KERB_M, stretch.yaw_deg - 90))
    elif plan.is_free(stretch.point(stretch.length - 1, stretch.street.half + 0.8), 0.5):
        standing["sign:stop"].append(
            (*stretch.point(stretch.length - CROSSING_M - 1, stretch.street.half + 0.8), KERB_M, stretch.yaw_deg - 90)
        )
    if rng.random() < 0.5:
        point = stretch.point(stretch.length - 0.9, stretch.street.half + 1.2)
        if plan.is_free(point, 0.8):
            standing[f"names:{stretch.across.name}|{stretch.street.name}"].append(
                (*point, KERB_M, stretch.yaw_deg - 90)
            )


def hang_wires(plan: Plan, looks: Looks) -> Piece:
    """Contact wires over the avenues on span wires between poles, left out over reserved circles."""
    black, steel = looks.plain((30, 30, 32), "matte"), looks.plain((70, 76, 76))
    pieces = []
    for stretch in plan.stretches():
        if not stretch.street.avenue or not plan.is_free((stretch.start + stretch.end) / 2, stretch.length / 2 + 8):
            continue
        ends = [np.array([(*stretch.point(along, y), 5.55)]) for y in (-1.68, 1.68) for along in (0.0, stretch.length)]
        pieces.append(bars(np.concatenate(ends[::2]), np.concatenate(ends[1::2]), 0.03, black, SceneClass.FURNITURE))
        reach = stretch.street.half + 0.6
        for along in np.arange(9.0, stretch.length - 5, 18.0):
            posts = np.array([(*stretch.point(along, side * reach), KERB_M) for side in (-1, 1)])
            tops = posts + [0, 0, 6.4]
            pieces.append(bars(posts, tops, 0.18, steel, SceneClass.FURNITURE))
            pieces.append(bars(tops[:1], tops[1:], 0.025, black, SceneClass.FURNITURE))
    return merge(*pieces)
