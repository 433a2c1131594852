"""Shooting a plan: what is on disk, what is done again, and what survives a kill."""

import errno
import json
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from toolkit.captures.manifest import MANIFEST, read_manifest
from toolkit.captures.shoot import ShootSettings, describe_look, shoot_plan
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.workspace import Workspace
from toolkit.objects.find_patch import find_patch
from toolkit.objects.load import load_object
from toolkit.objects.records import read_patch, write_patch
from toolkit.rig.camera import project
from toolkit.rig.plan import CapturePlan, read_plan, write_plan
from toolkit.rig.renderers import RENDERERS
from toolkit.rig.variants import CONTROLS_OF

SETTINGS = ShootSettings(backdrop="white")
PATHS = [f"crate/{variant}/pose_{i:02d}.jpg" for variant in ("patched", "unpatched") for i in (1, 2)]


def shoot(space, variants=("unpatched", "patched"), settings=SETTINGS, objects=("crate",), **more):
    return shoot_plan(space, read_plan(space.plan_file), objects, variants, settings, **more)


@pytest.fixture(scope="module")
def shot(tmp_path_factory, make_crate_space):
    """A workspace with all four images; not to be changed."""
    space = make_crate_space(tmp_path_factory.mktemp("shot"))
    result = shoot(space)
    assert (result.shot, result.kept, result.stale) == (4, 0, [])
    return space


@pytest.fixture
def space(shot, tmp_path):
    """A copy of it."""
    shutil.copytree(shot.root, tmp_path / "space")
    return Workspace(tmp_path / "space")


def contents(space):
    folder = space.captures_dir / "sim"
    return {str(f.relative_to(folder)): f.read_bytes() for f in folder.rglob("*.jpg")}


def test_every_image_is_there_with_its_record(shot):
    folder = shot.captures_dir / "sim"
    records = read_manifest(folder)
    assert sorted(records) == sorted(contents(shot)) == PATHS
    plan, patch = read_plan(shot.plan_file), read_patch(shot.patch("crate"))
    for path, record in records.items():
        assert Image.open(folder / path).size == (96, 72)
        assert record.image_sha256 == sha256_file(folder / path)
        assert f"{record.object}/{record.variant}/pose_{record.pose_id:02d}.jpg" == path
        assert record.booster_sha256 == (patch.record.png_sha256 if record.variant == "patched" else None)
        pose = next(pose for pose in plan.objects["crate"] if pose.id == record.pose_id)
        np.testing.assert_allclose(record.T_world_camera, pose.matrix(), atol=1e-5)
        assert record.intrinsics["fx"] == pytest.approx(48 / np.tan(np.radians(20)))
        assert record.made["renderer"] == "raycast" and record.made["seed"] == 0


def test_pairs_differ_on_the_patch_and_hardly_elsewhere(shot):
    folder = shot.captures_dir / "sim"
    for pose in read_plan(shot.plan_file).objects["crate"]:
        pair = [
            np.asarray(Image.open(folder / f"crate/{v}/pose_{pose.id:02d}.jpg"), float)
            for v in ("unpatched", "patched")
        ]  # fmt: skip
        change = np.abs(pair[0] - pair[1]).max(axis=-1)
        camera = read_plan(shot.plan_file).camera
        corners = np.array([[x, y, 40.5] for x in (-26, 26) for y in (-26, 26)])
        pixels, _ = project(camera, pose.matrix(), corners)
        (left, top), (right, bottom) = np.floor(pixels.min(axis=0)).astype(int), np.ceil(pixels.max(axis=0)).astype(int)
        inside = np.zeros((72, 96), bool)
        inside[top:bottom, left:right] = True
        assert change[inside].mean() > 20
        assert change[~inside].mean() < 3


def test_transforms_place_the_cameras(shot):
    for variant in ("patched", "unpatched"):
        folder = shot.captures_dir / "sim" / "crate" / variant
        content = json.loads((folder / "transforms.json").read_text())
        paths = [f"crate/{variant}/{frame['file_path']}" for frame in content["frames"]]
        assert paths == [path for path in PATHS if f"/{variant}/" in path]
        assert all((folder / frame["file_path"]).is_file() for frame in content["frames"])
    assert not (shot.captures_dir / "sim" / "transforms.json").exists()
    pose = read_plan(shot.plan_file).objects["crate"][1]
    matrix = np.array(content["frames"][1]["transform_matrix"])
    np.testing.assert_allclose(matrix[:3, 3] * 1000, pose.matrix()[:3, 3], atol=1e-3)
    np.testing.assert_allclose(-matrix[:3, 2], pose.matrix()[:3, 2], atol=1e-5)


def test_a_second_run_does_nothing(space):
    before, manifest = contents(space), (space.captures_dir / "sim" / MANIFEST).read_bytes()
    result = shoot(space)
    assert (result.shot, result.kept) == (0, 4)
    assert contents(space) == before and (space.captures_dir / "sim" / MANIFEST).read_bytes() == manifest


def test_where_nothing_is_left_to_shoot_no_compiler_is_loaded(shot):
    code = """
import sys
from toolkit.cli import main
try:
    main()
finally:
    print("HEAVY", sorted({"numba", "open3d", "torch"} & set(sys.modules)))
"""
    command = [sys.executable, "-c", code, "capture-sim", "--object", "crate", "--backdrop", "white"]
    done = subprocess.run(command, cwd=shot.root, capture_output=True, text=True, check=False)
    assert "shot 0 images, 4 kept" in done.stdout and done.stdout.endswith("HEAVY []\n"), done.stdout + done.stderr


def test_variants_and_objects_named_twice_are_shot_once(space):
    (space.captures_dir / "sim" / "crate/patched/pose_01.jpg").unlink()
    result = shoot(space, ["patched", "patched"], objects=["crate", "crate"])
    assert (result.shot, result.kept) == (1, 1)


@pytest.mark.slow
def test_another_patch_means_other_patched_images_only(space, patch_record):
    before = contents(space)
    pixels = np.full((12, 12, 3), 30, np.uint8)
    write_patch(space.patches_dir, pixels, patch_record("crate"))
    result = shoot(space)
    assert (result.shot, result.kept) == (2, 2)
    after = contents(space)
    changed = {path for path in after if after[path] != before[path]}
    assert changed == {path for path in PATHS if "/patched/" in path}
    assert read_manifest(space.captures_dir / "sim")[PATHS[0]].booster_sha256 == sha256_file(space.patch("crate"))


@pytest.mark.slow
def test_another_place_for_the_patch_means_other_patched_images_only(space):
    spec = space.objects_dir / "crate.toml"
    spec.write_text(spec.read_text() + "offset_mm = [8, 0]\n")
    result = shoot(space)
    assert (result.shot, result.kept) == (2, 2)


@pytest.mark.parametrize("damage", ["deleted", "cut short", "emptied"])
def test_only_a_damaged_image_is_shot_again_and_comes_out_the_same(space, damage):
    before = contents(space)
    file = space.captures_dir / "sim" / PATHS[3]
    if damage == "deleted":
        file.unlink()
    else:
        file.write_bytes(file.read_bytes()[: 500 if damage == "cut short" else 0])
    result = shoot(space)
    assert (result.shot, result.kept) == (1, 3)
    assert contents(space) == before


def test_images_of_another_plan_are_reported_and_left(space):
    plan = read_plan(space.plan_file)
    write_plan(space.plan_file, CapturePlan(camera=plan.camera, objects={"crate": plan.objects["crate"][:1]}))
    result = shoot(space)
    assert (result.shot, result.kept) == (0, 2)
    assert result.stale == ["crate/patched/pose_02.jpg", "crate/unpatched/pose_02.jpg"]
    assert sorted(contents(space)) == PATHS
    assert shoot(space, ["patched"]).stale == ["crate/patched/pose_02.jpg"]


KILLED = """
import os, signal, sys
from pathlib import Path
from toolkit.captures import manifest, shoot
from toolkit.rig.plan import read_plan
from toolkit.core.workspace import Workspace

real, calls = shoot.append_record, 0

def killed(source_dir, record):
    global calls
    calls += 1
    if calls == 2:
        if sys.argv[2] == "half a line":
            with (source_dir / manifest.MANIFEST).open("ab") as stream:
                stream.write(record.model_dump_json().encode()[:57])
        os.kill(os.getpid(), signal.SIGKILL)
    real(source_dir, record)

shoot.append_record = killed
space = Workspace(Path(sys.argv[1]))
settings = shoot.ShootSettings(backdrop="white")
shoot.shoot_plan(space, read_plan(space.plan_file), ["crate"], settings=settings)
"""


@pytest.mark.slow
@pytest.mark.parametrize("moment", ["image without its line", "half a line"])
def test_after_a_kill_the_same_command_ends_with_the_same_bytes(shot, tmp_path, moment):
    shutil.copytree(shot.root, tmp_path / "space")
    space = Workspace(tmp_path / "space")
    shutil.rmtree(space.captures_dir)
    done = subprocess.run([sys.executable, "-c", KILLED, str(space.root), moment], check=False)
    assert done.returncode == -signal.SIGKILL
    assert len(read_manifest(space.captures_dir / "sim")) == 1
    assert len(contents(space)) == 2
    result = shoot(space)
    assert (result.shot, result.kept) == (3, 1)
    assert contents(space) == contents(shot)
    lines = (space.captures_dir / "sim" / MANIFEST).read_text().splitlines()
    assert sorted(json.loads(line)["path"] for line in lines) == PATHS  # nothing lost, nothing twice


@pytest.mark.parametrize(
    ("code", "words"), [(errno.ENOSPC, "the disk is full: free some space"), (errno.EROFS, "file system is read-only")]
)
def test_a_full_or_read_only_disk_is_one_line(space, monkeypatch, code, words):
    (space.captures_dir / "sim" / PATHS[0]).unlink()

    def refuse(_):
        raise OSError(code, "no")

    monkeypatch.setattr("toolkit.core.files.os.fsync", refuse)
    with pytest.raises(ToolkitError, match=words) as caught:
        shoot(space)
    assert PATHS[0] in str(caught.value) and "\n" not in str(caught.value)
    assert not list(space.captures_dir.rglob(".*"))  # no half file is left


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ({"objects": ["crat"]}, r"no object called 'crat': did you mean crate\?"),
        ({"objects": ["eggnog"]}, r"object 'eggnog' is not in .*plan\.json: run 'toolkit plan --object eggnog'"),
        ({"variants": ["patchd"]}, "no variant called 'patchd': did you mean patched"),
        ({"settings": ShootSettings(backdrop="oaken")}, "no backdrop called 'oaken': did you mean oak"),
        ({"settings": ShootSettings(light="sid")}, "no light called 'sid': did you mean side"),
        ({"settings": ShootSettings(renderer="raycat")}, "no renderer called 'raycat': did you mean raycast"),
        ({"settings": ShootSettings(image_format="jpeg")}, "no image format called 'jpeg'"),
        ({"source": "../elsewhere"}, r"source '\.\./elsewhere': expected the name of one folder"),
        ({"source": ""}, "source '': expected the name of one folder"),
    ],
)
def test_unknown_names_are_refused_before_anything_is_written(shot, monkeypatch, call, words):
    monkeypatch.setattr("toolkit.objects.load.build_mesh", lambda name: load_object(shot.object_spec("crate")).mesh)
    before = contents(shot)
    with pytest.raises(ToolkitError, match=words):
        shoot(shot, **call)
    assert contents(shot) == before


def test_pictures_of_the_second_renderers_older_version_are_shot_again(space):
    """And those of the first keep their hash."""
    item = load_object(space.object_spec("crate"))
    looks = [describe_look(space, item, "unpatched", ShootSettings(renderer=name)) for name in ("raycast", "filament")]
    assert [look.get("filament") for look in looks] == [None, RENDERERS["filament"].version]


def test_a_patch_that_is_not_its_records_is_refused(space):
    png = space.patch("crate")
    Image.fromarray(np.zeros((12, 12, 3), np.uint8)).save(png)
    with pytest.raises(ToolkitError, match=r"crate\.png: its hash .* does not match the record's"):
        shoot(space)
    assert shoot(space, ["unpatched"]).kept == 2


def test_a_patch_is_found_by_name_by_class_or_not_at_all(space, patch_record):
    item = load_object(space.object_spec("crate"))
    assert find_patch(space, item).record.name == "crate"
    for file in space.patches_dir.glob("crate.*"):
        file.unlink()
    with pytest.raises(ToolkitError, match=r"no patch for object 'crate' .*toolkit train-patch --object crate"):
        find_patch(space, item)
    write_patch(space.patches_dir, np.zeros((4, 4, 3), np.uint8), patch_record("x") | {"class_name": "crate"})
    assert find_patch(space, item).record.name == "x"


def test_png_and_seed_are_honoured(space):
    png = ShootSettings(backdrop="white", image_format="png")
    result = shoot(space, ["unpatched"], png)
    folder = space.captures_dir / "sim"
    assert result.shot == 2 and result.stale == ["crate/unpatched/pose_01.jpg", "crate/unpatched/pose_02.jpg"]
    exact = np.asarray(Image.open(folder / "crate/unpatched/pose_01.png"), float)
    lossy = np.asarray(Image.open(folder / "crate/unpatched/pose_01.jpg"), float)
    assert np.abs(exact - lossy).mean() < 2  # the same picture
    other = shoot(space, ["unpatched"], ShootSettings(seed=1, backdrop="white", image_format="png"))
    assert other.shot == 2
    assert (np.asarray(Image.open(folder / "crate/unpatched/pose_01.png"), float) != exact).any()


@pytest.mark.slow
def test_controls_differ_from_the_patch_in_what_they_say(space, patch_record):
    """The same place and size with another, a random or a grey print; and the patch without the object."""
    pixels = np.zeros((12, 12, 3), np.uint8)
    write_patch(space.patches_dir, pixels, patch_record("crate2") | {"class_index": 2})  # next by name
    assert shoot(space, CONTROLS_OF["patched"]).shot == 2 * len(CONTROLS_OF["patched"])
    folder, camera = space.captures_dir / "sim", read_plan(space.plan_file).camera
    pose = read_plan(space.plan_file).objects["crate"][0]
    place, _ = project(camera, pose.matrix(), np.array([[0, 0, 40.5]]))
    x, y = place[0].astype(int)

    def picture(variant):
        return np.asarray(Image.open(folder / f"crate/{variant}/pose_01.jpg"), float)

    def middle(variant):
        return picture(variant)[y - 4 : y + 5, x - 4 : x + 5]

    assert middle("wrong-patch").mean() < 60  # printed black
    assert np.ptp(middle("grey-patch").mean(axis=(0, 1))) < 12 and middle("grey-patch").std(axis=(0, 1)).max() < 12
    assert middle("random-patch").std(axis=(0, 1)).min() > 15
    records = read_manifest(folder)
    patch, other = (sha256_file(space.patch(name)) for name in ("crate", "crate2"))
    assert records["crate/patch-alone/pose_01.jpg"].booster_sha256 == patch
    assert records["crate/wrong-patch/pose_01.jpg"].booster_sha256 == other
    # without the object there is table where the object's front was
    front, _ = project(camera, pose.matrix(), np.array([[50, 0, 20.0]]))
    u, v = front[0].astype(int)
    assert np.abs(picture("patch-alone")[v, u] - picture("patched")[v, u]).max() > 10


def test_photographs_are_not_shot_over(tmp_path, make_crate_space):
    from toolkit.captures.manifest import CaptureRecord, append_record

    space = make_crate_space(tmp_path / "w")
    source = space.captures_dir / "kitchen"
    source.mkdir(parents=True)
    append_record(source, CaptureRecord(path="crate/patched/pose_01.jpg", object="crate", variant="patched"))
    with pytest.raises(ToolkitError, match=r"holds photographs \(crate/patched/pose_01.jpg\).*name another source"):
        shoot_plan(space, read_plan(space.plan_file), ["crate"], source="kitchen")
