"""Meshes that ask for much with few bytes: built in time that grows with them, or refused in a line."""

import json
import math
import struct

import numpy as np
import pytest
from hostile_checks import count, limited, peak
from hostile_inputs import damaged
from hypothesis import given
from hypothesis import strategies as st

from toolkit.core.errors import ToolkitError
from toolkit.objects.add import find_named_files
from toolkit.objects.limits import MAX_FACES, MAX_PARTS
from toolkit.objects.load import read_mesh

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]], "<f4")
MANY = st.sampled_from((1, 300, MAX_PARTS + 1, 100_000))


def make_glb(numbers=CORNERS, **changes) -> bytes:
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "buffers": [{"byteLength": numbers.nbytes}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": numbers.nbytes}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": len(numbers), "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], **changes,
    }  # fmt: skip
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    parts = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", numbers.nbytes, b"BIN\0")
    return struct.pack("<4sII", b"glTF", 2, 12 + len(parts) + numbers.nbytes) + parts + numbers.tobytes()


def place_nodes(n: int, kind: str) -> dict:
    if kind == "beside":
        return {"nodes": [{"mesh": 0, "translation": [i, 0, 0]} for i in range(n)], "scenes": [{"nodes": [*range(n)]}]}
    if kind == "within":
        return {"nodes": [{"mesh": 0, "children": [i + 1]} for i in range(n)] + [{"mesh": 0}]}
    if kind == "empty":
        return {"nodes": [{"mesh": 0}, *({} for _ in range(n))], "scenes": [{"nodes": [*range(n + 1)]}]}
    if kind == "twice":  # each is the child of the one before, two times over
        return {"nodes": [{"children": [i + 1] * 2} for i in range(n)] + [{"mesh": 0}]}
    return {"nodes": [{"mesh": 0, "children": [i]} for i in range(n)]}  # its own child


@st.composite
def gltfs(draw) -> bytes:
    kind = draw(st.sampled_from(("nodes", "primitives", "count", "faces", "views", "instances", "looks", "damaged")))
    if kind == "nodes":
        placed = place_nodes(draw(MANY), draw(st.sampled_from(("beside", "within", "empty", "twice", "own child"))))
        return make_glb(**placed)
    if kind == "primitives":
        return make_glb(meshes=[{"primitives": [{"attributes": {"POSITION": 0}}] * draw(MANY)}])
    if kind in ("count", "faces"):
        many = {"componentType": 5126 if kind == "count" else 5125, "count": draw(st.sampled_from((3, 10**6, 10**9)))}
        some = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
        if kind == "count":
            return make_glb(accessors=[many | {"type": draw(st.sampled_from(("VEC3", "MAT4")))}])
        drawn = {"attributes": {"POSITION": 0}, "indices": 1}
        return make_glb(accessors=[some, many | {"type": "SCALAR"}], meshes=[{"primitives": [drawn]}])
    if kind == "views":
        numbers = np.zeros((100_000, 3), "<f4")
        view = {"buffer": 0, "byteOffset": 0, "byteLength": numbers.nbytes}
        return make_glb(numbers, bufferViews=[view] * draw(st.sampled_from((1, 100, 10_000))))
    if kind == "instances":
        numbers = np.random.default_rng(0).random((9000, 3)).astype("<f4")
        return make_glb(numbers, **place_nodes(draw(st.sampled_from((10, 5000))), "beside"))
    content = make_glb(**draw(looks())) if kind == "looks" else make_glb()
    return draw(damaged(content) | st.just(content))


@st.composite
def looks(draw) -> dict:
    """What a drawn part may say beside its corners: pictures, packed views, instances, skins, and nonsense."""
    wrong = st.sampled_from((0, 1, -1, 10**9, 1e300, "x", "../../etc/passwd", None, [], {}, [[]] * 9, True))
    moved = {"KHR_texture_transform": {"scale": draw(wrong)}}
    slot = {"index": draw(wrong), "texCoord": draw(wrong), "extensions": moved}
    packed = {
        "buffer": 0, "byteOffset": 0, "byteLength": 36, "mode": "ATTRIBUTES", "byteStride": draw(wrong),
        "count": draw(wrong),
    }  # fmt: skip
    view = {"buffer": 0, "byteOffset": draw(st.sampled_from((0, 30, 10**12))), "byteLength": 36}
    if draw(st.booleans()):
        view["extensions"] = {"EXT_meshopt_compression": packed}
    more = draw(st.sampled_from(("TEXCOORD_0", "COLOR_0", "JOINTS_0", "X")))
    drawn = {
        "attributes": {"POSITION": 0, more: draw(wrong)}, "material": draw(wrong), "mode": draw(wrong),
        "targets": draw(wrong),
    }  # fmt: skip
    node = {
        "mesh": 0, "skin": draw(wrong), "matrix": draw(wrong), "children": draw(wrong), "weights": draw(wrong),
        "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"SCALE": draw(wrong)}}},
    }  # fmt: skip
    pbr = {"baseColorTexture": slot, "baseColorFactor": draw(wrong)}
    made = {
        "materials": [{"pbrMetallicRoughness": pbr, "alphaMode": "MASK"}],
        "textures": [{"source": draw(wrong), "sampler": draw(wrong)}], "images": [{"uri": draw(wrong)}],
        "samplers": [{"wrapS": draw(wrong)}], "skins": [{"joints": draw(wrong)}], "bufferViews": [view],
        "meshes": [{"primitives": [drawn], "weights": draw(wrong)}], "nodes": [node], "extensionsUsed": draw(wrong),
    }  # fmt: skip
    kept = draw(st.sets(st.sampled_from(sorted(made)), max_size=4))
    return {key: made[key] for key in sorted(kept)}


def write_ring(n: int, suffix: str) -> str:
    """One polygon of n corners."""
    rows = [f"{math.cos(2 * math.pi * i / n):f} {math.sin(2 * math.pi * i / n):f} 0" for i in range(n)]
    if suffix == ".obj":
        return "".join(f"v {row}\n" for row in rows) + "f " + " ".join(str(i + 1) for i in range(n)) + "\n"
    return f"OFF\n{n} 1 0\n" + "\n".join(rows) + f"\n{n} " + " ".join(map(str, range(n))) + "\n"


@st.composite
def texts(draw) -> tuple[str, str]:
    """Suffix and text of a mesh."""
    kind = draw(st.sampled_from(("polygon", "fan", "materials", "off", "ply")))
    if kind == "polygon":
        suffix = draw(st.sampled_from((".obj", ".off")))
        return suffix, write_ring(draw(st.sampled_from((3, 50_000))), suffix)
    if kind == "fan":
        places = np.random.default_rng(0).normal(size=(draw(st.sampled_from((3, 20_000))), 3))
        rows = "".join(f"v {x:f} {y:f} {z:f}\n" for x, y, z in places)
        return ".obj", rows + "".join(f"f 1 {i} {i + 1}\n" for i in range(2, len(places)))
    if kind == "materials":
        square = "v 0 0 0\nv 1 0 0\nv 1 1 0\n"
        return ".obj", square + "".join(f"usemtl m{i}\nf 1 2 3\n" for i in range(draw(st.sampled_from((1, 30_000)))))
    if kind == "off":
        return ".off", "OFF\n1000000000 1000000000 0\n0 0 0\n"
    head = "".join(f"property float {axis}\n" for axis in "xyz")
    return ".ply", (
        f"ply\nformat {draw(st.sampled_from(('ascii', 'binary_little_endian')))} 1.0\nelement vertex 4000000000\n{head}"
        "element face 1000000000\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n"
    )


def read(file):
    """The mesh, or None after a line of the kit's own words."""
    count("meshes")
    try:
        with limited():
            return read_mesh(file)
    except ToolkitError as error:
        said = str(error)
        assert said.startswith(str(file)) and "\n" not in said and "Error" not in said and len(said) < 400, said
        return None


@given(content=gltfs())
def test_a_gltf_that_asks_for_much(tmp_path_factory, content):
    file = tmp_path_factory.getbasetemp() / "much.glb"
    file.write_bytes(content)
    read(file)


@given(made=texts())
def test_a_text_that_asks_for_much(tmp_path_factory, made):
    file = tmp_path_factory.getbasetemp() / f"much{made[0]}"
    file.write_text(made[1])
    read(file)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"accessors": [{"componentType": 5126, "count": 10**9, "type": "VEC3"}]}, "MB of numbers, more than 64"),
        (place_nodes(MAX_PARTS + 1, "beside"), "20,001 parts, more than 20,000: join them"),
        ({"bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 2**31}]}, "2,048 MB of numbers"),
        ({"accessors": [{"bufferView": 0, "componentType": 5126, "count": 3 * MAX_FACES + 3, "type": "VEC3"}]},
         "4,000,001 faces, more than 4,000,000: simplify it"),
    ],
)  # fmt: skip
def test_what_a_gltf_asks_for_is_named(tmp_path, changes, said):
    (tmp_path / "much.glb").write_bytes(make_glb(**changes))
    with pytest.raises(ToolkitError, match=said):
        read_mesh(tmp_path / "much.glb")


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
@pytest.mark.parametrize("opening", ["[", '{"a":', '{"meshes":['])
def test_deeply_nested_json_is_one_line(tmp_path, suffix, opening):
    text = (opening * 200_000).encode()
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON")
    file = tmp_path / f"deep{suffix}"
    file.write_bytes(head + text if suffix == ".glb" else text)
    assert find_named_files(file) == []
    with pytest.raises(ToolkitError, match=rf"deep{suffix}: not a readable {suffix} mesh") as caught:
        read_mesh(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("uri", ["../secret.bin", "/etc/passwd", "%2e%2e/secret.bin", "a/../../secret.bin"])
@pytest.mark.parametrize("what", ["buffers", "images"])
def test_a_uri_that_leaves_the_folder_is_refused(tmp_path, uri, what):
    (tmp_path / "secret.bin").write_bytes(CORNERS.tobytes())
    folder = tmp_path / "inside"
    folder.mkdir()
    changes = {
        "images": [{"uri": uri}], "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 0}, "material": 0}]}],
    } if what == "images" else {"buffers": [{"byteLength": 36, "uri": uri}]}  # fmt: skip
    (folder / "thing.glb").write_bytes(make_glb(**changes))
    with pytest.raises(ToolkitError, match="leaves its folder"):
        read_mesh(folder / "thing.glb")


def test_large_polygons_and_many_levels_are_read(tmp_path):
    (tmp_path / "ring.obj").write_text(write_ring(4_000, ".obj"))
    assert len(read(tmp_path / "ring.obj").faces) == 3_998
    (tmp_path / "ring.obj").write_text(write_ring(300_000, ".obj"))
    assert read(tmp_path / "ring.obj") is None  # its slivers would slow each ray down
    (tmp_path / "tower.glb").write_bytes(make_glb(**place_nodes(5000, "within")))
    assert len(read(tmp_path / "tower.glb").faces) == 5001


@pytest.mark.slow
def test_three_million_faces_take_under_two_gigabytes(tmp_path):
    """Of a soup of triangles, the costliest kind; measured in a process of its own."""
    n = 3_000_000
    rows = np.zeros(n, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")]))
    cell = np.arange(n) // 2
    rows["corners"][:, :, 0] = (cell % 1200)[:, None] + np.array([0, 1, 1])
    rows["corners"][:, :, 1] = (cell // 1200)[:, None] + np.array([0, 0, 1])
    rows["corners"][:, :, 2] = np.sin(rows["corners"][:, :, 0])
    (tmp_path / "soup.stl").write_bytes(b"\0" * 80 + struct.pack("<I", n) + rows.tobytes())
    del rows
    read = "from pathlib import Path; from toolkit.objects.load import read_mesh; read_mesh(Path({!r}))"
    assert peak(read.format(str(tmp_path / "soup.stl"))) < 2 << 30
