"""Geometry in bulk against closed forms."""

import numpy as np
import pytest

from toolkit.objects.mesh import Material, Mesh, hash_mesh
from toolkit.rooms.worlds.content.drawing import fractal, noise
from toolkit.rooms.worlds.content.pieces import (
    Looks,
    Piece,
    bars,
    boxes,
    cross,
    floor_quads,
    merge,
    place,
    quads,
    wall_quads,
)

NO_EMISSION = "a8d08b8a535c7302f90b4fc2accd6af3910b3dc373f63e177fb363ba0d619b1c"
"""The hash of a triangle from before materials could give light off: records hold such hashes."""


@pytest.fixture
def looks() -> Looks:
    return Looks(0)


def volume_of(piece: Piece) -> float:
    a, b, c = piece.vertices[piece.faces].astype(float).transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def test_boxes_enclose_their_volume_with_outward_faces(looks: Looks) -> None:
    low, high = np.array([(0, 0, 0), (4, -1, 2)], float), np.array([(1, 2, 3), (5, 1, 2.5)], float)
    piece = boxes(low, high, looks.plain((9, 9, 9)), 1, without=())
    assert volume_of(piece) == pytest.approx(6 + 1, rel=1e-6)


def test_place_turns_and_scales_a_copy_each(looks: Looks) -> None:
    piece = boxes(np.zeros((1, 3)), np.ones((1, 3)), looks.plain((9, 9, 9)), 1, without=())
    two = place(piece, [(10, 0, 0), (0, 5, 0)], [0, 90], [(2, 1, 1), (2, 1, 1)])
    first, second = two.vertices[:24], two.vertices[24:]
    assert np.ptp(first, axis=0) == pytest.approx([2, 1, 1])
    assert np.ptp(second, axis=0) == pytest.approx([1, 2, 1])
    assert second.min(axis=0) == pytest.approx([-1, 5, 0], abs=1e-6)
    assert volume_of(two) == pytest.approx(4)
    assert np.linalg.norm(two.normals, axis=1) == pytest.approx(1)


def test_bars_have_their_length_and_thickness(looks: Looks) -> None:
    piece = bars((0, 0, 0), (0, 3, 4), 0.2, looks.plain((9, 9, 9)), 1)
    middle = piece.vertices[piece.faces].mean(axis=1) - [0, 1.5, 2]
    assert (np.einsum("ij,ij->i", middle, piece.normals[piece.faces[:, 0]]) > 0).all()  # its sides face out
    corners = piece.vertices[piece.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(4 * 0.2 * 5, rel=1e-5)


def test_walls_and_floors_keep_the_texture_to_scale(looks: Looks) -> None:
    skin = looks.add(Material("w", np.zeros((8, 8, 3), np.uint8)), (2.0, 4.0))
    wall = wall_quads((1, 0, 3, 4), 0.0, skin, 1)
    assert np.ptp(wall.uv, axis=0) == pytest.approx([1, 1])
    assert wall.normals[0] == pytest.approx([0, -1, 0])
    floor = floor_quads((0, 0, 4, 4), 1.0, skin, 1)
    assert np.ptp(floor.uv, axis=0) == pytest.approx([2, 1])
    assert floor.normals[0] == pytest.approx([0, 0, 1])


def test_quads_without_area_are_left_out(looks: Looks) -> None:
    flat = np.zeros((1, 4, 3))
    real = np.array([[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]], float)
    assert len(quads(np.concatenate([flat, real]), looks.plain((1, 2, 3)), 1).faces) == 2
    assert len(merge().faces) == 0


def test_cross_is_numpys() -> None:
    a, b = np.random.default_rng(0).normal(size=(2, 50, 3))
    assert cross(a, b) == pytest.approx(np.cross(a, b))


def test_plain_colours_share_a_sheet_and_keep_their_colour(looks: Looks) -> None:
    red, blue = looks.plain((200, 10, 20)), looks.plain((10, 20, 200))
    assert red.material == blue.material
    assert red.at != blue.at
    sheet = looks.materials[red.material].texture
    assert red.at is not None
    row, column = int((1 - red.at[1]) * sheet.shape[0]), int(red.at[0] * sheet.shape[1])
    assert sheet[row, column].tolist() == [200, 10, 20]


def test_noise_repeats_without_a_seam_and_by_its_seed() -> None:
    field = noise(np.random.default_rng(4), (64, 64), (6, 6))
    inner, seam = np.abs(np.diff(field, axis=0)).max(), np.abs(field[0] - field[-1]).max()
    assert seam <= 1.5 * inner
    again, other = (fractal(np.random.default_rng(seed), (64, 64)) for seed in (4, 5))
    assert np.array_equal(again, fractal(np.random.default_rng(4), (64, 64)))
    assert not np.array_equal(again, other)


def test_emission_is_hashed_only_where_there_is_one() -> None:
    texture = np.full((4, 4, 3), 7, np.uint8)

    def hashed(emission: np.ndarray | None) -> str:
        material = Material("m", texture, emission=emission)
        triangle = np.eye(3, dtype=np.float32)
        faces = np.array([[0, 1, 2]], np.int32)
        return hash_mesh(Mesh(triangle, triangle, triangle[:, :2], faces, np.zeros(1, np.int32), (material,)))

    dark, lit = hashed(None), hashed(texture)
    assert dark != lit
    assert dark == NO_EMISSION
