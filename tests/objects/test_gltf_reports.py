"""glTFs made after public bug reports of neighbouring tools, and models of others: what each should show."""

import numpy as np
import pytest
from gltf_builder import colours_at

from toolkit.core.errors import ToolkitError
from toolkit.objects.load import read_mesh

RUST = (188, 92, 60)
QUARTERS = {(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)}


def read(shared, name):
    file = shared / name
    if not file.is_file():
        pytest.skip(f"needs {name} from ../shared")
    return read_mesh(file)


def colours_of(mesh, number=0):
    return {tuple(texel) for texel in mesh.materials[number].texture.reshape(-1, 3).tolist()}


def shown(mesh):
    """The colours that faces have in their middles."""
    uv = mesh.uv[mesh.faces].mean(axis=1)
    found = set()
    for place, number in zip(uv, mesh.face_material, strict=True):
        texture = mesh.materials[number].texture
        u, v = place % 1
        found.add(tuple(texture[int((1 - v) % 1 * texture.shape[0]), int(u * texture.shape[1])].tolist()))
    return found


@pytest.mark.parametrize("name", ["control_tex", "factor", "vcolor_u8", "vcolor_u16", "vcolor_float", "unlit", "png16"])
def test_the_same_colour_however_it_is_written(shared, name):
    mesh = read(shared, f"reports/glb/{name}.glb")
    np.testing.assert_allclose(list(shown(mesh)), [RUST], atol=1)
    np.testing.assert_allclose(mesh.size_mm, 0.1, rtol=1e-4)


@pytest.mark.parametrize("name", ["uv_u16", "quant", "texcoord1", "texcoord1_only", "webp"])
def test_the_same_cube_however_its_numbers_are_written(shared, name):
    mesh, plain = read(shared, f"reports/glb/{name}.glb"), read(shared, "reports/glb/scene1.glb")
    np.testing.assert_allclose(mesh.size_mm, 0.1, rtol=1e-4)
    assert colours_of(mesh) == QUARTERS == colours_of(plain)
    np.testing.assert_allclose(np.sort(mesh.uv, axis=0), np.sort(plain.uv, axis=0), atol=1e-4)


def test_white_times_red(shared):
    assert shown(read(shared, "reports/glb/vcolor_x_tex.glb")) == {(255, 0, 0)}


@pytest.mark.parametrize(("name", "metallic"), [("mrtex", 0), ("specgloss", 0), ("metal", 0)])
def test_what_is_no_metal(shared, name, metallic):
    assert read(shared, f"reports/glb/{name}.glb").materials[0].metallic == pytest.approx(metallic, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "longest"), [("morph1", 0.2), ("fan", 0.3), ("strip", 0.3), ("negscale", 0.1), ("opaque_alpha0", 0.1)]
)
def test_sizes(shared, name, longest):
    assert read(shared, f"reports/glb/{name}.glb").size_mm.max() == pytest.approx(longest, rel=1e-4)


def test_holes(shared):
    mesh = read(shared, "reports/glb/mask.glb")
    assert len(mesh.faces) > 12 and shown(mesh) != {(0, 0, 0)}


@pytest.mark.parametrize(
    ("name", "extension"), [("basisu", "KHR_texture_basisu"), ("meshopt", "EXT_meshopt_compression")]
)
def test_what_cannot_be_unpacked_is_one_line_that_names_the_extension(shared, name, extension):
    with pytest.raises(ToolkitError, match=extension) as caught:
        read(shared, f"reports/glb/{name}.glb")
    assert "\n" not in str(caught.value)


def test_khronos_card_shows_its_correct_signs(shared):
    """Ticks on green, blue and cyan; below, three arrows whose shafts point to ticks."""
    mesh = read(shared, "meshes/gltf/textureTransform/TextureTransformTest.gltf")
    ticks = np.array([[-1.4, 0.9], [-0.3, 0.9], [0.8, 0.9]])
    np.testing.assert_allclose(colours_at(mesh, ticks), [[0, 192, 0], [0, 0, 192], [0, 192, 192]], atol=2)
    shafts = np.array([[-1.387, -0.541], [-0.248, -0.303], [0.877, -0.477]])
    assert (colours_at(mesh, shafts) < 40).all()


def test_the_box_of_specular_and_glossiness_is_the_other_one(shared):
    name = "meshes/gltf/BoxTextured-glTF-{}/BoxTextured.gltf"
    glossy, plain = (read(shared, name.format(kind)) for kind in ("pbrSpecularGlossiness", "Embedded"))
    np.testing.assert_array_equal(glossy.materials[0].texture, plain.materials[0].texture)


def test_a_model_of_115_parts_that_draco_packed(shared):
    pytest.importorskip("DracoPy", reason="needs the extra gltf")
    mesh = read(shared, "meshes/gltf/draco/2CylinderEngine.gltf")
    assert len(mesh.faces) == 110_326 and len(mesh.materials) == 115
    np.testing.assert_allclose(mesh.size_mm, [743.38, 272.99, 268], atol=0.1)
