"""The Gymnasium environment: its checker is content, and steering by the truth lands."""

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="Gymnasium is not installed")
from gymnasium.utils.env_checker import check_env

from toolkit.rooms.landing.config import CameraConfig, EpisodeConfig
from toolkit.rooms.landing.env import LandingEnv


@pytest.fixture(scope="module")
def env() -> LandingEnv:
    config = EpisodeConfig(start_height_m=(1.5, 2.0), time_limit_s=15, wind_m_s=(0, 1), latency_s=0.0)
    return LandingEnv(episode=config, optics=CameraConfig(image_px=32), time="overcast", places=2)


def test_gymnasium_is_content(env: LandingEnv) -> None:
    check_env(env, skip_render_check=True)


def test_steering_by_the_truth_lands(env: LandingEnv) -> None:
    picture, info = env.reset(seed=4)
    assert picture.shape == (32, 32, 3)
    total, ended, late = 0.0, False, False
    while not (ended or late):
        right, back = info["offset_m"]
        picture, reward, ended, late, info = env.step(np.array([-back, -right, -0.6], np.float32))
        total += reward
    assert info["outcome"] == "success"
    assert total > 10
    first, _ = env.reset(seed=4)
    again, _ = env.reset(options={"index": 0})
    assert np.array_equal(first, again)
