"""train-texture against its network alone: does training wait for pictures, and how does it grow with the mesh?

The network's own rate is a bare forward and backward of a ResNet-18 to the pixels, in the precision that training uses.
"""

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from statistics import median
from time import perf_counter
from types import SimpleNamespace
from typing import cast

import numpy as np
import torch

from benchmarks.peers import peak_mb
from toolkit.boosters.booster import BoosterFiles
from toolkit.boosters.data import Loaded
from toolkit.boosters.pixels import Target, judge_photos
from toolkit.boosters.texture import TextureTask
from toolkit.boosters.texture_config import TextureConfig, make_config
from toolkit.boosters.texture_objects import TexturedObject, TextureInputs
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.network import Classifier, choose_device
from toolkit.models.vision import torchvision
from toolkit.models.weights import WeightsFile
from toolkit.objects.atlas import Atlas, make_atlas
from toolkit.objects.load import TableObject, build_mesh
from toolkit.objects.mesh import Material, Mesh, place_on_table
from toolkit.rig.camera import Camera
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.studio import make_studio
from toolkit.rig.views import DETAIL, FOV_DEG, random_pose
from toolkit.training.loop import make_steps

TEXELS, LENGTH_MM = 200, 270.0
RECIPE = {"objects": ("warplane",), "size_px": TEXELS}
"""What of the default recipe is set here."""
TRIANGLES = (1_000, 10_000, 100_000, 300_000)
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
GOAL, GOAL_GB = 0.85, 1.5
WARM_GROUPS, TIMED_GROUPS, ROUNDS = 1, 2, 3
NETWORKS, NETWORKS_GOAL = 3, 0.9


def make_target(device: str) -> Target:
    """ResNet-18 with random weights, frozen: speed does not depend on what it has learnt."""
    torch.manual_seed(0)
    module = torchvision.models.resnet18(weights=None).eval().requires_grad_(False)
    module = module.to(device=device, memory_format=torch.channels_last)
    weights = WeightsFile(Path("random"), "0" * 64, "random")
    how = Preprocessing(256, 224, MEAN, STD)
    return Target(Classifier("resnet18", module, ["class"] * 1000, how, weights, device, False), 0)


def make_sphere(triangles: int) -> Mesh:
    """A ball of about so many triangles, its texture laid round it."""
    rings = max(4, round(np.sqrt(triangles / 4)))
    v, u = np.mgrid[0 : rings + 1, 0 : 2 * rings + 1].astype(np.float32)
    v, u = v / rings, u / (2 * rings)
    polar, azimuth = np.pi * v, 2 * np.pi * u
    normals = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), -np.cos(polar)], -1)
    normals = normals.reshape(-1, 3).astype(np.float32)
    wide = 2 * rings + 1
    start = (np.arange(rings)[:, None] * wide + np.arange(2 * rings)).reshape(-1)
    lower = np.stack([start, start + 1, start + wide + 1], 1)
    upper = np.stack([start, start + wide + 1, start + wide], 1)
    faces = np.concatenate([lower[start >= wide], upper[start < (rings - 1) * wide]]).astype(np.int32)
    paint = Material("paint", np.full((4, 4, 3), 128, np.uint8))
    uv = np.stack([u, v], -1).reshape(-1, 2)
    mesh = Mesh(normals * 50, normals, uv, faces, np.zeros(len(faces), np.int32), (paint,))
    return place_on_table(mesh, LENGTH_MM)


def render_block(atlas: Atlas, views: int, seed: int) -> float:
    """Seconds per view to light a studio and render `views` pictures of the object in it, as `capture-sim` does."""
    began = perf_counter()
    renderer = RaycastRenderer(atlas.mesh, make_studio((seed, 1), LENGTH_MM), DETAIL)
    camera = Camera.from_fov(224, 224, FOV_DEG)
    for i in range(views):
        renderer.render(camera, random_pose(np.random.default_rng([seed, i]), atlas.mesh.vertices, camera))
    return (perf_counter() - began) / views


def time_rendering(atlas: Atlas, views: int) -> float:
    """Seconds per view, on one core."""
    return median(render_block(atlas, views, seed) for seed in range(1, 4))


def time_network(target: Target, batch: int, device: str, repeats: int = 9) -> float:
    """Seconds per image of a bare forward and backward to the pixels, in the precision that training chooses."""
    seconds = []
    images = torch.rand(batch, 3, 224, 224, device=device)
    for _ in range(repeats + 1):
        began = perf_counter()
        pixels = images.detach().requires_grad_(True)
        loss, _ = judge_photos(pixels, [target])
        loss.item(), torch.autograd.grad(loss, pixels)
        if device == "cuda":
            torch.cuda.synchronize()
        seconds.append((perf_counter() - began) / batch)
    return median(seconds[1:])


def step_through(atlas: Atlas, target: Target, config: TextureConfig, groups: int, networks: int = 1) -> Iterator[None]:
    """Training steps, one per turn, of so many groups of views, on the network once or several times."""
    config = config.with_overrides(steps=groups * config.steps_per_group)
    item = cast(TableObject, SimpleNamespace(mesh=atlas.mesh, name="ball"))
    none = Loaded(np.zeros((0, 256, 256, 3), np.uint8))
    files = BoosterFiles(Path("texture.png"), Path("preview.png"), Path("training"))
    inputs = TextureInputs([TexturedObject(item, atlas)], none)
    task = TextureTask(config, [target] * networks, inputs, files)
    yield from make_steps(task, config.fit_config(config.optimiser))


def time_training(
    atlas: Atlas, target: Target, config: TextureConfig, timed: int = TIMED_GROUPS, networks: int = 1
) -> float:
    """Seconds per image, once the first group of views is used up."""
    warm = WARM_GROUPS * config.steps_per_group
    began, count = 0.0, 0
    for count, _ in enumerate(step_through(atlas, target, config, WARM_GROUPS + timed, networks), 1):
        if count == warm:
            began = perf_counter()
    return (perf_counter() - began) / ((count - warm) * config.batch)


def measure_memory() -> float:
    """Peak of a training at the default batch, GB."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_train_and_weigh, RECIPE).result()


def _train_and_weigh(recipe: dict[str, object]) -> float:
    config = make_config("default", recipe)
    atlas = make_atlas(place_on_table(build_mesh("warplane"), LENGTH_MM), TEXELS)
    for _ in step_through(atlas, make_target("cpu"), config, 2):
        pass
    return peak_mb() * 1024**2 / 1e9


def run(device: str = "auto") -> dict[str, float | str]:
    """Images per second against the limits, the time of a step as the mesh grows, and peak memory."""
    device = choose_device(device)
    target = make_target(device)
    default = make_config("default", RECIPE)
    plain = default.with_overrides(reuse=1, clouds=False, camera=False)
    atlas = make_atlas(place_on_table(build_mesh("warplane"), LENGTH_MM), TEXELS)
    render = time_rendering(atlas, plain.per_studio)
    rates = []
    for _ in range(ROUNDS):  # side by side, so that drift of the machine hits both alike
        network, training = time_network(target, plain.batch, device), time_training(atlas, target, plain, 1)
        rates.append((1 / network, 1 / training))
    network, training = (median(column) for column in zip(*rates, strict=True))
    report: dict[str, float | str] = {
        "bare render, views/s, one core": 1 / render,
        f"bare forward + backward, images/s, batch {plain.batch}, {device}": network,
        "toolkit, every view used once, images/s": training,
        f"ratio to the bare network, every view used once (mark {GOAL:g})": median(b / a for a, b in rates),
    }
    rate = 1 / time_training(atlas, target, default)
    report[f"toolkit, default recipe, every view used {default.reuse} times, images/s"] = rate
    report["ratio to the bare network, default recipe"] = rate / network
    for ensemble in ("turns", "normalised"):
        joined = default.with_overrides(ensemble=ensemble)
        seconds = time_training(atlas, target, joined, 1, networks=NETWORKS)
        name = f"{NETWORKS} networks by {ensemble}: a step's time over {NETWORKS} of one's (mark {NETWORKS_GOAL:g})"
        report[name] = seconds * rate / NETWORKS
    for triangles in TRIANGLES:
        sphere = make_atlas(make_sphere(triangles), TEXELS)
        seconds = time_training(sphere, target, default, 1) * default.batch
        report[f"default recipe, {len(sphere.mesh.faces)} triangles, s per step"] = seconds
    report[f"default recipe, peak memory, GB (mark {GOAL_GB:g})"] = measure_memory()
    return report


if __name__ == "__main__":
    import json

    print(json.dumps(run(), indent=2))
