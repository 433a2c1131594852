"""Colours of glTF: factors, vertices and pictures in linear light, by every sampler and transform; gloss."""

import numpy as np
import pytest
from gltf_builder import CARD, CARD_FACES, CARD_UV, Gltf, base_colour, colours_at, to_code, to_linear
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.objects.add import find_named_files
from toolkit.objects.load import read_mesh
from toolkit.objects.paint import COLOURS, PLAIN_COLOUR

RUST = np.array([0.5028864580325687, 0.10702310297826761, 0.04518620438567554])
"""Linear light of sRGB (188, 92, 60)."""
GRID = np.stack(np.meshgrid(np.linspace(0.06, 0.94, 9), np.linspace(0.07, 0.93, 8)), axis=-1).reshape(-1, 2)
NOISE = np.random.default_rng(3).integers(0, 256, (8, 16, 3), dtype=np.uint8)
CLAMP, MIRROR, REPEAT = 33071, 33648, 10497


def read(folder, gltf):
    return read_mesh(gltf.write(folder))


def paint_card(folder, pixels, uv=CARD_UV, sampler=None, more=None, **slot):
    """What is painted on a card at `GRID`."""
    gltf = Gltf()
    texture = gltf.picture(pixels, sampler=sampler)
    gltf.card(gltf.material(**base_colour(texture, **slot), **(more or {})), uv)
    return colours_at(read(folder, gltf), GRID)


def sample(pixels, uv, wraps=(REPEAT, REPEAT)):
    """The specification's look-up, v down, as codes."""
    light, total = to_linear(pixels), 0
    height, width = light.shape[:2]
    x, y = uv[:, 0] * width - 0.5, uv[:, 1] * height - 0.5

    def wrap(index, size, mode):
        if mode == CLAMP:
            return np.clip(index, 0, size - 1)
        index = index % (2 * size) if mode == MIRROR else index % size
        return np.where(index >= size, 2 * size - 1 - index, index)

    for column, row in ((0, 0), (1, 0), (0, 1), (1, 1)):
        left, top = np.floor(x).astype(int) + column, np.floor(y).astype(int) + row
        weight = (1 - np.abs(x - left)) * (1 - np.abs(y - top))
        total = total + weight[:, None] * light[wrap(top, height, wraps[1]), wrap(left, width, wraps[0])]
    return to_code(total)


def upright(places):
    return places * [1, -1] + [0, 1]


def test_a_base_colour_is_linear_light(tmp_path):
    gltf = Gltf()
    gltf.card(gltf.material(pbrMetallicRoughness={"baseColorFactor": [*RUST, 1]}))
    np.testing.assert_allclose(colours_at(read(tmp_path, gltf), GRID), [[188, 92, 60]] * len(GRID), atol=1)


@pytest.mark.parametrize(("dtype", "most"), [("<f4", 1), ("<u1", 255), ("<u2", 65535)])
@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("has_material", [True, False])
def test_colours_of_vertices_are_linear_light(tmp_path, dtype, most, channels, has_material):
    gltf = Gltf()
    rows = np.tile(np.append(RUST, 1)[:channels] * most, (4, 1))
    colours = gltf.accessor((rows if most == 1 else np.round(rows)).astype(dtype), normalized=most > 1)
    gltf.card(gltf.material() if has_material else None, COLOR_0=colours)
    np.testing.assert_allclose(colours_at(read(tmp_path, gltf), GRID), [[188, 92, 60]] * len(GRID), atol=1.2)


def test_steep_colours_are_blended_evenly(tmp_path):
    """From 0 to 1 across one triangle, where four texels would need a colour below 0."""
    gltf = Gltf()
    colours = np.array([[1, 1, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0]], "<f4")
    gltf.card(gltf.material(), COLOR_0=colours)
    x, y = np.random.default_rng(1).random((2, 200))
    x, y = np.maximum(x, y), np.minimum(x, y)  # in the first triangle
    expected = np.stack([1 - x, x - y, y], axis=1) @ colours[:3]
    found = to_linear(colours_at(read(tmp_path, gltf), np.stack([x, y], axis=1)))
    np.testing.assert_allclose(found, expected, atol=0.03)


def test_one_colour_times_a_picture_keeps_the_pictures_coordinates(tmp_path):
    gltf = Gltf()
    material = gltf.material(**base_colour(gltf.picture(np.full((4, 4, 3), 255, np.uint8))))
    gltf.card(material, COLOR_0=np.tile([1, 0, 0], (4, 1)).astype("<f4"))
    mesh = read(tmp_path, gltf)
    assert mesh.materials[0].name == "skin"
    np.testing.assert_allclose(colours_at(mesh, GRID), [[255, 0, 0]] * len(GRID), atol=1)


def test_blended_colours_times_a_factor_times_a_picture(tmp_path):
    gltf = Gltf()
    look = base_colour(gltf.picture(NOISE.repeat(8, axis=0).repeat(8, axis=1)))
    look["pbrMetallicRoughness"]["baseColorFactor"] = [0.5, 1, 1, 1]
    # red from left to right, green upwards, blue stays
    colours = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], "<f4")
    gltf.card(gltf.material(**look), COLOR_0=colours)
    mesh = read(tmp_path, gltf)
    assert mesh.materials[0].name == COLOURS  # no sheet to train
    # in the middles of texels, where a blend of the new picture's texels says nothing else
    places = (np.stack(np.meshgrid(np.arange(16), np.arange(8)), axis=-1).reshape(-1, 2) + 0.5) / [16, 8]
    picture = to_linear(sample(NOISE, places))
    light = np.stack([places[:, 0] * 0.5, 1 - places[:, 1], np.ones(len(places))], axis=1)
    np.testing.assert_allclose(to_linear(colours_at(mesh, upright(places))), picture * light, atol=0.02)


@pytest.mark.parametrize("wraps", [(CLAMP, CLAMP), (MIRROR, MIRROR), (CLAMP, MIRROR), (MIRROR, REPEAT)])
def test_pictures_beyond_their_edges(tmp_path, wraps):
    uv = CARD_UV * [2.4, 3] - [0.7, 1.1]
    found = paint_card(tmp_path, NOISE, uv.astype("<f4"), {"wrapS": wraps[0], "wrapT": wraps[1]})
    expected = sample(NOISE, upright(GRID) * [2.4, 3] - [0.7, 1.1], wraps)
    np.testing.assert_allclose(found, expected, atol=1.5)


def test_a_clamped_picture_far_beyond_its_edges(tmp_path):
    uv = CARD_UV * 60 - 30
    found = paint_card(tmp_path, np.full((8, 8, 3), (9, 200, 99), np.uint8), uv.astype("<f4"), {"wrapS": CLAMP})
    np.testing.assert_allclose(found, [[9, 200, 99]] * len(GRID), atol=1)


def test_a_picture_that_is_not_to_be_blurred_has_hard_texels(tmp_path):
    pixels = np.array([[[255, 0, 0], [0, 0, 255]]], np.uint8)
    found = paint_card(tmp_path, pixels, sampler={"magFilter": 9728})
    left, right = GRID[:, 0] < 0.49, GRID[:, 0] > 0.51
    np.testing.assert_allclose(found[left], [[255, 0, 0]] * left.sum(), atol=1)
    np.testing.assert_allclose(found[right], [[0, 0, 255]] * right.sum(), atol=1)


@pytest.mark.parametrize(
    ("moved", "place"),
    [
        ({"offset": [0.25, 0.5]}, lambda u, v: (u + 0.25, v + 0.5)),
        ({"scale": [2, 3]}, lambda u, v: (2 * u, 3 * v)),
        ({"rotation": np.pi / 2}, lambda u, v: (v, -u)),
        ({"rotation": np.pi / 2, "scale": [2, 1], "offset": [0.1, 0]}, lambda u, v: (v + 0.1, -2 * u)),
    ],
)
def test_texture_transforms(tmp_path, moved, place):
    """The specification's matrix: translation times rotation times scale, positive angles counter-clockwise."""
    found = paint_card(tmp_path, NOISE, extensions={"KHR_texture_transform": moved})
    expected = sample(NOISE, np.stack(place(*upright(GRID).T), axis=1))
    np.testing.assert_allclose(found, expected, atol=1.5)


@pytest.mark.parametrize("by_extension", [True, False])
def test_a_second_set_of_coordinates(tmp_path, by_extension):
    gltf = Gltf()
    slot = {"texCoord": 1}
    if by_extension:
        slot = {"texCoord": 0, "extensions": {"KHR_texture_transform": slot}}
    material = gltf.material(**base_colour(gltf.picture(NOISE), **slot))
    gltf.card(material, np.zeros((4, 2), "<f4"), TEXCOORD_1=CARD_UV)
    np.testing.assert_allclose(colours_at(read(tmp_path, gltf), GRID), sample(NOISE, upright(GRID)), atol=1.5)


def test_a_second_set_alone_and_a_picture_without_a_set(tmp_path, capsys):
    gltf = Gltf()
    material = gltf.material(**base_colour(gltf.picture(NOISE), texCoord=1))
    gltf.card(material, None, TEXCOORD_1=CARD_UV)
    np.testing.assert_allclose(colours_at(read(tmp_path, gltf), GRID), sample(NOISE, upright(GRID)), atol=1.5)
    assert capsys.readouterr().err == ""
    gltf = Gltf()
    gltf.card(gltf.material(**base_colour(gltf.picture(NOISE))), None)
    (material,) = read_mesh(gltf.write(tmp_path, "bare.glb")).materials
    assert tuple(material.texture[0, 0]) == PLAIN_COLOUR
    assert "bare.glb: the picture of 'skin' is left out: a part has no TEXCOORD_0" in capsys.readouterr().err


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e30])
def test_texture_coordinates_that_are_none_leave_the_picture_out_with_a_note(tmp_path, capsys, bad):
    gltf = Gltf()
    uv = CARD_UV.copy()
    uv[0, 0] = bad
    gltf.card(gltf.material(**base_colour(gltf.picture(NOISE), texCoord=0)), uv)
    assert tuple(read(tmp_path, gltf).materials[0].texture[0, 0]) == PLAIN_COLOUR
    assert "the picture of 'skin' is left out: TEXCOORD_0 is not finite" in capsys.readouterr().err


def test_alpha_is_nothing_to_an_opaque_material(tmp_path):
    np.testing.assert_allclose(paint_card(tmp_path, np.full((4, 4, 4), (200, 30, 30, 0))), [[200, 30, 30]] * 72, atol=1)


@pytest.mark.parametrize(("kind", "name"), [("WEBP", "EXT_texture_webp"), ("PNG", "EXT_texture_webp")])
def test_pictures_named_by_extensions(tmp_path, kind, name):
    gltf = Gltf()
    gltf.use(name, required=True)
    texture = gltf.picture(NOISE, kind)
    gltf.tree["textures"][texture] = {"extensions": {name: {"source": 0}}}
    gltf.card(gltf.material(**base_colour(texture)))
    np.testing.assert_allclose(colours_at(read(tmp_path, gltf), GRID), sample(NOISE, upright(GRID)), atol=1.5)


def test_a_picture_that_cannot_be_read_gives_way_to_the_usual_one(tmp_path):
    gltf = Gltf()
    good = gltf.picture(NOISE)
    bad = gltf.image(b"RIFFbroken", "image/webp")
    gltf.tree["textures"][good]["extensions"] = {"EXT_texture_webp": {"source": bad}}
    gltf.card(gltf.material(**base_colour(good)))
    np.testing.assert_allclose(colours_at(read(tmp_path, gltf), GRID), sample(NOISE, upright(GRID)), atol=1.5)


@pytest.mark.parametrize(
    ("uri", "file"),
    [("a%20b.png", "a b.png"), ("50%25.png", "50%.png"), ("50%.png", "50%.png"), ("pics\\a.png", "pics/a.png")],
)
def test_pictures_are_found_however_their_uri_is_written(tmp_path, uri, file):
    gltf = Gltf()
    (tmp_path / "pics").mkdir()
    gltf.card(gltf.material(**base_colour(gltf.picture(NOISE, uri=uri))))
    Image.fromarray(NOISE).save(tmp_path / file)
    path = gltf.write(tmp_path, "thing.gltf")
    assert find_named_files(path) == [tmp_path / file]
    np.testing.assert_allclose(colours_at(read_mesh(path), GRID), sample(NOISE, upright(GRID)), atol=1.5)


@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\n", b"no picture"])
def test_a_picture_that_is_empty_or_broken_is_one_line_with_its_name(tmp_path, content):
    gltf = Gltf()
    gltf.card(gltf.material(**base_colour(gltf.image(content, "image/png", uri="my%20skin.png"))))
    (tmp_path / "my skin.png").write_bytes(content)
    with pytest.raises(ToolkitError, match=r"thing\.gltf: my%20skin\.png: a texture that (is empty|cannot be read)"):
        read_mesh(gltf.write(tmp_path, "thing.gltf"))


def test_metalness_is_a_factor_times_the_mean_of_its_picture_where_it_is_seen(tmp_path, capsys):
    gltf = Gltf()
    pixels = np.zeros((8, 8, 3), np.uint8)
    pixels[:, :4], pixels[:, 4:] = (0, 102, 255), (0, 204, 0)
    gloss = {"metallicRoughnessTexture": {"index": gltf.picture(pixels)}, "roughnessFactor": 0.5}
    gltf.card(gltf.material(pbrMetallicRoughness=gloss), (CARD_UV * [0.4, 1] + [0.55, 0]).astype("<f4"))
    (material,) = read(tmp_path, gltf).materials
    assert material.metallic == pytest.approx(0, abs=1e-6) and material.roughness == pytest.approx(0.4)
    assert "metallicRoughnessTexture of 'skin' counts as its mean" in capsys.readouterr().err


def test_a_material_that_says_nothing_of_gloss_is_no_metal(tmp_path):
    gltf = Gltf()
    gltf.card(gltf.material())
    (material,) = read(tmp_path, gltf).materials
    assert (material.metallic, material.roughness) == (0, 0.6) and tuple(material.texture[0, 0]) == PLAIN_COLOUR


def test_specular_and_glossiness(tmp_path):
    gltf = Gltf()
    name = "KHR_materials_pbrSpecularGlossiness"
    gltf.use(name)
    pixels = np.full((4, 4, 4), (10, 10, 10, 128), np.uint8)
    look = {
        "diffuseTexture": {"index": gltf.picture(NOISE)}, "diffuseFactor": [1, 1, 1, 1], "glossinessFactor": 0.5,
        "specularFactor": [0.04] * 3, "specularGlossinessTexture": {"index": gltf.picture(pixels)},
    }  # fmt: skip
    gltf.card(gltf.material(extensions={name: look}))
    mesh = read(tmp_path, gltf)
    np.testing.assert_allclose(colours_at(mesh, GRID), sample(NOISE, upright(GRID)), atol=1.5)
    assert mesh.materials[0].metallic == 0
    assert mesh.materials[0].roughness == pytest.approx(1 - 0.5 * 128 / 255, abs=1e-3)


def test_a_mesh_without_material_or_colours_is_plain_grey(tmp_path):
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh({"POSITION": CARD}, CARD_FACES))
    assert tuple(read(tmp_path, gltf).materials[0].texture[0, 0]) == PLAIN_COLOUR
