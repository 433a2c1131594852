"""Camera poses against OpenCV's projection, and against the geometry of a sheet seen from an angle."""

import cv2
import numpy as np
import pytest
import torch

from toolkit.boosters.transforms.placement import (
    AffineRanges,
    MixedPlacement,
    PoseRanges,
    Sheet,
    angle_above,
    box_corners,
    draw_sheet,
    project_sheet,
)
from toolkit.boosters.transforms.show import Appearance, show_patch
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.rig.camera import Camera, distance_to_fill, orbit_pose

N, M = 100, 224
TEXELS = np.array([[0, 0], [N, 0], [N, N], [0, N], [N / 2, N / 2], [20, 70]], float)


def send(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    x, y, w = T @ np.vstack([points.T, np.ones(len(points))])
    assert (w > 0).all(), "the sheet lies before the camera"
    return np.stack([x / w, y / w], axis=1)


def place(count: int = 300, **ranges) -> np.ndarray:
    return PoseRanges(**ranges).place(np.random.default_rng(5), count, N, M)


def corners_of(T: np.ndarray) -> np.ndarray:
    return np.stack([send(one, TEXELS[:4]) for one in T])


def area(corners: np.ndarray) -> float:
    x, y = corners.T
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2


def test_a_sheet_is_projected_as_opencv_does():
    rng = np.random.default_rng(0)
    for _ in range(20):
        camera = Camera.from_fov(M, M, rng.uniform(20, 70))
        box = rng.uniform(50, 300, 3)
        azimuth, elevation = rng.uniform(0, 360), rng.uniform(25, 85)
        sheet = draw_sheet(rng, box, 80.0, 0.3, rng.uniform(0, 10))
        T_world_camera = orbit_pose(np.array([5.0, -8, 40]), azimuth, elevation, 700.0, rng.uniform(-30, 30))
        across, down = (TEXELS / N - 0.5).T * 80.0
        world = sheet.middle + across[:, None] * sheet.right - down[:, None] * sheet.up
        T_camera_world = np.linalg.inv(T_world_camera)
        turn, _ = cv2.Rodrigues(T_camera_world[:3, :3])
        wanted, _ = cv2.projectPoints(world, turn, T_camera_world[:3, 3], camera.matrix, None)
        np.testing.assert_allclose(
            send(project_sheet(camera, T_world_camera, sheet, N), TEXELS), wanted[:, 0], atol=1e-6
        )


def test_the_sheet_is_a_square_of_its_size_on_top_of_the_box_and_its_slope_is_the_tilt():
    box, rng = np.array([300.0, 200, 90]), np.random.default_rng(1)
    for _ in range(50):
        tilt = rng.uniform(0, 10)
        sheet = draw_sheet(rng, box, 70.0, 0.2, tilt)
        normal = np.cross(sheet.right, sheet.up)
        assert np.degrees(np.arccos(normal[2])) == pytest.approx(tilt, abs=1e-6)
        sides = np.linalg.norm(np.diff(sheet.corners, axis=0), axis=1)
        np.testing.assert_allclose(sides, 70)
        assert sheet.middle[2] == 90
        assert (np.abs(sheet.middle[:2]) <= 0.2 * box[:2]).all()


def test_a_sheet_is_never_seen_from_behind_nor_grazing():
    """A high box, near and low: many cameras stand below its top; those draws are made again."""
    steep = {"tilt_deg": (30, 40), "elevation_deg": (20, 40), "height": (0.8, 0.8), "fov_deg": (50, 60)}
    assert all(area(corners) > 0 for corners in corners_of(place(100, **steep)))
    with pytest.raises(ToolkitError, match="no camera sees the sheet at more than 12°"):
        place(1, elevation_deg=(12, 13), height=(1, 1), fov_deg=(90, 90), tilt_deg=(0, 0))


def test_the_angle_above_a_level_sheet_is_the_elevation():
    sheet = Sheet(np.zeros(3), np.array([0.0, -1, 0]), np.array([1.0, 0, 0]), 10.0)
    for elevation in (-20, 5, 70):
        assert angle_above(sheet, orbit_pose(np.zeros(3), 33, elevation, 400.0)[:3, 3]) == pytest.approx(elevation)


def test_from_the_front_the_sheets_upper_edge_is_the_nearer_one():
    """Azimuth 0 sees the object's front, to which the sheet's up points: it is seen upside down."""
    (T,) = place(1, azimuth_deg=(0, 0), tilt_deg=(0, 0), roll_deg=(0, 0), offset=0, elevation_deg=(40, 40))
    ((upper_left, upper_right, lower_right, _),) = corners_of(T[None])
    assert upper_left[1] > lower_right[1]
    assert upper_left[0] > upper_right[0]
    assert abs(upper_left[0] - upper_right[0]) > 0
    (T,) = place(1, azimuth_deg=(180, 180), tilt_deg=(0, 0), roll_deg=(0, 0), offset=0, elevation_deg=(40, 40))
    ((upper_left, upper_right, lower_right, _),) = corners_of(T[None])
    assert upper_left[1] < lower_right[1]
    assert upper_left[0] < upper_right[0]


@pytest.mark.parametrize("elevation", [25.0, 45.0, 65.0])
def test_from_afar_foreshortening_is_the_sine_of_the_elevation(elevation):
    still = {"tilt_deg": (0, 0), "roll_deg": (0, 0), "fov_deg": (1, 1), "offset": 0}
    for corners in corners_of(place(10, elevation_deg=(elevation, elevation), **still)):
        singular = np.linalg.svd(np.stack([corners[1] - corners[0], corners[2] - corners[1]]), compute_uv=False)
        assert singular[1] / singular[0] == pytest.approx(np.sin(np.radians(elevation)), rel=0.02)


def test_from_above_and_afar_the_patch_has_its_share_of_the_objects_length():
    still = {"tilt_deg": (0, 0), "fov_deg": (1, 1), "elevation_deg": (90, 90), "fill": (0.8, 0.8), "offset": 0}
    corners = corners_of(place(20, size_mm=90, length_mm=300, azimuth_deg=(0, 0), roll_deg=(0, 0), **still))
    sides = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    np.testing.assert_allclose(sides, 90 / 300 * 0.8 * M, rtol=0.02)


def test_nothing_leaves_the_frame_and_no_sheet_is_mirrored():
    corners = corners_of(place())
    assert corners.min() > 0
    assert corners.max() < M
    assert all(area(one) > 0 for one in corners)
    centres = corners.mean(axis=1)
    assert np.ptp(centres[:, 0]) > 0.3 * M, "the object is not always in the middle"


def test_the_box_reaches_across_the_share_asked_for():
    box, camera = np.array([300.0, 120, 80]), Camera.from_fov(M, M, 40)
    points, middle = box_corners(box), np.array([0, 0, 40.0])
    distance = distance_to_fill(camera, points, middle, 70, 35, 0.7)
    T_camera_world = np.linalg.inv(orbit_pose(middle, 70, 35, distance))
    seen, _ = cv2.projectPoints(
        points, cv2.Rodrigues(T_camera_world[:3, :3])[0], T_camera_world[:3, 3], camera.matrix, None
    )
    assert np.abs(seen[:, 0] - M / 2).max() == pytest.approx(0.7 * M / 2, rel=1e-6)


def test_share_of_poses_in_a_mixture():
    for probability, low, high in ((0, 0, 0), (0.5, 60, 140), (1, 200, 200)):
        mixed = MixedPlacement(PoseRanges(probability=probability), AffineRanges())
        T = mixed.place(np.random.default_rng(0), 200, N, M)
        projective = (np.abs(T[:, 2, :2]) > 1e-12).any(axis=1).sum()
        assert low <= projective <= high


def test_the_patch_is_drawn_where_its_corners_are_sent():
    images = torch.zeros(4, 3, M, M)
    poses = PoseRanges()
    shown = show_patch(torch.ones(3, N, N), images, Appearance(poses), Draws(0, 0))[:, 0].numpy()
    corners = corners_of(poses.place(Draws(0, 0).of("PoseRanges"), 4, N, M))
    for photo, one in zip(shown, corners, strict=True):
        assert photo.sum() == pytest.approx(area(one), rel=0.05)


def test_a_sheet_knows_its_corners():
    sheet = Sheet(np.array([1.0, 2, 3]), np.array([0.0, -1, 0]), np.array([1.0, 0, 0]), 10.0)
    np.testing.assert_allclose(sheet.corners[0], [6, 7, 3])  # up is +x, left is +y


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ({"elevation_deg": (0, 60)}, "elevation_deg 0 60: expected two rising numbers from 12 to 90"),
        ({"fill": (0.5, 1.5)}, "fill 0.5 1.5: expected"),
        ({"size_mm": 400}, "length_mm 270: expected no less than the patch on it, 400.0 mm"),
        ({"length_mm": float("nan")}, "length_mm nan: expected"),
        ({"roll_deg": (5, -5)}, "roll_deg 5 -5: expected"),
        ({"fov_deg": (0, 40)}, "fov_deg 0 40: expected"),
        ({"probability": 1.5}, "probability 1.5: expected 0 to 1"),
        ({"offset": 0.7}, "offset 0.7: expected 0 to 0.5"),
    ],
)
def test_impossible_ranges_are_one_clear_line(ranges, words):
    with pytest.raises(ToolkitError, match=words) as caught:
        PoseRanges(**ranges)
    assert "\n" not in str(caught.value)
