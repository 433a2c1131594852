"""`transforms.json`: the cameras as nerfstudio and OpenGL have them."""

import json

import numpy as np
import pytest

from toolkit.captures.manifest import CaptureRecord, describe_transforms, to_opengl, write_transforms
from toolkit.rig.camera import Camera, orbit_pose, project

CAMERA = Camera.from_fov(160, 120, 45)


def record(name, T_world_camera, camera=CAMERA):
    return CaptureRecord(
        path=f"crate/patched/{name}.jpg", object="crate", variant="patched",
        T_world_camera=None if T_world_camera is None else T_world_camera.tolist(),
        intrinsics=camera.intrinsics,
    )  # fmt: skip


def test_axes_are_opengls_and_lengths_metres():
    T_world_camera = orbit_pose(np.array([0, 0, 30.0]), 50, 35, 400)
    matrix = to_opengl(T_world_camera)
    np.testing.assert_allclose(matrix[:3, 3] * 1000, T_world_camera[:3, 3])
    back = T_world_camera[:3, 3] - [0, 0, 30.0]
    np.testing.assert_allclose(matrix[:3, 2], back / np.linalg.norm(back))  # looks along -z
    assert matrix[2, 1] > 0.5 and matrix[2, 0] == pytest.approx(0)  # y is up, x level
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)


def test_a_viewer_projects_as_the_rig_does(tmp_path):
    """OpenGL's own way: into the camera, y up and -z ahead, then u = cx + fl x / -z, v = cy - fl y / -z."""
    T_world_camera = orbit_pose(np.zeros(3), 200, 20, 300, 15)
    (file,) = write_transforms(tmp_path, [record("a", T_world_camera)])
    content = json.loads(file.read_text())
    (frame,) = content["frames"]
    points = np.random.default_rng(0).uniform(-40, 40, (20, 3))
    local = np.linalg.inv(np.array(frame["transform_matrix"])) @ np.c_[points / 1000, np.ones(20)].T
    u = content["cx"] + content["fl_x"] * local[0] / -local[2]
    v = content["cy"] - content["fl_y"] * local[1] / -local[2]
    expected, _ = project(CAMERA, T_world_camera, points)
    np.testing.assert_allclose(np.stack([u, v], axis=1), expected, atol=1e-6)
    assert (content["w"], content["h"], content["camera_model"]) == (160, 120, "OPENCV")
    assert frame["file_path"] == "a.jpg" and file == tmp_path / "crate/patched/transforms.json"


def test_other_lenses_are_written_per_frame_and_unknown_cameras_left_out():
    """None stands at the top, where nerfstudio would take it for all."""
    pose = orbit_pose(np.zeros(3), 0, 30, 300)
    other = Camera.from_fov(320, 200, 60)
    content = describe_transforms([record("a", pose), record("b", pose, other), record("c", None)])
    assert [frame["file_path"][-5:] for frame in content["frames"]] == ["a.jpg", "b.jpg"]
    assert sorted(content) == ["camera_model", "frames"]
    assert [frame["w"] for frame in content["frames"]] == [160, 320]
    assert content["frames"][1]["fl_x"] == pytest.approx(160 / np.tan(np.radians(30)))
    assert describe_transforms([record("c", None)])["frames"] == []


def test_the_distortion_of_a_photograph_is_kept():
    """Frames of lenses that differ in it alone differ, and a single lens has it at the top."""
    pose = orbit_pose(np.zeros(3), 0, 30, 300)
    bent = record("b", pose).model_copy(update={"made": {"distortion": [0.1, -0.2, 0.001, -0.002, 0.05]}})
    first, second = describe_transforms([record("a", pose), bent])["frames"]
    names = ("k1", "k2", "p1", "p2", "k3")
    assert [second[name] for name in names] == [0.1, -0.2, 0.001, -0.002, 0.05]
    assert [first.get(name) for name in names] == [0, 0, 0, 0, None]
    assert describe_transforms([bent])["k1"] == 0.1
    with pytest.raises(ValueError, match="up to five numbers"):
        CaptureRecord.model_validate(bent.model_dump() | {"made": {"distortion": [0.1] * 8}})


def test_objects_and_variants_that_stand_at_one_origin_are_kept_apart(tmp_path):
    """A radiance field of several at once would be one ghost; the joined file of an earlier version goes."""
    (tmp_path / "transforms.json").write_text("{}")
    pose = orbit_pose(np.zeros(3), 0, 30, 300)
    paths = ("crate/patched/a.jpg", "crate/unpatched/a.jpg", "mug/patched/a.jpg", "mug/patched/b.jpg")
    records = [record("x", pose).model_copy(update={"path": path, "object": path.split("/")[0]}) for path in paths]
    files = write_transforms(tmp_path, records)
    assert sorted(file.relative_to(tmp_path).as_posix() for file in tmp_path.rglob("transforms.json")) == [
        f"{folder}/transforms.json" for folder in ("crate/patched", "crate/unpatched", "mug/patched")
    ]
    assert [len(json.loads(file.read_text())["frames"]) for file in files] == [1, 1, 2]
