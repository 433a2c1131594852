"""The order of the shots: short tours, no drift between the variants, and a file that is checked on reading."""

import json
from itertools import combinations, pairwise

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.objects.load import TableObject
from toolkit.objects.spec import ObjectSpec
from toolkit.rig import Pattern
from toolkit.rig.camera import Camera
from toolkit.rig.plan import make_plan
from toolkit.rooms.photos.shot_order import (  # fmt: skip
    ORDERS,
    ShotStep,
    find_tour,
    hash_poses,
    list_shots,
    measure_travel_mm,
    order_shots,
    read_shots,
    write_shots,
)


@pytest.fixture(scope="module")
def make_boxes_plan(make_box):
    """A function (pattern, names) -> a plan of light boxes."""

    def make(pattern=None, names=("crate", "chest")):
        items = [
            TableObject(ObjectSpec(name=name, class_name=name, mesh="box.obj", length_mm=100), make_box())
            for name in names
        ]
        return make_plan(items, Camera.from_fov(), pattern or Pattern())

    return make


def shortest_tour(apart: np.ndarray) -> float:
    """Held and Karp's exact dynamic programme over subsets."""
    n = len(apart)
    best = {(1 << j, j): apart[0, j] for j in range(1, n)}
    for size in range(2, n):
        for subset in combinations(range(1, n), size):
            mask = sum(1 << j for j in subset)
            for j in subset:
                rest = mask ^ (1 << j)
                best[mask, j] = min(best[rest, k] + apart[k, j] for k in subset if k != j)
    full = (1 << n) - 2
    return min(best[full, j] + apart[j, 0] for j in range(1, n))


def tour_length(points: np.ndarray) -> float:
    tour = points[find_tour(points)]
    return float(np.linalg.norm(tour - np.roll(tour, -1, axis=0), axis=1).sum())


@pytest.mark.parametrize("seed", range(6))
def test_tours_of_nine_points_are_near_the_exact_optimum(seed):
    points = np.random.default_rng(seed).normal(size=(9, 3))
    apart = np.linalg.norm(points[:, None] - points, axis=-1)
    exact = shortest_tour(apart)
    assert exact * 0.999999 <= tour_length(points) <= exact * 1.05


def test_a_tour_round_a_circle_is_the_circle():
    """Shuffled points of a ring: the shortest tour is the regular polygon's outline."""
    angles = np.random.default_rng(1).permutation(60) * 2 * np.pi / 60
    points = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    assert tour_length(points) == pytest.approx(2 * 60 * np.sin(np.pi / 60))


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_few_points_are_all_visited(n):
    assert sorted(find_tour(np.eye(n, 3))) == list(range(n))


def test_points_in_one_place_make_a_tour():
    assert sorted(find_tour(np.zeros((7, 3)))) == list(range(7))


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("count", [1, 2, 7, 18])
def test_every_object_pose_and_variant_comes_once(make_boxes_plan, order, count):
    plan = make_boxes_plan(Pattern(name="fibonacci", count=count))
    variants = ("unpatched", "patched", "grey-patch")
    steps = order_shots(plan, ["chest", "crate"], variants, seed=4, order=order)
    assert [step.number for step in steps] == list(range(1, 6 * count + 1))
    found = {(step.object, step.variant, step.pose_id) for step in steps}
    assert found == {(o, v, i) for o in ("chest", "crate") for v in variants for i in range(1, count + 1)}
    assert [step.object for step in steps] == ["chest"] * 3 * count + ["crate"] * 3 * count


def test_aba_sticks_the_sheet_on_once_and_a_steady_drift_cancels(make_boxes_plan):
    steps = order_shots(make_boxes_plan(), ["crate"], seed=3)
    variants = [step.variant for step in steps]
    assert sum(a != b for a, b in pairwise(variants)) == 2
    assert variants[0] == variants[-1] == "unpatched"
    when = {v: np.array([s.number for s in steps if s.variant == v]) for v in ("unpatched", "patched")}
    assert when["unpatched"].mean() == when["patched"].mean()
    by_pose = {(s.variant, s.pose_id): s.number for s in steps}
    delays = [by_pose["patched", i] - by_pose["unpatched", i] for i in range(1, 19)]
    assert sorted(delays) == [-18] * 9 + [18] * 9


def test_blocks_change_once_and_either_variant_may_be_first(make_boxes_plan):
    plan = make_boxes_plan()
    firsts = set()
    for seed in range(8):
        variants = [step.variant for step in order_shots(plan, ["crate"], seed=seed, order="blocks")]
        assert sum(a != b for a, b in pairwise(variants)) == 1
        firsts.add(variants[0])
    assert firsts == {"unpatched", "patched"}


def test_alternate_keeps_the_camera_for_each_pair_and_swaps_who_is_first(make_boxes_plan):
    steps = order_shots(make_boxes_plan(), ["crate"], order="alternate")
    pairs = list(zip(steps[::2], steps[1::2], strict=True))
    assert all(a.pose_id == b.pose_id and {a.variant, b.variant} == {"unpatched", "patched"} for a, b in pairs)
    assert all(a[0].variant != b[0].variant for a, b in pairwise(pairs))


def test_the_order_follows_its_seed_and_the_object_alone(make_boxes_plan):
    plan = make_boxes_plan()

    def poses(seed, objects=("crate",)):
        return [step.pose_id for step in order_shots(plan, objects, seed=seed) if step.object == "crate"]

    assert poses(5) == poses(5) == poses(5, ("chest", "crate"))
    assert len({tuple(poses(seed)) for seed in range(12)}) > 6


def test_the_camera_moves_far_less_than_in_a_random_order(make_boxes_plan):
    plan = make_boxes_plan()
    rng = np.random.default_rng(0)
    planned = measure_travel_mm(plan, order_shots(plan, ["crate"]))
    shuffled = []
    for _ in range(20):
        ids = np.concatenate([rng.permutation(18) + 1 for _ in range(2)])
        steps = [ShotStep(i, "crate", "unpatched", int(pose)) for i, pose in enumerate(ids, 1)]
        shuffled.append(measure_travel_mm(plan, steps))
    assert planned < 0.6 * min(shuffled)


def test_variants_may_differ_between_objects(make_boxes_plan):
    steps = order_shots(
        make_boxes_plan(), ["crate", "chest"], {"crate": ("unpatched",), "chest": ("unpatched", "patched")}
    )
    assert {s.variant for s in steps if s.object == "crate"} == {"unpatched"}
    assert len(steps) == 18 + 36


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"objects": ["crat"]}, "no object of the plan called 'crat': did you mean crate"),
        ({"objects": ["crate", "crate"]}, "each once"),
        ({"objects": ["crate"], "order": "abba"}, "no order of shots called 'abba'"),
        ({"objects": ["crate"], "variants": ()}, "at least one variant"),
    ],
)
def test_what_cannot_be_ordered_is_refused(make_boxes_plan, arguments, words):
    with pytest.raises(ToolkitError, match=words):
        order_shots(make_boxes_plan(), **arguments)


@pytest.fixture
def written(tmp_path, make_boxes_plan):
    """Write a list with one field changed, and read it back."""
    plan = make_boxes_plan(Pattern(name="ring", count=3), ("crate",))

    def write(change=lambda content: None):
        file = write_shots(tmp_path / "rig" / "shots.json", list_shots(plan, order_shots(plan, ["crate"])))
        content = json.loads(file.read_text())
        change(content)
        file.write_text(json.dumps(content))
        return read_shots(file, plan)

    return write


def test_a_list_is_read_as_it_was_written(written, make_boxes_plan):
    plan = make_boxes_plan(Pattern(name="ring", count=3), ("crate",))
    shots = written()
    assert shots.steps == order_shots(plan, ["crate"])
    assert (shots.seed, shots.order, shots.plan_sha256) == (0, "aba", {"crate": hash_poses(plan, "crate")})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c["steps"][1].update(pose_id=0), r"field 'steps\.1\.pose_id'.*found 0"),
        (lambda c: c["steps"][1].update(pose_id="two"), r"field 'steps\.1\.pose_id'"),
        (lambda c: c["steps"][1].update(number=7), "expected number 2 in place 2, found 7"),
        (lambda c: c["steps"][1].update(variant="../x"), r"field 'steps\.1\.variant'"),
        (lambda c: c["steps"][1].update(pose=1), r"field 'steps\.1\.pose'"),
        (lambda c: c["steps"][1].pop("object"), r"field 'steps\.1\.object' is missing"),
        (lambda c: c["steps"][1].update(object="chest"), "object 'chest' is not in plan_sha256"),
        (lambda c: c["steps"][1].update(c["steps"][0], number=2), "step 2 repeats step 1"),
        (lambda c: c["steps"].clear(), "field 'steps'"),
        (lambda c: c.update(order="zigzag"), "field 'order'"),
        (lambda c: c.update(seed=-1), "field 'seed'"),
        (lambda c: c.update(schema_version=2), "schema_version"),
        (lambda c: c["plan_sha256"].update(crate="0" * 64), r"plan_sha256\.crate.*has changed.*--shot-list"),
    ],
)
def test_a_wrong_field_is_named(written, change, words):
    with pytest.raises(ToolkitError, match=words) as caught:
        written(change)
    assert "shots.json" in str(caught.value) and "\n" not in str(caught.value)


def test_the_hash_is_of_one_objects_poses_and_the_camera(make_boxes_plan):
    plan, fewer = make_boxes_plan(), make_boxes_plan(names=("crate",))
    assert hash_poses(plan, "crate") == hash_poses(fewer, "crate")
    moved = make_boxes_plan(Pattern(elevation_deg=(25, 66)))
    assert hash_poses(plan, "crate") != hash_poses(moved, "crate")
    assert hash_poses(plan, "crate") != hash_poses(
        plan.model_copy(update={"camera": Camera.from_fov(640, 480, 41.0)}), "crate"
    )
