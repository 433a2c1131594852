"""Numbers that kernels make for themselves, against NumPy's: grain bit for bit, logarithm and power closely."""

import numpy as np
import pytest

from toolkit.rig.kernel.compiled import kernel
from toolkit.rig.kernel.develop import draw_normals
from toolkit.rig.kernel.lanes import exp2, log2
from toolkit.rig.shading import develop_light, draw_grain, stream_state, tone_map


@kernel
def draw(state: np.ndarray, out: np.ndarray) -> None:
    draw_normals(state, out)


@kernel
def fill_powers(x: np.ndarray, out: np.ndarray) -> None:
    for i in range(len(x)):
        out[i, 0], out[i, 1] = exp2(x[i]), log2(exp2(x[i]))


@pytest.mark.parametrize("seed", [(0,), (3, 14, 15)])
def test_normal_numbers_are_numpys_bit_for_bit_wherever_the_draw_is_cut(seed):
    """Two million: some five hundred of them lie in the tail beyond the ziggurat."""
    state, found = stream_state(seed), np.empty(2_000_003, np.float32)
    for part in (found[:7], found[7:1_000_000], found[1_000_000:]):
        draw(state, part)
    expected = np.random.default_rng(seed).standard_normal(len(found), dtype=np.float32)
    assert np.abs(expected).max() > 4.5
    assert found.tobytes() == expected.tobytes()


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (64, 48)])
def test_a_picture_has_the_grain_that_is_drawn_beforehand(shape):
    light = np.random.default_rng(1).random((*shape, 3), np.float32) * 1.5
    assert (
        tone_map(light, (5, 2), 0.1).tobytes() == develop_light(light, draw_grain(light.shape, (5, 2)), 0.1).tobytes()
    )


def test_powers_and_logarithms_are_numpys_to_seven_digits():
    x = np.concatenate([np.linspace(-40, 40, 100_001), [-900.0, 900.0, 0.5, -0.5]])
    found = np.empty((len(x), 2))
    fill_powers(x, found)
    np.testing.assert_allclose(found[:, 0], np.exp2(x), rtol=2e-7)
    np.testing.assert_allclose(found[:, 1], x, atol=4e-7)
