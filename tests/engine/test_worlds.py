"""Evaluations in a world on the engines: the same bytes everywhere, a bad unit alone, and a killed run that goes on."""

import json
import signal
import time
from pathlib import Path

import pytest
import walled_field
from forked import Forked

from toolkit.core.errors import ToolkitError
from toolkit.engine import EngineConfig
from toolkit.rig import bake_cache
from toolkit.rooms.worlds.evaluation import world_run


@pytest.mark.slow
def test_a_pool_writes_the_same_bytes(look, looked):
    here, files = looked
    there, others = look("pool", EngineConfig(workers=2))
    assert there.computed == here.computed == sum(len(one.true_rank) for one in here.results.answers.values())
    assert (there.kept, there.failed) == (0, ()) and len(files) > 100
    assert files == others


@pytest.mark.slow
def test_light_is_worked_out_by_the_driver_alone(look, looked, monkeypatch):
    """What is sent to a worker holds the light, and nothing that rays are cast at."""
    import pickle

    sent = {}

    def resend(shared, tasks, real=world_run.answer_unit):
        copy = sent.setdefault("setup", pickle.loads(pickle.dumps(shared.get())))
        monkeypatch.setattr(bake_cache, "bake_surroundings", lambda *given: pytest.fail("lit again"))
        yield from real(type(shared)(copy), tasks)

    bake_cache._in_use.clear()
    monkeypatch.setattr(world_run, "answer_unit", resend)
    monkeypatch.setattr(bake_cache, "keep_arrays", lambda kind, inputs, make: make())  # nor is it read from disk
    assert look("resent")[1] == looked[1]
    world = sent["setup"].source.stage.world
    assert world is not None and "shape" not in world.__dict__


def poison(monkeypatch, is_bad):
    real = world_run.render_frames

    def render(stage, tasks):
        if is_bad(tasks[0]):
            raise RuntimeError("torn")
        return real(stage, tasks)

    monkeypatch.setattr(world_run, "render_frames", render)


def test_a_poisoned_unit_is_listed_and_its_cameras_are_left_out_everywhere(look, looked, monkeypatch):
    whole, _ = looked
    poison(monkeypatch, lambda task: (task.place, task.variant) == (1, "patched") and task.camera.number > 8)
    done, _ = look("torn")
    ((name, reason),) = done.failed
    assert name.startswith("east patched cameras ") and ": torn (traceback in " in reason and "test_worlds.py" in reason
    first, last = map(int, name.rpartition(" ")[2].split("-"))
    lost = [camera for camera in whole.results.places[1].cameras if first <= camera.number <= last]
    assert lost and done.computed == whole.computed - 4 * len(lost)
    left = len(whole.results.cameras) - len(lost)
    assert len(done.results.cameras) == left
    summary = json.loads(done.files.summary.read_text())
    assert {group["n"] for group in summary["groups"] if group["place"] == "all"} == {left}
    assert summary["cameras"][-1]["left out: its pictures failed"] == len(lost)
    assert any(f"{len(lost)} cameras" in note for note in summary["notes"])


@pytest.mark.slow
def test_a_whole_place_may_fail_and_the_next_run_mends_it(look, looked, monkeypatch):
    whole, files = looked
    with monkeypatch.context() as patch:
        poison(patch, lambda task: task.place == 1 and task.variant == "unpatched")
        done, _ = look("again")
    assert [place.placed.spot.name for place in done.results.places] == ["west"]
    assert "1 whole place" in " ".join(json.loads(done.files.summary.read_text())["notes"])
    mended, others = look("again")
    assert not mended.failed and mended.computed + done.computed == whole.computed
    names = ("run/predictions.csv", "run/summary.json", "run/cameras.csv", "run/report.html")
    assert all(files[name] == others[name] for name in names)
    assert sorted(files["worlds/answers.jsonl"].splitlines()) == sorted(others["worlds/answers.jsonl"].splitlines())


def test_nothing_is_left_where_every_unit_fails(look, monkeypatch):
    poison(monkeypatch, lambda task: True)
    with pytest.raises(ToolkitError, match="torn"):
        look("hopeless")


SCRIPT = """
import sys
from pathlib import Path
from forked import parent
from walled_field import make_config, make_field, make_onlooker
from toolkit.core import child
from toolkit.core.workspace import Workspace
from toolkit.engine import EngineConfig
from toolkit.rooms.worlds.evaluation import world_run
from toolkit.rooms.worlds.sky import make_sky

child._Context = parent
world_run.open_world = lambda *given: make_field()
world_run.make_sky = lambda when, seed: make_sky(when, seed, 32)
world_run.UNIT_PICTURES = 32
config = make_config(keep=True, run="run")
world_run.evaluate_world(Workspace(Path(sys.argv[1])), make_onlooker(), config, EngineConfig(workers=2))
"""


@pytest.mark.slow
def test_a_driver_that_is_killed_goes_on_and_does_nothing_twice(look, looked, make_crate_space):
    _, files = looked
    space = make_crate_space(look.folder / "killed")
    log = space.eval_dir / "worlds" / "answers.jsonl"
    run = Forked(SCRIPT, space.root)
    until = time.monotonic() + 300
    while run.process.is_alive() and time.monotonic() < until:
        if log.is_file() and log.read_bytes().count(b"\n") > 2:  # its first line may be all that is there yet
            break
        time.sleep(0.002)
    run.process.kill()
    assert run.wait().returncode == -signal.SIGKILL
    before = log.read_bytes().splitlines()
    again, others = look("killed", EngineConfig(workers=2))
    assert again.kept >= 4 * (len(before) - 1) > 0 and again.computed > 0
    assert find_changed(files, others) == []


@pytest.mark.slow
def test_a_kill_between_a_frame_and_its_answer_leaves_no_trace(look, looked):
    """The frame lies there with its line in the manifest; that nobody was asked about it yet is all that is missing."""
    _, files = looked
    look("between")
    log = look.folder / "between" / "eval" / "worlds" / "answers.jsonl"
    *before, last = log.read_bytes().splitlines(keepends=True)
    log.write_bytes(b"".join(before))
    again, others = look("between")
    assert again.computed == 4 and last in files["worlds/answers.jsonl"]
    assert find_changed(files, others) == []


def find_changed(files, others):
    return [name for name in files | others if "report" not in name and files.get(name) != others.get(name)]


@pytest.mark.slow
def test_the_command_takes_workers_and_says_what_failed(make_crate_space, tmp_path, monkeypatch):
    from typer.testing import CliRunner

    from toolkit.cli import app

    space = make_crate_space(tmp_path)
    walled_field.stand_in(monkeypatch, is_drawn=False)
    monkeypatch.setattr("toolkit.models.load.load_classifier", lambda *args, **kwargs: walled_field.make_onlooker())
    words = ["world-eval", "--object", "crate", "--variant", "unpatched", "--places", "2", "--grid", "3x3x2"]
    words += ["--length-m", "4", "--workspace", str(space.root)]
    with monkeypatch.context() as patch:
        poison(patch, lambda task: task.place == 1)
        done = CliRunner().invoke(app, words)
    assert done.exit_code == 1 and "skipped east unpatched cameras" in done.stderr.replace("\n", " "), done.output
    done = CliRunner().invoke(app, [*words, "--workers", "1"])
    assert done.exit_code == 0 and "kept" in done.stdout, done.output
    assert Path(space.eval_dir / "world-city-crate-onlooker" / "summary.json").is_file()
