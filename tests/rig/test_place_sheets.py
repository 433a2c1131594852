"""Places for several sheets that go on together: against boxes on which the answer is known."""

import json

import pytest
from box_object import as_object, look
from typer.testing import CliRunner

from toolkit.cli.app import make_single
from toolkit.cli.rig import place
from toolkit.objects.load import load_object
from toolkit.objects.spec import read_spec
from toolkit.rig import Pattern, PlaceConfig
from toolkit.rig.camera import Camera
from toolkit.rig.patch_places import draw_poses, find_sheets, share_seen
from toolkit.rig.plan import make_plan, read_plan, write_plan

CAMERA = Camera.from_fov(640, 480, 40)


def test_the_second_goes_where_the_views_see_the_first_least(make_box):
    """Three views of the left, two of the right: the left is best alone, and beside it nothing helps like the right."""
    item = as_object(make_box((200.0, 160.0, 120.0)))
    poses = look(item, (85, 10), (90, 10), (95, 10), (265, 10), (275, 10))
    chosen = find_sheets(item, CAMERA, poses, PlaceConfig(steps=6, sheets=2), [70])
    assert [one.mount.at for one in chosen] == ["left", "right"]
    assert [one.poses_seen for one in chosen] == [3, 2] and share_seen(chosen) == 1 and share_seen(chosen[:1]) == 0.6


def test_none_overlap_and_none_goes_where_there_is_no_room(make_box):
    """A top of 100 x 60 mm and sides of 100 x 20 mm: of sheets of 30 + 10 mm, two lie side by side on the top."""
    item = as_object(make_box((100.0, 60.0, 20.0)))
    poses = look(item, (0, 10), (120, 10), (240, 10))
    chosen = find_sheets(item, CAMERA, poses, PlaceConfig(steps=20, sheets=4), [30])
    assert [one.mount.at for one in chosen] == ["top", "top"]
    apart = abs(chosen[0].mount.offset_mm[0] - chosen[1].mount.offset_mm[0])
    assert apart >= 40 - 1


def test_random_views_are_in_the_ranges_of_training_and_depend_on_seed_and_number(make_box):
    item = as_object(make_box((200.0, 160.0, 40.0)))
    poses = draw_poses(item, CAMERA, 30, 4)
    assert all(20 <= pose.elevation_deg <= 70 and abs(pose.roll_deg) <= 8 for pose in poses)
    assert len({pose.azimuth_deg for pose in poses}) == 30
    assert draw_poses(item, CAMERA, 3, 4) == poses[:3] and draw_poses(item, CAMERA, 3, 5) != poses[:3]


@pytest.fixture
def typed(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path / "w")

    def run(*arguments: str):
        fixed = ["--object", "crate", "--workspace", str(space.root), "--steps", "5", "--quiet"]
        done = CliRunner().invoke(make_single(place), [*fixed, *arguments])
        assert done.exit_code == 0, done.output
        return done

    return space, run


def test_the_plan_decides_nothing_of_several_and_write_makes_tables(typed):
    space, run = typed
    first = json.loads(run("--sheets", "2", "--size-mm", "25", "--json").stdout)
    assert len(first["places"]) == 2 and first["poses"] == 64 and first["written"] is None
    item, low = load_object(space.object_spec("crate")), Pattern(name="ring", count=2, elevation_deg=(5, 5))
    write_plan(space.plan_file, make_plan([item], read_plan(space.plan_file).camera, low))
    done = run("--sheets", "2", "--size-mm", "25", "--json", "--write")
    again = json.loads(done.stdout)
    assert again["places"] == first["places"] and again["now"] == first["now"]
    mounts = read_spec(space.object_spec("crate")).mounts
    assert [(one.at, one.size_mm) for one in mounts] == [(one["at"], 25) for one in first["places"]]
    said = " ".join(run("--sheets", "2", "--size-mm", "25").stdout.split())
    assert "2 sheets together" in said and "of 64 random views show half of a sheet" in said


def test_fewer_sheets_than_were_asked_for_are_said(typed):
    _, run = typed
    done = run("--sheets", "6", "--size-mm", "40", "--side", "top")
    said = " ".join(done.stdout.split())
    assert "1 sheet; " in said and "there is room for 1 of 6 sheets" in done.stderr
