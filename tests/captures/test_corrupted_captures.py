"""`toolkit capture-sim --corrupt`: corrupted copies are captures, resume, and say what `eval --corrupt` says."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image

from toolkit.captures.corrupted_copy import corrupt_source, cut_intrinsics
from toolkit.captures.manifest import MANIFEST, append_record, read_manifest
from toolkit.captures.read import read_captures
from toolkit.captures.shoot import ShootSettings, shoot_plan
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.workspace import Workspace
from toolkit.corruptions.folder import read_picture
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.network import Classifier
from toolkit.models.weights import WeightsFile
from toolkit.rig.plan import read_plan

FOG = ("fog", 3)


@pytest.fixture(scope="module")
def shot(tmp_path_factory, make_crate_space):
    """A workspace with four images; not to be changed."""
    space = make_crate_space(tmp_path_factory.mktemp("shot"))
    shoot_plan(space, read_plan(space.plan_file), ["crate"], settings=ShootSettings(backdrop="white"))
    return space


@pytest.fixture
def space(shot, tmp_path, monkeypatch):
    """A copy of it, and in it."""
    shutil.copytree(shot.root, tmp_path / "space")
    monkeypatch.setattr("toolkit.core.workspace.PACKAGE_DATA", tmp_path / "none")
    monkeypatch.chdir(tmp_path / "space")
    return Workspace(tmp_path / "space")


@pytest.fixture
def type_command(type_toolkit):
    def run(*arguments, code=0):
        found, *said = type_toolkit("capture-sim", *arguments)
        assert found == code, said
        return SimpleNamespace(out=said[0], err=said[1])

    return run


@pytest.fixture
def classifier():
    torch.manual_seed(0)
    module = torch.nn.Sequential(torch.nn.Conv2d(3, 4, 9, 8), torch.nn.Flatten(), torch.nn.Linear(4 * 27 * 27, 2))
    how = Preprocessing(256, 224, (0.5,) * 3, (0.25,) * 3)
    weights = WeightsFile(Path("tiny.pth"), "ab" * 32, "tiny.pth")
    return Classifier("tiny", module.eval(), ["crate", "dog"], how, weights, "cpu", False)


@pytest.mark.slow
def test_copies_are_captures_and_say_what_eval_says(space, type_command, classifier):
    said = type_command("--corrupt", "fog:3", "--corrupt", "defocus_blur:5", "--backdrop", "white", "--quiet").out
    assert "shot 0 images, 4 kept" in said and "corrupted 4 of them" in said
    copies = [space.captures_dir / f"sim-{name}" for name in ("fog-3", "defocus_blur-5")]
    shots = read_manifest(space.captures_dir / "sim")
    for folder in copies:
        records = read_manifest(folder)
        assert sorted(records) == [path.replace(".jpg", ".png") for path in sorted(shots)]
        for path, record in records.items():
            shot = shots[path.replace(".png", ".jpg")]
            assert record.image_sha256 == sha256_file(folder / path)
            same = ("object", "variant", "pose_id", "T_world_camera", "booster_sha256")
            assert all(getattr(record, name) == getattr(shot, name) for name in same)
            assert record.made["of"] == f"sim/{shot.path}" and record.inputs_sha256 is None
            assert Image.open(folder / path).size == (224, 224)
        for variant in ("patched", "unpatched"):
            assert len(json.loads((folder / "crate" / variant / "transforms.json").read_text())["frames"]) == 2
    both = [FOG, ("defocus_blur", 5)]
    files = evaluate_captures(space.captures_dir, space, classifier, EvalConfig(run="files"))
    assert files.notes == () and len(files.pairs) == 6
    only = EvalConfig(run="laid-on", sources=("sim",), corruptions=both)
    laid_on = evaluate_captures(space.captures_dir, space, classifier, only)
    found, expected = (
        [(one.capture.source, one.capture.pose_id, one.true_prob) for one in result.predictions]
        for result in (files, laid_on)
    )
    assert found == expected
    again = evaluate_captures(space.captures_dir, space, classifier, EvalConfig(run="again", corruptions=[FOG]))
    assert len(again.predictions) == 16 and "they are corrupted: sim-defocus_blur-5, sim-fog-3" in again.notes[0]


def test_a_second_run_keeps_and_a_stopped_one_goes_on(space, type_command):
    type_command("--corrupt", "fog:3", "--backdrop", "white", "--quiet")
    folder = space.captures_dir / "sim-fog-3"
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    said = type_command("--corrupt", "fog:3", "--backdrop", "white", "--json").out
    assert json.loads(said)["corrupted"] == [{"folder": str(folder), "made": 0, "kept": 4}]
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before
    lines = before[folder / MANIFEST].splitlines(keepends=True)
    (folder / MANIFEST).write_bytes(b"".join(lines[:2]))  # stopped between pictures and records
    (folder / "crate/patched/pose_01.png").unlink()
    said = type_command("--corrupt", "fog:3", "--backdrop", "white", "--quiet").out
    assert "corrupted 1 of them, 3 kept from before" in said
    assert {file: file.read_bytes() for file in before if file.suffix == ".png"} == {
        file: content for file, content in before.items() if file.suffix == ".png"
    }
    assert read_manifest(folder).keys() == {json.loads(line)["path"] for line in lines}


def test_a_shot_taken_anew_is_corrupted_anew(space):
    folder, out = space.captures_dir / "sim", space.captures_dir / "sim-contrast-2"
    corrupt_source(folder, [("contrast", 2)])
    old, path = read_manifest(out), "crate/patched/pose_01"
    Image.new("RGB", (96, 72), "red").save(folder / f"{path}.jpg")
    shot = read_manifest(folder)[f"{path}.jpg"]
    append_record(folder, shot.model_copy(update={"image_sha256": sha256_file(folder / shot.path)}))
    (done,) = corrupt_source(folder, [("contrast", 2)])
    assert (done.made, done.kept, done.failed) == (1, 3, ())
    new = read_manifest(out)
    assert [key for key in new if new[key] != old[key]] == [f"{path}.png"]
    assert new[f"{path}.png"].image_sha256 == sha256_file(out / f"{path}.png")


def test_what_bends_the_picture_has_no_cameras(space):
    corrupt_source(space.captures_dir / "sim", [("elastic_transform", 1)])
    assert len(read_manifest(space.captures_dir / "sim-elastic_transform-1")) == 4
    assert not list((space.captures_dir / "sim-elastic_transform-1").rglob("transforms.json"))


def test_other_images_are_not_touched(space):
    shutil.copytree(space.captures_dir / "sim", space.captures_dir / "sim-fog-3")
    with pytest.raises(ToolkitError, match="holds images that were not made by corrupting shots"):
        corrupt_source(space.captures_dir / "sim", [FOG])


def test_an_image_that_does_not_decode_is_listed(space, type_command):
    (space.captures_dir / "sim/crate/mine").mkdir()
    (space.captures_dir / "sim/crate/mine/1.png").write_bytes(b"")
    said = type_command("--corrupt", "fog:3", "--backdrop", "white", "--quiet", code=1)
    assert (
        "skipped sim-fog-3/crate/mine/1.png: manifest.jsonl does not list it" in said.err
        and "corrupted 4 of them" in said.out
    )


@pytest.mark.parametrize("size", [(640, 480), (301, 200), (200, 333), (224, 224)])
def test_intrinsics_follow_the_cut(tmp_path, size):
    """A picture whose values are its own coordinates tells where each pixel of the cut came from."""
    width, height = size
    at_x, at_y = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    pixels = np.stack([at_x, at_y, at_x * 0], -1)
    Image.fromarray(np.round(pixels * 255).astype(np.uint8)).save(tmp_path / "places.png")
    cut = read_picture(tmp_path / "places.png", 224) / 255.0
    camera = {"width": width, "height": height, "fx": 500.0, "fy": 480.0, "cx": 0.4 * width, "cy": 0.6 * height}
    found = cut_intrinsics(camera)
    middle = slice(20, 204)
    for u in (30.5, 112.5, 200.5):  # a ray through the same place on both images has the same slope
        was = (cut[middle, int(u), 0].mean() * width, cut[int(u), middle, 1].mean() * height)
        assert (u - found["cx"]) / found["fx"] == pytest.approx((was[0] - camera["cx"]) / 500, abs=1.5 / 500)
        assert (u - found["cy"]) / found["fy"] == pytest.approx((was[1] - camera["cy"]) / 480, abs=1.5 / 480)


def test_a_manifest_edited_by_hand_is_read_as_a_plain_image(space):
    corrupt_source(space.captures_dir / "sim", [("fog", 1)])
    folder = space.captures_dir / "sim-fog-1"
    (folder / MANIFEST).write_text((folder / MANIFEST).read_text().replace('"cut_px": 224', '"cut_px": "224"'))
    assert {(one.corruption, one.cut_px) for one in read_captures(folder).captures} == {(None, None)}
