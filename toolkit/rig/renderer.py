"""The protocol of renderers, and the geometry that all of them share."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from functools import cached_property

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import Mesh
from toolkit.rig.bake_cache import place_unlit
from toolkit.rig.camera import Camera, orbit_direction
from toolkit.rig.kernel.frame import NOTHING, Hits, Samples
from toolkit.rig.kernel.scene import CameraView, as_rotation, as_triple
from toolkit.rig.scene import AT_ORIGIN, Scene, Stand
from toolkit.rig.shading import LinearView
from toolkit.rig.trace import CENTRE, Tracer

FARTHEST = 1e9
"""Coordinates of a camera at most; float32 holds them to some tens of units."""


class Renderer(ABC):
    """An object in a scene, seen from any camera.

    Light is the renderer's own; buffers are exact and the same in all. To add a renderer, derive a class, and name it
    in the table of `toolkit.rig.renderers`:

        class FlatRenderer(Renderer):
            def render(self, camera, T_world_camera):
                seen = self.buffers(camera, T_world_camera)["material"] >= 0
                return seen[..., None].repeat(3, axis=2).astype(np.float32)
    """

    def __init__(self, mesh: Mesh, scene: Scene, stand: Stand = AT_ORIGIN) -> None:
        """Keep what is rendered: a mesh in its own frame, on a stand in a scene."""
        self._mesh, self._scene, self._stand = mesh, scene, stand

    @abstractmethod
    def render(self, camera: Camera, T_world_camera: np.ndarray) -> np.ndarray:
        """(height, width, 3) float32 linear light times the scene's exposure, 1 is white; not clipped."""

    def render_many(self, views: Iterable[tuple[Camera, np.ndarray]]) -> Iterator[np.ndarray]:
        """`render` of each (camera, `T_world_camera`), in order; the same pictures, faster if there are cores."""
        return (self.render(*view) for view in views)

    def render_with_depth(self, camera: Camera, T_world_camera: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """`render`, and `depth`, `mesh` and `face` of `buffers`."""
        found = self.buffers(camera, T_world_camera)
        return self.render(camera, T_world_camera), {name: found[name] for name in ("depth", "mesh", "face")}

    def render_linear(self, camera: Camera, T_world_camera: np.ndarray, texture: np.ndarray) -> LinearView:
        """What `render` shows, linear in the colours of those of the mesh's materials that share a texture.

        Raises:
            ToolkitError: the renderer has no linear views.
        """
        raise ToolkitError(f"{type(self).__name__} has no views to train a texture on: use the renderer raycast")

    def render_linear_many(
        self, camera: Camera, poses: Iterable[np.ndarray], texture: np.ndarray
    ) -> Iterator[LinearView]:
        """`render_linear` from each pose, in order."""
        return (self.render_linear(camera, pose, texture) for pose in poses)

    @cached_property
    def outline(self) -> np.ndarray:
        """(k, 3) points in the world that bound every picture of the object."""
        return self._stand.to_world(self._tracer.body.shape.outline)

    def buffers(self, camera: Camera, T_world_camera: np.ndarray) -> dict[str, np.ndarray]:
        """Exact buffers (h, w) at pixel centres.

        Returns:
            `depth` along the ray, in the mesh's units (inf: nothing is met); `material` of the object (-1: it is not
            seen) and `uv` (h, w, 2) on it (NaN); `mesh`: 0 the object, 1 its surroundings, 255 neither; `face` of
            that mesh.
        """
        shape = camera.height, camera.width
        pixels = np.arange(camera.height * camera.width, dtype=np.int32)
        samples = Samples(0, 0, camera.width, camera.height, pixels, CENTRE)
        hits = self._tracer.see(view_from(camera, T_world_camera), samples, np.ones(len(pixels), bool))
        seen = (hits.face != NOTHING) & (hits.mesh == 0)
        face, weights = hits.face[seen].astype(np.int64), hits.uv[seen]
        material = np.full(seen.shape, -1, np.int32)
        material[seen] = self._mesh.face_material[face]
        # barycentric: the hit's weights are those of corners 1 and 2, corner 0 has what is left
        corner_uv = self._mesh.uv[self._mesh.faces[face]]
        texture_uv = np.full((*seen.shape, 2), np.nan, np.float32)
        u, v = weights[:, :1], weights[:, 1:]
        texture_uv[seen] = corner_uv[:, 0] * (1 - u - v) + corner_uv[:, 1] * u + corner_uv[:, 2] * v
        return {
            **name_hits(hits, shape), "material": material.reshape(shape), "uv": texture_uv.reshape(*shape, 2),
        }  # fmt: skip

    @cached_property
    def _tracer(self) -> Tracer:
        """Finds what is seen. A renderer that lights the meshes itself puts its own in this place."""
        around, key = self._scene.surroundings, self._scene.key
        others = None if around is None else place_unlit(around, AT_ORIGIN, 1)
        direction = as_triple(orbit_direction(key.azimuth_deg, key.elevation_deg))
        return Tracer(place_unlit(self._mesh, self._stand, 0), others, direction)

    @cached_property
    def _mesh_in_world(self) -> Mesh:
        return self._mesh if self._stand == AT_ORIGIN else self._stand.put(self._mesh)


def name_hits(hits: Hits, shape: tuple[int, int]) -> dict[str, np.ndarray]:
    """`depth`, `mesh` and `face` of `Renderer.buffers`, from the first hits at the centres of all pixels."""
    met = np.where(hits.face == NOTHING, np.uint8(255), hits.mesh)
    found = {"depth": hits.distance, "mesh": met, "face": hits.face}
    return {name: values.reshape(shape) for name, values in found.items()}


def view_from(camera: Camera, T_world_camera: np.ndarray) -> CameraView:
    """Return a camera in its place, for the kernel; raises a `ToolkitError` if the camera stands nowhere."""
    pose = np.asarray(T_world_camera, np.float64)
    if not np.isfinite(pose).all() or np.abs(pose[:3, 3]).max() > FARTHEST:
        raise ToolkitError(
            f"the camera stands at {pose[:3, 3].tolist()}: expected numbers within {FARTHEST:g}: check the pose"
        )
    return CameraView(
        rotation=as_rotation(pose[:3, :3]), origin=as_triple(pose[:3, 3]), fx=float(camera.fx), fy=float(camera.fy),
        cx=float(camera.cx), cy=float(camera.cy), width=camera.width, height=camera.height,
    )  # fmt: skip
