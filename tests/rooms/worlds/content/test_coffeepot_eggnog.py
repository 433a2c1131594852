"""The coffeepot and the bottle of eggnog: sound meshes with sound charts, and a place for the patch."""

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


@pytest.mark.slow
def test_building_twice_gives_the_same_bytes():
    from toolkit.rooms.worlds.content import coffeepot, eggnog

    for module in (coffeepot, eggnog):
        first, second = module.build(), module.build()
        assert np.array_equal(first.vertices, second.vertices)
        assert np.array_equal(first.materials[0].texture, second.materials[0].texture)


def texels_where(mesh: Mesh, chosen: np.ndarray) -> np.ndarray:
    """(n, 3) colours of the texture at the chosen vertices."""
    u, v = mesh.uv[chosen].T
    return mesh.materials[0].texture[((1 - v) * 2047).astype(int), (u * 2047).astype(int)].astype(int)


def wall_line(mesh: Mesh, bearing_deg: float, heights: np.ndarray) -> np.ndarray:
    """(n, 3) colours up the bottle's wall as a level ray from outside meets it."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(mesh.vertices), o3d.core.Tensor(mesh.faces.astype(np.uint32)))
    out = np.array([np.cos(np.radians(bearing_deg)), np.sin(np.radians(bearing_deg)), 0])
    origins = out * 300 + np.c_[np.zeros((len(heights), 2)), heights]
    rays = np.hstack([origins, np.broadcast_to(-out, origins.shape)]).astype(np.float32)
    answer = scene.cast_rays(o3d.core.Tensor(rays))
    weights = answer["primitive_uvs"].numpy()
    corners = mesh.uv[mesh.faces[answer["primitive_ids"].numpy().astype(int)]]
    weights = np.c_[1 - weights.sum(axis=1), weights]
    u, v = np.einsum("nk,nkd->nd", weights, corners).T
    return mesh.materials[0].texture[((1 - v) * 2047).astype(int), (u * 2047).astype(int)].astype(int)


def test_eggnog_stands_open_and_full_with_nutmeg_on_the_foam():
    """From above the mouth shows cream and brown specks, a little below a rim of pale, nearly grey glass."""
    mesh = build_mesh("eggnog")
    level = (mesh.normals[:, 2] > 0.9) & (mesh.vertices[:, 2] > 200) & (np.hypot(*mesh.vertices[:, :2].T) < 44)
    foam = mesh.vertices[level]
    assert np.ptp(foam[:, :2], axis=0).min() > 80
    assert 230 - foam[:, 2].max() > 4 and foam[:, 2].min() > 205
    texels = texels_where(mesh, level)
    cream, specks = (texels[:, 0] > 225) & (texels[:, 2] > 150), texels[:, 0] < 190
    assert cream.mean() > 0.5 and specks.sum() > 20
    glass = wall_line(mesh, 0, np.linspace(219, 226, 8))
    assert (np.ptp(glass, axis=1) < 20).all() and glass.min() > 200


@pytest.mark.slow
@pytest.mark.parametrize("bearing_deg", [0, 90, 180, 270])
def test_eggnog_shows_through_the_glass_above_a_label_on_every_side(bearing_deg: float):
    mesh = build_mesh("eggnog")
    drink = wall_line(mesh, bearing_deg, np.linspace(100, 190, 10))
    assert (drink[:, 0] > drink[:, 2] + 50).all() and drink[:, 0].min() > 230
    sides = [wall_line(mesh, bearing_deg + turn, np.linspace(37, 93, 40)) for turn in (-20, -5, 5, 20)]
    label = np.concatenate(sides)
    assert len(np.unique(label, axis=0)) > 10
    assert ((label[:, 0] > 130) & (label[:, 1] < 50)).mean() > 0.2  # red paper
    assert (label.min(axis=1) > 150).mean() > 0.03  # letters or the picture of a mug


@pytest.mark.parametrize(("name", "tilt_deg"), [("coffeepot", 0), ("eggnog", 90)])
def test_the_spec_puts_a_sheet_where_a_hand_would(name: str, tilt_deg: float):
    from toolkit.rig.mount import mount_patch

    table_object = load_object(spec_file(name))
    pixels = np.zeros((32, 32, 3), np.uint8)
    sheet = mount_patch(table_object.mesh, pixels, 88, table_object.spec.mounts[0], name)
    normal = sheet.T_object_sheet[:3, 2]
    assert np.degrees(np.arccos(normal[2])) == pytest.approx(tilt_deg, abs=8)
    low, top = sheet.mesh.bounds[:, 2]
    if name == "coffeepot":  # on the lid, below the thumb lift's tip, level all over
        assert low > table_object.mesh.bounds[1, 2] - 45 and top < table_object.mesh.bounds[1, 2]
    else:  # around the front of the wall: clear of the table and of the mouth, nowhere far from the glass
        assert low > 10 and top < 160
        assert sheet.mesh.vertices[:, 0].min() > 30
        radius = np.hypot(*sheet.mesh.vertices[:, :2].T)
        assert radius.min() > 61.5 and radius.max() < 67
