"""What a sweep varies: values as typed, and plans changed against closed forms."""

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.rig.camera import Camera, orbit_pose, project
from toolkit.rig.plan import CapturePlan, Pose, scale_distance, scale_resolution
from toolkit.rig.studio import BACKDROPS, TRAINED_LIGHTS
from toolkit.rooms.benchmarks.sweeps.axes import AXES, PAPER_MM, find_axis, parse_values

TARGET = (1.0, -2.0, 30.0)


def make_plan(with_matrix=True):
    poses = []
    for i, (azimuth, elevation, roll) in enumerate([(20, 25, 0), (200, 65, 15), (310, 90, 0)], 1):
        rows = orbit_pose(np.array(TARGET), azimuth, elevation, 400.0, roll).round(6).tolist() if with_matrix else None
        poses.append(
            Pose(
                id=i, azimuth_deg=azimuth, elevation_deg=elevation, roll_deg=roll, distance_mm=400, target_mm=TARGET,
                T_world_camera=rows,
            )
        )  # fmt: skip
    return CapturePlan(camera=Camera.from_fov(640, 480, 40), objects={"crate": poses})


@pytest.mark.parametrize("factor", [0.5, 1.5, 3])
def test_distance_keeps_the_direction_and_scales_the_way_to_the_target(factor):
    plan = make_plan()
    moved = scale_distance(plan, factor)
    for old, new in zip(plan.objects["crate"], moved.objects["crate"], strict=True):
        before, after = old.matrix(), np.array(new.T_world_camera)
        np.testing.assert_allclose(after[:3, :3], before[:3, :3], atol=2e-6)
        np.testing.assert_allclose(after[:3, 3] - TARGET, factor * (before[:3, 3] - TARGET), atol=1e-3)
        assert new.distance_mm == pytest.approx(400 * factor) and new.id == old.id
    assert moved.camera == plan.camera
    CapturePlan.model_validate(moved.model_dump())  # angles, distance and matrix still agree


def test_distance_leaves_out_a_matrix_that_the_plan_left_out():
    moved = scale_distance(make_plan(with_matrix=False), 2)
    assert [pose.T_world_camera for pose in moved.objects["crate"]] == [None] * 3
    assert [pose.distance_mm for pose in moved.objects["crate"]] == [800] * 3


def test_distance_once_is_the_plan_itself():
    plan = make_plan()
    assert scale_distance(plan, 1.0) is plan


@pytest.mark.parametrize("lens", [{"fov_deg": 40}, {"focal_mm": 30.0, "sensor_width_mm": 36.0}, {}])
def test_resolution_scales_the_intrinsics_and_every_pixel(lens):
    content = make_plan().model_dump(mode="json") | {"camera": {"width": 640, "height": 480, **lens}}
    plan = CapturePlan.model_validate(content)
    old, new = plan.camera, scale_resolution(plan, 160).camera
    for name, value in old.intrinsics.items():
        assert new.intrinsics[name] == pytest.approx(value / 4), name
    points = np.random.default_rng(0).uniform(-50, 50, (20, 3))
    for pose in plan.objects["crate"]:
        before, _ = project(old, pose.matrix(), points)
        after, _ = project(new, pose.matrix(), points)
        np.testing.assert_allclose(after, before / 4, atol=1e-9)


def test_resolution_that_no_camera_has_is_refused():
    with pytest.raises(ToolkitError, match=r"a resolution of 18×14 px: expected both sides between 16 and 16384 px"):
        scale_resolution(make_plan(), 18)
    assert scale_resolution(make_plan(), 22).camera == Camera.from_fov(22, 16, 40)


def test_default_values_are_those_of_the_studio_and_the_paper():
    assert parse_values(AXES["light"]) == list(TRAINED_LIGHTS)
    assert parse_values(AXES["backdrop"], []) == list(BACKDROPS)
    assert abs(PAPER_MM - 100 / 72 * 25.4 * 2.5) < 1e-3
    assert parse_values(AXES["size"])[-1] == PAPER_MM


def test_values_are_taken_once_and_numbers_in_order():
    assert parse_values(AXES["size"], ["60,22", "44.0", "60.0"]) == [22, 44, 60]
    assert parse_values(AXES["light"], ["warm", "dim,warm"]) == ["warm", "dim"]
    assert [AXES["size"].label(v) for v in (22.0, PAPER_MM)] == ["22mm", "88.194mm"]
    assert [AXES[name].label(2) for name in ("distance", "resolution", "seed")] == ["2x", "2px", "seed2"]


@pytest.mark.parametrize(
    ("axis", "value", "words"),
    [
        ("light", "dimm", r"no light called 'dimm': did you mean dim\?"),
        ("backdrop", "oaken", r"no backdrop called 'oaken': did you mean oak\?"),
        ("distance", "far", "values far: expected a factor of the plan's distance, a number from 0.1 to 20"),
        ("distance", "nan", "values nan: expected a factor"),
        ("distance", "-1", "values -1: expected a factor"),
        ("resolution", "64.5", "values 64.5: expected the picture's width in pixels, a whole number"),
        ("size", "0", "values 0: expected the printed side of the patch in mm, a number from 1 to 10000"),
        ("size", "", "values : expected the printed side"),
        ("seed", "-2", "values -2: expected a seed, a whole number from 0"),
    ],
)
def test_a_wrong_value_is_one_line_that_says_what_is_expected(axis, value, words):
    with pytest.raises(ToolkitError, match=words) as caught:
        parse_values(AXES[axis], [value])
    assert "\n" not in str(caught.value)


def test_an_unknown_axis_names_the_nearest():
    with pytest.raises(ToolkitError, match=r"no axis called 'ligth': did you mean light\?"):
        find_axis("ligth")
