"""Places of a glTF's meshes: the nodes of its scene, their transforms, instances and joints."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolkit.objects.gltf.accessors import normalise, read_accessor
from toolkit.objects.gltf.document import DamagedGltf, Document, extension

INSTANCES = "EXT_mesh_gpu_instancing"


@dataclass(frozen=True)
class PlacedMesh:
    """A mesh of a node, both JSON, with (4, 4) its transform, or with (j, 4, 4) those of a skin in its default pose."""

    node: dict[str, Any]
    mesh: dict[str, Any]
    T_scene_mesh: np.ndarray
    T_scene_joints: np.ndarray | None = None


def place_meshes(document: Document) -> Iterator[PlacedMesh]:
    """Yield the meshes of the default scene, else of the first, else of all nodes; each node counts once.

    Nodes come last child first: the order decides meshes' hashes.
    """
    placed = _place_nodes(document)
    for index, T_scene_node in placed.items():
        node = document.row("nodes", index)
        if "mesh" not in node:
            continue
        mesh = document.row("meshes", node["mesh"])
        # a skin's joints place the mesh; its own node does not count
        if "skin" in node:
            yield PlacedMesh(node, mesh, T_scene_node, _place_joints(document, node["skin"], placed))
            continue
        for T_node_instance in _instances(document, node):
            yield PlacedMesh(node, mesh, T_scene_node if T_node_instance is None else T_scene_node @ T_node_instance)


def _place_nodes(document: Document) -> dict[int, np.ndarray]:
    """Number of each node of the scene -> (4, 4) transform to the scene."""
    nodes, scenes = document.rows("nodes"), document.rows("scenes")
    # a file without scenes shows all nodes that no other holds
    if scenes:
        roots = document.row("scenes", document.tree.get("scene", 0)).get("nodes", [])
    else:
        inner = {child for node in nodes for child in _children(node)}
        roots = [index for index in range(len(nodes)) if index not in inner]
    placed: dict[int, np.ndarray] = {}
    # a stack, not recursion: files may nest nodes deeply
    waiting: list[tuple[int, np.ndarray]] = [(root, np.eye(4)) for root in roots]
    while waiting:
        index, T_scene_parent = waiting.pop()
        if index in placed:  # a node has a single parent; a circle would never end
            continue
        node = document.row("nodes", index)
        if (extension(node, "KHR_node_visibility") or {}).get("visible", True) is False:
            continue
        T_scene_node = T_scene_parent @ local_transform(node)
        placed[index] = T_scene_node
        waiting += [(child, T_scene_node) for child in _children(node)]
    return placed


def _children(node: dict[str, Any]) -> list[int]:
    found = node.get("children", [])
    if not isinstance(found, list) or not all(isinstance(child, int) for child in found):
        raise DamagedGltf("a node's children are no list of numbers")
    return found


def local_transform(node: dict[str, Any]) -> np.ndarray:
    """(4, 4) from a node to its parent."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T  # column by column
    # translation · rotation · scale, as the specification orders them
    matrix = np.eye(4)
    if "translation" in node:
        matrix[:3, 3] = _numbers(node["translation"], 3)
    if "rotation" in node:
        from trimesh.transformations import quaternion_matrix

        matrix = matrix @ quaternion_matrix(_numbers(node["rotation"], 4)[[3, 0, 1, 2]])  # glTF has w last
    if "scale" in node:
        matrix = matrix @ np.diag([*_numbers(node["scale"], 3), 1.0])
    return matrix


def _numbers(found: Any, count: int) -> np.ndarray:
    return np.array(found, np.float64).reshape(count)


def _instances(document: Document, node: dict[str, Any]) -> Iterator[np.ndarray | None]:
    """Yield transforms from copies of a node's mesh to the node; None for the mesh itself."""
    found = extension(node, INSTANCES)
    if found is None:
        yield None
        return
    names = {"TRANSLATION": "translation", "ROTATION": "rotation", "SCALE": "scale"}
    columns = {
        name: normalise(read_accessor(document, found["attributes"][attribute]))
        for attribute, name in names.items()
        if attribute in found["attributes"]
    }
    # the shortest column decides, as instances need all of theirs
    for k in range(min((len(column) for column in columns.values()), default=0)):
        yield local_transform({name: column[k] for name, column in columns.items()})


def _place_joints(document: Document, index: Any, placed: dict[int, np.ndarray]) -> np.ndarray:
    skin = document.row("skins", index)
    T_scene_joints = np.stack([placed.get(joint, np.eye(4)) for joint in skin["joints"]])
    if "inverseBindMatrices" not in skin:
        return T_scene_joints
    inverse = read_accessor(document, skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
    if len(inverse) < len(T_scene_joints):
        raise DamagedGltf(f"skin {index} has fewer matrices than joints")
    # joints move from their rest, which the inverse matrices undo
    return T_scene_joints @ inverse[: len(T_scene_joints)].astype(np.float64)
