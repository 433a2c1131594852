import numpy as np
import pytest
import torch
from part_checks import check_gradient, count_changed, grey_noise

from toolkit.boosters.transforms.printing import TapeGlare

SHINE = {"probability": 1, "strip_probability": 0}
STRIP = {"probability": 0, "strip_probability": 1}


def square_mask(count: int, side: int = 40, margin: int = 8) -> torch.Tensor:
    mask = torch.zeros(count, 1, side, side, dtype=torch.float64)
    mask[..., margin:-margin, margin:-margin] = 1
    mask[..., margin, :] *= 0.5  # a rim that the patch half covers
    return mask


def cover(count: int = 60, **settings) -> tuple[torch.Tensor, torch.Tensor]:
    """Black paper under tape, and its mask."""
    mask = square_mask(count)
    black = torch.zeros(count, 3, 40, 40, dtype=torch.float64)
    return TapeGlare(**settings).light(black, mask, np.random.default_rng(1)), mask


@pytest.mark.parametrize("kind", [SHINE, STRIP])
def test_nothing_happens_beside_the_paper_and_half_of_it_on_a_half_covered_rim(kind):
    covered, mask = cover(**kind)
    assert covered[(mask == 0).expand_as(covered)].abs().max() == 0
    assert (covered <= mask + 1e-9).all()
    assert covered.max() > 0.3


def test_shine_is_soft_bright_and_has_the_width_asked_for():
    """A long band: the share of light over a line across it is that of a Gaussian."""
    covered, _ = cover(width=(0.1, 0.1), length=(40, 40), strength=(0.8, 0.8), **SHINE)
    assert covered.max() <= 0.8 + 1e-9
    assert covered.amax(dim=(1, 2, 3)).median() > 0.7
    inner = covered[:, :, 10:-10, 10:-10]
    assert inner.diff(dim=2).abs().max() < 0.8 * np.exp(-0.5) / 0.1 / 23.5 * 1.05, "no edge steeper than the Gaussian's"
    side = 24 * np.sqrt(23.5 / 24)
    crossing = [one for one in covered if one[0, 12:-12, 12:-12].max() > 0.79 and one[0, 8:-8, 8:-8].min() < 0.01]
    areas = [float(one[0].sum()) / (0.8 * 0.1 * side * np.sqrt(2 * np.pi)) for one in crossing]
    assert 0.6 * side < np.median(areas) < 1.45 * side  # a chord of the square


def test_a_strip_hides_what_is_below():
    mask = square_mask(40)
    part = TapeGlare(strip_width=(0.3, 0.3), **STRIP)
    papers = [torch.full((40, 3, 40, 40), value, dtype=torch.float64) * mask for value in (0.0, 1.0)]
    dark, light = (part.light(paper, mask, np.random.default_rng(3)) for paper in papers)
    hidden = ((light - dark).abs().amax(dim=1, keepdim=True) < 1e-9) & (mask == 1)
    share = hidden.sum(dim=(1, 2, 3)) / mask.sum(dim=(1, 2, 3))
    assert 0.15 < share.median() < 0.45
    assert share.min() > 0


def test_probabilities_are_kept_each_for_itself():
    mask = square_mask(300)
    paper = 0.5 * mask.expand(-1, 3, -1, -1)

    def count(**settings) -> int:
        return count_changed(lambda some, rng: TapeGlare(**settings).light(some, mask, rng), paper)

    assert count(probability=0, strip_probability=0) == 0
    assert count(**SHINE) == count(**STRIP) == 300
    assert 60 < count(probability=0.3, strip_probability=0) < 120
    assert 15 < count(probability=0, strip_probability=0.1) < 50


def test_gradients_are_those_of_finite_differences():
    mask = square_mask(2, side=10, margin=2)
    part = TapeGlare(probability=1, strip_probability=1)
    check_gradient(lambda paper: part.light(paper, mask, np.random.default_rng(0)), grey_noise(2, 3, 10, 10))


def places(mask: torch.Tensor) -> tuple[np.ndarray, np.ndarray, float]:
    """Columns and rows of all pixels, and the patch's side in pixels: the root of its area."""
    row, column = np.mgrid[: mask.shape[-2], : mask.shape[-1]] + 0.5
    return column, row, float(mask[0].sum()) ** 0.5


@pytest.mark.parametrize(("width", "length"), [(0.12, 0.12), (0.15, 0.5), (0.25, 0.9)])
def test_shine_is_a_gaussian_of_the_width_length_and_strength_asked_for(width, length):
    """Its logarithm is a paraboloid: the curvatures are 1 / width² and 1 / length², its top the strength."""
    covered, mask = cover(20, width=(width, width), length=(length, length), strength=(0.8, 0.8), **SHINE)
    x, y, side = places(mask)
    for one, inside in zip(covered.numpy(), mask[:, 0].numpy() == 1, strict=True):
        bright = inside & (one[0] > 1e-4)
        u, v = x[bright] / side, y[bright] / side
        terms = np.stack([np.ones_like(u), u, v, u * u / 2, u * v, v * v / 2], axis=1)
        found, left, *_ = np.linalg.lstsq(terms, np.log(one[:, bright]).T, rcond=None)
        assert left.max() < 1e-12
        for height, *slope, uu, uv, vv in found.T:
            curvature = np.array([[uu, uv], [uv, vv]])
            np.testing.assert_allclose(np.linalg.eigvalsh(-curvature), [1 / length**2, 1 / width**2], rtol=1e-6)
            middle = -np.linalg.solve(curvature, slope)
            assert 0.94 * 0.8 - 1e-9 < np.exp(height + middle @ slope / 2) < 0.8 + 1e-9
            assert np.hypot(*(middle - 20 / side)) < 0.5 * 2**0.5 + 0.02  # on the patch, whatever way it points


def test_a_strip_has_the_width_asked_for_and_an_edge_of_one_pixel():
    """Its cover is a ramp on either side; the ramps rise by one a pixel, and their middles lie its width apart."""
    covered, mask = cover(60, strip_width=(0.3, 0.3), **STRIP)
    x, y, side = places(mask)
    measured = 0
    for one, inside in zip(covered.numpy(), mask[:, 0].numpy() == 1, strict=True):
        alpha = one[0] / one[0][inside].max()
        ramp = inside & (alpha > 0.01) & (alpha < 0.99)
        full = inside & (alpha > 1 - 1e-9)
        if full.sum() < 100 or ramp.sum() < 20:
            continue
        points = np.stack([x[ramp], y[ramp]], axis=1)
        normal = np.linalg.eigh(np.cov(np.stack([x[full], y[full]])))[1][:, 0]  # to tell the two sides apart, roughly
        middle = np.array([x[full].mean(), y[full].mean()])
        offsets = []
        for sign in (1, -1):
            beside = sign * ((points - middle) @ normal) > 0
            if beside.sum() < 8:
                break
            terms = np.column_stack([points[beside], np.ones(beside.sum())])
            plane, left, rank, _ = np.linalg.lstsq(terms, alpha[ramp][beside], rcond=None)
            if rank < 3 or left.size == 0 or left[0] > 1e-9:
                break
            assert np.hypot(plane[0], plane[1]) == pytest.approx(1, rel=1e-6)
            offsets.append((plane[2] - 0.5, plane[:2]))
        if len(offsets) == 2:
            (one_side, direction), (other_side, opposite) = offsets
            np.testing.assert_allclose(direction, -opposite, atol=1e-6)
            assert one_side + other_side == pytest.approx(0.3 * side, rel=1e-6)
            measured += 1
    assert measured >= 5


def test_cover_mixes_in_proportion():
    """Where shine is half as strong, half of the paper is seen through it: out = paper + alpha (colour - paper)."""
    mask = square_mask(30)
    part = TapeGlare(strength=(0.6, 0.6), **SHINE)
    dark, mid, light = (
        part.light(torch.full((30, 3, 40, 40), value, dtype=torch.float64) * mask, mask, np.random.default_rng(2))
        for value in (0.0, 0.5, 1.0)
    )
    inside = (mask == 1).expand_as(dark)
    torch.testing.assert_close((dark + light)[inside], 2 * mid[inside])
    alpha = 1 - (light - dark)[inside]
    assert 0.55 < alpha.max() <= 0.6 + 1e-9 and alpha.min() >= 0
    colour = (dark[inside] / alpha.clamp_min(1e-9))[alpha > 1e-6]
    assert colour.min() > 0.94 - 1e-6 and colour.max() < 1 + 1e-6
