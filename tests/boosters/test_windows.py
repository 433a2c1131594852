import numpy as np
import torch

from toolkit.boosters.transforms.placement import AffineRanges
from toolkit.boosters.transforms.show import (
    Appearance,
    cut_windows,
    find_windows,
    paste_windows,
    show_patch,
    warp_patch,
)
from toolkit.core.draws import Draws

RANGES = AffineRanges(overhang=0.3)


def test_pasting_through_windows_is_pasting_into_the_whole_image():
    images, patch = torch.rand(12, 3, 96, 96), torch.rand(3, 40, 40)
    T = RANGES.place(Draws(3, 5).of("AffineRanges"), 12, 40, 96)
    paper, mask = warp_patch(patch, T, 96)
    whole = (images * (1 - mask) + paper).clamp(0, 1)
    shown = show_patch(patch, images, Appearance(RANGES), Draws(3, 5))
    assert find_windows(T, 40, 96)[1] < 70
    # the filter's faint tail beyond two pixels is all that the windows cut off
    assert (shown - whole).abs().max() < 0.05
    assert (shown - whole).abs().mean() < 1e-4


def test_windows_lie_inside_and_hold_the_patch():
    T = RANGES.place(np.random.default_rng(0), 300, 50, 96)
    corners, side = find_windows(T, 50, 96)
    assert corners.min() >= 0
    assert corners.max() + side <= 96
    square = np.array([[0, 50, 50, 0], [0, 0, 50, 50], [1, 1, 1, 1]], float)
    points = np.clip((T @ square)[:, :2], 0, 96)
    assert (points.min(axis=2) >= corners).all()
    assert (points.max(axis=2) <= corners + side).all()


def test_gradients_of_pasting_match_finite_differences():
    corners = np.array([[0, 2], [3, 1]])
    images = torch.rand(2, 1, 6, 6, dtype=torch.float64, requires_grad=True)
    windows = torch.rand(2, 1, 3, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda below, above: paste_windows(below, above, corners), (images, windows))
    pasted = paste_windows(images, windows, corners)
    assert torch.equal(cut_windows(pasted, corners, 3), windows)
    assert torch.equal(pasted[0, 0, :2], images[0, 0, :2])
