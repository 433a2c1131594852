"""A mesh that rays can be cast at."""

import numpy as np

from toolkit.objects.mesh import Mesh


def make_ray_scene(mesh: Mesh):
    """Open3D's ray-casting scene (Embree) of a mesh."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(np.ascontiguousarray(mesh.vertices, np.float32)),
        o3d.core.Tensor(np.ascontiguousarray(mesh.faces.astype(np.uint32))),
    )
    return scene
