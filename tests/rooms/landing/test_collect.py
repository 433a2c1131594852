"""Data sets for landings: truth, bytes, going on, and what is refused."""

import io
import json
import signal
import tarfile
import time
from pathlib import Path

import numpy as np
import pytest
from forked import Forked

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.rooms.landing.collect import Collected, Collector, collect, plan_shards
from toolkit.rooms.landing.config import CollectConfig
from toolkit.rooms.landing.dataset import Sample, encode_sample, open_dataset, read_shard, read_split, write_shard
from toolkit.rooms.landing.site import draw_pad
from toolkit.rooms.worlds.world import World

SETTINGS = {
    "frames": 30, "places": 5, "times": ("overcast",), "shard_frames": 10, "optics": {"image_px": 48},
    "weathers": ("clear", "fog:3"),
}  # fmt: skip
SMALL = CollectConfig(**SETTINGS)
DRIVER = f"""
import sys
from pathlib import Path
from toolkit.core.workspace import Workspace
from toolkit.rooms.landing.config import CollectConfig
from toolkit.rooms.landing.collect import collect
collect(Workspace(Path(sys.argv[1])), CollectConfig(**{SETTINGS}), seed=3)
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Workspace, Collected]:
    space = make_workspace(tmp_path_factory.mktemp("landing") / "work")
    return space, collect(space, SMALL, seed=3)


def copy_of(made: tuple[Workspace, Collected], tmp_path: Path) -> tuple[Workspace, Path]:
    import shutil

    space = make_workspace(tmp_path / "work")
    folder = space.captures_dir / "landing" / "grass"
    shutil.copytree(made[1].folder, folder)
    return space, folder


def test_truth_is_where_the_pad_is_seen(made: tuple[Workspace, Collected]) -> None:
    folder, camera = made[1].folder, SMALL.optics.camera
    samples = [
        sample for shard in made[1].about.shards for sample in read_shard(folder / shard.file, made[1].about.size_px)
    ]
    assert sorted(sample.truth.index for sample in samples) == list(range(30))
    whole = 0
    for sample in samples:
        truth = sample.truth
        assert 0.75 < truth.z_m < 10.4
        assert np.hypot(truth.x_m, truth.y_m) < truth.z_m * np.tan(np.radians(25 + 3))
        assert truth.seen_px == sample.mask.sum()
        edge = sample.mask[[0, -1]].any() or sample.mask[:, [0, -1]].any()
        if not edge and truth.seen_px > 20:
            whole += 1
            row, column = np.argwhere(sample.mask).mean(axis=0) + 0.5
            assert column == pytest.approx(camera.cx + camera.fx * truth.x_m / truth.z_m, abs=0.8)
            assert row == pytest.approx(camera.cy + camera.fy * truth.y_m / truth.z_m, abs=0.8)
    assert whole > 8
    assert {(sample.truth.weather, sample.truth.severity) for sample in samples} == {("clear", 0), ("fog", 3)}


def test_frames_are_split_by_place(made: tuple[Workspace, Collected]) -> None:
    folder = made[1].folder
    train, held_out = read_split(folder, "train"), read_split(folder, "held_out")
    assert len(train.truths) == 24
    assert len(held_out.truths) == 6
    assert train.images.shape == (24, 48, 48, 3)
    assert {one.place for one in train.truths}.isdisjoint({one.place for one in held_out.truths})
    assert {one.place for one in held_out.truths} == set(made[1].about.places["held_out"])


def test_a_random_split_is_an_option(grass: World) -> None:
    collector = Collector(CollectConfig(split="random", held_out=0.25, frames=400), grass, draw_pad("plain"), 0)
    share = np.mean([collector.split_of(index) == "held_out" for index in range(400)])
    assert 0.19 < share < 0.31


def test_frame_i_depends_on_seed_and_i_alone(made: tuple[Workspace, Collected], grass: World) -> None:
    fewer = Collector(SMALL.with_overrides(frames=10), grass, draw_pad("plain"), 3)
    known = {
        sample.truth.index: sample for sample in read_shard(made[1].folder / "train-000000.tar", made[1].about.size_px)
    }
    index = sorted(known)[3]
    again = fewer.shoot(index)
    assert again.truth == known[index].truth
    assert again.image.tobytes() == known[index].image.tobytes()


def test_it_goes_on_where_it_stopped_to_the_same_bytes(made: tuple[Workspace, Collected], tmp_path: Path) -> None:
    space, folder = copy_of(made, tmp_path)
    hashes = {path.name: sha256_file(path) for path in folder.glob("*.tar")}
    about = json.loads((folder / "dataset.json").read_text())
    (folder / "dataset.json").write_text(json.dumps(about | {"complete": False, "shards": []}))
    (folder / "train-000001.tar").unlink()
    (folder / ".train-000001.tar.abcd.partial").write_bytes(b"half")
    again = collect(space, SMALL, seed=3)
    assert again.made == 1
    assert {path.name: sha256_file(path) for path in folder.glob("*.tar")} == hashes
    assert not list(folder.glob(".*"))
    assert json.loads((folder / "dataset.json").read_text()) == about
    assert collect(space, SMALL, seed=3).made == 0


@pytest.mark.slow
def test_a_kill_costs_no_more_than_a_shard(made: tuple[Workspace, Collected], tmp_path: Path) -> None:
    space = make_workspace(tmp_path / "work")
    run = Forked(DRIVER, space.root)
    folder = space.captures_dir / "landing" / "grass"
    for _ in range(3000):
        if list(folder.glob("*.tar")):
            break
        time.sleep(0.02)
    run.process.kill()
    done = run.wait()
    assert done.returncode == -signal.SIGKILL, done.stderr.decode()
    left = len(list(folder.glob("*.tar")))
    assert collect(space, SMALL, seed=3).made == 4 - left < 4
    expected = {path.name: sha256_file(path) for path in made[1].folder.glob("*.tar")}
    assert {path.name: sha256_file(path) for path in folder.glob("*.tar")} == expected


def test_other_settings_do_not_mix(made: tuple[Workspace, Collected], tmp_path: Path) -> None:
    space, _ = copy_of(made, tmp_path)
    with pytest.raises(FieldError, match="holds a data set of other settings"):
        collect(space, SMALL, seed=4)
    with pytest.raises(FieldError, match="holds a data set of other settings"):
        collect(space, SMALL.with_overrides(frames=31), seed=3)


def rewrite(path: Path, change: dict[str, object]) -> None:
    """Another truth in the first sample of a shard."""
    with tarfile.open(path) as tar:
        members = [(entry, tar.extractfile(entry).read()) for entry in tar]  # type: ignore[union-attr]
    with tarfile.open(path, "w") as tar:
        for number, (entry, content) in enumerate(members):
            if number == 0:
                content = json.dumps(json.loads(content) | change).encode()
                entry.size = len(content)
            tar.addfile(entry, io.BytesIO(content))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (Path.unlink, "the shard is missing"),
        (lambda path: path.write_bytes(path.read_bytes()[:9000]), "cut or damaged"),
        (lambda path: rewrite(path, {"x_m": float("nan")}), "sample 00000000: the truth cannot be used: field 'x_m'"),
        (lambda path: rewrite(path, {"seed": 9}), "of seed 9, the data set is of seed 3"),
        (lambda path: rewrite(path, {"x_m": 0.5}), "differs from dataset.json"),
    ],
)
def test_damaged_sets_are_one_line(
    made: tuple[Workspace, Collected], tmp_path: Path, damage: object, words: str
) -> None:
    _, folder = copy_of(made, tmp_path)
    damage(folder / "train-000000.tar")  # type: ignore[operator]
    with pytest.raises(ToolkitError, match=words):
        read_split(folder, "train")


def test_an_unfinished_set_is_not_read(made: tuple[Workspace, Collected], tmp_path: Path) -> None:
    _, folder = copy_of(made, tmp_path)
    about = json.loads((folder / "dataset.json").read_text())
    (folder / "dataset.json").write_text(json.dumps(about | {"complete": False}))
    with pytest.raises(ToolkitError, match="is not complete"):
        open_dataset(folder)
    with pytest.raises(ToolkitError, match=r"holds no dataset\.json"):
        open_dataset(tmp_path)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"height_m": (-2.0, 4.0)}, "height_m -2 4: expected two rising numbers from 0.3 to 200"),
        ({"half_angle_deg": 40.0}, "half_angle_deg 40: expected less than half of optics.fov_deg, 70"),
        ({"times": ("night",)}, "no time of day called 'night'"),
        ({"weathers": ("hail",)}, "no weather called 'hail'"),
        ({"frames": 30}, "frames 30 places 40: expected a frame for each place"),
        ({"places": 1}, "places 1: a split by place needs at least 2"),
        ({"name": "../up"}, "name ../up: expected a name"),
    ],
)
def test_bad_settings_are_one_line(settings: dict[str, object], words: str) -> None:
    with pytest.raises(ToolkitError) as caught:
        CollectConfig(**settings)
    assert words in str(caught.value)


def test_a_cone_through_a_building_is_refused(grass: World) -> None:
    """A pad in the barn's lee: the barn is 18 m by 14 m around (-98, 73)."""
    config = CollectConfig(frames=2, at=(-98.0, 60.0), height_m=(3.0, 4.0), half_angle_deg=30)
    collector = Collector(config, grass, draw_pad("plain"), 0)

    class Walled:
        name, mesh, face_class = grass.name, grass.mesh, grass.face_class

        def inside_building(self, points: np.ndarray) -> np.ndarray:
            return np.ones(len(points), bool)

    collector.site(0)  # lit before the walls are there
    collector.world = Walled()  # type: ignore[assignment]
    with pytest.raises(ToolkitError, match="the cone goes through a building"):
        collector.aim(0)


def test_shards_hold_what_webdataset_streams(tmp_path: Path, made: tuple[Workspace, Collected], grass: World) -> None:
    samples = list(read_shard(made[1].folder / "train-000000.tar", made[1].about.size_px))
    write_shard(tmp_path / "a.tar", map(encode_sample, samples[:2]))
    with tarfile.open(tmp_path / "a.tar") as tar:
        names = tar.getnames()
    key = f"{samples[0].truth.index:08d}"
    assert names[:3] == [f"{key}.json", f"{key}.png", f"{key}.seg.png"]
    assert isinstance(samples[0], Sample)
    plan = plan_shards(SMALL, Collector(SMALL, grass, draw_pad("plain"), 3))
    assert [len(some) for _, _, some in plan] == [10, 10, 4, 6]
