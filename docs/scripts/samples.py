"""Compare answers to Mitsuba's images with those to images of 1,024 samples: samples.py [COUNT [MODEL ...]].

Writes docs/results/samples.csv. The images are drawn from those of run-renderers, which makes the workspace that this
reads: in turn without and with a booster. Images that the table has are left as they are; 80 CPU seconds each.
"""

import csv
import sys
from itertools import chain, product
from pathlib import Path

import numpy as np
from tables import TABLES, Row, write_table

from toolkit.captures.shoot import ShootSettings, studio_for
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.imaging.preprocessing import resize_and_crop
from toolkit.models.load import load_classifier
from toolkit.models.network import Classifier
from toolkit.models.predict import predict
from toolkit.objects.load import load_object
from toolkit.rig.mitsuba import SAMPLES, MitsubaRenderer, denoise
from toolkit.rig.plan import open_plan
from toolkit.rig.shading import tone_map
from toolkit.rig.variants import apply_booster, find_booster

FEW = SAMPLES, 64
"""Samples of the images that are compared with the reference."""
MANY = 1024
FILE = TABLES / "samples.csv"


def main(count: str = "30", *models: str) -> None:
    """Write a row for each image and network."""
    networks = [load_classifier(name) for name in models or ("resnet18", "mobilenet_v2")]
    rows: list[Row] = list(csv.DictReader(FILE.open(encoding="utf-8"))) if FILE.is_file() else []
    known = {(row["object"], row["variant"], row["light"], int(row["pose"])) for row in rows}
    space = open_workspace(Path("renderers")).with_patches("four-networks")
    for which in draw_images(space)[: int(count)]:
        if which not in known:
            rows += compare(space, which, networks)
            write_table(FILE, rows)


def draw_images(space: Workspace) -> list[tuple[str, str, str, int]]:
    """Object, variant, light and pose of all images in random order, in turn without and with a booster."""
    rng, plan = np.random.default_rng(0), open_plan(space)
    poses = [(name, pose.id) for name in sorted(plan.objects) for pose in plan.objects[name]]
    lights = "studio", "lamp", "sky"
    bare = [(name, "unpatched", light, pose) for (name, pose), light in product(poses, lights)]
    boosted = [
        (name, variant, light, pose)
        for (name, pose), light, variant in product(poses, lights, ("patched", "wrapped", "textured"))
    ]
    order = rng.permutation(len(bare)), rng.permutation(len(boosted))
    return list(chain(*((bare[a], boosted[b]) for a, b in zip(*order, strict=False))))


def compare(space: Workspace, which: tuple[str, str, str, int], networks: list[Classifier]) -> list[Row]:
    """A row for each network: its answers by samples, and how far the images differ from the reference."""
    name, variant, light, number = which
    item, settings, plan = load_object(space.object_spec(name)), ShootSettings(light=light), open_plan(space)
    mesh, scene = apply_booster(item, find_booster(space, item, variant)), studio_for(item, settings)
    pose = next(pose for pose in plan.objects[name] if pose.id == number).matrix()
    pictures: dict[str, np.ndarray] = {}
    for samples in (*FEW, MANY):
        light_map, albedo, normal = MitsubaRenderer(mesh, scene, samples=samples).trace(plan.camera, pose)
        noisy = light_map * np.float32(scene.exposure)
        pictures[str(samples)] = tone_map(denoise(noisy, albedo, normal), (0, number))
    # the reference without the denoiser, which could change the answer itself
    pictures["noisy"] = tone_map(noisy, (0, number))
    apart = np.abs(pictures[str(SAMPLES)].astype(int) - pictures[str(MANY)]).mean()
    found: list[Row] = []
    for network in networks:
        crops = np.stack([resize_and_crop(one, network.preprocessing) for one in pictures.values()])
        share = predict(crops, network).softmax(1).numpy()
        row: Row = {
            "object": name, "variant": variant, "light": light, "pose": number, "network": network.name,
            "difference": float(apart),
        }  # fmt: skip
        for key, chances in zip(pictures, share, strict=True):
            row |= {f"answer_{key}": int(chances.argmax()), f"probability_{key}": float(chances.max())}
        # how clear the reference's answer is: between its first two guesses
        second, first = np.sort(share[list(pictures).index(str(MANY))])[-2:]
        found.append(row | {"margin": float(first - second)})
    return found


if __name__ == "__main__":
    main(*sys.argv[1:])
