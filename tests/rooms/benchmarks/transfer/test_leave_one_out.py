"""Each network left out in turn: who was trained on, who judged, and what a second run need not do again."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from red_seeker import red_seeker
from tiny_network import tiny_classifier
from typer.testing import CliRunner

from toolkit.boosters.detectors import DetectorNetwork
from toolkit.cli.app import make_single
from toolkit.core.errors import ToolkitError
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.objects.records import Texture, read_patch, read_texture
from toolkit.rooms.benchmarks.commands import transfer
from toolkit.rooms.benchmarks.transfer import TransferConfig
from toolkit.rooms.benchmarks.transfer import leave_one_out as experiment
from toolkit.rooms.benchmarks.transfer.leave_one_out import JudgedRow, TransferResult, leave_one_out, tabulate

LABELS = ["cat", "dog", "sports car", "crate"]


def network(seed: int):
    made = tiny_classifier(seed)
    file = replace(made.weights, sha256=f"{seed:02d}" * 32)
    return replace(made, labels=LABELS, name=f"tiny:{seed}", weights=file)


@pytest.fixture
def space(tmp_path, make_crate_space):
    return make_crate_space(tmp_path / "w")


def make_quick(monkeypatch) -> None:
    """Texture settings that take a moment."""
    from toolkit.boosters import patch_config, texture_config

    slim = {"size_px": 16, "studios": 1, "per_studio": 2, "held_out": 1, "batch": 2, "reuse": 1}
    quick = texture_config.RECIPES["default"].model_copy(update=slim)
    monkeypatch.setitem(texture_config.RECIPES, "default", quick)
    patch = patch_config.RECIPES["default"].model_copy(update={"size_px": 16, "mounted_views": 4, "batch": 2})
    monkeypatch.setitem(patch_config.RECIPES, "default", patch)


@pytest.mark.slow
def test_all_but_one_are_trained_on_and_that_one_judges(space, monkeypatch):
    make_quick(monkeypatch)
    networks = [network(seed) for seed in (1, 2)]
    config = TransferConfig(steps=2, batch=3, objects=("crate",), corruptions=("contrast:3",), max_change=0.25)
    result = leave_one_out(space, config, networks)
    root = space.eval_dir / "transfer" / "leave-one-out"
    for seed in (1, 2):
        made = root / f"without-tiny-{seed}"
        for record in (read_patch(made / "print/patches/crate.png"), read_texture(made / "rig/textures/crate.png")):
            found = {one.sha256[:2] for one in record.record.networks}
            assert (record.record.settings["steps"], record.record.settings["batch"]) == (2, 3)
            assert record.record.settings.get("max_change") == (0.25 if isinstance(record, Texture) else None)
            assert found == {"01", "02"} - {f"{seed:02d}"}
    rows = [row for row in result.rows if row.object == "crate"]
    assert len(rows) == 2 * 2 * 2 * 2, "left out, judge, booster, clear and corrupted"
    assert {(row.left_out, row.judge) for row in rows if not row.seen} == {(f"tiny:{k}",) * 2 for k in (1, 2)}
    assert {row.source for row in rows} == {"sim", "sim-contrast-3"} and {row.n for row in rows} == {2}
    assert all(row.boosted - row.bare == row.gained - row.lost for row in rows)
    assert json.loads(result.json_file.read_text())["rows"][0]["trained_on"] == ["tiny:2"]
    assert "| tiny:1 | tiny:1 | patch | sim | crate |" in result.markdown_file.read_text()

    def refuse(*arguments, **options):
        raise AssertionError("nothing is done twice")

    monkeypatch.setattr(experiment, "evaluate_captures", refuse)
    monkeypatch.setattr("toolkit.boosters.patch.PatchTask.loss", refuse)
    monkeypatch.setattr("toolkit.boosters.texture.TextureTask.loss", refuse)
    assert leave_one_out(space, config, networks).rows == result.rows
    assert evaluate_captures is not refuse


@pytest.mark.slow
def test_what_is_trained_on_one_kind_is_judged_by_the_other(space, monkeypatch):
    """A classifier and a detector: each trains alone, both judge; a detector's poses are those where it finds it."""
    make_quick(monkeypatch)
    spec = space.objects_dir / "crate.toml"
    spec.write_text(spec.read_text().replace('class = "crate"', 'class = "sports car"'))
    detector = DetectorNetwork(red_seeker())
    config = TransferConfig(steps=2, objects=("crate",), kinds=("patch",), corruptions=())
    result = leave_one_out(space, config, [network(1), detector])
    rows = {(row.left_out, row.judge): row for row in result.rows if row.object == "crate"}
    assert {key: (row.trained_on, row.seen) for key, row in rows.items()} == {
        ("detectors", "tiny:1"): (["tiny:1"], True), ("detectors", "red"): (["tiny:1"], False),
        ("classifiers", "tiny:1"): (["red"], False), ("classifiers", "red"): (["red"], True),
    }  # fmt: skip
    made = space.eval_dir / "transfer/leave-one-out/without-classifiers"
    lines = (made / "eval/red/detections.csv").read_text().splitlines()
    found = [line.split(",")[lines[0].split(",").index("found")] for line in lines[1:] if ",patched," in line]
    assert rows["classifiers", "red"].boosted == found.count("1") and rows["classifiers", "red"].n == len(found) == 2
    content = json.loads(result.json_file.read_text())
    assert content["kind"] == "transfer"
    networks = content["networks"]
    assert networks["red"]["kind"] == "detector" and "kind" not in networks["tiny:1"]
    with pytest.raises(ToolkitError, match=r"no network called 'red': known: detectors, classifiers"):
        leave_one_out(space, config.with_overrides(left_out=("red",)), [network(1), detector])


def row(left_out: str, judge: str, name: str, **more) -> JudgedRow:
    fields = {
        "left_out": left_out, "trained_on": [], "judge": judge, "judge_sha256": "", "seen": left_out != judge,
        "source": "sim", "object": name, "kind": "patch", "n": 18, "bare": 3, "boosted": 9, "gained": 7, "lost": 1,
        "mcnemar_p": 0.07,
    }  # fmt: skip
    return JudgedRow(**(fields | more))


def test_the_table_has_objects_for_the_unseen_and_the_pool_for_the_seen():
    rows = [row(out, judge, name) for out in "ab" for judge in "ab" for name in ("mug", "jug", "all")]
    assert [cells[:5] for cells in tabulate(rows, seen=False)] == [
        (one, one, "patch", "sim", name) for one in "ab" for name in ("mug", "jug", "all")
    ]
    assert [cells[:2] for cells in tabulate(rows, seen=True)] == [("a", "b"), ("b", "a")]
    assert tabulate(rows, seen=False)[0][5:9] == ("3 of 18", "9 of 18 (29–71)", "7", "1")


def test_what_cannot_be_left_out_is_refused(space):
    with pytest.raises(ToolkitError, match="at least two networks"):
        leave_one_out(space, TransferConfig(), [network(1)])
    with pytest.raises(ToolkitError, match="each once"):
        leave_one_out(space, TransferConfig(), [network(1), network(1)])
    with pytest.raises(ToolkitError, match="no network called 'tiny:9'"):
        leave_one_out(space, TransferConfig(left_out=("tiny:9",)), [network(1), network(2)])
    with pytest.raises(ToolkitError, match="kinds"):
        TransferConfig(kinds=("sticker",))


def test_a_network_is_left_out_by_the_name_that_was_typed(space, monkeypatch):
    """`--model timm:lite` loads a network called timm-lite; either name is one for `--leave-out`."""
    asked = []
    networks = [replace(network(1), name="timm-lite"), network(2)]
    monkeypatch.setattr("toolkit.boosters.detectors.load_networks", lambda *arguments, **options: networks)
    monkeypatch.setattr(
        experiment, "leave_one_out",
        lambda workspace, config, networks: asked.append(config.left_out) or TransferResult((), Path("a"), Path("b")),
    )  # fmt: skip
    for name in ("timm:lite", "timm-lite"):
        words = ["--workspace", str(space.root), "--model", "timm:lite", "--model", "other", "--leave-out", name]
        outcome = CliRunner().invoke(make_single(transfer), words)
        assert outcome.exit_code == 0, outcome.output
    assert asked == [("timm-lite",)] * 2


def test_rows_of_other_settings_are_not_mixed_in(space, monkeypatch, capsys):
    """A network that an earlier run left out counts only if that run had these settings, poses and objects."""
    monkeypatch.setattr(experiment, "_train", lambda *a: None)

    def shoot(made, *_):
        made.captures_dir.joinpath("sim").mkdir(parents=True, exist_ok=True)
        made.captures_dir.joinpath("sim/manifest.jsonl").write_text("")

    monkeypatch.setattr(experiment, "_shoot", shoot)
    monkeypatch.setattr(experiment, "evaluate_captures", lambda captures, made, judge, settings: judge.name)
    monkeypatch.setattr(experiment, "collect_rows", lambda judge, left_out, _: [row(left_out, judge, "crate")])
    networks = [network(1), network(2)]
    config = TransferConfig(objects=("crate",), kinds=("patch",), steps=4)

    def left_out(**more) -> set[str]:
        return {one.left_out for one in leave_one_out(space, config.with_overrides(**more), networks).rows}

    assert left_out() == left_out(left_out=("tiny:2",)) == {"tiny:1", "tiny:2"}
    # other settings, and another object, have a matrix of their own
    root = space.eval_dir / "transfer"
    first = (root / "leave-one-out" / "matrix.json").read_bytes()
    assert left_out(left_out=("tiny:2",), steps=5) == {"tiny:2"}
    assert f"{root / 'leave-one-out'} holds another result, and stays as it is" in capsys.readouterr().err
    assert left_out(left_out=("tiny:1",), steps=5) == {"tiny:1", "tiny:2"}
    spec = space.objects_dir / "crate.toml"
    found = spec.read_text()
    spec.write_text(found.replace("length_mm = 100", "length_mm = 90"))
    assert left_out(left_out=("tiny:2",), steps=5) == {"tiny:2"}
    assert sorted(path.name for path in root.iterdir()) == [f"leave-one-out{number}" for number in ("", "-2", "-3")]
    assert (root / "leave-one-out" / "matrix.json").read_bytes() == first
    # the same pictures again: nothing is asked
    spec.write_text(found)
    monkeypatch.setattr(experiment, "evaluate_captures", None)
    assert left_out() == {"tiny:1", "tiny:2"}
    # other networks, none of which has a cell there
    first = (root / "leave-one-out" / "matrix.json").read_bytes()
    networks[:] = [network(3), network(4)]
    monkeypatch.setattr(experiment, "evaluate_captures", lambda captures, made, judge, settings: judge.name)
    assert left_out() == {"tiny:3", "tiny:4"}
    assert (root / "leave-one-out" / "matrix.json").read_bytes() == first
