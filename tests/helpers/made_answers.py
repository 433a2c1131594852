"""Answers made up for the tests of tables, figures and the report; plausible, and the same every time."""

from __future__ import annotations

import numpy as np

from toolkit.corruptions.catalogue import CORRUPTIONS
from toolkit.rooms.benchmarks.corruptions import CLEAN
from toolkit.rooms.benchmarks.corruptions.grid import Benchmark, CellRanks
from toolkit.rooms.benchmarks.corruptions.recognisers import NETWORK, READER

VARIANTS = {
    "unpatched": 0.0, "patches-100": 2.6, "patches-60": 1.4, "best-image-100": 0.9, "random-image-100": 0.2,
    "qr-100": -0.8,
}  # fmt: skip
READERS = {"zxing": 0.7, "pyzbar": 0.2, "opencv": -0.8}


def make_benchmark(
    n=120, n_classes=20, corruptions=tuple(CORRUPTIONS), severities=(1, 2, 3, 4, 5), cells=None,
    variants=tuple(VARIANTS), readers=True, fixed=True, clean=True, seed=0, parameters="imagenet",
    failed=(), notes=(), name="made",
):  # fmt: skip
    """A benchmark whose images and classes differ in how hard they are."""
    rng = np.random.default_rng(seed)
    classes = np.arange(n) * 7 % n_classes
    ease = rng.normal(0, 1.1, n_classes)[classes] + rng.normal(0, 0.6, n)
    hardness = dict(zip(CORRUPTIONS, rng.uniform(0.1, 1.6, len(CORRUPTIONS)), strict=True))
    cells = cells or [(name, level) for name in corruptions for level in severities]
    grid = ([(CLEAN, 0)] if clean else []) + list(cells)
    answers = []

    def add(variant, answerer, kind, gain):
        for corruption, severity in grid:
            loss = 0.0 if corruption == CLEAN else hardness[corruption] * (0.4 + 0.45 * severity)
            score = 0.9 + gain + ease - loss + rng.logistic(0, 0.7, n)
            if kind == NETWORK:
                ranks = np.where(score > 0, 1, 2 + (rng.exponential(6, n) - score).clip(0).astype(int))
            else:
                ranks = np.where(score > 0, 1, np.where(rng.random(n) < 0.04, 2, 0))
            answers.append(CellRanks(variant, answerer, kind, corruption, severity, ranks.astype(np.int32)))

    for variant in variants:
        add(variant, "resnet18", NETWORK, VARIANTS[variant])
    if fixed:
        add("unpatched", "resnet18-fixed", NETWORK, -0.3)
        add("fixed-pattern-100", "resnet18-fixed", NETWORK, 1.0)
    if readers:
        for reader, gain in READERS.items():
            add("qr-100", reader, READER, gain)
    sizes = {one: int(one.rsplit("-", 1)[1]) for one in (*variants, "fixed-pattern-100") if one != "unpatched"}
    about = {
        "name": name,
        "data": "nips2017",
        "model": {"name": "resnet18", "arch": "resnet18", "weights": "resnet18-f37072fd.pth", "sha256": "ab" * 32},
        "is_imagenet": parameters == "imagenet",
        "image_px": 224,
        "parameters": parameters,
        "placement": {"rotation_deg": 45.0, "scale": [0.9, 1.1], "translate": 0.3},
        "seed": 0,
        "variants": [{"name": "unpatched", "patch_px": None, "method": None}]
        + [{"name": one, "patch_px": px, "method": "made up", "share_whole": 0.9} for one, px in sizes.items()],
        "toolkit_version": "0",
    }
    ids = tuple(f"class{classes[i]:03d}/{i:05d}.png" for i in range(n))
    labels = {int(k): f"class {k}" for k in np.unique(classes)}
    return Benchmark(about, ids, classes, labels, tuple(answers), tuple(failed), tuple(notes))
