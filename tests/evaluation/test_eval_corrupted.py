"""`toolkit eval --corrupt`: the corruption is the published one, of what the network sees, in a source of its own."""

import base64
import csv
import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image

from toolkit.captures.read import Selection, read_captures
from toolkit.core.draws import image_seed
from toolkit.core.workspace import make_workspace
from toolkit.corruptions.batch import corrupt
from toolkit.corruptions.digital import from_bytes, to_bytes
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.ground_truth import add_corrupted
from toolkit.evaluation.predict import predict_captures
from toolkit.evaluation.read_pixels import read_ahead, read_pixels
from toolkit.imaging.preprocessing import resize_and_crop
from toolkit.imaging.read import read_image
from toolkit.models.network import Classifier

FOG, BLUR = ("fog", 3), ("defocus_blur", 5)
LABELS = ["racer", "warplane", "coffeepot", "eggnog"]


@pytest.fixture
def textured(put, workspace):
    """Two poses of a racer bare and patched, in `sim` and `real`, with something to blur in each."""
    rng = np.random.default_rng(4)
    for source in ("sim", "real"):
        for variant in ("unpatched", "patched"):
            for pose in (1, 2):
                file = put(f"{source}/racer/{variant}/pose_{pose}.png", "racer")
                Image.fromarray(rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)).save(file)
    return workspace


@pytest.fixture
def seeing(colour_classifier):
    """A network whose answer depends on every pixel."""
    torch.manual_seed(1)
    crop = colour_classifier.preprocessing.crop_px
    module = torch.nn.Sequential(torch.nn.Flatten(), torch.nn.Linear(3 * crop * crop, len(LABELS))).eval()
    return replace(colour_classifier, module=module)


def by_hand(file, below: str, corruption, classifier: Classifier):
    pixels = resize_and_crop(read_image(file), classifier.preprocessing)
    return to_bytes(corrupt(from_bytes(pixels[None]), *corruption, [image_seed(0, below)]))[0]


def test_it_is_the_crop_corrupted_by_hand(textured, seeing):
    result = evaluate_captures(textured.captures_dir, textured, seeing, EvalConfig(corruptions=[FOG, BLUR]))
    assert len(result.predictions) == 8 * 3
    for one in result.predictions:
        capture = one.capture
        below = f"racer/{capture.variant}/pose_{capture.pose_id}.png"
        clean = resize_and_crop(read_image(capture.file), seeing.preprocessing)
        seen = clean if capture.corruption is None else by_hand(capture.file, below, capture.corruption, seeing)
        assert (capture.corruption is None) == np.array_equal(seen, clean)
        batch = torch.from_numpy(seen.copy()).permute(2, 0, 1)[None].float() / 255
        chances = seeing.logits(batch).detach().double().softmax(1)[0]
        assert one.true_prob == pytest.approx(float(chances[0]), abs=1e-6)


def test_sources_tables_pairs_and_files_name_it(textured, seeing):
    result = evaluate_captures(textured.captures_dir, textured, seeing, EvalConfig(corruptions=[FOG]))
    sources = {group.source for group in result.groups}
    assert sources == {"sim", "real", "sim-fog-3", "real-fog-3"}
    assert {(pair.source, pair.outcomes.n) for pair in result.pairs} == {(source, 2) for source in sources}
    assert result.unpaired == ()
    summary = json.loads((result.run_dir / "summary.json").read_text())
    assert summary["corrupted"] == [
        {"source": source, "corruption": "fog", "severity": 3} for source in ("real-fog-3", "sim-fog-3")
    ]
    rows = list(csv.DictReader((result.run_dir / "predictions.csv").open(newline="")))
    assert len({row["path"] for row in rows}) == len(rows) == 16
    assert "sim-fog-3/racer/patched/pose_2.png" in {row["path"] for row in rows}
    compared = {(one.sim, one.real) for one in result.sim_real}
    assert compared == {("sim", "real"), ("sim-fog-3", "real-fog-3")}, "like with like"


def test_the_report_shows_the_corrupted_picture(textured, seeing):
    result = evaluate_captures(textured.captures_dir, textured, seeing, EvalConfig(corruptions=[FOG]))
    html = result.report_file.read_text()
    shown = re.findall(
        r'<img src="data:image/jpeg;base64,([^"]+)" alt="[^"]*" title="sim-fog-3/[^"]*/patched/pose_1', html
    )
    file = textured.captures_dir / "sim/racer/patched/pose_1.png"
    clean = resize_and_crop(read_image(file), seeing.preprocessing).astype(float)
    corrupted = by_hand(file, "racer/patched/pose_1.png", FOG, seeing).astype(float)
    found = np.asarray(Image.open(io.BytesIO(base64.b64decode(shown[0]))), float)
    assert found.shape == clean.shape
    assert np.abs(found - corrupted).mean() < np.abs(found - clean).mean() / 2
    assert "<b>sim-fog-3</b> by fog of severity 3" in html


def test_neither_order_nor_batch_matters(textured, seeing):
    folder = add_corrupted(read_captures(textured.captures_dir), [FOG, ("gaussian_noise", 5), ("frost", 2)])
    mixed = list(np.random.default_rng(0).permutation(np.array(folder.captures, object)))
    whole = {one.capture.path: one for one in predict_captures(folder.captures, {"racer": 0}, seeing)}
    for one in predict_captures(mixed, {"racer": 0}, seeing, batch_size=3):
        assert one.top1_prob == pytest.approx(whole[one.capture.path].top1_prob, abs=1e-6)
    how = seeing.preprocessing
    crops = {capture.path: pixels for capture, pixels in read_ahead(folder.captures, how, 32)}
    assert [capture for capture, _ in read_ahead(mixed, how, 3)] == mixed
    for capture, pixels in read_ahead(mixed, how, 3):
        assert np.array_equal(pixels, crops[capture.path])


@pytest.mark.filterwarnings("error")
def test_a_classifiers_crop_is_corrupted_and_a_detectors_whole_picture(textured, seeing):
    folder = add_corrupted(read_captures(textured.captures_dir, Selection(sources=("sim",))), [FOG])
    capture = next(one for one in folder.captures if one.pending_corruption)
    seeds, picture = [image_seed(0, capture.path_in_source)], read_image(capture.file).copy()
    crop = resize_and_crop(picture, seeing.preprocessing)
    whole, own = (to_bytes(corrupt(from_bytes(one[None]), *FOG, seeds))[0] for one in (picture, crop))
    assert np.array_equal(read_pixels(capture, None), whole)
    assert np.array_equal(read_pixels(capture, seeing.preprocessing), own)
    assert not np.array_equal(resize_and_crop(whole, seeing.preprocessing), own)


def test_a_folder_that_has_the_name_keeps_it(put, workspace, colour_classifier):
    put("sim/racer/unpatched/1.png", "racer")
    put("sim-fog-3/racer/unpatched/1.png", "warplane")
    put("sim-fog-3+/racer/unpatched/1.png", "warplane")
    folder = add_corrupted(read_captures(workspace.captures_dir), [FOG])
    made = {one.source for one in folder.captures if one.corruption is not None}
    assert made == {"sim-fog-3++", "sim-fog-3-fog-3", "sim-fog-3+-fog-3"}
    assert len({one.path for one in folder.captures}) == len(folder.captures) == 6


def test_an_unreadable_image_is_listed_under_each(put, workspace, colour_classifier):
    put("sim/racer/unpatched/1.png", "racer")
    put("sim/racer/unpatched/2.png", "racer").write_bytes(b"")
    put("sim/racer/unpatched/3.png", "racer")
    result = evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(corruptions=[FOG]))
    paths = [f"{source}/racer/unpatched/2.png" for source in ("sim", "sim-fog-3")]
    assert result.failed == tuple((path, "the file is empty") for path in paths)
    assert [group.n for group in result.groups if group.object == "racer"] == [2, 2]


@pytest.mark.parametrize(
    ("words", "told"), [("fogg:3", "did you mean fog"), ("fog:6", "severity '6'"), ("fog:", "severity ''")]
)
def test_bad_words_are_one_line_and_exit_code_2(words, told, type_toolkit, tmp_path):
    space = make_workspace(tmp_path / "lab")
    for command in (["eval"], ["capture-sim"], ["train-patch", "--class", "jet", "--data", tmp_path]):
        code, out, err = type_toolkit(*command, "--workspace", space.root, "--corrupt", words)
        assert code == 2 and out == ""
        assert told in err and err.count("\n") == 1
