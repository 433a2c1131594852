"""`toolkit add`: from a mesh to an object, its spec and its picture."""

import json

import numpy as np
import pytest
import trimesh
from PIL import Image
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace, open_workspace
from toolkit.objects.add import add_object
from toolkit.objects.load import load_object
from toolkit.objects.spec import ObjectRequest
from toolkit.rig.fit import measure_fit

REPLACED = ObjectRequest(class_name="coffee mug", replace=True)


@pytest.fixture
def space(tmp_path, monkeypatch):
    made = make_workspace(tmp_path / "space")
    monkeypatch.chdir(made.root)
    brick = trimesh.creation.box((10, 20, 30))
    brick.visual.face_colors = [200, 40, 30, 255]
    brick.export(tmp_path / "brick.ply")
    return made


def call(*arguments, code=0):
    result = CliRunner().invoke(app, ["add", *map(str, arguments)])
    assert result.exit_code == code, (result.output, result.exception)
    return result


def refused(*arguments):
    result = CliRunner().invoke(app, ["add", *map(str, arguments)])
    assert isinstance(result.exception, ToolkitError), result.output
    return str(result.exception)


@pytest.mark.slow
def test_it_says_what_it_made_and_what_is_next(space):
    said = call("../brick.ply", "--class", "Coffee mug", "--print-side", "front", "--quiet").stdout
    for words in ("added brick, coffee mug", "brick.toml", "brick-object.png", "next: toolkit plan --object brick"):
        assert words in said
    assert "measure the longest side and set length_mm in brick.toml" in said
    item = load_object(space.object_spec("brick"))
    assert item.spec.mounts[0].at == "front" and item.mesh.size_mm.max() == pytest.approx(200)


@pytest.mark.slow
def test_the_preview_shows_the_object_and_the_place_of_its_patch(space):
    """Red where the brick is, blue checks where the patch goes: on the side that was asked for, and no other."""
    given = ("../brick.ply", "--class", "crate", "--length-mm", 90, "--print-side", "front", "--json")
    made = json.loads(call(*given).stdout)
    assert made["files"] == [str(space.objects_dir / "brick" / "brick.ply")] and made["size_mm"] == [60, 30, 90]
    sheet = np.asarray(Image.open(made["preview"]).convert("RGB")).astype(int)
    assert sheet.shape == (480, 1280, 3)
    tiles = sheet[:240].reshape(240, 4, 320, 3).swapaxes(0, 1)  # from 0, 90, 180 and 270 degrees
    red = ((tiles[..., 0] > 1.6 * tiles[..., 1]) & (tiles[..., 0] > 2 * tiles[..., 2])).mean(axis=(1, 2))
    blue = (tiles[..., 2] > 1.6 * tiles[..., 0]).mean(axis=(1, 2))
    assert (red > 0.02).all()
    assert blue[0] > 0.005 and (blue[1:] < 0.002).all()


@pytest.mark.slow
def test_a_patch_without_a_place_costs_a_note_and_not_the_object(space, tmp_path):
    bars = [trimesh.creation.box((2, 2, 100)).apply_translation((x, 0, 0)) for x in (0, 100)]
    trimesh.util.concatenate(bars).export(tmp_path / "bars.stl")
    said = call("../bars.stl", "--class", "crate", "--length-mm", 100, "--quiet").stdout
    assert "note: no place for the patch yet: bars: there is no surface below the patch" in said
    assert "bars" in open_workspace().object_specs()


@pytest.mark.slow
def test_a_label_of_a_classifier_of_ones_own_counts(space):
    (space.classifiers_dir).mkdir(parents=True)
    (space.classifiers_dir / "parts.safetensors").write_bytes(b"")
    (space.classifiers_dir / "parts.json").write_text('{"labels": ["bracket", "hinge"]}')
    call("../brick.ply", "--class", "hinge", "--quiet")
    assert load_object(space.object_spec("brick")).spec.class_name == "hinge"


@pytest.mark.slow
def test_an_index_means_its_label_and_a_name_in_two_spellings_is_asked_after(space):
    call("../brick.ply", "--class", "134", "--quiet")
    assert load_object(space.object_spec("brick")).spec.class_name == "crane bird"
    assert "several classes are called 'CARDIGAN'" in refused("../brick.ply", "--class", "CARDIGAN", "--name", "b")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("../brick.ply", "--class", "cofee mug"), "--class: no class called 'cofee mug': did you mean coffee mug"),
        (
            ("../brick.ply", "--class", "toy car"),
            "did you mean freight car or passenger car or sports car or car mirror",
        ),
        (("../brick.ply", "--class", "toy spaceship"), "'toolkit models --classes WORD' searches them"),
        (("../brick.ply", "--class", "1000"), "class index 1000 is out of range"),
        (("../gone.ply", "--class", "crate"), "gone.ply: no such mesh file"),
        (("../brick.ply", "--class", "crate", "--name", "racer"), "the name 'racer' is taken"),
        (("../brick.ply", "--class", "crate", "--workspace", ".."), "is not a workspace"),
    ],
)
def test_bad_input_is_one_line(space, arguments, words):
    said = refused(*arguments)
    assert words in said and "\n" not in said
    assert sorted(open_workspace().object_specs()) == ["coffeepot", "eggnog", "racer", "warplane"]


@pytest.mark.parametrize("option", ["--print-side", "--up", "--front"])
def test_a_side_that_is_none_is_refused(space, option):
    assert f"{option} bottom: expected" in refused("../brick.ply", "--class", "crate", option, "bottom")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mesh", "length_axis"), [("carton_lowpoly/carton_kenney.obj", 2), ("racer_lowpoly/racer_kenney.obj", 0)]
)
def test_meshes_from_elsewhere_need_no_more_than_a_class(shared, space, mesh, length_axis):
    """Textured, a carton upright and a racer along its way, without a word about axes."""
    source = shared / "meshes" / mesh
    if not source.is_file():
        pytest.skip(f"needs {source.name} from ../shared/meshes")
    call(source, "--class", source.parent.name.split("_")[0], "--quiet")
    item = load_object(space.object_spec(source.stem))
    assert item.mesh.size_mm.argmax() == length_axis
    assert len(np.unique(item.mesh.materials[0].texture.reshape(-1, 3), axis=0)) > 1


@pytest.mark.slow
def test_a_patch_that_does_not_lie_on_top_is_put_where_place_finds_it_lying(space, tmp_path):
    """A board on edge: its top is 10 mm wide, its front and back are 100 × 100 mm."""
    trimesh.creation.box((100, 10, 100)).export(tmp_path / "board.stl")
    made = json.loads(call("../board.stl", "--class", "crate", "--length-mm", 100, "--size-mm", 40, "--json").stdout)
    item = load_object(space.object_spec("board"))
    mount = item.spec.mounts[0]
    assert mount.at in ("front", "back") and mount.size_mm == 40 and measure_fit(item, 40).lies
    assert f"it goes on its {mount.at}, 40 mm" in made["moved"] and not made["trouble"]
    assert made["moved"].endswith("toolkit place --object board --sheets 3 --write"), "no camera behind it sees it"
    asked = ("../board.stl", "--class", "crate", "--length-mm", 100, "--print-side", "top", "--replace", "--json")
    made = json.loads(call(*asked).stdout)
    assert not made["moved"] and "'toolkit place --object board' shows where one fits" in made["trouble"]


@pytest.mark.slow
def test_a_patch_beside_a_knob_stays_on_top(space, tmp_path):
    knob = trimesh.creation.cylinder(12, 40).apply_translation((0, 0, 40))
    trimesh.util.concatenate([trimesh.creation.box((200, 160, 60)), knob]).export(tmp_path / "tin.stl")
    asked = "../tin.stl --class crate --length-mm 200 --size-mm 40 --up z --front x --json"
    made = json.loads(call(*asked.split()).stdout)
    (mount,) = load_object(space.object_spec("tin")).spec.mounts
    forward, left = mount.offset_mm
    assert mount.at == "top" and max(abs(forward), abs(left)) > 30
    # offsets on the top are forward and left, as `PatchMount` has them
    along = f"{abs(forward):g} mm {'forward' if forward > 0 else 'back'}"
    aside = f"{abs(left):g} mm to the {'left' if left > 0 else 'right'}"
    assert f"in the middle of its top: it goes {along} and {aside}, 40 mm" in made["moved"]
    assert "--sheets" not in made["moved"], "from above every camera sees it"


def test_a_mesh_is_read_once(space, monkeypatch):
    """A large one takes longer to read than all else takes."""
    from toolkit.objects import load

    read, build = [], load._build_mesh
    monkeypatch.setattr(load, "_build_mesh", lambda path: read.append(path.name) or build(path))
    call("../brick.ply", "--class", "coffee mug", "--quiet")
    assert read == ["brick.ply"]
    monkeypatch.undo()
    kept, made = load_object(space.object_spec("brick")), add_object(space, space.root / "../brick.ply", REPLACED).item
    assert kept.mesh_sha256 == made.mesh_sha256
