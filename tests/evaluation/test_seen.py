"""A booster judged by a network that it never saw: told by the weights' hash, said in table, JSON and report."""

import json
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from toolkit.captures.manifest import CaptureRecord, append_record
from toolkit.core.files import sha256_file
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.tables import build_tables, print_tables
from toolkit.models.identity import hash_network_tensors
from toolkit.objects.records import write_patch, write_texture

SEEN, OTHER = "ab" * 32, "cd" * 32


def record(name: str, *networks: tuple[str, str]) -> dict:
    return {
        "name": name, "class_name": name, "class_index": 0, "data": {}, "seed": 0, "settings": {}, "final": {},
        "networks": [{"arch": arch, "weights": f"{arch}.pth", "sha256": sha256} for arch, sha256 in networks],
        "toolkit_version": "0",
    }  # fmt: skip


@pytest.fixture
def shot(put, workspace):
    """A racer with a patch of the network, a warplane with one of another's, and a texture of another's."""
    pixels = np.zeros((8, 8, 3), np.uint8)
    racer = write_patch(workspace.patches_dir, pixels, record("racer", ("colours", SEEN), ("resnet18", OTHER)))
    warplane = write_patch(workspace.patches_dir / "mine", pixels + 9, record("warplane", ("resnet18", OTHER)))
    worn = [{"name": "racer", "mesh_sha256": "0" * 64, "keep": []}]
    texture = write_texture(
        workspace.textures_dir, pixels + 99, record("racer", ("colours", OTHER)) | {"objects": worn}
    )
    boosters = {
        ("racer", "patched"): racer.record.png_sha256, ("warplane", "patched"): warplane.record.png_sha256,
        ("racer", "textured"): texture.record.png_sha256, ("racer", "grey-patch"): "9" * 64,
    }  # fmt: skip
    for name, variant in [("racer", "unpatched"), ("warplane", "unpatched"), *boosters]:
        for pose in (1, 2):
            path = f"{name}/{variant}/pose_{pose:02d}.png"
            put(f"sim/{path}", name)
            append_record(
                workspace.captures_dir / "sim",
                CaptureRecord(
                    path=path, object=name, variant=variant, pose_id=pose, booster_sha256=boosters.get((name, variant))
                ),
            )
    return workspace


def test_the_summary_says_which_network_each_booster_saw(shot, colour_classifier):
    done = evaluate_captures(shot.captures_dir, shot, colour_classifier)
    found = {(one["object"], one["variant"]): one for one in done.summary["boosters"]}
    assert {key: one["seen"] for key, one in found.items()} == {
        ("racer", "patched"): True, ("warplane", "patched"): False, ("racer", "textured"): False,
    }  # fmt: skip
    assert found["warplane", "patched"]["networks"] == [
        {"arch": "resnet18", "weights": "resnet18.pth", "sha256": OTHER}
    ]
    assert json.loads((done.run_dir / "summary.json").read_text())["boosters"] == done.summary["boosters"]


def test_table_and_words_say_it(shot, colour_classifier):
    done = evaluate_captures(shot.captures_dir, shot, colour_classifier)
    console = Console(width=200, record=True, file=StringIO())
    print_tables(console, done, "colours")
    text = console.export_text()
    (table,) = build_tables(done.groups, done.pairs, training=done.training)
    columns = {str(column.header): [str(cell) for cell in column.cells] for column in table.columns}
    rows = list(zip(columns["variant"], columns["seen"], strict=True))
    assert rows == [
        ("unpatched", ""), ("patched", "yes"), ("textured", "no"), ("grey-patch", ""),  # racer
        ("unpatched", ""), ("patched", "no"),  # warplane
        ("unpatched", ""), ("patched", "partly"), ("textured", "no"), ("grey-patch", ""),  # all
    ]  # fmt: skip
    assert "sim: patched (warplane) was trained on resnet18; colours was not seen in training" in text
    assert "sim: textured (racer) was trained on colours with other weights; colours was not seen in training" in text


def test_the_report_says_it(shot, colour_classifier):
    html = evaluate_captures(shot.captures_dir, shot, colour_classifier).report_file.read_text(encoding="utf-8")
    assert "Judged by a network that was not seen in training" in html
    assert html.count(">(unseen)<") == 3 and html.count(">(partly unseen)<") == 1, "also the pooled row of textures"


def test_where_the_network_was_seen_nothing_is_said(shot, colour_classifier):
    config = EvalConfig(objects=("racer",), variants=("unpatched", "patched"))
    done = evaluate_captures(shot.captures_dir, shot, colour_classifier, config)
    console = Console(width=200, record=True, file=StringIO())
    print_tables(console, done, "colours")
    assert "seen" not in console.export_text()
    assert "not seen in training" not in done.report_file.read_text(encoding="utf-8")
    assert [one["seen"] for one in done.summary["boosters"]] == [True]


def test_captures_without_a_manifest_are_judged_as_before(put, workspace, colour_classifier):
    put("real/racer/patched/1.png", "racer")
    assert evaluate_captures(workspace.captures_dir, workspace, colour_classifier).summary["boosters"] == []


def test_weights_saved_again_are_seen_by_their_numbers(shot, colour_classifier, tmp_path):
    """The same numbers in a file of other bytes are no other network: its own patch is no transfer."""
    import torch

    module = torch.nn.Sequential(colour_classifier.module, torch.nn.BatchNorm2d(4)).eval()
    module.forward = colour_classifier.module.forward
    judge = replace(colour_classifier, module=module, weights=replace(colour_classifier.weights, sha256="ef" * 32))
    tensors = hash_network_tensors(judge)
    file = shot.patches_dir / "mine" / "warplane.json"
    content = json.loads(file.read_text())
    for recorded, seen in ((tensors, True), ("0" * 64, False)):
        content["networks"][0]["tensors_sha256"] = recorded
        file.write_text(json.dumps(content))
        done = evaluate_captures(shot.captures_dir, shot, judge)
        found = {(one["object"], one["variant"]): one["seen"] for one in done.summary["boosters"]}
        assert found == {("racer", "patched"): False, ("warplane", "patched"): seen, ("racer", "textured"): False}


def test_an_older_record_is_seen_by_the_file_that_it_names(shot, colour_classifier):
    import torch

    module = torch.nn.Sequential(colour_classifier.module, torch.nn.BatchNorm2d(4)).eval()
    module.forward = colour_classifier.module.forward
    file = shot.classifiers_dir / "resnet18.pth"
    file.parent.mkdir(parents=True)
    torch.save(module.state_dict(), file)
    record_file = shot.patches_dir / "mine" / "warplane.json"
    record_file.write_text(record_file.read_text().replace(OTHER, sha256_file(file)))
    judge = replace(colour_classifier, module=module, weights=replace(colour_classifier.weights, sha256="ef" * 32))
    done = evaluate_captures(shot.captures_dir, shot, judge)
    assert {one["seen"] for one in done.summary["boosters"] if one["object"] == "warplane"} == {True}


def test_a_booster_for_another_label_than_is_judged_is_noted(shot, colour_classifier):
    """`class = 1` is another class in another list of labels: the record holds the label, and it is compared."""
    spec = shot.root / "rig/objects/racer.toml"
    spec.parent.mkdir(parents=True)
    spec.write_text('class = 1\nmesh = "builtin:racer"\nlength_mm = 100\n')
    done = evaluate_captures(shot.captures_dir, shot, colour_classifier)
    note = "sim: patched (racer) was trained for 'racer', and is judged as 'warplane'"
    assert note in done.summary["notes"] and "sim: patched (warplane)" not in "".join(done.summary["notes"])
    assert "is judged as" in done.report_file.read_text()
    spec.write_text('class = 0\nmesh = "builtin:racer"\nlength_mm = 100\n')
    assert not any(
        "is judged as" in note for note in evaluate_captures(shot.captures_dir, shot, colour_classifier).notes
    )


def test_a_networks_own_warnings_belong_to_its_results(shot, colour_classifier):
    """What may make all answers wrong stands in the summary and the report, whatever the terminal shows."""
    doubtful = replace(colour_classifier, notes=("its images may be normalised otherwise",))
    done = evaluate_captures(shot.captures_dir, shot, doubtful)
    assert done.summary["notes"][0] == done.notes[0] == doubtful.notes[0]
    assert doubtful.notes[0] in done.report_file.read_text()
