"""What runs on the engines: the same bytes in a pool, a bad unit alone, and a killed driver that goes on."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from toolkit.captures import shoot as shooting
from toolkit.core.errors import ToolkitError
from toolkit.engine.local import InProcess, LocalPool
from toolkit.rig import shading
from toolkit.rooms.benchmarks.corruptions import grid


@pytest.mark.slow
def test_a_pool_shoots_and_answers_the_same_bytes(shoot, ask, forked_workers):
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
    real = shooting.apply_booster

    def poisoned(item, booster):
        if booster is not None:
            raise RuntimeError("torn")
        return real(item, booster)

    monkeypatch.setattr(shooting, "apply_booster", poisoned)
    result, files = shoot("sim", InProcess())
    assert result.shot == 2 and {Path(name).parent.name for name in files if name.endswith(".jpg")} == {"unpatched"}
    ((name, reason),) = result.failed
    assert (
        name == "crate patched"
        and "RuntimeError in test_experiments.py" in reason
        and ": torn (traceback in " in reason
    )
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
        units = (Unit((at,), wait_and_add, (0.2, at), f"unit {at}") for at in range(100))
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
    for _ in range(600):
        states = ["ps", "-o", "stat=", "-s", str(driver.pid)]
        left = subprocess.run(states, capture_output=True, text=True, check=False).stdout.split()
        left = [state for state in left if state[0] != "Z"]  # the dead that nobody has counted yet
        if not left:
            break
        time.sleep(0.2)
    assert not left, "workers without a driver"


class Killed(BaseException):
    """Ends the driver as Ctrl-C does, wherever it is."""


@pytest.mark.slow
def test_a_driver_that_is_stopped_goes_on_with_any_engine_and_does_nothing_twice(shoot, forked_workers, monkeypatch):
    whole = shoot("whole", InProcess())[1]
    real, written = shooting.append_record, []

    def stop_at_the_second(source_dir, record):
        real(source_dir, record)
        written.append(record.path)
        if len(written) == 2:
            raise Killed

    monkeypatch.setattr(shooting, "append_record", stop_at_the_second)
    with pytest.raises(Killed), LocalPool(2) as pool:
        shoot("sim", pool)
    monkeypatch.setattr(shooting, "append_record", lambda *given: (written.append(given[1].path), real(*given)))
    result, files = shoot("sim", InProcess())
    assert (result.shot, result.kept) == (2, 2) and files == whole
    assert sorted(written) == sorted(set(written)) and len(written) == 4


@pytest.mark.slow
def test_the_command_takes_workers_and_lists_what_failed(make_crate_space, forked_workers, tmp_path, monkeypatch):
    from typer.testing import CliRunner

    from toolkit.cli import app

    space = make_crate_space(tmp_path / "crates")
    call = ["capture-sim", "--workspace", str(space.root), "--object", "crate", "--backdrop", "white"]
    done = CliRunner().invoke(app, [*call, "--workers", "2", "--source", "pool"])
    assert done.exit_code == 0 and "shot 4 images" in done.stdout
    real = shading.tone_map
    monkeypatch.setattr(shading, "tone_map", lambda picture, draws: 1 / 0 if draws[1] == 2 else real(picture, draws))
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 1 and "skipped crate unpatched: ZeroDivisionError" in done.stderr.replace("\n", " ")
    assert "shot 2 images" in done.stdout
    done = CliRunner().invoke(app, [*call, "--engine", "cloud"])
    assert "--engine cloud: expected local or ray" in str(done.exception)
    done = CliRunner().invoke(app, [*call, "--address", "10.0.0.1:6379"])
    assert "--address 10.0.0.1:6379: goes with --engine ray" in str(done.exception)
