"""Small renders to train a classifier on."""

import numpy as np
import pytest

from toolkit.objects.load import load_object
from toolkit.rig.camera import Camera, project
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.studio import make_studio
from toolkit.rig.views import (
    THUMBNAIL_DETAIL,
    THUMBNAIL_STUDIO,
    WIDE_VIEWS,
    ViewSettings,
    random_pose,
    render_pictures,
)

CAMERA = Camera.from_fov(48, 48, 30.5)


def take(mesh, count, seed):
    settings = ViewSettings(WIDE_VIEWS, 48, per_studio=count)
    return np.stack(list(render_pictures(mesh, count, settings, seed, setting=THUMBNAIL_STUDIO, threads=1)))


@pytest.mark.slow
def test_all_depends_on_the_seed(make_box):
    mesh = make_box()
    one, again, other = (take(mesh, 3, (seed, 7)) for seed in (1, 1, 2))
    assert one.shape == (3, 48, 48, 3) and one.dtype == np.uint8
    np.testing.assert_array_equal(one, again)
    assert all(np.abs(one[i].astype(int) - other[j]).mean() > 5 for i in range(3) for j in range(3))
    fewer = take(mesh, 2, (1, 7))
    np.testing.assert_array_equal(fewer, one[:2])


def test_poses_fill_the_wide_ranges(make_box):
    mesh = make_box()
    rng = np.random.default_rng(0)
    poses = [random_pose(rng, mesh.vertices, CAMERA, WIDE_VIEWS) for _ in range(400)]
    positions = np.array([pose[:3, 3] for pose in poses]) - [0, 0, mesh.size_mm[2] / 2]
    elevation = np.degrees(np.arcsin(positions[:, 2] / np.linalg.norm(positions, axis=1)))
    assert elevation.min() < 12 and 72 < elevation.max() < 88
    spans = []
    for pose in poses:
        pixels, depth = project(CAMERA, pose, mesh.vertices)
        assert (depth > 0).all()
        spans.append(np.ptp(pixels, axis=0).max() / 48)
    assert 0.2 < min(spans) < 0.4 and 0.9 < max(spans) < 1.3


@pytest.mark.slow
def test_coarse_light_is_close_to_the_full_one(tmp_path, make_crate_space):
    mesh = load_object(make_crate_space(tmp_path).object_spec("crate")).mesh
    studio = make_studio(3, 100.0)
    pose = random_pose(np.random.default_rng(1), mesh.vertices, CAMERA)
    full, coarse = (RaycastRenderer(mesh, studio, *detail).render(CAMERA, pose) for detail in ((), (THUMBNAIL_DETAIL,)))
    assert np.abs(full - coarse).mean() < 0.02 < full.mean()
    assert np.abs(full - coarse).max() > 0
