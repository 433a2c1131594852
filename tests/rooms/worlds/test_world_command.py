"""`toolkit world` as typed: what it lists, makes and refuses in one line."""

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from typer.testing import CliRunner
from walled_field import make_field

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.rooms.worlds import own
from toolkit.rooms.worlds.content.city import build_city
from toolkit.rooms.worlds.world import World

QUICK = ("--resolution", "64", "64", "--film-s", "0")


def make_meadow(seed: int) -> World:
    return replace(make_field(), name="grass")


@pytest.fixture
def space(tmp_path, monkeypatch) -> Iterator[Workspace]:
    """A workspace in which `grass` is a field with a wall, and there is no other built-in world."""
    own.build_world.cache_clear()
    monkeypatch.setattr(own, "WORLDS", {"grass": f"{__name__}:make_meadow"})
    yield make_workspace(tmp_path / "lab")
    own.build_world.cache_clear()


def call(space: Workspace, *words: object):
    return CliRunner().invoke(app, ["world", *map(str, words), "--workspace", str(space.root)])


def write_yard(path: Path, scale: float = 1.0, picture: bool = True, ground: bool = True) -> Path:
    """A slab of 40 m with a block on it, y up."""
    scene = trimesh.Scene()
    for k, (size, at) in enumerate([((40, 1, 40), (0, -0.5, 0)), ((4, 6, 4), (14, 3, 12))]):
        if k == 0 and not ground:
            size, at = (4, 1, 4), (-18, -0.5, -18)
        box = trimesh.creation.box(np.array(size) * scale)
        box.apply_translation(np.array(at) * scale)
        if picture:
            look = trimesh.visual.material.PBRMaterial(
                baseColorTexture=Image.new("RGB", (8, 8), (90 + 60 * k, 120, 90))
            )
            box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(box.vertices), 2)), material=look)
        scene.add_geometry(box, node_name=f"n{k}", geom_name=f"n{k}")
    path.parent.mkdir(parents=True, exist_ok=True)
    scene.export(path)
    return path


def test_the_list_has_the_studio_the_built_in_and_ones_own(space) -> None:
    write_yard(space.worlds_dir / "yard.glb")
    rows = {row["name"]: row for row in json.loads(call(space, "list", "--json").stdout)}
    assert list(rows) == ["studio", "grass", "yard"]
    assert rows["grass"]["triangles"] == 14 and rows["grass"]["spots"] == 3 and rows["grass"]["pads"] == 0
    assert rows["grass"]["size_m"] == [80.0, 80.0, 5.0] and rows["grass"]["classes"] == ["ground", "building"]
    assert rows["yard"]["size_m"][:2] == [40.0, 40.0] and rows["yard"]["file"].endswith("yard.glb")
    assert "your own: put a GLB" in call(space, "list").stdout


def test_a_world_of_ones_own_that_cannot_be_used_is_listed_with_the_reason(space) -> None:
    (space.worlds_dir).mkdir()
    (space.worlds_dir / "broken.glb").write_bytes(b"glTF")
    result = call(space, "list")
    assert result.exit_code == 1
    assert "grass" in result.stdout and "skipped broken: " in result.output


@pytest.mark.slow
def test_a_preview_says_what_was_made_and_does_nothing_twice(space) -> None:
    words = ("preview", "grass", "--time", "overcast", "--weather", "rain:5", *QUICK)
    result = call(space, *words)
    assert result.exit_code == 0, result.exception
    folder = space.worlds_dir / "grass"
    assert f"made 7 files of grass: {folder}" in result.output and "next: toolkit world export grass" in result.output
    assert {"overcast-street.jpg", "overcast-rain-5-street.jpg", "map.png"} <= {one.name for one in folder.iterdir()}
    again = json.loads(call(space, *words, "--json").stdout)
    assert not again["made"] and len(again["kept"]) == 7


def test_ones_own_world_wins_and_is_exported(space, tmp_path) -> None:
    write_yard(space.worlds_dir / "grass.glb")
    said = json.loads(call(space, "export", "grass", "--out", tmp_path / "x.glb", "--json").stdout)
    assert said["triangles"] == 24
    assert trimesh.load_scene(tmp_path / "x.glb").extents == pytest.approx([40, 7, 40], abs=1e-3)


def test_an_object_is_exported_where_it_stands(space, tmp_path) -> None:
    words = ("export", "grass", "--object", "racer", "--length-m", 4, "--place", "west", "--out", tmp_path / "x.glb")
    result = call(space, *words)
    assert result.exit_code == 0, result.exception
    parts = [one for one in trimesh.load_scene(tmp_path / "x.glb").geometry.values() if len(one.faces) > 12]
    low, high = np.min([one.bounds[0] for one in parts], 0), np.max([one.bounds[1] for one in parts], 0)
    assert (high - low).max() == pytest.approx(4.0, abs=0.05)
    middle = (low + high) / 2
    assert middle[[2, 0]] == pytest.approx([-4.0, 0.0], abs=0.1) and low[1] == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("preview", "gras"), "no world called 'gras': did you mean grass?"),
        (("preview", "nowhere.glb"), "nowhere.glb: no such mesh file"),
        (("preview", "studio"), "the studio is a table top, no world"),
        (("preview", "grass", "--time", "dawn"), "no time of day called 'dawn': known: noon"),
        (("preview", "grass", "--weather", "fgo"), "no weather called 'fgo': did you mean fog"),
        (("preview", "grass", "--weather", "fog:9"), "severity '9'"),
        (("preview", "grass", "--sky", "sky.mov"), "sky.mov: expected a panorama as .hdr"),
        (("preview", "grass", "--variant", "textured"), "--variant textured: needs an object: name it with --object"),
        (("preview", "grass", "--place", "west"), "--place west: needs an object"),
        (("preview", "grass", "--object", "racre"), "no object called 'racre': did you mean racer?"),
        (("preview", "grass", "--object", "racer", "--place", "wets"), "no place in the world grass called 'wets'"),
        (
            ("preview", "grass", "--object", "racer", "--variant", "patch-alone"),
            "shows a patch on a table without its object",
        ),
        (
            ("preview", "grass", "--object", "racer", "--length-m", "99"),
            "grass has no place for an object that reaches",
        ),
        (("preview", "grass", "--resolution", "9", "9"), "--resolution 9 9: expected 64 to 7680 pixels"),
        (("preview", "grass", "--film-s", "-1"), "--film-s -1: expected 0 to 300 seconds"),
        (("preview", "grass", "--world-scale", "2"), "--world-scale 2"),
        (("export", "grass", "--out", "x.obj"), "--out x.obj: expected a file that ends in .glb"),
        (("prevew", "grass"), "no command called 'world prevew': did you mean world preview?"),
    ],
)
def test_what_cannot_be_meant_is_one_line(space, words, said) -> None:
    result = call(space, *words)
    assert isinstance(result.exception, ToolkitError), result.exception
    assert said in str(result.exception) and "\n" not in str(result.exception)
    assert not list(space.worlds_dir.glob("grass/*"))


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (
            {"scale": 1000.0},
            r"the world is 40,000 m across, expected 15 to 6000: is it in centimetres\? try --world-scale",
        ),
        ({"scale": 0.1}, r"the world is 4 m across.*give the --world-scale that makes it metres"),
        ({"picture": False}, r"a world needs textures or colours, but this has none"),
        ({"ground": False}, r"no ground: only \d+% of its plan has anything under it"),
    ],
)
def test_a_mesh_that_is_no_world_is_one_line(space, tmp_path, made, said) -> None:
    file = write_yard(tmp_path / "yard.glb", **made)
    result = call(space, "preview", file, *QUICK)
    assert isinstance(result.exception, ToolkitError), result.exception
    assert re.search(said, str(result.exception)) and "\n" not in str(result.exception)


def test_a_mesh_in_centimetres_is_told_its_scale_and_taken_with_it(space, tmp_path) -> None:
    file = write_yard(tmp_path / "yard.glb", 300.0)  # 12 km: 120 m in centimetres
    refused = call(space, "preview", file, *QUICK)
    assert "12,000 m across" in str(refused.exception) and "try --world-scale 0.01" in str(refused.exception)
    taken = call(space, "export", file, "--world-scale", "0.01", "--json")
    assert json.loads(taken.stdout)["triangles"] == 24


def test_the_city_is_a_city_to_the_list() -> None:
    from toolkit.rooms.worlds.commands import describe_world

    row = describe_world(build_city(0, blocks=(1, 2)), None)
    assert {"road", "building", "vehicle", "tree", "furniture", "sign", "skyline"} <= set(row["classes"])


def test_the_parts_of_the_command_start_quickly() -> None:
    heavy = "[m for m in ('torch', 'open3d', 'cv2') if m in sys.modules]"
    code = f"import sys; import toolkit.rooms.worlds.commands; print({heavy})"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
