"""Blur, sensor noise and JPEG against SciPy, statistics and Pillow."""

from io import BytesIO

import numpy as np
import pytest
import torch
from part_checks import check_gradient, count_changed, grey_noise
from PIL import Image
from scipy.ndimage import gaussian_filter

from toolkit.boosters.transforms.camera import (
    CHROMA,
    LUMA,
    CameraBlur,
    JpegFile,
    SensorNoise,
    compress,
    make_kernels,
    quantise_tables,
    round_straight,
)

PARTS = [CameraBlur, SensorNoise, JpegFile]


def photograph(h: int = 80, w: int = 96) -> np.ndarray:
    """Smooth colours with edges and a little texture; (h, w, 3) uint8."""
    rng = np.random.default_rng(4)
    coarse = Image.fromarray(rng.integers(0, 256, (6, 7, 3), np.uint8)).resize((w, h), Image.Resampling.BICUBIC)
    pixels = np.asarray(coarse).astype(float) + rng.normal(0, 4, (h, w, 3))
    pixels[h // 3 : h // 2, w // 4 : w // 2] = (220, 40, 60)
    return pixels.clip(0, 255).astype(np.uint8)


def as_tensor(pixels: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(pixels.transpose(2, 0, 1) / 255.0)[None]


@pytest.mark.parametrize("part", PARTS)
def test_probability_is_kept_and_what_does_not_act_is_left_exactly(part):
    images = grey_noise(200, 3, 16, 16)
    assert count_changed(part(probability=0).change, images) == 0
    assert count_changed(part(probability=1).change, images) == 200
    assert 40 < count_changed(part(probability=0.3).change, images) < 80
    assert count_changed(lambda one, rng: part(probability=1).change(one[0], rng)[None], images[:1]) == 1


@pytest.mark.parametrize("part", PARTS)
def test_each_image_has_its_own_draw_and_the_same_draws_give_the_same(part):
    image = grey_noise(1, 3, 16, 16).expand(4, -1, -1, -1).float()
    first, again = (part(probability=1).change(image, np.random.default_rng(8)) for _ in range(2))
    assert torch.equal(first, again)
    assert not torch.equal(first[0], first[1])


@pytest.mark.parametrize("part", [CameraBlur(probability=0.6), SensorNoise(read=(0, 0), probability=0.6)])
def test_gradients_are_those_of_finite_differences(part):
    check_gradient(lambda images: part.change(images, np.random.default_rng(2)), grey_noise(3, 3, 6, 7))


@pytest.mark.slow
def test_gradient_of_jpeg_is_that_of_the_file_without_its_rounding():
    """The rounding's own slope is zero; straight through, it counts as one."""
    images, quality = grey_noise(2, 3, 10, 18), np.array([30, 80])
    check_gradient(lambda some: compress(some, quality, rounding=lambda exact: exact), images)
    gradients = []
    for rounding in (round_straight, lambda exact: exact):
        at = images.clone().requires_grad_(True)
        weights = grey_noise(*images.shape, seed=5)
        gradients += torch.autograd.grad((compress(at, quality, rounding) * weights).sum(), at)
    torch.testing.assert_close(*gradients)


def test_defocus_alone_is_a_gaussian():
    image = as_tensor(photograph(40, 40))
    part = CameraBlur(defocus_px=(1.5, 1.5), motion_px=(0, 0), probability=1)
    wanted = gaussian_filter(image.numpy(), (0, 0, 1.5, 1.5), mode="nearest", radius=5)
    np.testing.assert_allclose(part.change(image, np.random.default_rng(0)).numpy(), wanted, atol=2e-4)


def test_motion_has_the_variance_of_a_line_along_it_and_the_gaussians_across():
    (kernel,) = make_kernels(np.array([1.0]), np.array([6.0]), np.array([np.radians(90)]))
    y, x = np.mgrid[: len(kernel), : len(kernel)] - len(kernel) // 2
    assert kernel.sum() == pytest.approx(1)
    assert (kernel * x**2).sum() == pytest.approx(1, rel=0.02)
    assert (kernel * y**2).sum() == pytest.approx(1 + 6**2 / 12, rel=0.02)  # 90° is down: x turns towards y


def test_a_flat_image_stays_flat_under_blur():
    image = torch.full((1, 3, 12, 12), 0.4, dtype=torch.float64)
    torch.testing.assert_close(CameraBlur(probability=1).change(image, np.random.default_rng(1)), image)


@pytest.mark.parametrize(("level", "shot", "read"), [(0.5, 0.04, 0.0), (0.2, 0.0, 0.01), (0.8, 0.03, 0.02)])
def test_noise_is_that_of_photons_and_counter_in_linear_light(level, shot, read):
    """Noise of the stated size is added to linear light and encoded again, by the root that the formula rests on."""
    noisy = SensorNoise(shot=(shot, shot), read=(read, read), probability=1).change(
        torch.full((3, 200, 200), level), np.random.default_rng(0)
    )
    linear = level**2 + np.random.default_rng(1).normal(0, np.sqrt(shot**2 * level**2 + read**2), 200_000)
    assert float(noisy.std()) == pytest.approx(np.sqrt(linear.clip(0)).std(), rel=0.05)  # in the dark the root bends
    assert float(noisy.mean()) == pytest.approx(level, abs=1e-3)


def test_grain_is_drawn_on_the_cpu_whatever_the_device():
    """The device `meta` computes nothing and has no generator: numbers of its own could not be drawn there."""
    noisy = SensorNoise(probability=1).change(torch.zeros(2, 3, 8, 8, device="meta"), np.random.default_rng(0))
    assert noisy.device.type == "meta" and noisy.shape == (2, 3, 8, 8)


def test_tables_are_those_that_pillow_writes():
    for quality in (1, 10, 49, 50, 75, 90, 100):
        buffer = BytesIO()
        Image.new("RGB", (16, 16)).save(buffer, "JPEG", quality=quality)
        written = Image.open(BytesIO(buffer.getvalue())).quantization
        for number, table in ((0, LUMA), (1, CHROMA)):
            assert quantise_tables(table, np.array([quality]))[0].tolist() == list(written[number])


@pytest.mark.parametrize("quality", [20, 50, 75, 95])
@pytest.mark.parametrize("size", [(80, 96), (75, 90)])
def test_jpeg_is_pillows(quality, size):
    """To within the rounding to 8 bits that a file needs at each stage; the codec's own loss is larger."""
    pixels = photograph(*size)
    buffer = BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=quality, subsampling="4:2:0")
    saved = np.asarray(Image.open(BytesIO(buffer.getvalue()))).astype(float)
    ours = compress(as_tensor(pixels), np.array([quality]))[0].permute(1, 2, 0).numpy() * 255
    loss = np.abs(saved - pixels).mean()
    apart = np.abs(ours - saved).mean()
    assert apart < 1.3
    assert apart < loss or quality == 95
    assert 10 * np.log10(255**2 / ((ours - saved) ** 2).mean()) > 40


def test_qualities_span_their_range():
    flat = grey_noise(64, 1, 16, 16).expand(
        -1, 3, -1, -1
    )  # without colour, of which 4:2:0 loses as much at any quality
    part = JpegFile(quality=(5, 95), probability=1)
    change = (part.change(flat, np.random.default_rng(0)) - flat).abs().mean(dim=(1, 2, 3))
    assert change.max() > 4 * change.min()
