"""`toolkit baseline` as it is typed."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image

from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.network import Classifier
from toolkit.models.weights import WeightsFile


@pytest.fixture
def type_command(tmp_path, monkeypatch, type_toolkit):
    """Run `toolkit baseline ARGUMENTS` in an empty folder; returns exit code, stdout and stderr."""
    module = torch.nn.Sequential(torch.nn.AdaptiveAvgPool2d(2), torch.nn.Flatten(), torch.nn.Linear(12, 2))
    how = Preprocessing(64, 64, (0.5,) * 3, (0.25,) * 3)
    tiny = Classifier(
        "tiny", module.eval(), ["cat", "jet"], how, WeightsFile(Path("tiny.pth"), "ab" * 32, "tiny.pth"), "cpu", False
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("toolkit.models.load.load_classifier", lambda *_: tiny)

    def run(*arguments: str) -> SimpleNamespace:
        code, said, told = type_toolkit("baseline", *arguments)
        return SimpleNamespace(code=code, said=said, told=told)

    return run


@pytest.fixture
def photos(tmp_path):
    rng = np.random.default_rng(0)
    for label in ("cat", "jet"):
        (tmp_path / "photos" / label).mkdir(parents=True)
        for k in range(3):
            pixels = rng.integers(0, 256, (70, 80, 3), np.uint8)
            Image.fromarray(pixels).save(tmp_path / "photos" / label / f"{k}.png")
    return tmp_path / "photos"


def test_it_says_what_it_made_and_what_comes_next(type_command, tmp_path):
    ran = type_command("qr", "--size-px", "60", "--size-px", "50")
    assert ran.code == 0, ran.told
    assert f"{tmp_path}/print/patches/qr-60: 2 pictures of 60 px" in ran.said
    assert f"{tmp_path}/print/patches/qr-50: 2 pictures of 50 px" in ran.said
    assert "next: toolkit corrupt-eval --data FOLDER --patches qr-60" in ran.said
    assert "Making qr: 2 to do" in ran.told
    again = type_command("qr", "--size-px", "60", "--quiet")
    assert again.code == 0
    assert "qr-60: its 2 pictures were made from these inputs before: nothing to do" in again.said
    assert again.told == ""
    assert len(list((tmp_path / "print/patches/qr-60").iterdir())) == 4


def test_fixed_patterns_are_trained_with_next(type_command):
    ran = type_command("fixed-pattern", "--size-px", "20", "--set", "noise", "--class", "jet")
    assert "noise-20: 1 picture of 20 px" in ran.said
    assert "next: toolkit train-classifier --data FOLDER --patches noise-20" in ran.said


def test_json_is_the_result_and_nothing_else(type_command, photos):
    ran = type_command("best-image", "--data", "photos", "--size-px", "32", "--json", "--quiet")
    result = json.loads(ran.said)
    assert ran.code == 0
    assert result["skipped"] == []
    assert {key: result["sets"][0][key] for key in ("name", "size_px", "made", "found")} == {
        "name": "best-image-32", "size_px": 32, "made": 2, "found": 0,
    }  # fmt: skip
    assert Path(result["sets"][0]["folder"], "jet.json").is_file()


def test_bad_images_are_listed_and_the_exit_code_says_so(type_command, photos):
    (photos / "jet/1.png").write_bytes((photos / "jet/1.png").read_bytes()[:80])
    for _ in range(2):
        ran = type_command("best-image", "--data", "photos", "--size-px", "32")
        assert ran.code == 1
        assert "skipped jet/1.png: truncated" in ran.told
        assert "best-image-32" in ran.said, "the good part is done"
    assert "--data FOLDER --patches best-image-32: FOLDER with other images" in ran.said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["best-image"], "best-image: expected training images"),
        (
            ["best-img"],
            "KIND best-img: expected qr, apriltag, word, best-image, random-image or fixed-pattern; did you mean",
        ),
        (["qr", "--size-px", "30"], "--size-px 30: expected 46"),
        (["qr", "--class", "horse"], "called 'horse'"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(type_command, arguments, message):
    ran = type_command(*arguments)
    assert ran.code == 2
    assert message in ran.told
    assert len(ran.told.strip().splitlines()) == 1
