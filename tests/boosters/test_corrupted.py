"""Corruptions in training: forward the benchmark's own, backward the true gradient or the identity, as it says."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from part_checks import count_changed, grey_noise
from tiny_network import IMAGE_PX, tiny_classifier, tiny_config, train_tiny, wrap, write_photos
from watched_patch import patch_gradient, train_watched

from toolkit.boosters import patch_config
from toolkit.boosters.patch_config import list_patch_inputs, make_config
from toolkit.boosters.pixel_config import DataConfig
from toolkit.boosters.pixels import Target, draw_first_pixels, list_networks
from toolkit.boosters.transforms.placement import AffineRanges
from toolkit.boosters.transforms.show import Appearance
from toolkit.boosters.transforms.weather import DIFFERENTIABLE, STRAIGHT_THROUGH, Corrupted, corrupt_straight
from toolkit.boosters.validation import validate_patch
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.core.work import Work
from toolkit.corruptions.batch import corrupt
from toolkit.corruptions.catalogue import CORRUPTIONS
from toolkit.imaging.preprocessing import Preprocessing


@pytest.fixture
def space(tmp_path, make_crate_space):
    return make_crate_space(tmp_path)


STRAIGHT = sorted(STRAIGHT_THROUGH - {"pixelate"})


def smooth_images(count: int = 2, side: int = 96) -> torch.Tensor:
    """Soft colours, red above green above blue, so that no step changes their order, and one brightest pixel."""
    coarse = grey_noise(count, 3, 6, 6).float() * 0.2
    images = torch.nn.functional.interpolate(coarse, (side, side), mode="bicubic")
    images += torch.tensor([0.6, 0.4, 0.2])[:, None, None]
    images[:, 0, 3, 5] = 0.95
    return images


@pytest.mark.slow
@pytest.mark.parametrize("severity", [1, 3, 5])
@pytest.mark.parametrize("name", CORRUPTIONS)
def test_forward_it_is_the_benchmarks_corruption(name, severity):
    images = smooth_images().requires_grad_(True)
    found = corrupt_straight(images, name, severity, [5, 6])
    assert found.requires_grad
    assert torch.allclose(found.detach(), corrupt(images, name, severity, [5, 6]), atol=2e-6)


@pytest.mark.parametrize("name", sorted(DIFFERENTIABLE))
def test_the_gradient_is_that_of_differences(name):
    images = smooth_images() * (0.5 if name == "frost" else 1)  # it brightens: nothing shall be cut off at white
    weights = torch.from_numpy(np.random.default_rng(1).normal(size=(2, 3, 96, 96))).float()

    def weigh(at: torch.Tensor) -> torch.Tensor:
        return (corrupt_straight(at, name, 2, [5, 6]) * weights).double().sum()

    at = images.clone().requires_grad_(True)
    (gradient,) = torch.autograd.grad(weigh(at), at)
    assert gradient.abs().max() > 1e-3
    for k in range(3):
        # smooth directions, so that hardly any pixel crosses a kink within the step
        direction = torch.nn.functional.interpolate(grey_noise(2, 3, 4, 4, seed=k).float() - 0.5, (96, 96)) * 4e-3
        difference = float(weigh(images + direction) - weigh(images - direction)) / 2
        assert float((gradient * direction).sum()) == pytest.approx(difference, rel=0.05, abs=2e-3)


@pytest.mark.parametrize("severity", [1, 5])
def test_pixelate_has_the_gradient_of_its_means(severity):
    """Steps of many levels, over which its rounding averages out."""
    images, weights = smooth_images(), torch.from_numpy(np.random.default_rng(1).normal(size=(2, 3, 96, 96))).float()
    at = images.clone().requires_grad_(True)
    (gradient,) = torch.autograd.grad(corrupt_straight(at, "pixelate", severity, [5, 6]), at, weights)
    apart = 0.0
    for k in range(3):
        direction = torch.nn.functional.interpolate(grey_noise(2, 3, 48, 48, seed=k).float() - 0.5, (96, 96)) * 0.2
        ends = (corrupt(images + sign * direction, "pixelate", severity, [5, 6]) for sign in (1, -1))
        difference = float(((next(ends) - next(ends)) * weights).double().sum()) / 2
        assert float((gradient * direction).sum()) == pytest.approx(difference, rel=0.05, abs=0.8)
        apart += abs(float((weights * direction).sum()) - difference)
    assert apart > 2, "the identity is another"


@pytest.mark.parametrize("name", STRAIGHT)
def test_the_others_pass_the_gradient_straight_through(name):
    images, wanted = smooth_images().requires_grad_(True), torch.randn(2, 3, 96, 96)
    (gradient,) = torch.autograd.grad(corrupt_straight(images, name, 3, [5, 6]), images, wanted)
    assert torch.equal(gradient, wanted)


def test_a_corruption_whose_gradient_nobody_has_said_is_refused(monkeypatch):
    assert set(CORRUPTIONS) == DIFFERENTIABLE | STRAIGHT_THROUGH and not DIFFERENTIABLE & STRAIGHT_THROUGH
    monkeypatch.setitem(CORRUPTIONS, "posterise", CORRUPTIONS["brightness"])
    with pytest.raises(ToolkitError, match=r"^corruption posterise has no gradient to train with"):
        corrupt_straight(smooth_images(), "posterise", 3, [5, 6])


def test_straight_through_training_has_the_clean_pictures_gradient_at_the_corrupted_one():
    """A linear network has one gradient everywhere: through JPEG it must be that of the clean photographs."""
    torch.manual_seed(0)
    linear = torch.nn.Sequential(torch.nn.Flatten(), torch.nn.Linear(3 * IMAGE_PX**2, 1, bias=False))

    class Sum:
        preprocessing = tiny_classifier().preprocessing

        def logits(self, photos):
            return torch.cat([linear(photos), -linear(photos)], 1) * 1e-4  # so flat that softmax is linear too

    images, patch = torch.rand(3, 3, IMAGE_PX, IMAGE_PX), draw_first_pixels(16, 0)
    placement = AffineRanges()
    parts = [(), (Corrupted(corruptions=(("jpeg_compression", 3),), probability=1),)]
    clean, through = (
        patch_gradient(patch, images, [Target(Sum(), 0)], Appearance(placement, on_photo=part), Draws(0, 3))[0]
        for part in parts
    )
    assert torch.allclose(clean, through, rtol=1e-3, atol=1e-9)


def test_each_image_draws_its_own_by_step_and_seed():
    images = grey_noise(100, 3, 24, 24).float()
    part = Corrupted(corruptions=(("brightness", 5), ("contrast", 5), ("jpeg_compression", 1)))
    assert count_changed(part.with_overrides(probability=0).change, images) == 0
    assert count_changed(part.with_overrides(probability=1).change, images) == 100
    assert 30 < count_changed(part.change, images) < 70
    first, again, other = (part.change(images, Draws(0, step).of("Corrupted")) for step in (4, 4, 5))
    assert torch.equal(first, again) and not torch.equal(first, other)
    kinds = [
        sum(
            bool(torch.allclose(a, b, atol=1e-5))
            for a, b in zip(first, corrupt(images, name, s, range(100)), strict=True)
        )
        for name, s in part.corruptions
    ]
    assert min(kinds) > 5 and sum(kinds) == count_changed(lambda x, _: first, images)


def test_one_photograph_is_as_good_as_a_batch():
    part = Corrupted(corruptions=(("fog", 2), ("gaussian_blur", 1)), probability=1)
    image = grey_noise(3, 32, 32).float()
    assert part.change(image, np.random.default_rng(0)).shape == image.shape


@pytest.mark.parametrize("corruptions", [(), (("fogg", 3),), (("fog", 6),)])
def test_what_there_is_not_is_refused(corruptions):
    with pytest.raises(ToolkitError):
        Corrupted(corruptions=corruptions)


class Weights:
    sha256 = "ab" * 32


class Named:
    arch, weights = "tiny", Weights


def hash_of(recipe: str, **choices) -> str:
    config = make_config(recipe, {"steps": 3, "size_px": 16, **choices}, DataConfig(sources=("photos",)))
    return patch_config.PATCHES.key(*list_patch_inputs(config, "jet", list_networks([Target(Named, 3)]), "0" * 64))


def test_a_request_without_it_keeps_its_hash(monkeypatch):
    """As they were before there were corruptions in training, but for the print process, which real prints moved."""
    monkeypatch.setattr(patch_config, "PATCHES", Work("patch", 3, old_at=0))  # theirs
    assert hash_of("default") == "6dd395a8e224c99c30b8ca3a5c380d375c65df21479576171b176643ab23c522"
    assert hash_of("paper") == "4ee8bd9ced923a9c4a0b2dfe83112af0fcbfc5dfb8a82c2a71359180b2d827ba"
    others = {hash_of("default", corrupted=words) for words in (None, ("fog:3",), ("fog:2",), ("fog:3", "snow:1"))}
    assert len(others) == 4


@pytest.mark.slow
def test_it_is_recorded_said_and_validated(tmp_path):
    photos = write_photos(tmp_path / "photos", 6)
    choices = {"steps": 2, "batch": 4, "size_px": 16, "corrupted": ("contrast:5", "jpeg_compression:2")}
    config = make_config("default", choices, DataConfig(sources=(str(photos),)))
    assert dict(config.rows())["corrupted"] == "contrast:5, jpeg_compression:2, probability 0.5"
    made = train_tiny(tmp_path / "w", photos, config)
    record = json.loads(Path(made.files.png).with_suffix(".json").read_text())
    assert record["settings"]["corrupted"] == {
        "corruptions": [["contrast", 5], ["jpeg_compression", 2]],
        "probability": 0.5,
        "gradients": 2,
    }
    assert record["final"]["tiny_corrupted_patched_n"] == 128 and "tiny_held_out_patched_top1" in record["final"]
    assert train_tiny(tmp_path / "w", photos, config).was_finished


def test_what_a_program_is_shown_is_part_of_the_hash():
    """Another mean in the TOML beside an ONNX file trains another patch; a published network's is known by its name."""

    def listed(arch: str, mean: float) -> list[list[object]]:
        network = SimpleNamespace(
            arch=arch, weights=Weights, preprocessing=Preprocessing(192, 192, (mean,) * 3, (1.0,) * 3)
        )
        return list_networks([Target(network, 3)])

    assert listed("onnx:net.onnx", 0.5) != listed("onnx:net.onnx", 0.4)
    assert listed("net.pt2", 0.5) != listed("net.pt2", 0.4)
    assert listed("resnet18", 0.5) == listed("resnet18", 0.4) == [["resnet18", Weights.sha256, 3]]


class StripesOrRed(torch.nn.Module):
    """Sees a jet in fine red stripes, and in red at large: what a blur takes away, and what it leaves."""

    def forward(self, photos: torch.Tensor) -> torch.Tensor:
        red = photos[:, 0]
        stripes = (red[..., 1:] - red[..., :-1]).square().mean((1, 2))
        jet = 100 * stripes + 10 * (red.mean((1, 2)) - 0.5)
        return torch.stack([torch.full_like(jet, 0.8), jet * 0, jet * 0, jet], 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["defocus_blur", "gaussian_blur"])
def test_a_patch_that_has_met_a_corruption_bears_it_better(name):
    """By the true gradient and straight through; without it the patch learns the stripes, which are easier."""
    target = Target(wrap(StripesOrRed()), 3)
    images = torch.full((8, 3, 36, 36), 128, dtype=torch.uint8)
    clear = Appearance(AffineRanges(rotation_deg=(0, 0), share=(0.6, 0.7), foreshortening=(1, 1)))
    blur = Corrupted(corruptions=((name, 5),), probability=1)
    found = {}
    for met in (False, True):
        seen = replace(clear, on_photo=(blur,)) if met else clear
        task = train_watched(images, [target], seen, tiny_config(25, smoothing_px=0, start_contrast=1))
        for after in (None, blur):
            (answer,) = validate_patch(task.seen[-1], images, [target], clear, 0, draws=16, corrupted=after)
            found[met, after is not None] = answer.patched.value
    assert found[False, False] == 1, "without the blur it does what it was trained for"
    assert found[True, True] > found[False, True] + 0.5


def test_bare_and_patched_images_are_validated_in_the_same_corruption():
    """What differs is the patch alone: where it does not lie, the noise is the same."""
    asked = []

    class Listening(torch.nn.Module):
        def forward(self, photos: torch.Tensor) -> torch.Tensor:
            asked.append(photos.clone())
            return photos.mean((2, 3))[:, [0, 0, 0, 0]]

    images = torch.full((4, 3, 36, 36), 128, dtype=torch.uint8)
    small = Appearance(AffineRanges(rotation_deg=(0, 0), share=(0.1, 0.11), foreshortening=(1, 1)))
    noise = Corrupted(corruptions=(("gaussian_noise", 3), ("brightness", 4)), probability=0.8)
    target = Target(wrap(Listening()), 3)
    validate_patch(torch.zeros(3, 8, 8), images, [target], small, 0, draws=4, corrupted=noise)
    patched, bare = asked
    same = (patched == bare).all(dim=1).float().mean((1, 2))
    assert bare.std() > 0.05 and same.min() > 0.8 and same.max() < 1


def test_a_texture_meets_corruptions_and_its_gradient_is_that_of_differences():
    """After the camera, by the same part as a patch; a config without them records what it recorded before."""
    from texture_parts import crate_config

    from toolkit.boosters.texture_config import RECIPES
    from toolkit.boosters.texture_config import make_config as make_texture_config

    plain, met = crate_config(), crate_config(corrupted=("gaussian_blur:4", "gaussian_noise:5"))
    assert plain.transforms("photo") == () and met.transforms("photo") == (met.corrupted,)
    settings = met.settings(48)
    assert settings["camera"] == {
        "Corrupted": {"corruptions": (("gaussian_blur", 4), ("gaussian_noise", 5)), "probability": 0.5, "gradients": 2}
    }
    assert settings | {"camera": None} == plain.settings(48), "nothing else changed"
    default = make_texture_config("default", {"objects": ("crate",), "corrupted": ("defocus_blur:5",)})
    kinds = [type(part).__name__ for part in default.transforms("photo")]
    assert kinds == [*(type(part).__name__ for part in RECIPES["default"].transforms("photo")), "Corrupted"]
    assert dict(default.rows())["corrupted"] == "defocus_blur:5, probability 0.5"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gaussian_noise", "defocus_blur"])
def test_the_true_gradient_reaches_the_texture(space, name):
    """Through light, tone curve and corruption, in smooth directions as above."""
    from texture_parts import TEXELS, crate_config, make_crate, render_linear

    from toolkit.boosters.linear_view import batch_views
    from toolkit.boosters.texture import take_photos

    _, atlas = make_crate(space)
    views, *_ = render_linear(atlas)
    batch = batch_views(views, "cpu")
    config = crate_config(corrupted=Corrupted(corruptions=((name, 2),), probability=1), exposure=None)
    weights = torch.from_numpy(np.random.default_rng(1).normal(size=(len(views), 3, 48, 48))).float()

    def weigh(texture: torch.Tensor) -> torch.Tensor:
        return (take_photos(texture, batch, config, Draws(0, 4)) * weights).double().sum()

    texture = grey_noise(3, TEXELS, TEXELS).float().requires_grad_(True)
    (gradient,) = torch.autograd.grad(weigh(texture), texture)
    assert gradient.abs().max() > 1e-3
    for k in range(4):
        direction = (grey_noise(3, TEXELS, TEXELS, seed=k + 5).float() - 0.5) * 4e-3
        difference = float(weigh(texture.detach() + direction) - weigh(texture.detach() - direction)) / 2
        assert float((gradient * direction).sum()) == pytest.approx(difference, rel=0.05, abs=2e-3)


@pytest.mark.slow
def test_a_textures_record_says_how_it_bears_what_it_met(space):
    from texture_parts import crate_config

    from toolkit.boosters.texture import train_texture

    config = crate_config(steps=2, corrupted=("contrast:5",))
    made = train_texture(config, [tiny_classifier()], space, class_name="jet", workers=0)
    record = made.texture.record
    assert record.final["tiny_held_out_corrupted_patched_n"] == 4 == made.validations[0].corrupted.patched.n
    assert record.settings["camera"]["Corrupted"]["probability"] == 0.5
