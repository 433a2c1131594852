"""`toolkit models`: the networks at hand, with accuracy, speed and whether they can train."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.workspace import make_workspace
from toolkit.evaluation import survey

SOURCE = """
import torch

class Mean(torch.nn.Module):
    def forward(self, x):
        return x.mean((2, 3))

def colours():
    return Mean(), {"size": 32, "mean": [0.5, 0.5, 0.5], "std": [0.2, 0.2, 0.2], "labels": ["red", "green", "blue"]}
"""


@pytest.fixture
def space(tmp_path, monkeypatch):
    make_workspace(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TOOLKIT_WEIGHTS", str(tmp_path / "none"))
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr("toolkit.evaluation.survey.SPEED_S", 0.01)
    (tmp_path / "hues.py").write_text(SOURCE)
    return tmp_path


def run(*words):
    return CliRunner().invoke(app, ["models", *words])


def test_a_function_counted_on_a_folder(space):
    for k, label in enumerate(("red", "green", "blue", "blue")):
        pixels = np.zeros((40, 40, 3), np.uint8)
        pixels[..., min(k, 2) if k < 3 else 0] = 200  # the last is red, and lies with the blue ones
        (space / "images" / label).mkdir(parents=True, exist_ok=True)
        Image.fromarray(pixels).save(space / "images" / label / f"{k}.png")
    done = run("--model", "python:hues:colours", "--data", "images", "--speed", "--json")
    assert done.exit_code == 0, done.output
    (row,) = json.loads(done.stdout)
    assert (row["n"], row["correct"], row["accuracy"], row["classes"]) == (4, 3, 0.75, 3)
    assert row["can_train"] and row["images_per_s"] > 0 and row["trained_images_per_s"] > 0
    assert row["ci95"][0] < 0.75 < row["ci95"][1]
    shown = run("--model", "python:hues:colours", "--data", "images")
    assert "75.0" in shown.stdout and "not" in shown.stdout and "per s" not in shown.stdout


def test_the_bundled_one_is_at_hand_and_a_broken_one_is_a_row(space):
    (space / "rig" / "classifiers").mkdir(parents=True, exist_ok=True)
    (space / "rig" / "classifiers" / "broken.pt2").write_bytes(b"noise")
    done = run("--json")
    rows = {row["model"]: row for row in json.loads(done.stdout)}
    assert set(rows) == {"rig18", "broken"} and done.exit_code == 1
    assert rows["rig18"]["images_per_s"] is None  # only --speed takes the time
    assert rows["rig18"]["licence"] == "MIT" and rows["rig18"]["can_train"] and rows["rig18"]["classes"] == 36
    assert "not a program of torch.export" in rows["broken"]["why_not"]


def test_a_second_list_is_the_same_without_loading_a_network_until_a_file_changes(space, monkeypatch):
    monkeypatch.setenv("TOOLKIT_CACHE", str(space / "kept"))
    loaded, load = [], survey.load_classifier
    monkeypatch.setattr(survey, "load_classifier", lambda model, *rest: (loaded.append(model), load(model, *rest))[1])
    own = space / "rig" / "classifiers"
    own.mkdir(parents=True, exist_ok=True)
    first, second = run("--json"), run("--json")
    assert second.stdout == first.stdout and loaded == ["rig18"]
    # a new file and a changed file are surveyed, a network that does not load each time
    (own / "broken.pt2").write_bytes(b"noise")
    assert [row["model"] for row in json.loads(run("--json").stdout)] == ["rig18", "broken"]
    run("--json")
    assert run("--json").exit_code == 1 and loaded.count("broken") > loaded.count("rig18") == 2
    (own / "broken.pt2").unlink()
    assert run("--json").stdout == first.stdout
    # options that measure something, or name networks, are never answered from disk
    before = len(loaded)
    run("--model", "rig18", "--json")
    assert len(loaded) == before + 1


DETECTOR = Path(__file__).parents[2].parent / "shared/detectors/fastestdet.onnx"


@pytest.mark.skipif(not DETECTOR.is_file(), reason="needs ../shared/detectors")
def test_a_detector_is_a_row_of_its_own_kind(space):
    pytest.importorskip("onnxruntime", reason="needs onnxruntime: pip install '.[onnx]'")
    (row,) = json.loads(run("--model", f"onnx:{DETECTOR}", "--speed", "--json").stdout)
    assert (row["kind"], row["classes"], row["image_px"], row["can_train"]) == ("detector", 80, 352, True)
    assert row["images_per_s"] > 0 and row["n"] is None


def test_class_names_are_searched(space):
    (space / "rig/classifiers").mkdir(parents=True, exist_ok=True)
    (space / "rig/classifiers/own.json").write_text('{"arch": "resnet18", "labels": ["Toy car", "bolt"]}')
    (space / "rig/classifiers/own.pth").write_bytes(b"")
    shown = run("--classes", "car").stdout.splitlines()
    assert shown[:4] == ["freight car", "passenger car", "sports car", "Toy car"]
    assert {"car mirror", "streetcar"} <= set(shown) and "bolt" not in shown
    assert json.loads(run("--classes", "car", "--json").stdout) == shown
    refused = run("--classes", "xyzzy")
    assert refused.exit_code != 0 and refused.stdout == ""
