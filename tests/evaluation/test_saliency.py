"""Maps of the flips: which are drawn, where, and how they reach the report."""

import base64
import dataclasses
import io
import re

import numpy as np
import pytest
import torch
from PIL import Image
from torch import nn

from toolkit.evaluation import EvalConfig, saliency
from toolkit.evaluation.contact_sheet import MAX_BYTES
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.metrics import FlipList
from toolkit.evaluation.saliency import HEAT_COLOURS, draw_saliency, overlay_heat


class Spots(nn.Module):
    """Tells colours as the colour classifier does, from a map of 7 × 7 places."""

    def __init__(self) -> None:
        super().__init__()
        self.pool = nn.AvgPool2d(4)

    def forward(self, batch):
        means = self.pool(batch).mean((2, 3))
        return torch.cat([4 * means, torch.full_like(means[:, :1], 2.0)], dim=1)


@pytest.fixture
def spots(colour_classifier):
    return dataclasses.replace(colour_classifier, arch="spots", module=Spots().eval())


@pytest.fixture
def shot(put, workspace):
    """Three poses gained, one lost, one unchanged."""
    for pose in range(1, 6):
        put(f"sim/racer/unpatched/{pose}.png", "racer" if pose >= 4 else "warplane")
        put(f"sim/racer/patched/{pose}.png", "eggnog" if pose == 4 else "racer")
    return workspace


def pictures(result):
    html = result.report_file.read_text(encoding="utf-8")
    return re.findall(r'<img src="data:image/jpeg;base64,([^"]+)" alt="saliency (?:before|after)"', html), html


def test_report_has_two_maps_per_flip(shot, spots):
    found, html = pictures(evaluate_captures(shot.captures_dir, shot, spots))
    assert len(found) == 2 * 4
    assert all(len(base64.b64decode(one)) <= MAX_BYTES for one in found)
    assert Image.open(io.BytesIO(base64.b64decode(found[0]))).size == (28, 28)
    assert "Grad-CAM" in html and "No saliency maps" not in html


def test_batches_do_not_change_the_maps(shot, spots):
    first, _ = pictures(evaluate_captures(shot.captures_dir, shot, spots, EvalConfig(run="a")))
    second, _ = pictures(evaluate_captures(shot.captures_dir, shot, spots, EvalConfig(run="b", batch_size=3)))
    assert first == second


def test_may_be_left_out(shot, spots):
    found, html = pictures(evaluate_captures(shot.captures_dir, shot, spots, EvalConfig(saliency=False)))
    assert found == [] and "No saliency maps" not in html and "Grad-CAM" not in html


def test_a_network_without_a_map_says_so(shot, colour_classifier):
    result = evaluate_captures(shot.captures_dir, shot, colour_classifier)
    found, html = pictures(result)
    assert found == [] and "No saliency maps: colours has no feature map" in html
    assert result.notes == ()
    asked = evaluate_captures(shot.captures_dir, shot, colour_classifier, EvalConfig(saliency=True))
    assert any("no saliency maps: colours has no feature map" in note for note in asked.notes)


def test_many_flips_wait_to_be_asked(shot, spots, monkeypatch):
    monkeypatch.setattr(saliency, "MAX_UNASKED", 3)
    found, html = pictures(evaluate_captures(shot.captures_dir, shot, spots))
    assert found == [] and "4 flips are more than 3: use --saliency to draw maps" in html
    found, _ = pictures(evaluate_captures(shot.captures_dir, shot, spots, EvalConfig(saliency=True)))
    assert len(found) == 8
    assert draw_saliency([FlipList("gained", (), ())], spots).reason == ""


def test_an_image_gone_since_is_left_out(shot, spots, monkeypatch):
    def lose(*args):
        (shot.captures_dir / "sim/racer/patched/1.png").write_bytes(b"")
        return find(*args)

    find = saliency.find_feature_map
    monkeypatch.setattr(saliency, "find_feature_map", lose)
    found, _ = pictures(evaluate_captures(shot.captures_dir, shot, spots))
    assert len(found) == 2 * 3


def test_heat_lies_where_the_map_has_it():
    pixels = np.full((60, 80, 3), 120, np.uint8)
    heat = np.zeros((6, 8))
    heat[1:3, 5:7] = 2.0  # of ten pixels each: around x 60, y 20
    drawn = np.asarray(overlay_heat(pixels, heat, 2.0), float)
    change = np.abs(drawn - 120).sum(2)
    y, x = np.unravel_index(change.argmax(), change.shape)
    assert (y, x) == (pytest.approx(20, abs=5), pytest.approx(60, abs=5))
    assert change[35:].max() == 0 and change[:, :45].max() == 0
    expected = 120 + saliency.MAX_ALPHA * (np.array(HEAT_COLOURS[-1]) - 120)
    assert drawn[y, x] == pytest.approx(expected, abs=3)
    half = np.abs(np.asarray(overlay_heat(pixels, heat, 4.0), float) - drawn)
    assert half[y, x].max() > 10  # on a scale twice as long the same heat is another colour
    assert np.array_equal(np.asarray(overlay_heat(pixels, 0 * heat, 0.0)), pixels)


def test_both_maps_of_a_flip_have_one_scale(shot, spots, monkeypatch):
    grey = np.full((28, 28, 3), 120, np.uint8)

    def weak_before(images, *_):
        level = {one.capture.path: 1.0 if one.capture.variant == "unpatched" else 4.0 for one in images}
        return {path: (grey, np.full((7, 7), value, np.float32)) for path, value in level.items()}

    monkeypatch.setattr(saliency, "_compute_maps", weak_before)
    found, _ = pictures(evaluate_captures(shot.captures_dir, shot, spots))
    means = [np.asarray(Image.open(io.BytesIO(base64.b64decode(one)))).mean((0, 1)) for one in found[:2]]
    for mean, share in zip(means, (0.25, 1.0), strict=True):
        expected = np.asarray(overlay_heat(grey, np.full((7, 7), share), 1.0)).mean((0, 1))
        assert mean == pytest.approx(expected, abs=4)  # the rest is JPEG
    assert np.abs(means[0] - means[1]).max() > 40
