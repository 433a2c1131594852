"""Triangles of a glTF's primitives: lists, strips and fans, morphed by their weights, bent by their skin."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from toolkit.objects.gltf.accessors import normalise, read_accessor
from toolkit.objects.gltf.compressed import DRACO, decode_draco
from toolkit.objects.gltf.document import DamagedGltf, Document, extension, rows
from toolkit.objects.gltf.nodes import PlacedMesh

TRIANGLES, STRIP, FAN = 4, 5, 6
MORPHED = ("POSITION", "TEXCOORD", "COLOR")
"""Attributes of morph targets that are read."""


@dataclass(frozen=True)
class Primitive:
    """A part of a mesh with a single material.

    Attributes:
        vertices: (n, 3) float64, in the scene's axes, metres.
        faces: (m, 3) int64, counter-clockwise seen from outside.
        uv: number of a set -> (n, 2), v down.
        colours: (n, 3) linear light, if any.
        alpha: (n,) alpha of the colours, unless all are 1.
        material: number of its material, if any.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: dict[int, np.ndarray]
    colours: np.ndarray | None
    alpha: np.ndarray | None
    material: Any


def read_primitive(document: Document, placed: PlacedMesh, primitive: dict[str, Any]) -> Primitive | None:
    """Read a primitive of a placed mesh; None for points and lines, or without positions.

    Raises:
        DamagedGltf: accessors of different lengths, or indices that do not make triangles.
    """
    # points and lines have no surface
    mode = primitive.get("mode", TRIANGLES)
    named = primitive.get("attributes")
    if mode not in (TRIANGLES, STRIP, FAN) or not isinstance(named, dict) or "POSITION" not in named:
        return None
    attributes, index = _read_attributes(document, primitive, named)
    attributes = _morph(document, placed, primitive, attributes)
    position = attributes.pop("POSITION")
    count = len(position)
    if position.shape[1] != 3 or any(len(values) != count for values in attributes.values()):
        raise DamagedGltf("attributes of a mesh have different lengths")
    if extension(primitive, DRACO) is not None:
        mode = TRIANGLES  # whatever they were before
    # positions are decoded and morphed in the mesh's frame; bones or nodes place them in the scene
    faces = _triangles(np.arange(count) if index is None else index.astype(np.int64), mode)
    vertices, is_mirrored = _place(position.astype(np.float64), placed, attributes)
    if faces.size and (faces.min() < 0 or faces.max() >= count):
        raise DamagedGltf(f"a face names vertex {faces.max()}, the mesh has {count}")
    colours, alpha = _read_colours(attributes)
    return Primitive(
        vertices,
        # a mirror turns triangles inside out, so that they are turned back
        faces[:, ::-1] if is_mirrored else faces,
        {int(name[9:]): uv[:, :2] for name, uv in attributes.items() if name[:9] == "TEXCOORD_" and name[9:].isdigit()},
        colours,
        alpha,
        primitive.get("material"),
    )


def _read_colours(attributes: dict[str, np.ndarray]) -> tuple[np.ndarray | None, np.ndarray | None]:
    """(n, 3) linear light of the vertices, and (n,) alpha unless all are 1; None without colours."""
    if "COLOR_0" not in attributes:
        return None, None
    colours = normalise(attributes["COLOR_0"])
    if not np.isfinite(colours).all():
        raise DamagedGltf("COLOR_0 has colours that are NaN or infinite")
    alpha = colours[:, 3].clip(0, 1) if colours.shape[1] > 3 else None
    return colours[:, :3], None if alpha is None or (alpha == 1).all() else alpha


def is_read(name: str) -> bool:
    """Whether an attribute is read; normals and tangents are computed again."""
    return name in ("POSITION", "COLOR_0") or name.startswith(("TEXCOORD_", "JOINTS_", "WEIGHTS_"))


def _read_attributes(
    document: Document, primitive: dict[str, Any], named: dict[str, Any]
) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Return (n, k) values by name, and the (i,) indices, if there are any."""
    # compressed geometry stands in the extension; accessors only describe it
    draco = extension(primitive, DRACO)
    if draco is not None:
        decoded, faces = decode_draco(document, draco)
        attributes = {name: values for name, values in decoded.items() if is_read(name)}
        for name, values in attributes.items():  # the accessor decides whether integers are normalised
            if document.row("accessors", named.get(name)).get("normalized") is True:
                attributes[name] = normalise(values)
        others = {name: at for name, at in named.items() if name not in decoded}
        attributes |= {name: read_accessor(document, at) for name, at in others.items() if is_read(name)}
        return attributes, faces.reshape(-1)
    attributes = {name: read_accessor(document, at) for name, at in named.items() if is_read(name)}
    index = read_accessor(document, primitive["indices"])[:, 0] if "indices" in primitive else None
    return attributes, index


def _morph(
    document: Document, placed: PlacedMesh, primitive: dict[str, Any], attributes: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Move attributes by the targets, with the weights of the node, else of the mesh."""
    weights = placed.node.get("weights", placed.mesh.get("weights", []))
    for weight, target in zip(weights, rows(primitive, "targets"), strict=False):
        for name, index in target.items():
            if weight and name in attributes and name.startswith(MORPHED):
                attributes[name] = attributes[name] + weight * read_accessor(document, index)
    return attributes


def _triangles(index: np.ndarray, mode: int) -> np.ndarray:
    """(m, 3) corners of the triangles that (i,) indices draw."""
    if mode == TRIANGLES:
        if len(index) % 3:
            raise DamagedGltf(f"{len(index)} indices make no triangles")
        return index.reshape(-1, 3)
    if len(index) < 3:
        return np.zeros((0, 3), np.int64)
    if mode == FAN:
        return np.stack([np.full(len(index) - 2, index[0]), index[1:-1], index[2:]], axis=1)
    faces = np.stack([index[:-2], index[1:-1], index[2:]], axis=1)
    faces[1::2] = faces[1::2, ::-1]  # each second triangle runs the other way
    return faces


def _place(position: np.ndarray, placed: PlacedMesh, attributes: dict[str, np.ndarray]) -> tuple[np.ndarray, bool]:
    """Return vertices in the scene's axes, and whether a mirror turned their triangles inside out."""
    from trimesh import transform_points

    if placed.T_scene_joints is not None and "JOINTS_0" in attributes:
        return _bend(position, placed.T_scene_joints, attributes), False
    # a mesh in its place already stays bit for bit as it is
    T_scene_mesh = placed.T_scene_mesh
    if np.allclose(T_scene_mesh, np.eye(4), rtol=0, atol=1e-8):
        return position, False
    return transform_points(position, T_scene_mesh), bool(np.linalg.det(T_scene_mesh[:3, :3]) < 0)


def _bend(position: np.ndarray, T_scene_joints: np.ndarray, attributes: dict[str, np.ndarray]) -> np.ndarray:
    """Linear blend skinning in the pose that the nodes state."""
    # a vertex may hang on more than four joints, in several sets
    sets = sorted(name[7:] for name in attributes if name.startswith("JOINTS_"))
    joints = np.concatenate([attributes[f"JOINTS_{k}"] for k in sets], axis=1).astype(np.int64)
    weights = np.concatenate([normalise(attributes[f"WEIGHTS_{k}"]) for k in sets], axis=1).astype(np.float64)
    if joints.shape != weights.shape or joints.max(initial=0) >= len(T_scene_joints):
        raise DamagedGltf("a vertex hangs on a joint that its skin does not have")
    # weights need not add up to 1 in the file
    total = weights.sum(axis=1, keepdims=True)
    weights = np.where(total > 0, weights / np.where(total > 0, total, 1), 0)
    bent = np.zeros_like(position)
    # each joint moves the vertex, and the weights mix the results
    for k in range(joints.shape[1]):
        T = T_scene_joints[joints[:, k]]
        bent += weights[:, k, None] * (np.einsum("nij,nj->ni", T[:, :3, :3], position) + T[:, :3, 3])
    return bent
