import numpy as np
import torch

from toolkit.boosters.transforms.printing import LightRanges


def light(paper, mask, **ranges):
    return LightRanges(**ranges).light(paper, mask, np.random.default_rng(0))


def test_exposure_alone_is_one_factor_for_all():
    paper = torch.rand(2, 3, 5, 5)
    lit = light(paper, torch.ones(2, 1, 5, 5), exposure=(0.7, 0.7), contrast=(1, 1), tint=0)
    torch.testing.assert_close(lit, paper * 0.7)


def test_contrast_leaves_middle_grey_and_halves_the_distance_from_it():
    lit = light(
        torch.tensor([0.5, 1.0, 0.0]).view(1, 3, 1, 1),
        torch.ones(1, 1, 1, 1),
        exposure=(1, 1),
        contrast=(0.5, 0.5),
        tint=0,
    )
    torch.testing.assert_close(lit.flatten(), torch.tensor([0.5, 0.75, 0.25]))


def test_what_the_patch_does_not_cover_stays_untouched_and_a_half_covered_rim_is_lit_by_half():
    paper, mask = torch.zeros(1, 3, 1, 2), torch.tensor([0.0, 0.5]).view(1, 1, 1, 2)
    lit = light(paper + mask * 0.8, mask, exposure=(1, 1), contrast=(0.5, 0.5), tint=0)
    torch.testing.assert_close(lit[0, 0, 0], torch.tensor([0.0, 0.5 * 0.65]))


def test_tint_differs_between_channels_within_its_bound():
    lit = light(torch.ones(500, 3, 1, 1), torch.ones(500, 1, 1, 1), exposure=(1, 1), contrast=(1, 1), tint=0.1)
    assert 0.9 <= lit.min() < 0.91
    assert 1.09 < lit.max() <= 1.1
    assert (lit[:, 0] - lit[:, 2]).abs().mean() > 0.03
