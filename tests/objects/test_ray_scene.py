"""Answers of Open3D's ray scene, the same from every version that pyproject.toml allows."""

import numpy as np
import pytest
import trimesh

from toolkit.objects.mesh import Material, Mesh, load_open3d, make_ray_scene

TOLERANCE = 1e-3  # mm: Embree works in float32, the mesh is 100 mm wide


@pytest.fixture(scope="module")
def shape():
    """A ball inside a ring, so that some rays meet several surfaces."""
    parts = [trimesh.creation.icosphere(2, 20), trimesh.creation.torus(40, 10, major_sections=24, minor_sections=12)]
    return trimesh.util.concatenate(parts)


@pytest.fixture(scope="module")
def scene(shape):
    vertices, faces = np.asarray(shape.vertices, np.float32), np.asarray(shape.faces, np.int32)
    material = Material("plain", np.zeros((4, 4, 3), np.uint8), 0.9)
    return make_ray_scene(Mesh(vertices, vertices, vertices[:, :2], faces, np.zeros(len(faces), np.int32), (material,)))


@pytest.fixture(scope="module")
def rays():
    """(2000, 6) from a sphere around the shape to places in it; directions have length 1."""
    random = np.random.default_rng(7)
    start = random.normal(size=(2000, 3))
    start *= 120 / np.linalg.norm(start, axis=1, keepdims=True)
    ahead = random.uniform(-45, 45, (2000, 3)) * (1, 1, 0.3) - start
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    return np.concatenate([start, ahead], axis=1).astype(np.float32)


def meet_triangles(shape, rays) -> np.ndarray:
    """(rays, triangles) float64 the way to each triangle, inf where the ray passes it (Möller and Trumbore, 1997)."""
    a, b, c = np.moveaxis(np.asarray(shape.vertices, np.float32)[shape.faces].astype(float), 1, 0)
    start, ahead = rays[:, None, :3].astype(float), rays[:, None, 3:].astype(float)
    across = np.cross(ahead, c - a)
    determinant = np.einsum("tk,rtk->rt", b - a, across)
    inverse = 1 / np.where(determinant == 0, np.inf, determinant)
    u = np.einsum("rtk,rtk->rt", start - a, across) * inverse
    beside = np.cross(start - a, b - a)
    v = np.einsum("rtk,rtk->rt", np.broadcast_to(ahead, beside.shape), beside) * inverse
    way = np.einsum("tk,rtk->rt", c - a, beside) * inverse
    return np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (way > 0) & (determinant != 0), way, np.inf)


def ask(scene, question: str, given: np.ndarray):
    return getattr(scene, question)(load_open3d().core.Tensor(given))


def test_first_hits_are_those_of_the_formula(scene, shape, rays):
    ways = meet_triangles(shape, rays)
    expected, answer = ways.min(axis=1), ask(scene, "cast_rays", rays)
    found, triangle = answer["t_hit"].numpy(), answer["primitive_ids"].numpy()
    hits = np.isfinite(expected)
    assert 500 < hits.sum() < 1900
    assert (np.isfinite(found) == hits).all()
    np.testing.assert_allclose(found[hits], expected[hits], atol=TOLERANCE)
    assert (triangle[~hits] == 0xFFFFFFFF).all()  # Open3D's mark for nothing
    # a ray through an edge may name either neighbour
    np.testing.assert_allclose(ways[hits, triangle[hits]], expected[hits], atol=TOLERANCE)
    assert (triangle[hits] == ways.argmin(axis=1)[hits]).mean() > 0.99


def test_occlusion_counts_what_is_nearer_than_the_limit(scene, shape, rays):
    way = meet_triangles(shape, rays).min(axis=1)
    for limit in (80.0, 110.0, np.inf):
        clear = np.abs(way - limit) > TOLERANCE if np.isfinite(limit) else np.ones(len(way), bool)
        found = scene.test_occlusions(load_open3d().core.Tensor(rays), 0.0, float(limit)).numpy()
        expected = way < limit
        assert expected.any() and not expected.all()
        assert (found == expected)[clear].all()


def test_all_hits_are_listed(scene, shape, rays):
    """The other methods that the package calls."""
    ways, answer = meet_triangles(shape, rays), ask(scene, "list_intersections", rays)
    count = np.diff(answer["ray_splits"].numpy())
    expected = np.isfinite(ways).sum(axis=1)
    assert expected.max() >= 4 and (count == expected).mean() > 0.99  # Embree lists an edge once or twice
    same = np.repeat(count == expected, count)
    ray = np.repeat(np.arange(len(rays)), count)[same]
    np.testing.assert_allclose(
        answer["t_hit"].numpy()[same], ways[ray, answer["primitive_ids"].numpy()[same]], atol=TOLERANCE
    )


def test_distances_are_those_to_the_surface(scene, shape):
    """Against trimesh's nearest points."""
    points = np.random.default_rng(8).uniform(-60, 60, (300, 3)).astype(np.float32)
    nearest, distance, _ = trimesh.proximity.closest_point_naive(shape, points)
    np.testing.assert_allclose(ask(scene, "compute_distance", points).numpy(), distance, atol=TOLERANCE)
    found = ask(scene, "compute_closest_points", points)["points"].numpy()
    np.testing.assert_allclose(np.linalg.norm(found - points, axis=1), distance, atol=TOLERANCE)
    assert (np.abs(found - nearest).max(axis=1) < 10 * TOLERANCE).mean() > 0.95  # two places may be as near
