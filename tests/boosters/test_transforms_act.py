"""Every transform that a recipe's fields hold changes the picture, and so does one that was added by the book."""

import numpy as np
import pytest
import torch
from texture_parts import make_crate, render_linear
from tiny_network import tiny_classifier

from toolkit.boosters import patch_config, texture_config
from toolkit.boosters.linear_view import batch_views
from toolkit.boosters.patch_config import PatchConfig
from toolkit.boosters.pixels import Target, judge_ensemble
from toolkit.boosters.texture import take_photos
from toolkit.boosters.texture_config import TextureConfig
from toolkit.boosters.transforms import ImageTransform, PaperTransform, Probability, as_factors
from toolkit.boosters.transforms.camera import CameraBlur, Exposure, Jitter, JpegFile, SensorNoise
from toolkit.boosters.transforms.printing import LightRanges, PrintProcess, TapeGlare
from toolkit.boosters.transforms.show import show_patch
from toolkit.boosters.transforms.weather import Fog
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError

DRAWS = Draws(0, 3)


class Veil(ImageTransform):
    """A transform by docs/contributing.md: half of the light is gone."""

    probability: Probability = 1.0

    def draw(self, rng, count):
        return (np.full(count, 2.0),)

    def apply(self, some, drawn):
        return some / as_factors(drawn[0], some)


class PaperVeil(PaperTransform):
    probability: Probability = 1.0

    def light(self, paper, mask, rng):
        return paper / 2


class PrintVeil(Veil):
    stage = "print"


class VeiledPatch(PatchConfig):
    veil: Veil | PaperVeil | None = None


class VeiledTexture(TextureConfig):
    veil: Veil | PaperVeil | None = None


def grey(*shape: int) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(1).uniform(0.2, 0.8, shape).astype(np.float32))


@pytest.fixture(scope="module")
def views(tmp_path_factory, make_crate_space):
    _, atlas = make_crate(make_crate_space(tmp_path_factory.mktemp("w")))
    return batch_views(render_linear(atlas)[0], "cpu")


def show(config, views) -> torch.Tensor:
    """Photographs by a config; what a network sees of them where jitter acts on it alone."""
    if isinstance(config, TextureConfig):
        return take_photos(grey(3, 32, 32), views, config, DRAWS)
    return show_patch(grey(3, 16, 16), grey(4, 3, 64, 64), config.appearance(), DRAWS)


def always(part):
    """The transform where it acts on every image; one without a probability does so anyway."""
    if isinstance(part, tuple):
        return tuple(map(always, part))
    return part if not hasattr(part, "probability") else part.with_overrides(probability=1.0)


FIELDS = [
    (recipes, recipe, name)
    for recipes in (patch_config.RECIPES, texture_config.RECIPES)
    for recipe, config in recipes.items()
    for name in dict(config.held_transforms())
]


@pytest.mark.parametrize(("recipes", "recipe", "name"), FIELDS, ids=lambda one: one if isinstance(one, str) else "")
def test_every_transform_of_every_recipe_changes_the_picture(recipes, recipe, name, views):
    config = recipes[recipe]
    part = getattr(config, name)
    with_it = config.model_copy(update={name: always(part)})
    without = config.model_copy(update={name: None})
    if name == "affine":  # the patch has to lie somewhere
        with_it, without = (config.model_copy(update={"pose": None, name: one}) for one in (part, moved(part)))
    assert not torch.equal(show(with_it, views), show(without, views))
    if isinstance(part, tuple):
        for k in range(len(part)):
            fewer = with_it.model_copy(update={name: part[:k] + part[k + 1 :]})
            assert not torch.equal(show(with_it, views), show(fewer, views)), type(part[k]).__name__


def moved(part):
    return part.with_overrides(share=(0.9, 0.9))


@pytest.mark.parametrize("veil", [Veil(), PaperVeil(), PrintVeil()])
def test_a_transform_that_is_added_as_a_field_acts_and_is_listed_and_recorded(veil, views):
    plain, veiled = VeiledPatch(), VeiledPatch(veil=veil)
    assert not torch.equal(show(plain, views), show(veiled, views))
    assert "veil" in dict(veiled.rows()) and "veil" not in dict(plain.rows())
    assert veiled.record()["veil"] and not plain.record()["veil"]


def test_a_transform_that_is_added_to_textures_acts_and_is_listed_and_recorded_once(views):
    plain, veiled = (VeiledTexture(steps=1, veil=one) for one in (None, Veil()))
    assert not torch.equal(show(plain, views), show(veiled, views))
    assert "veil" in dict(veiled.rows())
    settings = veiled.settings(32)
    assert settings["camera"] == {"Veil": {"probability": 1.0}} and "veil" not in settings


def test_a_transform_that_could_never_act_is_refused():
    with pytest.raises(ToolkitError, match=r"veil: PaperVeil would never act: its stage is 'paper', expected light, "):
        VeiledTexture(veil=PaperVeil())


def test_jitter_changes_what_a_network_sees():
    photos, target = grey(4, 3, 40, 40), Target(tiny_classifier(), 3)
    plain, jittered = (judge_ensemble(photos, [target], PatchConfig(jitter=one), DRAWS)[0] for one in (None, Jitter()))
    assert float(plain) != float(jittered)


@pytest.mark.parametrize(
    ("kind", "ranges", "words"),
    [
        (TapeGlare, {"strength": (0, 2)}, "strength 0 2: expected two rising numbers from 0 to 1"),
        (TapeGlare, {"width": (0.2, 0.1)}, "width 0.2 0.1: expected two rising"),
        (TapeGlare, {"strip_probability": 3}, "strip_probability 3: expected 0 to 1"),
        (CameraBlur, {"defocus_px": (2, 1)}, "defocus_px 2 1: expected two rising numbers from 0.05 to 8"),
        (CameraBlur, {"probability": 1.1}, "probability 1.1: expected 0 to 1"),
        (SensorNoise, {"shot": (-0.1, 0.1)}, "shot -0.1 0.1"),
        (SensorNoise, {"read": (0, float("nan"))}, "read"),
        (JpegFile, {"quality": (0, 90)}, "quality 0 90: expected two rising numbers from 1 to 100"),
        (Jitter, {"shift": 0.6}, "shift 0.6: expected 0 to 0.5"),
        (PrintProcess, {"white": (0.9, 1.2)}, "white 0.9 1.2"),
        (PrintProcess, {"tint": -0.1}, "tint -0.1"),
        (PrintProcess, {"dot_gain": (0, 0.4)}, "dot_gain 0 0.4"),
        (PrintProcess, {"texel_mm": 0}, "texel_mm 0"),
        (LightRanges, {"exposure": (0, 1)}, "exposure 0 1"),
        (LightRanges, {"contrast": (1, 0.5)}, "contrast 1 0.5"),
        (LightRanges, {"tint": 1.0}, "tint 1"),
        (Fog, {"strength": (0, 6)}, "strength 0 6"),
        (Fog, {"smoothness": (1, 2)}, "smoothness 1 2"),
        (Exposure, {"factor": (0, 1)}, "factor 0 1"),
    ],
)
def test_impossible_ranges_are_one_clear_line(kind, ranges, words):
    with pytest.raises(ToolkitError, match=words) as caught:
        kind(**ranges)
    assert "\n" not in str(caught.value)
