"""The descent on a real ImageNet network."""

import numpy as np
import pytest
import torch
from tiny_network import tiny_config
from watched_patch import train_watched

from toolkit.boosters.pixels import Target
from toolkit.boosters.transforms.placement import AffineRanges
from toolkit.boosters.transforms.show import Appearance
from toolkit.boosters.validation import validate_patch
from toolkit.models.load import load_classifier


@pytest.mark.slow
def test_a_real_resnet_learns_to_see_a_warplane(real_weights):
    """Fourteen steps, the placement held easy: on an image that it never saw, the class comes first."""
    classifier = load_classifier("resnet18", next(real_weights.glob("resnet18-*.pth")), "cpu")
    targets = [Target(classifier, classifier.class_index("warplane"))]
    coarse = np.random.default_rng(0).integers(0, 256, (5, 3, 8, 8), np.uint8)
    images = torch.from_numpy(coarse.repeat(32, axis=2).repeat(32, axis=3))
    appearance = Appearance(AffineRanges(rotation_deg=(0, 0), share=(0.7, 0.7), foreshortening=(1, 1)))
    config = tiny_config(14, size_px=100, batch=2, smoothing_px=0, start_contrast=1)
    task = train_watched(images[:4], targets, appearance, config)
    losses = task.history.figures["loss"]
    assert task.history.figures["accuracy"][0] == 0
    assert losses[-1] < losses[0] / 2
    (answer,) = validate_patch(task.seen[-1], images[4:], targets, appearance, 0, draws=4)
    assert (answer.bare.hits, answer.bare.n) == (0, 1)
    assert answer.patched.hits >= 3
