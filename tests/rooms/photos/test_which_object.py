"""A photograph of another object is told, and what cannot be told is not called right."""

import board_photos as bp
import numpy as np
import pytest

from toolkit.core.workspace import make_workspace
from toolkit.objects.load import load_object
from toolkit.rig import Pattern
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.plan import make_plan, write_plan
from toolkit.rooms.photos.gates.objects import KnownObjects, judge_likeness

CAMERA = Camera.from_fov(640, 480, 40.0)


@pytest.fixture(scope="module")
def known(tmp_path_factory) -> KnownObjects:
    space = make_workspace(tmp_path_factory.mktemp("objects"))
    items = [load_object(space.object_spec(name)) for name in ("coffeepot", "racer")]
    pattern = Pattern(name="ring", count=4, elevation_deg=(35.0, 35.0))
    write_plan(space.plan_file, make_plan(items, CAMERA, pattern, space))
    return KnownObjects(space)


def test_a_racing_car_at_the_coffeepots_shot_is_told(known):
    T = orbit_pose(np.array([0, 0, 40.0]), 94, 36, 560)
    image = bp.photograph("racer", None, CAMERA, T, light="side", backdrop="oak", seed=4)
    wrong = known.check(image, "coffeepot")
    assert wrong.failed and "looks like 'racer', not like 'coffeepot'" in wrong.advice
    assert known.check(image, "racer").passed
    assert known.check(image, "moka").status == "not checked", "nobody knows what it looks like"


def test_a_picture_of_nothing_known_is_not_checked(known):
    noise = np.random.default_rng(0).integers(0, 255, (15, 20, 3), dtype=np.uint8).repeat(24, 0).repeat(24, 1)
    assert {known.check(noise, name).status for name in ("coffeepot", "racer")} == {"not checked"}


def test_without_a_plan_nothing_is_compared(tmp_path):
    blank = np.zeros((48, 64, 3), np.uint8)
    assert KnownObjects(make_workspace(tmp_path)).check(blank, "racer").status == "not checked"


@pytest.mark.parametrize(
    ("own", "rivals", "status"),
    [
        (0.5, {"racer": 0.75}, "failed"),
        (0.75, {"racer": 0.5}, "passed"),
        (0.7, {"racer": 0.72}, "not checked"),
        (0.47, {"racer": 0.66}, "not checked"),  # a keyboard
        (0.7, {}, "not checked"),
    ],
)
def test_one_must_be_plainly_ahead(own, rivals, status):
    assert judge_likeness("moka", own, rivals).status == status
