"""The picture of a texture: against the rig's own render, and its gradients against differences."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from kernel_samples import sample_by_numpy
from texture_parts import SIDE, TEXELS, make_crate, render_linear

from toolkit.boosters import linear_view as pyramid
from toolkit.boosters.linear_view import batch_views, show_texture
from toolkit.objects.atlas import apply_texture
from toolkit.objects.mesh import Material, Mesh
from toolkit.rig import shading as finish
from toolkit.rig import textures
from toolkit.rig.camera import Camera, look_at
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.studio import make_studio

"""OpenCV's look-up rounds places to a 32nd of a texel; a noise texture changes by up to its full range per texel."""


@pytest.fixture(scope="module")
def crate(tmp_path_factory, make_crate_space):
    return make_crate(make_crate_space(tmp_path_factory.mktemp("picture")))[1]


@pytest.fixture(scope="module")
def views(crate):
    return render_linear(crate)


@pytest.fixture(scope="module")
def noise():
    return np.random.default_rng(1).integers(0, 256, (TEXELS, TEXELS, 3), dtype=np.uint8)


def to_tensor(pixels: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1))).double() / 255


def test_the_parts_put_together_are_a_render_of_the_texture(crate, views, noise):
    taken, studio, camera, poses = views
    worn = apply_texture(crate, noise)
    renderer = RaycastRenderer(worn, studio)
    shown = show_texture(to_tensor(noise).float(), batch_views(taken, "cpu")).permute(0, 2, 3, 1).numpy()
    # light bounces off the table with the mean colour of the object, which is grey in the parts
    for picture, pose in zip(shown, poses, strict=True):
        rendered = finish.tone_map(renderer.render(camera, pose), (0,), noise=0, falloff=0) / 255
        difference = np.abs(picture - rendered)
        assert difference.max() < 0.5 / 255 + 0.02
        assert difference.mean() < 0.004


def test_black_and_white_textures_bound_what_a_view_can_show(views):
    batch = batch_views(views[0], "cpu")
    black = show_texture(torch.zeros(3, TEXELS, TEXELS), batch)
    white = show_texture(torch.ones(3, TEXELS, TEXELS), batch)
    assert (white >= black - 1e-6).all()
    seen = torch.from_numpy(np.stack([view.coverage for view in views[0]])) == 1
    assert ((white - black).amax(1)[seen] > 0.01).float().mean() > 0.99
    nothing = torch.from_numpy(np.stack([view.coverage for view in views[0]])) == 0
    assert torch.equal(white.permute(0, 2, 3, 1)[nothing], black.permute(0, 2, 3, 1)[nothing])


def test_both_gradients_show_the_same_picture(views, noise):
    batch = batch_views(views[0], "cpu")
    texture = to_tensor(noise).float()
    assert torch.equal(show_texture(texture, batch, "shaded"), show_texture(texture, batch, "linear"))


def difference_along(function, texture, direction, step=1e-5):
    return (function(texture + step * direction) - function(texture - step * direction)) / (2 * step)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_shaded_gradient_is_the_slope_of_the_picture(views, noise, seed):
    batch = batch_views(views[0], "cpu").to(torch.float64)
    rng = np.random.default_rng(seed)
    texture = to_tensor(noise).mul(0.8).add(0.1).requires_grad_()
    weight = torch.from_numpy(rng.standard_normal((2, 3, SIDE, SIDE)))
    direction = torch.from_numpy(rng.standard_normal(texture.shape))

    def loss(theta):
        return (show_texture(theta, batch, "shaded", 0.9) * weight).sum()

    (gradient,) = torch.autograd.grad(loss(texture), texture)
    slope = difference_along(loss, texture.detach(), direction)
    assert (gradient * direction).sum().item() == pytest.approx(slope.item(), rel=1e-5)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_straight_through_gradient_is_the_slope_of_the_linear_approximation(views, noise, seed):
    """`x_drend` written out by hand: at each pixel the texture where the UV buffer points, times coverage."""
    taken = views[0]
    batch = batch_views(taken, "cpu").to(torch.float64)
    rng = np.random.default_rng(seed)
    texture = to_tensor(noise).requires_grad_()
    weight = torch.from_numpy(rng.standard_normal((2, 3, SIDE, SIDE)))
    direction = torch.from_numpy(rng.standard_normal(texture.shape))

    def drend(theta):
        levels = textures.build_pyramid(theta.permute(1, 2, 0).numpy())
        total = 0.0
        for view, w in zip(taken, weight.numpy(), strict=True):
            colour = sample_by_numpy(levels, view.uv[:, 0], view.uv[:, 1], view.lod)
            counts = np.bincount(view.pixel, minlength=SIDE * SIDE)[view.pixel]
            share = view.coverage.reshape(-1)[view.pixel] / counts
            total += (w.reshape(3, -1)[:, view.pixel].T * colour * share[:, None]).sum()
        return total

    (gradient,) = torch.autograd.grad((show_texture(texture, batch, "linear") * weight).sum(), texture)
    slope = difference_along(drend, texture.detach(), direction, 0.1)  # linear: any step does, a long one rounds less
    assert (gradient * direction).sum().item() == pytest.approx(slope, rel=1e-4)


@pytest.mark.parametrize("gradient", ["shaded", "linear"])
def test_another_renderers_picture_is_shown_and_the_gradient_stays(views, noise, gradient):
    """Its picture is even, and as bright as the texture's first texel."""
    repaint = lambda pixels: np.full((SIDE, SIDE, 3), pixels[0, 0, 0] / 510, np.float32)  # noqa: E731
    taken = [replace(view, repaint=repaint) for view in views[0]]
    texture = to_tensor(noise).float().requires_grad_()
    grey = finish.tone_map(np.full((1, 1, 3), noise[0, 0, 0] / 510 * 0.9, np.float32), (0,), noise=0, falloff=0) / 255
    photograph = np.full((SIDE, SIDE, 3), 0.25, np.float32)
    for behind in (None, [photograph, None]):
        shown, alone = (
            show_texture(texture, batch_views(some, "cpu", behind), gradient, 0.9) for some in (taken, views[0])
        )
        outside = torch.from_numpy(taken[0].coverage == 0) if behind else torch.zeros(SIDE, SIDE, dtype=torch.bool)
        inside = torch.from_numpy(np.stack([taken[0].coverage == 1, np.ones((SIDE, SIDE), bool)]))
        assert torch.allclose(shown.permute(0, 2, 3, 1)[inside], torch.from_numpy(grey[0, 0]).float(), atol=0.003)
        assert torch.equal(shown[0][:, outside], alone[0][:, outside])
        gradients = [torch.autograd.grad((one * alone.detach()).sum(), texture)[0] for one in (shown, alone)]
        assert torch.equal(*gradients) and gradients[0].any()


def test_on_the_rim_the_photograph_takes_the_place_of_the_table(crate, views, noise):
    """Repainted by the same renderer, the picture is that of its linear views, photograph and rim included."""
    taken, studio, camera, poses = views
    renderer = RaycastRenderer(apply_texture(crate, noise), studio)
    again = [
        replace(view, repaint=lambda pixels, pose=pose: renderer.render(camera, pose))
        for view, pose in zip(taken, poses, strict=True)
    ]
    photographs = [np.random.default_rng(2).random((SIDE, SIDE, 3), np.float32) for _ in poses]
    texture = to_tensor(noise).float()
    expected, shown = (show_texture(texture, batch_views(some, "cpu", photographs)) for some in (taken, again))
    difference = (shown - expected).abs()
    assert difference.max() < 0.03 and difference.mean() < 0.002


def test_texels_that_no_view_shows_have_no_gradient(views, noise):
    batch = batch_views(views[0], "cpu")
    texture = to_tensor(noise).float().requires_grad_()
    (gradient,) = torch.autograd.grad(show_texture(texture, batch).sum(), texture)
    column, row = np.concatenate([v.uv for v in views[0]]).T
    far = np.ones((TEXELS, TEXELS), bool)
    reach = 4  # bilinear, and the coarser levels that a small picture reads
    for c, r in zip((column * TEXELS).astype(int), ((1 - row) * TEXELS).astype(int), strict=True):
        far[max(r - reach, 0) : r + reach + 1, max(c - reach, 0) : c + reach + 1] = False
    assert far.any() and not gradient[:, torch.from_numpy(far)].any()


def make_wall(texture: np.ndarray, low: float, high: float) -> Mesh:
    """A square of 100 mm that faces +x, with texture coordinates from `low` to `high`."""
    y, z = np.array([-50, 50, 50, -50.0]), np.array([0, 0, 100, 100.0])
    vertices = np.stack([np.zeros(4), y, z], axis=1).astype(np.float32)
    uv = np.array([[low, low], [high, low], [high, high], [low, high]], np.float32)
    normals = np.tile(np.float32([1, 0, 0]), (4, 1))
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(vertices, normals, uv, faces, np.zeros(2, np.int32), (Material("wall", texture, 0.9),))


def see_wall(n: int, low: float = 0.0, high: float = 1.0, side: int = 128):
    texture = np.full((n, n, 3), 128, np.uint8)
    mesh = make_wall(texture, low, high)
    camera = Camera.from_fov(side, side, 30.0)
    pose = look_at(np.array([230.0, 0, 50]), np.array([0.0, 0, 50]))
    return RaycastRenderer(mesh, make_studio(0, 100.0, "white")).render_linear(camera, pose, texture), camera


def test_a_texture_of_its_own_coordinates_comes_back_to_half_a_texel():
    """At every pixel away from silhouettes, against the plane's own perspective in closed form."""
    n = 64
    view, camera = see_wall(n)
    centres = (torch.arange(n) + 0.5) / n
    coordinates = torch.stack([centres.expand(n, n), (1 - centres)[:, None].expand(n, n), torch.zeros(n, n)])
    found = pyramid.look_up(pyramid.build_levels(coordinates), torch.from_numpy(view.uv), torch.from_numpy(view.lod))
    row, column = np.divmod(view.pixel, 128)
    mm_per_px = 230 / camera.fx
    u = (column + 0.5 - 64) * mm_per_px / 100 + 0.5
    v = 0.5 - (row + 0.5 - 64) * mm_per_px / 100
    inside = (np.abs(u - 0.5) < 0.5 - 1 / n) & (np.abs(v - 0.5) < 0.5 - 1 / n)
    assert inside.sum() > 5000
    assert np.abs(found[:, 0].numpy() - u)[inside].max() < 0.5 / n
    assert np.abs(found[:, 1].numpy() - v)[inside].max() < 0.5 / n


@pytest.mark.parametrize("place", [0.0, 1.0])
def test_an_object_that_lies_at_one_corner_of_the_texture_is_seen(place):
    """UV (0, 0) is no background, and u = 1, v = 1 no place beyond the last texel."""
    view, _ = see_wall(8, place, place)
    assert (view.coverage > 0).mean() > 0.3
    assert len(view.pixel) > 5000
    colours = torch.zeros(3, 8, 8)
    corners = [(-1, 0), (0, -1), (-1, -1), (0, 0)]  # the four texels that meet there, as the texture repeats
    for row, column in corners:
        colours[:, row, column] = 1.0
    found = pyramid.look_up(pyramid.build_levels(colours), torch.from_numpy(view.uv), torch.zeros(len(view.uv)))
    assert torch.allclose(found, torch.ones_like(found))


@pytest.mark.parametrize("n", [8, 25, 200, 333])
def test_the_pyramid_is_that_of_the_renderer(n):
    rng = np.random.default_rng(n)
    image = rng.random((n, n, 3), np.float32)
    u, v, lod = rng.uniform(-0.5, 1.5, 500), rng.uniform(-0.5, 1.5, 500), rng.uniform(-1, 9, 500)
    levels = textures.build_pyramid(image)
    mine = pyramid.build_levels(torch.from_numpy(image).permute(2, 0, 1))
    assert [level.shape[-1] for level in mine] == [len(level) for level in levels]
    for ours, theirs in zip(mine, levels, strict=True):
        assert np.abs(ours.permute(1, 2, 0).numpy() - theirs).max() < 1e-5
    places = torch.from_numpy(np.stack([u, v], 1)).float()
    found = pyramid.look_up(mine, places, torch.from_numpy(lod).float()).numpy()
    assert np.abs(found - sample_by_numpy(levels, u, v, lod)).max() < 2e-4


def test_a_cut_of_some_views_is_a_part_of_their_pictures(views, noise):
    batch, texture = batch_views(views[0], "cpu"), to_tensor(noise).float()
    whole = show_texture(texture, batch, "shaded", 0.9)
    cut = batch.cut(np.array([1, 0]), np.array([[3, 11], [0, 0]]), 32, torch.float32)
    shown = show_texture(texture, cut, "shaded", 0.9)
    assert torch.equal(shown[0], whole[1, :, 3:35, 11:43])
    assert torch.equal(shown[1], whole[0, :, :32, :32])
    last = show_texture(texture, batch.part(1, 2), "linear", 0.9)
    assert torch.equal(last[0], whole[1])
