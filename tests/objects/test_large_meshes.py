"""Meshes of any size: equal rows and corner normals in time that grows with n log n, against the plain definitions."""

import time

import numpy as np
import pytest

from toolkit.objects.mesh import ORDINARY_FAN, Material, corner_normals, group_places, group_rows, mesh_from_corners

GREY = Material("grey", np.full((4, 4, 3), 128, np.uint8))
FAR = 2**62


@pytest.mark.parametrize(
    ("low", "high", "width"),
    [(0, 3, 2), (-5, 5, 6), (0, 1, 3), (-(2**40), 2**40, 3), (-FAR, FAR, 2), (-100_000, 100_000, 6)],
)
def test_equal_rows_are_those_of_numpy_in_its_order(low, high, width):
    rng = np.random.default_rng(0)
    rows = rng.integers(low, high, (500, width))[rng.integers(0, 500, 3000)]
    rows[::7, -1] = low  # equal at first, different at the end
    _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    found_first, found = group_rows(list(rows.T))
    np.testing.assert_array_equal(found_first, first)
    np.testing.assert_array_equal(found, inverse.reshape(-1))


def test_vertices_within_a_millionth_of_the_extent_are_one_place():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1e-8, 0, 0], [1, 1e-5, 0], [1, 0, 2e-7]])
    first, place = group_places(vertices)
    assert place.tolist() == [0, 1, 0, 2, 1] and first.tolist() == [0, 1, 3]


def normals_by_definition(vertices, faces, crease_deg=40.0):
    """Every corner against every other that is at its place, in plain loops."""
    triangles = vertices[faces]
    weighted = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    unit = weighted / np.linalg.norm(weighted, axis=1, keepdims=True)
    normals = np.zeros((len(faces), 3, 3))
    for f, face in enumerate(faces):
        for c, vertex in enumerate(face):
            beside = (np.linalg.norm(triangles - vertices[vertex], axis=2) < 1e-9).any(axis=1)
            beside &= unit @ unit[f] >= np.cos(np.radians(crease_deg))
            total = weighted[beside].sum(axis=0)
            normals[f, c] = total / np.linalg.norm(total)
    return normals


def make_cone(sections, height=1.0):
    """A fan of triangles round its tip, and no base."""
    angle = np.arange(sections) * 2 * np.pi / sections
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    index = np.arange(sections)
    faces = np.stack([index, (index + 1) % sections, np.full(sections, sections)], axis=1)
    return np.concatenate([ring, [[0, 0, height]]]), faces


@pytest.mark.parametrize("kind", ["soup", "crate", "ball", "cone", "torn"])
def test_corner_normals_are_those_of_their_definition(kind):
    import trimesh

    rng = np.random.default_rng(3)
    if kind == "soup":
        vertices, faces = rng.normal(size=(30, 3)), np.stack([rng.permutation(30)[:3] for _ in range(300)])
    elif kind == "cone":
        vertices, faces = make_cone(200)
    else:
        shape = trimesh.creation.box((1, 2, 3)).subdivide() if kind == "crate" else trimesh.creation.icosphere(2)
        vertices, faces = np.array(shape.vertices), np.array(shape.faces)
        if kind == "torn":  # each triangle with vertices of its own, as in an STL file
            vertices, faces = vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)
    np.testing.assert_allclose(corner_normals(vertices, faces), normals_by_definition(vertices, faces), atol=1e-9)


def test_a_huge_fan_takes_a_moment_and_has_nearly_the_normals_of_its_definition():
    """60,000 triangles round one vertex: those within 40 degrees round the tip count, in cells of 2 degrees."""
    vertices, faces = make_cone(60_000)
    assert len(faces) > ORDINARY_FAN
    start = time.process_time()
    normals = corner_normals(vertices, faces)
    assert time.process_time() - start < 5
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1, atol=1e-9)
    # the mean of directions round the slope over ±w of azimuth, where slopes w apart make the crease's angle
    radial = vertices[faces[:, 0]] + vertices[faces[:, 1]]
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    w = np.arccos(2 * np.cos(np.radians(40)) - 1)  # n·n' = (cos w + 1) / 2 for a slope of 45 degrees
    expected = radial * np.sin(w) / w + [0, 0, 1]
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(normals[:, 2], expected, atol=0.03)
    few, some = make_cone(300)
    np.testing.assert_allclose(corner_normals(few, some), normals_by_definition(few, some), atol=0.03)


def test_a_flat_or_gentle_fan_of_any_size_is_exact():
    vertices, faces = make_cone(5000, height=0.1)
    normals = corner_normals(vertices, faces)
    np.testing.assert_allclose(normals[:, 2], np.tile([0, 0, 1.0], (5000, 1)), atol=1e-9)


def test_triangles_without_area_take_the_normal_of_their_neighbours():
    """Three points in a row, at a corner of a square, and alone."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 5], [0, 0, 6], [0, 0, 7.0], [2, 0, 0]])
    normals = corner_normals(vertices, np.array([[0, 1, 2], [0, 1, 6], [3, 4, 5]]))
    np.testing.assert_allclose(normals, np.broadcast_to([0, 0, 1.0], (3, 3, 3)))


def test_time_and_result_grow_evenly_with_the_mesh():
    """Eight times as many triangles take about eight times as long, not 64 times."""
    import trimesh

    times = []
    for level in (5, 6, 7):
        ball = trimesh.creation.icosphere(level)
        vertices, faces = np.array(ball.vertices), np.array(ball.faces)
        if level == 5:  # the first call pays for what it loads
            corner_normals(vertices, faces)
        start = time.process_time()
        mesh = mesh_from_corners(vertices, faces, np.zeros((len(faces), 3, 2)), np.zeros(len(faces)), (GREY,))
        times.append(time.process_time() - start)
        assert len(mesh.vertices) == len(vertices)
        np.testing.assert_allclose(mesh.normals, mesh.vertices, atol=0.01)
    assert times[2] < 40 * times[0] + 0.2


def test_a_polygon_of_very_many_corners_in_all_directions_takes_seconds():
    """All its triangles meet at one corner; their directions are compared by cells, of which there are only so many."""
    count = 100_000
    points = np.random.default_rng(0).normal(size=(count, 3))
    faces = np.stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)], axis=1)
    started = time.process_time()
    normals = corner_normals(points, faces, crease_deg=40)
    assert time.process_time() - started < 10
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1, atol=1e-6)
