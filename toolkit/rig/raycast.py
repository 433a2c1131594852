"""The rig's renderer: exact ray-cast buffers (Open3D's Embree scene), light baked once, shading per frame in float.

Per frame only what the camera changes is worked out: which surface each pixel sees, its texture at the right level of
detail, and the gloss. Silhouettes and the printed sheet get four samples a pixel.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from toolkit.objects.mesh import Mesh, make_ray_scene
from toolkit.rig import shading
from toolkit.rig.backdrop import Backdrop
from toolkit.rig.camera import Camera, pixel_rays, project
from toolkit.rig.lighting import FULL_DETAIL, BakeDetail, bake_lighting, read_samples
from toolkit.rig.linear_view import LinearView
from toolkit.rig.mount import PAPER_MATERIAL
from toolkit.rig.studio import Studio
from toolkit.rig.textures import sample_pyramid, texture_pyramid

SUBPIXELS = np.array([[-0.125, -0.375], [0.375, -0.125], [0.125, 0.375], [-0.375, 0.125]], np.float32)
"""Offsets of the four samples: a rotated grid, which resolves near-horizontal and near-vertical edges best."""

PARTS = 4
"""Pixels are worked on in so many parts at once; NumPy leaves the other cores free while it works on one."""


@lru_cache(maxsize=1)
def _workers() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(PARTS, "rig")


@dataclass(frozen=True)
class _RayHits:
    """What rays meet. Arrays of one row per ray; where nothing is hit, colour 0, material -1, normal 0, depth inf.

    `gain`, `uv` and `lod` are there when a texture was left out: by how much its colour counts (0 where a ray does not
    meet it), where on it, and the base-2 logarithm of its texels per pixel.
    """

    colour: np.ndarray
    material: np.ndarray
    normal: np.ndarray
    depth: np.ndarray
    gain: np.ndarray
    uv: np.ndarray
    lod: np.ndarray


@dataclass(frozen=True)
class _Traced:
    """The part of a picture that can show the object: its pixels, and the samples of those that need four."""

    region: tuple[int, int, int, int]
    seen: _RayHits
    refine: np.ndarray
    fine: _RayHits


class RaycastRenderer:
    """Renders one object in one studio from any camera."""

    def __init__(self, mesh: Mesh, studio: Studio, detail: BakeDetail = FULL_DETAIL) -> None:
        self._mesh, self._studio = mesh, studio
        self._scene = make_ray_scene(mesh)
        self._outline = _hull_vertices(mesh.vertices)
        self._corner_normals = mesh.normals[mesh.faces]
        self._corner_uv = mesh.uv[mesh.faces]
        corners = mesh.vertices[mesh.faces]
        self._textures, self._texture_of_material = _distinct_textures(mesh)
        self._texel_density = _texel_density(mesh, self._textures, self._texture_of_material)
        self._roughness = np.array([m.roughness for m in mesh.materials], np.float32)
        self._metallic = np.array([m.metallic for m in mesh.materials], np.float32)
        self._is_paper = np.array([m.name == PAPER_MATERIAL for m in mesh.materials])
        self._lighting = bake_lighting(
            self._scene, corners, self._corner_normals, self._mean_colour(), studio, detail=detail
        )
        self._backdrop = Backdrop(studio, self._lighting)

    def render(self, camera: Camera, T_world_camera: np.ndarray) -> np.ndarray:
        """(height, width, 3) float32 linear light times the studio's exposure; not clipped."""
        waiting = _workers().submit(self._backdrop.render, camera, T_world_camera)
        frame = self._look(camera, T_world_camera)
        picture = waiting.result()
        if frame is not None:
            left, top, right, bottom = frame.region
            behind = picture[top:bottom, left:right].reshape(-1, 3)
            seen, fine = frame.seen, frame.fine
            colour = np.where(seen.material[:, None] < 0, behind, seen.colour)
            missed = (fine.material < 0).reshape(len(SUBPIXELS), -1).mean(axis=0, dtype=np.float32)
            mean = fine.colour.reshape(len(SUBPIXELS), -1, 3).mean(axis=0)
            colour[frame.refine] = mean + behind[frame.refine] * missed[:, None]
            picture[top:bottom, left:right] = colour.reshape(bottom - top, right - left, 3)
        return picture * np.float32(self._studio.exposure)

    def render_linear(self, camera: Camera, T_world_camera: np.ndarray, texture: np.ndarray) -> LinearView:
        """What `render` shows, linear in the colours of those of the mesh's materials that share a texture.

        Args:
            camera, T_world_camera: as for `render`.
            texture: the one of the materials' textures (the array itself) that is left out; its materials must not be
                metallic, for their gloss has their colour. What bounces off the table has the texture's mean colour.
        """
        left_out = np.array([m.texture is texture for m in self._mesh.materials])
        waiting = _workers().submit(self._backdrop.render, camera, T_world_camera)
        frame = self._look(camera, T_world_camera, left_out)
        exposure = np.float32(self._studio.exposure)
        behind = waiting.result() * exposure
        return LinearView.of_nothing(behind) if frame is None else _assemble(frame, behind, exposure)

    def _look(self, camera: Camera, T_world_camera: np.ndarray, left_out: np.ndarray | None = None) -> _Traced | None:
        """Trace the pixels that can show the object; None where none can."""
        left, top, right, bottom = self._region(camera, T_world_camera)
        if right <= left or bottom <= top:
            return None
        x, y = np.meshgrid(np.arange(left, right, dtype=np.float32), np.arange(top, bottom, dtype=np.float32))
        pixels = np.stack([x, y], axis=-1).reshape(-1, 2) + np.float32(0.5)
        seen = self._trace(camera, T_world_camera, pixels, left_out)
        refine = np.flatnonzero(self._needs_samples(seen, (bottom - top, right - left)))
        samples = (pixels[refine] + SUBPIXELS[:, None]).reshape(-1, 2)
        fine = self._trace(camera, T_world_camera, samples, left_out)
        return _Traced((left, top, right, bottom), seen, refine, fine)

    def buffers(self, camera: Camera, T_world_camera: np.ndarray) -> dict[str, np.ndarray]:
        """Exact float buffers at pixel centres: depth along the ray, mm (inf: none), material (-1: none), uv (NaN)."""
        y, x = np.mgrid[: camera.height, : camera.width].astype(np.float32) + np.float32(0.5)
        pixels = np.stack([x, y], axis=-1).reshape(-1, 2)
        hits = self._cast(pixel_rays(camera, T_world_camera, pixels))
        shape = (camera.height, camera.width)
        seen = np.isfinite(hits["t_hit"])
        triangle, uv = hits["primitive_ids"][seen].astype(np.int64), hits["primitive_uvs"][seen]
        material = np.full(seen.shape, -1, np.int32)
        material[seen] = self._mesh.face_material[triangle]
        texture_uv = np.full((*seen.shape, 2), np.nan, np.float32)
        texture_uv[seen] = shading.interpolate(self._corner_uv[triangle], uv)
        return {
            "depth": hits["t_hit"].reshape(shape), "material": material.reshape(shape),
            "uv": texture_uv.reshape(*shape, 2),
        }  # fmt: skip

    def _cast(self, rays: np.ndarray) -> dict[str, np.ndarray]:
        import open3d as o3d

        found = self._scene.cast_rays(o3d.core.Tensor(rays))
        return {key: found[key].numpy() for key in ("t_hit", "primitive_ids", "primitive_uvs")}

    def _region(self, camera: Camera, T_world_camera: np.ndarray) -> tuple[int, int, int, int]:
        """Left, top, right, bottom of the pixels that can show the object."""
        low, high = self._mesh.bounds
        box = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        pixels, depth = project(camera, T_world_camera, self._outline)
        if (project(camera, T_world_camera, box)[1] <= 1).any():
            return 0, 0, camera.width, camera.height
        margin = 6 + 0.01 * camera.width
        left, top = np.floor(pixels[depth > 0].min(axis=0) - margin).astype(int)
        right, bottom = np.ceil(pixels[depth > 0].max(axis=0) + margin).astype(int)
        return max(left, 0), max(top, 0), min(right, camera.width), min(bottom, camera.height)

    def _trace(
        self, camera: Camera, T_world_camera: np.ndarray, pixels: np.ndarray, left_out: np.ndarray | None
    ) -> _RayHits:
        parts = list(
            _workers().map(
                lambda part: self._trace_part(camera, T_world_camera, part, left_out), np.array_split(pixels, PARTS)
            )
        )
        return _RayHits(
            *(np.concatenate([getattr(part, field) for part in parts]) for field in _RayHits.__dataclass_fields__)
        )

    def _trace_part(
        self, camera: Camera, T_world_camera: np.ndarray, pixels: np.ndarray, left_out: np.ndarray | None
    ) -> _RayHits:
        rays = pixel_rays(camera, T_world_camera, pixels)
        hits = self._cast(rays)
        count = 0 if left_out is None else len(pixels)
        seen = _RayHits(
            colour=np.zeros((len(pixels), 3), np.float32), material=np.full(len(pixels), -1, np.int32),
            normal=np.zeros((len(pixels), 3), np.float32), depth=hits["t_hit"],
            gain=np.zeros((count, 3), np.float32), uv=np.zeros((count, 2), np.float32),
            lod=np.zeros(count, np.float32),
        )  # fmt: skip
        if np.isfinite(seen.depth).any():
            self._shade(seen, rays, hits, np.float32(1 / camera.fx), left_out)
        return seen

    def _shade(
        self, seen: _RayHits, rays: np.ndarray, hits: dict[str, np.ndarray], pixel_angle: np.float32,
        left_out: np.ndarray | None,
    ) -> None:  # fmt: skip
        """Fill in the rows of `seen` whose rays hit something."""
        found = np.flatnonzero(np.isfinite(seen.depth))
        triangle, uv = hits["primitive_ids"][found].astype(np.int64), hits["primitive_uvs"][found]
        origin, direction, depth = rays[found, :3], rays[found, 3:], seen.depth[found]
        normal = shading.interpolate(self._corner_normals[triangle], uv)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        cosine = -np.einsum("ij,ij->i", normal, direction)
        away = cosine < 0
        normal[away] *= -1
        cosine = np.abs(cosine)
        material = self._mesh.face_material[triangle]
        texture_uv = shading.interpolate(self._corner_uv[triangle], uv)
        footprint_mm = depth * pixel_angle / np.sqrt(np.maximum(cosine, 0.1))
        lod = np.log2(np.maximum(footprint_mm * self._texel_density[triangle], 1e-6))
        albedo = self._albedo(material, texture_uv, lod)
        light = read_samples(self._lighting.grid, self._lighting.stored, triangle, uv)
        roughness, metallic = self._roughness[material], self._metallic[material]
        gain = light[:, :3] * ((1 - metallic) / np.float32(np.pi))[:, None]
        if left_out is not None:
            chosen = left_out[material]
            albedo[chosen] = 0
            seen.gain[found], seen.uv[found], seen.lod[found] = gain * chosen[:, None], texture_uv, lod
        points = origin + depth[:, None] * direction
        surface = shading.SurfacePoints(
            points=points, direction=direction, normal=normal, cosine=cosine, albedo=albedo, roughness=roughness,
            metallic=metallic,
        )  # fmt: skip
        colour = albedo * gain
        colour += shading.gloss(surface, light[:, 3], light[:, 4], self._studio.key, self._backdrop.reflect)
        seen.colour[found], seen.normal[found], seen.material[found] = colour, normal, material

    def _albedo(self, material: np.ndarray, uv: np.ndarray, lod: np.ndarray) -> np.ndarray:
        texture = self._texture_of_material[material]
        if len(self._textures) == 1:
            return sample_pyramid(self._textures[0], uv[:, 0], uv[:, 1], lod)
        albedo = np.empty((len(material), 3), np.float32)
        for index, levels in enumerate(self._textures):
            chosen = np.flatnonzero(texture == index)
            if len(chosen):
                albedo[chosen] = sample_pyramid(levels, uv[chosen, 0], uv[chosen, 1], lod[chosen])
        return albedo

    def _needs_samples(self, seen: _RayHits, shape: tuple[int, int]) -> np.ndarray:
        """Pixels whose neighbours show another material, a jump in depth or a crease; and those on printed paper."""
        material, normal = seen.material.reshape(shape), seen.normal.reshape(*shape, 3)
        depth = seen.depth.reshape(shape)
        depth = np.where(np.isfinite(depth), depth, 0)
        edge = np.zeros(shape, bool)
        for a, b in (((slice(1, None), slice(None)), (slice(-1), slice(None))),
                     ((slice(None), slice(1, None)), (slice(None), slice(-1)))):  # fmt: skip
            differ = material[a] != material[b]
            differ |= np.abs(depth[a] - depth[b]) > 0.02 * depth[a]
            differ |= np.einsum("ijk,ijk->ij", normal[a], normal[b]) < 0.75 * (material[a] >= 0)
            edge[a] |= differ
            edge[b] |= differ
        return (edge | (self._is_paper[material] & (material >= 0))).reshape(-1)

    def _mean_colour(self) -> np.ndarray:
        """(3,) linear colour of the object, averaged over its triangles by area."""
        corners = self._mesh.vertices[self._mesh.faces]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        middle = self._corner_uv.mean(axis=1)
        albedo = self._albedo(self._mesh.face_material, middle, np.zeros(len(middle), np.float32))
        return (albedo * area[:, None]).sum(axis=0) / max(float(area.sum()), 1e-9)


def _assemble(frame: _Traced, behind: np.ndarray, exposure: np.float32) -> LinearView:
    """The parts of a picture: interior pixels count one sample, refined ones the mean of theirs."""
    left, top, right, bottom = frame.region
    seen, fine, refine = frame.seen, frame.fine, frame.refine
    once = np.ones(len(seen.material), bool)
    once[refine] = False
    dark, hit = seen.colour, (seen.material >= 0).astype(np.float32)
    dark[refine] = fine.colour.reshape(len(SUBPIXELS), -1, 3).mean(axis=0)
    hit[refine] = (fine.material >= 0).reshape(len(SUBPIXELS), -1).mean(axis=0)
    coarse = np.flatnonzero(once & (seen.gain > 0).any(axis=1))
    split = np.flatnonzero((fine.gain > 0).any(axis=1))
    row, column = np.divmod(np.concatenate([coarse, np.tile(refine, len(SUBPIXELS))[split]]), right - left)
    full, cover = np.zeros_like(behind), np.zeros(behind.shape[:2], np.float32)
    full[top:bottom, left:right] = dark.reshape(bottom - top, right - left, 3) * exposure
    cover[top:bottom, left:right] = hit.reshape(bottom - top, right - left)
    share = np.float32(1 / len(SUBPIXELS))
    return LinearView(
        behind=behind, dark=full, coverage=cover,
        pixel=((row + top) * behind.shape[1] + column + left).astype(np.int32),
        uv=np.concatenate([seen.uv[coarse], fine.uv[split]]),
        lod=np.concatenate([seen.lod[coarse], fine.lod[split]]),
        gain=np.concatenate([seen.gain[coarse], fine.gain[split] * share]) * exposure,
    )  # fmt: skip


def _hull_vertices(vertices: np.ndarray) -> np.ndarray:
    """(k, 3) the vertices of the convex hull, which bound every picture of the mesh; all of them where it is flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return vertices[ConvexHull(vertices).vertices]
    except QhullError:
        return vertices


def _distinct_textures(mesh: Mesh) -> tuple[list[list[np.ndarray]], np.ndarray]:
    """One pyramid per distinct texture array, and which one each material uses."""
    known: dict[int, int] = {}
    pyramids: list[list[np.ndarray]] = []
    index: list[int] = []
    for material in mesh.materials:
        if id(material.texture) not in known:
            known[id(material.texture)] = len(pyramids)
            pyramids.append(texture_pyramid(material.texture))
        index.append(known[id(material.texture)])
    return pyramids, np.array(index)


def _texel_density(mesh: Mesh, textures: list[list[np.ndarray]], texture_of_material: np.ndarray) -> np.ndarray:
    """(m,) texels per millimetre of each triangle."""
    corners, corner_uv = mesh.vertices[mesh.faces], mesh.uv[mesh.faces]

    def doubled_area(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])

    surface = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chart = doubled_area(corner_uv[:, 1] - corner_uv[:, 0], corner_uv[:, 2] - corner_uv[:, 0])
    texels = np.array([levels[0].shape[0] * levels[0].shape[1] for levels in textures])[texture_of_material]
    return np.sqrt(chart * texels[mesh.face_material] / np.maximum(surface, 1e-12)).astype(np.float32)
