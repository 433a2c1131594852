"""Predictions as Parquet and as a folder for FiftyOne, read back by what does not know this package."""

import json

import pytest
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.evaluation.eval_config import EvalConfig
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.export import read_parquet, write_parquet
from toolkit.evaluation.notebook import predictions_table
from toolkit.evaluation.runs import open_run

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
    assert read_parquet(tmp_path / "a").num_rows == 5


@pytest.mark.parametrize(
    ("version", "words"),
    [(b"2", "was written by a newer toolkit (schema version 2"), (None, "holds no predictions of toolkit")],
)
def test_a_table_of_a_newer_or_another_program_is_a_line(tmp_path, version, words):
    import pyarrow

    table = pyarrow.table({"run": ["night"]})
    if version:
        table = table.replace_schema_metadata({b"toolkit_schema_version": version})
    parquet.write_table(table, tmp_path / "new.parquet")
    with pytest.raises(ToolkitError) as refused:
        read_parquet(tmp_path / "new.parquet")
    assert words in str(refused.value) and "\n" not in str(refused.value)


def test_a_damaged_table_is_a_line(evaluated, tmp_path):
    file = tmp_path / "all.parquet"
    write_parquet(file, evaluated, [open_run(evaluated, "night")])
    file.write_bytes(file.read_bytes()[:-20])
    with pytest.raises(ToolkitError, match="is no Parquet file, or damaged"):
        read_parquet(file)


def test_without_pyarrow_the_error_names_the_extra(evaluated, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(ToolkitError, match=r"toolkit-boost\[parquet\]"):
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
    done = CliRunner().invoke(app, [*call, "--to", "csv"])
    assert "--to csv: expected parquet or fiftyone" in str(done.exception)
    done = CliRunner().invoke(app, [*call, "--to", "fiftyone", "--captures", str(workspace.root / "nowhere")])
    assert "none of the images of fog, night is there" in str(done.exception)
