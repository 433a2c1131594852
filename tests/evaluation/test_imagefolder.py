"""Captures as an image folder for the Hub: read back by its own library and by Croissant's, where installed."""

import json
from pathlib import Path

import pytest
from one_line import error_of

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.export import export_predictions
from toolkit.evaluation.imagefolder import COLUMNS

# Croissant format specification 1.0, "Dataset-level information": what it requires and the file alone decides
REQUIRED = {"@context", "@type", "conformsTo", "description", "name", "distribution", "recordSet"}


@pytest.fixture
def captured(put, workspace, colour_classifier):
    for pose in (1, 2):
        put(f"sim/racer/unpatched/{pose}.png", "warplane")
        put(f"sim/racer/patched/{pose}.png", "racer")
    put("real/racer/patched/a train.png", "racer")
    (workspace.captures_dir / "sim/racer/patched/3.png").write_bytes(b"no picture")
    evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(run="night"))
    return workspace


def read_rows(folder: Path) -> dict[str, dict]:
    lines = (folder / "test/metadata.jsonl").read_text().splitlines()
    return {row["file_name"]: row for row in map(json.loads, lines)}


def test_every_image_is_there_with_its_label(captured, tmp_path):
    done = export_predictions(captured, ["night"], "imagefolder", tmp_path / "out")
    assert (done.count, done.left_out) == (5, 1)
    rows = read_rows(tmp_path / "out")
    assert len(rows) == 5 and all(list(row)[: len(COLUMNS)] == list(COLUMNS) for row in rows.values())
    for name, row in rows.items():
        content = (tmp_path / "out/test" / name).read_bytes()
        assert content == (captured.captures_dir / name).read_bytes() and row["image_sha256"] == sha256_bytes(content)
        assert (row["label"], row["object"]) == ("racer", "racer") and f"/{row['variant']}/" in name
        assert row["night_correct"] == (row["variant"] == "patched") and 0 < row["night_prob"] <= 1
    listed = {str(file.relative_to(tmp_path / "out/test")) for file in (tmp_path / "out/test").rglob("*.png")}
    assert listed == set(rows)


def test_a_run_of_other_images_is_not_an_empty_column(captured, put, colour_classifier, tmp_path):
    """A sweep's images lie elsewhere, here under the same names: its answers are of none of the exported images."""
    (captured.eval_dir / "sweeps/distance").mkdir(parents=True)
    captured.captures_dir.rename(captured.eval_dir / "sweeps/distance/captures")
    put("sim/racer/patched/1.png", "racer")
    run = captured.eval_dir / "sweeps/distance/colours"
    (captured.eval_dir / "night").rename(run)
    summary = json.loads((run / "summary.json").read_text())
    summary.pop("content_sha256", None)
    (run / "summary.json").write_text(json.dumps(summary | {"kind": "sweep"}))
    with pytest.raises(
        ToolkitError, match=r"sweeps/distance/colours judged none of the images in .*captures: leave it"
    ):
        export_predictions(captured, ["sweeps/distance/colours"], "imagefolder", tmp_path)


def test_the_card_tells_the_hub_where_the_images_are(captured, tmp_path):
    export_predictions(captured, (), "imagefolder", tmp_path)
    yaml = pytest.importorskip("yaml", reason="needs PyYAML, which comes with the extra site")
    _, head, body = (tmp_path / "README.md").read_text().split("---\n", 2)
    settings = yaml.safe_load(head)
    assert settings["configs"] == [{"config_name": "default", "data_files": [{"split": "test", "path": "test/**"}]}]
    assert settings["size_categories"] == ["n<1K"] and settings["task_categories"] == ["image-classification"]
    assert "| sim | racer | racer | unpatched | 2 |" in body
    assert all(f"| `{name}` |" in body for name in COLUMNS) and "night" not in body


def test_croissant_describes_the_table(captured, tmp_path):
    export_predictions(captured, ["night"], "imagefolder", tmp_path)
    content = json.loads((tmp_path / "croissant.json").read_text())
    assert set(content) >= REQUIRED and content["conformsTo"] == "http://mlcommons.org/croissant/1.0"
    table = content["distribution"][0]
    assert table["sha256"] == sha256_bytes((tmp_path / table["contentUrl"]).read_bytes())
    (records,) = content["recordSet"]
    assert {one["name"] for one in records["field"]} == set(next(iter(read_rows(tmp_path).values())))


def test_croissants_own_reader_takes_it(captured, tmp_path):
    mlcroissant = pytest.importorskip("mlcroissant", reason="needs mlcroissant")
    export_predictions(captured, ["night"], "imagefolder", tmp_path)
    found = mlcroissant.Dataset(jsonld=tmp_path / "croissant.json")
    assert not found.metadata.issues.errors
    rows = list(found.records("captures"))
    said = {row["captures/file_name"].decode(): row["captures/night_label"].decode() for row in rows}
    assert said == {name: row["night_label"] for name, row in read_rows(tmp_path).items()}


def test_the_hubs_own_reader_takes_it(captured, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    datasets = pytest.importorskip("datasets", reason="needs datasets")
    export_predictions(captured, (), "imagefolder", tmp_path / "out")
    for call in ({"path": str(tmp_path / "out")}, {"path": "imagefolder", "data_dir": str(tmp_path / "out")}):
        images = datasets.load_dataset(**call, split="test", cache_dir=str(tmp_path / "cache"))
        assert len(images) == 5 and set(images["variant"]) == {"patched", "unpatched"}
        assert images[0]["image"].size == (64, 48)


def test_a_second_export_leaves_nothing_of_the_first(captured, tmp_path):
    export_predictions(captured, (), "imagefolder", tmp_path / "out")
    (tmp_path / "out/test/notes.txt").write_text("mine")
    first = {file: file.read_bytes() for file in (tmp_path / "out").rglob("*") if file.is_file()}
    export_predictions(captured, (), "imagefolder", tmp_path / "out")
    assert {file: file.read_bytes() for file in (tmp_path / "out").rglob("*") if file.is_file()} == first
    (captured.captures_dir / "sim/racer/patched/2.png").unlink()
    export_predictions(captured, (), "imagefolder", tmp_path / "out")
    assert not (tmp_path / "out/test/sim/racer/patched/2.png").exists() and len(read_rows(tmp_path / "out")) == 4
    assert (tmp_path / "out/test/notes.txt").read_text() == "mine"
    # what another program wrote there is not taken for ours, and no line leads out of the folder
    metadata = tmp_path / "out/test/metadata.jsonl"
    metadata.write_text("[1]\n")
    line = error_of(lambda: export_predictions(captured, (), "imagefolder", tmp_path / "out"))
    assert "was not written by this command" in line
    (tmp_path / "kept.png").write_bytes(b"mine")
    metadata.write_text('{"file_name": "../../kept.png"}\n')
    assert error_of(lambda: export_predictions(captured, (), "imagefolder", tmp_path / "out"))
    assert (tmp_path / "kept.png").exists()


def test_without_images_a_line_says_so(workspace, tmp_path, put):
    def export(form: str) -> str:
        return error_of(lambda: export_predictions(workspace, (), form, tmp_path / "out"))

    assert "expected a folder of images" in export("imagefolder")
    put("sim/racer/patched/1.png", "racer").write_bytes(b"no picture")
    assert "none of 1 images can be read" in export("imagefolder")
    assert "expected parquet, csv" in export("hub") and not (tmp_path / "out").exists()
