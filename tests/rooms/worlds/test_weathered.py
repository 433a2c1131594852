"""Weather in training is that of the worlds, and its gradient that of finite differences."""

import numpy as np
import pytest
import torch
from part_checks import check_gradient
from texture_parts import TEXELS, make_crate, render_linear

from toolkit.boosters.linear_view import batch_views, show_linear, show_texture
from toolkit.core.errors import ToolkitError
from toolkit.rig.camera import Camera, look_at
from toolkit.rig.shading import DepthBuffer, tone_map
from toolkit.rooms.worlds.weathered import Weathered, read_words

SIDE = 24
METRES_PER_MM = 16 / 270  # the warplane's


@pytest.fixture(scope="module")
def crate_views(tmp_path_factory, make_crate_space):
    crate = make_crate(make_crate_space(tmp_path_factory.mktemp("weather")))[1]
    views, _, camera, poses = render_linear(crate, side=SIDE)
    depths = []
    for view, pose in zip(views, poses, strict=True):
        distance_mm = np.linalg.norm(pose[:3, 3])
        depths.append(np.where(view.coverage > 0, distance_mm, 2 * distance_mm))
    buffers = [DepthBuffer(depth, camera, pose) for depth, pose in zip(depths, poses, strict=True)]
    return views, [buffer.scaled(METRES_PER_MM) for buffer in buffers]


def test_a_model_is_as_far_away_as_the_thing_itself():
    camera, pose = Camera.from_fov(8, 8, 40), look_at(np.array([600.0, 0, 300]), np.zeros(3))
    view = DepthBuffer(np.full((8, 8), 670.8), camera, pose).scaled(METRES_PER_MM)
    assert view.depth[0, 0] == pytest.approx(670.8 * 16 / 270, rel=1e-6)
    assert np.linalg.norm(view.T_world_camera[:3, 3]) == pytest.approx(670.8 * 16 / 270, rel=1e-4)
    assert pose[0, 3] == 600


@pytest.mark.parametrize("word", ["fog:3", "dust:2", "rain:5", "snow:4"])
def test_the_gradient_through_weather_is_that_of_differences(crate_views, word):
    views, depths = crate_views
    drawn = Weathered(weathers=read_words([word]).weathers, probability=1).draw(depths, np.random.default_rng(0))
    batch = batch_views(views, "cpu").through(*drawn)
    texture = torch.from_numpy(np.random.default_rng(2).uniform(0.2, 0.7, (3, 4, 4)))
    doubles = {
        name: value.double() for name, value in vars(batch).items() if name in ("still", "uv", "lod", "gain", "share")
    }
    check_gradient(
        lambda linear: show_linear(linear, type(batch)(counts=batch.counts, pixel=batch.pixel, **doubles)), texture
    )


def test_views_through_weather_are_weathered_views(crate_views):
    """One implementation: the picture of a texture, weathered as NumPy weathers a render, is the batch's own."""
    views, depths = crate_views
    part = Weathered(weathers=(("fog", 3), ("snow", 2)), probability=1)
    factor, offset = part.draw(depths, np.random.default_rng(5))
    texture = torch.full((3, TEXELS, TEXELS), 0.5)
    plain = batch_views(views, "cpu")
    linear = torch.full((3, 4, 4), float(((0.5 + 0.055) / 1.055) ** 2.4))
    light = plain.still.clone().view(len(views), -1, 3)
    start = 0
    for k, count in enumerate(plain.counts):
        span = slice(start, start + count)
        light[k].index_add_(0, plain.pixel[span], plain.gain[span] * linear[:, 0, 0])
        start += count
    weathered = (light.view(plain.still.shape) * factor + offset).numpy()
    shown = show_texture(texture, plain.through(factor, offset)).permute(0, 2, 3, 1).numpy()
    for expected, found in zip(weathered, shown, strict=True):
        assert np.abs(tone_map(expected, (0,), noise=0, falloff=0) / 255 - found).max() < 0.6 / 255


def test_the_papers_gradient_is_dimmed_as_the_light_is(crate_views):
    views, _ = crate_views
    texture = torch.full((3, TEXELS, TEXELS), 0.5, requires_grad=True)
    plain = batch_views(views, "cpu")
    half = torch.full_like(plain.still, 0.5)
    for batch, expected in ((plain, 1.0), (plain.through(half, half), 0.5)):
        (gradient,) = torch.autograd.grad(show_texture(texture, batch, "linear").sum(), texture)
        assert gradient.sum() == pytest.approx(expected * 3 * sum(view.coverage.sum() for view in views), rel=0.05)


def test_probability_and_seeds(crate_views):
    depths = crate_views[1] * 30
    factor, offset = Weathered(weathers=(("fog", 3),), probability=0.3).draw(depths, np.random.default_rng(1))
    clear = [bool((one == 1).all() and (other == 0).all()) for one, other in zip(factor, offset, strict=True)]
    assert 28 < sum(clear) < 55
    again = Weathered(weathers=(("fog", 3),), probability=0.3).draw(depths, np.random.default_rng(1))
    assert torch.equal(factor, again[0]) and torch.equal(offset, again[1])
    assert (Weathered(weathers=(("fog", 3),), probability=0).draw(depths, np.random.default_rng(1))[0] == 1).all()


def test_words_and_what_is_refused():
    part = read_words(["fog:1-2", "dust:5"])
    assert part.weathers == (("fog", 1), ("fog", 2), ("dust", 5))
    assert part.describe() == "fog 1, fog 2, dust 5, probability 0.5"
    assert "visibility 10 m" in part.lines()[2]
    assert read_words(None) is None
    for arguments in ({"weathers": ()}, {"weathers": (("hail", 1),)}, {"weathers": (("fog", 9),)}):
        with pytest.raises(ToolkitError):
            Weathered(**arguments)
    with pytest.raises(ToolkitError, match="probability 2: expected 0 to 1"):
        Weathered(weathers=(("fog", 1),), probability=2)
