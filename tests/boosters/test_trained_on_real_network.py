"""The descent on a real ImageNet network."""

import numpy as np
import pytest
import torch

from toolkit.boosters.parts.affine import AffineRanges
from toolkit.boosters.parts.base import Appearance
from toolkit.boosters.patch_steps import Descent, Target, draw_first_patch, train_steps
from toolkit.boosters.validation import validate_patch
from toolkit.models.load import load_classifier


@pytest.mark.slow
def test_a_real_resnet_learns_to_see_a_warplane(real_weights):
    """Fourteen steps, the placement held easy: on an image that it never saw, the class comes first."""
    classifier = load_classifier("resnet18", next(real_weights.glob("resnet18-*.pth")), "cpu")
    targets = [Target(classifier, classifier.class_index("warplane"))]
    coarse = np.random.default_rng(0).integers(0, 256, (5, 3, 8, 8), np.uint8)
    images = torch.from_numpy(coarse.repeat(32, axis=2).repeat(32, axis=3))
    appearance = Appearance(AffineRanges((0, 0), (0.7, 0.7), (1, 1)))
    steps = list(
        train_steps(
            draw_first_patch(100, 0),
            0,
            images[:4],
            targets,
            appearance,
            Descent(14, 2, 0.1, smoothing_px=0, start_contrast=1),
            224,
        )
    )
    assert steps[0].accuracy == 0
    assert steps[-1].loss < steps[0].loss / 2
    (answer,) = validate_patch(steps[-1].patch, images[4:], targets, appearance, 0, 224, draws=4)
    assert (answer.bare.hits, answer.bare.n) == (0, 1)
    assert answer.patched.hits >= 3
