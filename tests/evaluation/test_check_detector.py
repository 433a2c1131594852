"""`toolkit models --check-on`: a wrong preprocessing is found, and the boxes are drawn."""

import json
from dataclasses import replace

import numpy as np
import pytest
from one_line import error_of
from PIL import Image
from red_seeker import PX, RedSeeker, red_seeker
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.workspace import make_workspace
from toolkit.evaluation.check_detector import check_detector


@pytest.fixture
def photos(tmp_path):
    """Grey photographs with a red half: what `red_seeker` finds, if it gets its channels in their order."""
    (tmp_path / "photos").mkdir()
    for k in range(3):
        pixels = np.full((PX, PX, 3), 60, np.uint8)
        pixels[:, : PX // 2, 0] = 250 - k
        Image.fromarray(pixels).save(tmp_path / "photos" / f"{k}.png")
    return tmp_path / "photos"


class Strict(RedSeeker):
    """Knows values from 0 to 1 only, as a trained network does."""

    def forward(self, batch):
        return super().forward(batch) * bool(batch.min() >= 0 and batch.max() <= 1)


def turned(channels):
    detector = red_seeker()
    return replace(detector, module=Strict(), decoder=replace(detector.decoder, channels=channels))


def test_the_wrong_order_of_channels_is_named_and_the_right_one_is_not(photos, tmp_path):
    done = check_detector("net", turned("RGB"), photos, tmp_path / "wrong.png")
    assert done.better == 'channels = "BGR"' and done.boxes < done.better_boxes
    assert "write that into the TOML" in done.describe()
    right = check_detector("net", turned("BGR"), photos, tmp_path / "right.png")
    assert not right.better and right.boxes == done.better_boxes and "no other preprocessing" in right.describe()
    shown, bare = (np.asarray(Image.open(tmp_path / name)) for name in ("right.png", "wrong.png"))
    orange = np.all(np.abs(shown.astype(int) - (255, 122, 51)) < 40, axis=2)
    assert orange.sum() > 200 and (shown != bare).any()
    (tmp_path / "none").mkdir()
    assert "expected a folder with photographs in it" in error_of(
        lambda: check_detector("net", turned("BGR"), tmp_path / "none", tmp_path / "x.png")
    )


def test_the_command_writes_the_picture_and_answers_1(photos, tmp_path, monkeypatch):
    make_workspace(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("toolkit.models.load_detector.load_detector", lambda *_: turned("RGB"))
    done = CliRunner().invoke(app, ["models", "--model", "onnx:red.onnx", "--check-on", "photos", "--json"])
    (row,) = json.loads(done.stdout)
    assert done.exit_code == 1 and row["photos"] == 3 and (tmp_path / "eval/check/red.png").is_file()
    unnamed = CliRunner().invoke(app, ["models", "--check-on", "photos"])
    assert "name the detectors to check" in str(unnamed.exception)
