"""Meshes as they should not be: each is a picture, or one clear line."""

import struct

import numpy as np
import pytest
import trimesh

from toolkit.core.errors import ToolkitError
from toolkit.objects import limits
from toolkit.objects.load import load_object, read_mesh
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.studio import make_studio

CAMERA = Camera.from_fov(64, 48, 40)
SPEC = 'name = "thing"\nclass = "thing"\nmesh = "thing.{}"\nlength_mm = 120\nup = "z"\nfront = "x"\n'


def write_ply(folder, vertices, faces, normals=None):
    """A binary PLY in doubles, with normals if given."""
    fields = ["x", "y", "z"] + (["nx", "ny", "nz"] if normals is not None else [])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property double {field}" for field in fields]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    table = np.asarray(vertices, "<f8") if normals is None else np.column_stack([vertices, normals]).astype("<f8")
    rows = b"".join(struct.pack("<B3i", 3, *face) for face in np.asarray(faces).tolist())
    (folder / "thing.ply").write_bytes("\n".join(header).encode() + table.tobytes() + rows)
    (folder / "thing.toml").write_text(SPEC.format("ply"))
    return folder / "thing.toml"


def shoot(spec_file):
    """The object's mesh, and a small picture of it: finite, and with the object in it."""
    mesh = load_object(spec_file).mesh
    renderer = RaycastRenderer(mesh, make_studio(0, 120, "white"))
    pose = orbit_pose(np.array([0, 0, mesh.size_mm[2] / 2]), 30, 40, 400)
    picture = renderer.render(CAMERA, pose)
    assert picture.shape == (48, 64, 3) and np.isfinite(picture).all()
    assert (renderer.buffers(CAMERA, pose)["material"] >= 0).any()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    assert mesh.size_mm.max() == pytest.approx(120, rel=1e-4)
    return mesh


BALL = trimesh.creation.icosphere(2, 1.0)
VERTICES, FACES = np.array(BALL.vertices), np.array(BALL.faces)


def test_normals_of_the_file_are_worked_out_again_even_where_they_are_nan(tmp_path):
    mesh = shoot(write_ply(tmp_path, VERTICES, FACES, np.full_like(VERTICES, np.nan)))
    centre = mesh.bounds.mean(axis=0)
    np.testing.assert_allclose(mesh.normals, (mesh.vertices - centre) / 60, atol=0.06)


def test_triangles_without_area_are_no_trouble(tmp_path):
    """Twice the same corner, three points in a row, one point thrice."""
    vertices = np.concatenate([VERTICES, [[2, 0, 0], [2.5, 0, 0], [3, 0, 0]]])
    n = len(VERTICES)
    odd = [[0, 0, 1], [n, n + 1, n + 2], [5, 5, 5]]
    mesh = shoot(write_ply(tmp_path, vertices, np.concatenate([FACES, odd])))
    assert len(mesh.faces) == len(FACES) + 1


def test_points_in_one_plane_are_a_sheet(tmp_path):
    corners = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    mesh = shoot(write_ply(tmp_path, corners, [[0, 1, 2], [0, 2, 3]]))
    assert mesh.size_mm[2] == 0
    upright = np.roll(corners, 1, axis=1)
    assert shoot(write_ply(tmp_path, upright, [[0, 1, 2], [0, 2, 3]])).size_mm[2] == pytest.approx(120, rel=1e-4)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_any_unit_will_do(tmp_path, scale):
    shoot(write_ply(tmp_path, VERTICES * scale, FACES))


def test_a_mesh_far_from_the_origin_keeps_its_shape(tmp_path):
    """Surveyed in metres from an equator: float32 has steps of half a metre there."""
    mesh = shoot(write_ply(tmp_path, VERTICES + np.array([500_000, 5_600_000, 300]), FACES))
    np.testing.assert_allclose(
        np.linalg.norm(mesh.vertices - mesh.bounds.mean(axis=0), axis=1), 60, atol=0.01
    )  # still a ball


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        (1e-300, r"the mesh is .*e-300 long, expected 1e-09 to 1e\+12"),
        (1e30, r"the mesh is 2e\+30 long, expected 1e-09 to 1e\+12 in its file's unit: scale it"),
        (1e308, r"the mesh is inf long|NaN or infinite"),
        (0, "zero area|one point"),
    ],
)
def test_coordinates_beyond_measure_are_one_clear_line(tmp_path, scale, words):
    with np.errstate(all="raise"), pytest.raises(ToolkitError, match=words) as caught:
        load_object(write_ply(tmp_path, VERTICES * scale, FACES))
    assert "thing.ply" in str(caught.value) and "\n" not in str(caught.value)


def test_more_faces_than_memory_has_room_for_are_one_clear_line(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "MAX_FACES", 300)
    with pytest.raises(ToolkitError, match=r"thing\.ply: 320 faces, more than 300: simplify it"):
        load_object(write_ply(tmp_path, VERTICES, FACES))


def test_a_mirrored_piece_is_turned_the_right_way_out(tmp_path):
    """glTF scales a piece by -1: its faces would look inwards."""
    scene = trimesh.Scene()
    scene.add_geometry(BALL, transform=np.diag([-1.0, 1, 1, 1]))
    scene.add_geometry(BALL, transform=trimesh.transformations.translation_matrix([5, 0, 0]))
    scene.export(tmp_path / "two.glb")
    mesh = read_mesh(tmp_path / "two.glb")
    corners = mesh.vertices[mesh.faces].astype(float)
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(2 * BALL.volume, rel=1e-3)
    np.testing.assert_allclose(mesh.size_mm, [7, 2, 2], atol=1e-3)
