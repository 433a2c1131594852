"""Closed loops: a classical finder lands, cells and pairs are counted right, runs go on, films show the flight."""

import json
import shutil
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from safetensors.torch import load_file, save_file
from scipy.stats import binomtest
from test_boost import make_regressor

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.work import Work
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.rooms.landing.config import EpisodeConfig, FlyConfig
from toolkit.rooms.landing.flight_report import film_episode, group_cells, pair_cells, write_report, write_summary
from toolkit.rooms.landing.fly import EpisodeRecord, FlightCell, Flown, fly_all, list_cells, load_predictors
from toolkit.rooms.landing.regressor import list_regressors
from toolkit.rooms.landing.site import draw_pad, find_world

QUICK = FlyConfig(
    regressors=("apriltag",), pads=("apriltag",), episodes=2, places=2, ground="bare", time="overcast",
    episode={"start_height_m": (2.2, 2.6), "start_angle_deg": (0, 8), "wind_m_s": (0, 1), "time_limit_s": 12.0},
    size_m=1.0,
)  # fmt: skip


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Workspace, Flown]:
    space = make_workspace(tmp_path_factory.mktemp("fly") / "work")
    return space, fly_all(space, QUICK, seed=2)


def test_an_apriltag_is_landed_on(flown: tuple[Workspace, Flown]) -> None:
    for one in flown[1].records:
        assert one.outcome == "success"
        assert one.error_m is not None
        assert one.error_m < 0.4
        assert 2 < one.time_s < 12
        assert len(one.track) > 20


def test_files_say_what_was_flown(flown: tuple[Workspace, Flown]) -> None:
    space, made = flown
    results, pairs = write_summary(made.folder, QUICK, made, 2)
    summary = json.loads((made.folder / "summary.json").read_text())
    assert summary["kind"] == "landing"
    (cell,) = summary["cells"]
    assert cell["success"] == 1.0
    assert (cell["n"], cell["missed"], cell["crashed"], cell["lost"], cell["timed_out"]) == (2, 0, 0, 0, 0)
    assert {"pad", "regressor", "world", "weather", "severity", "gains", "success_ci95", "median_error_m"} <= set(cell)
    assert "within 0.5 m of the centre" in summary["success_is"]
    page = write_report(QUICK, made, results, pairs, space).read_text()
    assert "http://" not in page
    assert "https://" not in page
    assert page.count("data:image/png;base64,") == 2
    assert "2 places of grass" in page
    assert "clear, 0" not in page
    assert len((made.folder / "episodes.csv").read_text().splitlines()) == 3


def test_two_pads_of_one_name_are_not_mixed(tmp_path: Path) -> None:
    space = make_workspace(tmp_path / "work")
    files = [tmp_path / folder / "plain.png" for folder in ("a", "b")]
    for shade, file in zip((90, 180), files, strict=True):
        file.parent.mkdir()
        cv2.imwrite(str(file), np.full((64, 64, 3), shade, np.uint8))
    for words in ((str(files[0]), str(files[1])), ("plain", str(files[0]))):
        with pytest.raises(ToolkitError, match=r"plain.* and .*plain\.png would both be called plain"):
            fly_all(space, QUICK.with_overrides(pads=words, regressors=("features",)), seed=2)


def test_two_regressors_of_one_name_are_not_mixed(tmp_path: Path) -> None:
    space = make_workspace(tmp_path / "work")
    make_regressor(space)
    (own,) = list_regressors(space).values()
    other = tmp_path / "other" / own.name
    shutil.copytree(own.parent, other.parent)
    save_file({name: tensor + 1 for name, tensor in load_file(own).items()}, other)
    record = other.with_suffix(".json")
    record.write_text(json.dumps(json.loads(record.read_text()) | {"sha256": sha256_file(other)}))
    with pytest.raises(ToolkitError, match=r"random and .*random\.safetensors would both be called random"):
        fly_all(space, QUICK.with_overrides(regressors=(own.stem, str(other)), size_m=None), seed=2)


def test_a_regressor_is_called_as_its_file_even_if_that_was_renamed(tmp_path: Path) -> None:
    space = make_workspace(tmp_path / "work")
    make_regressor(space)
    (own,) = list_regressors(space).values()
    for suffix in (".safetensors", ".json"):
        shutil.copy(own.with_suffix(suffix), own.with_name(f"best.v2{suffix}"))
    named = ("random", "best.v2", str(own.with_name("best.v2.safetensors")))
    config = QUICK.with_overrides(regressors=named, size_m=None)
    assert list(load_predictors(space, config, "cpu")[0]) == ["random", "best.v2"]
    cells = list_cells(config, {"plain": draw_pad("plain")}, find_world("grass"))
    assert {cell.regressor for cell in cells} == {"random", "best.v2"}


def test_flights_of_an_older_method_are_not_mixed_in(
    flown: tuple[Workspace, Flown], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    space = make_workspace(tmp_path / "work")
    shutil.copytree(flown[0].eval_dir, space.eval_dir, dirs_exist_ok=True)
    assert fly_all(space, QUICK, seed=2).made == 0
    monkeypatch.setattr("toolkit.rooms.landing.fly.FLIGHTS", Work("episode", 2))
    assert [fly_all(space, QUICK, seed=2).made for _ in range(2)] == [2, 0]


@pytest.mark.parametrize("changes", [{"outcome": "sucess"}, {"error_m": float("nan")}])
def test_an_episode_that_was_edited_to_nonsense_is_flown_again(
    flown: tuple[Workspace, Flown], tmp_path: Path, changes: dict[str, object]
) -> None:
    """An outcome without a name would be in no column of the table."""
    space = make_workspace(tmp_path / "work")
    shutil.copytree(flown[0].eval_dir, space.eval_dir, dirs_exist_ok=True)
    log = space.eval_dir / "landing/apriltag/episodes.jsonl"
    first, *others = log.read_text().splitlines()
    log.write_text("\n".join([json.dumps(json.loads(first) | changes), *others]) + "\n")
    again = fly_all(space, QUICK, seed=2)
    assert again.made == 1
    assert again.records == flown[1].records


@pytest.mark.slow
def test_more_pixels_find_a_tag_from_higher_up(tmp_path: Path) -> None:
    space = make_workspace(tmp_path / "work")
    high = QUICK.with_overrides({"episodes": 1, "episode.start_height_m": (6.0, 6.4), "episode.time_limit_s": 1.0})
    blind, sharp = (fly_all(space, high.with_overrides(image_px=px), seed=2).records[0].seen for px in (None, 320))
    assert not any(blind)
    assert all(sharp)


def test_regressors_see_as_they_were_trained(tmp_path: Path) -> None:
    space = make_workspace(tmp_path / "work")
    make_regressor(space)
    with pytest.raises(FieldError, match="image_px 500: expected 64, as random was trained"):
        fly_all(space, QUICK.with_overrides(regressors=("random",), image_px=500), seed=2)


@pytest.mark.slow
def test_a_film_shows_the_episode(flown: tuple[Workspace, Flown], tmp_path: Path) -> None:
    space, made = flown
    record = made.records[0]
    filmed = film_episode(space, QUICK, made, record, 2)
    loop = Image.open(BytesIO(filmed.encode_webp()))
    assert (loop.format, loop.size) == ("WEBP", (640, 346))
    assert (
        len(record.track) // 2 <= loop.n_frames <= len(filmed.frames) // 2 + 1
    )  # the last, which stays, is stored once
    # by the camera that flew: a coarser one saw less
    coarse = film_episode(space, QUICK.with_overrides(image_px=48), made, record, 2)
    assert (coarse.frames != filmed.frames).any()
    results, pairs = write_summary(tmp_path, QUICK, made, 2)
    page = write_report(QUICK, replace(made, folder=tmp_path), results, pairs, space, [filmed]).read_text()
    assert page.count("data:image/webp;base64,") == 1
    film = cv2.VideoCapture(str(filmed.write(tmp_path / "one.mp4")))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == len(record.track) + 10
    assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(10)
    shown, first = film.read()
    assert shown
    assert first.shape == (520, 960, 3)
    assert first.std() > 20


def test_flights_go_on_and_do_not_depend_on_the_batch(tmp_path: Path) -> None:
    space = make_workspace(tmp_path / "work")
    make_regressor(space)
    short = {"time_limit_s": 1.0, "start_height_m": (3.0, 4.0)}
    config = FlyConfig(
        regressors=("random",), pads=("plain", "grey"), episodes=5, places=2, ground="bare", time="overcast",
        weathers=("fog:3",), episode=short,
    )  # fmt: skip
    whole = fly_all(space, config, seed=1)
    assert whole.made == 10
    log = whole.folder / "episodes.jsonl"
    lines = log.read_text().splitlines()
    log.write_text("\n".join(lines[:3]) + "\n" + lines[3][:40])
    again = fly_all(space, config.with_overrides(batch=2), seed=1)
    assert again.made == 7
    assert again.records == whole.records
    assert fly_all(space, config, seed=1).made == 0
    assert fly_all(space, config, seed=2).made == 10
    plain, grey = whole.records[:5], whole.records[5:]
    assert [one.track[0] for one in plain] == [one.track[0] for one in grey]


@pytest.mark.parametrize(
    ("sets", "place"),
    [
        ([], "meadow-2-1"),
        ([{"world": "grass", "world_seed": 0}], "meadow-2-1"),
        ([{"world": "grass", "world_seed": 1}], "meadow-1-1"),
        ([{"world": "city", "world_seed": 0}], "meadow-1-1"),
        ([{"world": "city", "world_seed": 0}, {"world": "grass", "world_seed": 0}], "meadow-2-1"),
    ],
)
def test_spots_that_were_trained_on_are_left_out(tmp_path: Path, sets: list[dict[str, object]], place: str) -> None:
    """The regressor's record says meadow-1 of grass, or of each of several sets."""
    space = make_workspace(tmp_path / "work")
    data = make_regressor(space).record.data
    file = space.root / "rig" / "regressors" / "random.json"
    if sets:
        told = {"n": 0, "world": "both", "sets": [data | one for one in sets]}
        file.write_text(json.dumps(json.loads(file.read_text()) | {"data": told}))
    config = QUICK.with_overrides(
        regressors=("random",), pads=("plain",), episodes=1, places=1, episode=EpisodeConfig(time_limit_s=0.2)
    )
    assert fly_all(space, config, seed=1).places[0].name == place


def record(pad: str, index: int, outcome: str) -> EpisodeRecord:
    return EpisodeRecord(
        inputs="", pad=pad, regressor="net", world="grass", weather="clear", severity=0, gains="gentle", index=index,
        place="a", outcome=outcome, error_m=0.1 if outcome == "success" else None, time_s=5.0, path_m=8.0,
        speed_m_s=None, tilt_deg=None,
    )  # fmt: skip


def test_pairs_are_counted_episode_by_episode(tmp_path: Path) -> None:
    plain = ["success", "lost", "missed", "success", "lost", "lost", "lost", "lost"]
    boosted = ["success", "success", "success", "crashed", "success", "success", "success", "lost"]
    records = [record("plain", k, one) for k, one in enumerate(plain)]
    records += [record("boosted", k, one) for k, one in enumerate(boosted)]
    cells = tuple(FlightCell(pad, "net", "grass", "clear", 0, "gentle") for pad in ("plain", "boosted"))
    results = group_cells(Flown(tmp_path, tuple(records), cells, 0, (), {}))
    assert [one.count("success") for one in results] == [2, 6]
    (pair,) = pair_cells(results)
    assert (pair.cell.pad, pair.against.pad) == ("boosted", "plain")
    assert (pair.cell.words, pair.other) == ("boosted, net, clear, gentle", "pad plain")
    assert (pair.outcomes.only_second, pair.outcomes.only_first) == (5, 1)
    assert pair.outcomes.mcnemar_p == pytest.approx(binomtest(5, 6, 0.5).pvalue)
    assert results[0].success_ci95[0] < 0.25 < results[0].success_ci95[1]


def test_a_regressor_trained_again_is_compared_on_its_own_pad(tmp_path: Path) -> None:
    cells = tuple(
        FlightCell(pad, net, "grass", "clear", 0, "gentle") for net in ("net", "again") for pad in ("plain", "boosted")
    )
    records = tuple(record(cell.pad, 0, "success").model_copy(update={"regressor": cell.regressor}) for cell in cells)
    pairs = pair_cells(group_cells(Flown(tmp_path, records, cells, 0, (), {})))
    found = [(one.cell.pad, one.cell.regressor, one.against.pad, one.against.regressor) for one in pairs]
    assert found == [
        ("boosted", "net", "plain", "net"), ("boosted", "again", "plain", "again"),
        ("plain", "again", "plain", "net"), ("boosted", "again", "boosted", "net"),
        ("boosted", "again", "plain", "net"),
    ]  # fmt: skip


def test_bad_flights_are_one_line(tmp_path: Path) -> None:
    space = make_workspace(tmp_path / "work")
    with pytest.raises(ToolkitError, match="no regressor called 'none': there is none yet"):
        fly_all(space, FlyConfig(regressors=("none",)))
    with pytest.raises(ToolkitError, match="gains 'hard': expected paper, gentle"):
        FlyConfig(regressors=("features",), gains=("hard",))
    with pytest.raises(FieldError, match="latency_s 90: expected less than"):
        FlyConfig(regressors=("features",), episode={"latency_s": 90})
    with pytest.raises(ToolkitError, match="no world called 'moon'"):
        fly_all(space, FlyConfig(regressors=("features",), world="moon"))
