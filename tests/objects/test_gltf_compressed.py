"""Compressed glTF: meshopt's streams by its own encoder, Draco and Basis Universal by theirs, and what is said without.

The streams of `EXT` and `KHR` were written by gltfpack 1.3 of a ball of radius 1: trimesh's icosphere of 42 vertices,
each of the colour (place + 1) * 127.
"""

import base64
import sys

import numpy as np
import pytest
import trimesh
from gltf_builder import CARD, CARD_FACES, CARD_UV, Gltf, base_colour, colours_at

from toolkit.core.errors import ToolkitError
from toolkit.objects.gltf.meshopt import decode_view
from toolkit.objects.load import read_mesh

BALL = trimesh.creation.icosphere(1, 1.0)
EXT = [
    (
        {"mode": "ATTRIBUTES", "filter": "EXPONENTIAL", "count": 42, "byteStride": 12},
        (
            "pdSE1a&d9wIOG81<g>Kl0IP8Ta&Z8(+Nl8J0ORE1tU>%g001v?a^kFV9{?j57idqOjR1~~f<bKn1}H#hD1d{iwE$26P7N#tBme)v01Ox<KR_"
            "%6B|ilKnI;e<nIHfa1`-_r1ONd5fM`Gf03AOwKk(ska&d8Ta^h;V<l_M3I0E8w0CBWIa^nEu^Yickt8uh2<Kr;29X~Ta^D8DLCKniGY$-uM4"
            "^Tf3p1ZE604M_^7*Ibg|Nrm+1}H#73s67~3qchC0003bnE)gSAOHXr0FfX7NgyOh07-xV9Y4eH|KsH3<8tG2;%b*@a&qKx<8tHV0083QaX~N"
            "SKmYIm<m2J1LNIZx;vWD`4UbSifTzx-Kmcqhg_0O0j~C8mP7QxRY%3-s3{C(4@Blv#P;CYz3l{}06#<!;1_Xd$07(D<02LV^00FKB00aY)1|"
            "R?c0000000000000000000000015-v9D(HURPf008m"
        ),
    ),
    (
        {"mode": "ATTRIBUTES", "count": 42, "byteStride": 4},
        (
            "pdSE7etphQp3MNxw0(ow01Qrm%})OOt>geu08TJk3rGL|zyLLVGW~v93r&3=09j5=fH44l0DjBZQ-c71Fi?Lmp4g|f055n)eo%i||Nrm+3{H"
            "TBHc);qHiI7kPB6_-fBv*(w15EEQ})z;GO~ST%T6%;fY@11M>S3V|L_2RFi_bHNH%>7BLDyZ000000000000000000000000000000002Def"
            "By"
        ),
    ),
    (
        {"mode": "TRIANGLES", "count": 240, "byteStride": 2},
        (
            ";qV|JFcDBd&|u(z0?-uD6VMkxfDs@CzymNGkPnbB3_u8w7H|=e3Sa?H5h)M{U;+LiAQ(^);0!UKAD|L|5&i;CA3y;%Fb^M48X+t@91KPp^#&"
            "CK2Lu3ihgN5JsfJ~VXqW+M000"
        ),
    ),
]
KHR = [
    (
        {"mode": "ATTRIBUTES", "count": 42, "byteStride": 8},
        (
            "p<S&2>b@}?$HyET<1sPg$8Gt?{~R3u95FE*|Hpp<$H&M2<KyEo00|HVFeC&95H<-J83`~H6fh4K02U80761?#88#0T1OyZh2?+@h00|7X|Hm"
            "9L(*GPB9NXJ5G2<K@;~W4S;~X3S9NXJ5F&z8?95FE*9300B02CGw84v&u76t|a0tp!j|CR=yVDc&dHa0dE88-X^HW>*91{M?m{_Qz9H>%5AI"
            "5z<TajGKM_8~VoaX2?}Hvw{~A>RXBS|O=&0XK3t01^xo1Qj0>3m_gH9~T4?5ep0;CLjz8A0-PQ9vA}=A0ZI~7$6=CB@_Sv00000000000000"
            "0Ee|+503ZMW0ss"
        ),
    ),
    (
        {"mode": "ATTRIBUTES", "filter": "COLOR", "count": 42, "byteStride": 4},
        (
            "p}zntR5w12DL6Vz8VfT`Hz^}LQcNfdIa5m~5ezg=I4l<{Pdx?+N;)Mg081!8Izcc%Ru>mqBnCxKP*^AzPh(dn7*JMOBLzlKR4@lQ1!WgjP)h"
            "(U14Rc2Do7L?OBg5y0wF6D1sNqJ69yV4HyI@b0VEhI00>PZ8x$xn000000000000000000000001_-$wrc"
        ),
    ),
    (
        {"mode": "TRIANGLES", "count": 240, "byteStride": 2},
        (
            ";qVXuFc1(I01y`d79aow5C8`d2`~^802Tlk02%-v0384y03HAz4gdfK5D5?r5DyRy5DgFw5DgFw9}pEF4jvE=9uN*55Dp$35DYd63<v}g3KR"
            "f#hgN5JsfJ~VXqW+M000"
        ),
    ),
]


def encode_vertices(rows: np.ndarray) -> bytes:
    """The plainest stream of the codec's first version: every delta is a whole byte."""
    count, stride = rows.shape
    last, out = np.zeros(stride, np.uint8), b"\xa0"
    size = min(8192 // stride & ~15, 256)
    for first in range(0, count, size):
        block = rows[first : first + size]
        deltas = np.diff(np.vstack([last, block]), axis=0).astype(np.int8).astype(np.int16)
        zigzag = (deltas << 1 ^ deltas >> 15).astype(np.uint8)
        groups = -(-len(block) // 16)
        for column in np.pad(zigzag, ((0, groups * 16 - len(block)), (0, 0))).T:
            out += b"\xff" * (-(-groups // 4)) + column.tobytes()
        last = block[-1]
    return out + bytes(max(32 - stride, 0)) + bytes(stride)


def decode(rows, **fields):
    rows = np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), -1)
    packed = {"count": len(rows), "byteStride": rows.shape[1], "mode": "ATTRIBUTES", **fields}
    return decode_view(encode_vertices(rows), packed)


@pytest.mark.parametrize("name", ["EXT", "KHR"])
def test_gltfpacks_streams_are_the_ball(name):
    position, colour, index = (
        decode_view(base64.b85decode(text), fields) for fields, text in {"EXT": EXT, "KHR": KHR}[name]
    )
    if name == "EXT":
        vertices = position.view("<f4").reshape(-1, 3).astype(float)
    else:
        vertices = position.view("<u2").reshape(-1, 4)[:, :3] / 16383 * 2 - 1
    far = np.linalg.norm(vertices[:, None] - BALL.vertices, axis=2).min(axis=1)
    assert far.max() < 2e-4
    faces = index.view("<u2").reshape(-1, 3)
    corners = vertices[faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert len(faces) == 80 and volume == pytest.approx(BALL.volume, rel=1e-3)
    found = colour.reshape(-1, 4).astype(float)
    np.testing.assert_allclose(found[:, :3], (vertices + 1) * 127, atol=2 if name == "EXT" else 4)
    assert (found[:, 3] == 255).all()


@pytest.mark.parametrize(("count", "stride"), [(1, 4), (16, 12), (600, 16), (300, 256), (5000, 4)])
def test_streams_of_many_blocks(count, stride):
    rows = np.random.default_rng(count).integers(0, 256, (count, stride), dtype=np.uint8)
    np.testing.assert_array_equal(decode(rows), rows.reshape(-1))


def test_the_filter_of_directions():
    directions = np.random.default_rng(0).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    flat = directions / np.abs(directions).sum(axis=1, keepdims=True)
    signs = np.where(flat[:, :2] >= 0, 1, -1)
    folded = np.where(flat[:, 2:] < 0, (1 - np.abs(flat[:, [1, 0]])) * signs, flat[:, :2])
    rows = np.column_stack([np.round(folded * 32767), np.full((200, 1), 32767), np.full((200, 1), 5)]).astype("<i2")
    found = decode(rows, filter="OCTAHEDRAL").view("<i2").reshape(-1, 4)
    np.testing.assert_allclose(found[:, :3] / 32767, directions, atol=2e-4)
    assert (found[:, 3] == 5).all()


def test_the_filter_of_rotations():
    turns = np.random.default_rng(0).normal(size=(200, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    largest = np.abs(turns).argmax(axis=1)
    turns *= np.sign(turns[np.arange(200), largest])[:, None]
    others = turns[np.arange(200)[:, None], (largest[:, None] + [1, 2, 3]) % 4]
    rows = np.column_stack([np.round(others * np.sqrt(2) * 32767), 32764 | largest]).astype("<i2")
    found = decode(rows, filter="QUATERNION").view("<i2").reshape(-1, 4) / 32767
    np.testing.assert_allclose(found, turns, atol=2e-4)


def test_a_sequence_of_indices():
    """Each is told by its distance from one of the two before it; here always from the first of them."""

    def vbyte(value):
        return bytes([value]) if value < 128 else bytes([value & 127 | 128]) + vbyte(value >> 7)

    index, last, stream = [5, 3, 900, 70_000, 0], 0, b"\xd1"
    for one in index:
        step = one - last
        stream += vbyte((step << 1 ^ step >> 63) << 1)
        last = one
    packed = {"count": 5, "byteStride": 4, "mode": "INDICES"}
    assert decode_view(stream + bytes(4), packed).view("<u4").tolist() == index


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
@pytest.mark.parametrize("damage", ["none", "cut", "zeros", "mode", "count"])
def test_a_whole_file_and_damaged_ones(tmp_path, name, damage):
    gltf = Gltf()
    gltf.use(name, required=True)
    gltf.card()
    content = encode_vertices(np.ascontiguousarray(CARD).view(np.uint8).reshape(4, -1))
    content = {"cut": content[:40], "zeros": bytes(len(content))}.get(damage, content)
    view = gltf.view(content)
    stored = {key: value for key, value in gltf.tree["bufferViews"][view].items()}
    packed = stored | {"byteStride": 12, "count": 4, "mode": "ATTRIBUTES"}
    packed |= {"mode": {"mode": "OTHER"}, "count": {"count": -4}}.get(damage, {})
    position = gltf.tree["accessors"][0]["bufferView"]
    gltf.tree["bufferViews"][position] = {"buffer": 9, "byteLength": 48, "extensions": {name: packed}}
    if damage == "none":
        np.testing.assert_allclose(read_mesh(gltf.write(tmp_path)).size_mm, [1, 1, 0])
        return
    with pytest.raises(ToolkitError, match=rf"thing\.glb: .*{name}: the data of buffer view 0 are damaged"):
        read_mesh(gltf.write(tmp_path))


def a_draco_card(content=None):
    draco = pytest.importorskip("DracoPy", reason="needs the extra gltf")
    gltf = Gltf()
    name = "KHR_draco_mesh_compression"
    gltf.use(name, required=True)
    if content is None:
        content = draco.encode(CARD, CARD_FACES.reshape(-1, 3), tex_coord=CARD_UV.astype(np.float64))
    mesh = draco.decode(draco.encode(CARD, CARD_FACES.reshape(-1, 3), tex_coord=CARD_UV.astype(np.float64)))
    kinds = {one["attribute_type"]: one["unique_id"] for one in mesh.attributes}
    attributes = {"POSITION": kinds[0], "TEXCOORD_0": kinds[3]}
    pixels = np.zeros((2, 2, 3), np.uint8)
    pixels[0] = (200, 60, 10)
    material = gltf.material(**base_colour(gltf.picture(pixels.repeat(16, axis=0).repeat(16, axis=1))))
    number = gltf.card(material)
    for accessor in gltf.tree["accessors"]:
        del accessor["bufferView"]
    primitive = gltf.tree["meshes"][gltf.tree["nodes"][number]["mesh"]]["primitives"][0]
    primitive["extensions"] = {name: {"bufferView": gltf.view(content), "attributes": attributes}}
    return gltf


def test_draco(tmp_path):
    mesh = read_mesh(a_draco_card().write(tmp_path))
    np.testing.assert_allclose(mesh.size_mm, [1, 1, 0], atol=1e-3)
    np.testing.assert_allclose(colours_at(mesh, np.array([[0.3, 0.8], [0.6, 0.2]])), [[200, 60, 10], [0] * 3], atol=1)


def test_damaged_draco_is_one_clear_line(tmp_path):
    with pytest.raises(ToolkitError, match="KHR_draco_mesh_compression: the compressed mesh is damaged"):
        read_mesh(a_draco_card(b"DRACO\2\2\1\1\0\0 and no more").write(tmp_path))


def test_without_the_package_the_line_names_the_extra(tmp_path, monkeypatch):
    file = a_draco_card().write(tmp_path)
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(ToolkitError, match=r"KHR_draco_mesh_compression needs DracoPy.*\[gltf\].* without Draco"):
        read_mesh(file)


def a_basis_card(content, fallback=False):
    gltf = Gltf()
    name = "KHR_texture_basisu"
    gltf.use(name, required=not fallback)
    image = gltf.image(content, "image/ktx2")
    basis = {"extensions": {name: {"source": image}}}
    if fallback:
        texture = gltf.picture(np.full((8, 8, 3), (10, 200, 30), np.uint8), **basis)
    else:
        texture = len(gltf.tree["textures"])
        gltf.tree["textures"].append(basis)
    gltf.card(gltf.material(**base_colour(texture)))
    return gltf


def test_basis_universal(tmp_path, monkeypatch):
    library = pytest.importorskip("alktx2", reason="needs the extra gltf")
    ppm = b"P6 16 16 255 " + bytes([200, 60, 10]) * 256
    import io

    from PIL import Image

    png = io.BytesIO()
    Image.open(io.BytesIO(ppm)).save(png, "PNG")
    content = library.encode_bytes_to_ktx2(png.getvalue(), mime="image/png", codec="uastc")
    file = a_basis_card(bytes(content)).write(tmp_path)
    np.testing.assert_allclose(colours_at(read_mesh(file), np.array([[0.5, 0.5]])), [[200, 60, 10]], atol=3)
    monkeypatch.setitem(sys.modules, "alktx2", None)
    with pytest.raises(ToolkitError, match=r"KHR_texture_basisu needs alktx2.*\[gltf\].* as PNG"):
        read_mesh(file)


def test_a_basis_picture_that_is_none_is_one_clear_line(tmp_path):
    pytest.importorskip("alktx2", reason="needs the extra gltf")
    with pytest.raises(ToolkitError, match="KHR_texture_basisu"):
        read_mesh(a_basis_card(b"\xabKTX 20\xbb\r\n\x1a\n" + b"\1\0\0\0" * 40).write(tmp_path))


def test_the_usual_picture_is_taken_before_one_that_needs_a_package(tmp_path):
    mesh = read_mesh(a_basis_card(b"\xabKTX 20", fallback=True).write(tmp_path))
    np.testing.assert_allclose(colours_at(mesh, np.array([[0.5, 0.5]])), [[10, 200, 30]], atol=1)
