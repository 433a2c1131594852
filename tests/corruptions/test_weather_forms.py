"""Weather against HSV by the standard library, the diamond-square loop written out, and figures of the draws."""

import colorsys

import numpy as np
import pytest
import torch

from toolkit.core.draws import RandomStreams
from toolkit.corruptions.batch import corrupt
from toolkit.corruptions.catalogue import CORRUPTIONS, SEVERITIES
from toolkit.corruptions.weather import PANES, cut_frost, draw_clouds, draw_panes

CPU = torch.device("cpu")


def make_colours() -> torch.Tensor:
    """(1, 3, 20, 20): random colours, and black, white, greys and the pure colours."""
    colours = np.random.default_rng(0).random((400, 3))
    colours[:9] = [
        [0, 0, 0],
        [1, 1, 1],
        [0.5] * 3,
        [0.01] * 3,
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
        [1, 1, 0],
        [0, 0.3, 0.3],
    ]
    return torch.from_numpy(colours.astype(np.float32)).reshape(1, 20, 20, 3).permute(0, 3, 1, 2).contiguous()


def change_hsv(images: torch.Tensor, change) -> np.ndarray:
    rows = images[0].permute(1, 2, 0).reshape(-1, 3).double().tolist()
    changed = [colorsys.hsv_to_rgb(*change(*colorsys.rgb_to_hsv(*row))) for row in rows]
    return np.array(changed).reshape(20, 20, 3).transpose(2, 0, 1)


@pytest.mark.parametrize("severity", SEVERITIES)
def test_brightness_adds_to_v(severity):
    colours = make_colours()
    amount = CORRUPTIONS["brightness"].parameters["imagenet"][severity - 1]
    expected = change_hsv(colours, lambda h, s, v: (h, s, min(v + amount, 1)))
    ours = corrupt(colours, "brightness", severity, [0], "imagenet")
    assert np.abs(ours[0].numpy() - expected).max() < 1e-6


@pytest.mark.parametrize("severity", SEVERITIES)
def test_saturate_changes_s(severity):
    colours = make_colours()
    factor, summand = CORRUPTIONS["saturate"].parameters["imagenet"][severity - 1]
    expected = change_hsv(colours, lambda h, s, v: (h, min(s * factor + summand, 1), v))
    ours = corrupt(colours, "saturate", severity, [0], "imagenet")
    assert np.abs(ours[0].numpy() - expected).max() < 2e-5


def grow_by_loop(side: int, decay: float, shifts: list[float]) -> np.ndarray:
    """The diamond-square algorithm one point at a time."""
    field, given = np.zeros((side, side)), iter(shifts)
    step, bound = side, 100.0**2
    while step >= 2:
        half = step // 2
        for y in range(0, side, step):
            for x in range(0, side, step):
                corners = [field[(y + dy) % side, (x + dx) % side] for dy in (0, step) for dx in (0, step)]
                field[y + half, x + half] = np.mean(corners) + bound * next(given)
        for first_y, first_x in ((0, half), (half, 0)):
            for y in range(first_y, side, step):
                for x in range(first_x, side, step):
                    around = ((half, 0), (-half, 0), (0, half), (0, -half))
                    mean = np.mean([field[(y + dy) % side, (x + dx) % side] for dy, dx in around])
                    field[y, x] = mean + bound * next(given)
        step, bound = half, bound / decay**2
    return (field - field.min()) / (field.max() - field.min())


@pytest.mark.parametrize("decay", [1.4, 3.0])
def test_clouds_are_diamond_square(decay):
    clouds = draw_clouds(32, decay, RandomStreams([8, 9], "fog", 1, CPU)).numpy()
    for seed, cloud in zip((8, 9), clouds, strict=True):
        shifts = (RandomStreams([seed], "fog", 1, CPU).uniform(32**2 - 1)[0].double() * 2 - 1).tolist()
        assert np.abs(cloud - grow_by_loop(32, decay, shifts)).max() < 1e-5
        assert cloud.min() == 0 and cloud.max() == 1


@pytest.mark.parametrize("severity", SEVERITIES)
def test_fog_keeps_the_brightest_value_in_reach_and_scales_detail(severity):
    strength = CORRUPTIONS["fog"].parameters["imagenet"][severity - 1][0]
    step = torch.full((1, 3, 224, 224), 0.2)
    step[..., 112:] = 0.8
    spoilt = corrupt(step, "fog", severity, [1])
    flat = corrupt(torch.full_like(step, 0.8), "fog", severity, [1])
    # the same clouds: what differs is the image's own detail, scaled by max / (max + strength)
    assert torch.allclose(spoilt[..., 112:], flat[..., 112:], atol=1e-6)
    assert torch.allclose((flat - spoilt)[..., :112], torch.tensor(0.6 * 0.8 / (0.8 + strength)), atol=1e-5)
    assert spoilt.max() <= 0.8 + 1e-6


def test_snow_whitens_by_its_share_and_falls_steeply():
    dark = torch.zeros(6, 3, 224, 224)
    for severity in SEVERITIES:
        kept = CORRUPTIONS["snow"].parameters["imagenet"][severity - 1][-1]
        spoilt = corrupt(dark, "snow", severity, range(6))
        # black becomes half grey by (1 - kept); flakes only add
        assert spoilt.min() == pytest.approx((1 - kept) * 0.5, abs=1e-6)
        assert torch.equal(spoilt[:, 0], spoilt[:, 2])
        flakes = spoilt[:, 0] - (1 - kept) * 0.5
        assert torch.allclose(flakes, flakes.flip(1, 2), atol=1e-6)  # once as they are, once turned by 180°
    across, down = (flakes.diff(dim=axis).abs().mean() for axis in (2, 1))
    assert across > 1.3 * down


def test_frost_is_a_blend_with_a_piece_of_a_pane():
    pane = torch.stack(cut_frost(224, 224, 1, RandomStreams([1, 2, 3], "frost", 3, CPU)))
    image = torch.rand(3, 3, 224, 224)
    assert torch.allclose(corrupt(image, "frost", 3, [1, 2, 3]), (0.7 * image + 0.7 * pane).clamp(0, 1), atol=1e-6)


def test_frost_panes_have_the_photographs_figures():
    for pane, wanted in zip(draw_panes(), PANES, strict=True):
        grey = pane @ np.array([0.299, 0.587, 0.114])
        assert np.allclose(pane.mean((0, 1)), wanted.mean, atol=0.01)
        pieces = [grey[y : y + 224, x : x + 224].std() for y in range(0, 417, 104) for x in range(0, 417, 104)]
        assert np.mean(pieces) == pytest.approx(wanted.contrast, rel=0.1)
        # no seam: neighbours across the edge differ no more than neighbours elsewhere
        steps = np.abs(np.diff(grey, axis=0, append=grey[:1])).mean(1)
        assert steps[-1] < 1.3 * steps[:-1].mean()


def test_frost_takes_every_pane_and_repeats_on_large_images():
    pieces = torch.stack(cut_frost(32, 32, 0.2, RandomStreams(range(60), "frost", 1, CPU)))
    means = torch.tensor([pane.mean for pane in PANES])[:, :, None, None].mean((2, 3))
    nearest = (pieces.mean((2, 3))[:, None] - means).square().sum(2).argmin(1)
    assert set(nearest.tolist()) >= {0, 1, 3, 4}
    wide = cut_frost(32, 1400, 1, RandomStreams([0], "frost", 1, CPU))[0]
    assert torch.equal(wide[..., :100], wide[..., 640:740])


@pytest.mark.parametrize("severity", SEVERITIES)
def test_spatter_of_water_adds_turquoise_and_of_mud_covers(severity):
    black = torch.zeros(4, 3, 224, 224)
    spoilt = corrupt(black, "spatter", severity, range(4))
    strength = CORRUPTIONS["spatter"].parameters["imagenet"][severity - 1][4]
    colour = np.array([63, 42, 20] if severity > 3 else [175, 238, 238]) / 255
    wet = spoilt.sum(1) > 0.01
    assert 0.001 < wet.float().mean() < 0.4
    for channel in range(3):
        ratio = (spoilt[:, channel] / spoilt.sum(1))[wet]
        assert torch.allclose(ratio, torch.tensor(colour[channel] / colour.sum(), dtype=torch.float32), atol=1e-3)
    brightest = spoilt.amax((1, 2, 3))
    expected = colour.max() if severity > 3 else strength * colour.max()
    assert torch.allclose(brightest, torch.tensor(expected, dtype=torch.float32), atol=1e-3)
    if severity > 3:  # mud hides what is beneath, never less than 0.8 of it
        assert corrupt(torch.ones_like(black), "spatter", severity, range(4))[:, 2][wet].max() <= 1 - 0.8 * (
            1 - 20 / 255
        )
