"""Meshes that become objects: what comes along, how they stand, what the spec says, and what is refused."""

import base64
import io
import json
import re
import struct

import numpy as np
import pytest
import trimesh
from killed_runs import files_below
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.objects.add import ObjectRequest, add_object, find_named_files
from toolkit.objects.export_mesh import to_glb
from toolkit.objects.load import load_object
from toolkit.objects.spec import read_spec

MUG = ObjectRequest(class_name="coffee mug", length_mm=120)
CARD = "v 0 0 0\nv 1 0 0\nv 1 2 0\nv 0 2 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl skin\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"


@pytest.fixture
def space(tmp_path):
    return make_workspace(tmp_path / "space")


@pytest.fixture
def elsewhere(tmp_path):
    folder = tmp_path / "downloads"
    folder.mkdir()
    return folder


def write_card(folder, mtllib="my skin.mtl", texture="pictures/skin 1.png"):
    """1 wide, 2 high along y: an OBJ with its library and a picture in a folder below."""
    (folder / "card.obj").write_text(f"mtllib {mtllib}\n{CARD}")
    (folder / "my skin.mtl").write_text(f"newmtl skin\nKd 1 1 1\nmap_Kd {texture}\nmap_Bump -bm 0.2 bumps.png\n")
    (folder / "pictures").mkdir()
    Image.new("RGB", (4, 4), (200, 30, 20)).save(folder / "pictures" / "skin 1.png")
    Image.new("L", (4, 4)).save(folder / "bumps.png")
    return folder / "card.obj"


def write_gltf(folder, **uris):
    scene = trimesh.Scene(trimesh.creation.box((0.1, 0.2, 0.3)))
    for name, content in scene.export(file_type="gltf").items():
        (folder / name).write_bytes(content)
    file = folder / "model.gltf"
    tree = json.loads(file.read_text())
    for key, uri in uris.items():
        tree[key] = [{"uri": uri}]
    file.write_text(json.dumps(tree))
    return file


def test_an_obj_comes_with_all_that_it_names(space, elsewhere):
    (elsewhere / "holiday.jpg").write_bytes(b"not named")
    made = add_object(space, write_card(elsewhere), MUG)
    assert files_below(space.objects_dir) == [
        "README.txt", "card.toml", "card/bumps.png", "card/card.obj", "card/my skin.mtl", "card/pictures/skin 1.png",
    ]  # fmt: skip
    for file in made.mesh_files:
        original = elsewhere / file.relative_to(space.objects_dir / "card")
        assert file.read_bytes() == original.read_bytes()
    assert (made.item.mesh.materials[0].texture == (200, 30, 20)).all()
    np.testing.assert_allclose(made.item.mesh.size_mm, [0, 60, 120], atol=1e-3)  # y stands up, x lies to the side


def test_a_gltf_comes_with_its_buffers_and_pictures(space, elsewhere):
    """The names are percent-encoded, as the format asks for."""
    write_gltf(elsewhere)
    Image.new("RGB", (2, 2)).save(elsewhere / "bärk 2.png")
    file = write_gltf(elsewhere, images="b%C3%A4rk%202.png")
    named = {named.name for named in find_named_files(file)}
    assert "bärk 2.png" in named and len(named) > 1
    made = add_object(space, file, MUG)
    assert {copied.name for copied in made.mesh_files} == named | {"model.gltf"}


def test_a_gltf_with_everything_inside_names_nothing(elsewhere):
    tree = {"asset": {"version": "2.0"}, "buffers": [{"uri": "data:application/octet-stream;base64,AAAA"}, {}]}
    (elsewhere / "inside.gltf").write_text(json.dumps(tree))
    assert find_named_files(elsewhere / "inside.gltf") == []


def test_a_glb_may_name_pictures_beside_it(elsewhere):
    chunk = json.dumps({"asset": {"version": "2.0"}, "images": [{"uri": "bark.png"}]}).encode()
    content = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(chunk), len(chunk), b"JSON") + chunk
    (elsewhere / "tree.glb").write_bytes(content)
    (elsewhere / "bark.png").write_bytes(b"x")
    assert [file.name for file in find_named_files(elsewhere / "tree.glb")] == ["bark.png"]


def test_a_glb_stands_upright_at_the_size_that_it_states(space, elsewhere, make_box):
    """glTF: metres, y up, z to the front; the same with `up` and `front` left out of the spec."""
    (elsewhere / "crate.glb").write_bytes(to_glb(make_box((100, 60, 40)), "crate"))
    made = add_object(space, elsewhere / "crate.glb", ObjectRequest(class_name="crate"))
    np.testing.assert_allclose(made.item.mesh.size_mm, [100, 60, 40], rtol=1e-5)
    assert not made.length_is_guessed
    short = space.objects_dir / "short.toml"
    short.write_text('class = "crate"\nmesh = "crate/crate.glb"\nlength_mm = 100\n')
    np.testing.assert_array_equal(load_object(short).mesh.vertices, made.item.mesh.vertices)


@pytest.mark.parametrize(("suffix", "axes"), [("obj", ("y", "z")), ("stl", ("z", "-y")), ("ply", ("z", "-y"))])
def test_other_formats_stand_as_modellers_write_them(space, elsewhere, suffix, axes):
    trimesh.creation.box((10, 20, 30)).export(elsewhere / f"brick.{suffix}")
    made = add_object(space, elsewhere / f"brick.{suffix}", ObjectRequest(class_name="crate"))
    assert (made.item.spec.up, made.item.spec.front) == axes
    assert made.length_is_guessed and made.item.mesh.size_mm.max() == pytest.approx(200)
    named = ObjectRequest(class_name="crate", name="other", up="x", front="y", length_mm=60)
    item = add_object(space, elsewhere / f"brick.{suffix}", named).item
    np.testing.assert_allclose(item.mesh.size_mm, [40, 60, 20], rtol=1e-5)  # front y, left z, up x


@pytest.mark.parametrize("length_mm", [120, 300])
def test_every_field_of_the_spec_is_explained_and_may_be_uncommented(space, elsewhere, length_mm):
    request = ObjectRequest(class_name="coffee mug", length_mm=length_mm, print_side="left")
    made = add_object(space, write_card(elsewhere), request)
    lines = made.spec_file.read_text().splitlines()
    assert all(line.count("#") for line in lines if line)
    made.spec_file.write_text("\n".join(line.removeprefix("# ") for line in lines[1:]))
    spec = read_spec(made.spec_file)
    assert (spec.name, spec.class_name, spec.length_mm) == ("card", "coffee mug", length_mm)
    assert spec.world_length_m == pytest.approx(length_mm / 1000)
    assert spec.mounts[0].at == "left" and spec.mounts[0].size_mm <= length_mm / 3 + 0.1


def test_labels_are_quoted_as_toml_asks_for(space, elsewhere):
    label = 'a "tea" \\ pot # 1 ü'
    made = add_object(space, write_card(elsewhere), ObjectRequest(class_name=label))
    assert made.item.spec.class_name == label
    assert (
        add_object(space, elsewhere / "card.obj", ObjectRequest(class_name=504, name="b")).item.spec.class_name == 504
    )


def test_a_mesh_in_the_workspace_stays_where_it_is(space):
    file = write_card(space.objects_dir)
    made = add_object(space, file, MUG)
    assert made.item.spec.mesh == "card.obj"
    assert len(files_below(space.objects_dir)) == 6  # the guide, the card's four and its spec


def test_a_taken_name_is_refused_unless_it_is_to_be_replaced(space, elsewhere):
    file = write_card(elsewhere)
    add_object(space, file, MUG)
    with pytest.raises(ToolkitError, match=r"the name 'card' is taken \(there is .*card.toml\)"):
        add_object(space, file, ObjectRequest(class_name="crate"))
    assert read_spec(space.object_spec("card")).class_name == "coffee mug"
    add_object(space, file, ObjectRequest(class_name="crate", replace=True))
    assert read_spec(space.object_spec("card")).class_name == "crate"
    with pytest.raises(ToolkitError, match=r"the name 'racer' is taken \(it is built in\)"):
        add_object(space, file, ObjectRequest(class_name="racer", name="racer"))


def test_the_files_name_becomes_a_name(space, elsewhere):
    trimesh.creation.box((10, 20, 30)).export(elsewhere / "My mug (1).stl")
    assert add_object(space, elsewhere / "My mug (1).stl", MUG).item.name == "My-mug-1"


@pytest.mark.parametrize("name", ["../mug", "a b", "", "mug.v2"])
def test_a_name_that_is_no_name_is_refused(space, elsewhere, name):
    file = write_card(elsewhere)
    if not name:
        file = file.rename(elsewhere / "ü.obj")
    with pytest.raises(ToolkitError, match="name: expected letters, digits"):
        add_object(space, file, ObjectRequest(class_name="coffee mug", name=name or None))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mtllib": "gone.mtl"}, r"names files that are not there: gone\.mtl: put them into"),
        ({"texture": "gone.png"}, r"names files that are not there: gone\.png"),
        ({"mtllib": "../outside.mtl"}, "path '../outside.mtl' leaves its folder"),
        ({"texture": "../../secret.png"}, "leaves its folder"),
        ({"texture": "/etc/passwd"}, "leaves its folder"),
    ],
)
def test_files_that_are_missing_or_elsewhere_are_named(space, elsewhere, change, words):
    (elsewhere.parent / "outside.mtl").write_text("")
    with pytest.raises(ToolkitError, match=words) as caught:
        add_object(space, write_card(elsewhere, **change), MUG)
    assert "card.obj" in str(caught.value) and "\n" not in str(caught.value)
    assert files_below(space.objects_dir) == ["README.txt"]


@pytest.mark.parametrize("uri", ["../secret.bin", "%2e%2e/secret.bin", "/etc/passwd", "textures/../../secret.bin"])
def test_a_gltf_does_not_reach_outside_its_folder(space, elsewhere, uri):
    (elsewhere.parent / "secret.bin").write_bytes(b"0" * 99)
    with pytest.raises(ToolkitError, match="leaves its folder"):
        add_object(space, write_gltf(elsewhere, buffers=uri), MUG)
    assert files_below(space.objects_dir) == ["README.txt"]


def test_a_link_to_elsewhere_is_not_followed(space, elsewhere):
    file = write_card(elsewhere)
    (elsewhere.parent / "secret.png").write_bytes((elsewhere / "bumps.png").read_bytes())
    (elsewhere / "bumps.png").unlink()
    (elsewhere / "bumps.png").symlink_to(elsewhere.parent / "secret.png")
    with pytest.raises(ToolkitError, match="leaves its folder"):
        add_object(space, file, MUG)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("gone.obj", None, "no such mesh file"),
        ("mug.fbx", "x", r"cannot read a mesh from '\.fbx' files"),
        ("mug.obj", "v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "zero area|no extent|one point"),
        ("mug.obj", "v 0 0 0\n", "no faces"),
        ("mug.gltf", "{", r"not a readable \.gltf mesh"),
        ("mug.gltf", "[1]", r"not a readable \.gltf mesh"),
        ("mug.glb", "glTF", r"not a readable \.glb mesh"),
        ("mug.ply", "hello", r"not a readable \.ply mesh"),
    ],
)
def test_a_mesh_that_cannot_be_used_leaves_nothing(space, elsewhere, name, content, words):
    if content is not None:
        (elsewhere / name).write_text(content)
    with pytest.raises(ToolkitError, match=words) as caught:
        add_object(space, elsewhere / name, MUG)
    assert str(elsewhere / name) in str(caught.value) and "\n" not in str(caught.value)
    assert files_below(space.objects_dir) == ["README.txt"]


@pytest.mark.parametrize("length_mm", [0, -3, float("nan"), 1e6])
def test_a_length_that_is_none_is_refused(space, elsewhere, length_mm):
    with pytest.raises(ToolkitError, match=r"length_mm .*: expected millimetres over 0 and under 100000"):
        add_object(space, write_card(elsewhere), ObjectRequest(class_name="coffee mug", length_mm=length_mm))


def test_one_axis_is_not_two(space, elsewhere):
    with pytest.raises(ToolkitError, match="must be different axes"):
        add_object(space, write_card(elsewhere), ObjectRequest(class_name="coffee mug", up="y", front="-y"))
    assert files_below(space.objects_dir) == ["README.txt"]


@pytest.mark.parametrize(
    ("suffix", "sides", "words"),
    [
        ("glb", (0.12, 0.184, 0.09), None),
        ("glb", (3.1, 12.0, 2.0), "the glTF says 12 m: is the real object 1.2e+04 mm long?"),
        (
            "glb",
            (92, 184, 90),
            "the mesh is 184 m long in the file (1840 mm, if centimetres or 184 mm, if millimetres?); 200",
        ),
        ("stl", (0.1, 0.23, 0.1), "the mesh is 0.23 long and states no unit (230 mm, if metres?); 200 mm are assumed"),
        ("stl", (92, 184, 90), "(1840 mm, if centimetres or 184 mm, if millimetres?); 200 mm are assumed"),
    ],
)
def test_an_unusual_or_unknown_length_is_asked_after(space, elsewhere, suffix, sides, words):
    trimesh.creation.box(sides).export(elsewhere / f"thing.{suffix}")
    asked = add_object(space, elsewhere / f"thing.{suffix}", ObjectRequest(class_name="crate")).ask_scale()
    assert asked is None if words is None else words in asked
    said = ObjectRequest(class_name="crate", name="measured", length_mm=5000)
    assert add_object(space, elsewhere / f"thing.{suffix}", said).ask_scale() is None


def test_the_page_to_turn_it_holds_the_mesh_and_needs_no_network(make_box):
    from toolkit.objects.export_mesh import make_turntable

    page = make_turntable(make_box(), "crate <1>", "100 mm & more")
    assert "<title>crate &lt;1&gt;</title>" in page and "100 mm &amp; more" in page
    assert not re.search(r"""(?:src|href)\s*=\s*["']?https?:""", page)
    for injected in (
        "HemisphereLight(0xffffff,0x9a948c",
        "turned=gltf.scene",
        "turned.rotation.y+=",
        "var turning=true",
    ):
        assert page.count(injected) == 1, (
            injected
        )  # the viewer that trimesh brings is the one that this was written for
    content = base64.b64decode(re.search(r'base64_data="([^"]+)"', page)[1])
    box = trimesh.load_scene(io.BytesIO(content), file_type="glb")
    np.testing.assert_allclose(np.sort(box.extents), [0.04, 0.06, 0.1], rtol=1e-4)


@pytest.mark.parametrize("linked", ["m", "m/deep", "other", "rig/objects"])
def test_nothing_is_written_through_a_link(space, elsewhere, tmp_path, linked):
    """A workspace that somebody sends may hold links; unpacking one makes them."""
    (elsewhere / "m.obj").write_text(CARD)
    outside = tmp_path / "a" / "b"
    outside.mkdir(parents=True)
    if linked == "rig/objects":
        for file in space.objects_dir.iterdir():
            file.unlink()
        space.objects_dir.rmdir()
        space.objects_dir.symlink_to(outside)
    elif linked == "other":
        (space.objects_dir / "other").mkdir()
        (space.objects_dir / "m").symlink_to("other")
    elif linked == "m":
        (space.objects_dir / "m").symlink_to("../../../a/b")
    else:
        (elsewhere / "deep").mkdir()
        (elsewhere / "m.obj").write_text("mtllib deep/m.mtl\n" + CARD)
        (elsewhere / "deep" / "m.mtl").write_text("newmtl skin\n")
        (space.objects_dir / "m").mkdir()
        (space.objects_dir / "m" / "deep").symlink_to(outside)
    before = files_below(tmp_path / "space"), list(outside.iterdir())
    with pytest.raises(ToolkitError, match=r"is a link: nothing is written or deleted|leads outside"):
        add_object(space, elsewhere / "m.obj", MUG)
    after = files_below(tmp_path / "space"), list(outside.iterdir())
    assert [name for name in after[0] if name not in before[0]] == (["rig/objects/m/m.obj"] if "deep" in linked else [])
    assert after[1] == []
    if linked == "rig/objects":
        with pytest.raises(ToolkitError, match="is a link: nothing is written"):
            make_workspace(space.root)
