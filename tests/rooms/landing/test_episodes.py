"""Landing episodes with regressors whose error is known."""

import numpy as np
import pytest

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.rooms.landing.config import GAINS, DescentConfig, EpisodeConfig, parse_gains
from toolkit.rooms.landing.episodes import Episode, EpisodeDraws, FlatGround, Flights, Look, place_cameras
from toolkit.rooms.landing.fly import fly

PAD = np.array([3.0, -2.0, 1.0])


def truth(poses: np.ndarray) -> np.ndarray:
    return np.einsum("mji,mj->mi", poses[:, :3, :3], PAD - poses[:, :3, 3])[:, :2]


def noisy(spread_m: float) -> Look:
    def look(indices: np.ndarray, poses: np.ndarray, tick: int) -> np.ndarray:
        draws = [np.random.default_rng([int(index), tick]).standard_normal(2) for index in indices]
        return truth(poses) + spread_m * np.array(draws)

    return look


def run(
    look: Look, indices: list[int], gains: str = "gentle", ground: FlatGround | None = None, **settings: object
) -> list[Episode]:
    config = EpisodeConfig(**settings)
    flights = Flights(config, PAD, ground or FlatGround(1.0), seed=5, indices=indices)
    fly(flights, look, GAINS[gains], DescentConfig())
    return flights.episodes


def share(episodes: list[Episode]) -> float:
    return float(np.mean([one.outcome == "success" for one in episodes]))


def test_it_lands_with_a_perfect_regressor_in_wind() -> None:
    for gains in GAINS:
        episodes = run(noisy(0.0), list(range(8)), gains, latency_s=0.0)
        assert share(episodes) == 1.0
        assert max(one.error_m or 0 for one in episodes) < 0.3
        assert all(3 < one.time_s < 20 and one.path_m > 4 for one in episodes)


@pytest.mark.slow
def test_a_late_answer_upsets_the_papers_gains() -> None:
    late = run(noisy(0.0), list(range(8)), "paper", latency_s=0.1)
    assert np.mean([one.time_s for one in late]) > 1.5 * np.mean(
        [one.time_s for one in run(noisy(0.0), list(range(8)), "gentle", latency_s=0.1)]
    )


def test_noise_upsets_the_papers_gains_before_the_gentle_ones() -> None:
    paper = run(noisy(0.3), list(range(12)), "paper")
    gentle = run(noisy(0.3), list(range(12)), "gentle")
    assert share(gentle) == 1.0
    assert share(paper) < 0.8


def test_an_episode_is_the_same_alone_and_among_64() -> None:
    among = run(noisy(0.1), list(range(64)), time_limit_s=2.5)
    alone = run(noisy(0.1), [41], time_limit_s=2.5)[0]
    assert np.array(alone.track).tobytes() == np.array(among[41].track).tobytes()
    assert (alone.outcome, alone.time_s, alone.path_m) == (among[41].outcome, among[41].time_s, among[41].path_m)


def test_draws_are_of_seed_and_index_and_part() -> None:
    config = EpisodeConfig()
    one, same, other = (EpisodeDraws.of(config, 1, k) for k in (3, 3, 4))
    assert one.offset.tobytes() == same.offset.tobytes() != other.offset.tobytes()
    calm = EpisodeDraws.of(EpisodeConfig(wind_m_s=(0, 0), gust_m_s=0), 1, 3)
    assert calm.offset.tobytes() == one.offset.tobytes()
    assert not calm.wind.any()
    assert not calm.gusts.any()
    assert 5 <= one.offset[2] <= 8
    assert 5 <= np.degrees(np.arctan2(np.hypot(*one.offset[:2]), one.offset[2])) <= 20


def test_gusts_have_their_spread_and_their_time() -> None:
    config = EpisodeConfig(time_limit_s=600, gust_m_s=2.0, gust_time_s=1.0)
    gusts = EpisodeDraws.of(config, 0, 0).gusts[:, 0]
    assert gusts.std() == pytest.approx(2.0, rel=0.1)
    assert np.corrcoef(gusts[:-10], gusts[10:])[0, 1] == pytest.approx(np.exp(-1), abs=0.1)


def test_a_camera_looks_down_with_its_top_to_the_heading() -> None:
    pose = place_cameras(np.array([[0, 0, 10.0]]), np.array([0.0]), np.array([1.0]), np.zeros((1, 2)))[0]
    local = pose[:3, :3].T @ np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]).T
    assert np.allclose(local[:, 0], [0, -1, 0])  # ahead is up in the picture
    assert np.allclose(local[:, 1], [1, 0, 0])
    assert np.allclose(local[:, 2], [0, 0, 1])
    tilted = place_cameras(np.zeros((1, 3)), np.array([0.6]), np.array([0.8]), np.array([[0.1, -0.2]]))[0, :3, :3]
    assert np.allclose(tilted @ tilted.T, np.eye(3))
    assert np.linalg.det(tilted) == pytest.approx(1.0)


def test_every_end_is_told_apart() -> None:
    def away(indices: np.ndarray, poses: np.ndarray, tick: int) -> np.ndarray:
        return truth(poses) + np.array([1.5, 0.0])

    def blind(indices: np.ndarray, poses: np.ndarray, tick: int) -> np.ndarray:
        return np.full((len(indices), 2), np.nan)

    def flee(indices: np.ndarray, poses: np.ndarray, tick: int) -> np.ndarray:
        return -10 * truth(poses)

    class Wall(FlatGround):
        def is_hit(self, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
            return stop[:, 2] < 4

    calm = {"wind_m_s": (0, 0), "gust_m_s": 0.0, "gimbal_error_deg": 0.0}
    assert {one.outcome for one in run(away, [0, 1], **calm)} == {"missed"}
    assert {one.outcome for one in run(blind, [0, 1], time_limit_s=3, **calm)} == {"timed_out"}
    assert {one.outcome for one in run(flee, [0, 1], **calm)} == {"lost"}
    assert {one.outcome for one in run(noisy(0), [0, 1], ground=Wall(1.0))} == {"crashed"}
    assert {one.outcome for one in run(noisy(0), [0, 1], touchdown_m_s=0.1)} == {"crashed"}


def test_what_goes_out_of_control_ends_so_without_a_nan() -> None:
    from toolkit.rooms.landing.dynamics import CascadeGains

    flights = Flights(
        EpisodeConfig(), PAD, FlatGround(1.0), seed=0, indices=[0, 1, 2], gains=CascadeGains(rate_p=-40.0, level_p=90.0)
    )
    fly(flights, noisy(0.0), (1e9, 1e9, 1e9), DescentConfig())
    for one in flights.episodes:
        assert one.outcome in ("diverged", "crashed")
        assert np.isfinite([one.time_s, one.path_m]).all()
        assert np.isfinite(np.array(one.track)).all()
    assert any(one.outcome == "diverged" for one in flights.episodes)


def test_nan_answers_and_wild_gains_fly_without_nan() -> None:
    flights = Flights(EpisodeConfig(time_limit_s=4), PAD, FlatGround(1.0), seed=0, indices=[0, 1])
    fly(flights, noisy(0.2), (1e30, 0.0, 1e30), DescentConfig())
    assert all(np.isfinite(np.array(one.track)).all() for one in flights.episodes)


def test_bad_settings_are_one_line() -> None:
    with pytest.raises(FieldError, match="latency_s 40: expected less than time_limit_s, 30"):
        EpisodeConfig(latency_s=40)
    with pytest.raises(FieldError, match="camera_hz 0: expected above 0"):
        EpisodeConfig(camera_hz=0)
    with pytest.raises(FieldError, match=r"camera_hz 0\.01: expected a picture within time_limit_s, 30"):
        EpisodeConfig(camera_hz=0.01)
    with pytest.raises(ToolkitError, match="gains 'wild': expected paper, gentle"):
        parse_gains("wild")
    assert parse_gains("2,0,0.5") == (2.0, 0.0, 0.5)
