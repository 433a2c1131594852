"""Cameras where nobody would put one: a finite picture, or one clear line; no warning, no NaN, no endless wait."""

import time
import warnings

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.rig.camera import Camera, look_at, orbit_pose
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.studio import make_studio

CAMERA = Camera.from_fov(64, 48, 40)
MIDDLE = np.array([0, 0, 20.0])


@pytest.fixture(scope="module")
def boxed(make_box):
    """A box of 100 × 60 × 40 mm."""
    return RaycastRenderer(make_box(), make_studio(0, 100, "white"))


def take(renderer: RaycastRenderer, pose: np.ndarray, camera: Camera = CAMERA) -> np.ndarray:
    """A picture, with every floating-point error and warning raised."""
    with warnings.catch_warnings(), np.errstate(all="raise", under="ignore"):
        warnings.simplefilter("error")
        return renderer.render(camera, pose)


def check_picture(picture: np.ndarray) -> None:
    assert picture.shape == (48, 64, 3) and picture.dtype == np.float32
    assert np.isfinite(picture).all() and picture.min() >= 0


PLACES = {
    "inside the object": look_at(MIDDLE, np.array([50.0, 10, 20])),
    "inside the object, upwards": look_at(MIDDLE, MIDDLE + np.array([0, 0, 1.0])),
    "on its surface": look_at(np.array([50.0, 0, 20]), np.array([100.0, 0, 20])),
    "on its surface, inwards": look_at(np.array([50.0, 0, 20]), MIDDLE),
    "on the table, level": look_at(np.array([300.0, 0, 0]), np.array([0, 0, 0.0])),
    "below the table, looking up": look_at(np.array([200.0, 50, -300]), MIDDLE),
    "below the table, looking down": look_at(np.array([200.0, 50, -300]), np.array([0, 0, -900.0])),
    "straight above": look_at(np.array([0, 0, 500.0]), MIDDLE),
    "straight above, at the sky": look_at(np.array([0, 0, 500.0]), np.array([0, 0, 900.0])),
    "beside the table's edge": orbit_pose(MIDDLE, 40, 3, 3000),
    "far behind the room": orbit_pose(MIDDLE, 200, 30, 1e6),
    "a kilometre away, looking away": look_at(np.array([1e6, 0, 1e5]), np.array([2e6, 0, 0])),
}


@pytest.mark.parametrize("place", PLACES)
def test_wherever_the_camera_stands_there_is_a_finite_picture(boxed, place):
    check_picture(take(boxed, PLACES[place]))


def test_inside_the_object_every_pixel_shows_its_walls(boxed):
    """They are lit from nowhere: darker than the same walls from outside."""
    inside = take(boxed, PLACES["inside the object"])
    outside = take(boxed, orbit_pose(MIDDLE, 40, 30, 300))
    assert inside.max() < outside[24, 32].max()


def test_far_away_the_room_is_what_it_is_from_near(boxed):
    """It is at no distance: looking up, a camera sees the same from everywhere."""
    up = np.array([0.3, 0.2, 1.0])
    near, far = (take(boxed, look_at(np.array(at), at + up)) for at in ((0, 0, 500.0), (4e4, -3e4, 2e4)))
    np.testing.assert_allclose(near, far, atol=2e-3)


def test_an_object_out_of_view_leaves_the_table_and_the_room(boxed, make_box):
    away = look_at(np.array([150.0, 0, 60]), np.array([400.0, 0, 0]))
    dark = RaycastRenderer(make_box(paint=(10, 10, 10)), make_studio(0, 100, "white"))
    check_picture(take(boxed, away))
    np.testing.assert_allclose(take(boxed, away), take(dark, away), atol=0.05)  # but for light off its sides


def test_an_object_over_the_whole_frame_hides_what_is_behind(boxed, make_box):
    pose = look_at(np.array([0, 0, 55.0]), np.array([1.0, 0, 40]))
    picture = take(boxed, pose)
    check_picture(picture)
    dark = take(RaycastRenderer(make_box(paint=(0, 0, 0)), make_studio(0, 100, "white")), pose)
    assert dark.max() < 0.35 * picture.min()  # black paint everywhere: no pixel shows the white table


@pytest.mark.parametrize("distance_mm", [1e9, 1e20, 1e37, 1e300])
@pytest.mark.parametrize("looks", ["at it", "away"])
def test_a_camera_far_out_of_the_world_shows_something_finite_or_says_no(boxed, distance_mm, looks):
    pose = orbit_pose(np.zeros(3), 30, 40, 1.0)
    pose[:3, 3] *= distance_mm
    if looks == "away":
        pose[:3, 0] *= -1
        pose[:3, 2] *= -1
    start = time.monotonic()
    try:
        check_picture(take(boxed, pose))
    except ToolkitError as error:
        assert "\n" not in str(error) and "camera" in str(error)
    assert time.monotonic() - start < 20


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", [(0, 3), (1, 1), (2, 2)])
def test_a_pose_that_is_no_number_is_one_clear_line(boxed, bad, place):
    pose = orbit_pose(MIDDLE, 30, 40, 300)
    pose[place] = bad
    with pytest.raises(ToolkitError, match=r"camera.*(finite|NaN|infinite|number)") as caught:
        take(boxed, pose)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("fov_deg", [0.01, 170.0])
def test_the_narrowest_and_the_widest_lens_see_something_finite(boxed, fov_deg):
    check_picture(take(boxed, orbit_pose(MIDDLE, 30, 40, 300), Camera.from_fov(64, 48, fov_deg)))


def test_a_lens_that_looks_beside_its_own_axis_is_no_trouble(boxed):
    """A crop far off the principal point."""
    check_picture(take(boxed, orbit_pose(MIDDLE, 30, 40, 300), CAMERA.cropped(2000, -1500, 64, 48)))
