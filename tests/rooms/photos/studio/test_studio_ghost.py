import io

import cv2
import numpy as np
import pytest
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.objects.load import load_object
from toolkit.rig.camera import project
from toolkit.rig.plan import read_plan
from toolkit.rooms.photos.gates import GateResult
from toolkit.rooms.photos.photo import read_photo
from toolkit.rooms.photos.studio.ghost import SIDE_PX, GhostRenderer, square_camera


@pytest.fixture
def artist(shot_space):
    return GhostRenderer(shot_space, read_plan(shot_space.plan_file))


def read_ghost(artist, variant, pose_id=1):
    return np.asarray(Image.open(io.BytesIO(artist.draw("crate", variant, pose_id))))


def corners_on(camera, pose, mesh):
    low, high = mesh.bounds
    box = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    return project(camera, pose.matrix(), box)[0]


@pytest.mark.parametrize("pose_id", [1, 2])
def test_the_ghost_fills_the_hull_of_the_projected_corners(artist, shot_space, pose_id):
    plan = read_plan(shot_space.plan_file)
    ghost = read_ghost(artist, "unpatched", pose_id)
    assert ghost.shape == (SIDE_PX, SIDE_PX, 4)
    pose = next(pose for pose in plan.objects["crate"] if pose.id == pose_id)
    mesh = load_object(shot_space.object_spec("crate")).mesh
    corners = corners_on(square_camera(plan.camera), pose, mesh)
    expected = np.zeros(ghost.shape[:2], np.uint8)
    cv2.fillConvexPoly(expected, cv2.convexHull(corners.astype(np.float32)).round().astype(np.int32), 1)
    drawn = ghost[..., 3] > 10
    grown, shrunk = cv2.dilate(expected, np.ones((21, 21))), cv2.erode(expected, np.ones((5, 5)))
    assert not (drawn & (grown == 0)).any() and drawn[shrunk == 1].mean() > 0.999
    bright = (ghost[..., :3].min(axis=-1) > 240) & (ghost[..., 3] > 200)
    rim = expected - cv2.erode(expected, np.ones((3, 3)))
    near = cv2.dilate(bright.astype(np.uint8), np.ones((7, 7)))
    assert near[rim == 1].mean() > 0.98 and not bright[grown == 0].any()


def test_the_square_is_the_middle_of_the_plans_frame(shot_space):
    camera = read_plan(shot_space.plan_file).camera
    pose = read_plan(shot_space.plan_file).objects["crate"][0]
    points = np.array([[40.0, -25.0, 10.0], [-50.0, 30.0, 40.0]])
    frame, square = project(camera, pose.matrix(), points)[0], project(square_camera(camera), pose.matrix(), points)[0]
    share = SIDE_PX / min(camera.width, camera.height)
    shift = (np.array([camera.width, camera.height]) - min(camera.width, camera.height)) / 2
    np.testing.assert_allclose(square, (frame - shift) * share, atol=1e-6)


def test_the_sheet_is_amber_and_only_there_when_it_is_on(artist):
    def amber(ghost):
        red, green, blue = (ghost[..., i].astype(int) for i in range(3))
        return ((red > 220) & (green > 150) & (blue < 110) & (ghost[..., 3] > 120)).sum()

    assert amber(read_ghost(artist, "unpatched")) == 0
    assert amber(read_ghost(artist, "patched")) > 300


def test_a_pose_that_is_not_there_is_said(artist):
    with pytest.raises(ToolkitError, match="no pose 9"):
        artist.draw("crate", "unpatched", 9)


def test_the_ghost_comes_over_the_wire(desk):
    answer = desk.client.get("/api/shots/1/ghost.png")
    assert answer.headers["content-type"] == "image/png" and answer.content.startswith(b"\x89PNG")


def test_the_real_inspector_judges_by_the_real_gates(desk, photo, tmp_path):
    from toolkit.rooms.photos.studio.inspection import Inspector

    step = desk.session.find_step(1)
    inspector = Inspector(desk.space, desk.session.plan)
    inspector.warm_up(step)
    found = {}
    for name, level in (("fine", 128), ("dark", 12)):
        (tmp_path / name).write_bytes(photo(level=level, size=(320, 240)))
        inspection = inspector.inspect(read_photo(tmp_path / name), step)
        found[name] = {one.name: one for one in inspection.results}
        assert all(isinstance(one, GateResult) for one in inspection.results)
        assert inspection.no_board == "no board is seen" and inspection.match is None
    assert found["dark"]["under-exposure"].failed and not found["fine"]["under-exposure"].failed
    assert found["fine"]["cut off"].status == "not checked"
