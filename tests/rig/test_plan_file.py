"""The capture plan: nothing cropped, and a file that a person may edit and gets told where it went wrong."""

import json

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.spec import ObjectSpec
from toolkit.rig import Pattern
from toolkit.rig.camera import Camera, project
from toolkit.rig.plan import (
    check_poses,
    hash_pose,
    keep_others,
    make_plan,
    open_plan,
    read_plan,
    scale_resolution,
    write_plan,
)


@pytest.fixture(scope="module")
def crate(make_box) -> TableObject:
    spec = ObjectSpec(name="crate", class_name="crate", mesh="crate.obj", length_mm=100)
    return TableObject(spec, make_box())


@pytest.fixture
def written(tmp_path, crate):
    """Write a plan with one field changed and read it back."""

    def write(change):
        content = make_plan([crate], Camera.from_fov(), Pattern(count=2)).model_dump(mode="json", exclude_none=True)
        change(content)
        file = tmp_path / "plan.json"
        file.write_text(json.dumps(content))
        return read_plan(file)

    return write


def test_the_built_in_objects_are_whole_in_all_eighteen_poses(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    space = open_workspace()
    items = [load_object(file) for file in space.object_specs().values()]
    assert [item.name for item in items] == ["coffeepot", "eggnog", "racer", "warplane"]
    camera = Camera.from_fov()
    plan = make_plan(items, camera, Pattern())
    for item in items:
        poses = plan.objects[item.name]
        assert [pose.id for pose in poses] == list(range(1, 19))
        assert len({(pose.azimuth_deg, pose.elevation_deg) for pose in poses}) == 18
        for pose in poses:
            pixels, depth = project(camera, np.array(pose.T_world_camera), item.mesh.vertices)
            reach = np.abs(pixels - [320, 240]).max() / 240
            assert depth.min() > 0 and reach == pytest.approx(0.8, abs=0.001)


def test_file_round_trip_is_byte_equal(tmp_path, crate):
    plan = make_plan([crate], Camera.from_fov(96, 72, 33.3), Pattern(name="fibonacci", count=5, jitter_deg=1, seed=3))
    first = write_plan(tmp_path / "a.json", plan)
    second = write_plan(tmp_path / "b.json", read_plan(first))
    assert first.read_bytes() == second.read_bytes()
    for before, after in zip(plan.objects["crate"], read_plan(second).objects["crate"], strict=True):
        np.testing.assert_array_equal(before.matrix(), after.matrix())


def test_distances_asked_for_are_spread_over_the_poses(crate):
    poses = make_plan([crate], Camera.from_fov(), Pattern(count=3, distance_mm=(300, 500))).objects["crate"]
    assert [pose.distance_mm for pose in poses] == [300, 400, 500]
    with pytest.raises(ToolkitError, match=r"'crate', pose 1: the object is cropped at 120 mm: expected at least"):
        make_plan([crate], Camera.from_fov(), Pattern(distance_mm=(120, 500)))
    with pytest.raises(ToolkitError, match="the nearer first"):
        Pattern(distance_mm=(900, 100))


def test_focal_length_and_sensor_stand_for_the_field_of_view(written):
    def to_lens(content):
        del content["camera"]["fov_deg"]
        content["camera"] |= {"focal_mm": 35.0, "sensor_width_mm": 36.0}

    camera = written(to_lens).camera
    assert camera.fov_deg == pytest.approx(54.43, abs=0.01)  # the 35 mm lens of the textbooks
    assert camera.fx == pytest.approx(640 * 35 / 36)


LENS = {"fx": 700.0, "fy": 690.5, "cx": 310.25, "cy": 250.0, "distortion": (0.1, -0.2, 0.001, 0.0, 0.03)}


def test_a_measured_lens_is_written_and_read_whole(tmp_path, crate):
    camera = Camera(640, 480, **LENS)
    plan = make_plan([crate], camera, Pattern(count=2))
    again = read_plan(write_plan(tmp_path / "plan.json", plan))
    assert again.camera == camera and keep_others(again, plan) == plan
    for pose in again.objects["crate"]:
        pixels, depth = project(camera, pose.matrix(), crate.mesh.vertices)
        assert depth.min() > 0 and np.abs(pixels - [320, 240]).max() == pytest.approx(0.8 * 240, abs=0.1)
    small = scale_resolution(plan, 320).camera
    assert (small.fy, small.cx, small.distortion) == (690.5 / 2, 310.25 / 2, camera.distortion)


def test_a_plain_camera_is_written_and_hashed_as_before(crate):
    plan = make_plan([crate], Camera.from_fov(), Pattern(count=2))
    assert plan.model_dump(mode="json", include={"camera"})["camera"] == {
        "width": 640, "height": 480, "fov_deg": 40.0, "focal_mm": None, "sensor_width_mm": None,
        "convention": "opencv",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("lens", "words"),
    [
        ({"focal_mm": 35.0}, "focal_mm says how wide the camera sees only with sensor_width_mm: add it"),
        ({"sensor_width_mm": 36.0}, "sensor_width_mm says how wide the camera sees only with focal_mm: add it"),
        (
            {"fov_deg": 40.0, "focal_mm": 35.0, "sensor_width_mm": 36.0},
            r"fov_deg \(879.2 px\) and focal_mm \(622.2 px\) are different focal lengths: keep one",
        ),
        ({"fov_deg": 40.0, "fx": 700.0}, r"fov_deg \(879.2 px\) and fx \(700.0 px\) are different"),
        ({"fov_deg": 40.0, "distortion": [0.1, 0.2]}, "camera.distortion"),
    ],
)
def test_a_lens_that_is_said_by_half_or_twice_is_refused(written, lens, words):
    def change(content):
        content["camera"] = {"width": 640, "height": 480, **lens}

    with pytest.raises(ToolkitError, match=words) as caught:
        written(change)
    assert "plan.json: field 'camera" in str(caught.value) and "\n" not in str(caught.value)


def test_the_same_lens_said_twice_is_read(written):
    camera = written(lambda c: c["camera"].update(focal_mm=49.455, sensor_width_mm=36.0)).camera
    assert camera == Camera.from_fov()


def test_a_pose_is_known_by_where_the_camera_stands_and_how_it_sees(crate):
    plan = make_plan([crate], Camera.from_fov(), Pattern(count=2))
    first, second = plan.objects["crate"]
    known = hash_pose(plan.camera, first)
    assert known == hash_pose(plan.camera, first.model_copy(update={"id": 9, "T_world_camera": None}))
    assert known != hash_pose(plan.camera, second)
    assert known != hash_pose(plan.camera, first.model_copy(update={"distance_mm": first.distance_mm + 1}))
    assert known != hash_pose(Camera.from_fov(fov_deg=41), first)
    # other machines differ in the last digits
    assert known == hash_pose(Camera.from_fov(fov_deg=40 + 1e-13), first)


def first_pose(content):
    return content["objects"]["crate"][0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: first_pose(c).update(azimuth_deg=1.0), "objects.crate.0.*pose 1: T_world_camera does not agree"),
        (lambda c: first_pose(c).update(roll_deg=1.0), "objects.crate.0.*pose 1: T_world_camera does not agree"),
        (lambda c: first_pose(c).update(distance_mm=-3), r"objects.crate.0.distance_mm.*found -3"),
        (lambda c: first_pose(c).update(distance_mm=float("inf")), r"objects.crate.0.distance_mm.*finite"),
        (lambda c: first_pose(c).update(elevation_deg=91), r"objects.crate.0.elevation_deg"),
        (lambda c: first_pose(c).update(azimuth_deg="north"), r"objects.crate.0.azimuth_deg.*north"),
        (lambda c: first_pose(c).update(elevaton_deg=4), r"objects.crate.0.elevaton_deg"),
        (lambda c: first_pose(c).pop("target_mm"), r"objects.crate.0.target_mm.*is missing"),
        (lambda c: c["objects"]["crate"][1].update(id=1), r"field 'objects'|ids that differ"),
        (lambda c: c["objects"].update(crate=[]), "at least one pose"),
        (lambda c: c["camera"].update(width=8), "camera.width"),
        (lambda c: c["camera"].update(convention="opengl"), "camera.convention"),
        (lambda c: c.update(schema_version=2), "schema_version"),
        (lambda c: c.pop("objects"), "objects"),
    ],
)
def test_a_wrong_field_is_named(written, change, words):
    with pytest.raises(ToolkitError, match=words) as caught:
        written(change)
    assert "plan.json" in str(caught.value) and "\n" not in str(caught.value)


def test_a_pose_without_its_matrix_follows_its_angles(written):
    def move(content):
        first_pose(content).pop("T_world_camera")
        first_pose(content).update(azimuth_deg=90.0, elevation_deg=0.0, distance_mm=500.0)

    position = written(move).objects["crate"][0].matrix()[:3, 3]
    np.testing.assert_allclose(position, [0, 500, 20], atol=1e-9)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"distance_mm": 10.0}, "the camera is inside the object"),
        ({"distance_mm": 900.0, "elevation_deg": -20.0}, "below the table top"),
        ({"distance_mm": 110.0}, "cropped at 110 mm: expected at least"),
        ({"target_mm": (200.0, 0.0, 20.0), "distance_mm": 300.0}, "cropped"),
    ],
)
def test_a_pose_that_cannot_be_shot_is_refused_in_one_line(crate, fields, words):
    pose = make_plan([crate], Camera.from_fov(), Pattern(count=1)).objects["crate"][0]
    wrong = type(pose).model_validate(pose.model_dump(exclude={"T_world_camera"}) | fields)
    with pytest.raises(ToolkitError, match=words) as caught:
        check_poses(crate, Camera.from_fov(), [wrong])
    assert str(caught.value).startswith("plan: object 'crate', pose 1:") and "\n" not in str(caught.value)


def test_a_camera_that_cannot_be_is_refused(crate):
    with pytest.raises(ToolkitError, match=r"camera: width.*found 8"):
        make_plan([crate], Camera.from_fov(8, 480), Pattern())


def test_objects_of_another_plan_are_kept_where_its_camera_is_the_same(crate):
    old, other = (make_plan([crate], Camera.from_fov(*size), Pattern(count=1)) for size in ((640, 480), (96, 72)))
    new = old.model_copy(update={"objects": {"box": old.objects["crate"]}})
    assert list(keep_others(old, new).objects) == ["crate", "box"]
    assert keep_others(other, new) == new


def test_a_missing_plan_is_made_once_and_then_read(tmp_path, make_crate_space, monkeypatch):
    space = make_crate_space(tmp_path)
    monkeypatch.setattr("toolkit.core.workspace.PACKAGE_DATA", tmp_path / "none")
    space.plan_file.unlink()
    made = open_plan(Workspace(space.root))
    assert list(made.objects) == ["crate"] and len(made.objects["crate"]) == 18
    content = space.plan_file.read_bytes()
    assert open_plan(space).model_dump() == read_plan(space.plan_file).model_dump()
    assert space.plan_file.read_bytes() == content


def test_a_plan_with_a_focal_length_keeps_its_objects_when_one_is_added(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path)
    open_plan(space, ["crate"], Pattern(count=2))
    content = json.loads(space.plan_file.read_text())
    content["camera"] = {"width": 640, "height": 480, "focal_mm": 50.0, "sensor_width_mm": 36.0}
    space.plan_file.write_text(json.dumps(content))
    before = read_plan(space.plan_file)
    after = open_plan(space, ["racer"], Pattern(count=1))
    assert after.objects["crate"] == before.objects["crate"] and len(after.objects["racer"]) == 1
    assert read_plan(space.plan_file).camera.fx == pytest.approx(before.camera.fx, rel=1e-12)
