"""The printer's model against measured samples of its source, closed forms and finite differences."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from part_checks import check_gradient, count_changed, grey_noise
from PIL import Image
from scipy.ndimage import gaussian_filter1d

from toolkit.boosters.transforms.printing import LUMA, PrintProcess, gain_dots, mix_solids, spread_ink
from toolkit.imaging.colour import srgb_to_linear
from toolkit.imaging.printer import PAPER, SOLIDS
from toolkit.rooms.photos.prints.align import sample_image
from toolkit.rooms.photos.prints.colours import measure_error
from toolkit.rooms.photos.prints.find import find_patch

NOMINAL = PrintProcess(
    white=(1, 1), tint=0, density=(1, 1), chroma=(1, 1), dot_gain=(0, 0), bleed_mm=(0.001, 0.001), probability=1
)
# coverage of cyan, magenta, yellow in percent, and the measured X, Y, Z (D50): samples of FOGRA29L.txt
SAMPLES = [
    ((0, 40, 0), (59.38, 50.77, 47.35)),
    ((0, 70, 0), (45.62, 32.71, 30.98)),
    ((10, 0, 0), (76.12, 80.47, 74.36)),
    ((10, 10, 0), (69.46, 70.48, 66.57)),
]
BRADFORD_D50_TO_SRGB = np.array(
    [[3.1338561, -1.6168667, -0.4906146], [-0.9787684, 1.9161415, 0.0334540], [0.0719453, -0.2289914, 1.4052427]]
)


def encode(xyz) -> np.ndarray:
    linear = BRADFORD_D50_TO_SRGB @ np.array(xyz) / 100
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clip(0.0031308) ** (1 / 2.4) - 0.055).clip(0, 1)


def print_flat(part: PrintProcess, *colour: float) -> np.ndarray:
    flat = torch.tensor(colour, dtype=torch.float64).view(3, 1, 1).expand(3, 6, 6)
    return part.change(flat, np.random.default_rng(0))[:, 3, 3].numpy()


def test_white_is_paper_and_black_is_not_black():
    np.testing.assert_allclose(print_flat(NOMINAL, 1, 1, 1), PAPER, atol=1e-9)
    np.testing.assert_allclose(print_flat(NOMINAL, 0, 0, 0), SOLIDS[0, 0, 0], atol=1e-9)
    for seed in range(20):
        images = torch.tensor([0.0, 1.0]).view(2, 1, 1, 1).expand(2, 3, 4, 4)
        black, white = PrintProcess(probability=1).change(images, np.random.default_rng(seed))
        assert 0.02 < black.min() <= black.max() < 0.28  # photographs of real prints: 0.08 to 0.24 of paper
        assert 0.85 < white.min() <= white.max() < 1


@pytest.mark.parametrize(("coverage", "xyz"), SAMPLES)
def test_measured_tones_come_out_as_measured(coverage, xyz):
    np.testing.assert_allclose(print_flat(NOMINAL, *(1 - np.array(coverage) / 100)), encode(xyz), atol=0.03)


def test_the_solids_are_the_sources():
    for (r, g, b), xyz in [((1, 1, 1), (86.44, 89.31, 76.37)), ((0, 1, 1), (20.16, 27.07, 52.63)),
                           ((1, 0, 1), (37.72, 22.97, 20.87)), ((1, 1, 0), (70.42, 73.84, 10.82)),
                           ((0, 0, 0), (6.99, 7.03, 5.38)), ((0, 0, 1), (11.08, 10.39, 20.74)),
                           ((0, 1, 0), (12.25, 20.36, 10.06)), ((1, 0, 0), (33.23, 20.57, 7.02))]:  # fmt: skip
        np.testing.assert_allclose(SOLIDS[r, g, b], encode(xyz), atol=0.002)


def test_more_light_in_the_file_is_more_light_on_paper():
    """Each channel rises with its own, and so does the lightness, on every printer."""
    steps = torch.linspace(0, 1, 12, dtype=torch.float64)
    r, g, b = torch.meshgrid(steps, steps, steps, indexing="ij")
    cube = torch.stack([r, g, b]).reshape(1, 3, 12, 144)
    part = PrintProcess(bleed_mm=(0.001, 0.001), probability=1)
    weights = torch.tensor(LUMA, dtype=torch.float64)
    for seed in range(10):
        printed = part.change(cube, np.random.default_rng(seed)).reshape(3, 12, 12, 12)
        light = (printed * weights.view(3, 1, 1, 1)).sum(dim=0)
        for channel in range(3):
            assert printed[channel].diff(dim=channel).min() >= 0
            assert light.diff(dim=channel).min() > 0
        assert 0 <= printed.min() <= printed.max() <= 1


def test_dot_gain_is_what_it_says_at_half_coverage_and_nothing_at_the_ends():
    tones = torch.tensor([0.0, 0.5, 1.0], dtype=torch.float64).view(1, 3, 1, 1)
    gained = 1 - gain_dots(tones, np.array([0.15])).flatten()
    torch.testing.assert_close(gained, torch.tensor([1.0, 0.65, 0.0], dtype=torch.float64))


def test_bleeding_is_a_gaussian_on_the_printed_squares():
    """Against texels drawn 100 times as fine, blurred there, and averaged again."""
    row = np.random.default_rng(0).random(20)
    sigma = 0.31
    fine = gaussian_filter1d(row.repeat(100), sigma * 100, mode="nearest").reshape(20, 100).mean(axis=1)
    image = torch.from_numpy(row).view(1, 1, 1, 20).expand(1, 3, 5, 20)
    np.testing.assert_allclose(spread_ink(image, np.array([sigma]))[0, 1, 2].numpy(), fine, atol=1e-3)
    np.testing.assert_allclose(spread_ink(image.mT, np.array([sigma]))[0, 1, :, 2].numpy(), fine, atol=1e-3)


def test_gradients_are_those_of_finite_differences():
    part = PrintProcess(bleed_mm=(0.2, 0.4), probability=1)
    check_gradient(lambda patch: part.change(patch, np.random.default_rng(0)), grey_noise(3, 5, 5))
    check_gradient(lambda prints: part.change(prints, np.random.default_rng(0)), grey_noise(2, 3, 4, 5))
    check_gradient(mix_solids, grey_noise(1, 3, 2, 2))


def test_probability_is_kept():
    prints = grey_noise(100, 3, 5, 5)
    assert count_changed(PrintProcess(probability=0).change, prints) == 0
    assert count_changed(PrintProcess(probability=1).change, prints) == 100
    assert 30 < count_changed(PrintProcess(probability=0.5).change, prints) < 70
    patch = prints[0]
    assert PrintProcess(probability=0).change(patch, np.random.default_rng(0)) is patch


def test_printers_differ_within_their_ranges():
    white = torch.ones(300, 3, 3, 3, dtype=torch.float64)
    printed = PrintProcess(white=(0.9, 1.0), tint=0, probability=1).change(white, np.random.default_rng(0))
    share = printed[:, 0, 0, 0] / PAPER[0]
    assert 0.9 <= share.min() < 0.905
    assert 0.995 < share.max() <= 1


def fit_light(model: np.ndarray, seen: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """(n, 3) light over texels: for each channel a slope, by least squares weighted to what the eye sees."""
    weight = (seen + 0.02) ** (-2 / 3)
    fits = [
        np.linalg.lstsq(slope * (model[:, c] * weight[:, c])[:, None], seen[:, c] * weight[:, c], rcond=None)[0]
        for c in range(3)
    ]
    return np.clip(slope @ np.array(fits).T, 1e-3, None)


def measure_texels(file: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The sticker's file (n, n, 3) in [0, 1], which texels are usable (n, n), their linear light, and slope terms."""
    original = np.array(Image.open(file.parent / "originals" / f"{file.stem.split('_')[0]}.png").convert("RGB"))
    image, n = np.array(Image.open(file).convert("RGB")), len(original)
    sighting = find_patch(image, original)
    assert sighting is not None
    u, v = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n)
    at = sighting.warp.to_pixels(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(n, n, 2)
    share = sighting.warp.side_px / n
    texels = sample_image(cv2.blur(image, (max(1, round(share / 2)),) * 2), at)
    usable = texels.max(axis=2) < 250
    slope = np.stack([u - 0.5, v - 0.5, np.ones_like(u)], axis=-1)[usable]
    return original / 255, usable, srgb_to_linear(texels[usable] / 255.0), slope


def miss_of(file_linear: np.ndarray, seen: np.ndarray, slope: np.ndarray) -> float:
    """Median ΔE00 between texels as a process has them, as shares of its paper, and as they are seen, light fitted."""
    return measure_error(seen / fit_light(file_linear, seen, slope), file_linear).median


@pytest.mark.slow
@pytest.mark.parametrize("sticker", ["basketball1", "basketball2", "bear1", "bear2"])
def test_the_ranges_hold_real_prints(sticker, shared):
    """Eight of sixteen photographs; the ranges were set on the other eight, after all sixteen were seen."""
    part = PrintProcess(probability=1, tint=0)
    middle = [np.mean(one) for one in (part.bleed_mm, part.dot_gain, part.chroma, part.density)]
    rng, paper = np.random.default_rng(0), srgb_to_linear(PAPER)
    tries = [middle, *[list(row) for row in zip(*part.draw(rng, 40)[:4], strict=True)]]
    for file in sorted((shared / "photos/stickers-keyboard").glob(f"{sticker}_6in_*.jpg")):
        original, usable, seen, slope = measure_texels(file)
        pixels = torch.from_numpy(original).permute(2, 0, 1)[None]
        misses = []
        for bleed, gain, chroma, density in tries:
            drawn = (*(np.array([one]) for one in (bleed, gain, chroma, density)), np.ones((1, 3)))
            printed = part.apply(pixels, drawn)[0].permute(1, 2, 0).numpy()[usable]
            misses.append(miss_of(srgb_to_linear(printed) / paper, seen, slope))
        identity = miss_of(srgb_to_linear(original[usable]), seen, slope)
        assert misses[0] < 0.9 * identity and min(misses) < 7, (file.name, identity, misses[0], min(misses))
