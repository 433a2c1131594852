"""The built-in warplane: a sound mesh that stands on its wheels, with a free place for a sheet on top."""

from pathlib import Path

import numpy as np
import pytest

import toolkit
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.mesh import Mesh, place_on_table
from toolkit.objects.records import TAPE_MARGIN_MM
from toolkit.rooms.worlds.content.warplane import build

SPEC = Path(toolkit.__file__).parent / "data" / "objects" / "warplane.toml"


@pytest.fixture(scope="module")
def plane() -> Mesh:
    return build()


@pytest.fixture(scope="module")
def on_table() -> TableObject:
    return load_object(SPEC)


@pytest.mark.slow
def test_it_is_finite_and_of_moderate_size(plane):
    assert 10_000 <= len(plane.faces) <= 60_000
    for values in (plane.vertices, plane.normals, plane.uv):
        assert np.isfinite(values).all()
    np.testing.assert_allclose(np.linalg.norm(plane.normals, axis=1), 1, atol=1e-4)
    assert 265 < plane.size_mm[0] < 275
    assert plane.size_mm.argmax() == 0


def test_left_and_right_reach_equally_far(plane):
    low, high = plane.bounds[:, 1]
    assert high == pytest.approx(-low, abs=0.01)


def test_the_skin_faces_outwards(plane):
    import open3d as o3d

    corners = plane.vertices[plane.faces].astype(float)
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume > 100_000  # mm³: at least a fuselage of 30 × 25 × 130

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(np.ascontiguousarray(plane.vertices)), o3d.core.Tensor(plane.faces.astype(np.uint32))
    )
    rng = np.random.default_rng(0)
    origins = rng.normal(size=(20_000, 3))
    origins *= 500 / np.linalg.norm(origins, axis=1, keepdims=True)
    targets = plane.vertices[rng.integers(len(plane.vertices), size=len(origins))] + rng.normal(size=origins.shape)
    rays = np.concatenate([origins, targets - origins], axis=1).astype(np.float32)
    hits = scene.cast_rays(o3d.core.Tensor(rays))
    met = np.isfinite(hits["t_hit"].numpy())
    seen_from_behind = (hits["primitive_normals"].numpy()[met] * rays[met, 3:]).sum(axis=1) > 0
    assert met.sum() > 10_000
    assert seen_from_behind.mean() < 0.001


def test_every_spot_of_the_atlas_belongs_to_one_triangle(plane):
    assert plane.uv.min() >= 0
    assert plane.uv.max() <= 1
    corners = plane.uv[plane.faces].astype(float)
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    real = np.abs(area) > 1e-12
    assert real.mean() > 0.99
    rng = np.random.default_rng(1)
    weights = rng.dirichlet(np.ones(3), size=500) * 0.9 + 0.1 / 3  # away from the edges
    spots = np.einsum("nk,nkd->nd", weights, corners[rng.choice(np.flatnonzero(real), 500, replace=False)])
    a, ab, ac, area = a[real], ab[real], ac[real], area[real]
    for spot in spots:
        along = spot - a
        first = (along[:, 0] * ac[:, 1] - along[:, 1] * ac[:, 0]) / area
        second = (ab[:, 0] * along[:, 1] - ab[:, 1] * along[:, 0]) / area
        assert ((first > 1e-3) & (second > 1e-3) & (first + second < 1 - 1e-3)).sum() == 1


def test_it_stands_on_three_wheels(plane):
    placed = place_on_table(plane, 270)
    low = placed.vertices[placed.vertices[:, 2] < 0.05]
    nose, left, right = (
        low[low[:, 0] > 40],
        low[(low[:, 0] < 0) & (low[:, 1] > 5)],
        low[(low[:, 0] < 0) & (low[:, 1] < -5)],
    )
    assert len(nose) and len(left) and len(right)
    assert len(nose) + len(left) + len(right) == len(low)
    assert [placed.materials[i].name for i in set(_materials_below(placed, 0.05))] == ["rubber"]
    # what stands on three points must have its middle over their triangle
    feet = np.stack([nose.mean(axis=0), left.mean(axis=0), right.mean(axis=0)])[:, :2]
    solved = np.linalg.solve(np.vstack([feet.T, np.ones(3)]), [*_centre_of_volume(placed)[:2], 1])
    assert (solved > 0).all()


def test_the_sheet_lies_free_between_canopy_and_fins(on_table):
    mount = on_table.spec.mounts[0]
    assert mount.at == "top"
    half = 88 / 2 + TAPE_MARGIN_MM
    vertices = on_table.mesh.vertices
    below = vertices[(np.abs(vertices[:, :2] - mount.offset_mm) < half).all(axis=1)]
    spine = below[np.abs(below[:, 1]) < 5, 2].max()
    assert below[:, 2].max() - spine < 1
    fins_and_canopy = vertices[vertices[:, 2] > spine + 5]
    assert (fins_and_canopy[:, 0] < mount.offset_mm[0] - half).any()
    assert (fins_and_canopy[:, 0] > mount.offset_mm[0] + half).any()


def _materials_below(mesh: Mesh, height_mm: float) -> list[int]:
    return mesh.face_material[(mesh.vertices[mesh.faces][..., 2] < height_mm).any(axis=1)].tolist()


def _centre_of_volume(mesh: Mesh) -> np.ndarray:
    corners = mesh.vertices[mesh.faces].astype(float)
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return (corners.sum(axis=1) / 4 * volume[:, None]).sum(axis=0) / volume.sum()
