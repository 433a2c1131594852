"""Meshes for other programs: GLB, in metres with y up, as glTF has it."""

from io import BytesIO

import numpy as np
from PIL import Image

from toolkit.objects.mesh import Mesh

MM_PER_M = 1000.0


def to_glb(mesh: Mesh, name: str) -> bytes:
    """A binary glTF with one primitive per material, textures embedded."""
    import trimesh

    T_gltf_world = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], float)  # front +x -> +z, left +y -> +x, up +z -> +y
    scene = trimesh.Scene(base_frame=name)
    for index, material in enumerate(mesh.materials):
        faces = mesh.faces[mesh.face_material == index]
        if not len(faces):
            continue
        used, inverse = np.unique(faces, return_inverse=True)
        look = trimesh.visual.material.PBRMaterial(
            name=material.name, baseColorTexture=_png_image(material.texture), metallicFactor=float(material.metallic),
            roughnessFactor=float(material.roughness),
        )  # fmt: skip
        piece = trimesh.Trimesh(
            vertices=mesh.vertices[used] @ T_gltf_world.T / MM_PER_M, faces=inverse.reshape(-1, 3),
            vertex_normals=mesh.normals[used] @ T_gltf_world.T,
            visual=trimesh.visual.TextureVisuals(uv=mesh.uv[used], material=look), process=False,
        )  # fmt: skip
        unique = f"{material.name}-{index}"  # of two nodes with one name, trimesh keeps the last
        scene.add_geometry(piece, node_name=unique, geom_name=unique)
    return scene.export(file_type="glb", include_normals=True)


def _png_image(texture: np.ndarray) -> Image.Image:
    """A PIL image that the exporter embeds as PNG."""
    buffer = BytesIO()
    Image.fromarray(texture).save(buffer, "PNG")
    return Image.open(buffer)
