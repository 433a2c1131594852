"""Patterns of camera positions."""

from typing import get_args

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.rig import Pattern
from toolkit.rig.camera import orbit_direction
from toolkit.rig.plan import PATTERNS, spread_poses

NAMES = list(PATTERNS)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("count", "elevations"), [(1, (25, 65)), (2, (0, 90)), (5, (40, 40)), (7, (0, 90)), (18, (40, 40)), (97, (25, 65))]
)
def test_as_many_as_asked_for_in_range_and_all_different(name, count, elevations):
    angles = spread_poses(Pattern(name=name, count=count, elevation_deg=elevations))
    assert angles.shape == (count, 2)
    assert (angles[:, 0] >= 0).all() and (angles[:, 0] < 360).all()
    assert (angles[:, 1] >= elevations[0] - 1e-9).all() and (angles[:, 1] <= elevations[1] + 1e-9).all()
    assert len(np.unique(angles.round(6), axis=0)) == count


def test_a_ring_has_one_elevation_and_equal_steps():
    angles = spread_poses(Pattern(name="ring", count=8, elevation_deg=(20, 50)))
    assert set(angles[:, 1]) == {35}
    np.testing.assert_allclose(np.diff(angles[:, 0]), 45)


@pytest.mark.parametrize("name", ["hemisphere", "fibonacci"])
def test_spread_patterns_cover_the_sphere_evenly(name):
    """Directions as dense near the pole as near the horizon: the mean height of an even spread is the middle height."""
    angles = spread_poses(Pattern(name=name, count=200, elevation_deg=(0, 90)))
    directions = np.stack([orbit_direction(a, e) for a, e in angles])
    assert directions[:, 2].mean() == pytest.approx(0.5, abs=0.02)
    assert np.abs(directions[:, :2].mean(axis=0)).max() < 0.03
    nearest = np.sort(np.arccos(np.clip(directions @ directions.T, -1, 1)), axis=1)[:, 1]
    alone = np.sqrt(2 * np.pi / 200)  # spacing of a square net with the same density
    assert 0.35 * alone < nearest.min() and nearest.max() < 1.5 * alone


@pytest.mark.parametrize("count", [*range(1, 8), 11, 13, 24])
def test_a_grid_of_any_count_looks_from_all_sides(count):
    azimuths = np.unique(np.round(spread_poses(Pattern(count=count))[:, 0], 6))
    gaps = np.diff([*azimuths, azimuths[0] + 360])
    assert gaps.max() <= max(360 / count, 90) + 1e-6


def test_a_spiral_leaves_as_much_room_below_as_above():
    sines = np.sin(np.radians(spread_poses(Pattern(name="fibonacci", count=5, elevation_deg=(10, 70)))[:, 1]))
    assert sines.mean() == pytest.approx(np.sin(np.radians([10, 70])).mean())


def test_the_default_grid_is_six_azimuths_at_three_elevations():
    wanted = [(azimuth, elevation) for elevation in (25.0, 45.0, 65.0) for azimuth in range(0, 360, 60)]
    np.testing.assert_array_equal(spread_poses(Pattern()), wanted)


@pytest.mark.parametrize("name", ["fibonacci", "grid", "ring", "hemisphere"])
def test_jitter_of_a_pose_depends_on_seed_and_number_alone(name):
    def jitter(count, seed):
        moved = spread_poses(Pattern(name=name, count=count, elevation_deg=(30, 60), jitter_deg=2, seed=seed))
        shift = moved - spread_poses(Pattern(name=name, count=count, elevation_deg=(30, 60)))
        return np.stack([(shift[:, 0] + 180) % 360 - 180, shift[:, 1]], axis=1)

    # clipping keeps elevations within three standard deviations of the range: none is reached here
    np.testing.assert_allclose(jitter(6, 4), jitter(18, 4)[:6], atol=1e-9)
    assert np.abs(jitter(6, 4) - jitter(6, 5)).min() > 0
    many = jitter(200, 1)
    assert many[:, 0].std() == pytest.approx(2, rel=0.15)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"name": "gird"}, "name gird: expected grid, .*did you mean grid"),
        ({"count": 0}, "count 0: expected 1 to 10000"),
        ({"elevation_deg": (60, 20)}, "elevation_deg 60 20: expected two rising numbers from 0 to 90"),
        ({"elevation_deg": (-5, 20)}, "rising numbers from 0 to 90"),
        ({"elevation_deg": (20, 95)}, "rising numbers from 0 to 90"),
        ({"elevation_deg": (float("nan"), 95)}, "rising numbers from 0 to 90"),
        ({"fill": 1.2}, r"fill 1.2: expected 0.05 to 0.95"),
        ({"fill": 0.0}, "fill 0: expected"),
        ({"jitter_deg": -1}, "jitter_deg -1: expected 0 to 45"),
        ({"jitter_deg": float("nan")}, "jitter_deg nan: expected"),
        (
            {"distance_mm": (-5, 400)},
            "distance_mm -5 400: expected two distances over 0 and under 1000000 mm, the nearer first",
        ),
        ({"distance_mm": (400, float("inf"))}, "distance_mm 400 inf: expected two distances over 0"),
    ],
)
def test_what_cannot_be_is_refused_by_name(wrong, words):
    with pytest.raises(ToolkitError, match=words):
        Pattern(**wrong)


def test_every_pattern_that_can_be_asked_for_is_there():
    assert set(get_args(Pattern.model_fields["name"].annotation)) == set(PATTERNS)
