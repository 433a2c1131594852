"""Landing's frames and episodes on the engines: the same bytes everywhere, and a bad unit alone."""

from dataclasses import replace

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.workspace import make_workspace
from toolkit.engine import EngineConfig
from toolkit.rooms.landing import collect as collecting
from toolkit.rooms.landing import fly as flying
from toolkit.rooms.landing.collect import Collector, collect
from toolkit.rooms.landing.config import CameraConfig, CollectConfig, FlyConfig
from toolkit.rooms.landing.flight_report import place_results, write_summary
from toolkit.rooms.landing.fly import fly_all

FRAMES = CollectConfig(
    frames=12, places=2, times=("overcast",), shard_frames=4, optics=CameraConfig(image_px=48),
    weathers=("clear", "fog:3"),
)  # fmt: skip
FLIGHTS = FlyConfig(
    regressors=("apriltag",), pads=("apriltag",), episodes=4, batch=2, places=2, ground="bare", time="overcast",
    episode={"start_height_m": (2.2, 2.6), "time_limit_s": 0.5}, weathers=("clear", "fog:3"), size_m=1.0,
)  # fmt: skip
pytestmark = pytest.mark.usefixtures("forked_workers")


def hash_files(folder):
    return {file.name: sha256_file(file) for file in folder.iterdir()}


@pytest.fixture(autouse=True)
def small_units(monkeypatch):
    monkeypatch.setattr(collecting, "UNIT_FRAMES", 2)


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    return collect(make_workspace(tmp_path_factory.mktemp("frames") / "here"), FRAMES, seed=3)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return fly_all(make_workspace(tmp_path_factory.mktemp("flights") / "here"), FLIGHTS, seed=1)


@pytest.mark.slow
def test_a_pool_shoots_and_flies_the_same_bytes(collected, flown, tmp_path):
    space, engine = make_workspace(tmp_path / "pool"), EngineConfig(workers=2)
    there = collect(space, FRAMES, seed=3, engine=engine)
    assert there.made == collected.made == len(there.about.shards) == 4
    assert hash_files(there.folder) == hash_files(collected.folder)
    again = fly_all(space, FLIGHTS, seed=1, engine=engine)
    assert again.records == flown.records and len(again.records) == 8
    assert hash_files(again.folder) == hash_files(flown.folder)
    assert again.seconds["whole_s"] > again.seconds["rendering_s"] > 0


def test_a_frame_that_fails_costs_its_shard_alone_and_the_next_run_mends_it(collected, tmp_path, monkeypatch):
    space, real = make_workspace(tmp_path / "torn"), Collector.shoot
    with monkeypatch.context() as patch:
        patch.setattr(Collector, "shoot", lambda self, index: 1 / 0 if index == 5 else real(self, index))
        torn = collect(space, FRAMES, seed=3)
    ((name, reason),) = torn.failed
    assert ".tar frames " in name and reason.startswith("ZeroDivisionError")
    assert torn.made == 3 and not torn.about.complete and len(list(torn.folder.glob("*.tar"))) == 3
    mended = collect(space, FRAMES, seed=3)
    assert (mended.made, mended.failed) == (1, ()) and hash_files(mended.folder) == hash_files(collected.folder)


def test_frames_that_all_fail_are_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(Collector, "shoot", lambda self, index: 1 / 0)
    with pytest.raises(ToolkitError, match="ZeroDivisionError"):
        collect(make_workspace(tmp_path / "torn"), FRAMES, seed=3)


def test_a_cell_that_fails_is_left_out_and_the_next_run_mends_it(flown, tmp_path, monkeypatch):
    def poisoned(setup, cell, indices, clock, real=flying.fly_cell):
        if cell.weather == "fog":
            raise RuntimeError("lost in it")
        return real(setup, cell, indices, clock)

    space = make_workspace(tmp_path / "torn")
    with monkeypatch.context() as patch:
        patch.setattr(flying, "fly_cell", poisoned)
        torn = fly_all(space, FLIGHTS, seed=1)
    assert [name for name, _ in torn.failed] == [f"{flown.cells[1].key} episodes {some}" for some in ("0-1", "2-3")]
    assert torn.cells == flown.cells[:1] and torn.records == flown.records[:4] and torn.made == 4
    results, pairs = write_summary(torn.folder, FLIGHTS, torn, 1)
    assert len(results) == 1 and pairs == []
    mended = fly_all(space, FLIGHTS, seed=1)
    assert (mended.made, mended.failed, mended.records) == (4, (), flown.records)


def test_results_of_other_flights_go_beside(flown, tmp_path):
    """The episodes' log serves all flights of a name; what was found of some of them is not written over."""
    named = replace(flown, folder=tmp_path / "pad")
    first = place_results(FLIGHTS, named, 1)
    write_summary(first.folder, FLIGHTS, first, 1)
    before = (first.folder / "summary.json").read_bytes()
    other = place_results(FLIGHTS, named, 2)
    assert (first.folder.name, other.folder.name) == ("pad", "pad-2")
    write_summary(other.folder, FLIGHTS, other, 2)
    assert place_results(FLIGHTS, named, 1).folder == first.folder
    assert (first.folder / "summary.json").read_bytes() == before
