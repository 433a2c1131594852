"""Evaluation, JPEG files to predictions, against a bare batched forward of the same network on tensors in memory.

Both sides run in this process, on the same device, batch and threads, in turns, so that a busy machine slows both. The
network has random weights: its speed does not depend on them.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.peers import peak_mb

BATCH = 32
ROUNDS = 3
MEMORY_COUNTS = (96, 192, 384)


def write_photographs(folder: Path, count: int, width: int = 640, height: int = 480) -> None:
    """JPEG files with the detail, and so the size on disk (about 60 kB), of photographs."""
    import numpy as np
    from PIL import Image

    folder.mkdir(parents=True, exist_ok=True)
    draw = np.random.default_rng(0)
    for index in range(count):
        coarse = Image.fromarray(draw.integers(0, 256, (24, 32, 3), dtype=np.uint8))
        smooth = np.asarray(coarse.resize((width, height), Image.Resampling.BICUBIC), np.float32)
        noisy = np.clip(smooth + draw.normal(0, 6, smooth.shape), 0, 255).astype(np.uint8)
        Image.fromarray(noisy).save(folder / f"{index + 1}.jpg", quality=90)


def make_classifier(folder: Path):
    """A ResNet-18 with random weights, read from a file like any other."""
    from toolkit.models.load import load_classifier

    file = folder / "resnet18-random.pth"
    if not file.is_file():
        import torch

        from toolkit.models.vision import torchvision

        torch.manual_seed(0)
        torch.save(torchvision.models.resnet18().state_dict(), file)
    return load_classifier("resnet18", file)


def measure_speed(folder: Path, count: int) -> tuple[float, float]:
    """(images/s of the evaluation, images/s of the bare forward), medians over rounds taken in turns."""
    import torch

    from toolkit.captures.read import read_captures
    from toolkit.evaluation.predict import predict_captures
    from toolkit.models.vision import torchvision

    classifier = make_classifier(folder)
    bare = torchvision.models.resnet18()
    bare.load_state_dict(torch.load(folder / "resnet18-random.pth", weights_only=True))
    bare.eval().to(classifier.device)
    captures = read_captures(folder / "captures").captures[:count]
    batch = torch.rand(BATCH, 3, 224, 224, device=classifier.device)

    def run_bare() -> None:
        with torch.inference_mode():
            for _ in range(count // BATCH):
                bare(batch).argmax(1).cpu()

    def run_ours() -> None:
        predict_captures(captures, {"racer": 751}, classifier, BATCH)

    seconds: dict[str, list[float]] = {"bare": [], "ours": []}
    for turn in range(ROUNDS + 1):
        for name, work in (("bare", run_bare), ("ours", run_ours)):
            start = time.perf_counter()
            work()
            if turn:  # the first turn warms caches and kernels
                seconds[name].append(time.perf_counter() - start)
    ours, plain = (count / sorted(seconds[name])[ROUNDS // 2] for name in ("ours", "bare"))
    return ours, plain


def measure_memory(folder: Path, count: int) -> float:
    """Peak resident memory in MB of a fresh process that classifies `count` images as the command does."""
    command = [sys.executable, "-m", "benchmarks.bench_eval", "--memory", str(folder), str(count)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def _report_peak(folder: Path, count: int) -> None:
    from toolkit.captures.read import read_captures
    from toolkit.evaluation.predict import predict_captures

    captures = read_captures(folder / "captures").captures[:count]
    predict_captures(captures, {"racer": 751}, make_classifier(folder))
    print(json.dumps(peak_mb()))


def run() -> dict[str, float]:
    """Ratios: speed against a bare forward (target: 0.9 or more), and peak memory as the number of images doubles."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_photographs(folder / "captures" / "real" / "racer" / "unpatched", MEMORY_COUNTS[-1])
        ours, plain = measure_speed(folder, 4 * BATCH)
        peaks = [measure_memory(folder, count) for count in MEMORY_COUNTS]
    return {
        "eval images/s": ours,
        "bare forward images/s": plain,
        "eval / bare forward": ours / plain,
        **{f"peak MB at {count} images": peak for count, peak in zip(MEMORY_COUNTS, peaks, strict=True)},
        f"peak memory, {MEMORY_COUNTS[-1]} / {MEMORY_COUNTS[0]} images": peaks[-1] / peaks[0],
    }


if __name__ == "__main__":
    if sys.argv[1:2] == ["--memory"]:
        _report_peak(Path(sys.argv[2]), int(sys.argv[3]))
    else:
        print(json.dumps(run(), indent=2))
