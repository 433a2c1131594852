"""An evaluation in a world from end to end: what it writes, that it is the same again, and that it goes on."""

import csv
import errno
import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from walled_field import make_config, make_field, make_onlooker

from toolkit.core.errors import ToolkitError
from toolkit.core.statistics import mcnemar_p
from toolkit.rooms.worlds.evaluation.frames import BOOSTER_ID, OBJECT_ID, SKY_ID
from toolkit.rooms.worlds.evaluation.world_run import WorldRun, evaluate_world
from toolkit.rooms.worlds.world import SceneClass

FILES = ("summary.json", "predictions.csv", "cameras.csv", "report.html")


def read_rows(file: Path) -> list[dict[str, str]]:
    with file.open() as lines:
        return list(csv.DictReader(lines))


def log_of(space) -> Path:
    return space.eval_dir / "worlds" / "answers.jsonl"


def read_all(done: WorldRun) -> dict[str, bytes]:
    return {name: (done.files.summary.parent / name).read_bytes() for name in FILES}


def test_every_picture_is_a_row_and_pairs_share_their_camera(finished: WorldRun) -> None:
    rows = read_rows(finished.files.predictions)
    cameras = sum(len(place.cameras) for place in finished.results.places)
    assert len(rows) == cameras * 2 * 4 == finished.computed
    by_variant = defaultdict(list)
    for row in rows:
        by_variant[row["variant"]].append([row[key] for key in ("place", "pose_id", "weather", "azimuth_deg")])
    assert by_variant["unpatched"] == by_variant["patched"]
    for row in rows:
        assert (row["correct_top1"], row["correct_top5"]) == (
            str(int(int(row["true_rank"]) == 1)),
            str(int(int(row["true_rank"]) <= 5)),
        )
        assert (row["visibility_m"] == "") == (row["weather"] == "clear")


def test_the_summary_counts_the_rows(finished: WorldRun) -> None:
    summary, rows = json.loads(finished.files.summary.read_text()), read_rows(finished.files.predictions)
    assert summary["kind"] == "world-eval"
    assert {group["place"] for group in summary["groups"]} == {"all", "west", "east"}
    assert len(summary["groups"]) == 2 * 4 * 3
    for group in summary["groups"]:
        own = [
            row for row in rows
            if (row["variant"], row["weather"], int(row["severity"]))
            == (group["variant"], group["weather"], group["severity"])
            and group["place"] in ("all", row["place"])
        ]  # fmt: skip
        assert group["n"] == len(own)
        assert group["top1"] == pytest.approx(np.mean([int(row["correct_top1"]) for row in own]))
        assert group["top5"] == pytest.approx(np.mean([int(row["correct_top5"]) for row in own]))
        assert group["mean_true_prob"] == pytest.approx(np.mean([float(row["true_prob"]) for row in own]), rel=1e-4)
        assert group["top1_ci95"][0] <= group["top1"] <= group["top1_ci95"][1]
    for pair in summary["pairs"]:
        key = (pair["weather"], pair["severity"])
        right = defaultdict(dict)
        for row in rows:
            if (row["weather"], int(row["severity"])) == key and pair["place"] in ("all", row["place"]):
                right[row["variant"]][row["place"], row["pose_id"]] = row["correct_top1"] == "1"
        gained = sum(right["patched"][one] and not right["unpatched"][one] for one in right["patched"])
        lost = sum(right["unpatched"][one] and not right["patched"][one] for one in right["patched"])
        assert (pair["n_pairs"], pair["gained"], pair["lost"]) == (len(right["patched"]), gained, lost)
        assert pair["mcnemar_p"] == pytest.approx(mcnemar_p(gained, lost))


def test_cameras_that_were_left_out_are_counted_in_all_files(finished: WorldRun) -> None:
    summary, rows = json.loads(finished.files.summary.read_text()), read_rows(finished.files.cameras)
    total = summary["cameras"][-1]
    assert total["place"] == "all"
    assert len(rows) == total["points"] == 2 * 18
    assert sum(row["left_out"] != "" for row in rows) == total["points"] - total["standing"] > 0
    assert total["left out: inside a building"] == sum(row["left_out"] == "inside a building" for row in rows)
    assert sum(float(row["visible_share"] or 1) < 0.01 for row in rows) == total["hidden"]
    report = finished.files.report.read_text()
    assert "inside a building" in report and "hidden" in report
    assert "http://" not in report.replace("http://www.w3.org", "") and "https://" not in report


def test_kept_frames_hold_exact_depth_and_classes(finished: WorldRun) -> None:
    folder = finished.files.frames
    records = [json.loads(line) for line in (folder / "manifest.jsonl").read_text().splitlines()]
    assert len(records) == 2 * len(finished.results.cameras)
    for record in records:
        assert sorted(file.name for file in (folder / record["path"]).iterdir()) == [
            "classes.png", "clear.png", "depth.png", "dust-5.png", "fog-1.png", "fog-3.png",
        ]  # fmt: skip
        depth = cv2.imread(str(folder / record["path"] / "depth.png"), cv2.IMREAD_UNCHANGED) / 100
        classes = cv2.imread(str(folder / record["path"] / "classes.png"), cv2.IMREAD_UNCHANGED)
        assert set(np.unique(classes)) <= {SceneClass.GROUND, SceneClass.BUILDING, OBJECT_ID, BOOSTER_ID, SKY_ID}
        assert (depth[classes == SKY_ID] == 0).all()
        pose, lens = np.array(record["T_world_camera"]), record["intrinsics"]
        y, x = np.nonzero(classes == SceneClass.GROUND)
        rays = np.column_stack(
            [(x + 0.5 - lens["cx"]) / lens["fx"], (y + 0.5 - lens["cy"]) / lens["fy"], np.ones(len(x))]
        )
        rays = rays @ pose[:3, :3].T / np.linalg.norm(rays, axis=1)[:, None]
        assert depth[y, x] == pytest.approx(-pose[2, 3] / rays[:, 2], abs=0.006)
    boosted = [record for record in records if record["variant"] == "patched" and record["visible_share"] == 1]
    seen = [
        (cv2.imread(str(folder / one["path"] / "classes.png"), cv2.IMREAD_UNCHANGED) == BOOSTER_ID).any()
        for one in boosted
        if one["elevation_deg"] > 20
    ]
    assert seen and all(seen)


def test_fog_hides_what_is_far_and_dust_is_tan(finished: WorldRun) -> None:
    """Beyond the visibility of 40 m less than 5 % of the light is left: what is there looks like the sky."""
    records = [json.loads(line) for line in (finished.files.frames / "manifest.jsonl").read_text().splitlines()]
    for record in records:
        fog, dust = (
            cv2.imread(str(finished.files.frames / record["path"] / f"{name}.png")).astype(float)
            for name in ("fog-3", "dust-5")
        )
        depth = cv2.imread(str(finished.files.frames / record["path"] / "depth.png"), cv2.IMREAD_UNCHANGED) / 100
        far = (depth == 0) | (depth > 40)
        if far.any():
            assert fog[far].std(axis=0).max() < 10
        blue, _, red = dust.mean(axis=(0, 1))
        assert red > blue + 20


@pytest.mark.slow
def test_same_seed_same_bytes_whatever_batch_and_threads(in_field, make_crate_space, tmp_path, finished) -> None:
    threads = torch.get_num_threads()
    found = []
    for name, batch, count in (("a", 8, 1), ("b", 24, 2), ("c", None, 2)):
        torch.set_num_threads(count)
        try:
            space = make_crate_space(tmp_path / name)
            done = evaluate_world(space, make_onlooker(), make_config(batch_size=batch))
        finally:
            torch.set_num_threads(threads)
        found.append((read_all(done), log_of(space).read_bytes()))
    assert found[0] == found[1] == found[2]
    whole = read_all(finished)
    assert all(found[0][0][name] == whole[name] for name in FILES[:-1])


def test_an_answer_is_computed_once(in_field, make_crate_space, tmp_path) -> None:
    space, network = make_crate_space(tmp_path), make_onlooker()
    first = evaluate_world(space, network, make_config())
    seen, before = network.module.seen, read_all(first)
    again = evaluate_world(space, network, make_config())
    assert (again.computed, again.kept, network.module.seen) == (0, first.computed, seen)
    assert read_all(again) == before
    more = evaluate_world(space, network, make_config(weathers=("fog:1", "fog:3", "dust:5", "rain:2"), run="more"))
    shown = 2 * 2 * 4  # the sample of pictures of another run's folder is made again
    assert more.computed == len(first.results.cameras) * 2 + shown
    other = evaluate_world(space, network, make_config(seed=1, run="other"))
    assert other.kept == 0


@pytest.mark.slow
def test_another_run_of_that_name_goes_beside(in_field, make_crate_space, tmp_path) -> None:
    """Neither result nor pictures of the first are touched; what is asked again is the first again."""
    space, network = make_crate_space(tmp_path), make_onlooker()
    first = evaluate_world(space, network, make_config(run="one"))
    frames = {file: file.read_bytes() for file in first.files.frames.rglob("*.*")}
    before = read_all(first)
    doubtful = replace(network, notes=("its images may be normalised otherwise",))
    other = evaluate_world(space, doubtful, make_config(run="one", seed=1))
    assert other.files.summary.parent.name == "one-2"
    assert (
        f"{first.files.summary.parent} holds another result" in json.loads(other.files.summary.read_text())["notes"][-1]
    )
    assert json.loads(other.files.summary.read_text())["notes"][0] == doubtful.notes[0]
    assert read_all(first) == before and {file: file.read_bytes() for file in first.files.frames.rglob("*.*")} == frames
    again = evaluate_world(space, network, make_config(run="one"))
    assert again.files.summary.parent.name == "one" and again.computed == 0 and read_all(again) == before


@pytest.mark.slow
def test_a_cut_log_goes_on_where_it_was(in_field, make_crate_space, tmp_path) -> None:
    space = make_crate_space(tmp_path)
    first = evaluate_world(space, make_onlooker(), make_config())
    before, log = read_all(first), log_of(space)
    lines = log.read_bytes().splitlines(keepends=True)
    log.write_bytes(b"".join(lines[:7]) + lines[7][:40])
    again = evaluate_world(space, make_onlooker(), make_config())
    assert again.kept == 7 * 4
    assert read_all(again) == before


SCRIPT = """
import sys
sys.path.insert(0, {helpers!r})
from pathlib import Path
import time
from walled_field import make_config, make_onlooker, make_field
from toolkit.core.workspace import Workspace
from toolkit.rooms.worlds.evaluation import world_report, world_run
from toolkit.rooms.worlds.sky import make_sky
world_run.open_world = lambda *given: make_field()
world_run.make_sky = lambda when, seed: make_sky(when, seed, 32)
network = make_onlooker()
for name in ("draw_sample", "draw_weathers", "draw_curves", "draw_cameras"):
    setattr(world_report, name, lambda *given: b"drawn")
network.module.register_forward_hook(lambda *given: time.sleep(0.3))
world_run.evaluate_world(Workspace(Path({root!r})), network, make_config(batch_size=8))
"""


@pytest.mark.slow
def test_it_survives_kill_9(in_field, make_crate_space, tmp_path) -> None:
    space = make_crate_space(tmp_path / "killed")
    helpers = str(Path(__file__).parents[3] / "helpers")
    run = subprocess.Popen([sys.executable, "-c", SCRIPT.format(helpers=helpers, root=str(space.root))])
    until = time.monotonic() + 60
    while not (log_of(space).is_file() and log_of(space).stat().st_size > 900) and time.monotonic() < until:
        time.sleep(0.05)
    run.kill()
    assert run.wait() == -9
    again = evaluate_world(space, make_onlooker(), make_config())
    assert 0 < again.kept < again.kept + again.computed
    whole = evaluate_world(make_crate_space(tmp_path / "whole"), make_onlooker(), make_config())
    assert read_all(again) == read_all(whole)
    assert sorted(log_of(space).read_text().splitlines()) != []


def test_a_full_disk_is_one_line(in_field, make_crate_space, tmp_path, monkeypatch) -> None:
    space = make_crate_space(tmp_path)

    def fail(number: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(ToolkitError, match="the disk is full"):
        evaluate_world(space, make_onlooker(), make_config())


def test_a_network_that_says_nothing_finite_is_refused(in_field, make_crate_space, tmp_path) -> None:
    network = make_onlooker()
    with torch.no_grad():
        network.module.layers[0].weight.fill_(float("nan"))
    with pytest.raises(ToolkitError, match="not a number"):
        evaluate_world(make_crate_space(tmp_path), network, make_config())


def test_one_variant_in_clear_air_at_one_place(in_field, make_crate_space, tmp_path) -> None:
    config = make_config(variants=("unpatched",), weathers=(), places=1, sample=3)
    done = evaluate_world(make_crate_space(tmp_path), make_onlooker(), config)
    summary = json.loads(done.files.summary.read_text())
    assert (summary["pairs"], summary["half_lost"]) == ([], [])
    assert done.computed == 3
    assert any("One place says nothing" in note for note in summary["notes"])
    assert any("A sample: 3 of the" in note for note in summary["notes"])


def test_an_object_larger_than_every_place_is_refused(in_field, make_crate_space, tmp_path) -> None:
    space = make_crate_space(tmp_path)
    with pytest.raises(ToolkitError, match=r"field has no place for an object that reaches .*'west', is free for 9.5"):
        evaluate_world(space, make_onlooker(), make_config(length_m=40.0))
    with pytest.raises(ToolkitError, match=r"has 2 places for an object .* 3 are asked for"):
        evaluate_world(space, make_onlooker(), make_config(length_m=10.0, places=3))


def test_rain_and_snow_run_too(in_field, make_crate_space, tmp_path) -> None:
    config = make_config(weathers=("rain:5", "snow:5"), places=1, sample=4, variants=("patched",))
    done = evaluate_world(make_crate_space(tmp_path), make_onlooker(), config)
    clear, snow = (
        cv2.imread(str(next(done.files.frames.rglob(f"{name}.png")))).astype(float) for name in ("clear", "snow-5")
    )
    classes = cv2.imread(str(next(done.files.frames.rglob("classes.png"))), cv2.IMREAD_UNCHANGED)
    ground = classes == SceneClass.GROUND
    assert snow[ground].mean() > clear[ground].mean() + 30


def test_where_the_object_is_left_out_the_place_alone_is_seen(in_field, make_crate_space, tmp_path) -> None:
    config = make_config(variants=("unpatched", "absent"), weathers=("fog:3",), keep=True)
    done = evaluate_world(make_crate_space(tmp_path), make_onlooker(), config)
    summary = json.loads(done.files.summary.read_text())
    records = [json.loads(line) for line in (done.files.frames / "manifest.jsonl").read_text().splitlines()]
    shares = {"unpatched": [], "absent": []}
    for record in records:
        classes = cv2.imread(str(done.files.frames / record["path"] / "classes.png"), cv2.IMREAD_UNCHANGED)
        shares[record["variant"]].append((classes == OBJECT_ID).mean())
    assert max(shares["absent"]) < 1e-3 < 0.01 < np.mean(shares["unpatched"])
    assert {row["variant"] for row in summary["groups"]} == {"unpatched", "absent"}
    page = done.files.report.read_text()
    assert "pictures of the places without it" in page and "with absent" not in page


def test_the_field_is_what_it_says() -> None:
    assert make_field().inside_building(np.array([(6.5, 0, 1), (3, 0, 1)])).tolist() == [True, False]
