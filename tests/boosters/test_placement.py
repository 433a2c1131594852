"""Placements against closed forms, and pictures on images against OpenCV's own warp."""

import cv2
import numpy as np
import pytest
import torch

from toolkit.boosters.apply import boost_images, is_whole
from toolkit.boosters.transforms.placement import Placement
from toolkit.core.errors import ToolkitError

SEEDS = list(range(400))


def test_the_draws_span_the_ranges_and_no_more():
    placed = Placement(rotation_deg=30, scale=(0.5, 1.5), translate=0.2).place_seeded(SEEDS, 10, 100)
    angle = np.degrees(np.arctan2(placed[:, 1, 0], placed[:, 0, 0]))
    scale = np.sqrt(np.linalg.det(placed[:, :2, :2]))
    centre = (placed @ [5, 5, 1])[:, :2]
    for values, low, high in ((angle, -30, 30), (scale, 0.5, 1.5), (centre[:, 0], 30, 70), (centre[:, 1], 30, 70)):
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high
        assert abs(values.mean() - (low + high) / 2) < 0.1 * (high - low)
    drawn = np.stack([angle, scale, *centre.T])
    assert np.abs(np.corrcoef(drawn) - np.eye(4)).max() < 0.2  # drawn apart from each other


def test_an_image_keeps_its_place_whatever_else_is_placed_and_whatever_the_size():
    placement = Placement()
    alone = placement.place_seeded([7], 50, 224)
    among = placement.place_seeded([1, 7, 3], 50, 224)
    np.testing.assert_array_equal(alone[0], among[1])
    other = placement.place_seeded([7], 100, 224)
    np.testing.assert_allclose(alone[0] @ [25, 25, 1], other[0] @ [50, 50, 1])
    np.testing.assert_array_equal(alone[0, :2, :2], other[0, :2, :2])


def test_a_patch_is_whole_where_all_its_ink_is_in_the_frame():
    placed = Placement().place_seeded(SEEDS[:60], 40, 100)
    whole = is_whole(placed, 40, 100)
    assert 0 < whole.mean() < 1
    shift = np.array([[0, 0, 200], [0, 0, 200]])
    for T_image_patch, is_inside in zip(placed, whole, strict=True):
        wide = cv2.warpAffine(np.ones((40, 40), np.float32), T_image_patch[:2] + shift, (500, 500))
        framed = wide[200:300, 200:300].sum()
        assert (framed > 0.995 * wide.sum()) == is_inside or abs(framed / wide.sum() - 0.995) < 0.01


def test_boosted_images_are_those_that_opencv_warps():
    rng = np.random.default_rng(1)
    smooth = cv2.GaussianBlur(rng.random((40, 40, 3), np.float32), (0, 0), 3)
    picture = (smooth - smooth.min()) / np.ptp(smooth)
    image = np.full((96, 96, 3), 0.25, np.float32)
    placement = Placement(rotation_deg=45, scale=(1.0, 1.1), translate=0.2)
    T_image_patch = placement.place_seeded([3], 40, 96)
    ours = boost_images(_planes(image), _planes(picture), placement, [3])[0].permute(1, 2, 0).numpy()
    # OpenCV's pixel centres are at whole numbers
    half, back = np.eye(3), np.eye(3)
    half[:2, 2], back[:2, 2] = 0.5, -0.5
    matrix = back @ T_image_patch[0] @ half
    paper = cv2.warpPerspective(picture, matrix, (96, 96), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    inside = cv2.warpPerspective(np.ones((40, 40), np.float32), matrix, (96, 96), flags=cv2.INTER_LINEAR)
    inner, outer = cv2.erode(inside, np.ones((5, 5))) > 0.99, cv2.dilate(inside, np.ones((5, 5))) < 0.01
    assert inner.sum() > 800 and outer.sum() > 4000
    assert np.abs(ours[inner] - paper[inner]).max() < 0.03
    np.testing.assert_allclose(ours[outer], 0.25, atol=0.5 / 255)  # the filter rings by less than half a level


def test_an_image_does_not_depend_on_the_others_of_its_batch():
    generator = torch.Generator().manual_seed(2)
    images, pictures = (torch.rand(8, 3, side, side, generator=generator) for side in (32, 12))
    together = boost_images(images, pictures, Placement(), SEEDS[:8])
    for k in range(8):
        alone = boost_images(images[k : k + 1], pictures[k : k + 1], Placement(), SEEDS[k : k + 1])
        np.testing.assert_allclose(alone[0], together[k], atol=1e-5)


def test_black_covers_what_is_below_it():
    image, black = torch.ones(1, 3, 32, 32), torch.zeros(1, 3, 12, 12)
    boosted = boost_images(image, black, Placement(rotation_deg=0, scale=(1, 1), translate=0), [0])
    assert boosted[..., 12:20, 12:20].max() < 1e-5
    assert float(boosted.sum() / 3) == pytest.approx(32 * 32 - 12 * 12, rel=1e-3)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"rotation_deg": 200}, "rotation_deg 200: expected 0 to 180 degrees"),
        ({"scale": (1.2, 1.1)}, "scale 1.2 1.1: expected two rising numbers from 0.1 to 2"),
        ({"translate": 0.7}, "translate 0.7: expected 0 to 0.5 of the image's side"),
    ],
)
def test_ranges_that_make_no_sense_are_refused(given, words):
    with pytest.raises(ToolkitError, match=words):
        Placement(**given)


def _planes(picture):
    return torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1)))[None]
