"""The visibility at which half is lost, against closed forms."""

import numpy as np
import pytest

from toolkit.core.statistics import percentile_interval, resample_clusters, sign_flip_p
from toolkit.rooms.worlds.evaluation.world_results import format_times, format_visibility, judge_world
from toolkit.rooms.worlds.evaluation.world_rows import find_ladder, find_level, list_extinctions, measure_half

EXTINCTIONS = list_extinctions([("clear", 0), *(("fog", k) for k in range(1, 6))])


def half(shares, bare=None):
    rows = np.array([shares, shares, shares], float)
    return measure_half("textured", "fog", EXTINCTIONS, rows, None if bare is None else np.array([bare] * 3, float))


def test_extinctions_are_koschmieders() -> None:
    assert EXTINCTIONS.tolist() == pytest.approx([0, 0.02996, 0.0428, 0.0749, 0.1498, 0.2996])
    assert find_ladder((("clear", 0), ("fog", 3), ("dust", 2), ("fog", 1))) == {
        "fog": [("clear", 0), ("fog", 1), ("fog", 3)], "dust": [("clear", 0), ("dust", 2)],
    }  # fmt: skip


def test_a_straight_line_is_halved_where_it_says() -> None:
    shares = 0.8 - 2.0 * EXTINCTIONS  # 0.4 at 0.2 per metre
    found = half(shares)
    assert found["visibility_m"] == pytest.approx(2.996 / 0.2)
    assert found["visibility_ci95"] == pytest.approx((2.996 / 0.2, 2.996 / 0.2))
    assert found["clear_top5"] == 0.8


def test_twice_the_fog_is_twice() -> None:
    bare, boosted = 0.8 - 4.0 * EXTINCTIONS, 0.8 - 2.0 * EXTINCTIONS
    found = half(boosted, bare)
    assert found["times"] == pytest.approx(2)
    assert found["same_times"] == pytest.approx(2)
    assert not found["times_is_bound"]


def test_the_same_share_as_bare_is_another_question() -> None:
    bare, boosted = 0.4 - 2.0 * EXTINCTIONS, 0.8 - 4.0 * EXTINCTIONS  # both are halved at 0.1; 0.2 is left at 0.15
    found = half(boosted, bare)
    assert found["times"] == pytest.approx(1)
    assert found["same_times"] == pytest.approx(1.5)


def test_what_is_not_reached_is_a_bound() -> None:
    found = half(np.full(6, 0.9), 0.8 - 4.0 * EXTINCTIONS)
    assert found["visibility_m"] is None
    assert found["visibility_ci95"] == [None, None]
    assert found["densest_m"] == pytest.approx(10)
    assert found["times_is_bound"] and found["times"] == pytest.approx(0.2996 / 0.1)
    assert format_times(found, "times") == "at least 3.0 times"
    assert format_visibility(found) == "not reached"


def test_nothing_to_lose_is_no_number() -> None:
    found = half(np.zeros(6), 0.8 - 4.0 * EXTINCTIONS)
    assert (found["visibility_m"], found["visibility_ci95"], found["times"]) == (None, None, None)
    assert half(0.8 - 4.0 * EXTINCTIONS, np.zeros(6))["times"] is None


def test_the_first_crossing_counts() -> None:
    shares = np.array([[1.0, 0.4, 0.6, 0.6, 0.2, 0.1]])
    at = find_level(EXTINCTIONS, shares, np.array([0.5]))
    assert at[0] == pytest.approx(0.02996 * 0.5 / 0.6)


def test_cluster_samples_are_those_of_a_multinomial() -> None:
    weights = resample_clusters(5)
    assert (weights.sum(axis=1) == 5).all()
    assert weights.mean(axis=0) == pytest.approx(np.ones(5), abs=0.06)
    assert weights.var(axis=0) == pytest.approx(np.full(5, 5 * 0.2 * 0.8), abs=0.08)
    assert len(np.unique(weights, axis=0)) <= 126
    low, high = percentile_interval(weights[:, 0])
    assert (low, high) == (0, 3)


def test_signs_are_flipped_exactly() -> None:
    assert sign_flip_p([0.1, 0.2, 0.1, 0.4, 0.3]) == pytest.approx(2 / 32)
    assert sign_flip_p([0.1, -0.1]) == 1
    assert sign_flip_p([0.3, 0.2, -0.1]) == pytest.approx(4 / 8)  # 0.4 is exceeded or met by ±0.6 and ±0.4
    assert sign_flip_p([0.1] * 20) < 0.001


def test_what_never_halves_is_told_in_plain_words() -> None:
    bare, boosted = 0.8 - 2.0 * EXTINCTIONS, 0.8 - 0.5 * EXTINCTIONS
    row = half(boosted, bare)
    (verdict,) = judge_world({"groups": [], "pairs": [], "half_lost": [row]})
    assert (
        "even at 10 m, the thickest fog tested, more than half remain; that is at least 1.5 times" in verdict.sentence
    )
    assert "the fog that halves the baseline" in verdict.sentence
