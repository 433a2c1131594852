"""Paper models: refolded along their folds they are the mesh again, all of it, and nothing lies on anything."""

import numpy as np
import pytest
import shapely
import trimesh

from tests.rooms.wraps.test_wrap_pieces import A4, areas, box, check, cone, make_mesh
from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import Mesh
from toolkit.rooms.wraps.cutting.flatten import weld_surface
from toolkit.rooms.wraps.cutting.net import find_tabs, unfold
from toolkit.rooms.wraps.cutting.seams import find_folds
from toolkit.rooms.wraps.wrap import FlatPiece


def step() -> Mesh:
    """An L, which has one valley."""
    profile = np.array([(0, 0), (60, 0), (60, 20), (25, 20), (25, 50), (0, 50)], float)
    vertices = np.concatenate([np.pad(profile, ((0, 0), (0, 1)), constant_values=z) for z in (0, 30)])
    cap = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)])
    i, j = np.arange(6), (np.arange(6) + 1) % 6
    sides = [np.stack([i, j, 6 + j], axis=1), np.stack([i, 6 + j, 6 + i], axis=1)]
    return make_mesh(vertices, np.concatenate([cap[:, ::-1], 6 + cap, *sides]))


def ball() -> Mesh:
    made = trimesh.creation.icosphere(1, 40)
    return make_mesh(made.vertices, made.faces)


def refold(mesh: Mesh, piece: FlatPiece) -> np.ndarray:
    """(k, 3, 3) where corners come to lie: the first face is laid on the mesh, then edge after edge is bent.

    Which edges hold is taken from the flat piece alone, by how much they bend from trimesh.
    """
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    solid.merge_vertices(merge_tex=True, merge_norm=True)
    signs = np.where(solid.face_adjacency_convex, -1.0, 1.0)
    bend = dict(
        zip(
            map(tuple, np.sort(solid.face_adjacency, axis=1).tolist()), signs * solid.face_adjacency_angles, strict=True
        )
    )
    flat = np.pad(piece.flat_mm, ((0, 0), (0, 0), (0, 1)))
    own = np.round(piece.flat_mm, 5)
    sides = {(tuple(own[i, e]), tuple(own[i, (e + 1) % 3])): (i, e) for i in range(len(own)) for e in range(3)}
    # where face i goes: x ↦ x @ turn + shift
    first = mesh.vertices[mesh.faces[piece.faces[0]]].astype(float)
    frames = [np.stack([p[1] - p[0], p[2] - p[0], np.cross(p[1] - p[0], p[2] - p[0])]) for p in (flat[0], first)]
    turn = np.linalg.solve(*frames)
    place = {0: (turn, first[0] - flat[0, 0] @ turn)}
    queue = [0]
    while queue:
        i = queue.pop()
        for e in range(3):
            j, _ = sides.get((tuple(own[i, (e + 1) % 3]), tuple(own[i, e])), (i, 0))
            one, two = sorted((int(piece.faces[i]), int(piece.faces[j])))
            if j in place or (one, two) not in bend:
                continue
            axis = flat[i, e] - flat[i, (e + 1) % 3]
            about = trimesh.transformations.rotation_matrix(bend[one, two], axis, flat[i, e])
            turn, shift = place[i]
            place[j] = about[:3, :3].T @ turn, about[:3, 3] @ turn + shift
            queue.append(j)
    assert len(place) == len(piece.faces)
    return np.stack([flat[i] @ place[i][0] + place[i][1] for i in range(len(flat))])


@pytest.mark.parametrize("make", [lambda: box(60, 40, 30), step, ball, lambda: cone(30, 60, 24)])
def test_a_net_folds_up_to_the_mesh(make) -> None:
    mesh = make()
    pieces = unfold(weld_surface(mesh), A4)
    check(mesh, pieces, 1e-6)
    assert sum(piece.area_mm2 for piece in pieces) == pytest.approx(areas(mesh).sum(), rel=1e-6)
    for piece in pieces:
        solid = mesh.vertices[mesh.faces[piece.faces]]
        assert np.abs(refold(mesh, piece) - solid).max() < 0.1


def test_a_step_has_one_valley_and_mountains() -> None:
    mesh = step()
    surface, pieces = weld_surface(mesh), unfold(weld_surface(mesh), A4)
    found = [find_folds(surface, piece, 1.0) for piece in pieces]
    valleys = [line for _, lines in found for line in lines]
    assert [np.linalg.norm(np.subtract(*line)) for line in valleys] == pytest.approx([30] * len(valleys))
    assert len(valleys) <= 1 and sum(len(folds) for folds, _ in found) >= 5


def test_each_edge_that_is_glued_has_one_tab_that_lies_on_nothing() -> None:
    mesh = box(60, 40, 30)
    surface = weld_surface(mesh)
    pieces = unfold(surface, A4)
    tabs, missed = find_tabs(surface, pieces)
    assert len(pieces) == 1 and len(tabs) == 7 and missed == 0  # 12 edges, of which a tree of six sides folds 5
    outline = pieces[0].outline()
    outlines = [shapely.Polygon(tab.outline) for tab in tabs]
    for k, one in enumerate(outlines):
        assert one.is_valid and one.area > 0
        assert one.intersection(outline).area < 1e-3
        assert all(one.intersection(other).area < 1e-3 for other in outlines[:k])
        assert shapely.LineString(tabs[k].outline[:2]).distance(outline.exterior) < 1e-6


def test_a_net_larger_than_the_sheet_is_several() -> None:
    mesh = box(60, 40, 30)
    pieces = unfold(weld_surface(mesh), (100, 100))
    assert len(pieces) > 1
    assert all(max(piece.width_mm, piece.height_mm) <= 86 for piece in pieces)
    assert sum(piece.area_mm2 for piece in pieces) == pytest.approx(areas(mesh).sum())


def test_too_many_triangles_are_refused_in_one_line() -> None:
    made = trimesh.creation.icosphere(4, 40)
    with pytest.raises(ToolkitError, match="5,120 triangles cannot be folded"):
        unfold(weld_surface(make_mesh(made.vertices, made.faces)), A4)
