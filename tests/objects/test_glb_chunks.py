"""GLB files taken apart by hand, as the glTF 2.0 specification lays them out."""

import json
import struct
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from toolkit.objects.atlas import apply_texture, make_atlas
from toolkit.objects.export_mesh import to_glb
from toolkit.objects.load import build_mesh
from toolkit.objects.mesh import Material, Mesh, merge_meshes, mesh_from_corners

COMPONENTS = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}


def take_apart(content: bytes) -> tuple[dict, bytes]:
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    size, kind = struct.unpack_from("<I4s", content, 12)
    assert kind == b"JSON" and size % 4 == 0
    tree = json.loads(content[20 : 20 + size])
    rest, kind = struct.unpack_from("<I4s", content, 20 + size)
    assert kind == b"BIN\0" and 28 + size + rest == length
    return tree, content[28 + size :]


def read_accessor(tree: dict, data: bytes, index: int) -> np.ndarray:
    accessor = tree["accessors"][index]
    view = tree["bufferViews"][accessor["bufferView"]]
    assert "byteStride" not in view and not accessor.get("normalized", False)
    kind, width = COMPONENTS[accessor["componentType"]], WIDTHS[accessor["type"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    assert start % np.dtype(kind).itemsize == 0
    values = np.frombuffer(data, kind, accessor["count"] * width, start)
    return values.reshape(-1, width) if width > 1 else values


def read_image(tree: dict, data: bytes, index: int) -> bytes:
    image = tree["images"][index]
    assert image["mimeType"] == "image/png"
    view = tree["bufferViews"][image["bufferView"]]
    start = view.get("byteOffset", 0)
    return data[start : start + view["byteLength"]]


def primitives(tree: dict):
    for node in tree["nodes"]:
        if "mesh" in node:
            assert not {"matrix", "rotation", "scale", "translation"} & set(node) or np.allclose(
                node.get("matrix", np.eye(4).reshape(-1)), np.eye(4).reshape(-1)
            )
            yield from tree["meshes"][node["mesh"]]["primitives"]


@pytest.fixture(scope="module")
def dressed():
    """The racer in a texture, its tyres kept."""
    texture = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    return apply_texture(make_atlas(build_mesh("racer"), 64, keep=["rubber"]), texture)


@pytest.fixture(scope="module")
def parts(dressed):
    return take_apart(to_glb(dressed, "racer"))


def test_it_is_gltf_2_with_a_scene(parts):
    tree, data = parts
    assert tree["asset"]["version"] == "2.0"
    assert tree["scenes"][tree["scene"]]["nodes"]
    assert len(tree["buffers"]) == 1 and tree["buffers"][0]["byteLength"] <= len(data)
    assert "extensionsRequired" not in tree and "uri" not in json.dumps(tree)


def test_each_picture_is_there_once_with_its_exact_pixels(parts, dressed):
    tree, data = parts
    sheets = list({id(m.texture): m.texture for m in dressed.materials}.values())
    assert len(sheets) == 2 == len(tree["images"]) == len(tree["textures"])
    pngs = [read_image(tree, data, t["source"]) for t in tree["textures"]]
    assert all(png.startswith(b"\x89PNG") for png in pngs) and len(set(pngs)) == 2
    assert data.count(b"\x89PNG\r\n\x1a\n") == 2
    for material in tree["materials"]:
        before = next(m for m in dressed.materials if m.name == material["name"])
        png = pngs[material["pbrMetallicRoughness"]["baseColorTexture"]["index"]]
        np.testing.assert_array_equal(np.asarray(Image.open(BytesIO(png)).convert("RGB")), before.texture)


def test_materials_keep_their_gloss_and_are_opaque(parts, dressed):
    tree, _ = parts
    assert [m["name"] for m in tree["materials"]] == [m.name for m in dressed.materials]
    for found, wanted in zip(tree["materials"], dressed.materials, strict=True):
        look = found["pbrMetallicRoughness"]
        assert look["roughnessFactor"] == pytest.approx(wanted.roughness)
        assert look["metallicFactor"] == pytest.approx(wanted.metallic)  # glTF's default is 1: it must be there
        assert look.get("baseColorFactor", [1, 1, 1, 1]) == [1, 1, 1, 1]
        assert look["baseColorTexture"].get("texCoord", 0) == 0
        assert found.get("alphaMode", "OPAQUE") == "OPAQUE" and found["doubleSided"]


def test_pictures_are_filtered_and_repeat_as_in_the_rig(parts):
    tree, _ = parts
    for texture in tree["textures"]:
        sampler = tree["samplers"][texture["sampler"]]
        assert sampler == {"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}


def test_geometry_is_in_metres_y_up_and_v_runs_down(parts, dressed):
    tree, data = parts
    count = 0
    corners = []
    for part in primitives(tree):
        assert part.get("mode", 4) == 4
        index = read_accessor(tree, data, part["indices"]).astype(int)
        place, normal, uv = (
            read_accessor(tree, data, part["attributes"][name]) for name in ("POSITION", "NORMAL", "TEXCOORD_0")
        )
        assert all(np.isfinite(values).all() for values in (place, normal, uv))
        np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-5)
        accessor = tree["accessors"][part["attributes"]["POSITION"]]
        np.testing.assert_allclose([accessor["min"], accessor["max"]], [place.min(0), place.max(0)], rtol=1e-6)
        corners.append(np.concatenate([place, normal, uv], axis=1)[index])
        count += len(index) // 3
    assert count == len(dressed.faces)
    found = np.concatenate(corners)
    order = np.argsort(dressed.face_material, kind="stable")
    index = dressed.faces[order].reshape(-1)
    x, y, z = dressed.vertices[index].T / 1000
    np.testing.assert_allclose(found[:, :3], np.stack([y, z, x], axis=1), atol=1e-7)
    x, y, z = dressed.normals[index].T
    np.testing.assert_allclose(found[:, 3:6], np.stack([y, z, x], axis=1), atol=1e-5)
    np.testing.assert_allclose(found[:, 6], dressed.uv[index, 0], atol=1e-6)
    np.testing.assert_allclose(found[:, 7], 1 - dressed.uv[index, 1], atol=1e-6)  # glTF: (0, 0) is the upper left


def test_the_upper_left_texel_is_at_gltf_0_0():
    texture = np.zeros((8, 8, 3), np.uint8)
    texture[:4, :4] = 255  # row 0 is v = 1
    places = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    uv = places[:, :2] / 10
    mesh = mesh_from_corners(places, faces, uv[faces], np.zeros(2, int), (Material("m", texture),))
    tree, data = take_apart(to_glb(mesh, "square"))
    part = next(primitives(tree))
    uv = read_accessor(tree, data, part["attributes"]["TEXCOORD_0"])
    place = read_accessor(tree, data, part["attributes"]["POSITION"])
    corner = np.flatnonzero(np.isclose(place[:, 2], 0) & np.isclose(place[:, 0], 0.01))  # world x = 0, y = 10 mm
    np.testing.assert_allclose(uv[corner], [[0, 0]], atol=1e-7)
    pixels = np.asarray(Image.open(BytesIO(read_image(tree, data, 0))).convert("RGB"))
    assert pixels[0, 0, 0] == 255 and pixels[7, 0, 0] == 0 and pixels[0, 7, 0] == 0


def test_equal_materials_and_faces_without_area_do_no_harm():
    places = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0]], np.float32)
    looks = Material("same", np.full((4, 4, 3), 50, np.uint8))
    one = mesh_from_corners(places, np.array([[0, 1, 2], [0, 0, 1]]), np.zeros((2, 3, 2)), np.zeros(2, int), (looks,))
    one = Mesh(**{**vars(one), "normals": one.normals * np.array([[0], [1], [1]], np.float32)})  # a mesh made by hand
    two = merge_meshes([one, Mesh(**{**vars(one), "materials": (looks,)})])
    tree, data = take_apart(to_glb(two, "twice"))
    assert len(tree["images"]) == 1
    for part in primitives(tree):
        normal = read_accessor(tree, data, part["attributes"]["NORMAL"])
        np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-5)
        assert tree["materials"][part["material"]]["name"] == "same"
