"""Views of the mounted sheet: where samples land, and what depends on what."""

import numpy as np
import pytest

from toolkit.boosters.mounted import render_mounted_views
from toolkit.objects.load import load_object


@pytest.fixture(scope="module")
def crate(tmp_path_factory, make_crate_space):
    return load_object(make_crate_space(tmp_path_factory.mktemp("views")).object_spec("crate"))


@pytest.fixture(scope="module")
def views(crate):
    return render_mounted_views(crate, [40.0], 64, 2, seed=3, image_px=40)


def test_gain_is_where_samples_see_the_sheet(views):
    for view in views:
        assert view.gain.min() >= 0
        assert view.gain.max(axis=1).min() > 0  # some light falls on all of it
        assert view.uv.min() >= 0
        assert view.uv.max() <= 1
        assert np.ptp(view.uv, axis=0).min() > 0.9  # the whole sheet is in the picture
        assert view.coverage.reshape(-1)[view.pixel].min() > 0  # it lies on the object
        assert np.bincount(view.pixel).max() == 4  # paper is seen by four samples to a pixel
        shared = np.bincount(view.pixel, view.share, view.coverage.size)
        np.testing.assert_allclose(shared[view.pixel], view.coverage.reshape(-1)[view.pixel], rtol=1e-6)


@pytest.mark.slow
def test_a_view_depends_on_seed_and_number_alone(crate, views):
    (first,) = render_mounted_views(crate, [40.0], 64, 1, seed=3, image_px=40)
    np.testing.assert_array_equal(first.dark, views[0].dark)
    np.testing.assert_array_equal(first.uv, views[0].uv)
    assert first.sha256 == views[0].sha256 != views[1].sha256
    (other,) = render_mounted_views(crate, [40.0], 64, 1, seed=4, image_px=40)
    assert np.abs(other.dark - first.dark).max() > 0.01
