"""From a spec to a mesh on the table: built-in objects and the user's own files."""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import inside
from toolkit.objects.mesh import (
    Material,
    Mesh,
    check_mesh,
    hash_mesh,
    hash_shape,
    merge_meshes,
    mesh_from_corners,
    place_on_table,
)
from toolkit.objects.spec import BUILTIN_PREFIX, ObjectSpec, read_spec

if TYPE_CHECKING:
    import trimesh
    from trimesh.visual.material import PBRMaterial, SimpleMaterial

BUILTIN = ("racer", "warplane", "coffeepot", "eggnog")
SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")
PLAIN_COLOUR = (168, 170, 173)
"""sRGB of a mesh that comes without texture or colours."""


@dataclass(frozen=True)
class TableObject:
    """An object as the rig sees it: on the table, front to +x, in millimetres."""

    spec: ObjectSpec
    mesh: Mesh

    @property
    def name(self) -> str:
        """The object's name."""
        return self.spec.name

    @cached_property
    def mesh_sha256(self) -> str:
        """`hash_mesh` of its mesh."""
        return hash_mesh(self.mesh)

    @cached_property
    def shape_sha256(self) -> str:
        """`hash_shape` of its mesh."""
        return hash_shape(self.mesh)


def load_object(spec_file: Path) -> TableObject:
    """Read a spec and its mesh, turned upright, scaled to its length and placed on the table.

    Raises:
        ToolkitError: the spec or the mesh cannot be used; the message says why.
    """
    spec = read_spec(spec_file)
    if spec.mesh.startswith(BUILTIN_PREFIX):
        mesh = build_mesh(spec.mesh.removeprefix(BUILTIN_PREFIX))
    else:
        mesh = read_mesh(inside(Path(spec_file).parent, spec.mesh))
    mesh = turn_upright(mesh, spec.up, spec.front)
    return TableObject(spec, place_on_table(mesh, spec.length_mm))


@lru_cache(maxsize=8)
def build_mesh(name: str) -> Mesh:
    """Build one of the procedural objects."""
    if name not in BUILTIN:
        raise one_of("built-in mesh", name, list(BUILTIN))
    return import_module(f"toolkit.objects.shapes.{name}").build()


def read_mesh(path: Path, max_parts: int | None = None) -> Mesh:
    """Read a user's mesh: geometry, texture coordinates and base colours; a file without them is plain grey.

    Raises:
        ToolkitError: no such file, an unknown kind, unreadable, without faces, with vertices that are not finite, or in
            more parts than `max_parts`.
    """
    import trimesh

    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ToolkitError(
            f"{path}: cannot read a mesh from '{path.suffix}' files, expected one of {' '.join(SUFFIXES)}"
        )
    if not path.is_file():
        raise ToolkitError(f"{path}: no such mesh file: put it beside its spec, or mend 'mesh' in the spec")
    try:
        scene = trimesh.load_scene(path, process=False)
        parts = len(scene.graph.nodes_geometry)
        if max_parts is not None and parts > max_parts:
            raise ToolkitError(f"{path}: {parts} parts, expected at most {max_parts}: join them before the export")
        pieces = [piece for piece in scene.dump() if isinstance(piece, trimesh.Trimesh) and len(piece.faces)]
    except ToolkitError:
        raise
    except Exception as error:  # trimesh's readers raise whatever their format makes them
        raise ToolkitError(f"{path}: not a readable {path.suffix} mesh: {type(error).__name__}: {error}") from None
    if not pieces:
        raise ToolkitError(f"{path}: the mesh has no faces (a point cloud?): export it with triangles")
    return check_mesh(merge_meshes([_from_trimesh(piece, str(path)) for piece in pieces]), str(path))


def turn_upright(mesh: Mesh, up: str, front: str) -> Mesh:
    """Turn a mesh whose axes `up` and `front` are named (as '-y') so that up is +z and front +x.

    Raises:
        ToolkitError: both name the same axis.
    """
    x, z = _axis(front), _axis(up)
    if abs(x @ z) > 0.5:
        raise ToolkitError(f"an object's 'up' ({up}) and 'front' ({front}) must be different axes")
    T_world_mesh = np.stack([x, np.cross(z, x), z]).astype(np.float32)
    return replace(mesh, vertices=mesh.vertices @ T_world_mesh.T, normals=mesh.normals @ T_world_mesh.T)


def _axis(name: str) -> np.ndarray:
    axis = np.zeros(3)
    axis["xyz".index(name[-1])] = -1 if name.startswith("-") else 1
    return axis


def _from_trimesh(piece: "trimesh.Trimesh", source: str) -> Mesh:
    vertices, faces = np.asarray(piece.vertices, np.float32), np.asarray(piece.faces, np.int64)
    if not np.isfinite(vertices).all():
        bad = int((~np.isfinite(vertices)).any(axis=1).sum())
        raise ToolkitError(f"{source}: {bad} of {len(vertices)} vertices are NaN or infinite: repair the mesh")
    if faces.min() < 0 or faces.max() >= len(vertices):
        worst = faces.max() if faces.max() >= len(vertices) else faces.min()
        raise ToolkitError(f"{source}: a face names vertex {worst}, the mesh has {len(vertices)}: repair the mesh")
    corner_uv, material = _paint_of(piece, vertices, faces)
    # one position per place, so that smoothing crosses the seams that texture coordinates cut
    scale = max(float(np.ptp(vertices, axis=0).max()), 1e-9)
    _, first, inverse = np.unique(
        np.round(vertices / (scale * 1e-6)).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    welded = inverse.reshape(-1)[faces]
    real = (welded[:, 0] != welded[:, 1]) & (welded[:, 1] != welded[:, 2]) & (welded[:, 0] != welded[:, 2])
    if not real.any():
        raise ToolkitError(f"{source}: every face has zero area: expected an object with an extent")
    return mesh_from_corners(
        vertices[first], welded[real], corner_uv[real], np.zeros(int(real.sum()), np.int32), (material,)
    )


def _paint_of(piece: "trimesh.Trimesh", vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, Material]:
    """(m, 3, 2) texture coordinates of the corners, and the material: a texture, colours, or plain."""
    from trimesh.visual import ColorVisuals, TextureVisuals

    visual, uv = piece.visual, getattr(piece.visual, "uv", None)
    if isinstance(visual, TextureVisuals) and uv is not None and len(uv) == len(vertices) and np.isfinite(uv).all():
        return np.asarray(uv, np.float32)[faces], _material(visual.material)
    if isinstance(visual, ColorVisuals) and visual.kind in ("vertex", "face"):
        return _colours_as_texture(np.asarray(visual.face_colors)[:, :3])
    plain = Material("plain", _solid(PLAIN_COLOUR), roughness=0.45)
    return np.zeros((len(faces), 3, 2), np.float32), plain


def _solid(colour: tuple[int, int, int]) -> np.ndarray:
    return np.full((4, 4, 3), colour, np.uint8)


def _colours_as_texture(colours: np.ndarray) -> tuple[np.ndarray, Material]:
    """Colours (m, 3) of the faces become one texel for each that differs."""
    palette, index = np.unique(colours, axis=0, return_inverse=True)
    side = int(np.ceil(np.sqrt(len(palette))))
    texture = np.zeros((side * side, 3), np.uint8)
    texture[: len(palette)] = palette
    row, column = np.divmod(index.reshape(-1), side)
    texture = texture.reshape(side, side, 3).repeat(4, axis=0).repeat(4, axis=1)  # bilinear look-ups stay inside
    uv = np.stack([(column + 0.5) / side, 1 - (row + 0.5) / side], axis=1)
    return np.repeat(uv[:, None], 3, axis=1).astype(np.float32), Material("colours", texture)


def _material(material: "PBRMaterial | SimpleMaterial") -> Material:
    """Base colour, roughness and metalness of a trimesh material."""
    from trimesh.visual.material import SimpleMaterial

    pbr = material.to_pbr() if hasattr(material, "to_pbr") else material
    image, factor = pbr.baseColorTexture, pbr.baseColorFactor
    if isinstance(material, SimpleMaterial) and (
        image is not None or tuple(np.asarray(material.diffuse)[:3]) == (102, 102, 102)
    ):
        factor = None  # trimesh's own default grey, not the file's
    tint = np.ones(3) if factor is None else np.asarray(factor, float)[:3] / (255 if np.max(factor) > 1 else 1)
    texture = _solid((255, 255, 255)) if image is None else np.asarray(image.convert("RGB"))
    if image is None and factor is None:
        texture = _solid(PLAIN_COLOUR)
    return Material(
        pbr.name or "material",
        (texture * tint).clip(0, 255).astype(np.uint8),
        roughness=0.6 if pbr.roughnessFactor is None else float(pbr.roughnessFactor),
        metallic=0.0 if pbr.metallicFactor is None else float(pbr.metallicFactor),
    )
