"""Views of the mounted sheet: where samples land, and what depends on what."""

import numpy as np
import pytest

from toolkit.rig.mounted import render_mounted_views


@pytest.fixture(scope="module")
def space(tmp_path_factory, make_crate_space):
    return make_crate_space(tmp_path_factory.mktemp("views"))


@pytest.fixture(scope="module")
def views(space):
    return list(render_mounted_views(space, "crate", 40.0, 2, 3, 40, quiet=True))


def test_gain_is_where_samples_see_the_patch(views):
    for view in views:
        seen = ~np.isnan(view.uv[..., 0])
        assert view.gain[~seen.any(axis=0)].max() == 0
        assert view.gain[seen.all(axis=0)].min() > 0  # some light falls on all of it
        inside = view.uv[seen]
        assert inside.min() >= 0
        assert inside.max() <= 1
        assert np.ptp(inside, axis=0).min() > 0.8  # the whole patch is in the picture


def test_a_view_depends_on_seed_and_number_alone(space, views):
    (first,) = render_mounted_views(space, "crate", 40.0, 1, 3, 40, quiet=True)
    np.testing.assert_array_equal(first.dark, views[0].dark)
    np.testing.assert_array_equal(first.uv, views[0].uv)
    (other,) = render_mounted_views(space, "crate", 40.0, 1, 4, 40, quiet=True)
    assert np.abs(other.dark - first.dark).max() > 0.01
