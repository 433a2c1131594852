import numpy as np
import pytest
import torch
from part_checks import check_gradient, count_changed, grey_noise

from toolkit.boosters.parts.glare import TapeGlare
from toolkit.core.errors import ToolkitError

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


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ({"strength": (0, 2)}, "glare strength range 0 to 2"),
        ({"width": (0.2, 0.1)}, "glare width range"),
        ({"length": (0, 1)}, "glare length range 0 to 1"),
        ({"strip_width": (-1, 1)}, "strip width range -1"),
        ({"probability": -1}, "glare probability -1"),
        ({"strip_probability": 3}, "strip probability 3"),
    ],
)
def test_impossible_ranges_are_one_clear_line(ranges, words):
    with pytest.raises(ToolkitError, match=words) as caught:
        TapeGlare(**ranges)
    assert "\n" not in str(caught.value)
