"""Predictions as Parquet and as a folder for FiftyOne, read back by what does not know this package."""

import csv
import json
import runpy
import shutil
import sys
from unittest.mock import MagicMock

import pytest
from typer.testing import CliRunner

from toolkit.captures.capture import Capture
from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.files import write_json, write_text
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.export import export_predictions, write_csv, write_fiftyone, write_parquet
from toolkit.evaluation.prediction import Detection
from toolkit.evaluation.predictions_csv import (
    DETECTION_COLUMNS,
    encode_detections,
    make_detected,
    predictions_table,
    read_predictions,
)
from toolkit.evaluation.summaries import open_run
from toolkit.imaging.read import read_image

parquet = pytest.importorskip("pyarrow.parquet")


@pytest.fixture
def evaluated(put, workspace, colour_classifier):
    for pose in (1, 2):
        put(f"sim/racer/unpatched/{pose}.png", "warplane")
        put(f"sim/racer/patched/{pose}.png", "racer")
    (workspace.captures_dir / "sim/racer/patched/3.png").write_bytes(b"no picture")
    evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(run="night"))
    config = EvalConfig(run="fog", corruptions=(("fog", 3),))
    evaluate_captures(workspace.captures_dir, workspace, colour_classifier, config)
    return workspace


def test_parquet_holds_what_the_csv_holds(evaluated, tmp_path):
    file = tmp_path / "all.parquet"
    assert write_parquet(file, evaluated, [open_run(evaluated, "night"), open_run(evaluated, "fog")]) == 15
    table = parquet.read_table(file).to_pandas()
    own = table[table.run == "night"].reset_index(drop=True)
    said = predictions_table(evaluated.eval_dir / "night")
    for name in set(said.columns) - {"failed_gates", "top1_prob", "true_prob"}:
        assert [None if one != one or one is None else one for one in own[name].astype(object)] == [
            None if str(one) == "<NA>" else one for one in said[name].astype(object)
        ], name
    fog = table[table.source == "sim-fog-3"]
    assert set(fog.condition) == {"fog"} and set(fog.severity) == {3} and set(table.network) == {"colours"}
    assert own.correct_top1.isna().sum() == 1  # the image that is no picture


def test_the_same_runs_give_the_same_bytes(evaluated, tmp_path):
    runs = [open_run(evaluated, "night")]
    for name in ("a", "b"):
        write_parquet(tmp_path / name, evaluated, runs)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert parquet.read_table(tmp_path / "a").num_rows == 5


def test_without_pyarrow_the_error_names_the_extra(evaluated, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(ToolkitError, match=r"\.\[parquet\]"):
        write_parquet(tmp_path / "x", evaluated, [])


def test_fiftyone_finds_every_image_and_label(evaluated, tmp_path):
    """As FiftyOneImageClassificationDataset is documented, with a `data.json`: ids without dots, absolute files."""
    out = tmp_path / "out"
    call = ["export", "--to", "fiftyone", "--out", str(out), "--workspace", str(evaluated.root)]
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 0 and "4 images, 2 runs" in done.stdout
    assert "left out 7 answers" in done.stderr  # five in fog without files of their own, one unread image in each run
    places = json.loads((out / "data.json").read_text())
    assert all(evaluated.captures_dir / "sim" in __import__("pathlib").Path(file).parents for file in places.values())
    fields = {file.stem: json.loads(file.read_text())["labels"] for file in (out / "labels").iterdir()}
    assert set(fields) == {"ground_truth", "object", "variant", "source", "prediction_night", "prediction_fog"}
    assert all(set(labels) == set(places) for labels in fields.values())
    for key, file in places.items():
        answer = fields["prediction_night"][key]
        assert answer["label"] == ("racer" if "/patched/" in file else "warplane") and 0 < answer["confidence"] <= 1
        assert fields["ground_truth"][key] == "racer" and fields["variant"][key] in file
    compile((out / "load.py").read_text(), "load.py", "exec")


def test_what_cannot_be_exported_is_a_line(workspace, evaluated):
    call = ["export", "--workspace", str(workspace.root)]
    done = CliRunner().invoke(app, [*call, "--to", "excel"])
    assert "--to excel: expected parquet, csv, fiftyone, coco, imagefolder" in str(done.exception)
    done = CliRunner().invoke(app, [*call, "--to", "coco"])
    assert "holds no run of a detector: make one with 'toolkit eval'" in str(done.exception)
    done = CliRunner().invoke(app, ["export", "night", *call[1:], "--to", "coco"])
    assert "night holds no boxes (kind 'eval'): expected a run of a detector" in str(done.exception)
    done = CliRunner().invoke(app, [*call, "--to", "fiftyone", "--captures", str(workspace.root / "nowhere")])
    assert "no image of fog, night is there" in str(done.exception)
    done = CliRunner().invoke(app, [*call, "--out", str(workspace.root / "night.csv")])
    assert "night.csv: parquet would be written under a name of csv: give --to csv" in str(done.exception)
    assert not (workspace.root / "night.csv").exists()


def test_one_run_is_not_several(evaluated, tmp_path):
    call = ["export", "night", "--to", "csv", "--out", str(tmp_path / "x.csv"), "--workspace", str(evaluated.root)]
    assert "predictions of 1 run: " in CliRunner().invoke(app, call).output


def test_a_run_that_is_named_twice_counts_once(evaluated, tmp_path):
    out = tmp_path / "x.csv"
    call = ["export", "night", str(evaluated.eval_dir / "night"), "--to", "csv", "--out", str(out)]
    assert "5 predictions of 1 run: " in CliRunner().invoke(app, [*call, "--workspace", str(evaluated.root)]).output
    assert len(out.read_text().splitlines()) == 1 + 5


@pytest.mark.parametrize("form", ["fiftyone", "imagefolder"])
def test_two_runs_of_one_short_name_are_not_mixed(evaluated, tmp_path, form):
    for name in ("night-1", "night_1"):
        shutil.copytree(evaluated.eval_dir / "night", evaluated.eval_dir / name)
    with pytest.raises(ToolkitError, match=r"night-1 and night_1 would both be called night_1"):
        export_predictions(evaluated, ["night-1", "night_1"], form, tmp_path / form)


def test_fiftyone_does_not_load_the_labels_of_an_earlier_export(
    evaluated, put, colour_classifier, tmp_path, monkeypatch
):
    """The second export numbers other images: an earlier run's predictions would land on them."""
    out = tmp_path / "out"
    export_predictions(evaluated, ["night"], "fiftyone", out)
    put("sim/racer/unpatched/0.png", "racer")
    (evaluated.captures_dir / "sim/racer/patched/1.png").unlink()
    evaluate_captures(evaluated.captures_dir, evaluated, colour_classifier, EvalConfig(run="late"))
    export_predictions(evaluated, ["late"], "fiftyone", out)
    # what load.py asks FiftyOne to merge
    fake = MagicMock()
    monkeypatch.setitem(sys.modules, "fiftyone", fake)
    monkeypatch.setattr(sys, "argv", ["load.py"])
    runpy.run_path(str(out / "load.py"))
    merged = {call.kwargs["label_field"] for call in fake.Dataset.return_value.merge_dir.call_args_list}
    assert merged == {"ground_truth", "object", "variant", "source", "prediction_late"}


BOX, FITTING = (10.0, 20.0, 50.0, 60.0), (12.0, 20.0, 52.0, 60.0)


@pytest.fixture
def detected(put, workspace):
    """A detector's run: found, seen as a dog, and an image that is no picture."""
    said = [Detection(BOX, True, 0.9, 0.9, FITTING, "car", 0.9), Detection(BOX, False, strongest_label="dog",
            strongest_score=0.7), Detection(BOX)]  # fmt: skip
    rows = []
    for pose, one in enumerate(said, 1):
        path = f"sim/racer/unpatched/{pose}.png"
        file = put(path, "racer")
        capture = Capture("sim", "racer", "unpatched", pose, file, path)
        rows.append(make_detected(capture, "car", one, "ok" if one.found is not None else "is no picture"))
    group = {"source": "sim", "object": "racer", "variant": "unpatched", "n": 2, "failed": 1, "found": 0.5}
    group |= {"recall50": 1.0, "ap50": 0.4, "ap50_95": 0.2, "mean_score": 0.3, "found_ci95": [0.1, 0.9]}
    summary = {"schema_version": 1, "kind": "detections", "model": {"name": "yolo"}, "groups": [group], "pairs": []}
    write_json(workspace.eval_dir / "yolo/summary.json", summary)
    write_text(workspace.eval_dir / "yolo/detections.csv", encode_detections(rows))
    assert read_predictions(open_run(workspace, "yolo"), workspace.captures_dir) == rows
    return workspace


def test_a_detectors_run_is_exported_with_its_boxes_and_no_classifiers_columns(detected, tmp_path):
    run = open_run(detected, "yolo")
    assert write_parquet(tmp_path / "x.parquet", detected, [run]) == 3
    table = parquet.read_table(tmp_path / "x.parquet")
    assert table.column_names == ["run", "network", "condition", "severity", *DETECTION_COLUMNS]
    first, second, third = table.to_pylist()
    assert (first["true_box"], first["box"], first["found"]) == (list(BOX), list(FITTING), True)
    assert (second["box"], second["found"], second["strongest_label"]) == (None, False, "dog")
    assert (third["found"], third["score"], third["status"]) == (None, None, "is no picture")
    call = ["export", "yolo", "--to", "csv", "--out", str(tmp_path / "x.csv"), "--workspace", str(detected.root)]
    assert CliRunner().invoke(app, call).exit_code == 0
    with (tmp_path / "x.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == table.column_names
    assert (rows[0]["box"], rows[0]["found"], rows[1]["box"]) == ("12.0 20.0 52.0 60.0", "1", "")


def test_mixed_runs_leave_empty_what_they_do_not_have(evaluated, detected, tmp_path):
    runs = [open_run(detected, "night"), open_run(detected, "yolo")]
    assert write_csv(tmp_path / "x.csv", detected, runs) == 8
    with (tmp_path / "x.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert (rows[0]["true_rank"] != "", rows[0]["found"]) == (True, "")
    assert (rows[-3]["true_rank"], rows[-3]["found"]) == ("", "1")


def test_cocos_own_reader_reads_the_boxes(detected, tmp_path):
    coco = pytest.importorskip("pycocotools.coco", reason="needs pycocotools: pip install pycocotools")
    call = ["export", "--to", "coco", "--out", str(tmp_path), "--workspace", str(detected.root)]
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 0 and "2 images, 1 run" in done.stdout and "left out 1 answers" in done.stderr
    truth = coco.COCO(str(tmp_path / "yolo/instances.json"))
    found = truth.loadRes(str(tmp_path / "yolo/results.json"))
    assert [one["bbox"] for one in truth.loadAnns(truth.getAnnIds())] == [[10, 20, 40, 40]] * 2
    (note,) = found.anns.values()
    assert (note["bbox"], note["score"], truth.loadCats(note["category_id"])[0]["name"]) == (
        [12, 20, 40, 40],
        0.9,
        "car",
    )
    (image,) = truth.loadImgs(note["image_id"])
    assert (detected.captures_dir / image["file_name"]).is_file() and image["width"] > 0


def test_fiftyone_has_the_boxes_in_shares_of_the_image(detected, tmp_path):
    assert write_fiftyone(tmp_path, detected, [open_run(detected, "yolo")]) == (2, 1)
    height, width = read_image(detected.captures_dir / "sim/racer/unpatched/1.png").shape[:2]
    fields = {file.stem: json.loads(file.read_text())["labels"] for file in (tmp_path / "labels").iterdir()}
    assert set(fields) == {"object", "variant", "source", "ground_truth_boxes", "prediction_yolo"}
    (seen,) = fields["prediction_yolo"]["000000"]
    assert seen["bounding_box"] == pytest.approx([12 / width, 20 / height, 40 / width, 40 / height])
    assert (seen["label"], seen["confidence"], seen["attributes"]["found"]) == ("car", 0.9, True)
    assert fields["prediction_yolo"]["000001"] == [] and fields["ground_truth_boxes"]["000001"]
