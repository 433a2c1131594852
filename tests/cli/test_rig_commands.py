"""`toolkit plan`, `objects`, `capture-sim` and `doctor` on a workspace with one light object."""

import json
import re
from io import BytesIO

import numpy as np
import pytest
import trimesh
from copier import copier_profile
from PIL import Image
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.cli.rig import what_pairs_can_show
from toolkit.imaging.printer import write_print_profile
from toolkit.rig.plan import read_plan
from toolkit.training.machine import Check


def call(*arguments, code=0):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, (result.output, result.exception)
    return result


def test_plan_writes_what_it_was_asked_for_and_prints_it(space):
    result = call(
        "plan", "--pattern", "fibonacci", "--count", 7, "--elevation", 30, 60, "--resolution", 160, 120, "--fill", 0.5
    )
    plan = read_plan(space.plan_file)
    assert (plan.camera.width, plan.camera.height) == (160, 120)
    assert len(plan.objects["crate"]) == 7
    assert all(30 <= pose.elevation_deg <= 60 for pose in plan.objects["crate"])
    assert "crate" in result.stdout and "plan.json" in result.stdout and "toolkit capture-sim" in result.stdout
    assert re.search(r"^crate: 7 poses, elevations .*, \d+ to \d+ mm away$", result.stdout, re.MULTILINE)
    assert len(result.output.splitlines()) <= 12
    first = space.plan_file.read_bytes()
    call("plan", "--pattern", "fibonacci", "--count", 7, "--elevation", 30, 60, "--resolution", 160, 120, "--fill", 0.5)
    assert space.plan_file.read_bytes() == first


def test_plan_names_the_training_that_is_missing(space):
    for file in space.patches().values():
        file.unlink(), file.with_suffix(".json").unlink()
    assert "next: toolkit train-patch --object crate, then toolkit capture-sim" in call("plan").stdout


def test_jitter_follows_its_seed(space):
    def planned(seed):
        call("plan", "--jitter", 3, "--seed", seed, "--quiet")
        return space.plan_file.read_bytes()

    assert planned(1) == planned(1) != planned(2)


def test_a_seed_orders_the_shots_of_the_poses_that_are_planned(space):
    call("plan", "--count", 4, "--elevation", 40, 40, "--resolution", 64, 48, "--quiet")
    planned = space.plan_file.read_bytes()
    call("plan", "--shot-list", "--seed", 3, "--quiet")
    assert space.plan_file.read_bytes() == planned


def test_plan_as_json_is_the_file(space):
    result = call("plan", "--count", 4, "--json")
    printed = json.loads(result.stdout)
    assert [pose["id"] for pose in printed["objects"]["crate"]] == [1, 2, 3, 4]
    assert read_plan(space.plan_file).model_dump(mode="json") == printed


@pytest.mark.slow
def test_the_preview_draws_positions_and_what_they_see(space):
    call("plan", "--count", 2, "--resolution", 96, 72, "--preview", "--json")
    for kind, size in (("positions", (1320, 616)), ("sheet", (640, 240))):
        picture = Image.open(space.root / "rig" / "preview" / f"crate-{kind}.png")
        assert picture.size == size
        assert len(picture.convert("RGB").getcolors(1 << 24)) > 50


def test_eighteen_pairs_show_what_the_statistics_tables_say():
    """Six of six flips have p = 2/64 = 0.031, five 2/32 = 0.0625."""
    words = what_pairs_can_show(18)
    assert words.startswith(
        "with 18 poses of an object, at least 6 images must improve and none get worse for p < 0.05"
    )
    assert "no number of changes" in what_pairs_can_show(5)
    assert what_pairs_can_show(1).startswith("with 1 pose of an object, ")


def test_objects_are_listed_and_exported(space, tmp_path):
    (row,) = json.loads(call("objects", "--json").stdout)
    assert row["name"] == "crate" and row["size_mm"] == [100, 60, 40] and row["triangles"] == 12
    assert "crate" in call("objects").stdout
    call("objects", "--export", tmp_path / "out")
    scene = trimesh.load_scene(BytesIO((tmp_path / "out" / "crate.glb").read_bytes()), file_type="glb")
    assert sorted(scene.extents.round(4)) == [0.04, 0.06, 0.1]


def test_capture_sim_shoots_resumes_and_notes_what_is_stale(space):
    first = json.loads(call("capture-sim", "--backdrop", "white", "--variant", "unpatched", "--json").stdout)
    assert (first["shot"], first["kept"]) == (2, 0)
    folder = space.captures_dir / "sim" / "crate" / "unpatched"
    assert sorted(file.name for file in folder.iterdir() if file.suffix != ".json") == ["pose_01.jpg", "pose_02.jpg"]
    again = call("capture-sim", "--backdrop", "white", "--variant", "unpatched", "--quiet")
    assert "shot 0 images, 2 kept" in again.stdout and "toolkit eval" in again.stdout
    plan = json.loads(space.plan_file.read_text())
    del plan["objects"]["crate"][1]
    space.plan_file.write_text(json.dumps(plan))
    result = call("capture-sim", "--backdrop", "white", "--variant", "unpatched", "--quiet")
    assert "1 image is not of this plan" in result.stderr and "pose_02.jpg" in result.stderr


@pytest.mark.parametrize(
    ("state", "code", "words"), [("ok", 0, "ready"), ("note", 0, "ready"), ("missing", 1, "to fix")]
)
def test_doctor_prints_the_line_that_fixes_it(space, monkeypatch, state, code, words):
    found = [Check("disk", "ok", "much"), Check("thing", state, "absent [bold]", "apt install thing")]
    monkeypatch.setattr("toolkit.training.machine.check_machine", lambda folder: found)
    result = call("doctor", code=code)
    assert words in result.stdout and "apt install thing" in result.stdout and "absent [bold]" in result.stdout
    listed = json.loads(call("doctor", "--json", code=code).stdout)
    assert listed[1] == {"name": "thing", "state": state, "found": "absent [bold]", "fix": "apt install thing"}


def test_a_rehearsal_has_a_folder_of_its_own(space):
    shot = call("capture-sim", "--backdrop", "white", "--rehearse", "--quiet")
    assert "captures/sim-rehearsed" in shot.stdout and "next: toolkit eval" in shot.stdout
    assert len(list((space.captures_dir / "sim-rehearsed").rglob("*.jpg"))) == 4
    again = call("capture-sim", "--backdrop", "white", "--rehearse", "--json")
    assert (json.loads(again.stdout)["shot"], json.loads(again.stdout)["kept"]) == (0, 4)
    for words, said in (
        (["--print-profile", "profile.json"], "profile.json"),
        (["--rehearse", "--print-profile", "profile.json"], "profile.json"),
        (["--rehearse", "--format", "png"], "a phone's JPEGs"),
    ):
        assert said in str(call("capture-sim", *words, code=1).exception)


def test_a_measured_printer_alone_has_a_folder_of_its_own(space):
    """The sheet of a capture is the print of the patch; what is not printed stays as it was, pixel for pixel."""
    file = write_print_profile(space.root / "print/profiles/copier.json", copier_profile())
    words = "capture-sim", "--backdrop", "white", "--format", "png", "--quiet"
    call(*words, "--source", "plain")
    result = call(*words, "--print-profile", file)
    assert "captures/sim-printed" in result.stdout
    plain, printed = (space.captures_dir / name / "crate" for name in ("plain", "sim-printed"))
    bare, worn = (
        [np.asarray(Image.open(folder / variant / "pose_01.png"), float) for folder in (plain, printed)]
        for variant in ("unpatched", "patched")
    )
    assert np.array_equal(*bare) and np.abs(worn[0] - worn[1]).max() > 30
    again = json.loads(call(*words, "--print-profile", file, "--json").stdout)
    assert (again["shot"], again["kept"]) == (0, 4)
    write_print_profile(file, copier_profile(power=2.0))
    assert json.loads(call(*words, "--print-profile", file, "--json").stdout)["shot"] == 4
