"""From folder to run folder, with a classifier whose every answer is known."""

import csv
import json
import re
import shutil
import threading
import warnings
from dataclasses import replace

import pytest
from PIL import Image

from toolkit.captures.read import read_captures, read_crop
from toolkit.core.errors import ToolkitError
from toolkit.evaluation import EvalConfig, read_pixels
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.ground_truth import add_corrupted
from toolkit.evaluation.predict import predict_captures
from toolkit.evaluation.predictions_csv import COLUMNS
from toolkit.models.network import Classifier
from toolkit.models.predict import predict_stream


def read_rows(result):
    with (result.run_dir / "predictions.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def shot(put, workspace):
    """Eight poses of a racer and a warplane: the racer's patch helps in seven, the warplane's harms in one."""
    for pose in range(1, 9):
        put(f"sim/racer/unpatched/pose_{pose:02d}.png", "racer" if pose == 8 else "warplane")
        put(f"sim/racer/patched/pose_{pose:02d}.png", "racer")
        put(f"sim/warplane/unpatched/pose_{pose:02d}.png", "warplane")
        put(f"sim/warplane/patched/pose_{pose:02d}.png", "eggnog" if pose == 3 else "warplane")
    return workspace


def test_results_are_right(shot, colour_classifier):
    result = evaluate_captures(shot.captures_dir, shot, colour_classifier)
    assert result.run_dir == shot.eval_dir / "colours-sim"
    assert sorted(path.name for path in result.run_dir.iterdir()) == ["predictions.csv", "report.html", "summary.json"]
    summary = json.loads((result.run_dir / "summary.json").read_text())
    assert summary == result.summary
    assert (summary["schema_version"], summary["kind"]) == (1, "eval")
    assert {key: summary["model"][key] for key in ("arch", "weights", "sha256")} == {
        "arch": "colours",
        "weights": "colours.pth",
        "sha256": "ab" * 32,
    }
    top1 = {(g["object"], g["variant"]): (g["n"], g["top1"]) for g in summary["groups"]}
    assert top1 == {
        ("racer", "unpatched"): (8, 1 / 8),
        ("racer", "patched"): (8, 1.0),
        ("warplane", "unpatched"): (8, 1.0),
        ("warplane", "patched"): (8, 7 / 8),
        ("all", "unpatched"): (16, 9 / 16),
        ("all", "patched"): (16, 15 / 16),
    }
    pairs = {p["object"]: (p["n_pairs"], p["gained"], p["lost"], round(p["mcnemar_p"], 6)) for p in summary["pairs"]}
    assert pairs == {"racer": (8, 7, 0, 0.015625), "warplane": (8, 0, 1, 1.0), "all": (16, 7, 1, 0.070312)}


def test_csv_has_the_agreed_columns(shot, colour_classifier):
    rows = read_rows(evaluate_captures(shot.captures_dir, shot, colour_classifier))
    assert tuple(rows[0]) == tuple(COLUMNS)
    assert len(rows) == 32
    row = next(row for row in rows if row["path"] == "sim/racer/unpatched/pose_02.png")
    assert {key: row[key] for key in ("true_index", "true_label", "top1_index", "top1_label")} == {
        "true_index": "0",
        "true_label": "racer",
        "top1_index": "1",
        "top1_label": "warplane",
    }
    assert (row["pose_id"], row["correct_top1"], row["correct_top5"], row["status"]) == ("2", "0", "1", "ok")
    assert 0 < float(row["true_prob"]) < float(row["top1_prob"]) < 1


def test_same_input_same_bytes_and_another_result_goes_beside_it(shot, colour_classifier):
    first = evaluate_captures(shot.captures_dir, shot, colour_classifier, EvalConfig(run="again"))
    before = {path.name: path.read_bytes() for path in first.run_dir.iterdir()}
    evaluate_captures(shot.captures_dir, shot, colour_classifier, EvalConfig(run="again", batch_size=5))
    assert {path.name: path.read_bytes() for path in first.run_dir.iterdir()} == before
    one = EvalConfig(run="again", objects=("racer",))
    for _ in range(2):  # the second finds its own result there
        other = evaluate_captures(shot.captures_dir, shot, colour_classifier, one)
        assert other.run_dir.name == "again-2" and len(read_rows(other)) == 16
        assert other.notes[-1].endswith("again holds another result, and stays as it is")
    assert {path.name: path.read_bytes() for path in first.run_dir.iterdir()} == before
    evaluate_captures(shot.captures_dir, shot, colour_classifier, one.with_overrides(replace=True))
    assert len(read_rows(first)) == 16


def test_a_runs_name_tells_network_weights_and_sources(workspace, put, colour_classifier):
    from dataclasses import replace

    for source in ("sim", "real"):
        put(f"{source}/racer/unpatched/1.png", "racer")
    weights = replace(colour_classifier.weights, name="colours-epoch 9.pth")
    other = replace(colour_classifier, weights=weights)
    runs = [
        evaluate_captures(folder, workspace, network).run_dir.name
        for network in (colour_classifier, other)
        for folder in (workspace.captures_dir, workspace.captures_dir / "sim")
    ]
    assert runs == ["colours-real-sim", "colours-sim", "colours-epoch-9-real-sim", "colours-epoch-9-sim"]


def test_bad_files_are_listed_and_the_good_part_is_done(shot, colour_classifier):
    folder = shot.captures_dir / "sim" / "racer" / "patched"
    whole = (folder / "pose_01.png").read_bytes()
    (folder / "pose_01.png").write_bytes(whole[: len(whole) // 2])
    (folder / "pose_02.png").write_bytes(b"")
    (folder / "pose_03.png").write_text("no image")
    (folder / "pose_20.png").write_bytes(whole)
    (folder / "notes.txt").write_text("not counted")
    (shot.captures_dir / "sim" / "instances.json").write_text("{}")  # from `toolkit coco`
    result = evaluate_captures(shot.captures_dir, shot, colour_classifier)
    reasons = {path.rsplit("/", 1)[1]: reason for path, reason in result.failed}
    assert set(reasons) == {"pose_01.png", "pose_02.png", "pose_03.png"}
    assert "truncated" in reasons["pose_01.png"] and "empty" in reasons["pose_02.png"]
    group = next(g for g in result.summary["groups"] if (g["object"], g["variant"]) == ("racer", "patched"))
    assert (group["n"], group["failed"]) == (6, 3)
    assert [p["n_pairs"] for p in result.summary["pairs"] if p["object"] == "racer"] == [5]
    assert ("sim/racer/patched/pose_20.png", "no unpatched image of pose 20") in result.unpaired
    statuses = {row["path"]: row["status"] for row in read_rows(result)}
    assert statuses["sim/racer/patched/pose_02.png"] == "the file is empty"
    assert len(statuses) == 33
    (note,) = [note for note in result.notes if "not counted" in note]
    assert "notes.txt" in note and "instances.json" not in note
    html = result.report_file.read_text()
    assert "the file is empty" in html and "no unpatched image of pose 20" in html


def test_nothing_readable_is_still_a_result(put, workspace, colour_classifier):
    put("real/racer/patched/1.png", "racer").write_bytes(b"")
    result = evaluate_captures(workspace.captures_dir, workspace, colour_classifier)
    assert len(result.failed) == 1
    assert result.summary["groups"][0]["top1"] is None
    assert result.summary["groups"][0]["top1_ci95"] == [0.0, 1.0]


def test_truth_from_spec_folder_name_or_clear_error(put, workspace, colour_classifier):
    workspace.objects_dir.mkdir()
    (workspace.objects_dir / "my_mug.toml").write_text(
        'name = "my_mug"\nclass = "coffeepot"\nmesh = "mug.obj"\nlength_mm = 90\n'
    )
    put("real/my_mug/unpatched/1.png", "coffeepot")
    put("real/Racer/unpatched/1.png", "racer")
    result = evaluate_captures(workspace.captures_dir, workspace, colour_classifier)
    assert [one.correct_top1 for one in result.predictions] == [True, True]
    put("real/warplan/unpatched/1.png", "racer")
    with pytest.raises(ToolkitError, match=r"'warplan'.*did you mean warplane.*rig/objects/warplan\.toml"):
        evaluate_captures(workspace.captures_dir, workspace, colour_classifier)
    (workspace.objects_dir / "my_mug.toml").write_text(
        'name = "my_mug"\nclass = "cup"\nmesh = "mug.obj"\nlength_mm = 90\n'
    )
    shutil.rmtree(workspace.captures_dir / "real" / "warplan")
    result = evaluate_captures(workspace.captures_dir, workspace, colour_classifier)
    assert [one.capture.object for one in result.predictions] == ["Racer"]
    (note,) = (note for note in result.notes if "my_mug" in note)
    assert "1 image of 'my_mug' left out" in note and "my_mug.toml: no class called 'cup'" in note
    assert note in result.summary["notes"]
    only = EvalConfig(objects=("my_mug",))
    with pytest.raises(ToolkitError, match=r"my_mug\.toml: no class called 'cup'.*knows none of the objects"):
        evaluate_captures(workspace.captures_dir, workspace, colour_classifier, only)


def test_bad_run_names():
    for name in ("../evil", "a/b", ".hidden", "-x"):
        with pytest.raises(ToolkitError, match=f"^run {re.escape(name)}: expected letters"):
            EvalConfig(run=name)


def test_read_only_workspace(shot, colour_classifier, monkeypatch):
    import os

    real_open = os.open

    def refuse(path, flags, *args, **kwargs):
        if flags & (os.O_WRONLY | os.O_RDWR):
            raise OSError(30, "Read-only file system")
        return real_open(path, flags, *args, **kwargs)

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(ToolkitError, match="read-only"):
        evaluate_captures(shot.captures_dir, shot, colour_classifier)


def test_ties_go_to_the_lower_index_on_every_path(put, workspace, colour_classifier):
    import dataclasses

    import torch

    class Flat(torch.nn.Module):
        def forward(self, batch):
            return torch.zeros(len(batch), 4)

    flat = dataclasses.replace(colour_classifier, module=Flat())
    put("real/racer/unpatched/1.png", "racer")
    put("real/eggnog/unpatched/1.png", "racer")
    result = evaluate_captures(workspace.captures_dir, workspace, flat)
    assert [(one.true_label, one.top1_index, one.true_rank) for one in result.predictions] == [
        ("eggnog", 0, 4),
        ("racer", 0, 1),
    ]


def test_few_images_are_decoded_ahead(put, workspace, colour_classifier, monkeypatch):
    """Memory stays level: never more decoded images than a batch waiting and those that are read ahead."""
    for pose in range(80):
        put(f"real/racer/unpatched/{pose}.png", "racer")
    alive, most, lock = 0, 0, threading.Lock()
    real_crop, real_logits = read_pixels.read_crop, Classifier.logits

    def crop(*args):
        nonlocal alive, most
        with lock:
            alive += 1
            most = max(most, alive)
        return real_crop(*args)

    def logits(classifier, batch):
        nonlocal alive
        with lock:
            alive -= len(batch)
        return real_logits(classifier, batch)

    monkeypatch.setattr(read_pixels, "read_crop", crop)
    monkeypatch.setattr(Classifier, "logits", logits)
    captures = add_corrupted(read_captures(workspace.captures_dir), [("contrast", 1)]).captures
    found = predict_captures(captures, {"racer": 0}, colour_classifier, batch_size=4)
    assert len(found) == 160 and all(one.correct_top1 for one in found)
    assert most <= 4 + read_pixels.AHEAD + 1


def test_an_answer_depends_on_its_image_alone(put, workspace, colour_classifier):
    """Whatever the batch and whoever else is asked about, to the last bit: passes of another shape give other ones."""
    import torch

    class ByShape(torch.nn.Module):
        def forward(self, batch):
            means = batch.mean((2, 3)) * (1 + 0.1 * len(batch))
            return torch.cat([4 * means, torch.full_like(means[:, :1], 2.0)], dim=1)

    network = replace(colour_classifier, module=ByShape().eval())
    for pose in range(6):
        put(f"real/racer/unpatched/{pose}.png", ("racer", "warplane")[pose % 2])
    captures = read_captures(workspace.captures_dir).captures
    whole = predict_captures(captures, {"racer": 0}, network)
    for size in (1, 3, 4, 100):
        assert predict_captures(captures, {"racer": 0}, network, batch_size=size) == whole
    assert [one for capture in captures for one in predict_captures([capture], {"racer": 0}, network)] == whole
    pixels = [read_crop(capture, network.preprocessing) for capture in captures]
    streamed = predict_stream(enumerate(pixels), network, 3)
    assert [float(logits.softmax(0).max()) for _, logits in streamed] == [one.top1_prob for one in whole]


def test_warnings_of_decoders_do_not_reach_the_user(put, workspace, colour_classifier, monkeypatch):
    file = put("real/racer/unpatched/1.png", "racer")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 2000)
    assert Image.MAX_IMAGE_PIXELS < 64 * 48 and file.is_file()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = evaluate_captures(workspace.captures_dir, workspace, colour_classifier)
    assert result.predictions[0].is_read


def test_report_is_one_safe_file(shot, colour_classifier, put):
    evil = "<script>alert(1)<&script>_5.png"
    put(f"sim/racer/patched/{evil}", "racer")
    result = evaluate_captures(shot.captures_dir, shot, colour_classifier)
    html = result.report_file.read_text(encoding="utf-8")
    assert html.count("<script") == 1, "the page's own, which makes cards of rows"
    assert "<script>alert" not in html and "&lt;script&gt;" in html
    assert not re.findall(r"""(?:src|href)=["'](?!data:image/jpeg;base64,|#)""", html)
    assert not re.findall(r"https?://", html)
    assert html.count("<img ") >= 32
    assert "The patch" in html or "too few to be sure" in html or "not enough to tell" in html
    assert "ab" * 32 in html
    assert "No chart for <b>sim</b>" in html
    longest = max(len(uri) for uri in re.findall(r"base64,([^\"]+)", html))
    assert longest * 3 / 4 <= 12_000
