"""New texture coordinates: apart, at one scale, the same each time, and quick for fine meshes."""

import numpy as np
import pytest
import trimesh

from toolkit.objects.unwrap import unwrap

SHAPES = {
    "box": lambda: trimesh.creation.box((1, 2, 3)),
    "sphere": lambda: trimesh.creation.icosphere(3),
    "torus": lambda: trimesh.creation.torus(1, 0.4, major_sections=48, minor_sections=24),
    "cylinder": lambda: trimesh.creation.cylinder(1, 3, sections=48),
    "cone": lambda: trimesh.creation.cone(1, 2),
    "one triangle": lambda: trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
}


def areas(corners: np.ndarray) -> np.ndarray:
    padded = np.zeros((*corners.shape[:2], 3))
    padded[..., : corners.shape[2]] = corners
    return np.linalg.norm(np.cross(padded[:, 1] - padded[:, 0], padded[:, 2] - padded[:, 0]), axis=1) / 2


def layers(corner_uv: np.ndarray, count: int = 40_000) -> np.ndarray:
    """How many triangles lie over random places of the texture, counted by rays."""
    import open3d as o3d

    m = len(corner_uv)
    height = np.repeat(np.linspace(0, 0.5, m), 3)  # Open3D counts hits at one distance once
    corners = np.column_stack([corner_uv.reshape(-1, 2), height]).astype(np.float32)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(corners), o3d.core.Tensor(np.arange(3 * m, dtype=np.uint32).reshape(-1, 3)))
    rays = np.zeros((count, 6), np.float32)
    rays[:, :2], rays[:, 2], rays[:, 5] = np.random.default_rng(0).random((count, 2)), 1, -1
    return scene.count_intersections(o3d.core.Tensor(rays)).numpy()


@pytest.mark.parametrize("name", SHAPES)
def test_triangles_lie_apart_and_at_one_scale(name):
    shape = SHAPES[name]()
    uv = unwrap(shape.vertices.astype(np.float32), shape.faces, 200)
    assert uv.shape == (len(shape.faces), 3, 2) and uv.min() >= 0 and uv.max() <= 1
    over = layers(uv)
    assert (over > 1).mean() < 1e-3
    scale = areas(uv) / areas(shape.triangles)
    assert (
        scale.min() > 0 and scale.max() / scale.min() < 2.3
    )  # seen along a direction up to 54.7° away: 1 / cos = 1.73
    assert areas(uv).sum() > 0.2


def test_charts_are_two_texels_apart():
    from scipy.ndimage import label

    from toolkit.objects.atlas import cover_texels

    shape, n = trimesh.creation.box((1, 2, 3)), 64
    uv = unwrap(shape.vertices.astype(np.float32), shape.faces, n)
    side = np.unique(np.round(shape.face_normals), axis=0, return_inverse=True)[1].reshape(-1)
    covered = [cover_texels(uv[side == i], n) for i in range(6)]
    assert label(np.any(covered, axis=0), np.ones((3, 3)))[1] == 6
    for i, one in enumerate(covered):
        for other in covered[:i]:
            apart = np.abs(np.argwhere(one)[:, None] - np.argwhere(other)).max(axis=2).min()
            assert apart >= 3  # two texels between


def test_twice_is_the_same():
    shape = SHAPES["torus"]()
    first, second = (unwrap(shape.vertices.astype(np.float32), shape.faces, 128) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_corners_that_meet_on_the_mesh_meet_on_the_texture_but_at_seams():
    shape = SHAPES["sphere"]()
    uv = unwrap(shape.vertices.astype(np.float32), shape.faces, 128)
    split = {(v, *c) for v, c in zip(shape.faces.reshape(-1), uv.reshape(-1, 2).tolist(), strict=True)}
    assert len(split) < 1.35 * len(shape.vertices)  # 3 · m / n = 6 if nothing held together


@pytest.mark.slow
def test_a_finely_tessellated_sphere_is_no_plane():
    """Of these 80 000 faces xatlas' own segmentation makes one chart, and the process dies."""
    shape = trimesh.creation.icosphere(6)
    uv = unwrap(shape.vertices.astype(np.float32), shape.faces, 256)
    scale = areas(uv) / areas(shape.triangles)
    assert scale.max() / scale.min() < 2.3
    assert (layers(uv) > 1).mean() < 1e-3


def test_a_ramp_that_winds_over_itself_is_cut():
    t = np.linspace(0, 6 * np.pi, 300)
    rails = [np.stack([r * np.cos(t), r * np.sin(t), 0.08 * t], axis=1) for r in (0.5, 1.0)]
    vertices = np.stack(rails, axis=1).reshape(-1, 3).astype(np.float32)
    i = np.arange(299) * 2
    faces = np.concatenate([np.stack([i, i + 1, i + 3], 1), np.stack([i, i + 3, i + 2], 1)])
    over = layers(unwrap(vertices, faces, 200))
    assert (over > 1).sum() < 0.03 * (over > 0).sum()


def test_many_more_pieces_than_texels_still_get_a_place():
    rng = np.random.default_rng(0)
    corners = rng.random((300, 1, 3)) + 0.05 * rng.random((300, 3, 3))
    uv = unwrap(corners.reshape(-1, 3).astype(np.float32), np.arange(900).reshape(-1, 3), 12)
    assert uv.min() >= 0 and uv.max() <= 1 and (areas(uv) > 0).all()


def test_faces_without_area_do_no_harm():
    shape = trimesh.creation.box((1, 1, 1))
    faces = np.concatenate([shape.faces, [[0, 0, 1], [2, 2, 2]]])
    uv = unwrap(shape.vertices.astype(np.float32), faces, 64)
    assert np.isfinite(uv).all() and (areas(uv)[:12] > 0).all()


def test_without_xatlas_it_says_so(monkeypatch):
    import sys

    from toolkit.core.errors import ToolkitError

    monkeypatch.setitem(sys.modules, "xatlas", None)
    shape = trimesh.creation.box((1, 1, 1))
    with pytest.raises(ToolkitError, match="pip install xatlas"):
        unwrap(shape.vertices.astype(np.float32), shape.faces, 64)


def test_threads_of_xatlas_that_never_end_keep_nobody_waiting(monkeypatch, tmp_path):
    (tmp_path / "xatlas.py").write_text(
        "import time, types\n"
        "PackOptions = types.SimpleNamespace\n"
        "class Atlas:\n"
        "    width = height = 8\n"
        "    def add_uv_mesh(self, uv, faces, chart): self.uv = uv\n"
        "    def generate(self, pack_options): pass\n"
        "    def get_mesh(self, index): return range(len(self.uv)), None, self.uv * 0\n"
        "    def __del__(self): time.sleep(3600)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    shape = trimesh.creation.box((1, 1, 1))
    assert not unwrap(shape.vertices.astype(np.float32), shape.faces, 64).any()


def test_what_xatlas_cannot_pack_is_said(monkeypatch, tmp_path):
    from toolkit.core.errors import ToolkitError

    (tmp_path / "xatlas.py").write_text("def Atlas(): raise RuntimeError('no room')\n")
    monkeypatch.syspath_prepend(tmp_path)
    shape = trimesh.creation.box((1, 1, 1))
    with pytest.raises(ToolkitError, match="texture coordinates for this mesh: RuntimeError: no room"):
        unwrap(shape.vertices.astype(np.float32), shape.faces, 64)
