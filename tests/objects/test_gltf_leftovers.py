"""What of a glTF is not read is said, each once, from the file's own lists; what it requires is read or refused."""

import struct

import numpy as np
import pytest
from gltf_builder import CARD, CARD_FACES, CARD_UV, Gltf, base_colour
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.objects.add import ObjectRequest, add_object
from toolkit.objects.load import read_mesh


def notes(folder, gltf, capsys, name="thing.glb"):
    read_mesh(gltf.write(folder, name))
    lines = capsys.readouterr().err.replace("\n", " ").split("note: ")
    return [line.split(": ", 1)[1].strip() for line in lines if line]


def test_a_plain_file_has_no_notes(tmp_path, capsys):
    gltf = Gltf()
    gltf.card(
        gltf.material(**base_colour(gltf.picture(np.zeros((4, 4, 3))))), NORMAL=CARD, TANGENT=np.eye(4, dtype="<f4")
    )
    assert notes(tmp_path, gltf, capsys) == []


def used_and_named_nowhere(gltf):
    gltf.use("VENDOR_of_next_year")


def named_but_not_listed(gltf):
    gltf.tree["materials"][0]["extensions"] = {"VENDOR_of_next_year": {}}


def on_a_node(gltf):
    gltf.tree["nodes"][0]["extensions"] = {"VENDOR_of_next_year": {"deep": [1, 2]}}


def a_list_of_next_year(gltf):
    gltf.tree["VENDOR_of_next_year"] = [1]


def a_slot_of_next_year(gltf):
    gltf.tree["materials"][0]["VENDOR_of_next_year"] = {"index": 0}


def a_pbr_slot_of_next_year(gltf):
    gltf.tree["materials"][0]["pbrMetallicRoughness"]["VENDOR_of_next_year"] = {"index": 0}


def an_attribute_of_next_year(gltf):
    gltf.tree["meshes"][0]["primitives"][0]["attributes"]["VENDOR_of_next_year"] = 0


def a_mode_of_next_year(gltf):
    gltf.tree["materials"][0]["alphaMode"] = "VENDOR_of_next_year"


def a_target_of_next_year(gltf):
    gltf.tree["meshes"][0]["primitives"][0]["targets"] = [{"VENDOR_of_next_year": 0}]


@pytest.mark.parametrize(
    "add",
    [
        used_and_named_nowhere, named_but_not_listed, on_a_node, a_list_of_next_year, a_slot_of_next_year,
        a_pbr_slot_of_next_year, an_attribute_of_next_year, a_mode_of_next_year, a_target_of_next_year,
    ],
)  # fmt: skip
def test_a_feature_of_next_year_is_one_note(tmp_path, capsys, add):
    gltf = Gltf()
    gltf.card(gltf.material(**base_colour(gltf.picture(np.zeros((4, 4, 3))))))
    add(gltf)
    (note,) = notes(tmp_path, gltf, capsys)
    assert "VENDOR_of_next_year" in note and "left out" in note


def test_features_of_today_that_a_picture_does_not_show(tmp_path, capsys):
    gltf = Gltf()
    texture = gltf.picture(np.zeros((4, 4, 3)))
    slots = {name: {"index": texture} for name in ("normalTexture", "occlusionTexture", "emissiveTexture")}
    extensions = {"KHR_materials_unlit": {}, "KHR_materials_clearcoat": {}}
    gltf.card(gltf.material(**slots, emissiveFactor=[1, 0, 0], alphaMode="BLEND", extensions=extensions), COLOR_1=CARD)
    gltf.tree["animations"], gltf.tree["cameras"] = [{}], [{}]
    found = notes(tmp_path, gltf, capsys)
    for name in (*slots, *extensions, "alphaMode BLEND", "COLOR_1", "animations", "cameras"):
        assert sum(note.startswith(name) for note in found) == 1, name
    assert len(found) == 9


def test_a_material_that_gives_light_without_a_picture_is_noted(tmp_path, capsys):
    gltf = Gltf()
    gltf.card(gltf.material(emissiveFactor=[1, 0, 0]))
    assert notes(tmp_path, gltf, capsys) == ["emissiveFactor is left out: the object gives no light"]


@pytest.mark.parametrize("name", ["binary.gltf", "text.glb"])
def test_the_bytes_count_and_not_the_suffix(tmp_path, name):
    gltf = Gltf()
    gltf.card()
    (tmp_path / name).write_bytes(gltf.as_glb() if name == "binary.gltf" else gltf.as_gltf().encode("utf-8-sig"))
    assert len(read_mesh(tmp_path / name).faces) == 2


def test_a_note_is_said_once_however_often_the_file_is_read(tmp_path, capsys):
    gltf = Gltf()
    gltf.card()
    gltf.use("VENDOR_x")
    assert len(notes(tmp_path, gltf, capsys)) == 1
    assert notes(tmp_path, gltf, capsys) == []


def test_a_required_extension_that_is_not_read_is_one_line_with_the_way_out(tmp_path):
    gltf = Gltf()
    gltf.card()
    gltf.use("VENDOR_x", required=True)
    gltf.use("KHR_mesh_quantization", required=True)
    with pytest.raises(
        ToolkitError, match=r"thing\.glb: requires the glTF extension VENDOR_x, which .* export"
    ) as caught:
        read_mesh(gltf.write(tmp_path))
    assert "quantization" not in str(caught.value)


def test_what_may_be_left_out_is_noted_even_where_it_is_required(tmp_path, capsys):
    gltf = Gltf()
    gltf.card()
    gltf.use("KHR_materials_unlit", required=True)
    assert len(notes(tmp_path, gltf, capsys)) == 1


def test_a_texture_by_an_extension_of_next_year_is_one_line(tmp_path):
    gltf = Gltf()
    texture = gltf.picture(np.zeros((4, 4, 3)))
    gltf.tree["textures"][texture] = {"extensions": {"VENDOR_texture": {"source": 0, "picture": 1}}}
    gltf.card(gltf.material(**base_colour(texture)))
    with pytest.raises(ToolkitError, match=r"thing\.glb: a texture names no picture .*VENDOR_texture.*: save"):
        read_mesh(gltf.write(tmp_path))


def test_a_binary_file_of_the_first_version_is_named(tmp_path):
    (tmp_path / "old.glb").write_bytes(b"glTF" + struct.pack("<IIII", 1, 24, 4, 0) + b"{}  ")
    with pytest.raises(ToolkitError, match=r"old\.glb: glTF 1\.0, expected 2\.0"):
        read_mesh(tmp_path / "old.glb")


def test_colours_that_are_no_numbers_are_refused(tmp_path):
    gltf = Gltf()
    gltf.card(uv=None, COLOR_0=np.full((4, 3), np.nan, "<f4"))
    with pytest.raises(ToolkitError, match="COLOR_0 has colours that are NaN"):
        read_mesh(gltf.write(tmp_path))


def test_a_file_of_the_first_version_is_named(tmp_path):
    (tmp_path / "old.gltf").write_text('{"asset": {"version": "1.0"}, "meshes": {}}')
    with pytest.raises(ToolkitError, match=r"old\.gltf: glTF 1\.0, expected 2\.0"):
        read_mesh(tmp_path / "old.gltf")


def test_add_says_which_pictures_the_object_shows(tmp_path):
    gltf = Gltf()
    pixels = np.full((4, 4, 3), (10, 200, 30), np.uint8)
    textures = [gltf.picture(pixels, uri=f"{name}.png") for name in ("skin", "gloss", "bumps")]
    for name in ("skin", "gloss", "bumps"):
        Image.fromarray(pixels).save(tmp_path / f"{name}.png")
    look = base_colour(textures[0])
    look["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {"index": textures[1]}
    corners = np.concatenate([CARD, CARD[[2, 3, 0, 1]] + np.array([0, 0, 1])]).astype("<f4")
    attributes = {"POSITION": corners, "TEXCOORD_0": np.tile(CARD_UV, (2, 1))}
    faces = np.concatenate([CARD_FACES, CARD_FACES + 4]).astype("<u2")
    material = gltf.material(**look, normalTexture={"index": textures[2]})
    gltf.node(mesh=gltf.mesh(attributes, faces, material))
    space = make_workspace(tmp_path / "space")
    added = add_object(space, gltf.write(tmp_path, "crate.gltf"), ObjectRequest(class_name="crate", length_mm=200))
    lines = list(added.lines())
    assert lines[1].endswith("crate.gltf with skin.png, gloss.png")
    assert lines[2] == "copied, but not shown on the object: bumps.png"
    (shown,) = {material.texture.tobytes() for material in added.item.mesh.materials}
    assert shown == pixels.tobytes()  # what was announced is what the material holds
