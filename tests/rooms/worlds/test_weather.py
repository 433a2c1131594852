"""Weather by its name: words, tables, seeds, AirSim's numbers."""

import numpy as np
import pytest

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.rig.camera import Camera, look_at
from toolkit.rooms.worlds.conditions import parse_weathers
from toolkit.rooms.worlds.depth_weather import (
    WEATHERS,
    Clear,
    Rain,
    add_weather,
    describe_weathers,
    make_weather,
    to_airsim,
    weather_rng,
)
from toolkit.rooms.worlds.particles import DepthView

AIRLIGHT = np.array([0.7, 0.8, 0.95])
LIGHT = np.random.default_rng(0).uniform(0, 1, (48, 64, 3)).astype(np.float32)
ALL = parse_weathers(["clear", "fog", "dust", "rain", "snow"])


def make_view() -> DepthView:
    depth = np.random.default_rng(1).uniform(1, 60, (48, 64)).astype(np.float32)
    depth[:10] = np.inf
    pose = look_at(np.array([30.0, 5.0, 8.0]), np.array([0.0, 0.0, 2.0]))
    return DepthView(depth, Camera.from_fov(64, 48, 60), pose, ground=depth > 30)


def test_words_with_severities():
    assert parse_weathers(["fog:3"]) == (("fog", 3),)
    assert parse_weathers(["clear", "fog:4-5", "dust:1", "fog:5"]) == (
        ("clear", 0),
        ("fog", 4),
        ("fog", 5),
        ("dust", 1),
    )
    assert parse_weathers(["snow"]) == tuple(("snow", severity) for severity in (1, 2, 3, 4, 5))
    assert parse_weathers([]) == ()


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("fgo:3", "no weather called 'fgo': did you mean fog"),
        ("hail", "no weather called 'hail': "),
        ("", "no weather called ''"),
        ("fog:6", "weather 'fog:6': severity '6': expected one of 1"),
        ("dust:3-1", "weather 'dust:3-1': severity '3-1'"),
        ("clear:1", "weather 'clear:1': clear air has no severity"),
    ],
)
def test_what_there_is_not(word, message):
    with pytest.raises(ToolkitError, match=message):
        parse_weathers([word])


def test_no_such_weather_or_severity():
    with pytest.raises(ToolkitError, match="no weather called 'sleet'"):
        make_weather("sleet", 1)
    with pytest.raises(FieldError, match="severity 6: fog: expected one of 1"):
        make_weather("fog", 6)
    with pytest.raises(FieldError, match="severity 0: rain: expected"):
        make_weather("rain", 0)
    with pytest.raises(FieldError, match="severity 2: clear: expected 0"):
        make_weather("clear", 2)


def test_the_table_says_each_one_its_numbers():
    lines = describe_weathers(ALL)
    assert len(lines) == 21 and "visibility 40 m, extinction 74.9 /km" in lines[3] and "fog:3" in lines[3]
    assert "25 mm/h" in lines[13] and "2.7 /km" in lines[13]


def test_every_weather_knows_its_visibility():
    far = [make_weather(name, severity).visibility_m for name, severity in ALL]
    assert far[0] == np.inf and far[1:6] == [100, 70, 40, 20, 10] == far[6:11]
    assert far[13] == pytest.approx(1111, abs=1) and far[20] == pytest.approx(98, abs=1)
    assert Rain(rate_mm_h=0, wetness=1).visibility_m == np.inf


@pytest.mark.parametrize(("name", "severity"), ALL)
def test_same_seed_same_bytes_and_an_item_alone(name, severity):
    view, weather = make_view(), make_weather(name, severity)

    def show(item: int) -> np.ndarray:
        seen = add_weather(LIGHT, view, weather, AIRLIGHT, weather_rng(7, item, name, severity))
        assert seen.dtype == np.float32 and seen.shape == LIGHT.shape and (seen >= 0).all()
        return seen

    third = show(3)
    show(0), show(1)
    np.testing.assert_array_equal(show(3), third)
    if name in ("rain", "snow"):
        assert (show(4) != third).any()


def test_clear_air_changes_nothing():
    np.testing.assert_array_equal(
        add_weather(LIGHT, make_view(), Clear(), AIRLIGHT, weather_rng(0, 0, "clear", 0)), LIGHT
    )


@pytest.mark.parametrize("name", ["fog", "dust", "rain", "snow"])
def test_each_severity_hides_more(name):
    factors = [
        make_weather(name, severity).change_light(make_view(), AIRLIGHT, np.random.default_rng(0)).factor.mean()
        for severity in (1, 2, 3, 4, 5)
    ]
    assert (np.diff(factors) < 0).all()


def test_weather_is_linear_in_the_picture():
    view, other = make_view(), 1 - LIGHT

    def show(light: np.ndarray) -> np.ndarray:
        return add_weather(light, view, make_weather("snow", 3), AIRLIGHT, weather_rng(0, 0, "snow", 3))

    mixed = show(0.3 * LIGHT + 0.7 * other)
    np.testing.assert_allclose(mixed, 0.3 * show(LIGHT) + 0.7 * show(other), atol=1e-6)


@pytest.mark.parametrize("name", WEATHERS)
def test_airsims_numbers_are_our_ladder(name):
    for severity in (1, 2, 3, 4, 5):
        numbers, ours = to_airsim(name, severity), make_weather(name, severity)
        assert numbers.pop(name.capitalize()) == severity / 5
        # rain brings its wet ground with it, snow its cover
        assert numbers == {
            "rain": {"Roadwetness": pytest.approx(1 - np.exp(-getattr(ours, "rate_mm_h", 0) / 10))},
            "snow": {"RoadSnow": getattr(ours, "cover", 0)},
        }.get(name, {})
    assert to_airsim("clear", 0) == {}
