"""Several sheets on one object: against boxes on which every place is known."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from toolkit.captures.manifest import read_manifest
from toolkit.captures.shoot import sha256_json, shoot_plan
from toolkit.cli.app import make_single
from toolkit.cli.setup import list_objects
from toolkit.core.errors import ToolkitError
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.mesh import merge_meshes
from toolkit.objects.records import TAPE_MARGIN_MM
from toolkit.objects.spec import ObjectSpec, PatchMount, read_spec, write_mounts
from toolkit.rig.fit import describe_misfits, mounted_sizes_mm, sheet_points
from toolkit.rig.mount import mount_sheets, wear_sheets
from toolkit.rig.plan import list_misfits, read_plan
from toolkit.rig.variants import apply_booster, find_booster, note_booster

PX = np.random.default_rng(3).integers(0, 256, (8, 8, 3), dtype=np.uint8)
TOP, LEFT = PatchMount(at="top", size_mm=40), PatchMount(at="left", size_mm=25)
TWO_TABLES = '[[patch]]\nat = "top"\nsize_mm = 40\n\n[[patch]]\nat = "left"\nsize_mm = 25\n'


@pytest.fixture
def space(tmp_path, make_crate_space):
    """The crate, 100 × 60 × 40 mm, with 40 mm on its top and 25 mm on its left."""
    space = make_crate_space(tmp_path / "w")
    file = space.objects_dir / "crate.toml"
    file.write_text(file.read_text().partition("[patch]")[0] + TWO_TABLES)
    return space


@pytest.fixture
def crate(space) -> TableObject:
    return load_object(space.object_spec("crate"))


def test_one_table_and_several_are_read_and_one_is_written_as_before(space, tmp_path):
    spec = read_spec(space.object_spec("crate"))
    assert spec.mounts == (TOP, LEFT) and spec.sizes_mm(88) == (40, 25)
    assert [mount["at"] for mount in spec.model_dump()["patch"]] == ["top", "left"]
    one = spec.with_mounts([TOP])
    assert one.model_dump()["patch"] == TOP.model_dump()  # what hashes are made of
    assert ObjectSpec.model_validate(spec.model_dump(by_alias=True) | {"class": "crate"}) == spec
    written = write_mounts(space.object_spec("crate"), tmp_path / "crate.toml", [TOP])
    assert "[[patch]]" not in written.read_text() and read_spec(written).mounts == (TOP,)
    again = write_mounts(written, tmp_path / "again" / "crate.toml", [LEFT, TOP])
    assert again.read_text().count("[[patch]]") == 2 and read_spec(again).mounts == (LEFT, TOP)


@pytest.mark.parametrize(
    ("tables", "words"),
    [("patch = []\n", "at least 1 item"), (TWO_TABLES.replace("left", "bottom"), r"field 'patch\.1\.at'")],
)
def test_a_wrong_table_is_named_by_its_number(tmp_path, tables, words):
    file = tmp_path / "crate.toml"
    file.write_text('class = "crate"\nmesh = "crate.obj"\nlength_mm = 100\n' + tables)
    with pytest.raises(ToolkitError, match=words):
        read_spec(file)


def test_each_lies_on_its_own_side_in_its_own_size(crate):
    top, left = mount_sheets(crate.mesh, PX, [TOP, LEFT], [40, 25], "crate")
    low, high = crate.mesh.bounds
    assert np.ptp(top.mesh.vertices, axis=0)[:2] == pytest.approx([50, 50], abs=0.1)
    assert np.ptp(left.mesh.vertices, axis=0)[[0, 2]] == pytest.approx([35, 35], abs=0.1)
    assert top.mesh.vertices[:, 2].min() > high[2] and left.mesh.vertices[:, 1].min() > high[1]
    assert low[0] < left.mesh.vertices[:, 0].min()


def test_all_share_one_paper_texel_on_texel(crate):
    """The shared texture at a sheet's new place is its own texture at the old one, margin and patch alike."""
    sheets = mount_sheets(crate.mesh, PX, [TOP, LEFT], [40, 25], "crate")
    mesh, paper = wear_sheets(crate.mesh, sheets)
    assert sum(material.texture is paper for material in mesh.materials) == 2
    vertex, side = len(crate.mesh.vertices), len(paper)
    for sheet in sheets:
        own, count = sheet.mesh.materials[0].texture, len(sheet.mesh.vertices)
        moved = mesh.uv[vertex : vertex + count]
        vertex += count
        assert moved.min() > -1e-6 and moved.max() < 1 + 1e-6
        # places of both are affine in one another: look at the middles of the sheet's own texels
        texels = np.arange(len(own)) + 0.5
        scale = np.ptp(moved[:, 0]) / np.ptp(sheet.mesh.uv[:, 0])
        there = ((texels / len(own) - 0.5) * scale + 0.5) * side
        np.testing.assert_allclose(there % 1, 0.5, atol=1e-3)  # the middle of a texel again
        rows = np.floor(there).astype(int)
        np.testing.assert_array_equal(paper[np.ix_(rows, rows)], own)


def test_a_single_sheet_is_worn_as_it_was(crate):
    (sheet,) = mount_sheets(crate.mesh, PX, [TOP], [40], "crate")
    mesh, paper = wear_sheets(crate.mesh, [sheet])
    assert paper is sheet.mesh.materials[0].texture
    np.testing.assert_array_equal(mesh.uv[len(crate.mesh.vertices) :], sheet.mesh.uv)


@pytest.mark.parametrize(
    ("first", "second", "overlap"),
    [
        ({"offset_mm": (-16, 0)}, {"offset_mm": (16, 0)}, False),  # 20 + 10 mm each, edges 2 mm apart
        ({"offset_mm": (-15, 0)}, {"offset_mm": (15, 0)}, False),  # edge on edge
        ({"offset_mm": (-12, 0)}, {"offset_mm": (12, 0)}, True),
        ({"offset_mm": (0, 0)}, {"offset_mm": (0, 0), "rotation_deg": 45}, True),
        ({"at": "left"}, {"at": "right"}, False),
    ],
)
def test_sheets_that_lie_on_one_another_are_a_line(crate, first, second, overlap):
    mounts = [PatchMount(**first), PatchMount(**second)]
    if not overlap:
        assert len(mount_sheets(crate.mesh, PX, mounts, [20, 20], "crate")) == 2
        return
    with pytest.raises(ToolkitError, match=r"crate: sheet 1 \(top\) and sheet 2 \(top\) overlap"):
        mount_sheets(crate.mesh, PX, mounts, [20, 20], "crate")


def test_a_sheet_below_one_that_spans_two_ridges_is_under_it(make_box):
    """Ridges of 15 mm, 84 mm apart: one of 80 + 10 mm rests on them, one of 40 mm lies between, with air above it."""
    ridge = make_box((6.0, 100.0, 15.0))
    ridges = [replace(ridge, vertices=ridge.vertices + np.float32([x, 0, 20])) for x in (-42, 42)]
    tray = merge_meshes([make_box((200.0, 100.0, 20.0)), *ridges])
    heights = [mount_sheets(tray, PX, [TOP], [size])[0].mesh.vertices[:, 2].mean() for size in (80, 40)]
    assert heights[0] - heights[1] > 10
    with pytest.raises(ToolkitError, match="overlap"):
        mount_sheets(tray, PX, [TOP, TOP], [80, 40])


def test_a_thin_plate_is_between_its_two_sides(make_box):
    plate = make_box((100.0, 1.0, 80.0))
    assert len(mount_sheets(plate, PX, [PatchMount(at="left"), PatchMount(at="right")], [40, 40], "plate")) == 2


def test_which_sheet_does_not_lie_is_said(space, crate):
    assert describe_misfits(crate, mounted_sizes_mm(space, crate)) == []
    (line,) = describe_misfits(crate, (40, 46))
    assert "crate: sheet 2, a patch of 46 mm does not fit flat on its left" in line, line
    with pytest.raises(ToolkitError, match="crate, sheet 2: a patch of 70 mm is over half"):
        mount_sheets(crate.mesh, PX, crate.spec.mounts, (40, 70), "crate")
    twice = TableObject(crate.spec.with_mounts([TOP, TOP]), crate.mesh)
    (line,) = describe_misfits(twice, (40, 40))
    assert "sheet 1 (top) and sheet 2 (top) overlap" in line
    write_mounts(space.object_spec("crate"), space.object_spec("crate"), [TOP, LEFT.model_copy(update={"size_mm": 46})])
    assert any("sheet 2" in one for one in list_misfits(space, ["crate"]))


def test_a_plan_frames_all_of_them(space, crate):
    points = sheet_points(space, crate)
    side = 25 + 2 * TAPE_MARGIN_MM
    on_left = points[points[:, 1] > crate.mesh.bounds[1][1]]
    assert np.ptp(on_left, axis=0)[[0, 2]] == pytest.approx([side, side], abs=0.1)
    assert points[:, 2].max() > crate.mesh.bounds[1][2]


def test_the_rig_shoots_all_of_them_and_the_manifest_says_so(space, crate):
    booster = find_booster(space, crate, "patched")
    assert booster.sizes_mm == (40, 25) and note_booster(booster)["booster_mm"] == [40, 25]
    looks = booster.describe(crate)
    assert looks["mm"] == [40, 25] and [mount["at"] for mount in looks["mount"]] == ["top", "left"]
    one = TableObject(crate.spec.with_mounts([TOP]), crate.mesh)
    before = {"patch": booster.sha256, "mm": 40.0, "mount": TOP.model_dump()}
    assert sha256_json(find_booster(space, one, "patched").describe(one)) == sha256_json(before)
    alone = apply_booster(crate, find_booster(space, crate, "patch-alone"))
    assert alone.size_mm[:2] == pytest.approx([50, 50], abs=0.1)
    shoot_plan(space, read_plan(space.plan_file), ["crate"], ["patched"])
    records = read_manifest(space.captures_dir / "sim").values()
    assert [record.made["booster_mm"] for record in records] == [[40, 25], [40, 25]]


def test_objects_lists_the_side_of_each(space):
    done = CliRunner().invoke(make_single(list_objects), ["--workspace", str(space.root), "--json"])
    at = {row["name"]: row["patch_at"] for row in json.loads(done.stdout)}
    assert at["crate"] == ["top", "left"] and at["racer"] == "top"
