"""What runs on the engines: the same bytes in a pool, a bad unit alone, and a killed driver that goes on."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from toolkit.benchmark import grid
from toolkit.captures import shoot as shooting
from toolkit.core.errors import ToolkitError
from toolkit.engine.local import InProcess, LocalPool


@pytest.mark.slow
def test_a_pool_shoots_and_answers_the_same_bytes(shoot, ask):
    (_, here), (one, said) = shoot("sim", InProcess()), ask("here", InProcess())
    with LocalPool(2) as pool:
        (result, there), (other, said_there) = shoot("pool", pool), ask("pool", pool)
    assert (result.shot, result.kept, result.failed) == (4, 0, ()) and here == there
    assert said == said_there and (one.computed, other.computed) == (54, 54)
    for cell, twin in zip(one.cells, other.cells, strict=True):
        assert cell.ranks.tolist() == twin.ranks.tolist()


def test_a_condition_that_fails_is_left_out_and_tried_again(ask, monkeypatch):
    real = grid.rank_images

    def poisoned(images, condition, recognisers, device):
        if condition[0] == "fog":
            raise ToolkitError("the fog is out")
        return real(images, condition, recognisers, device)

    monkeypatch.setattr(grid, "rank_images", poisoned)
    done, _ = ask("cells", InProcess())
    assert {(cell.corruption, cell.variant) for cell in done.cells} == {
        (corruption, variant) for corruption in ("clean", "jpeg_compression") for variant in ("unpatched", "paint-16")
    }
    assert done.failed == (("unpatched fog 3", "the fog is out"), ("paint-16 fog 3", "the fog is out"))
    assert (done.computed, done.kept) == (36, 0)
    monkeypatch.undo()
    done, _ = ask("cells", InProcess())
    assert (done.computed, done.kept, done.failed) == (18, 36, ()) and len(done.cells) == 6


def test_a_benchmark_that_cannot_work_ends_at_once(ask, monkeypatch):
    calls = []

    def broken(*given):
        calls.append(given)
        raise ToolkitError("its weights are damaged")

    monkeypatch.setattr(grid, "rank_images", broken)
    with pytest.raises(ToolkitError, match="its weights are damaged"):
        ask("cells", InProcess())
    assert len(calls) == 3


def test_a_scene_that_cannot_be_shot_is_listed_and_the_other_is_there(shoot, monkeypatch):
    real = shooting.dress

    def poisoned(item, booster):
        if booster is not None:
            raise RuntimeError("torn")
        return real(item, booster)

    monkeypatch.setattr(shooting, "dress", poisoned)
    result, files = shoot("sim", InProcess())
    assert result.shot == 2 and {Path(name).parent.name for name in files if name.endswith(".jpg")} == {"unpatched"}
    ((name, reason),) = result.failed
    assert name == "crate patched" and "RuntimeError in test_experiments.py" in reason and reason.endswith("torn")
    monkeypatch.undo()
    again, _ = shoot("sim", InProcess())
    assert (again.shot, again.kept, again.failed) == (2, 2, ())


DRIVER = """
import sys, time
from engine_work import wait_and_add
from toolkit.engine.local import LocalPool
from toolkit.engine.units import Unit

if __name__ == "__main__":
    with LocalPool(2) as pool:
        units = (Unit(f"{at:064d}", wait_and_add, (0.2, at), f"unit {at}", at) for at in range(100))
        for one in pool.run(units):
            print(one.result, flush=True)
"""


@pytest.mark.slow
def test_the_workers_of_a_killed_driver_end(tmp_path):
    script = tmp_path / "driver.py"
    script.write_text(DRIVER)
    driver = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True, start_new_session=True)
    assert driver.stdout.readline() == "0\n"
    os.kill(driver.pid, signal.SIGKILL)
    driver.wait()
    for _ in range(100):
        left = subprocess.run(["pgrep", "-g", str(driver.pid)], capture_output=True, text=True, check=False).stdout
        if not left:
            break
        time.sleep(0.2)
    assert not left, "workers without a driver"
