"""Holes of `alphaMode: MASK`: as large as a closed form says, and where the picture has them."""

import numpy as np
import pytest
from gltf_builder import CARD_UV, Gltf, base_colour, colours_at

from toolkit.core.errors import ToolkitError
from toolkit.objects.gltf import holes
from toolkit.objects.load import read_mesh

SIDE = 64


def disc_alpha(radius=20.0):
    """A solid disc whose alpha falls from 1 to 0 over eight texels; half of it is reached at the radius."""
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5 - SIDE / 2
    return np.clip(0.5 + (radius - np.hypot(x, y)) / 8, 0, 1)


def write_card(folder, alpha, uv=CARD_UV, factor=1.0, **fields):
    gltf = Gltf()
    pixels = np.full((*alpha.shape, 4), 90, np.uint8)
    pixels[..., 3] = np.round(alpha * 255)
    look = base_colour(gltf.picture(pixels))
    look["pbrMetallicRoughness"]["baseColorFactor"] = [1, 1, 1, factor]
    gltf.card(gltf.material(**look, **fields), np.asarray(uv, "<f4"))
    return gltf.write(folder)


def measure(mesh):
    corners = mesh.vertices[mesh.faces].astype(float)
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2


@pytest.mark.parametrize(("cutoff", "radius"), [(None, 20), (0.25, 22), (0.75, 18)])
def test_a_disc_is_cut_out(tmp_path, cutoff, radius):
    more = {} if cutoff is None else {"alphaCutoff": cutoff}
    mesh = read_mesh(write_card(tmp_path, disc_alpha(), alphaMode="MASK", **more))
    assert measure(mesh) == pytest.approx(np.pi * (radius / SIDE) ** 2, rel=0.005)
    from_centre = np.hypot(*(mesh.vertices[:, :2] - 0.5).T)
    assert from_centre.max() == pytest.approx(radius / SIDE, abs=0.3 / SIDE)


def test_a_hole_is_empty_and_the_rest_is_painted(tmp_path):
    mesh = read_mesh(write_card(tmp_path, 1 - disc_alpha(), alphaMode="MASK"))
    places = np.array([[0.5, 0.5], [0.7, 0.5], [0.9, 0.5], [0.1, 0.1]])
    found = colours_at(mesh, places)
    assert np.isnan(found[:2]).all() and (found[2:] == pytest.approx(90))


def test_holes_repeat_with_their_picture(tmp_path):
    mesh = read_mesh(write_card(tmp_path, disc_alpha(), CARD_UV * 2 - 0.3, alphaMode="MASK"))
    assert measure(mesh) == pytest.approx(np.pi * (20 / SIDE) ** 2, rel=0.01)


def test_the_factors_alpha_counts_too(tmp_path):
    mesh = read_mesh(write_card(tmp_path, disc_alpha(), factor=0.5 / 0.75, alphaMode="MASK"))
    assert measure(mesh) == pytest.approx(np.pi * (18 / SIDE) ** 2, rel=0.01)
    with pytest.raises(ToolkitError, match="no faces"):
        read_mesh(write_card(tmp_path, disc_alpha(), factor=0.1, alphaMode="MASK"))


def test_a_solid_picture_leaves_the_triangles_as_they_are(tmp_path):
    assert len(read_mesh(write_card(tmp_path, np.ones((8, 8)), alphaMode="MASK")).faces) == 2


@pytest.mark.parametrize("mode", ["OPAQUE", "BLEND"])
def test_other_modes_cut_nothing(tmp_path, mode, capsys):
    assert len(read_mesh(write_card(tmp_path, disc_alpha(), alphaMode=mode)).faces) == 2
    assert ("alphaMode BLEND of 'skin' is left out: it is drawn opaque" in capsys.readouterr().err) == (mode == "BLEND")


def test_a_picture_of_specks_is_cut_as_finely_as_the_cap_allows(tmp_path, monkeypatch):
    monkeypatch.setattr(holes, "MOST_PIECES", 2000)
    specks = np.random.default_rng(0).random((SIDE, SIDE)).round()
    mesh = read_mesh(write_card(tmp_path, specks, alphaMode="MASK"))
    assert 0 < len(mesh.faces) < 8000 and 0.3 < measure(mesh) < 0.7


def test_alpha_of_vertices_cuts_holes(tmp_path):
    gltf = Gltf()
    fading = np.array([[1, 1, 1, 1], [1, 1, 1, 0], [1, 1, 1, 0], [1, 1, 1, 1]], "<f4")
    gltf.card(gltf.material(alphaMode="MASK"), uv=None, COLOR_0=fading)
    mesh = read_mesh(gltf.write(tmp_path))
    np.testing.assert_allclose(mesh.size_mm, [0.5, 1, 0], atol=1e-6)


def test_alpha_of_vertices_multiplies_that_of_a_picture(tmp_path):
    gltf = Gltf()
    half = np.full((8, 8, 4), 255, np.uint8)
    half[:, 4:, 3] = 0
    fading = np.array([[1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 0], [1, 1, 1, 0]], "<f4")
    gltf.card(gltf.material(alphaMode="MASK", **base_colour(gltf.picture(half))), COLOR_0=fading)
    found = colours_at(read_mesh(gltf.write(tmp_path)), np.array([[0.3, 0.3], [0.3, 0.7], [0.7, 0.3], [0.7, 0.7]]))
    assert np.isnan(found[:, 0]).tolist() == [False, True, True, True]
