"""A run's folder: no result is written over another one, and all who read a run find files changed by hand."""

import json
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.compare_tables import compare_tables
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.run_files import (
    find_run_dir,
    hash_summary,
    lacks_other_inputs,
    lacks_other_table,
    write_run,
)
from toolkit.evaluation.summaries import build_runs_table, open_run
from toolkit.imaging.preprocessing import Preprocessing


@pytest.fixture
def night(put, workspace, colour_classifier):
    """One run of four images, of which two are right."""
    for variant, says in (("unpatched", "warplane"), ("patched", "racer")):
        for pose in (1, 2):
            put(f"sim/racer/{variant}/{pose}.png", says)
    return evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(run="night"))


def run_command(workspace, *words):
    return CliRunner().invoke(app, [*words, "--workspace", str(workspace.root)])


def test_the_summary_holds_the_hash_of_its_table_and_its_own(night):
    content = json.loads((night.run_dir / "summary.json").read_text())
    assert content["predictions_sha256"] == sha256_file(night.run_dir / "predictions.csv")
    assert content["content_sha256"] == hash_summary(content)


COMMANDS = (("runs",), ("report", "night"), ("report", "--all"), ("compare", "night", "night"),
            ("export", "night", "--to", "csv"))  # fmt: skip


@pytest.mark.parametrize("words", COMMANDS)
@pytest.mark.parametrize("changed", ["predictions.csv", "summary.json"])
def test_all_who_read_a_run_refuse_one_that_was_changed(night, workspace, words, changed):
    file = night.run_dir / changed
    text = file.read_text()
    file.write_text(
        text.replace(",0,1,ok", ",1,1,ok", 1) if changed[0] == "p" else text.replace('"top1": 0', '"top1": 1', 1)
    )
    assert file.read_text() != text
    done = run_command(workspace, *words)
    said = f"{done.output} {done.stderr} {done.exception}"
    assert done.exit_code != 0 and f"{changed} was changed after" in said, said


@pytest.mark.parametrize("words", COMMANDS)
def test_an_untouched_run_is_read(night, workspace, words):
    assert run_command(workspace, *words).exit_code == 0


def test_a_summary_that_was_only_laid_out_anew_is_read(night, workspace):
    file = night.run_dir / "summary.json"
    file.write_text(json.dumps(json.loads(file.read_text()), sort_keys=True))
    assert open_run(workspace, "night").rows


def test_an_older_summary_is_read_as_before(night, workspace, as_older):
    as_older(night.run_dir)
    file = night.run_dir / "predictions.csv"
    file.write_text(file.read_text() + "\n")
    assert open_run(workspace, "night").rows


def test_another_result_goes_beside(tmp_path):
    wanted = tmp_path / "run"
    for k, text in enumerate(("a\n", "b\n", "a\n", "c\n")):
        folder = find_run_dir(wanted, lacks_other_table("predictions.csv", text))
        assert folder.name == ("run", "run-2", "run", "run-3")[k]
        write_run(folder, {"schema_version": 1}, {"predictions.csv": text})


def test_what_is_not_finished_is_gone_on_with(tmp_path):
    """The question is known before the answer: a folder without a summary is one that was interrupted."""
    wanted = tmp_path / "run"
    wanted.mkdir()
    assert find_run_dir(wanted, lacks_other_inputs("one")) == wanted
    write_run(wanted, {"inputs_sha256": "one"}, {})
    assert find_run_dir(wanted, lacks_other_inputs("one")) == wanted
    assert find_run_dir(wanted, lacks_other_inputs("two")).name == "run-2"
    assert find_run_dir(wanted, lacks_other_inputs("two"), overwrite=True) == wanted


def test_the_note_on_another_result_is_in_the_summary(night, put, workspace, colour_classifier):
    put("sim/racer/patched/1.png", "warplane")
    again = evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(run="night"))
    assert again.run_dir.name == "night-2"
    assert f"{night.run_dir} holds another result, and stays as it is" in again.summary["notes"]


@pytest.fixture
def twins(put, workspace, colour_classifier):
    """Runs `m1` and `m1b` of networks with one name and file, whose labels are swapped; `small` sees images smaller."""
    for pose in (1, 2, 3):
        put(f"sim/racer/unpatched/{pose}.png", "racer")
    labels = ["warplane", "racer", *colour_classifier.labels[2:]]
    how = Preprocessing(30, 28, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    networks = {
        "m1": colour_classifier, "m1b": replace(colour_classifier, labels=labels),
        "small": replace(colour_classifier, preprocessing=how),
    }  # fmt: skip
    for name, network in networks.items():
        evaluate_captures(workspace.captures_dir, workspace, network, EvalConfig(run=name))
    return workspace


def test_a_network_is_its_labels_and_preprocessing_too(twins):
    runs = [open_run(twins, name) for name in ("m1", "m1b", "small")]
    assert len({run.network.network_id for run in runs}) == 3
    assert len({run.network.sha256 for run in runs}) == 1
    table = build_runs_table([row for run in runs for row in run.rows])
    shown = next([str(cell) for cell in column.cells] for column in table.columns if column.header == "network")
    assert len(set(shown)) == 3 and all(cell.startswith("colours ") for cell in shown)
    alone = build_runs_table(runs[0].rows)
    (shown,) = ({str(cell) for cell in column.cells} for column in alone.columns if column.header == "network")
    assert shown == {"colours"}


def test_compare_says_first_that_labels_are_swapped(twins):
    done = run_command(twins, "compare", "m1", "m1b")
    said = done.stderr
    assert done.exit_code == 0
    assert (
        "different lists of labels, though their weights are the same file: output 0 is 'racer' and 'warplane'" in said
    )
    content = json.loads(run_command(twins, "compare", "m1", "m1b", "--json").stdout)
    assert any("different lists of labels" in note for note in content["notes"])
    page = (twins.eval_dir / "comparisons/m1-vs-m1b.html").read_text()
    assert page.index("different lists of labels") < page.index('id="table"')


def test_compare_says_first_that_images_are_seen_differently(twins):
    said = run_command(twins, "compare", "m1", "small").stderr
    assert "the networks see images differently: short side resized to 32 px" in said and "30 px" in said
    assert "labels" not in said


def test_compare_says_first_that_the_true_class_changed(put, workspace, colour_classifier):
    put("sim/thing/unpatched/1.png", "racer")
    spec = workspace.root / "rig/objects/thing.toml"
    spec.parent.mkdir(parents=True)
    for name, label in (("before", "racer"), ("after", "warplane")):
        spec.write_text(f'class = "{label}"\nmesh = "builtin:racer"\nlength_mm = 100\n')
        evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(run=name))
    said = run_command(workspace, "compare", "before", "after").stderr
    assert "the true class differs in 1 of 1 images: 'racer' in before, 'warplane' in after" in said


def test_runs_of_several_objects_are_tested_over_objects(put, workspace, colour_classifier):
    for name in ("racer", "warplane", "coffeepot"):
        for pose in range(1, 4):
            put(f"sim/{name}/unpatched/{pose}.png", name)
    evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(run="one"))
    put("sim/racer/unpatched/1.png", "warplane")
    evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(run="two"))
    content = json.loads(run_command(workspace, "compare", "one", "two", "--json").stdout)
    assert content["over_clusters"]["clusters"] == 3 and content["cluster_by"] == "object"


def test_an_edit_of_numbers_alone_is_found(tmp_path):
    write_run(tmp_path, {"schema_version": 1, "groups": [], "notes": []}, {})
    file = tmp_path / "summary.json"
    file.write_text(file.read_text().replace('"notes": []', '"notes": ["fine"]'))
    from toolkit.evaluation.summaries import read_run

    with pytest.raises(ToolkitError, match=r"summary\.json was changed after the run"):
        read_run(tmp_path, "run")


def test_a_runs_own_table_that_was_changed_is_refused_as_a_table_too(night, tmp_path):
    table = night.run_dir / "predictions.csv"
    copy = tmp_path / "predictions.csv"
    copy.write_bytes(table.read_bytes())
    (tmp_path / "summary.json").write_text("[]")  # another program's
    compare_tables(table, copy)
    table.write_text(table.read_text().replace(",0,1,ok", ",1,1,ok", 1))
    with pytest.raises(ToolkitError, match=r"predictions\.csv was changed after"):
        compare_tables(table, copy)
