"""The engines: two workers against one on cells of the corruption benchmark, and what Ray adds to units of a second."""

import importlib.util
import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torchvision.models import resnet18

from toolkit.benchmark.cells import ShardImages
from toolkit.benchmark.grid import rank_cell
from toolkit.benchmark.recognisers import Recogniser, recognise_by_network
from toolkit.engine.config import EngineConfig
from toolkit.engine.units import Engine, Shared, Unit
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.network import Classifier
from toolkit.models.weights import WeightsFile

IMAGES = 16
CELLS = [(name, 3) for name in ("fog", "gaussian_noise", "motion_blur", "jpeg_compression")] * 2
SECONDS = 10


def run() -> dict[str, float | str]:
    """Seconds of the same list; each worker has loaded its libraries and the network before the clock starts."""
    one, two = (_time_cells(workers) for workers in (1, 2))
    found: dict[str, float | str] = {"cells: 2 workers, ratio to one worker": one / two}
    if importlib.util.find_spec("ray"):
        for name, config in (("local", EngineConfig(workers=2)), ("ray", EngineConfig(engine="ray", workers=2))):
            found[f"units of 1 s, 2 workers, {name}: ratio to no engine"] = SECONDS / 2 / _time_waiting(config)
    return found


def _time_cells(workers: int) -> float:
    torch.manual_seed(0)
    how = Preprocessing(256, 224, (0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
    file = WeightsFile(Path("none.pth"), "0" * 64, "none.pth")
    labels = [str(k) for k in range(1000)]
    network = Classifier("resnet18", resnet18().eval(), labels, how, file, "cpu", False)
    pixels = torch.randint(0, 256, (IMAGES, 3, 224, 224), dtype=torch.uint8)
    images = ShardImages(pixels, np.zeros(IMAGES, np.int64), list(range(IMAGES)), [])
    with EngineConfig(workers=workers).open() as engine:
        shared, asked = engine.share(images), engine.share([recognise_by_network(network)])

        def list_units(cells: list[tuple[str, int]]) -> Iterator[Unit[None, list[np.ndarray]]]:
            for number, cell in enumerate(cells):
                yield Unit(str(number), rank_cell, (shared, cell, asked, "cpu"), cell[0], None)

        ready: set[object] = set()
        while len(ready) < workers:  # a first worker may do all while another still loads its libraries
            units = (Unit(str(k), warm, (shared, asked), "warm", None) for k in range(2 * workers))
            ready |= {outcome.result for outcome in engine.run(units)}
        start = time.perf_counter()
        _drain(engine, list_units(CELLS))
        return time.perf_counter() - start


def _time_waiting(config: EngineConfig) -> float:
    with config.open() as engine:
        _drain(engine, (Unit(str(k), wait, (0.1,), "wait", None) for k in range(4)))
        start = time.perf_counter()
        _drain(engine, (Unit(str(k), wait, (1.0,), "wait", None) for k in range(SECONDS)))
        return time.perf_counter() - start


def warm(images: Shared[ShardImages], recognisers: Shared[list[Recogniser]]) -> Iterator[int]:
    for _ in rank_cell(images, ("clean", 0), recognisers, "cpu"):
        yield os.getpid()


def wait(seconds: float) -> Iterator[float]:
    time.sleep(seconds)
    yield seconds


def _drain(engine: Engine, units: Iterator[Unit[None, object]]) -> None:
    for outcome in engine.run(units):
        assert not outcome.reason, outcome.reason


if __name__ == "__main__":
    print(run())
