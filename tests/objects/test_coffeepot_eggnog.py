"""The coffeepot and the eggnog carton: sound meshes with sound charts, and a place for the patch on top."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from toolkit.objects.load import build_mesh, load_object
from toolkit.objects.mesh import Mesh, place_on_table

NAMES = ("coffeepot", "eggnog")


@pytest.fixture(scope="module", params=NAMES)
def mesh(request: pytest.FixtureRequest) -> Mesh:
    return build_mesh(request.param)


def spec_file(name: str) -> Path:
    return Path(str(files("toolkit") / "data" / "objects" / f"{name}.toml"))


def cross_2d(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def test_mesh_is_finite_and_of_sensible_size(mesh: Mesh):
    assert 5_000 <= len(mesh.faces) <= 60_000
    for array in (mesh.vertices, mesh.normals, mesh.uv):
        assert np.isfinite(array).all()
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-3)
    assert mesh.size_mm.max() == pytest.approx(270, abs=3)
    assert mesh.uv.min() >= 0 and mesh.uv.max() <= 1


def test_winding_is_outward(mesh: Mesh):
    corners = mesh.vertices[mesh.faces].astype(float)
    volume_mm3 = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    box_mm3 = float(np.prod(mesh.size_mm))
    assert 0.2 * box_mm3 < volume_mm3 < box_mm3
    geometric = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    shaded = mesh.normals[mesh.faces].mean(axis=1)
    assert (np.einsum("ij,ij->i", geometric, shaded) > 0).mean() > 0.999


def test_every_surface_seen_from_outside_is_a_front_face(mesh: Mesh):
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(mesh.vertices), o3d.core.Tensor(mesh.faces.astype(np.uint32)))
    rng = np.random.default_rng(0)
    origins = rng.standard_normal((20_000, 3))
    origins = mesh.bounds.mean(axis=0) + 600 * origins / np.linalg.norm(origins, axis=1, keepdims=True)
    targets = rng.uniform(*mesh.bounds, (20_000, 3))
    directions = targets - origins
    rays = o3d.core.Tensor(np.hstack([origins, directions]).astype(np.float32))
    answer = scene.cast_rays(rays)
    hit = np.isfinite(answer["t_hit"].numpy())
    facing = np.einsum("ij,ij->i", answer["primitive_normals"].numpy(), directions) < 0
    assert hit.sum() > 3_000
    assert facing[hit].mean() > 0.998  # a ray may slip through a hair's breadth between two parts


def test_no_two_charts_share_a_texel(mesh: Mesh):
    """At points drawn from the atlas at most one triangle answers."""
    triangles = mesh.uv[mesh.faces].astype(float)
    area = np.abs(cross_2d(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])) / 2
    assert 0.3 < area.sum() < 1  # the atlas is used, and not twice over
    rng = np.random.default_rng(1)
    chosen = rng.choice(len(triangles), 300, p=area / area.sum())
    points = np.einsum("nk,nkd->nd", rng.dirichlet((2, 2, 2), 300), triangles[chosen])
    orientation = np.sign(cross_2d(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]))
    for point in points:
        edges = [cross_2d(triangles[:, (k + 1) % 3] - triangles[:, k], point - triangles[:, k]) for k in range(3)]
        holders = (np.stack(edges) * orientation > 1e-12).all(axis=0) & (area > 1e-12)
        assert holders.sum() <= 1, f"{holders.sum()} triangles hold {point}"


@pytest.mark.parametrize("name", NAMES)
def test_stands_flat_on_the_table(name: str):
    mesh = place_on_table(build_mesh(name), 270)
    low = mesh.vertices[mesh.vertices[:, 2] < 0.2]
    assert mesh.vertices[:, 2].min() == pytest.approx(0, abs=1e-4)
    assert (np.ptp(low[:, :2], axis=0) > 80).all()


def test_texture_and_materials_are_those_of_a_household_object(mesh: Mesh):
    for material in mesh.materials:
        assert material.texture.dtype == np.uint8 and material.texture.shape == (2048, 2048, 3)
        assert 0.1 <= material.roughness <= 0.6 and material.metallic == 0


def test_building_twice_gives_the_same_bytes():
    from toolkit.objects import coffeepot, eggnog

    for module in (coffeepot, eggnog):
        first, second = module.build(), module.build()
        assert np.array_equal(first.vertices, second.vertices)
        assert np.array_equal(first.materials[0].texture, second.materials[0].texture)


def test_carton_is_printed_on_all_four_sides():
    """Each panel's texels, found through the mesh itself, hold a picture and not a plain colour."""
    mesh = build_mesh("eggnog")
    texture = mesh.materials[0].texture
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        on_panel = (mesh.normals[:, axis] * sign > 0.99) & (mesh.vertices[:, 2] < 200)
        u, v = mesh.uv[on_panel].T
        texels = texture[((1 - v) * 2047).astype(int), (u * 2047).astype(int)]
        assert len(texels) > 100 and len(np.unique(texels, axis=0)) > 50


@pytest.mark.parametrize(("name", "tilt_deg"), [("coffeepot", 0), ("eggnog", 43)])
def test_the_spec_puts_a_sheet_where_a_hand_would(name: str, tilt_deg: float):
    from toolkit.rig.mount import mount_patch

    table_object = load_object(spec_file(name))
    pixels = np.zeros((32, 32, 3), np.uint8)
    sheet = mount_patch(table_object.mesh, pixels, 88, table_object.spec.patch, name)
    normal = sheet.T_object_sheet[:3, 2]
    assert np.degrees(np.arccos(normal[2])) == pytest.approx(tilt_deg, abs=8)
    top = table_object.mesh.bounds[1, 2]
    if name == "coffeepot":  # on the lid, below the thumb lift's tip, level all over
        assert sheet.mesh.vertices[:, 2].max() < top
        assert sheet.mesh.vertices[:, 2].min() > top - 45
    else:  # on the front slope alone: it neither climbs the fin nor hangs behind it
        assert sheet.mesh.vertices[:, 0].min() > 0
        assert sheet.mesh.vertices[:, 2].max() < top - 15
