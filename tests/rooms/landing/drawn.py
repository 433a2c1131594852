"""A landing data set whose pictures are drawn: a white square where the truth says."""

from pathlib import Path

import cv2
import numpy as np

from toolkit.core.files import sha256_file, write_json
from toolkit.models.architectures import build_network
from toolkit.rooms.landing.config import CameraConfig
from toolkit.rooms.landing.dataset import DatasetFile, Sample, ShardFile, Split, Truth, encode_sample, write_shard

OPTICS = CameraConfig(image_px=48)
SEED = 5


def draw(index: int) -> Sample:
    rng, camera = np.random.default_rng([SEED, index]), OPTICS.camera
    z = rng.uniform(2, 6)
    x, y = rng.uniform(-0.4, 0.4, 2) * z
    image = rng.integers(40, 90, (48, 48, 3)).astype(np.uint8)
    mask = np.zeros((48, 48), np.uint8)
    half = camera.fx / z
    centre = camera.cx + camera.fx * np.array([x, y]) / z
    low, high = np.round(centre - half).astype(int), np.round(centre + half).astype(int)
    cv2.rectangle(mask, tuple(map(int, low)), tuple(map(int, high - 1)), 255, -1)
    image[mask > 0] = 230
    weather = ("clear", 0) if index % 3 else ("fog", 2)
    truth = Truth(
        index=index, seed=SEED, x_m=x, y_m=y, z_m=z, yaw_deg=0.0, place="drawn", time="noon", weather=weather[0],
        severity=weather[1], seen_px=int((mask > 0).sum()),
    )  # fmt: skip
    return Sample(image, mask > 0, truth)


def write_drawn(folder: Path, train: int = 256, held_out: int = 64, first: int = 0) -> Path:
    folder.mkdir(parents=True)
    shards = []
    parts: list[tuple[Split, range]] = [
        ("train", range(first, first + train)), ("held_out", range(first + train, first + train + held_out))
    ]  # fmt: skip
    for split, numbers in parts:
        file = f"{split}.tar"
        write_shard(folder / file, [encode_sample(draw(index)) for index in numbers])
        shards.append(ShardFile(file=file, split=split, n=len(numbers), sha256=sha256_file(folder / file)))
    about = DatasetFile(
        inputs_sha256=f"{first:064d}", seed=SEED, world="drawn", world_seed=0, pad="plain",
        pad_sha256="1" * 64, size_m=2.0, camera=OPTICS.camera.intrinsics,
        places={"train": ["drawn"], "held_out": ["drawn"]}, settings={}, complete=True, shards=shards,
        toolkit_version="0",
    )  # fmt: skip
    write_json(folder / "dataset.json", about.model_dump(mode="json"))
    return folder


def write_start(file: Path) -> Path:
    """Random weights of a network, as published ones would be."""
    import torch

    torch.manual_seed(0)
    torch.save(build_network("shufflenet_v2_x0_5", 10).state_dict(), file)
    return file
