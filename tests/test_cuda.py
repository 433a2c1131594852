"""What a GPU computes is what a CPU does, and all that trains or answers runs there; skipped where there is none."""

import numpy as np
import pytest
import torch
from colour_folder import write_colours
from texture_parts import make_crate, render_linear
from tiny_network import write_photos

import toolkit as tk
from toolkit.boosters import patch_config, texture_config
from toolkit.boosters.linear_view import batch_views
from toolkit.boosters.pixel_config import DataConfig
from toolkit.boosters.pixels import Target, judge_ensemble
from toolkit.boosters.texture import take_photos
from toolkit.boosters.transforms.show import show_patch
from toolkit.core.draws import Draws
from toolkit.corruptions.catalogue import CORRUPTIONS
from toolkit.evaluation.saliency import compute_gradcam, find_feature_map
from toolkit.models.network import fold_normalisation
from toolkit.models.predict import predict
from toolkit.training.refine import refine_network
from toolkit.training.refine_config import RefineConfig

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU that torch can use")
DEVICES, DRAWS = ("cpu", "cuda"), Draws(0, 3)


@pytest.fixture(scope="module")
def networks():
    return {device: tk.load_classifier("rig18", device=device) for device in DEVICES}


@pytest.fixture(scope="module")
def pictures():
    coarse = np.random.default_rng(0).integers(0, 256, (8, 14, 14, 3), np.uint8)
    return torch.from_numpy(coarse.repeat(16, axis=1).repeat(16, axis=2).transpose(0, 3, 1, 2) / np.float32(255))


def noise(*shape):
    return torch.from_numpy(np.random.default_rng(1).uniform(0.2, 0.8, shape).astype(np.float32))


def share_of(different, of):
    """How long a difference is, of the length of what it is from."""
    return float((different - of).norm() / of.norm())


def check_shown(found):
    """Pictures and gradients on the CPU and on the GPU; a JPEG's rounding may fall to either side."""
    (picture, gradient), (other, its_gradient) = found
    assert share_of(other, picture) < 1e-2
    assert share_of(its_gradient, gradient) < 1e-4


def test_answers_are_those_of_the_cpu_to_single_precision(networks, pictures):
    images = list((pictures * 255).byte().permute(0, 2, 3, 1).numpy())
    cpu, cuda = (predict(images, networks[one]).softmax(1).numpy() for one in DEVICES)
    assert np.allclose(cpu, cuda, atol=1e-5)


def test_normalisation_folds(networks):
    assert fold_normalisation(networks["cuda"]) is not networks["cuda"]


def test_heat_is_that_of_the_cpu(networks, pictures):
    cpu, cuda = (
        compute_gradcam(networks[one], find_feature_map(networks[one]), pictures[:4], [3, 1, 4, 1]) for one in DEVICES
    )
    assert np.allclose(cpu, cuda, atol=1e-3 * np.abs(cpu).max())


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_corruptions_are_those_of_the_cpu(name, pictures):
    cpu, cuda = (tk.corrupt(pictures[:3].to(one), name, 3, [5, 6, 7]).cpu() for one in DEVICES)
    assert float((cpu - cuda).abs().mean()) < 1e-4


@pytest.mark.parametrize("recipe", patch_config.RECIPES)
def test_a_patch_is_shown_as_on_the_cpu_and_so_is_its_gradient(recipe):
    config, found = patch_config.RECIPES[recipe], []
    for device in DEVICES:
        theta = noise(3, 16, 16).to(device).requires_grad_(True)
        shown = show_patch(theta, noise(4, 3, 64, 64).to(device), config.appearance(), DRAWS)
        (shown * noise(*shown.shape).to(device)).sum().backward()
        found.append((shown.detach().cpu(), theta.grad.cpu()))
    check_shown(found)


@pytest.mark.parametrize("recipe", texture_config.RECIPES)
def test_a_texture_is_shown_as_on_the_cpu_and_so_is_its_gradient(recipe, make_crate_space, tmp_path):
    views, found = render_linear(make_crate(make_crate_space(tmp_path / "w"))[1])[0], []
    config = texture_config.RECIPES[recipe]
    for device in DEVICES:
        theta = noise(3, 32, 32).to(device).requires_grad_(True)
        shown = take_photos(theta, batch_views(views, device), config, DRAWS)
        (shown * noise(*shown.shape).to(device)).sum().backward()
        found.append((shown.detach().cpu(), theta.grad.cpu()))
    check_shown(found)


@pytest.mark.parametrize("options", [
    {}, {"ensemble": "normalised"}, {"jitter": True}, {"block_shuffle": True}, {"feature_mixup": True},
], ids=str)  # fmt: skip
def test_networks_lead_photographs_the_same_way(options, networks, pictures):
    settings, found = patch_config.make_config("default", options, DataConfig(sources=("rig",))), []
    for device in DEVICES:
        photos = pictures.detach().clone().to(device).requires_grad_(True)
        targets = [Target(networks[device], index) for index in (3, 5)]
        clean = pictures.to(device) if "feature_mixup" in options else None
        judge_ensemble(photos, targets, settings, DRAWS, clean)[0].backward()
        found.append(photos.grad.cpu())
    # the networks run in half precision there
    assert share_of(*found[::-1]) < 0.1


@pytest.mark.parametrize("settings", [
    {}, {"flat": "sam"}, {"flat": "swa"}, {"robust": "l2:0.25"}, {"checkpoints": 2},
], ids=str)  # fmt: skip
def test_a_network_is_refined(settings, networks, tmp_path):
    space, folder = tk.make_workspace(tmp_path / "w"), tmp_path / "photos"
    for k, label in enumerate(("racer", "warplane")):
        write_photos(folder / label, 10, k, (256, 256))
    config = RefineConfig(name="fine", data=(str(folder),), steps=4, batch=8, **settings)
    with tk.quietly():
        made = refine_network(config, space, networks["cuda"])
    for fine in made.records:
        one = tk.load_classifier(fine.name, device="cuda", folder=space.classifiers_dir)
        assert fine.settings["precision"] == "bfloat16" and one.device == "cuda"


@pytest.mark.parametrize("command", [
    "train-patch --object racer --steps 3 --batch 4 --mounted-views 10 --images 10 --corrupt common --weather fog",
    "train-patch --object racer --steps 3 --batch 4 --mounted-views 10 --images 10 --recipe paper",
    "train-texture --object racer --steps 3 --batch 4 --corrupt common --weather snow",
    "train-wrap --object racer --steps 3 --batch 4",
    "train-classifier --name own --data {colours} --image-px 32 --epochs 1 --batch 8",
    "train-classifier --name own --data {colours} --image-px 32 --epochs 1 --batch 8 --robust l2:0.5",
], ids=lambda one: " ".join(one.split()[:2]))  # fmt: skip
def test_the_command_runs(command, tmp_path, type_toolkit):
    words = command.format(colours=write_colours(tmp_path / "colours", 10, 64)).split()
    type_toolkit("init", tmp_path / "w")
    model = [] if words[0] == "train-classifier" else ["--model", "rig18"]
    if words[0] == "train-wrap":
        assert type_toolkit("wrap", "--object", "racer", "--workspace", tmp_path / "w")[0] == 0
    code, out, err = type_toolkit(*words, *model, "--workspace", tmp_path / "w", "--device", "cuda")
    assert code == 0, out + err


def test_the_same_seed_gives_the_same_pixels(networks, tmp_path):
    found = []
    for k in range(2):
        with tk.quietly():
            made = tk.train_patch(
                tk.make_workspace(tmp_path / f"w{k}"), "racer", networks["cuda"], steps=6, batch=4, mounted_views=10,
                images=10,
            )  # fmt: skip
        found.append(made.patch.pixels)
    assert np.array_equal(*found)
