"""Views rendered ahead: who renders them, and when, changes nothing."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from toolkit.boosters.linear_view import batch_views, show_texture
from toolkit.objects.atlas import make_atlas
from toolkit.objects.load import load_object
from toolkit.rig.renderers import RENDERERS
from toolkit.rig.views import (
    HELD_OUT,
    TRAIN,
    PaintableObject,
    ViewRanges,
    ViewSettings,
    ViewStream,
    random_pose,
    render_block,
)

SETTINGS = ViewSettings(image_px=32, studios=2, per_studio=2)


@pytest.fixture(scope="module")
def subject(tmp_path_factory, make_crate_space):
    mesh = load_object(make_crate_space(tmp_path_factory.mktemp("stream")).object_spec("crate")).mesh
    atlas = make_atlas(mesh, 16)
    return PaintableObject(atlas.mesh, int(atlas.mesh.face_material[0]), mesh)


def same(one, other) -> bool:
    parts = all(np.array_equal(a, b) for a, b in zip(vars(one.view).values(), vars(other.view).values(), strict=True))
    return parts and one.subject == other.subject and np.array_equal(one.bare, other.bare)


@pytest.mark.slow
def test_threads_render_what_the_asker_renders(subject):
    with ViewStream([subject], SETTINGS, 5, 3, workers=2) as stream:
        ahead = [stream.group(0), stream.group(1)]
        held_out = stream.held_out(1)
    with ViewStream([subject], SETTINGS, 5, 3, workers=0) as stream:
        later = stream.group(1)  # as a run does that goes on there
        assert all(same(a, b) for a, b in zip(ahead[1], later, strict=True))
        assert all(same(a, b) for a, b in zip(ahead[0], stream.group(0), strict=True))
        assert all(same(a, b) for a, b in zip(held_out, stream.held_out(1), strict=True))
    assert len(later) == 4
    assert held_out[0].bare is not None and later[0].bare is None


def test_blocks_differ_by_number_kind_and_seed(subject):
    first = render_block((subject,), SETTINGS, 5, TRAIN, 0)
    for seed, kind, block in ((5, TRAIN, 1), (5, HELD_OUT, 0), (6, TRAIN, 0)):
        other = render_block((subject,), SETTINGS, seed, kind, block)
        assert not any(a.view.dark.shape == b.view.dark.shape and np.array_equal(a.view.dark, b.view.dark)
                       for a in first for b in other)  # fmt: skip


def test_training_views_by_another_renderer_show_the_texture_that_they_are_given(subject, monkeypatch):
    """The ray caster under another name: its pictures are those of its own linear views."""
    monkeypatch.setitem(RENDERERS, "other", replace(RENDERERS["raycast"], version=9))
    pixels = np.random.default_rng(0).integers(0, 256, (16, 16, 3), dtype=np.uint8)
    texture = torch.from_numpy(pixels.transpose(2, 0, 1)).float() / 255
    with ViewStream([subject], SETTINGS, 5, 1, workers=0, renderer="other") as stream:
        views = [one.view for one in stream.group(0)]
        held_out = stream.held_out(1)
    assert all(one.view.repaint is None for one in held_out) and all(view.repaint is not None for view in views)
    shown, expected = (
        show_texture(texture, batch_views(some, "cpu"))
        for some in (views, [replace(view, repaint=None) for view in views])
    )
    assert (shown - expected).abs().mean() < 0.004
    assert views[0].sha256 == replace(views[0], repaint=None).sha256


def test_successive_blocks_show_successive_objects(subject):
    with ViewStream([subject, subject, subject], SETTINGS, 5, 2, workers=0) as stream:
        assert [view.subject for view in stream.group(0)] == [0, 0, 1, 1]
        assert [view.subject for view in stream.group(1)] == [2, 2, 0, 0]


def test_the_whole_sphere_is_covered_evenly(subject):
    """Elevations of points that are even over a sphere have uniform sines."""
    camera_z, sphere = [], ViewRanges((-90.0, 90.0), (-180.0, 180.0), (0.35, 0.95), 0.15, evenly=True)
    for i in range(600):
        pose = random_pose(np.random.default_rng([9, i]), subject.bare.vertices, _camera(), sphere)
        camera_z.append(-pose[2, 2])  # the sine of the elevation that it looks down from
    share = np.histogram(camera_z, 5, (-1, 1))[0] / len(camera_z)
    assert np.abs(share - 0.2).max() < 0.06


def _camera():
    from toolkit.rig.camera import Camera

    return Camera.from_fov(32, 32, 30.0)
