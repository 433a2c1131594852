"""The modelling kit: closed volumes against closed forms, and paint that lands where it was put."""

import numpy as np
import pytest
import trimesh
from PIL import Image, ImageDraw

from toolkit.rooms.worlds.content.modelling import (  # fmt: skip
    Parts,
    assemble,
    box,
    extrude,
    fan,
    loft,
    plate,
    revolve,
    smooth_curve,
    superellipse,
    surface,
    tube,
)

LOOK = {"paint": (0.6, 0.0)}
L_SHAPE = [(0, 0), (30, 0), (30, 10), (10, 10), (10, 40), (0, 40)]


def solid(parts):
    """One trimesh of all parts, equal positions joined."""
    pieces = [trimesh.Trimesh(part.vertices, part.faces, process=False) for part in parts if len(part.faces)]
    whole = trimesh.util.concatenate(pieces)
    whole.merge_vertices(digits_vertex=6)
    whole.update_faces(whole.nondegenerate_faces())
    return whole


def tetra_volume(parts):
    corners = np.concatenate([part.vertices[part.faces] for part in parts])
    return np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6


def test_a_box_has_its_volume():
    whole = solid(box((30, 20, 10)))
    assert whole.is_watertight and whole.is_winding_consistent
    assert whole.volume == pytest.approx(6000)
    bevelled = solid(box((30, 20, 10), bevel=2))
    assert bevelled.is_watertight and bevelled.is_winding_consistent
    assert 0.9 * 6000 < bevelled.volume < 6000
    np.testing.assert_allclose(bevelled.extents, [30, 20, 10])


def test_a_revolved_profile_has_the_volume_of_its_prism():
    """A cylinder of n flat sides: n/2 sin(2π/n) r² h, and a cone a third of that."""
    base = 48 / 2 * np.sin(2 * np.pi / 48) * 7**2
    cylinder = solid([revolve([(0, 0), (7, 0), (7, 20), (0, 20)], 48)])
    assert cylinder.is_watertight and cylinder.volume == pytest.approx(base * 20)
    assert solid([revolve([(0, 0), (7, 0), (0, 20)], 48)]).volume == pytest.approx(base * 20 / 3)


@pytest.mark.parametrize("outline", [L_SHAPE, [(0, 0), (10, 0), (20, 0), (20, 8), (10, 8), (0, 8)]])
def test_concave_and_collinear_outlines_are_filled_once(outline):
    x, y = np.array(outline, float).T
    area = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
    flat = plate(np.c_[x, y, 0 * x])
    corners = flat.vertices[flat.faces]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (doubled[:, 2] >= -1e-9).all()  # none turned over
    assert doubled[:, 2].sum() / 2 == pytest.approx(area)
    whole = solid(extrude(outline, 6))
    assert whole.is_watertight and whole.volume == pytest.approx(area * 6)


def test_lofts_and_tubes_are_closed_and_face_outwards():
    sections = [superellipse(20, 10, 4, x=0), superellipse(30, 20, 3, x=25), superellipse(8, 8, x=60)]
    hull = solid(loft(sections))
    assert hull.is_watertight and hull.is_winding_consistent and hull.volume > 0
    path = smooth_curve([(0, 0, 0), (30, 0, 10), (40, 20, 30), (40, 20, 60)], 24)
    pipe = solid(tube(path, 4))
    assert pipe.is_watertight and pipe.is_winding_consistent
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    ring = 24 / 2 * np.sin(2 * np.pi / 24) * 16
    assert pipe.volume == pytest.approx(ring * length, rel=0.03)  # Pappus: the path is its centre line


def test_curves_go_through_their_points():
    points = [(0, 0, 0), (10, 5, 0), (30, 5, 2)]
    curve = smooth_curve(points, 400)
    for point in points:
        assert np.linalg.norm(curve - point, axis=1).min() < 0.1
    np.testing.assert_allclose(curve[[0, -1]], [points[0], points[-1]])


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_mirror_image_keeps_its_outside(axis):
    parts = extrude(L_SHAPE, 6).moved(5, 6, 7)
    mirrored = parts.mirrored(axis)
    assert tetra_volume(mirrored) == pytest.approx(tetra_volume(parts)) and tetra_volume(parts) > 0
    flip = np.where(np.array(list("xyz")) == axis, -1, 1)
    np.testing.assert_allclose(solid(mirrored).center_mass, solid(parts).center_mass * flip)
    for before, after in zip(parts, mirrored, strict=True):  # paint stays on its spot
        np.testing.assert_allclose(after.vertices[after.faces][:, ::-1] * flip, before.vertices[before.faces])
        np.testing.assert_array_equal(after.corner_uv[:, ::-1], before.corner_uv)
    assert tetra_volume(parts.flipped()) == pytest.approx(-tetra_volume(parts))
    assert tetra_volume(parts.flipped().outward()) == tetra_volume(parts.outward()) == tetra_volume(parts)
    assert tetra_volume(parts.both_sides()) == pytest.approx(2 * tetra_volume(parts))


def test_turns_are_counter_clockwise_from_the_axis_tip():
    part = fan(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float))
    for axis, start, end in (("x", 1, 2), ("y", 2, 0), ("z", 0, 1)):
        point = np.eye(3)[start]
        moved = part.bent(lambda _, point=point: point[None]).rotated(axis, 90)
        np.testing.assert_allclose(moved.vertices[0], np.eye(3)[end], atol=1e-12)


@pytest.fixture(scope="module")
def assembled():
    pipe = tube(smooth_curve([(0, 0, 0), (20, 5, 9), (50, 0, 20)], 12), 3, 12)
    parts = Parts(box((40, 30, 20), bevel=3), pipe, revolve([(0, 0), (9, 0), (12, 15), (0, 18)], 24))
    return assemble(parts, LOOK, 512)


def test_no_spot_of_the_atlas_belongs_to_two_triangles(assembled):
    assert assembled.uv.min() >= 0 and assembled.uv.max() <= 1
    corners = assembled.uv[assembled.faces].astype(float)
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    real = np.abs(area) > 1e-12
    spots = np.random.default_rng(0).uniform(0, 1, (4000, 2))
    along = spots[:, None] - a[real]
    first = (along[..., 0] * ac[real, 1] - along[..., 1] * ac[real, 0]) / area[real]
    second = (ab[real, 0] * along[..., 1] - ab[real, 1] * along[..., 0]) / area[real]
    owners = ((first > 1e-3) & (second > 1e-3) & (first + second < 1 - 1e-3)).sum(axis=1)
    assert owners.max() == 1
    assert (owners == 1).mean() > 0.3  # and the atlas is used


def test_a_texel_has_one_size_everywhere():
    """Flat charts: texture area over surface area is the same for every triangle."""
    mesh = assemble([*box((40, 30, 20)), *box((8, 9, 10))], LOOK, 512)
    corners, uv = mesh.vertices[mesh.faces].astype(float), mesh.uv[mesh.faces].astype(float)
    surface_area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    ab, ac = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    chart_area = np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
    density = np.sqrt(chart_area / surface_area)
    np.testing.assert_allclose(density, np.median(density), rtol=0.06)  # charts are whole texels wide


@pytest.mark.parametrize("mark", [(10, 5), (30, 18), (2, 2)])
def test_paint_lands_where_it_was_put(mark):
    """A red dot at (x, y) mm of the chart of a flat 40 × 20 mm part is found at that place of the part."""

    def paint(width, height, px_per_mm):
        image = Image.new("RGB", (width, height), "white")
        x, y = mark[0] * px_per_mm, height - mark[1] * px_per_mm
        ImageDraw.Draw(image).ellipse((x - 3, y - 3, x + 3, y + 3), fill="red")
        return image

    x, y = np.meshgrid(np.linspace(0, 40, 5), np.linspace(0, 20, 3))
    net = np.stack([x, y, 0 * x], axis=-1)
    mesh = assemble([surface(net, paint), *box((10, 10, 10))], LOOK, 256)
    flat = np.abs(mesh.normals[:, 2] - 1) < 1e-6
    flat &= mesh.vertices[:, 2] == 0
    to_uv, *_ = np.linalg.lstsq(np.c_[mesh.vertices[flat, :2], np.ones(flat.sum())], mesh.uv[flat], rcond=None)
    texture = mesh.materials[0].texture

    def colour(x_mm, y_mm):
        u, v = np.array([x_mm, y_mm, 1]) @ to_uv
        return texture[int((1 - v) * 256), int(u * 256)]

    assert colour(*mark)[0] > 200 and colour(*mark)[1] < 60
    assert colour(40 - mark[0], 20 - mark[1]).min() > 200


def test_the_margin_around_a_chart_has_its_edge_colour():
    """Look-ups half a texel beyond a chart's border must not meet another chart's paint."""
    mesh = assemble([*box((20, 20, 20), paint=(255, 0, 0)), *box((20, 20, 20), paint=(0, 0, 255))], LOOK, 256)
    texture = mesh.materials[0].texture
    for faces, channel in ((mesh.faces[:12], 0), (mesh.faces[12:], 2)):
        x, y = mesh.uv[faces][..., 0] * 256, (1 - mesh.uv[faces][..., 1]) * 256
        for dx, dy in ((-1, -1), (1, 1), (-1, 1), (1, -1)):
            met = texture[np.clip(y + dy, 0, 255).astype(int), np.clip(x + dx, 0, 255).astype(int)]
            assert (met[..., channel] == 255).all()


def test_materials_are_those_named():
    parts = Parts(box((5, 5, 5)).painted((9, 9, 9), "chrome"), box((3, 3, 3)))
    mesh = assemble(parts, {"paint": (0.6, 0.0), "chrome": (0.1, 1.0)}, 64)
    by_name = {material.name: material for material in mesh.materials}
    assert (by_name["chrome"].roughness, by_name["chrome"].metallic) == (0.1, 1.0)
    assert np.bincount(mesh.face_material).tolist() == [12, 12]
