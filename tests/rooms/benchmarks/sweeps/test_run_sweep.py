"""A sweep from end to end: rows against counts, what is done once only, and what cannot be done."""

import csv
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from red_crate import make_base, paint_patch

from toolkit.captures.manifest import read_manifest
from toolkit.captures.shoot import shoot_plan
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.evaluation.predictions_csv import find_captures_dir, read_predictions
from toolkit.evaluation.summaries import open_run
from toolkit.rig.plan import read_plan, write_plan
from toolkit.rig.renderer import Renderer
from toolkit.rig.renderers import RENDERERS, RendererKind
from toolkit.rooms.benchmarks.sweeps import SweepConfig
from toolkit.rooms.benchmarks.sweeps import sweep as sweeps
from toolkit.rooms.benchmarks.sweeps.sweep import run_sweep


@pytest.fixture(scope="module")
def swept(tmp_path_factory, make_crate_space, redness):
    """A workspace after `light` with studio and dim, and its result; not to be changed."""
    space = make_crate_space(tmp_path_factory.mktemp("swept"))
    paint_patch(space)
    return space, sweep(space, redness, "light", ["studio", "dim"])


@pytest.fixture
def after(swept, tmp_path):
    """A copy of it."""
    shutil.copytree(swept[0].root, tmp_path / "after")
    return Workspace(tmp_path / "after")


def sweep(space, redness, axis, values, **more):
    config = SweepConfig(axis=axis, values=values, objects=["crate"], **more)
    return run_sweep(space, config, redness, make_base(space))


def image(space, axis, label, variant, pose=1):
    return Image.open(space.eval_dir / "sweeps" / axis / "captures" / label / f"crate/{variant}/pose_{pose:02d}.jpg")


def measure_red(picture) -> float:
    """How much redder than grey a picture is, summed over its pixels: the patch's area, also with soft edges."""
    pixels = np.asarray(picture, float)
    return float((pixels[..., 0] - pixels[..., 1]).sum())


@pytest.mark.slow
def test_rows_pairs_and_files_say_what_the_pictures_hold(swept):
    space, result = swept
    assert (result.shot, result.kept, result.classified) == (8, 0, 8)
    content = json.loads(result.json_file.read_text())
    assert content["schema_version"] == 1 and content["axis"] == "light" and content["unit"] == ""
    assert content["kind"] == result.evaluation.summary["kind"] == "sweep"
    assert content["model"] == {"name": "redness", "arch": "redness", "weights": "red.pth", "sha256": "cd" * 32}
    assert content["kept"]["backdrop"] == "white" and "light" not in content["kept"]
    assert content["values"] == [{"value": name, "label": name} for name in ("studio", "dim")]
    assert content["objects"] == [{"object": "crate", "longest_mm": 100.0}]
    assert content["skipped"] == content["failed"] == []
    rows = {(row["value"], row["object"], row["variant"]): row for row in content["rows"]}
    names = [(o, v) for o in ("crate", "all") for v in ("unpatched", "patched")]
    assert list(rows) == [(light, *name) for light in ("studio", "dim") for name in names]
    for (_, _, variant), row in rows.items():
        assert (row["n"], row["failed"], row["top1"], row["top5"]) == (2, 0, float(variant == "patched"), 1.0)
        assert row["patch_mm"] == (40 if variant == "patched" else None)
        assert row["patch_share"] == (0.4 if variant == "patched" else None)
    assert rows["dim", "crate", "patched"]["ci95"] == pytest.approx([0.3424, 1.0], abs=1e-4)  # z²/(n + z²) below
    assert [(p["label"], p["object"], p["n_pairs"], p["gained"], p["lost"]) for p in content["pairs"]] == [
        (light, name, 2, 2, 0) for light in ("studio", "dim") for name in ("crate", "all")
    ]
    with result.csv_file.open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [(row["light"], row["object"], row["variant"]) for row in table] == list(rows)
    assert [row["gained"] for row in table[:2]] == ["", "2"]
    assert Image.open(result.figure_file).width > 500
    assert "dim" in result.evaluation.report_file.read_text()
    for light in ("studio", "dim"):
        records = read_manifest(space.eval_dir / "sweeps/light/captures" / light).values()
        assert {record.made["studio"].split("/")[1] for record in records} == {light}


def test_a_second_run_shoots_and_classifies_nothing_and_says_the_same(swept, after, redness):
    first = swept[1]
    before = {file.name: file.read_bytes() for file in (first.json_file, first.csv_file, first.figure_file)}
    seen = redness.module.seen
    again = sweep(after, redness, "light", ["studio", "dim"])
    assert (again.shot, again.kept, again.classified, redness.module.seen) == (0, 8, 0, seen)
    assert {file.name: file.read_bytes() for file in (again.json_file, again.csv_file, again.figure_file)} == before


def test_another_patch_means_its_own_images_again_and_no_others(after, redness):
    paint_patch(after, (120, 120, 120))
    result = sweep(after, redness, "light", ["studio", "dim"])
    assert (result.shot, result.kept, result.classified) == (4, 4, 4)
    assert {group.top1 for group in result.sweep.groups if group.variant == "patched"} == {0.0}


def test_size_covers_its_square_and_the_bare_object_is_shot_once(space, redness):
    result = sweep(space, redness, "size", [20.0, 40.0])
    # 40 mm is the spec's own size: bare images are the same for both, and for any other
    assert (result.shot, result.kept, result.classified) == (6, 2, 6)
    for pose in (1, 2):
        small, large = (
            measure_red(image(space, "size", f"{mm}mm", "patched", pose))
            - measure_red(image(space, "size", f"{mm}mm", "unpatched", pose))
            for mm in (20, 40)
        )
        assert large / small == pytest.approx(4, rel=0.12)
        bare = [np.asarray(image(space, "size", f"{mm}mm", "unpatched", pose)) for mm in (20, 40)]
        np.testing.assert_array_equal(*bare)
    records = read_manifest(space.eval_dir / "sweeps/size/captures/20mm")
    assert records["crate/patched/pose_01.jpg"].made["booster_mm"] == 20
    shares = {row["label"]: row["patch_share"] for row in result.sweep.rows if row["variant"] == "patched"}
    assert shares == {"20mm": 0.2, "40mm": 0.4}
    assert [(pair.source, pair.outcomes.n) for pair in result.sweep.pairs if pair.object == "crate"] == [
        ("20mm", 2), ("40mm", 2)
    ]  # fmt: skip


def test_a_patch_too_large_is_reported_and_the_rest_is_done(space, redness):
    result = sweep(space, redness, "size", [40.0, 80.0])
    assert [(label, name) for label, name, _ in result.sweep.skipped] == [("80mm", "crate")]
    assert "a patch of 80 mm is over half of the object's longest side (100 mm)" in result.sweep.skipped[0][2]
    assert {group.source for group in result.sweep.groups} == {"40mm"}
    content = json.loads(result.json_file.read_text())
    assert [value["value"] for value in content["values"]] == [40, 80] and len(content["skipped"]) == 1
    with pytest.raises(ToolkitError, match="no value of the sweep can be shot: 80mm: crate: a patch of 80 mm"):
        sweep(space, redness, "size", [80.0])
    with pytest.raises(ToolkitError, match="'size' varies the patch: name the variant 'patched'"):
        sweep(space, redness, "size", [40.0], variants=["unpatched"])


def test_a_camera_that_crops_the_object_is_reported(space, redness):
    result = sweep(space, redness, "distance", [0.5, 1.0], variants=["unpatched"])
    assert result.shot == 2
    assert "the object is cropped" in result.sweep.skipped[0][2]


def test_images_shot_before_from_the_same_inputs_are_copied(space, redness):
    base = make_base(space)
    shoot_plan(space, base.plan, ["crate"], ["unpatched"], base.settings)
    whole, damaged = (space.captures_dir / "sim" / f"crate/unpatched/pose_0{i}.jpg" for i in (1, 2))
    content = whole.read_bytes()
    damaged.write_bytes(damaged.read_bytes()[:300])
    result = sweep(space, redness, "distance", [1.0], variants=["unpatched"])
    assert (result.shot, result.kept) == (1, 1)
    copied = space.eval_dir / "sweeps/distance/captures/1x/crate/unpatched/pose_01.jpg"
    assert copied.read_bytes() == content
    # and from one axis to the next, where only the smaller pictures are new
    assert sweep(space, redness, "resolution", [48, 96], variants=["unpatched"]).shot == 2
    assert [image(space, "resolution", f"{px}px", "unpatched").size for px in (48, 96)] == [(48, 36), (96, 72)]


def test_an_interrupted_sweep_goes_on_where_it_stopped(space, redness, monkeypatch):
    real, calls = sweeps.shoot_plan, []

    def interrupted(*arguments, **more):
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(*arguments, **more)

    monkeypatch.setattr(sweeps, "shoot_plan", interrupted)
    with pytest.raises(KeyboardInterrupt):
        sweep(space, redness, "light", ["studio", "dim"], variants=["patched"])
    result = sweep(space, redness, "light", ["studio", "dim"], variants=["patched"])
    assert (result.shot, result.kept) == (2, 2)


def test_what_else_lies_in_the_folder_is_not_counted(after, redness):
    result = sweep(after, redness, "light", ["dim"], variants=["patched"])
    assert {(group.source, group.variant, group.n) for group in result.sweep.groups} == {("dim", "patched", 2)}
    plan = read_plan(after.plan_file)
    fewer = plan.model_copy(update={"objects": {"crate": plan.objects["crate"][:1]}})
    write_plan(after.plan_file, fewer)
    result = sweep(after, redness, "light", ["dim"], variants=["patched"])
    assert {group.n for group in result.sweep.groups} == {1}


def test_an_object_that_is_no_class_is_refused_before_any_work(space, redness):
    spec = space.objects_dir / "crate.toml"
    spec.write_text(spec.read_text().replace('class = "crate"', 'class = "crayfish"'))
    with pytest.raises(ToolkitError, match=r"crate\.toml: .*crayfish"):
        sweep(space, redness, "light", ["dim"])
    assert not (space.eval_dir / "sweeps").exists()


def test_at_each_size_the_patches_that_were_trained_for_it(space, redness):
    """A red patch for 40 mm, a grey one for 20 mm, and none for 30 mm."""
    for folder, colour in (("40mm", (220, 20, 20)), ("20mm", (90, 90, 90))):
        paint_patch(space, colour, folder)
    result = sweep(space, redness, "size", ["20,30,40"], trained=True)
    right = {(row["value"], row["object"], row["variant"]): row["top1"] for row in result.sweep.rows}
    assert right[40.0, "crate", "patched"] == 1 and right[20.0, "crate", "patched"] == 0
    assert [label for label, _, reason in result.sweep.skipped] == ["30mm"]
    assert "no set of patches called '30mm'" in result.sweep.skipped[0][2]
    assert result.json_file.name == "sweep-redness-trained.json"
    with pytest.raises(ToolkitError, match="expected the axis size"):
        SweepConfig(axis="light", trained=True)


@pytest.mark.slow
def test_another_sweep_of_that_name_goes_beside(after, redness):
    """Other values are another result: the first one's files stay, and the same values again are the first."""
    folder = after.eval_dir / "sweeps/light"
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file() and "captures" not in str(file)}
    other = sweep(after, redness, "light", ["studio"])
    assert other.evaluation.run_dir.name == "redness-2" and other.json_file.name == "sweep-redness-2.json"
    assert other.evaluation.notes[-1] == f"{folder / 'redness'} holds another result, and stays as it is"
    assert {file: file.read_bytes() for file in before} == before
    again = sweep(after, redness, "light", ["studio", "dim"])
    assert again.evaluation.run_dir.name == "redness" and again.classified == 0
    for name in ("redness", "redness-2"):
        run = open_run(after, f"sweeps/light/{name}")
        assert all(one.capture.file.is_file() for one in read_predictions(run, find_captures_dir(after, run)))


@pytest.mark.slow
def test_the_images_of_a_set_are_found_for_its_second_run_too(after, redness):
    mine = after.with_patches("mine") if (after.patches_dir / "mine").is_dir() else None
    if mine is None:
        shutil.copytree(after.patches_dir, after.patches_dir / "mine")
        mine = after.with_patches("mine")
    for values in (["studio", "dim"], ["studio"]):
        done = sweep(mine, redness, "light", values)
    run = open_run(mine, f"sweeps/light/{done.evaluation.run_dir.name}")
    assert run.name.endswith("-mine-2") and find_captures_dir(mine, run).name == "captures-mine"


@pytest.mark.slow
def test_pictures_of_another_renderer_lie_apart(tmp_path, make_crate_space, redness, monkeypatch):
    class Dark(Renderer):
        def render(self, camera, T_world_camera):
            return np.zeros((camera.height, camera.width, 3), np.float32)

    monkeypatch.setitem(RENDERERS, "dark", RendererKind(lambda mesh, scene, detail, stand: Dark(mesh, scene, stand)))
    space = make_crate_space(tmp_path)
    base = make_base(space)
    base = replace(base, settings=replace(base.settings, renderer=SweepConfig(axis="light", renderer="dark").renderer))
    result = run_sweep(space, SweepConfig(axis="light", values=["studio"], objects=["crate"]), redness, base)
    assert result.json_file.name == "sweep-redness-dark.json"
    picture = space.eval_dir / "sweeps/light/captures-dark/studio/crate/unpatched/pose_01.jpg"
    assert np.asarray(Image.open(picture)).max() < 60
    assert not (space.eval_dir / "sweeps/light/captures").exists()
    with pytest.raises(ToolkitError, match="no renderer called 'drak'"):
        SweepConfig(axis="light", renderer="drak")
