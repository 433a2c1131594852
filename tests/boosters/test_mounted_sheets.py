"""Training on sheets of different size at once: their views against a render, the gradient against differences."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from tiny_network import tiny_classifier
from watched_patch import patch_gradient

from toolkit.boosters.mounted import draw_mounted, make_sheet_subject, render_mounted_views, show_mounted, stack_views
from toolkit.boosters.pixels import Target, draw_first_pixels
from toolkit.boosters.transforms.placement import AffineRanges
from toolkit.boosters.transforms.show import Appearance
from toolkit.core.draws import Draws
from toolkit.objects.load import TableObject
from toolkit.objects.spec import ObjectSpec
from toolkit.rig.camera import project
from toolkit.rig.mount import mount_sheets, wear_sheets
from toolkit.rig.shading import tone_map
from toolkit.rig.views import TRAIN, ViewBlock, ViewSettings

SIDE, TEXELS, SIZES_MM = 48, 8, (40.0, 24.0)


@pytest.fixture(scope="module")
def crate(make_box) -> TableObject:
    """A box with a large sheet on its top and a small one on each of two sides, so that two show from anywhere."""
    mounts = [{"at": "top"}, {"at": "left"}, {"at": "right"}]
    fields = {"name": "crate", "class": "crate", "mesh": "crate.obj", "length_mm": 100, "patch": mounts}
    return TableObject(ObjectSpec.model_validate(fields), make_box())


@pytest.fixture(scope="module")
def sizes_mm() -> tuple[float, ...]:
    return (*SIZES_MM, SIZES_MM[1])


@pytest.fixture(scope="module")
def views(crate, sizes_mm):
    return render_mounted_views(crate, sizes_mm, TEXELS, 3, seed=7, image_px=SIDE)


@pytest.fixture(scope="module")
def block(crate, sizes_mm) -> ViewBlock:
    """What the views were taken in."""
    mesh = make_sheet_subject(crate, sizes_mm, TEXELS).mesh
    return ViewBlock(mesh, ViewSettings(image_px=SIDE), Draws(7, 0, TRAIN))


def test_the_views_are_renders_of_all_sheets(crate, sizes_mm, views, block):
    """The same camera, studio and mounts, but rendered with the patch itself."""
    pixels = np.random.default_rng(1).integers(0, 256, (TEXELS, TEXELS, 3), dtype=np.uint8)
    mesh, _ = wear_sheets(crate.mesh, mount_sheets(crate.mesh, pixels, crate.spec.mounts, sizes_mm))
    renderer = block.place(mesh)
    theta = torch.from_numpy(pixels.transpose(2, 0, 1) / 255.0).float()
    stacked = stack_views(views, sizes_mm, "cpu")
    for i in range(3):
        camera, pose = block.aim(i)
        seen = renderer.buffers(camera, pose)
        papers = {mesh.materials[k].name + str(k) for k in np.unique(seen["material"]) if k >= 0}
        assert len([name for name in papers if name.startswith("paper") and "back" not in name]) == 2
        rendered = tone_map(renderer.render(camera, pose), (0,), noise=0, falloff=0) / 255
        shown = show_mounted(theta, stacked, np.array([i]), np.zeros((1, 2), int), SIDE)[0].permute(1, 2, 0).numpy()
        assert np.abs(shown - rendered).max() < 3 / 255
        assert np.abs(shown - rendered).mean() < 0.3 / 255


def test_the_gradient_through_both_is_that_of_finite_differences(sizes_mm, views):
    stacked = stack_views(views, sizes_mm, "cpu")
    classifier = SimpleNamespace(
        preprocessing=SimpleNamespace(crop_px=SIDE), logits=tiny_classifier().module.double().__call__
    )
    targets = [Target(classifier, 1)]
    theta = draw_first_pixels(TEXELS, 3).double() * 0.8 + 0.1
    empty, draws = torch.empty(0, 3, 32, 32, dtype=torch.float64), Draws(0, 0)

    def loss_at(patch):
        waiting = draw_mounted(stacked, draws, 3, 32)
        return patch_gradient(patch, empty, targets, Appearance(AffineRanges()), draws, mounted=waiting)

    gradient, _, _ = loss_at(theta)
    for k in gradient.abs().flatten().topk(6).indices:
        step = torch.zeros_like(theta).flatten()
        step[k] = 1e-5
        step = step.view_as(theta)
        difference = (loss_at(theta + step)[1] - loss_at(theta - step)[1]) / 2e-5
        assert difference == pytest.approx(float(gradient.flatten()[k]), rel=1e-3)


def test_the_same_texels_are_lit_on_two_sheets_at_once(crate, sizes_mm, views, block):
    """Where their light falls: in the middle of the large sheet and of the small one that the third view shows."""
    stacked = stack_views(views, sizes_mm, "cpu")
    dark, lit = torch.zeros(3, TEXELS, TEXELS), torch.zeros(3, TEXELS, TEXELS)
    lit[:, 3:5, 3:5] = 1  # the patch's middle, 10 mm of the large sheet and 6 of a small one
    shown = [show_mounted(one, stacked, np.array([2]), np.zeros((1, 2), int), SIDE)[0].mean(0) for one in (dark, lit)]
    brighter = (shown[1] - shown[0]).numpy()
    camera, pose = block.aim(2)
    middles = block.stand.to_world(np.array([[0, 0, 40.5], [0, 30.5, 20.0], [0, -30.5, 20.0]]))  # of the three sheets
    places, depth = project(camera, pose, middles)
    faces = (pose[:3, 3] - middles) * (np.array([[0, 0, 1], [0, 1, 0], [0, -1, 0]]) @ block.stand.turn.T)
    seen = places[(faces.sum(axis=1) > 0) & (depth > 0)].astype(int)
    near = np.zeros((SIDE, SIDE), bool)
    for x, y in seen:
        near[y - 5 : y + 6, x - 5 : x + 6] = True
        assert brighter[y - 1 : y + 2, x - 1 : x + 2].max() > 0.2
    assert len(seen) == 2 and np.abs(brighter[~near]).max() < 0.005  # and nothing else
