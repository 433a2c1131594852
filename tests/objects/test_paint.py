"""Colours and pictures of users' meshes: what becomes of them, and of pictures that are too large or damaged."""

import io
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from toolkit.core.errors import ToolkitError
from toolkit.imaging import read
from toolkit.objects import paint
from toolkit.objects.atlas import make_atlas
from toolkit.objects.load import read_mesh
from toolkit.objects.mesh import Mesh


def to_linear(code):
    code = np.asarray(code, float) / 255
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def colour_at(mesh: Mesh, face: int, weights) -> np.ndarray:
    """Linear colour of a place on a face, bilinear between texels as renderers look it up."""
    texture = to_linear(mesh.materials[mesh.face_material[face]].texture)
    u, v = np.asarray(weights) @ mesh.uv[mesh.faces[face]].astype(float)
    x, y = u * texture.shape[1] - 0.5, (1 - v) * texture.shape[0] - 0.5
    column, row = int(np.floor(x + 1e-4)), int(np.floor(y + 1e-4))
    fx, fy = x - column, y - row
    around = texture[row : row + 2, column : column + 2]
    around = np.pad(around, ((0, 2 - around.shape[0]), (0, 2 - around.shape[1]), (0, 0)), mode="edge")
    return np.einsum("r,c,rck->k", [1 - fy, fy], [1 - fx, fx], around)


def a_coloured_ball(folder, name, dtype=np.uint8):
    """Colours say the place: red, green, blue grow with x, y, z."""
    ball = trimesh.creation.icosphere(2, 10.0)
    colours = np.clip(np.asarray(ball.vertices) * 6 + 128, 0, 255).astype(np.uint8)
    ball.visual.vertex_colors = np.column_stack([colours, np.full(len(colours), 255, np.uint8)])
    ball.export(folder / name)
    return folder / name


@pytest.mark.parametrize("name", ["ball.ply", "ball.obj", "ball.glb"])
def test_colours_of_vertices_are_blended_over_each_face(tmp_path, name):
    mesh = read_mesh(a_coloured_ball(tmp_path, name))
    assert len(mesh.faces) == 320 and [m.name for m in mesh.materials] == ["colours"]
    corners = mesh.vertices[mesh.faces].astype(float)
    for face in range(0, 320, 7):
        expected = np.clip(corners[face] * 6 + 128, 0, 255)
        expected = expected / 255 if name == "ball.glb" else to_linear(expected)  # glTF's colours are linear light
        for weights in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1 / 3, 1 / 3, 1 / 3), (0.6, 0.3, 0.1)):
            np.testing.assert_allclose(colour_at(mesh, face, weights), weights @ expected, atol=0.02)


def test_neighbours_lie_near_each_other_on_the_texture_so_that_it_can_be_shrunk(tmp_path):
    """A few levels up, where a texel holds many faces, colours are still those of the place."""
    ball = trimesh.creation.icosphere(4, 10.0)
    colours = np.clip(np.asarray(ball.vertices) * 6 + 128, 0, 255).astype(np.uint8)
    ball.visual.vertex_colors = np.column_stack([colours, np.full(len(colours), 255, np.uint8)])
    ball.export(tmp_path / "ball.ply")
    mesh = read_mesh(tmp_path / "ball.ply")
    texture = mesh.materials[0].texture.astype(float)
    blocks = texture.reshape(texture.shape[0] // 8, 8, texture.shape[1] // 8, 8, 3)  # 16 faces each
    spread = blocks.std(axis=(1, 3)).mean()
    assert spread < 0.25 * texture.reshape(-1, 3)[texture.reshape(-1, 3).any(axis=1)].std()


def test_faces_too_small_to_be_blended_have_their_mean_colour(tmp_path, monkeypatch):
    """One place on the texture each, so that no look-up mixes faces that lie apart."""
    monkeypatch.setattr(paint, "BLENDED", 300)
    mesh = read_mesh(a_coloured_ball(tmp_path, "ball.ply"))
    corners = mesh.vertices[mesh.faces].astype(float)
    assert np.ptp(mesh.uv[mesh.faces], axis=1).max() == 0
    for face in range(0, 320, 7):
        expected = to_linear(np.clip(corners[face] * 6 + 128, 0, 255)).mean(axis=0)
        np.testing.assert_allclose(colour_at(mesh, face, (1, 0, 0)), expected, atol=0.01)


def test_more_colours_than_a_texture_holds_lose_their_last_bit(monkeypatch):
    monkeypatch.setattr(paint, "MOST_COLOURS", 200)
    colours = np.column_stack([np.arange(256), np.full(256, 7), np.full(256, 8)]).astype(np.uint8)
    uv, texture = paint._spread_palette(colours)
    assert len(np.unique(uv, axis=0)) == 128 and texture.shape == (48, 48, 3)
    assert texture[..., 1].max() == 6 and set(np.unique(texture[..., 0])) == set(range(0, 256, 2))


def test_a_texture_that_was_made_from_colours_is_no_sheet_to_train(tmp_path):
    assert make_atlas(read_mesh(a_coloured_ball(tmp_path, "ball.ply")), 64).unwrapped


def test_a_base_colour_without_texture_coordinates_is_the_colour(tmp_path):
    box = trimesh.creation.box((1, 2, 3))
    box.visual = TextureVisuals(material=PBRMaterial(baseColorFactor=[200, 40, 10, 255], roughnessFactor=0.3))
    box.export(tmp_path / "box.glb")
    (material,) = read_mesh(tmp_path / "box.glb").materials
    np.testing.assert_allclose(
        to_linear(material.texture.reshape(-1, 3)) * 255, np.tile([200, 40, 10], (16, 1)), atol=1
    )
    assert material.roughness == pytest.approx(0.3)


def test_colours_of_vertices_are_tinted_by_the_base_colour(tmp_path):
    box = trimesh.creation.box((1, 1, 1))
    box.visual = TextureVisuals(material=PBRMaterial(baseColorFactor=[255, 128, 0, 255]))
    box.visual.vertex_attributes["color"] = np.tile(np.array([[100, 200, 50, 255]], np.uint8), (len(box.vertices), 1))
    box.export(tmp_path / "box.glb")
    (material,) = read_mesh(tmp_path / "box.glb").materials
    found = to_linear(material.texture.reshape(-1, 3).mean(axis=0)) * 255
    expected = [100, 200 * 128 / 255, 0] if material.name == paint.COLOURS else [255, 128, 0]
    np.testing.assert_allclose(found, expected, atol=1.5)  # older trimesh writes no colours beside a material


def a_textured_card(folder, image: Image.Image, name="card.glb"):
    square = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    square.visual = TextureVisuals(
        uv=[[0, 0], [1, 0], [1, 1], [0, 1]], material=PBRMaterial(baseColorTexture=image, metallicFactor=0.0)
    )
    square.export(folder / name)
    return folder / name


def test_a_large_texture_is_shrunk_with_a_notice(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(read, "MAX_TEXTURE_PX", 16)
    pixels = np.random.default_rng(0).integers(0, 256, (20, 40, 3), dtype=np.uint8)
    mesh = read_mesh(a_textured_card(tmp_path, Image.fromarray(pixels)))
    shown = mesh.materials[0].texture
    assert shown.shape == (7, 14, 3)
    np.testing.assert_allclose(shown[0, 0], pixels[:3, :3].reshape(-1, 3).mean(axis=0), atol=1)
    said = capsys.readouterr().err
    assert "card.glb: a texture of 40 × 20 pixels is shrunk to 14 × 7" in said and said.count("\n") == 1


def test_a_texture_far_too_large_is_one_clear_line(tmp_path, monkeypatch):
    file = a_textured_card(tmp_path, Image.new("RGB", (60, 50)))
    monkeypatch.setattr(read, "MAX_MEGAPIXELS", 0.002)
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)  # Pillow's own limit would leave it out without a word
    with pytest.raises(ToolkitError, match=r"card\.glb: a texture of 60 × 50 pixels, more than 0.002 megapixels: sca"):
        read_mesh(file)
    assert Image.MAX_IMAGE_PIXELS == 100


def test_a_texture_without_its_end_is_one_clear_line(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG")
    (tmp_path / "skin.png").write_bytes(out.getvalue()[:3000])
    (tmp_path / "skin.mtl").write_text("newmtl skin\nmap_Kd skin.png\n")
    (tmp_path / "card.obj").write_text(
        "mtllib skin.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nusemtl skin\nf 1/1 2/2 3/3\n"
    )
    with pytest.raises(ToolkitError, match=r"skin\.png: a texture of 64 × 64 pixels: truncated"):
        read_mesh(tmp_path / "card.obj")


def test_sixteen_bits_and_transparency_do_not_change_the_paint(tmp_path):
    deep = Image.fromarray(np.full((8, 8), 32896, np.uint16))  # 128 of 255
    assert (read.decode_texture(deep, "a") == 128).all()
    clear = Image.fromarray(np.full((8, 8, 4), (10, 200, 30, 0), np.uint8))
    assert (read.decode_texture(clear, "a") == (10, 200, 30)).all()


PEAK = """
import sys
from pathlib import Path
from toolkit.objects.load import read_mesh
shape = read_mesh(Path(sys.argv[1])).materials[0].texture.shape
(peak,) = [line.split()[1] for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")]
print(shape, int(peak) // 1024)  # not getrusage: a child begins with its parent's peak
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads its memory from /proc")
def test_a_texture_of_13000_pixels_a_side_loads_in_a_gigabyte_and_a_half(tmp_path):
    file = a_textured_card(tmp_path, Image.new("RGB", (13000, 13000), (20, 90, 160)))
    done = subprocess.run([sys.executable, "-c", PEAK, str(file)], capture_output=True, text=True, check=True)
    shape, _, peak_mb = done.stdout.strip().rpartition(" ")
    assert shape == "(6500, 6500, 3)" and int(peak_mb) < 1500
