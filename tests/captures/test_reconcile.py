"""What counts: an image is what its manifest says, a pair differs in the booster alone, and a copy counts once."""

import json
import shutil

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from toolkit.captures.manifest import LEFT_OUT, MANIFEST, CaptureRecord, append_record, read_manifest
from toolkit.captures.read import Selection, read_captures
from toolkit.captures.shoot import ShootSettings, shoot_plan
from toolkit.captures.simulate import SimulateConfig, simulate_captures
from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.workspace import Workspace
from toolkit.objects.records import write_patch
from toolkit.rig.plan import read_plan, write_plan

BOOSTER, OTHER = "ab" * 32, "cd" * 32
MADE = {"renderer": "raycast", "studio": "oak/studio/0-1", "seed": 0}


def draw(file, seed):
    """A picture of its own."""
    file.parent.mkdir(parents=True, exist_ok=True)
    coarse = np.random.default_rng(seed).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    Image.fromarray(coarse).resize((64, 48), Image.Resampling.BICUBIC).save(file)


def render(source, path, seed, pose_id, **more):
    """A picture with its line, as if the rig had made it."""
    draw(source / path, seed)
    name, variant, _ = path.split("/")
    made = MADE | more.pop("made", {})
    booster = None if variant == "unpatched" else BOOSTER
    append_record(source, CaptureRecord(**{
        "path": path, "object": name, "variant": variant, "pose_id": pose_id, "booster_sha256": booster,
        "image_sha256": sha256_file(source / path), "made": made, **more,
    }))  # fmt: skip


@pytest.fixture
def source(tmp_path):
    """Two poses of two objects, bare and patched."""
    folder = tmp_path / "captures/sim"
    seed = 0
    for name in ("racer", "warplane"):
        for variant in ("unpatched", "patched"):
            for pose in (1, 2):
                seed += 1
                render(folder, f"{name}/{variant}/pose_{pose:02d}.png", seed, pose)
    return folder


def count(source, **more):
    found = read_captures(source, **more)
    return found, [one.path_in_source for one in found.captures]


def test_what_is_as_the_manifest_says_counts(source):
    found, paths = count(source)
    assert len(paths) == 8 and found.set_aside == () and found.notes == () and found.without_manifest == ()


def test_swapped_folders_do_not_turn_an_effect_round(source):
    racer = source / "racer"
    (racer / "patched").rename(racer / "aside")
    (racer / "unpatched").rename(racer / "patched")
    (racer / "aside").rename(racer / "unpatched")
    found, paths = count(source)
    assert {path.split("/")[0] for path in paths} == {"warplane"}
    assert len(found.faults) == 4
    assert dict(found.faults)["sim/racer/patched/pose_01.png"] == (
        "manifest.jsonl lists this picture in another place: sim/racer/unpatched/pose_01.png. Was a folder or file "
        "renamed, swapped or copied?"
    )


def test_a_renamed_object_is_not_judged_as_another(source):
    shutil.rmtree(source / "warplane")
    (source / "racer").rename(source / "warplane")
    with pytest.raises(
        ToolkitError, match=r"none of 4 images counts; .* lists this picture in another place: sim/racer/"
    ):
        count(source)


def test_a_picture_that_was_replaced_a_stranger_and_a_lost_one_are_set_aside(source):
    draw(source / "racer/patched/pose_01.png", 99)
    draw(source / "racer/patched/backup/pose_02.png", 98)
    (source / "warplane/patched/pose_02.png").unlink()
    found, paths = count(source)
    assert len(paths) == 6
    assert [reason.split(" (")[0].split(":")[0] for _, reason in found.faults] == [
        "manifest.jsonl does not list it", "it is not the picture in manifest.jsonl",
        "manifest.jsonl lists it, and the file is gone",
    ]  # fmt: skip
    trusted, paths = count(source, trust_files=True)
    assert len(paths) == 8 and trusted.faults == [] and trusted.is_trusted


def test_a_lost_picture_is_missed_only_where_it_was_looked_for(source):
    (source / "warplane/patched/pose_02.png").unlink()
    assert len(count(source)[0].faults) == 1
    assert count(source / "racer")[0].faults == []
    assert count(source, selection=Selection(objects=("racer",)))[0].faults == []


def test_a_folder_that_was_deleted_is_told_and_is_no_fault(source):
    shutil.rmtree(source / "racer/patched")
    found, paths = count(source)
    assert len(paths) == 6 and found.faults == []
    assert "sim/racer/patched/pose_02.png: manifest.jsonl lists it, and its folder is gone" in found.notes[0]
    # where only a part was asked for, nothing else is missed
    assert count(source / "warplane")[0].notes == ()
    assert count(source, selection=Selection(objects=("warplane",)))[0].notes == ()


def test_images_set_aside_for_one_reason_are_one_kind(source):
    (source / "racer").rename(source / "car")
    found, _ = count(source)
    assert {one.kind for one in found.set_aside} == {"manifest.jsonl lists this picture in another place"}
    assert len(found.faults) == 4


def test_photographs_with_an_unknown_booster_are_a_group_of_their_own(source):
    line = read_manifest(source)["racer/patched/pose_02.png"]
    append_record(source, line.model_copy(update={"booster_sha256": None, "made": {"how": "photograph"}}))
    found, _ = count(source)
    variants = {one.path_in_source: one.variant for one in found.captures}
    assert variants["racer/patched/pose_02.png"] == "patched-unknown"
    assert variants["racer/patched/pose_01.png"] == "patched" and variants["racer/unpatched/pose_01.png"] == "unpatched"


def test_a_manifest_that_says_the_opposite_of_a_folder_is_refused(source):
    for variant, booster, said in (("unpatched", OTHER, "carries the booster"), ("patched", None, "no booster")):
        line = read_manifest(source)[f"racer/{variant}/pose_01.png"]
        append_record(source, line.model_copy(update={"booster_sha256": booster}))
        with pytest.raises(ToolkitError, match=rf"called '{variant}', and by manifest.jsonl .*{said}.*swapped"):
            count(source)
        append_record(source, line)
    assert len(count(source)[1]) == 8


def test_a_variant_with_two_boosters_is_two_groups(source):
    line = read_manifest(source)["racer/patched/pose_02.png"]
    append_record(source, line.model_copy(update={"booster_sha256": OTHER}))
    found, _ = count(source)
    variants = {one.path_in_source: one.variant for one in found.captures}
    assert variants["racer/patched/pose_01.png"] == "patched-abababab"
    assert variants["racer/patched/pose_02.png"] == "patched-cdcdcdcd"
    assert variants["warplane/patched/pose_01.png"] == "patched"


def test_a_pose_shot_as_jpeg_and_png_counts_once_and_the_newest(source):
    T = np.eye(4).tolist()
    for suffix in ("jpg", "png"):
        render(source, f"racer/unpatched/pose_03.{suffix}", 50, 3, T_world_camera=T)
    found, paths = count(source)
    assert "racer/unpatched/pose_03.png" in paths and "racer/unpatched/pose_03.jpg" not in paths
    (note,) = found.notes
    assert "the same pose was shot again: sim/racer/unpatched/pose_03.png counts" in note and found.faults == []


@pytest.mark.parametrize(
    ("made", "why"),
    [
        ({"studio": "oak/dim/0-1"}, "other light"),
        ({"studio": "linen/studio/0-1"}, "another backdrop"),
        ({"seed": 7, "studio": "oak/studio/7-1"}, "another seed"),
        ({"renderer": "filament"}, "another renderer"),
        ({"rehearsed": True}, "one is a rehearsal, the other is not"),
        ({"mesh_sha256": OTHER}, "another shape or length of the object"),
        ({"class": "tank"}, "another class"),
    ],
)
def test_a_pair_differs_in_the_booster_alone(tmp_path, made, why):
    known = {"mesh_sha256": BOOSTER, "class": "racer"}
    render(tmp_path / "sim", "racer/unpatched/pose_01.png", 1, 1, made=known)
    render(tmp_path / "sim", "racer/patched/pose_01.png", 2, 1, made=known)
    boosted, bare = read_captures(tmp_path / "sim").captures
    assert bare.explain_no_pair(boosted) is None
    render(tmp_path / "sim", "racer/patched/pose_01.png", 3, 1, made=known | made)
    boosted, bare = read_captures(tmp_path / "sim").captures
    assert bare.explain_no_pair(boosted) == boosted.explain_no_pair(bare) == why


def test_photographs_of_two_plans_are_no_pair(tmp_path):
    for variant, plan in (("unpatched", "11" * 32), ("patched", "22" * 32)):
        file = tmp_path / f"real/mug/{variant}/pose_01.png"
        draw(file, ord(variant[0]))
        made = {"how": "photograph", "pose_sha256": plan}
        append_record(tmp_path / "real", CaptureRecord(
            path=f"mug/{variant}/pose_01.png", object="mug", variant=variant, pose_id=1,
            image_sha256=sha256_file(file), made=made,
        ))  # fmt: skip
    boosted, bare = read_captures(tmp_path / "real").captures
    assert bare.explain_no_pair(boosted) == "another plan"


def test_copies_of_a_small_photograph_count_once(tmp_path):
    for number in range(1, 10):
        draw(tmp_path / f"real/mug/unpatched/{number}.png", 1)
        draw(tmp_path / f"real/mug/patched/{number}.png", 10 + number)
    found, paths = count(tmp_path)
    assert [path for path in paths if "unpatched" in path] == ["mug/unpatched/1.png"] and len(paths) == 10
    assert found.without_manifest == ("real",)


def test_a_corrupted_copy_of_an_earlier_picture_does_not_count(source):
    copies = source.with_name("sim-fog-3")
    for path, line in read_manifest(source).items():
        draw(copies / path, list(path.encode()))
        made = line.made | {
            "corruption": "fog", "severity": 3, "cut_px": 64, "of": f"sim/{path}", "of_sha256": line.image_sha256,
        }  # fmt: skip
        sha256 = sha256_file(copies / path)
        append_record(copies, line.model_copy(update={"made": made, "image_sha256": sha256}))
    assert len(read_captures(copies).captures) == 8
    render(source, "racer/patched/pose_01.png", 77, 1)
    found = read_captures(source.parent)
    assert len(found.captures) == 15
    assert [one.path for one in found.set_aside] == ["sim-fog-3/racer/patched/pose_01.png"]
    assert "made from an earlier picture: sim/racer/patched/pose_01.png has changed" in found.set_aside[0].reason


SETTINGS = ShootSettings(backdrop="white")
WHITE = SimulateConfig(backdrop="white")


@pytest.fixture(scope="module")
def shot(tmp_path_factory, make_crate_space):
    """A workspace with all four images; not to be changed."""
    space = make_crate_space(tmp_path_factory.mktemp("reconcile"))
    shoot_plan(space, read_plan(space.plan_file), ["crate"], settings=SETTINGS)
    return space


@pytest.fixture
def space(shot, tmp_path):
    """A copy of it."""
    shutil.copytree(shot.root, tmp_path / "space")
    return Workspace(tmp_path / "space")


def pairs(space, source="sim"):
    """Reason for each pose of why bare and patched are no pair; None for a pair."""
    found = {(one.variant, one.pose_id): one for one in read_captures(space.captures_dir / source).captures}
    return [
        found["unpatched", pose].explain_no_pair(found["patched", pose])
        for variant, pose in found if variant == "unpatched" and ("patched", pose) in found
    ]  # fmt: skip


def change_length(space):
    spec = space.objects_dir / "crate.toml"
    spec.write_text(spec.read_text().replace("length_mm = 100", "length_mm = 90"))


def change_light(space):
    return WHITE.with_overrides({"light": "dim"})


def change_seed(space):
    return {"seed": 3}


def change_booster(space):
    record = json.loads(space.patch("crate").with_suffix(".json").read_text())
    kept = ("name", "class_name", "class_index", "networks", "data", "seed", "settings", "final", "toolkit_version")
    write_patch(space.patches_dir, np.full((12, 12, 3), 200, np.uint8), {name: record[name] for name in kept})


@pytest.mark.parametrize(
    ("change", "asked", "again"),
    [
        (change_length, ["patched"], {"unpatched": "another shape or length of the object"}),
        (change_light, ["patched"], {"unpatched": "other light"}),
        (change_seed, ["patched"], {"unpatched": "another seed"}),
        (change_booster, ["unpatched"], {"patched": "another booster"}),
    ],
)
def test_what_no_longer_goes_together_is_shot_again(space, change, asked, again):
    given = change(space)
    config = given if isinstance(given, SimulateConfig) else WHITE
    seed = given["seed"] if isinstance(given, dict) else 0
    done = simulate_captures(space, config, ["crate"], asked, seed=seed)
    ((variant, why),) = again.items()
    assert done.all_remarks == [f"crate/{variant}: shot again too, {why} when it was shot before"]
    assert pairs(space) == [None, None]


def test_what_no_longer_goes_together_can_be_kept_out_of_the_result(space):
    change_length(space)
    done = simulate_captures(space, WHITE.with_overrides({"keep": True}), ["crate"], ["patched"])
    assert done.shot.shot == 2 and "left out of results" in done.all_remarks[0]
    found = read_captures(space.captures_dir / "sim")
    assert {one.variant for one in found.captures} == {"patched"} and found.faults == []
    assert {one.reason for one in found.set_aside} == {
        "another shape or length of the object than the images that were shot since"
    }
    # and counts again when it is shot again
    simulate_captures(space, WHITE, ["crate"])
    assert pairs(space) == [None, None]


def test_poses_of_an_earlier_plan_do_not_count(space):
    plan = read_plan(space.plan_file)
    whole = {name: poses for name, poses in plan.objects.items()}
    write_plan(space.plan_file, plan.model_copy(update={"objects": {"crate": whole["crate"][:1]}}))
    done = simulate_captures(space, WHITE, ["crate"])
    assert "2 images are not of this plan" in done.all_remarks[0]
    found = read_captures(space.captures_dir / "sim")
    assert len(found.captures) == 2 and len(found.set_aside) == 2 and found.faults == []
    write_plan(space.plan_file, plan)
    assert simulate_captures(space, WHITE, ["crate"]).shot.shot == 0
    assert len(read_captures(space.captures_dir / "sim").captures) == 4
    assert not any(LEFT_OUT in one.made for one in read_manifest(space.captures_dir / "sim").values())


def test_boxes_are_not_written_for_an_object_of_another_length(space):
    change_length(space)
    done = CliRunner().invoke(app, ["coco", "--workspace", str(space.root)])
    assert isinstance(done.exception, ToolkitError) and "another shape or length" in str(done.exception)


def test_manifests_of_earlier_versions_are_read(space):
    """Without hashes of mesh and sheet, and without those of images, all that is there counts."""
    file = space.captures_dir / "sim" / MANIFEST
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    for line in lines:
        line["image_sha256"] = None
        line["made"] = {name: line["made"][name] for name in ("renderer", "studio", "seed")}
    file.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = read_captures(space.captures_dir)
    assert len(found.captures) == 4 and found.set_aside == () and pairs(space) == [None, None]
