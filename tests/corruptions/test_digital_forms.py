"""Digital corruptions against Pillow, closed forms, and SciPy and OpenCV on the same draws."""

import io

import cv2
import numpy as np
import pytest
import torch
from PIL import Image
from scipy import ndimage

from toolkit.core.draws import RandomStreams
from toolkit.corruptions.batch import corrupt
from toolkit.corruptions.catalogue import CORRUPTIONS, SEVERITIES


@pytest.fixture(scope="module", params=[(224, 224), (32, 32), (100, 131)])
def pixels(request) -> np.ndarray:
    rng = np.random.default_rng(2)
    height, width = request.param
    coarse = rng.integers(0, 256, (12, 14, 3), dtype=np.uint8)
    smooth = np.asarray(Image.fromarray(coarse).resize((width, height), Image.Resampling.BICUBIC), np.float64)
    return np.clip(smooth + rng.normal(0, 12, smooth.shape), 0, 255).astype(np.uint8)


def as_batch(pixels: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(pixels.astype(np.float32) / 255).permute(2, 0, 1)[None]


def as_levels(batch: torch.Tensor) -> np.ndarray:
    return batch[0].permute(1, 2, 0).numpy() * 255


@pytest.mark.parametrize("parameters", ["imagenet", "cifar"])
@pytest.mark.parametrize("severity", SEVERITIES)
def test_pixelate_is_pillows_box(pixels, severity, parameters):
    share = CORRUPTIONS["pixelate"].parameters[parameters][severity - 1]
    height, width = pixels.shape[:2]
    small = Image.fromarray(pixels).resize((int(width * share), int(height * share)), Image.Resampling.BOX)
    expected = np.asarray(small.resize((width, height), Image.Resampling.BOX), np.float64)
    ours = as_levels(corrupt(as_batch(pixels), "pixelate", severity, [0], parameters))
    assert np.abs(ours - expected).max() < 1e-3


@pytest.mark.parametrize("severity", SEVERITIES)
def test_jpeg_is_pillows_at_the_published_quality(pixels, severity):
    parameters = "cifar" if len(pixels) == 32 else "imagenet"
    quality = {"imagenet": (25, 18, 15, 10, 7), "cifar": (80, 65, 58, 50, 40)}[parameters][severity - 1]
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=quality)
    expected = np.asarray(Image.open(stream), np.float64)
    assert np.abs(as_levels(corrupt(as_batch(pixels), "jpeg_compression", severity, [0])) - expected).max() < 1e-3


@pytest.mark.parametrize("severity", SEVERITIES)
def test_contrast_shrinks_about_the_mean(pixels, severity):
    share = CORRUPTIONS["contrast"].parameters["imagenet"][severity - 1]
    means = pixels.mean((0, 1), keepdims=True)
    ours = as_levels(corrupt(as_batch(pixels), "contrast", severity, [0], "imagenet"))
    assert np.abs(ours - ((pixels - means) * share + means)).max() < 1e-3


@pytest.mark.parametrize("parameters", ["imagenet", "cifar"])
@pytest.mark.parametrize("severity", SEVERITIES)
def test_elastic_is_opencvs_affine_and_scipys_map(severity, parameters):
    side = 224 if parameters == "imagenet" else 32
    # smooth, because OpenCV rounds the places of an affine change to 1/32 px
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    image = np.stack([np.sin(x / 9) + np.cos(y / 7), np.sin((x + y) / 11), np.cos(x * y / side / 8)], 2)
    image = ((image + 2) / 4).astype(np.float32)
    strength, sigma, shift = CORRUPTIONS["elastic_transform"].parameters[parameters][severity - 1]
    draws = RandomStreams([6], "elastic_transform", severity, torch.device("cpu"))
    moves = (draws.uniform(3, 2)[0].numpy() * 2 - 1) * shift
    noise = draws.uniform(2, side, side)[0].double().numpy() * 2 - 1

    middle, reach = side // 2, side // 3
    before = np.float32([[middle + reach, middle + reach], [middle + reach, middle - reach], [middle - reach] * 2])
    matrix = cv2.getAffineTransform(before, (before + moves).astype(np.float32))
    moved = cv2.warpAffine(image, matrix, (side, side), borderMode=cv2.BORDER_REFLECT_101)
    if strength:
        noise = ndimage.gaussian_filter(noise, (0, sigma, sigma), mode="reflect", truncate=3) * strength
    else:
        noise = noise * 0
    places = [y + noise[1], x + noise[0]]
    expected = np.stack([ndimage.map_coordinates(moved[..., c], places, order=1, mode="reflect") for c in range(3)])
    ours = corrupt(torch.from_numpy(image).permute(2, 0, 1)[None], "elastic_transform", severity, [6], parameters)
    error = np.abs(ours[0].numpy() - expected)
    assert error.mean() < 1e-3 and error.max() < 0.02


def test_elastic_displacement_has_the_deviation_of_smoothed_noise():
    """A ramp shows the displacement: uniform noise of variance 1/3 through a Gaussian of sum of squares 1/(4πσ²)."""
    from toolkit.corruptions import digital as elastic

    strength, sigma = 244 * 0.12, 2.44
    ramp = torch.arange(224.0).expand(20, 3, 224, 224) / 224
    moved = elastic.bend(
        ramp.contiguous(), (strength, sigma, 0.0), RandomStreams(range(20), "x", 1, torch.device("cpu"))
    )
    shift = ((moved - ramp) * 224)[..., 20:-20, 20:-20]
    expected = strength * (1 / 3 / (4 * np.pi * sigma**2)) ** 0.5
    assert shift.std().item() == pytest.approx(expected, rel=0.03)
    assert abs(shift.mean().item()) < 0.05 * expected
