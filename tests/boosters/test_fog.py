"""Fog in training is the benchmark's fog, and its gradient that of finite differences."""

import numpy as np
import torch
from part_checks import check_gradient, count_changed, grey_noise

from toolkit.boosters.transforms.weather import Fog
from toolkit.core.draws import RandomStreams
from toolkit.corruptions.catalogue import CORRUPTIONS
from toolkit.corruptions.weather import add_fog


def test_probability_is_kept_and_what_does_not_act_is_left_exactly():
    images = grey_noise(100, 3, 16, 16)
    assert count_changed(Fog(probability=0).change, images) == 0
    assert count_changed(Fog(probability=1).change, images) == 100
    assert 15 < count_changed(Fog(probability=0.3).change, images) < 45


def test_with_a_fixed_strength_it_is_the_benchmarks_fog():
    images = grey_noise(2, 3, 32, 32).float()
    strength, smoothness = CORRUPTIONS["fog"].parameters["imagenet"][2]
    part = Fog(strength=(strength, strength), smoothness=(smoothness, smoothness), probability=1)
    drawn = np.random.default_rng(3)
    foggy = part.change(images, np.random.default_rng(3))
    drawn.random(2), drawn.uniform(size=4)
    seeds = drawn.integers(1 << 62, size=2)
    for image, seed, found in zip(images, seeds, foggy, strict=True):
        streams = RandomStreams([int(seed)], "fog", 0, image.device)
        expected = add_fog(image[None].clone(), (strength, smoothness), streams)[0]
        assert torch.allclose(found, expected.clamp(0, 1), atol=1e-6)


def test_its_gradient_is_that_of_differences():
    check_gradient(lambda images: Fog(probability=1).change(images, np.random.default_rng(1)), grey_noise(1, 3, 4, 4))
