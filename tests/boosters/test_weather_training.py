"""Training in weather: its gradient, its draws, what is validated, and that a run without it is as before."""

import numpy as np
import pytest
import torch
from texture_parts import crate_config
from tiny_network import IMAGE_PX, tiny_classifier, tiny_config

from toolkit.boosters.booster import introduce
from toolkit.boosters.data import Loaded
from toolkit.boosters.mounted import draw_mounted, render_mounted_views, show_mounted, stack_views
from toolkit.boosters.patch import train_patch
from toolkit.boosters.patch_config import PatchConfig
from toolkit.boosters.pixel_config import DataConfig
from toolkit.boosters.pixels import Target, judge_photos
from toolkit.boosters.texture import TextureTask, choose_files, train_texture
from toolkit.boosters.texture_config import TextureConfig
from toolkit.boosters.texture_objects import TextureInputs, load_objects
from toolkit.boosters.transforms.weather import find_depths
from toolkit.core.console import quietly, verbosely
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.objects.load import load_object
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.studio import make_studio
from toolkit.rig.views import find_depth
from toolkit.rooms.worlds.weathered import Weathered, read_words

WORLD_LENGTH_M = 6.0
FOGGY = {"weather": ("fog:3-5", "dust:4")}


@pytest.fixture(scope="module")
def space(tmp_path_factory, make_crate_space):
    made = make_crate_space(tmp_path_factory.mktemp("foggy"))
    file = made.objects_dir / "crate.toml"
    file.write_text(file.read_text().replace("[patch]", f"world_length_m = {WORLD_LENGTH_M}\n[patch]"))
    return made


def double_classifier():
    made = tiny_classifier()
    made.module.double()
    return made


def texture_task(space, config: TextureConfig) -> TextureTask:
    objects = load_objects(space, config, None)
    none = Loaded(np.zeros((0, 36, 36, 3), np.uint8))
    files, inputs = choose_files(space, None, "x"), TextureInputs(objects, none)
    task = TextureTask(config, [Target(double_classifier(), 3)], inputs, files, workers=0)
    task.pixels = task.pixels.detach().double().requires_grad_(True)
    return task


def test_the_gradient_of_a_whole_step_in_weather_is_that_of_differences(space):
    task = texture_task(space, crate_config(batch=3, **FOGGY).with_overrides({"weather.probability": 1.0}))
    with task.open():
        loss, _ = task.loss(0)
        (gradient,) = torch.autograd.grad(loss, task.pixels)
        strongest = gradient.abs().flatten().topk(6).indices
        for k in strongest.tolist():
            found = []
            for step in (1e-5, -1e-5):
                with torch.no_grad():
                    task.pixels.view(-1)[k] += step
                    found.append(float(task.loss(0)[0]))
                    task.pixels.view(-1)[k] -= step
            assert (found[0] - found[1]) / 2e-5 == pytest.approx(float(gradient.view(-1)[k]), rel=1e-4)
    assert gradient.abs().max() > 0


def test_weather_dims_what_the_texture_changes(space):
    """The same step in clear air and in fog: what is drawn beside the weather stays as it was."""
    sizes = []
    for words in ((), ("fog:5",)):
        config = crate_config(batch=3, exposure=None, **({"weather": words} if words else {}))
        task = texture_task(space, config.with_overrides({"weather.probability": 1.0} if words else {}))
        with task.open():
            (gradient,) = torch.autograd.grad(task.loss(0)[0], task.pixels)
        sizes.append(float(gradient.abs().sum()))
    assert sizes[1] < 0.2 * sizes[0]  # at 10 m and more, of 10 m visibility


def test_depth_in_the_studio_is_the_way_to_object_table_and_room(space):
    """Against the table's plane and the crate's box, ray by ray."""
    item = load_object(space.object_spec("crate"))
    studio, camera = make_studio(0, 100.0, "oak"), Camera.from_fov(24, 18, 50)
    pose = orbit_pose(np.array([0, 0, 20.0]), 30, 25, 400)
    found = find_depth(RaycastRenderer(item.mesh, studio), studio, camera, pose).depth
    low, high = item.mesh.bounds
    for row in range(18):
        for column in range(24):
            x, y = (column + 0.5 - camera.cx) / camera.fx, (row + 0.5 - camera.cy) / camera.fy
            ray = pose[:3, :3] @ (np.array([x, y, 1.0]) / np.linalg.norm([x, y, 1.0]))
            near, far = np.sort((np.stack([low, high]) - pose[:3, 3]) / ray, axis=0)
            reach = near.max() if near.max() < far.min() else np.inf
            to_table = -pose[2, 3] / ray[2] if ray[2] < 0 else np.inf
            on_table = np.abs(pose[:2, 3] + to_table * ray[:2]) <= np.array(studio.need_table().size_mm) / 2
            reach = min(reach, to_table if on_table.all() else np.inf)
            assert found[row, column] == pytest.approx(reach, rel=1e-3)


def test_views_of_a_sheet_are_cut_with_their_weather(space):
    """A cut in weather is the same as the weather of the whole view, cut: fog depends on the pixel's depth alone."""
    item = load_object(space.object_spec("crate"))
    views = render_mounted_views(item, [40.0], 8, 2, seed=7, image_px=40, with_depth=True)
    stacked = stack_views(views, [40.0], "cpu", item.spec.metres_per_mm)
    part, patch = Weathered(weathers=(("fog", 4),), probability=1), torch.full((3, 8, 8), 0.5)
    which, corners, whole = np.array([0, 1]), np.array([[3, 5], [6, 1]]), np.zeros((2, 2), int)

    def show(corners, side):
        through = stacked.draw_weather(part, which, corners, side, np.random.default_rng(3))
        return show_mounted(patch, stacked, which, corners, side, through=through)

    cut, full = show(corners, 32), show(whole, 40)
    for k, (top, left) in enumerate(corners):
        assert torch.allclose(cut[k], full[k, :, top : top + 32, left : left + 32], atol=1e-6)
    clear = show_mounted(patch, stacked, which, corners, 32)
    assert (clear - cut).abs().mean() > 0.05
    nearest = min(float(view.depth.min()) for view in stacked.depths)
    assert 5 < nearest < 40  # a crate of 6 m fills the frame from there


def test_the_gradient_on_the_sheet_in_weather_is_that_of_differences(space):
    item = load_object(space.object_spec("crate"))
    views = render_mounted_views(item, [40.0], 8, 3, seed=7, image_px=40, with_depth=True)
    stacked = stack_views(views, [40.0], "cpu", item.spec.metres_per_mm)
    part = Weathered(weathers=read_words(["fog:2", "rain:5"]).weathers, probability=1)
    theta = torch.from_numpy(np.random.default_rng(1).uniform(0.2, 0.8, (3, 8, 8))).requires_grad_(True)
    targets = [Target(double_classifier(), 1)]

    def loss_at(patch):
        return judge_photos(draw_mounted(stacked, Draws(0, 0), 3, IMAGE_PX, part)(patch), targets)[0]

    (gradient,) = torch.autograd.grad(loss_at(theta), theta)
    for k in gradient.abs().flatten().topk(6).indices.tolist():
        step = torch.zeros(theta.numel(), dtype=torch.float64)
        step[k] = 1e-5
        step = step.view_as(theta)
        with torch.no_grad():
            difference = float(loss_at(theta + step) - loss_at(theta - step)) / 2e-5
        assert difference == pytest.approx(float(gradient.view(-1)[k]), rel=1e-4)


def test_a_texture_trained_in_weather_is_judged_in_it(space):
    with quietly():
        made = train_texture(crate_config(2, **FOGGY), [tiny_classifier()], space, class_name="jet", workers=0)
    record = made.texture.record
    assert record.settings["weather"]["weathers"] == [["fog", 3], ["fog", 4], ["fog", 5], ["dust", 4]]
    assert record.final["tiny_held_out_weather_patched_n"] == 4
    assert made.validations[0].weather is not None


def test_a_patch_trained_in_weather_is_judged_in_it(space):
    config = tiny_config(2, mounted_share=0.5, mounted_views=5, **FOGGY)
    with quietly():
        made = train_patch(config, "jet", [tiny_classifier()], DataConfig(sources=("rig:crate",), images=4), space)
    assert made.patch.record.final["tiny_mounted_weather_patched_n"] == 1
    assert made.patch.record.settings["weather"]["probability"] == 0.5


def test_settings_without_weather_are_recorded_as_before():
    for config in (TextureConfig(objects=("crate",)), PatchConfig()):
        assert "weather" not in config.record()
        assert "weather" not in dict(config.rows())
        foggy = config.with_overrides(weather=("fog:2",))
        assert foggy.record() != config.record()
        with verbosely():
            said = "\n".join(introduce("patch", foggy, 8, [Target(tiny_classifier(), 3)]))
        assert "visibility 70 m" in said


def test_depths_are_those_of_the_real_thing(space):
    item = load_object(space.object_spec("crate"))
    (view,) = render_mounted_views(item, [40.0], 8, 1, seed=7, image_px=20, with_depth=True)
    (depth,) = find_depths([view], [item.spec.metres_per_mm])
    assert depth.depth.min() / view.depth.depth.min() == pytest.approx(0.06)  # 6 m for 100 mm


def test_what_has_no_real_size_is_refused(tmp_path, make_crate_space):
    bare = make_crate_space(tmp_path / "w")
    said = "object 'crate' has no real size, which weather and worlds need: add world_length_m"
    with quietly(), pytest.raises(ToolkitError, match=said):
        train_texture(crate_config(2, **FOGGY), [tiny_classifier()], bare, class_name="jet", workers=0)
    config, data = tiny_config(2, mounted_share=0.5, **FOGGY), DataConfig(sources=("rig:crate",), images=4)
    with quietly(), pytest.raises(ToolkitError, match=said):
        train_patch(config, "jet", [tiny_classifier()], data, bare)
    with quietly(), pytest.raises(ToolkitError, match="weather and world need the object itself"):
        train_patch(tiny_config(2, **FOGGY), "jet", [tiny_classifier()], data, bare)
