"""Training on the mounted sheet: its buffers against a real render, its gradient against differences."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from tiny_network import LABELS, tiny_classifier, tiny_config
from watched_patch import patch_gradient, train_watched

from toolkit.boosters.linear_view import srgb_to_linear, tone_map
from toolkit.boosters.mounted import (
    draw_mounted,
    make_sheet_subject,
    print_on_paper,
    render_mounted_views,
    show_mounted,
    stack_views,
    validate_mounted,
)
from toolkit.boosters.pixels import Target, draw_first_pixels
from toolkit.boosters.transforms import Transform
from toolkit.boosters.transforms.placement import AffineRanges
from toolkit.boosters.transforms.show import Appearance
from toolkit.core.draws import Draws
from toolkit.imaging import colour
from toolkit.objects.load import load_object
from toolkit.rig import mount
from toolkit.rig import shading as finish
from toolkit.rig.mount import attach, mount_patch
from toolkit.rig.views import TRAIN, ViewBlock, ViewSettings

SIDE, TEXELS, SIZE_MM = 48, 8, 40.0


@pytest.fixture(scope="module")
def space(tmp_path_factory, make_crate_space):
    return make_crate_space(tmp_path_factory.mktemp("mounted"))


@pytest.fixture(scope="module")
def views(space):
    item = load_object(space.object_spec("crate"))
    return render_mounted_views(item, [SIZE_MM], TEXELS, 3, seed=7, image_px=SIDE)


@pytest.mark.slow
def test_the_buffers_put_together_are_a_render_of_the_patch(space, views):
    """The same camera, studio and mount, but rendered with the patch itself."""
    pixels = np.random.default_rng(1).integers(0, 256, (8, 8, 3), dtype=np.uint8)
    item = load_object(space.object_spec("crate"))
    mesh = attach(item.mesh, mount_patch(item.mesh, pixels, 40.0, item.spec.mounts[0]))
    subject = make_sheet_subject(item, [SIZE_MM], TEXELS)
    block = ViewBlock(subject.mesh, ViewSettings(image_px=SIDE), Draws(7, 0, TRAIN))
    renderer = block.place(mesh)
    theta = torch.from_numpy(pixels.transpose(2, 0, 1) / 255.0).float()
    stacked = stack_views(views, [SIZE_MM], "cpu")
    for i in range(3):
        rendered = finish.tone_map(renderer.render(*block.aim(i)), (0,), noise=0, falloff=0) / 255
        shown = show_mounted(theta, stacked, np.array([i]), np.zeros((1, 2), int), SIDE)[0].permute(1, 2, 0).numpy()
        assert len(np.unique(views[i].pixel)) > 40
        # half a level of rounding, half precision, and light that bounces with the colour of a grey patch
        assert np.abs(shown - rendered).max() < 2 / 255
        assert np.abs(shown - rendered).mean() < 0.3 / 255


def test_upside_down_would_be_noticed(views):
    stacked = stack_views(views, [SIZE_MM], "cpu")
    theta = torch.zeros(3, TEXELS, TEXELS)
    theta[:, :4] = 1  # the upper half of the sheet is white
    shown = show_mounted(theta, stacked, np.array([0]), np.zeros((1, 2), int), SIDE)[0].mean(0).numpy()
    inside = np.abs(views[0].uv - 0.5).max(axis=1) < 0.35  # on the patch and not on the margin
    pixel, v = views[0].pixel[inside], views[0].uv[inside, 1]
    shown = shown.reshape(-1)
    assert shown[pixel[v > 0.7]].mean() > shown[pixel[v < 0.3]].mean() + 0.2


@pytest.mark.parametrize("margin", ["white", "bleed"])
@pytest.mark.parametrize("n", [8, 33, 100, 300])
def test_the_paper_is_that_of_the_rig(n, margin):
    pixels = np.random.default_rng(n).integers(0, 256, (n, n, 3), dtype=np.uint8)
    theta = torch.from_numpy(pixels.transpose(2, 0, 1) / 255.0)
    found = print_on_paper(srgb_to_linear(theta), 88.2, margin).numpy()
    wanted = colour.srgb_to_linear(mount.print_on_paper(pixels, 88.2, margin) / 255)
    np.testing.assert_allclose(found.transpose(1, 2, 0), wanted, atol=1e-6)


def test_tone_map_is_the_rigs(views):
    light = np.random.default_rng(0).uniform(0, 2, (9, 9, 3)).astype(np.float32)
    wanted = finish.tone_map(light, (0,), noise=0, falloff=0) / 255
    found = tone_map(torch.from_numpy(light)).numpy()
    assert np.abs(found - wanted).max() <= 0.5 / 255 + 1e-6


def test_the_gradient_is_that_of_finite_differences(views):
    stacked = stack_views(views, [SIZE_MM], "cpu")
    classifier = SimpleNamespace(
        preprocessing=SimpleNamespace(crop_px=SIDE), logits=tiny_classifier().module.double().__call__
    )
    targets = [Target(classifier, 1)]
    theta = draw_first_pixels(10, 3).double() * 0.8 + 0.1
    empty, draws = torch.empty(0, 3, 32, 32, dtype=torch.float64), Draws(0, 0)

    def loss_at(patch):
        waiting = draw_mounted(stacked, draws, 3, 32)
        return patch_gradient(patch, empty, targets, Appearance(AffineRanges()), draws, mounted=waiting)

    gradient, _, _ = loss_at(theta)
    assert gradient.abs().max() > 0
    strongest = gradient.abs().flatten().topk(6).indices
    for k in strongest:
        step = torch.zeros_like(theta).flatten()
        step[k] = 1e-5
        step = step.view_as(theta)
        difference = (loss_at(theta + step)[1] - loss_at(theta - step)[1]) / 2e-5
        assert difference == pytest.approx(float(gradient.flatten()[k]), rel=1e-3)


def test_training_on_views_alone_raises_the_class(views):
    classifier = tiny_classifier(2)
    stacked = stack_views(views, [SIZE_MM], "cpu")
    empty = torch.zeros(1, 3, 36, 36, dtype=torch.uint8)
    targets, config = [Target(classifier, LABELS.index("jet"))], tiny_config(30, mounted_share=1.0)
    losses = train_watched(empty, targets, Appearance(AffineRanges()), config, stacked).history.figures["loss"]
    assert np.mean(losses[-5:]) < np.mean(losses[:5]) - 0.001


def test_held_out_views_are_not_trained_on(views):
    train, held_out = stack_views(views, [SIZE_MM], "cpu").divide()
    assert (len(train), len(held_out)) == (2, 1)
    answer = validate_mounted(torch.zeros(3, 8, 8), held_out, [Target(tiny_classifier(), 0)], 32)
    assert [(a.bare.n, a.patched.n) for a in answer] == [(1, 1)]


class Darken(Transform):
    """A stand-in for printer or camera."""

    factor: float

    def change(self, pixels, rng):
        return pixels * self.factor


def test_printer_and_camera_act_on_the_mounted_sheet_too(views):
    """On the print they change the patch alone, on the photograph everything."""
    stacked = stack_views(views, [SIZE_MM], "cpu")
    seen = []
    classifier = SimpleNamespace(
        preprocessing=SimpleNamespace(crop_px=32),
        logits=lambda photos: seen.append(photos.detach()) or photos.mean((2, 3)),
    )
    empty, theta = torch.empty(0, 3, 32, 32), torch.full((3, 8, 8), 0.8)
    for on_print, on_photo in (((), ()), ((Darken(factor=0.5),), ()), ((), (Darken(factor=0.5),))):
        appearance = Appearance(AffineRanges(), on_print=on_print, on_photo=on_photo)
        waiting = draw_mounted(stacked, Draws(0, 0), 3, 32)
        patch_gradient(theta, empty, [Target(classifier, 1)], appearance, Draws(0, 0), mounted=waiting)
    plain, printed, photographed = seen
    changed = (plain - printed).abs().amax(dim=1) > 1e-6
    on_patch = draw_mounted(stacked, Draws(0, 0), 3, 32)(torch.zeros(3, 8, 8)) != plain
    assert changed.any()
    assert not (changed & ~on_patch.any(dim=1)).any()
    assert torch.allclose(photographed, plain * 0.5)
