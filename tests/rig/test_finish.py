"""The tone curve and grain of the virtual camera."""

import numpy as np
import pytest

from toolkit.imaging.colour import srgb_to_linear
from toolkit.rig.kernel.develop import develop
from toolkit.rig.shading import tone_map


def flat(value, shape=(120, 160)):
    return np.full((*shape, 3), value, np.float32)


def test_the_same_seed_gives_the_same_bytes_and_leaves_the_light_alone():
    light = np.random.default_rng(0).uniform(0, 1.2, (40, 50, 3)).astype(np.float32)
    before = light.copy()
    first, again, other = tone_map(light, (3, 1)), tone_map(light, (3, 1)), tone_map(light, (3, 2))
    np.testing.assert_array_equal(light, before)
    assert first.tobytes() == again.tobytes()
    assert (first != other).any()
    assert first.dtype == np.uint8 and first.shape == (40, 50, 3)


def test_more_light_is_never_darker():
    ramp = np.tile(np.linspace(0, 4, 2000, dtype=np.float32)[None, :, None], (1, 1, 3))
    codes = tone_map(ramp, (0,), noise=0, falloff=0).astype(int)[0, :, 0]
    assert (np.diff(codes) >= 0).all()
    assert codes[0] == 0 and codes[-1] == 255
    assert tone_map(flat(1.0), (0,), noise=0, falloff=0).max() < 255  # white keeps its detail


@pytest.mark.parametrize("code", [60, 118, 180])
def test_middle_greys_keep_their_code(code):
    picture = tone_map(flat(float(srgb_to_linear(np.array(code / 255)))), (1,), falloff=0)
    assert picture.mean() == pytest.approx(code, abs=1)
    centre = tone_map(flat(float(srgb_to_linear(np.array(code / 255)))), (1,))[50:70, 70:90]
    assert centre.mean() == pytest.approx(code, abs=2)


def test_grain_is_there_and_small():
    grey = tone_map(flat(0.18), (5,), falloff=0).astype(float)
    assert 0.3 < grey.std() < 3


def test_corners_lose_the_share_of_light_that_is_said():
    picture = tone_map(flat(0.4), (0,), noise=0, falloff=0.2)
    corner, centre = (float(srgb_to_linear(picture[y, x, 0] / 255)) for y, x in ((0, 0), (60, 80)))
    assert corner / centre == pytest.approx(0.8, abs=0.01)


def test_light_that_is_no_number_is_black_and_endless_light_white():
    light = flat(0.2, (2, 3))
    light[0, 0], light[0, 1], light[0, 2], light[1, 0] = np.nan, np.inf, -np.inf, 1e30
    picture = tone_map(light, (0,), noise=0, falloff=0)
    assert picture[:, :, 0].tolist()[0] == [0, 255, 0] and picture[1, 0, 0] == 255
    assert picture[1, 1, 0] == tone_map(flat(0.2, (2, 3)), (0,), noise=0, falloff=0)[1, 1, 0]


def test_whole_numbers_are_no_other_machine_code():
    """It would be kept beside the first, and the next command would find its folder changed and compile all again."""
    tone_map(flat(0.2), (0,))
    known = len(develop.signatures)
    tone_map(flat(0.2), (0,), noise=0, falloff=0)
    assert len(develop.signatures) == known == 1
