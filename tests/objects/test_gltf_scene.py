"""Where a glTF's parts stand: nodes, instances, skins, morphs; and the ways in which triangles are listed."""

import numpy as np
import pytest
from gltf_builder import CARD, CARD_FACES, Gltf

from toolkit.core.errors import ToolkitError
from toolkit.objects.load import read_mesh

HALF_TURN = [0, 0, 1, 0]


def bounds(folder, gltf):
    return read_mesh(gltf.write(folder)).bounds


def area_and_normal(mesh):
    corners = mesh.vertices[mesh.faces].astype(float)
    total = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0) / 2
    return np.linalg.norm(total), total / np.linalg.norm(total)


@pytest.mark.parametrize(
    ("mode", "index"),
    [(4, [0, 1, 2, 0, 2, 3]), (5, [0, 1, 3, 2]), (6, [0, 1, 2, 3])],
)
@pytest.mark.parametrize("is_listed", [True, False])
def test_lists_strips_and_fans_make_the_same_card(tmp_path, mode, index, is_listed):
    gltf = Gltf()
    corners = CARD if is_listed else CARD[index]
    gltf.node(mesh=gltf.mesh({"POSITION": corners}, np.array(index, "<u2") if is_listed else None, mode=mode))
    area, normal = area_and_normal(read_mesh(gltf.write(tmp_path)))
    assert area == pytest.approx(1) and normal == pytest.approx([0, 0, 1])


def test_points_and_lines_are_noted_beside_what_has_a_surface(tmp_path, capsys):
    gltf = Gltf()
    gltf.card()
    gltf.node(mesh=gltf.mesh({"POSITION": CARD + 5}, mode=1))
    assert len(read_mesh(gltf.write(tmp_path)).faces) == 2
    assert "thing.glb: lines are left out" in capsys.readouterr().err


def test_transforms_of_nodes_come_after_one_another(tmp_path):
    gltf = Gltf()
    inner = gltf.node(False, mesh=gltf.mesh({"POSITION": CARD}, CARD_FACES), translation=[1, 0, 0])
    gltf.node(children=[inner], rotation=HALF_TURN, scale=[2, 3, 1], translation=[10, 0, 0])
    # x in [1, 2] is scaled to [2, 4], turned to [-4, -2] and moved to [6, 8]
    np.testing.assert_allclose(bounds(tmp_path, gltf), [[6, -3, 0], [8, 0, 0]], atol=1e-6)


def test_a_matrix_is_listed_column_by_column(tmp_path):
    gltf = Gltf()
    matrix = np.array([[0, -2, 0, 7], [1, 0, 0, 8], [0, 0, 1, 9], [0, 0, 0, 1]])
    gltf.node(mesh=gltf.mesh({"POSITION": CARD}, CARD_FACES), matrix=matrix.T.reshape(-1).tolist())
    np.testing.assert_allclose(bounds(tmp_path, gltf), [[5, 8, 9], [7, 9, 9]], atol=1e-6)


def test_a_mirror_keeps_the_outside_out(tmp_path):
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh({"POSITION": CARD}, CARD_FACES), scale=[-1, 1, 1])
    assert area_and_normal(read_mesh(gltf.write(tmp_path)))[1] == pytest.approx([0, 0, 1])


def test_the_default_scene_counts_and_the_others_are_noted(tmp_path, capsys):
    gltf = Gltf()
    mesh = gltf.mesh({"POSITION": CARD}, CARD_FACES)
    gltf.node(mesh=mesh)
    other = gltf.node(False, mesh=mesh, scale=[3, 3, 3])
    gltf.tree["scenes"].append({"nodes": [other]})
    gltf.tree["scene"] = 1
    np.testing.assert_allclose(bounds(tmp_path, gltf)[1], [3, 3, 0], atol=1e-6)
    assert "scene 1 of 2 is read" in capsys.readouterr().err


def test_without_scenes_all_nodes_count(tmp_path):
    gltf = Gltf()
    gltf.card()
    del gltf.tree["scene"], gltf.tree["scenes"]
    assert len(read_mesh(gltf.write(tmp_path)).faces) == 2


def test_instances_and_hidden_nodes(tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh({"POSITION": CARD}, CARD_FACES)
    attributes = {
        "TRANSLATION": gltf.accessor(np.array([[0, 0, 0], [5, 0, 0]], "<f4")),
        "SCALE": gltf.accessor(np.array([[1, 1, 1], [2, 2, 2]], "<f4")),
    }
    gltf.node(mesh=mesh, extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})
    gltf.node(mesh=mesh, translation=[90, 0, 0], extensions={"KHR_node_visibility": {"visible": False}})
    mesh = read_mesh(gltf.write(tmp_path))
    assert len(mesh.faces) == 4
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [7, 2, 0]], atol=1e-6)


@pytest.mark.parametrize("on_node", [True, False])
def test_morph_targets_count_by_their_weights(tmp_path, on_node):
    gltf = Gltf()
    first, second = np.zeros((4, 3), "<f4"), np.zeros((4, 3), "<f4")
    first[:, 2], second[2:, 1] = 9, 4
    targets = [{"POSITION": gltf.accessor(first)}, {"POSITION": gltf.accessor(second)}]
    weights = {"weights": [0, 0.25]}
    mesh = gltf.mesh({"POSITION": CARD}, CARD_FACES, targets=targets, **({"weights": [1, 1]} if on_node else weights))
    gltf.node(mesh=mesh, **(weights if on_node else {}))
    np.testing.assert_allclose(bounds(tmp_path, gltf), [[0, 0, 0], [1, 2, 0]], atol=1e-6)


def test_a_skin_puts_vertices_where_its_joints_stand(tmp_path):
    """The upper corners hang on a joint that was bound at y = 1 and stands at y = 5; the node's place is nothing."""
    gltf = Gltf()
    joints, weights = np.zeros((4, 4), "<u1"), np.zeros((4, 4), "<u1")
    joints[2:, 0], weights[:, 0] = 1, 255
    inverse = np.tile(np.eye(4, dtype="<f4"), (2, 1, 1))
    inverse[1, 3, 1] = -1  # column by column: the translation is the last row of what is written
    low, high = gltf.node(), gltf.node(translation=[0, 5, 0])
    attributes = {
        "POSITION": CARD, "JOINTS_0": joints, "WEIGHTS_0": gltf.accessor(weights, normalized=True),
    }  # fmt: skip
    gltf.tree["skins"] = [{"joints": [low, high], "inverseBindMatrices": gltf.accessor(inverse.reshape(2, 16))}]
    gltf.node(mesh=gltf.mesh(attributes, CARD_FACES), skin=0, translation=[100, 100, 100])
    np.testing.assert_allclose(bounds(tmp_path, gltf), [[0, 0, 0], [1, 5, 0]], atol=1e-6)


def test_a_joint_that_is_not_there_is_one_clear_line(tmp_path):
    gltf = Gltf()
    attributes = {"POSITION": CARD, "JOINTS_0": np.full((4, 4), 7, "<u1"), "WEIGHTS_0": np.ones((4, 4), "<f4")}
    gltf.tree["skins"] = [{"joints": [0]}]
    gltf.node(mesh=gltf.mesh(attributes, CARD_FACES), skin=0)
    with pytest.raises(ToolkitError, match="hangs on a joint that its skin does not have"):
        read_mesh(gltf.write(tmp_path))


def test_a_node_within_itself_counts_once(tmp_path):
    gltf = Gltf()
    number = gltf.card()
    gltf.tree["nodes"][number]["children"] = [number]
    assert len(read_mesh(gltf.write(tmp_path)).faces) == 2


def test_a_part_without_area_does_not_spoil_the_others(tmp_path):
    gltf = Gltf()
    gltf.card()
    gltf.node(mesh=gltf.mesh({"POSITION": np.zeros((3, 3), "<f4")}))
    assert len(read_mesh(gltf.write(tmp_path)).faces) == 2
