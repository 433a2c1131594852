"""Cutout and block shuffle by their published formulas; off unless they are asked for."""

import numpy as np
import pytest
import torch
from torchvision.transforms.functional import InterpolationMode, rotate

from toolkit.boosters.patch_config import PatchConfig
from toolkit.boosters.texture_config import TextureConfig
from toolkit.boosters.transforms.transfer import BlockShuffle, Cutout, divide


def pictures(count=2, px=20):
    return torch.rand(count, 3, px, px, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


def test_cutout_hides_a_square_of_the_share_about_its_middle():
    """T-SEA: a side of 0.4, filled with 0.5, elsewhere the patch as it is."""
    patch = pictures(1)
    found = Cutout().apply(patch, (np.array([[0.5, 0.3]]),))[0]
    hidden = (found == 0.5).all(0)
    assert torch.equal(hidden, (found != patch[0]).any(0))
    rows, columns = (np.flatnonzero(hidden.any(axis).numpy()) for axis in (1, 0))
    assert rows.tolist() == list(range(2, 10)) and columns.tolist() == list(range(6, 14))
    assert hidden.sum() == 64, "0.16 of 400"


def test_cutout_acts_in_nine_of_ten_steps_with_its_middle_anywhere_in_the_patch():
    rng = np.random.default_rng(0)
    patch = pictures(1)[0]
    changed = [not torch.equal(Cutout().change(patch, rng), patch) for _ in range(400)]
    assert np.mean(changed) == pytest.approx(0.9, abs=0.05)
    (middle,) = Cutout().draw(rng, 4000)
    assert middle.min() >= -0.05 and middle.max() <= 1.05
    assert middle.mean(0) == pytest.approx([0.5, 0.5], abs=0.02)
    assert middle.var(0) == pytest.approx([1.1**2 / 12] * 2, rel=0.05), "even from -0.05 to 1.05, as in its release"


def test_the_gradient_reaches_what_is_not_hidden_alone():
    patch = pictures(1).requires_grad_(True)
    Cutout().apply(patch, (np.array([[0.5, 0.5]]),)).sum().backward()
    assert patch.grad.sum() == 3 * (400 - 64) and set(patch.grad.unique().tolist()) == {0.0, 1.0}


def test_blocks_lie_where_their_order_says():
    """Two by two with no angle: strips of 5 and 15 rows change places, and so do the blocks of the second."""
    photo = pictures(1)
    sizes = np.array([[[1.0, 3.0], [1.0, 1.0], [1.0, 4.0]]])
    orders, angles = np.array([[[1, 0], [0, 1], [1, 0]]]), np.zeros((1, 2, 2))
    down = BlockShuffle().apply(photo, (np.array([0]), sizes, orders, angles))[0]
    first = torch.cat([photo[0, :, 5:, 4:], photo[0, :, 5:, :4]], 2)
    assert torch.allclose(down, torch.cat([first, photo[0, :, :5]], 1))
    right = BlockShuffle().apply(photo.mT, (np.array([1]), sizes, orders, angles))[0]
    assert torch.allclose(right, down.mT), "along the other axis the same of the picture on its side"


def test_without_an_angle_pixels_change_places_alone_and_one_block_is_turned_whole():
    photos, rng = pictures(3), np.random.default_rng(1)
    moved = BlockShuffle(blocks=4, max_angle_deg=0, probability=1).change(photos, rng)
    assert not torch.allclose(moved, photos)
    assert torch.allclose(moved.flatten(2).sort(2)[0], photos.flatten(2).sort(2)[0])
    whole = BlockShuffle(blocks=1)
    drawn = whole.draw(rng, 3)
    turned = [
        rotate(one, float(a), InterpolationMode.BILINEAR) for one, a in zip(photos, drawn[3].ravel(), strict=True)
    ]
    assert torch.allclose(whole.apply(photos, drawn), torch.stack(turned))


def test_angles_and_sizes_are_as_published():
    _, sizes, orders, angles = BlockShuffle().draw(np.random.default_rng(0), 2000)
    assert np.abs(angles).max() <= 24 and angles.std() == pytest.approx(24 / 3**0.5, rel=0.03)
    assert (orders[..., 0] == 0).mean() == pytest.approx(0.5, abs=0.03)
    for one in sizes[:50, 0]:
        parts = divide(224, one)
        assert sum(parts) == 224 and np.abs(np.array(parts) - 224 * one / one.sum()).max() <= 1


def test_the_gradient_agrees_with_a_difference():
    photos = pictures(1, px=8).requires_grad_(True)
    drawn = BlockShuffle().draw(np.random.default_rng(4), 1)
    assert torch.autograd.gradcheck(lambda x: BlockShuffle().apply(x, drawn), photos)


def test_they_are_off_and_leave_no_trace_unless_asked_for():
    assert PatchConfig().cutout is None and PatchConfig().block_shuffle is None
    assert not {"cutout", "block_shuffle"} & {*PatchConfig().record(), *TextureConfig().record()}
    asked = PatchConfig().with_overrides({"cutout": True, "block_shuffle": True})
    assert [type(one) for one in asked.transforms("network")] == [BlockShuffle]
    assert Cutout in [type(one) for one in asked.transforms("print")]
    assert asked.record()["cutout"] == {"share": 0.4, "probability": 0.9}
