"""Many frames at once: the same bytes in the same order, however many threads, views or processes there are."""

import threading
import time

import numpy as np
import pytest

from toolkit.core.threads import map_ahead
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.lighting import BakeDetail
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.studio import make_studio

CAMERA = Camera.from_fov(48, 36, 40)
QUICK = BakeDetail(key_rays=4, room_rays=16, surface_spacing=0.08, table_spacing=0.08)
POSES = [orbit_pose(np.array([0, 0, 20.0]), 53 * i, 10 + 9 * i, 220) for i in range(9)]


def make_renderer(mesh) -> RaycastRenderer:
    return RaycastRenderer(mesh, make_studio(3, 100, "white"), QUICK)


@pytest.fixture(scope="module")
def renderer(make_box):
    return make_renderer(make_box())


@pytest.mark.parametrize("threads", [1, 2, 8])
@pytest.mark.parametrize("count", [0, 1, 2, 9])
def test_a_batch_has_the_bytes_of_single_frames_in_order(renderer, monkeypatch, threads, count):
    monkeypatch.setattr("toolkit.core.threads.count_cores", lambda: threads)
    alone = [renderer.render(CAMERA, pose) for pose in POSES[:count]]
    together = list(renderer.render_many((CAMERA, pose) for pose in POSES[:count]))
    assert [p.tobytes() for p in together] == [p.tobytes() for p in alone]
    assert len({p.tobytes() for p in alone}) == count


@pytest.mark.parametrize("threads", [1, 2, 8])
def test_a_batch_of_linear_views_has_the_bytes_of_single_ones_in_order(renderer, monkeypatch, threads):
    monkeypatch.setattr("toolkit.core.threads.count_cores", lambda: threads)
    texture = renderer._mesh.materials[0].texture
    alone = [renderer.render_linear(CAMERA, pose, texture).sha256 for pose in POSES[:5]]
    assert [view.sha256 for view in renderer.render_linear_many(CAMERA, POSES[:5], texture)] == alone
    assert len(set(alone)) == 5


def test_views_of_several_sizes_come_in_order(renderer):
    cameras = [Camera.from_fov(16 + 8 * i, 12, 40) for i in range(6)]
    shapes = [picture.shape for picture in renderer.render_many((camera, POSES[0]) for camera in cameras)]
    assert shapes == [(12, 16 + 8 * i, 3) for i in range(6)]


def test_frames_come_in_order_when_the_first_takes_longest():
    assert list(map_ahead(lambda i: time.sleep(0.05 * (i == 0)) or i, range(20), threads=8)) == list(range(20))


def test_frames_are_made_side_by_side():
    """Each waits for the other: one thread alone would never end."""
    both = threading.Barrier(2, timeout=10)
    assert sorted(map_ahead(lambda i: both.wait() * 0 + i, range(4), threads=2)) == [0, 1, 2, 3]


@pytest.mark.parametrize("threads", [1, 2, 8])
def test_an_error_in_one_frame_reaches_the_caller_after_the_frames_before_it(threads):
    made, seen = [], []

    def make(i: int) -> int:
        made.append(i)
        if i == 5:
            raise ValueError("frame 5")
        return i

    with pytest.raises(ValueError, match=r"^frame 5$"):
        for i in map_ahead(make, range(1000), threads):
            seen.append(i)
    assert seen == [0, 1, 2, 3, 4]
    assert len(made) < 6 + 3 * threads + 1  # and the rest is not made


def test_an_error_among_the_views_reaches_the_caller():
    def views():
        yield 1
        raise KeyError("views")

    with pytest.raises(KeyError, match="views"):
        list(map_ahead(str, views(), threads=2))


def test_a_bad_camera_in_a_batch_is_the_one_clear_line_of_a_single_frame(renderer):
    from toolkit.core.errors import ToolkitError

    nowhere = POSES[0].copy()
    nowhere[0, 3] = np.nan
    pictures = renderer.render_many((CAMERA, pose) for pose in (POSES[0], nowhere, POSES[1]))
    assert np.isfinite(next(pictures)).all()
    with pytest.raises(ToolkitError, match="the camera stands at"):
        next(pictures)


def test_a_batch_that_is_left_early_stops_working():
    made, asked = [], []

    def views():
        for i in range(1000):
            asked.append(i)
            yield i

    before = threading.active_count()
    frames = map_ahead(lambda i: made.append(i) or i, views(), threads=2)
    assert [next(frames), next(frames)] == [0, 1]
    frames.close()
    count = len(made)
    assert count <= len(asked) <= 2 + 2 * 2 + 1  # two for each thread are made ahead
    time.sleep(0.05)
    assert len(made) == count and threading.active_count() == before


def test_nothing_is_made_before_it_is_asked_for():
    made = []
    map_ahead(made.append, range(5), threads=2)
    assert made == []
