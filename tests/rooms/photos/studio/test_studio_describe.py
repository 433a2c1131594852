from types import SimpleNamespace

import pytest

from toolkit.rig.camera import orbit_pose
from toolkit.rig.plan import Pose
from toolkit.rooms.photos.gates import Gate
from toolkit.rooms.photos.locate import match_pose
from toolkit.rooms.photos.studio.describe import describe_gate, describe_inspection, say_moves
from toolkit.rooms.photos.studio.inspection import Inspection

MIDDLE = (0.0, 0.0, 40.0)
POSES = [
    Pose(id=i + 1, azimuth_deg=a, elevation_deg=30, distance_mm=500, target_mm=MIDDLE) for i, a in enumerate((0, 90))
]


def stand(azimuth=0.0, elevation=30.0, roll=0.0):
    return orbit_pose(MIDDLE, azimuth, elevation, 500, roll)


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        (stand(), []),
        (stand(azimuth=4), []),
        # who faces the front has azimuth 90 on the right hand
        (stand(azimuth=20), ["go 20° round to the left"]),
        (stand(azimuth=-20), ["go 20° round to the right"]),
        (stand(elevation=45), ["go 15° lower"]),
        (stand(elevation=15), ["go 15° higher"]),
        (stand(roll=12), ["turn the camera 12° level"]),
    ],
)
def test_the_way_to_the_pose_is_said_as_one_walks_it(camera, words):
    assert say_moves(match_pose(camera, POSES[:1])) == words


def inspection_at(camera):
    return Inspection("ab", (), SimpleNamespace(), "", match_pose(camera, POSES[:1]), match_pose(camera, POSES), 1.0)


def test_a_camera_at_another_pose_speaks_against_keeping():
    assert inspection_at(stand(5)).good
    wrong = inspection_at(stand(88))
    assert not wrong.good and wrong.wrong_pose == "the board shows that this is nearer to pose 2"
    assert describe_inspection(wrong)["pose"]["wrong"] == wrong.wrong_pose


def test_a_value_that_is_no_number_becomes_null():
    gate = Gate("g", 1.0, "px", "advice")
    assert describe_gate(gate.judge(float("inf")))["value"] is None
    assert describe_gate(gate.judge(0.5))["value"] == 0.5
