"""Everyday objects: each kind gives sound, light, textured meshes, the same for the same seed and others for others."""

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.objects.load import BUILTIN, build_mesh
from toolkit.objects.mesh import place_on_table
from toolkit.rooms.worlds.content.drawing import Rng
from toolkit.rooms.worlds.content.everyday import MAKERS, make_everyday, vary_shipped

SEEDS = (0, 1, 2, 3)
OWN = {"chair", "dice", "traffic cone"}
"""Labels that ImageNet does not have."""
kinds = pytest.mark.parametrize("label", list(MAKERS))


@pytest.fixture(scope="module")
def made():
    """Some instances of each kind, made once."""
    return {label: [make_everyday(label, (7, seed)) for seed in SEEDS] for label in MAKERS}


def _bytes(mesh):
    arrays = (mesh.vertices, mesh.normals, mesh.uv, mesh.faces, mesh.face_material)
    return b"".join([*(a.tobytes() for a in arrays), *(m.texture.tobytes() for m in mesh.materials)])


@pytest.mark.slow
@kinds
def test_seed_decides(label, made):
    assert _bytes(make_everyday(label, (7, SEEDS[1]))) == _bytes(made[label][1])
    assert len({_bytes(mesh) for mesh in made[label]}) == len(SEEDS)


@kinds
def test_on_the_table_and_of_one_length(label, made):
    for mesh in made[label]:
        low, high = mesh.bounds
        assert mesh.size_mm.max() == pytest.approx(270, abs=0.01)
        assert low[2] == pytest.approx(0, abs=0.01)
        np.testing.assert_allclose((low + high)[:2], 0, atol=0.01)
        assert mesh.size_mm.min() > 5  # nothing is flat


@kinds
def test_numbers_are_sound_and_few(label, made):
    for mesh in made[label]:
        for values in (mesh.vertices, mesh.normals, mesh.uv):
            assert np.isfinite(values).all() and values.dtype == np.float32
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-3)
        assert mesh.uv.min() >= 0 and mesh.uv.max() <= 1
        assert mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)
        assert mesh.face_material.max() < len(mesh.materials)
        assert 50 < len(mesh.faces) < (70_000 if label in BUILTIN else 8_000)


@kinds
def test_whatever_a_camera_sees_faces_it(label, made):
    """Rays at the object from all around meet triangles, and shading normals, from their outside."""
    o3d = pytest.importorskip("open3d")
    rng = np.random.default_rng(0)
    for mesh in made[label]:
        from_where = rng.normal(size=(3000, 3)) * [1, 1, 0.7]
        from_where[:, 2] = np.abs(from_where[:, 2])  # no camera looks up from below the table
        from_where *= 600 / np.linalg.norm(from_where, axis=1, keepdims=True)
        towards = rng.uniform(*mesh.bounds, (3000, 3)) - from_where
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        scene = o3d.t.geometry.RaycastingScene()
        scene.add_triangles(o3d.core.Tensor(mesh.vertices), o3d.core.Tensor(mesh.faces.astype(np.uint32)))
        found = scene.cast_rays(o3d.core.Tensor(np.concatenate([from_where, towards], 1).astype(np.float32)))
        hit = np.isfinite(found["t_hit"].numpy())
        assert hit.sum() > 100
        triangle = mesh.faces[found["primitive_ids"].numpy()[hit].astype(np.int64)]
        a, b, c = np.moveaxis(mesh.vertices[triangle].astype(np.float64), 1, 0)
        outside = np.einsum("ij,ij->i", np.cross(b - a, c - a), towards[hit]) < 0
        assert outside.mean() > 0.985
        shading = mesh.normals[triangle].sum(axis=1)
        assert (np.einsum("ij,ij->i", shading, towards[hit]) < 0).mean() > 0.93


@kinds
def test_instances_differ_in_shape_and_colour(label, made):
    shapes = np.array([mesh.size_mm / 270 for mesh in made[label]])
    colours = np.array(
        [np.concatenate([m.texture.reshape(-1, 3) for m in mesh.materials]).mean(0) for mesh in made[label]]
    )
    assert np.ptp(colours, axis=0).max() > 4
    assert np.ptp(shapes, axis=0).max() > 0.02 or label == "soccer ball"


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILTIN)
def test_shipped_objects_never_come_as_they_are(name):
    shipped = place_on_table(build_mesh(name), 270)
    for seed in SEEDS[:3]:
        varied = vary_shipped(name, Rng(seed))
        assert varied.vertices.shape == shipped.vertices.shape
        assert np.abs(varied.vertices - shipped.vertices).max() > 2  # mm
        change = varied.materials[0].texture.astype(int).mean((0, 1)) - shipped.materials[0].texture.mean((0, 1))
        assert np.abs(change).max() > 2
    sizes = [len(make_everyday(name, seed).faces) for seed in range(16)]
    assert sum(size != len(shipped.faces) for size in sizes) >= 8
    assert len(set(sizes)) >= 4  # several builds of the kind


def test_thirty_six_labels_spelled_as_imagenet_has_them():
    published = pytest.importorskip("torchvision.models._meta")._IMAGENET_CATEGORIES
    assert len(MAKERS) == 36 and set(BUILTIN) <= set(MAKERS)
    assert set(MAKERS) - set(published) == OWN


def test_unknown_label_names_the_nearest():
    with pytest.raises(ToolkitError, match="no everyday object called 'tea pot': did you mean teapot"):
        make_everyday("tea pot", 0)
