"""Pieces that lie flat, against closed forms: boxes, cylinders and cones unroll whole, a sphere does not."""

import numpy as np
import pytest
import shapely
import trimesh

from toolkit.objects.mesh import Material, Mesh, cross_products, flat_areas, mesh_from_corners
from toolkit.rooms.wraps.cutting.flatten import Region, join_edges, weld_surface
from toolkit.rooms.wraps.cutting.grow import MANY, find_pieces
from toolkit.rooms.wraps.cutting.seams import find_folds, find_seams
from toolkit.rooms.wraps.cutting.trim import Limits, even_border
from toolkit.rooms.wraps.wrap import FlatPiece

A4 = (190.0, 277.0)
GREY = Material("grey", np.full((4, 4, 3), 128, np.uint8))


def make_mesh(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
    return mesh_from_corners(
        np.asarray(vertices, float), np.asarray(faces), np.zeros((len(faces), 3, 2)), np.zeros(len(faces)), (GREY,)
    )


def box(*size: float) -> Mesh:
    made = trimesh.creation.box(size)
    return make_mesh(made.vertices, made.faces)


def pipe(radius: float, height: float, sides: int) -> Mesh:
    """The side of a cylinder."""
    return sector_mesh(radius, radius, height, sides)


def sector_mesh(low: float, high: float, height: float, sides: int) -> Mesh:
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    vertices = np.concatenate([low * ring, high * ring + [0, 0, height]])
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = np.concatenate([np.stack([i, j, sides + j], 1), np.stack([i, sides + j, sides + i], 1)])
    return make_mesh(vertices, faces)


def cone(radius: float, height: float, sides: int) -> Mesh:
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    i = np.arange(sides)
    faces = np.stack([i, (i + 1) % sides, np.full(sides, sides)], axis=1)
    return make_mesh(np.concatenate([ring, [[0, 0, height]]]), faces)


def sphere(radius: float) -> Mesh:
    made = trimesh.creation.icosphere(3, radius)
    return make_mesh(made.vertices, made.faces)


def areas(mesh: Mesh) -> np.ndarray:
    return np.linalg.norm(cross_products(mesh.vertices[mesh.faces]), axis=1) / 2


def find(mesh: Mesh, stretch: float, count: int, sheet: tuple[float, float] = A4) -> list[FlatPiece]:
    found = find_pieces(mesh, areas(mesh), np.ones(len(mesh.faces), bool), Limits(stretch, sheet), count)
    check(mesh, found, stretch)
    return found


def check(mesh: Mesh, pieces: list[FlatPiece], stretch: float) -> None:
    """What holds for any pieces: the right way round, over nothing twice, as stretched as they say, each face once."""
    faces = np.concatenate([piece.faces for piece in pieces])
    assert len(np.unique(faces)) == len(faces)
    for piece in pieces:
        assert piece.flat_mm.min() >= 0 and piece.flat_mm.reshape(-1, 2).min(axis=0) == pytest.approx([0, 0], abs=1e-9)
        a, b, c = np.moveaxis(piece.flat_mm, 1, 0)
        assert (np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(c - a, ((0, 0), (0, 1))))[:, 2] > 0).all()
        outline = piece.outline()
        assert isinstance(outline, shapely.Polygon) and outline.is_valid
        assert outline.area == pytest.approx(piece.area_mm2, rel=1e-4)  # no part lies on another
        assert piece.stretch <= stretch
        assert piece.stretch == pytest.approx(stretch_by_singular_values(mesh, piece), rel=1e-3, abs=1e-7)
        assert piece.area_mm2 == pytest.approx(areas(mesh)[piece.faces].sum(), rel=max(0.005, stretch))


def stretch_by_singular_values(mesh: Mesh, piece: FlatPiece) -> float:
    """The same figure from each triangle's two singular values and the directions that they act along."""
    solid = mesh.vertices[mesh.faces[piece.faces]].astype(float)
    edges = np.stack([solid[:, 1] - solid[:, 0], solid[:, 2] - solid[:, 0]], axis=2)
    lying = np.stack([piece.flat_mm[:, 1] - piece.flat_mm[:, 0], piece.flat_mm[:, 2] - piece.flat_mm[:, 0]], axis=2)
    _, drawn, axes = np.linalg.svd(lying @ np.linalg.pinv(edges), full_matrices=False)
    around = np.roll(solid, -1, axis=1) - solid
    along = np.einsum("kai,kei->kea", axes, around) / np.linalg.norm(around, axis=2, keepdims=True)
    change = np.abs(np.sqrt((along**2 * drawn[:, None] ** 2).sum(axis=2)) - 1).reshape(-1)
    weight = np.repeat(areas(mesh)[piece.faces], 3)
    order = np.argsort(change)
    return float(change[order][np.searchsorted(np.cumsum(weight[order]), 0.95 * weight.sum())])


def test_a_box_is_one_piece_folded_along_its_edges() -> None:
    mesh = box(60, 40, 30)
    [piece] = find(mesh, 0.01, 12)
    assert len(piece.faces) == 12 and piece.stretch < 1e-6
    assert piece.area_mm2 == pytest.approx(2 * (60 * 40 + 40 * 30 + 60 * 30), rel=1e-6)
    folds, valleys = find_folds(weld_surface(mesh), piece)
    assert valleys == []
    assert len(folds) == 5  # a tree of six sides
    lengths = np.linalg.norm(np.diff(np.array(folds), axis=1)[:, 0], axis=1)
    assert all(min(abs(length - side) for side in (60, 40, 30)) < 1e-3 for length in lengths)


def test_what_no_camera_sees_is_left_off() -> None:
    mesh = box(60, 40, 30)
    value = np.where((mesh.vertices[mesh.faces][..., 2] == mesh.vertices[:, 2].min()).all(axis=1), 0, areas(mesh))
    [piece] = find_pieces(mesh, value, np.ones(12, bool), Limits(0.01, A4), 12)
    check(mesh, [piece], 0.01)
    assert sorted(piece.faces) == np.flatnonzero(value).tolist()  # the ground is not printed


def test_what_holds_a_piece_together_stays_though_nobody_sees_it() -> None:
    mesh = pipe(20, 60, 48)  # its front and back are seen, its sides are not
    side = np.abs(mesh.vertices[mesh.faces].mean(axis=1)[:, 1]) > 14
    value = np.where(side, 0, areas(mesh))
    [piece] = find_pieces(mesh, value, np.ones(len(mesh.faces), bool), Limits(0.001, A4), 12)
    check(mesh, [piece], 0.001)
    assert np.isin(np.flatnonzero(~side), piece.faces).all() and side[piece.faces].any()


def test_a_cylinder_unrolls_to_a_rectangle_with_one_seam() -> None:
    mesh, width = pipe(20, 60, 48), 2 * 48 * 20 * np.sin(np.pi / 48)
    [piece] = find(mesh, 0.001, 12)
    low, high = sorted((piece.width_mm, piece.height_mm))  # the seam may run along the diagonals of the sides
    assert low == pytest.approx(60, rel=1e-5) and width <= high + 1e-6 <= width + 2 * 20 * np.sin(np.pi / 48) + 1e-5
    assert piece.area_mm2 == pytest.approx(60 * width, rel=1e-5)
    [[one, two]] = find_seams(weld_surface(mesh), [piece])
    assert one.letter == two.letter == "A" and one.piece == two.piece == 1
    assert np.linalg.norm(np.subtract(one.from_mm, one.to_mm)) == pytest.approx(60, abs=0.1)
    assert np.linalg.norm(np.subtract(one.middle_mm, two.middle_mm)) == pytest.approx(width, rel=1e-4)


def test_a_cylinder_larger_than_the_sheet_is_several_pieces() -> None:
    mesh = pipe(50, 100, 64)
    pieces = find(mesh, 0.001, 12, sheet=(120, 150))
    assert len(pieces) > 1
    assert all(min(p.width_mm, p.height_mm) <= 120 and max(p.width_mm, p.height_mm) <= 150 for p in pieces)
    assert sum(p.area_mm2 for p in pieces) > 0.95 * areas(mesh).sum()
    letters = [seam.letter for seams in find_seams(weld_surface(mesh), pieces) for seam in seams]
    assert all(letters.count(letter) == 2 for letter in letters)


def test_a_cone_unrolls_to_a_sector() -> None:
    radius, height, sides = 30.0, 60.0, 64
    slant = np.hypot(radius, height)
    mesh = cone(radius, height, sides)
    [piece] = find(mesh, 0.001, 12)
    apex = np.flatnonzero((mesh.vertices[mesh.faces[piece.faces]][..., 2] > height - 1e-3).reshape(-1))
    tips = piece.flat_mm.reshape(-1, 2)[apex]
    assert np.ptp(tips, axis=0).max() < 1e-6
    step = 2 * np.arcsin(radius * np.sin(np.pi / sides) / slant)  # of one triangle at the apex
    assert piece.area_mm2 == pytest.approx(sides * slant**2 * np.sin(step) / 2, rel=1e-5)
    rim = np.delete(piece.flat_mm.reshape(-1, 2), apex, axis=0) - tips[0]
    assert np.linalg.norm(rim, axis=1) == pytest.approx(slant, rel=1e-5)
    turns = np.sort(np.unique(np.round(np.arctan2(rim[:, 1], rim[:, 0]), 6)))
    gap = np.diff(turns, append=turns[0] + 2 * np.pi).max()
    assert 2 * np.pi - gap == pytest.approx(sides * step, abs=1e-3)  # 2 π r / slant of the smooth cone


def test_a_sphere_does_not_lie_flat_but_is_cut_into_parts() -> None:
    mesh = sphere(50)
    whole = areas(mesh).sum()
    assert find(mesh, 0.01, 1)[0].area_mm2 < 0.5 * whole  # petals round a middle, not the whole
    parts = find(mesh, 0.03, 12)
    assert 0.7 * whole < sum(p.area_mm2 for p in parts) <= 1.03 * whole
    assert len(parts) > 1  # gores that hang together in a star, and what is between them


def test_a_stiff_sheet_finds_nothing_on_a_sphere() -> None:
    mesh = sphere(20)
    assert find_pieces(mesh, areas(mesh), np.ones(len(mesh.faces), bool), Limits(0.001, A4), 12) == []


@pytest.mark.parametrize("kind", ["one triangle", "doubled", "three at an edge", "soup", "crossing"])
def test_odd_meshes_give_what_can_be_done(kind: str) -> None:
    one = np.array([[0, 0, 0], [40, 0, 0], [0, 40, 0]], float)
    if kind == "one triangle":
        mesh = make_mesh(one, [[0, 1, 2]])
    elif kind == "doubled":  # both sides of a sheet
        mesh = make_mesh(one, [[0, 1, 2], [0, 2, 1]])
    elif kind == "three at an edge":
        vertices = np.concatenate([one, [[0, 0, 40], [0, -40, 0]]])
        mesh = make_mesh(vertices, [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    elif kind == "soup":
        made = trimesh.creation.box((60, 40, 30))
        mesh = make_mesh(made.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3))
    else:
        made = trimesh.util.concatenate([trimesh.creation.box((60, 40, 30)), trimesh.creation.box((30, 60, 40))])
        mesh = make_mesh(made.vertices, made.faces)
    pieces = find(mesh, 0.01, 12)
    assert sum(p.area_mm2 for p in pieces) == pytest.approx(areas(mesh).sum(), rel=1e-5)


def test_faces_without_value_or_out_of_reach_are_left_out() -> None:
    mesh = box(60, 40, 30)
    top = mesh.vertices[mesh.faces][..., 2].min(axis=1) > 14
    pieces = find_pieces(mesh, areas(mesh), top, Limits(0.01, A4), 12)
    assert sorted(np.concatenate([p.faces for p in pieces]).tolist()) == np.flatnonzero(top).tolist()
    assert find_pieces(mesh, 0 * areas(mesh), top, Limits(0.01, A4), 12) == []
    assert flat_areas(pieces[0].flat_mm).sum() == pytest.approx(60 * 40)


@pytest.mark.slow
def test_many_triangles_give_the_piece_that_few_give() -> None:
    few = pipe(20, 60, 28)
    vertices, faces = few.vertices, few.faces
    for _ in range(4):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    mesh = make_mesh(vertices, faces)
    assert len(faces) > MANY
    pieces = find(mesh, 0.01, 2)
    assert pieces[0].area_mm2 > 0.95 * areas(few).sum()


def test_a_box_larger_than_the_sheet_is_cut_at_its_edges() -> None:
    mesh = box(120, 200, 90)  # of triangles that nearly fill the sheet: two of them only just lie on it
    pieces = find(mesh, 0.03, 12, sheet=(177.0, 241.0))
    assert sum(piece.area_mm2 for piece in pieces) == pytest.approx(areas(mesh).sum(), rel=1e-6)
    assert all(min(p.width_mm, p.height_mm) <= 177 and max(p.width_mm, p.height_mm) <= 241 for p in pieces)
    assert len(pieces) <= 6


def test_teeth_and_notches_of_an_edge_are_evened_out() -> None:
    """A level grid of 5 mm, cut across its triangles at a slope: the edge is a saw."""
    x, y = np.meshgrid(np.arange(33), np.arange(33), indexing="ij")
    corner = (33 * x + y)[:-1, :-1].reshape(-1)
    faces = np.concatenate([[[a, a + 33, a + 34], [a, a + 34, a + 1]] for a in corner])
    mesh = make_mesh(np.stack([5.0 * x, 5.0 * y, 0.0 * x], axis=-1).reshape(-1, 3), faces)
    surface = weld_surface(mesh)
    middle = surface.corners.mean(axis=1)
    rows = np.flatnonzero(middle[:, 1] + 0.2 * middle[:, 0] < 100)
    ragged = join_edges(surface, Region(rows, surface.corners[rows][..., :2], np.zeros((len(rows), 3), bool)), 0.0)
    even = even_border(surface, ragged, np.ones(len(faces), bool))
    before, after = (shapely.union_all(shapely.polygons(np.round(one.flat, 6))) for one in (ragged, even))
    assert after.geom_type == "Polygon" and after.is_valid
    assert after.area == pytest.approx(before.area, rel=0.02)
    assert before.length > 560 and after.length == pytest.approx(520)  # of steps along the grid alone
    # what it may not have, it does not take
    assert set(even_border(surface, ragged, np.isin(np.arange(len(faces)), rows)).faces) <= set(rows)
