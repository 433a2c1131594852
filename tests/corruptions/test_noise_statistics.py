"""Noise against what its distribution says: means, variances, shares, and the counts of a Poisson variable."""

import numpy as np
import pytest
import torch
from scipy.stats import chisquare, poisson

from toolkit.core.draws import RandomStreams
from toolkit.corruptions.batch import corrupt
from toolkit.corruptions.catalogue import CORRUPTIONS
from toolkit.corruptions.noise import draw_poisson

COUNT = 8
LEVELS = 3 * 224 * 224 * COUNT


def make_flat(value: float) -> torch.Tensor:
    return torch.full((COUNT, 3, 224, 224), value)


@pytest.mark.parametrize(("name", "scale_at_half"), [("gaussian_noise", 1.0), ("speckle_noise", 0.5)])
def test_normal_noise_has_the_published_deviation(name, scale_at_half):
    # severity 1: at mid grey next to nothing is cut off at 0 or 1
    for parameters in ("imagenet", "cifar"):
        sigma = CORRUPTIONS[name].parameters[parameters][0] * scale_at_half
        noise = corrupt(make_flat(0.5), name, 1, range(COUNT), parameters) - 0.5
        # four standard errors of a mean and of a standard deviation
        assert abs(noise.mean()) < 4 * sigma / LEVELS**0.5
        assert abs(noise.std() / sigma - 1) < 4 / (2 * LEVELS) ** 0.5
        assert abs((noise / sigma).pow(4).mean() - 3) < 4 * (96 / LEVELS) ** 0.5


def test_speckle_leaves_black_black_and_gaussian_noise_does_not():
    assert (corrupt(make_flat(0.0), "speckle_noise", 5, range(COUNT)) == 0).all()
    # half of the draws fall below black and are cut off
    assert abs((corrupt(make_flat(0.0), "gaussian_noise", 5, range(COUNT)) > 0).float().mean() - 0.5) < 0.005


@pytest.mark.parametrize("severity", [1, 3, 5])
def test_shot_noise_counts_photons(severity):
    photons = CORRUPTIONS["shot_noise"].parameters["imagenet"][severity - 1]
    level = 51  # a fifth of full scale, so that counts above full scale are rare
    counts = corrupt(make_flat(level / 255), "shot_noise", severity, range(COUNT)) * photons
    assert torch.allclose(counts, counts.round(), atol=1e-4)
    top = photons  # the image is cut off at 1, which is `photons` counts
    observed = np.bincount(counts.round().long().flatten().numpy(), minlength=top + 1)
    expected = poisson.pmf(np.arange(top + 1), photons / 5) * LEVELS
    expected[-1] += poisson.sf(top, photons / 5) * LEVELS
    pooled = expected >= 10
    observed, expected = (
        np.append(observed[pooled], observed[~pooled].sum()),
        np.append(expected[pooled], expected[~pooled].sum()),
    )
    if expected[-1] == 0:
        observed, expected = observed[:-1], expected[:-1]
    assert chisquare(observed, expected).pvalue > 1e-3


@pytest.mark.parametrize("scale", [3, 60, 500])
def test_poisson_table_at_every_level(scale):
    levels = torch.arange(256, dtype=torch.int32).repeat(600, 1)[None]
    counts = draw_poisson(levels, scale, 255, RandomStreams([5], "test", 1, torch.device("cpu")))[0]
    means = np.arange(256) * scale / 255
    errors = (counts.mean(0).numpy() - means) / np.sqrt(np.maximum(means, 1e-9) / 600)
    assert counts[:, 0].max() == 0
    assert np.abs(errors[1:]).max() < 4.5 and abs(errors[1:].std() - 1) < 0.2
    assert abs((counts.var(0).numpy()[1:] / means[1:]).mean() - 1) < 0.03


@pytest.mark.parametrize("severity", [1, 5])
def test_impulse_noise_salts_and_peppers_its_share(severity):
    share = CORRUPTIONS["impulse_noise"].parameters["imagenet"][severity - 1]
    spoilt = corrupt(make_flat(0.3), "impulse_noise", severity, range(COUNT))
    error = 4 * (share / LEVELS) ** 0.5
    assert abs((spoilt == 0).float().mean() - share / 2) < error
    assert abs((spoilt == 1).float().mean() - share / 2) < error
    assert ((spoilt == 0) | (spoilt == 1) | (spoilt == 0.3)).all()
    # each channel on its own
    hit = (spoilt != 0.3).float()
    assert abs((hit[:, 0] * hit[:, 1]).mean() - share**2) < 0.002


def test_noise_of_two_images_and_of_two_channels_is_unrelated():
    noise = corrupt(make_flat(0.5), "gaussian_noise", 1, range(COUNT)) - 0.5
    correlation = np.corrcoef(noise.flatten(0, 1).flatten(1).numpy())
    assert np.abs(correlation - np.eye(len(correlation))).max() < 5 / 224
