"""Pieces of a wrap on a box: where they lie, and where what is printed on them is seen."""

import numpy as np
import pytest
from wrap_parts import FRONT_AND_TOP, N_PX, SIDE, TEXEL_MM, make_box_wrap

from toolkit.core.draws import Draws
from toolkit.objects.mesh import cross_products
from toolkit.rooms.wraps.config import Misfit
from toolkit.rooms.wraps.wrapped import EDGE_MM, IN_PLACE, LAYER_MM, SHEET_MM, draw_places, lay_piece, wear_wrap

CANVAS = np.full((N_PX, N_PX, 3), 90, np.uint8)
THREE = np.array([[1.0, 0.0, 3.0], [0.0, 1.0, -2.0]])


@pytest.fixture(scope="module")
def box(make_box):
    return make_box()


def areas(corners):
    return np.linalg.norm(cross_products(corners), axis=1).sum() / 2


def turn(degrees, about, shift=(0.0, 0.0), scale=1.0):
    """(2, 3) a turn about a point, then a shift."""
    angle = np.radians(degrees)
    turned = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.column_stack([turned, np.array(about) + shift - turned @ about])


def test_in_place_every_piece_covers_its_part_of_the_surface(box):
    wrap = make_box_wrap(box)
    for piece in wrap.pieces:
        printed, edge = lay_piece(box, piece, IN_PLACE)
        assert areas(printed.corners) + areas(edge.corners) == pytest.approx(piece.area_mm2, rel=5e-3)
        rim = 2 * (piece.width_mm + piece.height_mm) * EDGE_MM - 4 * EDGE_MM**2
        assert areas(edge.corners) == pytest.approx(rim, rel=0.02)


def test_in_place_every_texel_lies_where_the_canvas_says(box):
    wrap = make_box_wrap(box)
    mesh = wear_wrap(box, wrap, CANVAS, draw_places(wrap, None, Draws(0, 0)))
    sheet = mesh.faces[mesh.face_material == len(box.materials)]
    assert mesh.materials[len(box.materials)].texture is CANVAS
    at, uv = mesh.vertices[sheet].astype(float), mesh.uv[sheet].astype(float)
    normal = cross_products(at)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    x, y, z = np.moveaxis(at, 2, 0)
    for axis, flat, origin in (
        ((0, -1, 0), (x + 50, z), FRONT_AND_TOP), ((0, 0, 1), (x + 50, y + 70), FRONT_AND_TOP),
        ((1, 0, 0), (y + 30, z), SIDE),
    ):  # fmt: skip
        shown = normal @ axis > 0.99
        assert shown.any()
        texels = np.stack(flat, axis=2)[shown] / TEXEL_MM + origin
        # a sheet on a fold stands off by its thickness both ways
        np.testing.assert_allclose(uv[shown] * N_PX, texels, atol=(SHEET_MM + LAYER_MM) / TEXEL_MM + 1e-3)


@pytest.mark.parametrize("place", [THREE, turn(5, (50, 20), (1.5, 0.5), 1.01), turn(-90, (50, 20))])
def test_a_mark_moves_by_the_misfit_exactly_and_beyond_the_border_in_its_plane(box, place):
    front = make_box_wrap(box, with_top=False).pieces[0]
    printed, edge = lay_piece(box, front, place)
    sheet = np.concatenate([printed.corners, edge.corners])
    wanted = np.concatenate([printed.sheet_mm, edge.sheet_mm]) @ place[:, :2].T + place[:, 2]
    np.testing.assert_allclose(sheet[..., 0] + 50, wanted[..., 0], atol=1e-4)
    np.testing.assert_allclose(sheet[..., 2], wanted[..., 1], atol=1e-4)
    np.testing.assert_allclose(sheet[..., 1], -30 - SHEET_MM, atol=1e-4)
    assert areas(sheet) == pytest.approx(front.area_mm2 * np.linalg.det(place[:, :2]), rel=1e-4), "nothing is lost"


def test_each_next_piece_lies_a_little_higher(box):
    wrap = make_box_wrap(box, with_top=False)
    mesh = wear_wrap(box, wrap, CANVAS, [IN_PLACE, IN_PLACE])
    own = mesh.vertices[np.unique(mesh.faces[mesh.face_material >= len(box.materials)])]
    assert -own[:, 1].min() - 30 == pytest.approx(SHEET_MM, abs=1e-4)
    assert own[:, 0].max() - 50 == pytest.approx(SHEET_MM + LAYER_MM, abs=1e-4)
    assert len(mesh.faces) > len(box.faces) and (mesh.vertices[: len(box.vertices)] == box.vertices).all()


def test_misfits_are_drawn_for_each_piece_within_their_bounds(box):
    wrap, misfit = make_box_wrap(box), Misfit(shift_mm=2, turn_deg=3, scale=0.01)
    many = np.array([draw_places(wrap, misfit, Draws(0, step)) for step in range(300)])
    centres = np.array([[piece.width_mm / 2, piece.height_mm / 2] for piece in wrap.pieces])
    shift = np.einsum("spij,pj->spi", many[..., :2], centres) + many[..., 2] - centres
    scale = np.sqrt(np.linalg.det(many[..., :2]))
    angle = np.degrees(np.arctan2(many[..., 1, 0], many[..., 0, 0]))
    for values, most in ((shift, 2), (angle, 3), (scale - 1, 0.01)):
        assert 0.95 * most < np.abs(values).max() <= most + 1e-9
        assert np.abs(values.mean()) < 0.1 * most
    assert not np.allclose(shift[:, 0], shift[:, 1]), "each piece has its own"
    np.testing.assert_array_equal(draw_places(wrap, misfit, Draws(0, 7)), many[7])
    assert draw_places(wrap, None, Draws(0, 7)) == [IN_PLACE, IN_PLACE]
