"""The image that a network sees is the one torchvision's own transforms give."""

import numpy as np
import pytest
import torch
import torchvision
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.imaging.preprocessing import published_preprocessing, resize_and_crop
from toolkit.models.architectures import published_weights
from toolkit.models.labels import LabelsFile, adapt_preprocessing


def photograph(width: int, height: int) -> np.ndarray:
    """Noise over a gradient: every resampling error shows."""
    draw = np.random.default_rng(width * 10_000 + height)
    ramp = np.linspace(0, 200, width)[None, :, None] + np.zeros((height, 1, 3))
    return np.clip(ramp + draw.normal(0, 30, (height, width, 3)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("arch", ["resnet18", "swin_t", "convnext_tiny", "efficientnet_b3"])
@pytest.mark.parametrize(
    ("width", "height"),
    [
        (640, 480),
        (480, 640),
        (256, 256),
        (257, 255),
        (1001, 667),
        (100, 37),
        (33, 260),
        (33, 300),
        (224, 224),
        (5, 9),
        (1, 1),
    ],
)
def test_same_as_torchvision(arch, width, height):
    preset = published_weights(arch).transforms()
    image = photograph(width, height)
    expected = preset(Image.fromarray(image))
    mean, std = (torch.tensor(values).view(3, 1, 1) for values in (preset.mean, preset.std))
    levels = ((expected * std + mean) * 255).round().numpy().transpose(1, 2, 0)
    ours = resize_and_crop(image, published_preprocessing(preset)).astype(float)
    if max(width, height) <= 8 * min(width, height):
        assert np.array_equal(ours, levels)
    else:  # Pillow then rounds, and cuts off what a bicubic filter overshoots, between its passes in another order
        assert np.abs(ours - levels).max() <= (2 if "BILINEAR" in str(preset.interpolation) else 16)
        assert np.abs(ours - levels).mean() < 1


def test_a_very_long_image_takes_little_memory():
    strip = np.zeros((2, 60_000, 3), np.uint8)
    strip[:, 29_990:30_010] = 200
    how = published_preprocessing(published_weights("resnet18").transforms())
    seen = resize_and_crop(strip, how)
    assert seen.shape == (224, 224, 3)
    assert seen.max() == 200


def test_own_preprocessing():
    published = published_preprocessing(torchvision.models.ResNet18_Weights.IMAGENET1K_V1.transforms())
    own = adapt_preprocessing(published, LabelsFile(resize_px=64, crop_px=48, std=(1, 1, 1)))
    assert (own.resize_px, own.crop_px, own.mean, own.std) == (64, 48, published.mean, (1, 1, 1))
    assert resize_and_crop(photograph(100, 80), own).shape == (48, 48, 3)
    with pytest.raises(ToolkitError, match="crop_px 300"):
        adapt_preprocessing(published, LabelsFile(crop_px=300))
