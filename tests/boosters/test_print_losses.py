"""Total variation against its closed form, printability against brute force; the record's scores against the losses."""

from itertools import pairwise

import numpy as np
import pytest
import torch
from part_checks import check_gradient

from toolkit.boosters.patch_config import non_printability, total_variation
from toolkit.imaging.printer import SOLIDS, PrintScores, nearest_printable, score_print


def test_total_variation_of_flat_stripes_and_noise():
    assert float(total_variation(torch.full((3, 9, 9), 0.3))) == 0
    stripes = torch.zeros(3, 10, 10)
    stripes[:, :, ::2] = 1
    assert float(total_variation(stripes)) == pytest.approx(0.5)  # every step to the right is 1, every step down 0
    noise = torch.from_numpy(np.random.default_rng(0).random((3, 200, 200)))
    # the mean distance of two numbers that are drawn from [0, 1]
    assert float(total_variation(noise)) == pytest.approx(1 / 3, abs=0.003)


def test_distance_to_what_can_be_printed_is_that_of_a_search():
    """Many random mixtures of the eight solids, the nearest of them to each colour."""
    rng = np.random.default_rng(1)
    colours = rng.random((60, 3))
    mixtures = np.concatenate([rng.dirichlet(np.full(8, a), 100_000) for a in (0.05, 0.2, 1.0)]) @ SOLIDS.reshape(8, 3)
    searched = np.array([np.sqrt(((mixtures - colour) ** 2).sum(axis=1).min()) for colour in colours])
    nearest = np.linalg.norm(colours - nearest_printable(colours), axis=1)
    assert (nearest <= searched + 1e-9).all(), "nothing that can be printed is nearer"
    np.testing.assert_allclose(nearest, searched, atol=0.03)
    assert (nearest == 0).sum() > 3


def test_what_can_be_printed_is_left_and_the_nearest_can_be_printed():
    rng = np.random.default_rng(2)
    inside = rng.dirichlet(np.ones(8), 200) @ SOLIDS.reshape(8, 3)
    np.testing.assert_allclose(nearest_printable(inside), inside)
    once = nearest_printable(rng.random((200, 3)))
    np.testing.assert_allclose(nearest_printable(once), once, atol=1e-6)


def test_gradients_are_those_of_finite_differences():
    patch = torch.from_numpy(np.random.default_rng(3).random((3, 5, 5)))
    check_gradient(lambda theta: total_variation(theta) * 10, patch)
    check_gradient(lambda theta: non_printability(theta) * 10, patch)


def test_a_printable_patch_has_no_gradient_and_no_nan():
    patch = torch.full((3, 4, 4), 0.6, requires_grad=True)
    score = non_printability(patch)
    assert score.item() == 0
    assert torch.equal(torch.autograd.grad(score, patch)[0], torch.zeros(3, 4, 4))


def test_going_down_the_losses_makes_a_patch_printable_and_smooth():
    patch = torch.from_numpy(np.random.default_rng(4).random((3, 8, 8)))
    scores = []
    for _ in range(60):
        patch.requires_grad_(True)
        loss = non_printability(patch) + total_variation(patch)
        scores.append(loss.item())
        (gradient,) = torch.autograd.grad(loss, patch)
        patch = (patch.detach() - 0.02 * gradient.sign()).clamp(0, 1)
    assert scores[-1] < 0.25 * scores[0]
    assert sum(after > before for before, after in pairwise(scores)) < 30


def test_the_records_scores_are_the_losses():
    pixels = np.random.default_rng(5).integers(0, 256, (20, 20, 3), np.uint8)
    scores = score_print(pixels)
    theta = torch.from_numpy(pixels.transpose(2, 0, 1) / 255.0)
    assert scores.total_variation == pytest.approx(float(total_variation(theta)))
    assert scores.non_printability == pytest.approx(float(non_printability(theta)))


def test_a_line_says_what_the_numbers_mean():
    line = PrintScores(0.123, 0.031).describe("racer")
    assert line.startswith("racer: total variation 0.12 (")
    assert "non-printability 0.03 (near to what inks" in line
    assert "duller than on the screen" in PrintScores(0.3, 0.3).describe("x")
    assert "texels blur" in PrintScores(0.3, 0.3).describe("x")
