"""What a result rests on: told in terminal, summary and report; copies count once; a result can be made again."""

import json

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from toolkit.captures.capture import Capture
from toolkit.captures.manifest import CaptureRecord, append_record
from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.tables import print_tables
from toolkit.evaluation.twins import TwinFinder
from toolkit.evaluation.verify import verify_run


def shoot(workspace, put, says="racer", light="studio", **more):
    """Eight poses, of which the bare ones are called eggnog; each with its line."""
    root = workspace.captures_dir / "sim"
    for variant, answer in (("unpatched", "eggnog"), ("patched", says)):
        for pose in range(1, 9):
            path = f"racer/{variant}/pose_{pose:02d}.png"
            put(f"sim/{path}", answer)
            append_record(root, CaptureRecord(
                path=path, object="racer", variant=variant, pose_id=pose, image_sha256=sha256_file(root / path),
                booster_sha256=None if variant == "unpatched" else "ab" * 32,
                made={"renderer": "raycast", "studio": f"oak/{light}/0-1", "seed": 0, "booster": "racer"},
            ))  # fmt: skip
    return root


def evaluate(workspace, classifier, **more):
    return evaluate_captures(workspace.captures_dir, workspace, classifier, EvalConfig(saliency=False, **more))


def test_a_result_states_what_it_rests_on(workspace, put, colour_classifier, capsys):
    root = shoot(workspace, put)
    (root / "racer/patched/pose_01.png").write_bytes((root / "racer/patched/pose_02.png").read_bytes())
    done = evaluate(workspace, colour_classifier)
    rests = json.loads((done.run_dir / "summary.json").read_text())["rests_on"]
    assert rests["counted"] == 15 and rests["trusted_files"] is False
    (fault,) = rests["set_aside"]
    assert fault["path"] == "sim/racer/patched/pose_01.png" and fault["fault"]
    assert rests["sources"][0]["boosters"] == [{"variant": "patched", "name": "racer", "sha256": "abababab"}]
    assert rests["sources"][0]["lights"] == ["studio"] and rests["sources"][0]["controls"] == []
    page = done.report_file.read_text()
    assert "What was evaluated" in page and "1 image set aside" in page and "Was a folder or file renamed" in page
    from rich.console import Console

    from toolkit.core.console import verbosely

    print_tables(Console(width=120), done)
    said = capsys.readouterr().out
    assert "images: 15 counted; 1 set aside: manifest.jsonl lists this picture in another place\n" in said
    assert "no control was shot (sim): the report says how" in said and "rendered by" not in said
    with verbosely():
        print_tables(Console(width=120), done)
    said = capsys.readouterr().out
    assert "sim: 15 images, compared with manifest.jsonl; rendered by raycast, studio light; no controls" in said


def test_trusted_files_count_and_the_result_says_so_for_ever(workspace, put, colour_classifier):
    root = shoot(workspace, put)
    put("sim/racer/patched/pose_01.png", "warplane")
    assert len(evaluate(workspace, colour_classifier).predictions) == 15
    done = evaluate(workspace, colour_classifier, trust_files=True, run="trusted")
    assert len(done.predictions) == 16
    assert "files were trusted over their manifest" in done.report_file.read_text()
    assert json.loads((done.run_dir / "summary.json").read_text())["rests_on"]["trusted_files"] is True
    assert root.is_dir()


def test_the_command_ends_with_1_where_a_folder_contradicts_itself(workspace, put):
    for pose in (1, 2):
        for variant in ("unpatched", "patched"):
            put(f"sim/racer/{variant}/pose_0{pose}.png", "racer")
    root = workspace.captures_dir / "sim"
    for path in sorted(root.rglob("*.png"))[:3]:
        name = path.relative_to(root).as_posix()
        variant = name.split("/")[1]
        append_record(root, CaptureRecord(
            path=name, object="racer", variant=variant, image_sha256=sha256_file(path),
            booster_sha256=None if variant == "unpatched" else "ab" * 32,
        ))  # fmt: skip
    asked = ["eval", "--workspace", str(workspace.root), "--model", "rig18"]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 1 and "1 set aside:" in done.stderr
    assert "sim/racer/unpatched/pose_02.png: manifest.jsonl does not list it" in done.stderr
    assert CliRunner().invoke(app, [*asked, "--trust-files"]).exit_code == 0


def test_hand_sorted_folders_say_how_they_are_paired(workspace, put, colour_classifier):
    for pose in (1, 2):
        for variant in ("unpatched", "patched"):
            put(f"real/racer/{variant}/{pose}.png", "racer")
    done = evaluate(workspace, colour_classifier)
    assert "no manifest: pairing by name" in done.report_file.read_text()


def test_pairs_of_two_lights_are_not_formed_and_told_in_one_line(workspace, put, colour_classifier):
    root = shoot(workspace, put)
    lines = (root / "manifest.jsonl").read_text().splitlines()
    dim = [line.replace("oak/studio", "oak/dim") for line in lines if '"variant": "unpatched"' in line]
    (root / "manifest.jsonl").write_text("\n".join([*lines, *dim]) + "\n")
    done = evaluate(workspace, colour_classifier)
    assert done.pairs == () and done.headlines[0].tone == "open"
    assert done.origin.no_pairs == (("sim/patched: other light", 8),)
    assert ("pairs", "8 not formed, sim/patched: other light") in done.origin.lines()


def photograph(seed):
    """(224, 224, 3) uint8 with structure of all sizes, as a photograph has."""
    draw = np.random.default_rng(seed)
    layers = [
        np.asarray(Image.fromarray(draw.integers(0, 256, (n, n, 3), dtype=np.uint8)).resize((224, 224)), float)
        for n in (4, 16, 64, 224)
    ]
    return np.clip(np.mean(layers, axis=0), 0, 255).astype(np.uint8)


def look_at(pictures):
    """A finder that has seen {path: pixels}, and the predictions of them."""
    from toolkit.evaluation.prediction import Prediction

    finder, predictions = TwinFinder(), []
    for path, pixels in pictures.items():
        source, name, variant, file = path.split("/")
        capture = Capture(source, name, variant, None, file, path)
        finder.look(capture, pixels)
        predictions.append(Prediction(capture, 0, "mug"))
    kept, aside = finder.drop(predictions)
    return [one.capture.path for one in kept], {one.path: one for one in aside}


def recode(pixels, tmp_path, side=224, **how):
    small = Image.fromarray(pixels).resize((side, side), Image.Resampling.LANCZOS)
    small.save(tmp_path / "x.jpg", **how)
    return np.asarray(Image.open(tmp_path / "x.jpg").resize((224, 224), Image.Resampling.BICUBIC))


@pytest.mark.parametrize("side", [224, 160])
def test_jpeg_and_png_of_one_photograph_count_once(tmp_path, side):
    original = photograph(1)
    kept, aside = look_at({
        "real/mug/unpatched/1.jpg": recode(original, tmp_path, side, quality=80),
        "real/mug/unpatched/1.png": original,
        "real/mug/unpatched/2.png": photograph(2),
    })  # fmt: skip
    assert kept == ["real/mug/unpatched/1.jpg", "real/mug/unpatched/2.png"]
    assert not aside["real/mug/unpatched/1.png"].is_fault


def test_one_picture_in_both_halves_of_a_pair_is_no_pair():
    same = photograph(1)
    kept, aside = look_at({"real/mug/unpatched/1.png": same, "real/mug/patched/1.png": same})
    assert kept == [] and all(one.is_fault for one in aside.values())
    assert "unpatched and boosted are the same picture" in aside["real/mug/patched/1.png"].reason
    kept, aside = look_at({"real/mug/unpatched/1.png": same, "real/cup/unpatched/1.png": same})
    assert kept == [] and "of another object" in aside["real/cup/unpatched/1.png"].reason


def test_a_small_patch_makes_another_picture():
    bare, boosted = photograph(1), photograph(1)
    boosted[100:112, 100:112] = 255 - boosted[100:112, 100:112] // 2
    kept, aside = look_at({"real/mug/unpatched/1.png": bare, "real/mug/patched/1.png": boosted})
    assert len(kept) == 2 and aside == {}


def test_a_result_is_made_again_and_compared(workspace, put, colour_classifier):
    shoot(workspace, put)
    done = evaluate(workspace, colour_classifier)
    found = verify_run(workspace, done.run_dir.name, colour_classifier)
    assert found.is_same and found.n == 16 and found.other_digits == 0
    assert found.describe().endswith("the same result, 16 of 16 answers")
    # other light in both halves leaves pictures and answers; then a picture is replaced
    shoot(workspace, put, light="dim")
    assert verify_run(workspace, done.run_dir.name, colour_classifier).is_same
    put("sim/racer/patched/pose_04.png", "warplane")
    found = verify_run(workspace, done.run_dir.name, colour_classifier)
    assert found.differing == (("sim/racer/patched/pose_04.png", "in the table, and does not count now"),)
    assert set(found.parts) >= {"images", "groups", "pairs"} and not found.is_same
    # an answer edited in the table
    table = done.run_dir / "predictions.csv"
    table.write_text(table.read_text().replace("eggnog,", "racer,", 1))
    with pytest.raises(ToolkitError, match=r"predictions.csv was changed after summary.json was counted"):
        verify_run(workspace, done.run_dir.name, colour_classifier)


def test_a_result_is_not_verified_by_another_network(workspace, put, colour_classifier):
    from dataclasses import replace

    shoot(workspace, put)
    done = evaluate(workspace, colour_classifier)
    other = replace(colour_classifier, preprocessing=replace(colour_classifier.preprocessing, crop_px=27))
    with pytest.raises(ToolkitError, match=r"judged by colours with network_id .*name the network"):
        verify_run(workspace, done.run_dir.name, other)


def test_what_cannot_be_verified_says_why(workspace, put, colour_classifier, as_older):
    shoot(workspace, put)
    done = evaluate(workspace, colour_classifier)
    as_older(done.run_dir)
    summary = json.loads((done.run_dir / "summary.json").read_text())
    del summary["asked"]
    (done.run_dir / "summary.json").write_text(json.dumps(summary))
    with pytest.raises(ToolkitError, match="does not state from which folder it was made"):
        verify_run(workspace, done.run_dir.name, colour_classifier)
