"""The mesh type: placing, merging, creases."""

from dataclasses import replace

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import (
    Material,
    Mesh,
    check_mesh,
    corner_normals,
    hash_mesh,
    merge_meshes,
    mesh_from_corners,
    pack_mesh,
    place_on_table,
    unpack_mesh,
)

GREY = Material("grey", np.full((4, 4, 3), 128, np.uint8))


def bent(angle_deg):
    """Two squares that share the y axis, the second one folded down by an angle."""
    down = np.radians(angle_deg)
    x, z = np.cos(down), -np.sin(down)
    vertices = np.array([[-1, 0, 0], [0, 0, 0], [0, 1, 0], [-1, 1, 0], [x, 0, z], [x, 1, z]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]])
    return vertices, faces


@pytest.mark.parametrize(("angle", "smooth"), [(10, True), (39, True), (41, False), (90, False)])
def test_edges_flatter_than_the_crease_angle_are_smooth(angle, smooth):
    vertices, faces = bent(angle)
    normals = corner_normals(vertices, faces, 40)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1, atol=1e-9)
    half = np.radians(angle / 2)
    on_the_fold = normals[0, 1]
    expected = [np.sin(half), 0, np.cos(half)] if smooth else [0, 0, 1]
    if smooth:  # the area-weighted mean leans to the side with more triangles at that corner, here 1 to 2
        assert 0 < on_the_fold[0] < np.sin(2 * half) and on_the_fold[1] == pytest.approx(0)
    else:
        np.testing.assert_allclose(on_the_fold, expected, atol=1e-9)
    np.testing.assert_allclose(normals[1, 2], [0, 0, 1], atol=1e-9)  # away from the fold


def test_a_fine_sphere_has_the_normals_of_a_sphere():
    import trimesh

    sphere = trimesh.creation.icosphere(3, 5.0)
    normals = corner_normals(np.asarray(sphere.vertices), np.asarray(sphere.faces))
    np.testing.assert_allclose(normals, np.asarray(sphere.vertices)[sphere.faces] / 5, atol=0.015)


def test_vertices_are_split_where_texture_or_crease_ask_for_it():
    vertices, faces = bent(90)
    uv = np.zeros((4, 3, 2))
    creased = mesh_from_corners(vertices, faces, uv, np.zeros(4), (GREY,))
    assert len(creased.vertices) == 8  # the two on the fold are there twice
    flat_vertices, _ = bent(0)
    whole = mesh_from_corners(flat_vertices, faces, uv, np.zeros(4), (GREY,))
    assert len(whole.vertices) == 6
    uv[2:] = 0.5
    assert len(mesh_from_corners(flat_vertices, faces, uv, np.zeros(4), (GREY,)).vertices) == 8
    np.testing.assert_allclose(creased.vertices[creased.faces], vertices[faces], atol=1e-6)


def test_a_mesh_comes_back_from_its_arrays(make_box):
    mesh = make_box()
    (paint,) = mesh.materials
    lamp = Material("lamp", paint.texture, 1, 0.25, emission=paint.texture // 2)
    mesh = replace(mesh, materials=(paint, lamp))
    back = unpack_mesh(pack_mesh(mesh))
    assert hash_mesh(back) == hash_mesh(mesh) and np.array_equal(back.normals, mesh.normals)
    assert back.materials[0].texture is back.materials[1].texture  # one picture, as before


def test_a_mesh_is_shown_by_its_counts(make_box):
    assert repr(make_box()) == "Mesh(24 vertices, 12 faces, 1 materials)"


def test_placing_scales_the_longest_side_and_centres_the_base(make_box):
    mesh = make_box((10, 20, 5))
    moved = Mesh(**{**vars(mesh), "vertices": mesh.vertices + np.array([7, -3, 2], np.float32)})
    placed = place_on_table(moved, 200)
    np.testing.assert_allclose(placed.bounds, [[-50, -100, 0], [50, 100, 50]], atol=1e-3)
    np.testing.assert_allclose(place_on_table(moved).size_mm, [10, 20, 5], atol=1e-5)


def test_merging_keeps_every_triangle_and_its_material(make_box):
    first, second = make_box((10, 10, 10), (255, 0, 0)), make_box((4, 4, 30), (0, 0, 255))
    both = merge_meshes([first, second])
    assert both.faces.dtype == both.face_material.dtype == np.int32
    np.testing.assert_array_equal(
        both.vertices[both.faces], np.concatenate([m.vertices[m.faces] for m in (first, second)])
    )
    colours = [both.materials[i].texture.reshape(-1, 3).max(axis=0).argmax() for i in both.face_material]
    assert colours == [0] * 12 + [2] * 12


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"faces": np.zeros((0, 3), np.int32)}, "no faces"),
        ({"faces": np.array([[0, 1, 99]])}, "names vertex 99, the mesh has 24"),
        ({"faces": np.array([[0, 1, -2]])}, "names vertex -2|the mesh has 24"),
        ({"vertices": np.full((24, 3), np.nan)}, "24 of 24 vertices are NaN"),
        ({"vertices": np.ones((24, 3))}, "at the same point"),
    ],
)
def test_what_cannot_be_photographed_is_refused(make_box, change, words):
    mesh = make_box()
    with pytest.raises(ToolkitError, match=words) as caught:
        check_mesh(Mesh(**{**vars(mesh), **change}), "thing.obj")
    assert str(caught.value).startswith("thing.obj: ")
