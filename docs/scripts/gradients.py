"""Compare gradients of a texture with Mitsuba's own: gradients.py [OBJECT]. Writes docs/results/gradients.csv.

Each view is drawn as training draws it. Mitsuba renders it, and ResNet-18 judges the image. The gradient of its loss
then reaches the texels in three ways: by Mitsuba's differentiable path tracer (`prb`), and by both gradients of our
linear views. Views that the table has are left as they are.
"""

import csv
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from tables import TABLES, Row, write_table
from torch.nn.functional import cosine_similarity, cross_entropy

from toolkit.boosters.linear_view import batch_views, show_texture, tone_map
from toolkit.boosters.pixels import from_picture
from toolkit.boosters.texture_objects import TexturedObject
from toolkit.core.draws import Draws
from toolkit.core.workspace import Workspace
from toolkit.models.load import load_classifier
from toolkit.models.network import Classifier
from toolkit.objects.atlas import make_atlas
from toolkit.objects.load import load_object
from toolkit.rig import mitsuba
from toolkit.rig.camera import Camera
from toolkit.rig.mitsuba import BOUNCES, MitsubaRenderer, _load, _make_sensor
from toolkit.rig.views import TRAIN, ViewBlock, ViewSettings

VIEWS, TEXELS = 10, 200
SAMPLES = 35
"""Rays of a pixel in each of two estimates of Mitsuba's gradient; their cosine shows the noise that is left. Its
sampler takes a grid of 5 × 7."""
FILE = TABLES / "gradients.csv"


def main(name: str = "racer") -> None:
    """Write a row for each view."""
    item, network = load_object(Workspace(Path()).object_spec(name)), load_classifier("resnet18")
    textured = TexturedObject(item, make_atlas(item.mesh, TEXELS))
    subject, pixels = textured.subject(), textured.paint()
    left_out, texture = subject.mesh.materials[subject.material].texture, from_picture(pixels, "cpu")
    painted = tuple(replace(m, texture=pixels) if m.texture is left_out else m for m in subject.mesh.materials)
    trained = [number for number, m in enumerate(painted) if m.texture is pixels]
    wanted = torch.tensor([network.class_index(item.spec.class_name)])
    block = ViewBlock(subject.mesh, ViewSettings(per_studio=VIEWS), Draws(0, 0, TRAIN))
    # bitmaps of 8 bits keep their type, and only floating-point numbers have a gradient
    make_texture = mitsuba._make_texture
    mitsuba._make_texture = lambda picture: make_texture(picture) | {"format": "variant"}
    other = MitsubaRenderer(replace(subject.mesh, materials=painted), block.scene, block.stand)
    rows: list[Row] = list(csv.DictReader(FILE.open(encoding="utf-8"))) if FILE.is_file() else []
    for number in range(len(rows), VIEWS):
        camera, pose = block.aim(number)
        light = other.render(camera, pose)
        slope = differentiate(light, network, wanted) * block.scene.exposure
        # texels are encoded, Mitsuba's gradient is of linear colours
        halves = [slope_of_srgb(texture) * trace_back(other, trained, camera, pose, slope, seed) for seed in (1, 2)]
        true, view = halves[0] + halves[1], block.renderer.render_linear(camera, pose, left_out)
        batch = batch_views([replace(view, repaint=lambda _, light=light: light)], "cpu")
        row: Row = {"object": name, "view": number, "samples": 2 * SAMPLES, "cosine_noise": compare(*halves)}
        for gradient in ("shaded", "linear"):
            theta = texture.clone().requires_grad_()
            loss = cross_entropy(network.logits(show_texture(theta, batch, gradient)), wanted)
            row[f"cosine_{gradient}"] = compare(torch.autograd.grad(loss, theta)[0], true)
        rows.append(row)
        write_table(FILE, rows)


def compare(one: torch.Tensor, other: torch.Tensor) -> float:
    """Cosine of the angle between two gradients."""
    return cosine_similarity(one.flatten(), other.flatten(), 0).item()


def differentiate(light: np.ndarray, network: Classifier, wanted: torch.Tensor) -> np.ndarray:
    """(h, w, 3) gradient of the network's loss by the light of an image."""
    given = torch.from_numpy(light).permute(2, 0, 1)[None].requires_grad_()
    (slope,) = torch.autograd.grad(cross_entropy(network.logits(tone_map(given)), wanted), given)
    return slope[0].permute(1, 2, 0).contiguous().numpy()


def slope_of_srgb(texture: torch.Tensor) -> torch.Tensor:
    """Derivative of linear colours by encoded colours (IEC 61966-2-1)."""
    return torch.where(texture <= 0.04045, 1 / 12.92, 2.4 / 1.055 * ((texture + 0.055) / 1.055) ** 1.4)


def trace_back(
    renderer: MitsubaRenderer, trained: list[int], camera: Camera, pose: np.ndarray, slope: np.ndarray, seed: int
) -> torch.Tensor:
    """(3, n, n) gradient of Σ slope · light by the linear texels of the object's trained materials."""
    mi = _load()
    import drjit

    params = mi.traverse(renderer._built)
    ours = tuple(f"body0_{number}." for number in trained)
    keys = [key for key, _ in params if key.startswith(ours) and key.endswith("base_color.data")]
    for key in keys:
        # gradients of earlier calls would add up
        drjit.disable_grad(params[key])
        drjit.enable_grad(params[key])
    params.update()
    shown = mi.render(
        renderer._built, params, sensor=_make_sensor(camera, pose), spp=SAMPLES, seed=2 * seed, seed_grad=2 * seed + 1,
        integrator=mi.load_dict({"type": "prb", "max_depth": BOUNCES}),
    )  # fmt: skip
    drjit.backward(drjit.sum(shown * mi.TensorXf(slope), axis=None))
    found = np.sum([np.array(drjit.grad(params[key])) for key in keys], axis=0)
    return torch.from_numpy(found.astype(np.float32)).permute(2, 0, 1)


if __name__ == "__main__":
    main(*sys.argv[1:])
