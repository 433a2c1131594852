"""Where a patch is best stuck: against boxes on which the answer is known."""

import json
from dataclasses import replace

import numpy as np
import pytest
from box_object import as_object, look
from typer.testing import CliRunner

from toolkit.cli.app import make_single
from toolkit.cli.rig import place
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import make_ray_scene, merge_meshes
from toolkit.objects.spec import PatchMount, read_spec, write_mounts
from toolkit.rig import PlaceConfig
from toolkit.rig.camera import Camera
from toolkit.rig.patch_places import find_places, judge_place
from toolkit.rig.plan import Pose

CAMERA = Camera.from_fov(640, 480, 40)


def judge(item: TableObject, poses: list[Pose], **mount):
    return judge_place(item, make_ray_scene(item.mesh), CAMERA, poses, PatchMount(**mount))


def test_from_straight_above_a_flat_sheet_is_seen_whole_and_as_large_as_the_pinhole_says(make_box):
    item = as_object(make_box((200.0, 160.0, 40.0)))
    found = judge(item, look(item, (0, 90)), at="top", size_mm=60)
    depth = 700 - 20 - 1  # to the top of the box, and the sheet's lift
    side_px = 70 * CAMERA.fx / depth
    assert found.visible == 1 and found.poses_seen == 1 and found.fit.lies
    assert found.area_px == pytest.approx(side_px**2, rel=0.01)
    assert found.score == pytest.approx(side_px, rel=0.01)


def test_half_of_the_sheet_behind_something_is_half_seen(make_box):
    """A board hangs over it, from 3.5 mm beside its middle on: 38.5 of the sheet's 70 mm are free."""
    box, cover = make_box((200.0, 160.0, 40.0)), make_box((100.0, 160.0, 5.0))
    lifted = replace(cover, vertices=cover.vertices + np.float32([53.5, 0, 100]))
    item = as_object(box)
    scene = make_ray_scene(merge_meshes([box, lifted]))
    poses = look(item, (0, 90))
    bare, hidden = (
        judge_place(item, one, CAMERA, poses, PatchMount(at="top", size_mm=60)) for one in (make_ray_scene(box), scene)
    )
    assert hidden.visible == pytest.approx(38.5 / 70, abs=0.01)
    assert hidden.area_px == pytest.approx(bare.area_px * 38.5 / 70, rel=0.02)


def test_what_faces_away_is_not_seen(make_box):
    item = as_object(make_box((200.0, 160.0, 120.0)))
    front = look(item, (0, 5))
    assert judge(item, front, at="front", size_mm=60).visible == 1
    assert judge(item, front, at="back", size_mm=60).visible == 0


def test_the_best_place_is_the_side_that_the_cameras_look_at(make_box):
    item = as_object(make_box((200.0, 160.0, 120.0)))
    config = PlaceConfig(steps=6)
    for angles, side in (((90, 5), "left"), ((0, 90), "top")):
        best = find_places(item, CAMERA, look(item, angles), config, [60.0])[0]
        assert best.mount.at == side and best.poses_seen == 1
    several = find_places(item, CAMERA, look(item, (0, 60), (120, 60), (240, 60)), config, [60.0, 40.0])
    assert [one.mount.size_mm for one in several] == [60] * 3 + [40] * 3
    assert several[0].mount.at == "top" and several[0].poses_seen == 3
    middles = [one.fit.points_mm.mean(axis=0) for one in several[:3]]
    gaps = [np.linalg.norm(a - b) for i, a in enumerate(middles) for b in middles[:i]]
    assert min(gaps) >= 70, "no two sheets on each other"


def test_no_tent_over_an_open_lid(make_box):
    """Four walls and a floor: a sheet as wide as the opening would lie on the rims alone."""
    walls = [
        replace(make_box(size), vertices=make_box(size).vertices + np.float32(at))
        for size, at in (
            ((160.0, 4.0, 100.0), (0, 38, 0)), ((160.0, 4.0, 100.0), (0, -38, 0)), ((4.0, 80.0, 100.0), (78, 0, 0)),
            ((4.0, 80.0, 100.0), (-78, 0, 0)), ((160.0, 80.0, 4.0), (0, 0, 0)),
        )
    ]  # fmt: skip
    item = as_object(merge_meshes(walls))
    assert not judge(item, look(item, (0, 90)), at="top", size_mm=76).fit.lies
    found = find_places(item, CAMERA, look(item, (0, 60)), PlaceConfig(steps=6, sides=("top",)), [76.0])
    assert found == []


@pytest.fixture
def typed(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path / "w")
    command = make_single(place)

    def run(*arguments: str):
        return CliRunner().invoke(command, [*arguments, "--workspace", str(space.root), "--steps", "4", "--quiet"])

    return space, run


def test_the_command_changes_nothing_unless_it_is_asked_to(typed):
    space, run = typed
    file = space.objects_dir / "crate.toml"
    before = file.read_text()
    done = run("--object", "crate", "--size-mm", "30", "--json")
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert file.read_text() == before and told["written"] is None
    assert told["now"]["size_mm"] == 40 and {one["size_mm"] for one in told["places"]} == {30}
    assert told["places"][0]["at"] == "top" and (space.root / "rig" / "preview" / "crate-places.png").is_file()
    done = run("--object", "crate", "--size-mm", "30", "--write")
    assert done.exit_code == 0, done.output
    assert read_spec(file).mounts[0].size_mm == 30 and read_spec(file).class_name == "crate"


def test_a_place_that_stands_in_the_file_is_tried_beside_the_grid(typed):
    """Between two places of the grid, and seen better than both: --write must not put a worse one in its stead."""
    space, run = typed
    file = space.objects_dir / "crate.toml"
    between = PatchMount(at="top", size_mm=30, offset_mm=(-30, 0))
    asked = ("--object", "crate", "--size-mm", "30", "--side", "top", "--write", "--json")
    on_grid = json.loads(run(*asked).stdout)["places"][0]
    write_mounts(file, file, [between])
    kept = json.loads(run(*asked).stdout)["places"][0]
    assert kept["score"] > on_grid["score"] and read_spec(file).mounts == (between,)


def test_a_place_is_written_beside_what_else_the_file_says(tmp_path):
    file = tmp_path / "moka.toml"
    file.write_text('class = "coffeepot"  # a moka pot\nmesh = "moka.glb"\nlength_mm = 184\n\n[patch]\nat = "top"\n')
    mount = PatchMount(at="left", size_mm=45, offset_mm=(3, -4.5))
    assert write_mounts(file, file, [mount]) == file
    assert read_spec(file).mounts == (mount,) and read_spec(file).length_mm == 184
    assert "# a moka pot" in file.read_text()
    built_in = Workspace(tmp_path).object_spec("racer")
    written = write_mounts(built_in, tmp_path / "rig" / "objects" / "racer.toml", [mount])
    assert read_spec(written).mounts[0] == mount and read_spec(built_in).mounts[0] != mount
    assert Workspace(tmp_path).object_spec("racer") == written


@pytest.mark.parametrize("arguments", [("--size-mm", "70"), ("--side", "bottom")])
def test_what_cannot_be_is_a_line(typed, arguments):
    _, run = typed
    done = run("--object", "crate", *arguments)
    assert done.exit_code != 0 and done.exception is not None
    assert any(word in str(done.exception) for word in ("fits flat anywhere", "side"))


@pytest.mark.slow
def test_a_short_training_in_each_place_is_told_and_leaves_nothing(typed, monkeypatch):
    from tiny_network import tiny_classifier

    from toolkit.boosters import patch_config

    network = replace(tiny_classifier(), labels=["cat", "dog", "sports car", "crate"])
    monkeypatch.setattr("toolkit.models.load.load_classifiers", lambda *arguments: [network])
    slim = patch_config.RECIPES["default"].model_copy(update={"size_px": 16, "batch": 2, "mounted_views": 4})
    monkeypatch.setitem(patch_config.RECIPES, "default", slim)
    space, run = typed
    before = {file for file in space.root.rglob("*") if file.is_file()}
    done = run("--object", "crate", "--size-mm", "30", "--best", "1", "--side", "top", "--train", "1", "--json")
    assert done.exit_code == 0, done.output
    (told,) = json.loads(done.stdout)["places"]
    assert set(told["trained"]) == {"tiny"} and 0 <= told["trained"]["tiny"]["patched"] <= 1
    assert {file.name for file in space.root.rglob("*") if file.is_file() and file not in before} == {
        "crate-places.png"
    }
