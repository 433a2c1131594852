"""The racer: a sound mesh, standing on four wheels, with paint that no two triangles share."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from toolkit.objects.load import load_object
from toolkit.objects.mesh import place_on_table
from toolkit.rig.mount import mount_patch
from toolkit.rooms.worlds.content.racer import build

SPEC = Path(str(files("toolkit") / "data" / "objects" / "racer.toml"))


@pytest.fixture(scope="module")
def racer():
    return place_on_table(build())


@pytest.fixture(scope="module")
def rays(racer):
    o3d = pytest.importorskip("open3d")
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(racer.vertices), o3d.core.Tensor(racer.faces.astype(np.uint32)))

    def cast(origins, directions):
        both = np.concatenate(np.broadcast_arrays(origins, directions), axis=1).astype(np.float32)
        found = scene.cast_rays(o3d.core.Tensor(both))
        return {name: found[name].numpy() for name in ("t_hit", "primitive_ids", "primitive_normals")}

    return cast


@pytest.mark.slow
def test_numbers_are_finite_and_in_range(racer):
    for values in (racer.vertices, racer.normals, racer.uv):
        assert np.isfinite(values).all()
    assert racer.uv.min() >= 0 and racer.uv.max() <= 1
    np.testing.assert_allclose(np.linalg.norm(racer.normals, axis=1), 1, atol=1e-3)
    assert 10_000 <= len(racer.faces) <= 60_000
    assert {material.name for material in racer.materials} == {"paint", "rubber", "metal", "glass", "carbon"}


def test_toy_sized_and_symmetric(racer):
    low, high = racer.bounds
    length, width, height = high - low
    assert 265 <= length <= 275 and 0.4 < width / length < 0.6 and 0.2 < height / length < 0.4
    assert low[1] == pytest.approx(-high[1], abs=0.01)


def test_volume_is_positive(racer):
    a, b, c = np.moveaxis(racer.vertices[racer.faces].astype(float), 1, 0)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 > 100_000  # mm³: bodywork and four tyres


def test_whatever_a_camera_sees_faces_it(racer, rays):
    """From 26 directions, parallel rays over the whole car meet triangles from their outside."""
    rng = np.random.default_rng(0)
    spread = rng.uniform(-140, 140, (4000, 3))
    wrong = seen = 0
    for direction in np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), -1).reshape(-1, 3):
        if not direction.any() or direction[2] > 0:  # none from below the table
            continue
        forward = direction / np.linalg.norm(direction)
        found = rays(spread - 500 * forward - np.outer(spread @ forward, forward), forward)
        hit = np.isfinite(found["t_hit"])
        seen += hit.sum()
        wrong += (found["primitive_normals"][hit] @ forward > 0.05).sum()
    assert seen > 5_000
    assert wrong / seen < 0.005


def test_normals_agree_with_winding(racer):
    a, b, c = np.moveaxis(racer.vertices[racer.faces].astype(float), 1, 0)
    flat = np.cross(b - a, c - a)
    area = np.linalg.norm(flat, axis=1)
    real = area > 1e-3
    smooth = racer.normals[racer.faces].mean(axis=1)[real]
    assert (np.einsum("ij,ij->i", flat[real] / area[real, None], smooth) > 0).all()


def test_four_wheels_stand_on_the_table(racer):
    assert racer.bounds[0, 2] == pytest.approx(0, abs=1e-4)
    touching = racer.vertices[racer.vertices[:, 2] < 0.05]
    corners = {(bool(x > 0), bool(y > 0)) for x, y, _ in touching}
    assert len(corners) == 4
    assert (np.abs(touching[:, 1]) > 35).all() and (np.abs(touching[:, 0]) > 60).all()


def test_no_two_triangles_share_a_texel(racer):
    """Random points of the atlas lie strictly inside at most one triangle."""
    o3d = pytest.importorskip("open3d")
    flat = np.concatenate([racer.uv[racer.faces].reshape(-1, 2), np.zeros((3 * len(racer.faces), 1))], 1)
    scene = o3d.t.geometry.RaycastingScene()
    index = np.arange(len(flat), dtype=np.uint32).reshape(-1, 3)
    scene.add_triangles(o3d.core.Tensor(flat.astype(np.float32)), o3d.core.Tensor(index))
    points = np.random.default_rng(1).uniform(0, 1, (60_000, 2))
    down = np.concatenate([points, np.ones((len(points), 1)), np.tile([0, 0, -1.0], (len(points), 1))], 1)
    counts = scene.count_intersections(o3d.core.Tensor(down.astype(np.float32))).numpy()
    assert (counts >= 1).mean() > 0.4  # the atlas is used
    assert (counts > 1).mean() < 5e-4  # only points on a common edge


def test_paint_shows_three_colours_and_the_number(racer, rays):
    """Straight down on the engine cover: the roundel is white, its number black, the tail red."""
    grid = np.stack(np.meshgrid(np.linspace(-46, 2, 97), np.linspace(-16, 16, 65)), -1).reshape(-1, 2)
    colours = _colours_from_above(racer, rays, grid)
    white, black = (colours.min(axis=1) > 200).mean(), (colours.max(axis=1) < 60).mean()
    assert white > 0.4 and 0.1 < black < 0.5
    red = _colours_from_above(racer, rays, np.array([[-80.0, 0.0], [-70.0, 0.0]]))
    assert (red[:, 0] > 150).all() and (red[:, 1:] < 80).all()


def _colours_from_above(mesh, rays, points):
    origins = np.concatenate([points, np.full((len(points), 1), 300.0)], 1)
    found = rays(origins, np.array([0.0, 0.0, -1.0]))
    face = mesh.faces[found["primitive_ids"].astype(int)]
    places = origins - np.outer(found["t_hit"], [0, 0, 1])
    corners = mesh.vertices[face].astype(float)
    matrix = np.concatenate([corners[..., :2], np.ones((*face.shape, 1))], 2)  # seen from above: plane barycentrics
    weights = np.linalg.solve(
        np.swapaxes(matrix, 1, 2), np.concatenate([places[:, :2], np.ones((len(points), 1))], 1)[..., None]
    )
    uv = (mesh.uv[face] * weights).sum(axis=1)
    texture = mesh.materials[0].texture
    rows = ((1 - uv[:, 1]) * texture.shape[0]).astype(int).clip(0, texture.shape[0] - 1)
    columns = (uv[:, 0] * texture.shape[1]).astype(int).clip(0, texture.shape[1] - 1)
    return texture[rows, columns].astype(int)


def test_a_sheet_lies_flat_on_the_engine_cover():
    """The shipped spec puts 88 mm of patch clear of the headrest, the wheels and the wing."""
    item = load_object(SPEC)
    sheet = mount_patch(item.mesh, np.zeros((11, 11, 3), np.uint8), 88.0, item.spec.mounts[0])
    heights = sheet.mesh.vertices[:, 2]
    assert np.ptp(heights) < 4
    assert 38 < heights.mean() < 46
