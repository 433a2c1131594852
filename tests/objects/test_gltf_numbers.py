"""Numbers of glTF in every form that the specification allows give the same mesh."""

import numpy as np
import pytest
from gltf_builder import CARD, CARD_FACES, CARD_UV, Gltf, base_colour, colours_at

from toolkit.core.errors import ToolkitError
from toolkit.objects.load import read_mesh

QUARTERS = np.zeros((8, 8, 3), np.uint8)
QUARTERS[:4, :4], QUARTERS[:4, 4:], QUARTERS[4:, :4] = (200, 30, 30), (30, 200, 30), (30, 30, 200)
PLACES = np.array([[0.25, 0.75], [0.75, 0.75], [0.25, 0.25], [0.75, 0.25]])
SHOWN = [[200, 30, 30], [30, 200, 30], [30, 30, 200], [0, 0, 0]]


def read_card(folder, name="thing.glb", **attributes):
    """A card with a picture of four colours, whose attributes may be written otherwise: a function of the glTF."""
    gltf = Gltf()
    material = gltf.material(**base_colour(gltf.picture(QUARTERS)))
    made = {key: make(gltf) for key, make in attributes.items()}
    gltf.card(material, made.pop("TEXCOORD_0", CARD_UV), **made)
    return read_mesh(gltf.write(folder, name))


def check(mesh):
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [1, 1, 0], atol=1e-4)
    np.testing.assert_allclose(colours_at(mesh, mesh.vertices.min(axis=0)[:2] + PLACES), SHOWN, atol=1)


@pytest.mark.parametrize("name", ["thing.glb", "thing.gltf"])
@pytest.mark.parametrize(("dtype", "most"), [("<u1", 255), ("<u2", 65535), ("<i1", 127), ("<i2", 32767)])
def test_normalised_texture_coordinates(tmp_path, name, dtype, most):
    check(read_card(tmp_path, name, TEXCOORD_0=lambda g: g.accessor((CARD_UV * most).astype(dtype), normalized=True)))


@pytest.mark.parametrize(("dtype", "most"), [("<u1", 255), ("<u2", 65535), ("<i1", 127), ("<i2", 32767)])
def test_normalised_positions_are_fractions(tmp_path, dtype, most):
    rows = (np.pad(CARD, ((0, 0), (0, 1))) * most).astype(dtype)[:, :3]
    check(read_card(tmp_path, POSITION=lambda g: g.accessor(rows, normalized=True)))


def test_positions_of_plain_integers_are_scaled_by_their_node(tmp_path):
    """`KHR_mesh_quantization`, as gltfpack writes it: padded to four bytes, with the scale in the node."""
    gltf = Gltf()
    gltf.use("KHR_mesh_quantization", required=True)
    position = gltf.accessor((CARD * 4095).astype("<u2"), stride=8)
    gltf.node(mesh=gltf.mesh({"POSITION": position}, CARD_FACES), scale=[0.1 / 4095] * 3, translation=[5, 0, 0])
    mesh = read_mesh(gltf.write(tmp_path))
    np.testing.assert_allclose(mesh.size_mm, [0.1, 0.1, 0], atol=1e-6)


def test_texture_coordinates_of_plain_integers_are_scaled_by_their_transform(tmp_path):
    gltf = Gltf()
    moved = {"KHR_texture_transform": {"scale": [1 / 4095, 1 / 4095]}}
    material = gltf.material(**base_colour(gltf.picture(QUARTERS), extensions=moved))
    gltf.card(material, (CARD_UV * 4095).astype("<u2"))
    check(read_mesh(gltf.write(tmp_path)))


def test_the_least_signed_integer_is_minus_one(tmp_path):
    rows = np.array([[-32768, 0, 0], [32767, 0, 0], [0, 32767, 0]], "<i2")
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh({"POSITION": gltf.accessor(rows, stride=8, normalized=True)}))
    np.testing.assert_allclose(read_mesh(gltf.write(tmp_path)).size_mm, [2, 1, 0], atol=1e-6)


def test_interleaved_rows(tmp_path):
    check(
        read_card(
            tmp_path,
            POSITION=lambda g: g.accessor(CARD, stride=28),
            TEXCOORD_0=lambda g: g.accessor(CARD_UV, stride=12),
        )
    )


def test_sparse_rows_replace_those_below_them_and_zeros(tmp_path):
    def make(gltf, below):
        number = gltf.accessor(below)
        rows, values = gltf.view(np.array([1, 2, 3], "<u2").tobytes()), gltf.view(CARD[1:].tobytes())
        gltf.tree["accessors"][number]["sparse"] = {
            "count": 3, "indices": {"bufferView": rows, "componentType": 5123}, "values": {"bufferView": values},
        }  # fmt: skip
        return number

    check(read_card(tmp_path, POSITION=lambda g: make(g, np.vstack([CARD[:1], np.full((3, 3), 9)]).astype("<f4"))))

    def make_of_zeros(gltf):
        number = make(gltf, CARD)
        del gltf.tree["accessors"][number]["bufferView"]
        return number

    check(read_card(tmp_path, POSITION=make_of_zeros))


@pytest.mark.parametrize("dtype", ["<u1", "<u2", "<u4"])
def test_indices_of_any_size(tmp_path, dtype):
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh({"POSITION": CARD}, CARD_FACES.astype(dtype)))
    assert len(read_mesh(gltf.write(tmp_path)).faces) == 2


def break_offset(gltf):
    gltf.tree["accessors"][0]["byteOffset"] = 1000


def break_view(gltf):
    gltf.tree["bufferViews"][0]["byteLength"] = 10**6


def break_count(gltf):
    gltf.tree["accessors"][0]["count"] = 500


def break_stride(gltf):
    gltf.tree["bufferViews"][0]["byteStride"] = 100


def break_index(gltf):
    gltf.tree["accessors"][2] = gltf.tree["accessors"][2] | {"count": 5}


def break_type(gltf):
    gltf.tree["accessors"][0]["type"] = "VEC9"


def break_number(gltf):
    gltf.tree["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 77


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (break_offset, "accessor 0 reaches outside of its buffer view of 48 bytes"),
        (break_view, "buffer view 0 reaches outside of its buffer"),
        (break_count, "accessor 0 reaches outside"),
        (break_stride, "accessor 0 reaches outside"),
        (break_index, "5 indices make no triangles"),
        (break_type, "accessor 0 is of an unknown type"),
        (break_number, "accessors has 3 entries, none is number 77"),
    ],
)
def test_numbers_that_are_not_there_are_one_clear_line(tmp_path, damage, words):
    gltf = Gltf()
    gltf.card()
    damage(gltf)
    with pytest.raises(ToolkitError, match=words) as caught:
        read_mesh(gltf.write(tmp_path))
    assert str(tmp_path / "thing.glb") in str(caught.value) and "\n" not in str(caught.value)
