"""Pictures in memory are those that are shot, and show what is put on."""

import numpy as np
import pytest
from PIL import Image

from toolkit.captures.render import render
from toolkit.captures.shoot import ShootSettings, shoot_plan
from toolkit.objects.load import load_object
from toolkit.objects.records import read_patch
from toolkit.rig import Pattern
from toolkit.rig.camera import project
from toolkit.rig.plan import open_plan, plan_objects, read_plan


@pytest.fixture
def space(tmp_path, make_crate_space):
    return make_crate_space(tmp_path / "lab")


def test_the_pixels_are_those_of_the_files(space):
    plan, settings = open_plan(space), ShootSettings(seed=3, image_format="png", backdrop="slate")
    shot = shoot_plan(space, plan, ["crate"], settings=settings)
    item, poses, camera = load_object(space.object_spec("crate")), plan.objects["crate"], plan.camera
    for variant, booster in (("unpatched", None), ("patched", read_patch(space.patch("crate")))):
        files = [shot.source_dir / "crate" / variant / f"pose_{pose.id:02d}.png" for pose in poses]
        expected = np.stack([np.asarray(Image.open(file)) for file in files])
        assert np.array_equal(render(item, poses, camera, booster, settings), expected)


def test_a_patch_changes_the_picture_where_it_lies(space):
    plan, item = open_plan(space), load_object(space.object_spec("crate"))
    poses, camera = plan.objects["crate"], plan.camera
    bare, patched = (render(item, poses, camera, one) for one in (None, read_patch(space.patch("crate"))))
    for pose, change in zip(poses, np.abs(patched.astype(int) - bare).sum(axis=3), strict=True):
        middle, _ = project(camera, pose.matrix(), np.array([[0, 0, item.mesh.size_mm[2]]]))
        x, y = middle[0].astype(int)
        assert change[y - 2 : y + 3, x - 2 : x + 3].mean() > 30
        assert change[:8].mean() < 5


def test_no_poses_are_no_pictures(space):
    assert render(load_object(space.object_spec("crate")), []).shape == (0, 480, 640, 3)


def test_objects_are_planned_anew_and_the_others_kept(space):
    before = open_plan(space)
    camera = before.camera
    plan = plan_objects(space, ["racer"], Pattern(name="ring", count=3, elevation_deg=(30, 30)), camera)
    assert read_plan(space.plan_file).objects == plan.objects
    assert plan.objects["crate"] == before.objects["crate"]
    assert [pose.azimuth_deg for pose in plan.objects["racer"]] == [0, 120, 240]
    again = plan_objects(space, ["crate"], Pattern(name="ring", count=1), camera)
    assert len(again.objects["crate"]) == 1 and again.objects["racer"] == plan.objects["racer"]
