"""Predictions that are kept: by the image's bytes and the weights, through kills, and never of what was not read."""

import hashlib
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from toolkit.captures.read import read_captures
from toolkit.core.files import sha256_file
from toolkit.core.work import NOWHERE, Work
from toolkit.evaluation import predict
from toolkit.evaluation.predict import predict_captures, predict_once
from toolkit.models.weights import WeightsFile


@pytest.fixture
def captures(tmp_path):
    """Three images: red, white, and a copy of the red one in another variant."""
    folder = tmp_path / "captures/sim/crate/patched"
    folder.mkdir(parents=True)
    for i, colour in ((1, (220, 10, 10)), (2, (240, 240, 240))):
        Image.fromarray(np.full((72, 96, 3), colour, np.uint8)).save(folder / f"{i}.png")
    other = folder.with_name("unpatched")
    other.mkdir()
    shutil.copy(folder / "1.png", other / "3.png")
    return read_captures(tmp_path / "captures").captures


def test_an_image_is_asked_about_once_whatever_it_is_called(captures, redness, tmp_path):
    cache, classes = tmp_path / "kept.jsonl", {"crate": 1}
    first, n_first = predict_once(captures, classes, redness, cache)
    again, n_again = predict_once(captures, classes, redness, cache)
    assert (n_first, n_again) == (2, 0)
    assert [one.correct_top1 for one in first] == [True, False, True]
    assert first == again == predict_captures(captures, classes, redness)
    assert len(cache.read_text().splitlines()) == 2


def test_other_weights_another_truth_or_other_pixels_are_asked_about(captures, redness, tmp_path):
    cache = tmp_path / "kept.jsonl"
    predict_once(captures, {"crate": 1}, redness, cache)
    other = replace(redness, weights=WeightsFile(redness.weights.path, "ef" * 32, "other.pth"))
    assert predict_once(captures, {"crate": 1}, other, cache)[1] == 2
    assert predict_once(captures, {"crate": 0}, redness, cache)[1] == 2
    smaller = replace(redness, preprocessing=replace(redness.preprocessing, crop_px=40))
    assert predict_once(captures, {"crate": 1}, smaller, cache)[1] == 2
    Image.fromarray(np.zeros((72, 96, 3), np.uint8)).save(captures[1].file)
    assert predict_once(captures, {"crate": 1}, redness, cache)[1] == 1


def test_a_line_cut_short_costs_its_image_only(captures, redness, tmp_path):
    cache = tmp_path / "kept.jsonl"
    whole, _ = predict_once(captures, {"crate": 1}, redness, cache)
    cache.write_bytes(cache.read_bytes()[:-30])
    again, n_asked = predict_once(captures, {"crate": 1}, redness, cache)
    assert n_asked == 1 and again == whole
    assert predict_once(captures, {"crate": 1}, redness, cache)[1] == 0


def test_an_image_that_cannot_be_read_is_listed_and_tried_again(captures, redness, tmp_path):
    cache, good = tmp_path / "kept.jsonl", captures[1].file.read_bytes()
    captures[1].file.write_bytes(good[:60])
    broken, _ = predict_once(captures, {"crate": 1}, redness, cache)
    assert [one.is_read for one in broken] == [True, False, True] and broken[1].status != "ok"
    captures[1].file.write_bytes(good)
    mended, n_asked = predict_once(captures, {"crate": 1}, redness, cache)
    assert n_asked == 1 and all(one.is_read for one in mended)


def test_answers_of_an_older_method_are_asked_for_again(captures, redness, tmp_path, monkeypatch):
    """A key without a version is the first's, so that rows stay good where nothing changed."""
    cache = tmp_path / "kept.jsonl"
    monkeypatch.setattr(predict, "PREDICTIONS", Work("prediction", 1, old_at=NOWHERE))
    predict_once(captures, {"crate": 1}, redness, cache)
    parts = [sha256_file(captures[1].file), redness.weights.sha256, "redness", redness.preprocessing.describe(), 1]
    assert hashlib.sha256(json.dumps(parts).encode()).hexdigest() in cache.read_text()
    monkeypatch.setattr(predict, "PREDICTIONS", Work("prediction", 2, old_at=NOWHERE))
    assert [predict_once(captures, {"crate": 1}, redness, cache)[1] for _ in range(2)] == [2, 0]
