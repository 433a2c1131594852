"""3MF and OBJ as other programs read them, and what is said of a surface that is to be printed in 3D."""

from dataclasses import replace

import lib3mf
import numpy as np
import pytest
import trimesh

from toolkit.objects.export_mesh import examine_solid, to_3mf, to_obj
from toolkit.objects.load import load_object
from toolkit.objects.mesh import merge_meshes
from toolkit.objects.records import decode_png, encode_png


def read_3mf(content):
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromBuffer(content)
    assert reader.GetWarningCount() == 0
    return model


def only(iterator):
    assert iterator.MoveNext()
    return iterator


@pytest.fixture(scope="module")
def crate(make_box):
    return merge_meshes([make_box((100, 60, 40), (200, 40, 30)), make_box((20, 30, 50), (20, 60, 200))])


def test_3mf_has_the_triangles_pictures_and_millimetres(crate):
    model = read_3mf(to_3mf(crate, "crate"))
    assert model.GetUnit() == lib3mf.ModelUnit.MilliMeter
    solid = only(model.GetMeshObjects()).GetCurrentMeshObject()
    places = np.array([tuple(one.Coordinates) for one in solid.GetVertices()])
    faces = np.array([tuple(one.Indices) for one in solid.GetTriangleIndices()])
    np.testing.assert_allclose(np.ptp(places, axis=0), crate.size_mm, atol=1e-4)
    np.testing.assert_allclose(places[faces] + crate.bounds[0], crate.vertices[crate.faces], atol=1e-4)
    assert solid.GetName() == "crate"
    assert solid.IsManifoldAndOriented()
    pictures = [bytes(model.GetAttachment(i).WriteToBuffer()) for i in range(model.GetAttachmentCount())]
    assert pictures == [encode_png(material.texture) for material in crate.materials]
    groups = {}
    iterator = model.GetTexture2DGroups()
    while iterator.MoveNext():
        group = iterator.GetCurrentTexture2DGroup()
        groups[group.GetResourceID()] = group
    for i, properties in enumerate(solid.GetAllTriangleProperties()):
        group = groups[properties.ResourceID]
        uv = [(at.U, at.V) for at in (group.GetTex2Coord(one) for one in properties.PropertyIDs)]
        np.testing.assert_allclose(uv, crate.uv[crate.faces[i]], atol=1e-5)
        picture = bytes(group.GetTexture2D().GetAttachment().WriteToBuffer())
        assert picture == encode_png(crate.materials[crate.face_material[i]].texture)


def test_3mf_is_the_same_each_time_and_holds_a_shared_picture_once(crate):
    sheet = crate.materials[0].texture
    shared = replace(crate, materials=tuple(replace(one, texture=sheet) for one in crate.materials))
    assert to_3mf(shared, "crate") == to_3mf(shared, "crate")
    assert read_3mf(to_3mf(shared, "crate")).GetAttachmentCount() == 1


def test_obj_is_read_by_trimesh_in_millimetres_with_y_up(crate, tmp_path):
    for file, content in to_obj(crate, "crate").items():
        (tmp_path / file).write_bytes(content)
    scene = trimesh.load_scene(tmp_path / "crate.obj")
    np.testing.assert_allclose(scene.extents, crate.size_mm[[1, 2, 0]], rtol=1e-5)  # left, up, front
    assert sum(len(piece.faces) for piece in scene.geometry.values()) == len(crate.faces)
    by_height = sorted(scene.geometry.values(), key=lambda piece: piece.extents[1])  # 40 and 50 mm
    for piece, material in zip(by_height, crate.materials, strict=True):
        np.testing.assert_array_equal(np.asarray(piece.visual.material.image.convert("RGB")), material.texture)
    assert decode_png((tmp_path / "crate-1.png").read_bytes(), tmp_path).shape == crate.materials[0].texture.shape


def test_walls_of_closed_forms(make_box):
    plate = examine_solid(make_box((100, 60, 0.8), (1, 2, 3)))
    assert plate.open_edges == plate.tangled_edges == 0
    assert plate.thinnest_mm == pytest.approx(0.8, abs=0.01)
    sides = 2 * 0.8 * (100 + 60)
    assert plate.thin_share == pytest.approx(1 - sides / (sides + 2 * 100 * 60), abs=0.01)
    # two boxes that overlap are one solid of 100 mm, not walls of 10
    left, right = make_box((60, 50, 50), (1, 2, 3)), make_box((50, 50, 50), (1, 2, 3))
    moved = replace(right, vertices=right.vertices + np.float32([45, 0, 0]))
    assert examine_solid(merge_meshes([left, moved])).thinnest_mm > 49


def test_an_open_surface_is_said_to_be_open(make_box):
    box = make_box((100, 60, 40), (1, 2, 3))
    lidless = replace(box, faces=box.faces[:-2], face_material=box.face_material[:-2])
    solid = examine_solid(lidless)
    assert (solid.open_edges, solid.tangled_edges) == (4, 0)
    assert "4 open edges" in solid.describe()
    flipped = replace(box, faces=np.concatenate([box.faces[:1, ::-1], box.faces[1:]]))
    assert examine_solid(flipped).tangled_edges == 3


def test_a_texture_goes_to_a_colour_printer(tmp_path):
    from toolkit.core.workspace import make_workspace
    from toolkit.rig.applied.texture import find_texture
    from toolkit.rig.variants import export_object

    space = make_workspace(tmp_path)
    (file,), solid = export_object(space, "eggnog", ["3mf"], "textured")
    assert file == space.print_dir / "eggnog-textured.3mf"
    assert solid.describe().startswith("watertight")
    model = read_3mf(file.read_bytes())
    item = load_object(space.object_spec("eggnog"))
    found = [decode_png(bytes(model.GetAttachment(i).WriteToBuffer()), file) for i in range(model.GetAttachmentCount())]
    texture = find_texture(space, item).pixels
    assert any(one.shape == texture.shape and (one == texture).mean() > 0.99 for one in found)
