"""Polygons with hollow corners, whose fan would cover what lies outside of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from toolkit.core.errors import ToolkitError
from toolkit.objects.limits import MAX_CORNERS
from toolkit.objects.load import read_mesh
from toolkit.objects.polygons import triangulate, triangulate_polygon

ELL = [(2, 1), (1, 1), (1, 2), (0, 2), (0, 0), (2, 0)]
DART = [(2, 0), (0.3, 0.3), (0, 2), (0, 0)]


def write(folder, suffix, polygons):
    """A file of polygons in the plane z = 0."""
    places = [place for polygon in polygons for place in polygon]
    rows = [f"{x} {y} 0" for x, y in places]
    faces, first = [], 0
    for polygon in polygons:
        faces.append(range(first, first + len(polygon)))
        first += len(polygon)
    path = folder / f"plate{suffix}"
    if suffix == ".obj":
        lines = [f"v {row}" for row in rows] + ["f " + " ".join(str(i + 1) for i in face) for face in faces]
    else:
        counted = [" ".join(map(str, (len(face), *face))) for face in faces]
        head = [
            "ply", "format ascii 1.0", f"element vertex {len(rows)}", *(f"property float {axis}" for axis in "xyz"),
            f"element face {len(faces)}", "property list int int vertex_indices", "end_header",
        ]  # fmt: skip
        head = head if suffix == ".ply" else ["OFF", f"{len(rows)} {len(faces)} 0"]
        lines = [*head, *rows, *counted]
    path.write_text("\n".join(lines) + "\n")
    return path


def signed_area(corners):
    a, b, c = np.moveaxis(corners, 1, 0)
    return np.cross(b - a, c - a)[:, 2] / 2


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".off"])
@pytest.mark.parametrize(("polygons", "area"), [([ELL], 3), ([DART], 0.6), ([DART, ELL[:3], ELL], 4.1)])
def test_hollow_corners_stay_hollow(tmp_path, suffix, polygons, area):
    mesh = read_mesh(write(tmp_path, suffix, polygons))
    found = signed_area(mesh.vertices[mesh.faces].astype(float))
    assert np.abs(found).sum() == pytest.approx(area, rel=1e-5)


@given(st.integers(4, 40), st.integers(0, 10_000), st.booleans())
def test_a_star_of_any_shape_is_covered_once_and_wound_as_it_was(count, seed, is_clockwise):
    rng = np.random.default_rng(seed)
    turn = np.sort(rng.uniform(0, 2 * np.pi, count))
    turn = turn if not is_clockwise else -turn
    flat = rng.uniform(0.1, 1, (count, 1)) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    places = np.column_stack([flat, np.zeros(count)]) + 5
    triangles = triangulate_polygon(places)
    x, y = flat.T
    shoelace = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
    areas = signed_area(places[triangles])
    assert len(triangles) == count - 2
    if np.diff(np.append(turn, turn[0] + 2 * np.pi * (1 - 2 * is_clockwise))).__abs__().max() < np.pi:
        assert areas.sum() == pytest.approx(shoelace, abs=1e-9)
        assert (areas * np.sign(shoelace)).min() > -1e-9


def test_triangles_and_convex_quadrilaterals_keep_their_order():
    places = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    counts = np.array([4, 3, 4])
    corner_vertex = np.array([0, 1, 2, 3, 0, 1, 2, 0, 1, 2, 3])
    found = corner_vertex[triangulate(places, corner_vertex, counts)]
    assert found.tolist() == [[0, 1, 2], [0, 1, 2], [0, 1, 2], [2, 3, 0], [2, 3, 0]]


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".off"])
def test_a_polygon_of_very_many_corners_is_one_line(tmp_path, suffix):
    turn = np.linspace(0, 2 * np.pi, MAX_CORNERS + 2)[1:]
    ring = write(tmp_path, suffix, [[(np.cos(angle), np.sin(angle)) for angle in turn]])
    with pytest.raises(ToolkitError, match=r"a face of 4,097 corners, more than 4,096: triangulate it"):
        read_mesh(ring)
