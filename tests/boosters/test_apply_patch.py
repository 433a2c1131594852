"""`apply_patch` against pastes by hand, torchvision's rotation, and finite differences."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from torchvision.transforms.functional import InterpolationMode, rotate

from toolkit.boosters.apply import apply_patch
from toolkit.boosters.transforms.placement import AffineRanges
from toolkit.core.errors import ToolkitError


@dataclass(frozen=True)
class Fixed:
    """Always the same similarity: turned by `angle_deg` clockwise, its first corner or its middle at a place."""

    left: float = 0.0
    top: float = 0.0
    angle_deg: float = 0.0

    def place(self, rng, count, patch_px, image_px):
        c, s = np.cos(np.radians(self.angle_deg)), np.sin(np.radians(self.angle_deg))
        linear = np.array([[c, -s], [s, c]])
        middle = np.full(2, patch_px / 2)
        T_image_patch = np.eye(3)
        T_image_patch[:2, :2] = linear
        T_image_patch[:2, 2] = np.array([self.left, self.top]) + middle - linear @ middle
        return np.repeat(T_image_patch[None], count, axis=0)


def make_images(count=3, height=40, width=40, dtype=torch.float32):
    return torch.rand(count, 3, height, width, generator=torch.Generator().manual_seed(1), dtype=dtype) * 0.8 + 0.1


def make_patch(n=12, dtype=torch.float32):
    return torch.rand(3, n, n, generator=torch.Generator().manual_seed(2), dtype=dtype) * 0.8 + 0.1


def smooth_patch(n=24):
    y, x = torch.meshgrid(*[(torch.arange(n) + 0.5) / n] * 2, indexing="ij")
    return torch.stack([x, y, (1 + torch.sin(3 * x) * torch.cos(3 * y)) / 2]) * 0.8 + 0.1


def test_at_whole_pixels_it_is_a_paste():
    images, patch = make_images(), make_patch()
    expected = images.clone()
    expected[:, :, 5:17, 9:21] = patch
    assert torch.allclose(apply_patch(images, patch, placement=Fixed(left=9, top=5)), expected, atol=2e-5)


def test_a_patch_for_each_image_and_a_cut_at_the_edge():
    images = make_images(2)
    patches = torch.stack([make_patch(), 1 - make_patch()])
    expected = images.clone()
    expected[:, :, :8, 32:] = patches[:, :, 4:, :8]
    assert torch.allclose(apply_patch(images, patches, placement=Fixed(left=32, top=-4)), expected, atol=2e-5)


@pytest.mark.parametrize(("height", "width", "top", "left"), [(30, 50, 3, 12), (50, 30, 13, 2)])
def test_it_lies_in_the_central_square_of_an_image_that_is_none(height, width, top, left):
    images, patch = make_images(2, height, width), make_patch()
    expected = images.clone()
    expected[:, :, top : top + 12, left : left + 12] = patch
    assert torch.allclose(apply_patch(images, patch, placement=Fixed(left=2, top=3)), expected, atol=2e-5)


def test_a_turn_agrees_with_torchvisions():
    patch = smooth_patch()
    canvas, mask = torch.zeros(3, 48, 48), torch.zeros(1, 48, 48)
    canvas[:, 12:36, 12:36], mask[:, 12:36, 12:36] = patch, 1
    # torchvision turns counter-clockwise
    turned, inside = (rotate(one, -30, InterpolationMode.BILINEAR) for one in (canvas, mask))
    images = make_images(1, 48, 48)
    found = apply_patch(images, patch, placement=Fixed(12, 12, angle_deg=30))
    expected = images * (1 - inside) + turned
    deep = torch.nn.functional.avg_pool2d(inside[None], 5, 1, 2)[0, 0] == 1
    away = torch.nn.functional.max_pool2d(inside[None], 5, 1, 2)[0, 0] == 0
    assert deep.sum() > 250 and away.sum() > 1000
    assert (found - expected)[0][:, deep].abs().max() < 0.02
    # the filter's ripples die out, they do not stop
    assert (found - expected)[0][:, away].abs().max() < 0.03
    assert (found - expected)[0][:, away].abs().mean() < 0.003


def test_a_mask_shows_the_image_below():
    images, patch = make_images(), make_patch()
    mask = torch.zeros(12, 12)
    mask[3:9, 2:10] = 1
    mask[3:5] *= 0.25
    expected = images.clone()
    expected[:, :, 5:17, 9:21] = images[:, :, 5:17, 9:21] * (1 - mask) + patch * mask
    found = apply_patch(images, patch, placement=Fixed(left=9, top=5), mask=mask)
    assert torch.allclose(found, expected, atol=2e-5)


def test_black_texels_are_opaque():
    found = apply_patch(make_images(), torch.zeros(3, 12, 12), placement=Fixed(left=9, top=5))
    assert found[:, :, 5:17, 9:21].abs().max() < 2e-5


@pytest.mark.slow
@pytest.mark.parametrize("masked", [False, True])
def test_the_gradients_are_those_of_finite_differences(masked):
    images = make_images(2, 9, 8, torch.float64) * 0.5 + 0.2
    patch = make_patch(4, torch.float64) * 0.5 + 0.2
    mask = torch.rand(4, 4, generator=torch.Generator().manual_seed(3), dtype=torch.float64) if masked else None
    images.requires_grad_(True)
    patch.requires_grad_(True)
    assert torch.autograd.gradcheck(lambda x, p: apply_patch(x, p, 7, mask=mask), (images, patch), atol=1e-6)


def test_an_image_depends_on_its_own_seed_alone():
    images, patch = make_images(6), make_patch()
    whole = apply_patch(images, patch, 3)
    assert torch.equal(whole, apply_patch(images, patch, 3))
    assert torch.allclose(whole[:2], apply_patch(images[:2], patch, 3), atol=1e-6)
    assert not torch.allclose(whole, apply_patch(images, patch, 4), atol=0.05)
    seeded = apply_patch(images, patch, [5, 6, 7, 8, 9, 10])
    turned = apply_patch(images.flip(0), patch, [10, 9, 8, 7, 6, 5]).flip(0)
    assert torch.allclose(seeded, turned, atol=1e-6)


def test_the_side_is_a_share_of_the_image():
    plain = AffineRanges(share=(0.3, 0.3), foreshortening=(1, 1))
    found = apply_patch(torch.zeros(8, 3, 100, 100), torch.ones(3, 10, 10), placement=plain)
    assert found[:, 0].sum(dim=(1, 2)).numpy() == pytest.approx(900, rel=0.03)


def test_half_precision_stays_half():
    found = apply_patch(make_images().half(), make_patch(), placement=Fixed(left=9, top=5))
    assert found.dtype == torch.float16


def test_no_images_are_no_trouble():
    assert apply_patch(torch.zeros(0, 3, 40, 40), make_patch()).shape == (0, 3, 40, 40)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((torch.zeros(3, 8, 8), make_patch()), r"images: expected \(b, 3, h, w\).*got \(3, 8, 8\)"),
        ((torch.zeros(1, 3, 8, 8, dtype=torch.uint8), make_patch()), "images: .*torch.uint8"),
        ((make_images(), torch.zeros(3, 8, 9)), r"patch: .*got \(3, 8, 9\)"),
        ((make_images(), torch.zeros(2, 3, 8, 8)), "b = 3 images"),
        ((make_images(), torch.zeros(3, 8, 8, dtype=torch.uint8)), "divide 8-bit pixels by 255"),
        ((make_images(), make_patch(), [1, 2]), "seed: expected one number, or 3"),
    ],
)
def test_what_does_not_fit_is_named(arguments, words):
    with pytest.raises(ToolkitError, match=words):
        apply_patch(*arguments)


def test_a_mask_of_another_size_is_named():
    with pytest.raises(ToolkitError, match=r"mask: expected \(12, 12\).*got \(3, 3\)"):
        apply_patch(make_images(), make_patch(), mask=torch.ones(3, 3))
