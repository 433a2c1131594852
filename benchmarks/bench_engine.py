"""The engines: two workers against one on corruption cells and on world frames; what Ray adds to units of a second."""

import importlib.util
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

from benchmarks.bench_world_eval import WEATHERS, make_classifier
from toolkit.core.workspace import Workspace
from toolkit.engine import EngineConfig
from toolkit.engine.units import Engine, Unit
from toolkit.rig.bake_cache import light_surroundings
from toolkit.rooms.benchmarks.corruptions.cells import ShardImages
from toolkit.rooms.benchmarks.corruptions.grid import rank_cells
from toolkit.rooms.benchmarks.corruptions.recognisers import recognise_by_network
from toolkit.rooms.worlds.evaluation import WorldEvalConfig
from toolkit.rooms.worlds.evaluation.world_run import Rendered, Setup, answer_unit, plan_run

IMAGES = 16
CELLS = [(name, 3) for name in ("fog", "gaussian_noise", "motion_blur", "jpeg_compression")] * 2
FRAMES, UNITS = 8, 8
"""Frames of a unit, each in eleven weathers, and units."""
SECONDS = 10


def run() -> dict[str, float | str]:
    """Seconds of the same list; each worker has loaded its libraries and done a unit before the clock starts."""
    found: dict[str, float | str] = {}
    for name, work, prepare, count in (
        ("cells", rank_cells, _share_cells, 1),
        ("world frames", answer_unit, _share_frames, FRAMES),
    ):
        one, two = (_time_units(workers, work, prepare, count) for workers in (1, 2))
        found[f"{name}: 2 workers, ratio to one worker"] = one / two
    if importlib.util.find_spec("ray"):
        for name, config in (("local", EngineConfig(workers=2)), ("ray", EngineConfig(engine="ray", workers=2))):
            found[f"units of 1 s, 2 workers, {name}: ratio to no engine"] = SECONDS / 2 / _time_waiting(config)
    return found


Inputs = tuple[object, ...]
Work = Callable[..., Iterator[object]]


def _time_units(workers: int, work: Work, prepare: Callable[[Engine], list[Inputs]], count: int) -> float:
    with EngineConfig(workers=workers).open() as engine:
        each = prepare(engine)
        ready: set[object] = set()
        while len(ready) < workers:  # a first worker may do all while another still loads its libraries
            units = (Unit((k,), warm, (work, each[0]), "warm") for k in range(2 * workers))
            ready |= {outcome.result for outcome in engine.run(units)}
        start = time.perf_counter()
        _drain(engine, (Unit(tuple(range(count)), work, inputs, "unit") for inputs in each))
        return time.perf_counter() - start


def _share_cells(engine: Engine) -> list[Inputs]:
    """A corruption of sixteen photographs and what a network says of them."""
    torch.manual_seed(0)
    pixels = torch.randint(0, 256, (IMAGES, 3, 224, 224), dtype=torch.uint8)
    images = engine.share(
        ShardImages(pixels, np.zeros(IMAGES, np.int64), list(range(IMAGES)), [""] * IMAGES, [], np.ones(IMAGES, bool))
    )
    asked = engine.share([recognise_by_network(make_classifier())])
    return [(images, cell, asked, "cpu") for cell in CELLS]


def _share_frames(engine: Engine) -> list[Inputs]:
    """Some frames of a jet on grass in clear air and ten weathers, and what a network says of them."""
    config = WorldEvalConfig(world="grass", places=1, sample=FRAMES * UNITS, weathers=WEATHERS, variants=("unpatched",))
    with TemporaryDirectory() as folder:
        asked = plan_run(Workspace(Path(folder)), make_classifier(), config)
    light = light_surroundings(asked.stage.places[0].scene)
    setup = engine.share(Setup(Rendered(asked.stage, light), asked.classifier, asked.true_index, None))
    tasks = asked.tasks()
    return [(setup, tuple(tasks[start : start + FRAMES])) for start in range(0, len(tasks), FRAMES)]


def _time_waiting(config: EngineConfig) -> float:
    with config.open() as engine:
        _drain(engine, (Unit((k,), wait, (0.1,), "wait") for k in range(4)))
        start = time.perf_counter()
        _drain(engine, (Unit((k,), wait, (1.0,), "wait") for k in range(SECONDS)))
        return time.perf_counter() - start


def warm(work: Work, inputs: Inputs) -> Iterator[int]:
    for _ in work(*inputs):
        pass
    yield os.getpid()


def wait(seconds: float) -> Iterator[float]:
    time.sleep(seconds)
    yield seconds


def _drain(engine: Engine, units: Iterator[Unit[object]]) -> None:
    for outcome in engine.run(units):
        assert not outcome.reason, outcome.reason


if __name__ == "__main__":
    print(run())
