"""The corruption benchmark's grid, photographs to ranks, against corrupting alone and the network alone on tensors.

All three run in this process, on the same device and threads, in turns, over the fifteen corruptions at severity 3. The
limit is the slower of the two: a grid that keeps the machine busy with nothing else comes near it. The network has
random weights: its speed does not depend on them.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.bench_eval import make_classifier, write_photographs
from benchmarks.peers import peak_mb

IMAGES, ROUNDS, SEVERITY = 32, 3, 3
BATCH = 32
MEMORY_COUNTS = (256, 512)
"""From one shard on: what is held is a shard."""
LABEL = "racer"


def make_grid(folder: Path, count: int, corruptions):
    """The grid over `count` photographs without and with a patch of 100 px."""
    import numpy as np

    from toolkit.core.workspace import make_workspace
    from toolkit.objects.records import write_patch
    from toolkit.rooms.benchmarks.corruptions import CorruptEvalConfig
    from toolkit.rooms.benchmarks.corruptions.cells import open_variants
    from toolkit.rooms.benchmarks.corruptions.grid import Grid
    from toolkit.training.images import open_images

    classifier, workspace = make_classifier(folder), make_workspace(folder / "space")
    pixels = np.random.default_rng(0).integers(0, 256, (100, 100, 3), np.uint8)
    record = {
        "name": LABEL, "class_name": LABEL, "class_index": classifier.class_index(LABEL), "networks": [], "data": {},
        "seed": 0, "settings": {"method": "noise"}, "final": {}, "toolkit_version": "0",
    }  # fmt: skip
    write_patch(workspace.root / "print" / "patches" / "noise-100", pixels, record)
    found = open_images(str(folder / "photographs"), classifier)
    variants, _ = open_variants(workspace, ["noise-100"], classifier, lambda name: None)
    images = type(found)(found.name, found.images[:count], (), found.read_pixels, found.hash_image)
    return Grid(images, tuple(variants), CorruptEvalConfig(corruptions=corruptions))


def measure_speed(folder: Path) -> dict[str, float]:
    """Images per second of the grid, of the corruptions alone and of the network alone; medians of turns."""
    import torch

    from toolkit.corruptions.batch import corrupt
    from toolkit.corruptions.catalogue import COMMON
    from toolkit.models.vision import torchvision
    from toolkit.rooms.benchmarks.corruptions.grid import run_grid

    corruptions = tuple((name, SEVERITY) for name in COMMON)
    grid = make_grid(folder, IMAGES, corruptions)
    bare = torchvision.models.resnet18()
    bare.load_state_dict(torch.load(folder / "resnet18-random.pth", weights_only=True))
    device = grid.variants[0].classifier.device
    bare.eval().to(device)
    batch = torch.rand(BATCH, 3, 224, 224, device=device)

    def run_ours() -> int:
        (folder / "cells.jsonl").unlink(missing_ok=True)
        return run_grid(grid, folder / "cells.jsonl").computed

    def run_corruptions() -> int:
        for name in COMMON:
            corrupt(batch, name, SEVERITY, range(BATCH))
        return BATCH * len(COMMON)

    def run_network() -> int:
        with torch.inference_mode():
            for _ in COMMON:
                bare(batch).argmax(1).cpu()
        return BATCH * len(COMMON)

    rates: dict[str, list[float]] = {"ours": [], "corruptions": [], "network": []}
    for turn in range(ROUNDS + 1):
        for name, work in (("ours", run_ours), ("corruptions", run_corruptions), ("network", run_network)):
            start = time.perf_counter()
            count = work()
            if turn:  # the first turn warms caches and kernels
                rates[name].append(count / (time.perf_counter() - start))
    return {name: sorted(values)[ROUNDS // 2] for name, values in rates.items()}


def measure_memory(folder: Path, count: int) -> float:
    """Peak resident memory in MB of a fresh process that evaluates `count` images under one corruption."""
    command = [sys.executable, "-m", "benchmarks.bench_corrupt_eval", "--memory", str(folder), str(count)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def _report_peak(folder: Path, count: int) -> None:
    from toolkit.rooms.benchmarks.corruptions.grid import run_grid

    run_grid(make_grid(folder, count, (("contrast", SEVERITY),)), folder / f"cells-{count}.jsonl")
    print(json.dumps(peak_mb()))


def run() -> dict[str, float]:
    """Ratios: speed against the slower part alone, and peak memory as the number of images doubles."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_photographs(folder / "photographs" / LABEL, MEMORY_COUNTS[-1], 320, 240)
        rates = measure_speed(folder)
        peaks = [measure_memory(folder, count) for count in MEMORY_COUNTS]
    limit = min(rates["corruptions"], rates["network"])
    return {
        "corrupt-eval answers/s": rates["ours"],
        "corruptions alone images/s": rates["corruptions"],
        "network alone images/s": rates["network"],
        "corrupt-eval: ratio to its slower part": rates["ours"] / limit,
        **{f"peak MB at {count} images": peak for count, peak in zip(MEMORY_COUNTS, peaks, strict=True)},
        f"peak memory, {MEMORY_COUNTS[-1]} / {MEMORY_COUNTS[0]} images": peaks[-1] / peaks[0],
    }


if __name__ == "__main__":
    if sys.argv[1:2] == ["--memory"]:
        _report_peak(Path(sys.argv[2]), int(sys.argv[3]))
    else:
        print(json.dumps(run(), indent=2))
