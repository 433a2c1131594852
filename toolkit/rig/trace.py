"""First hits of a camera's rays: by rays, or by drawing a mesh that has few triangles for the picture."""

from dataclasses import dataclass

import numpy as np

from toolkit.objects.mesh import load_open3d
from toolkit.rig.kernel.frame import (
    NOTHING,
    SUBPIXELS,
    Hits,
    Samples,
    TracedRegion,
    describe_hits,
    fill_key_rays,
    fill_rays,
    mark_edges,
    move_rays,
    take_nearer,
)
from toolkit.rig.kernel.raster import draw_triangles, project_corners
from toolkit.rig.kernel.scene import CameraView, LitMesh
from toolkit.rig.kernel.textures import Colour
from toolkit.rig.lighting import Shape

CENTRE = np.zeros((1, 2))
FACES_PER_SAMPLE = 5
"""A mesh of more faces than this for each sample is seen by rays, whose cost hardly grows with it."""


@dataclass(frozen=True)
class LitBody:
    """A mesh in its place."""

    shape: Shape  # its triangles
    lit: LitMesh  # the same with their light and paint
    is_moved: bool  # whether it stands elsewhere than its own frame says
    number: int  # of `Hits.mesh`

    def cast(self, rays: np.ndarray) -> Hits:
        """First hits of rays (n, 6) in the world; frames are what is spread over the cores."""
        o3d = load_open3d()

        found = self.shape.rays.cast_rays(o3d.core.Tensor(self._localise(rays)), nthreads=1)
        distance, face, uv = (found[key].numpy() for key in ("t_hit", "primitive_ids", "primitive_uvs"))
        return Hits(distance, face, uv, np.full(len(face), self.number, np.uint8), np.full(len(face), -1, np.float32))

    def draw(self, view: CameraView, samples: Samples) -> Hits:
        """First hits of samples, as `cast` finds them."""
        hits = _miss(_count(samples), self.number)
        points = self.shape.mesh.vertices
        corners, screen = np.empty((len(points), 3)), np.empty((len(points), 3), np.float32)
        # corners go straight from the mesh to pixels: one matrix for turn, place, camera and lens
        lens = np.array([[view.fx, 0, view.cx], [0, view.fy, view.cy], [0, 0, 1]]) @ np.transpose(view.rotation)
        T_pixel_mesh = np.column_stack([lens @ self.lit.turn, lens @ np.subtract(self.lit.place, view.origin)])
        project_corners(points, T_pixel_mesh, corners, screen)
        slot = np.empty((samples.bottom - samples.top) * (samples.right - samples.left), np.int32)
        faces = np.ascontiguousarray(self.shape.mesh.faces, np.int32)
        furthest, later = np.empty(len(slot), np.float32), np.empty(len(faces), np.int32)
        draw_triangles(faces, corners, screen, view, samples, slot=slot, furthest=furthest, later=later, hits=hits)
        return hits

    def see(self, view: CameraView, samples: Samples) -> Hits:
        """First hits of samples, the cheaper way."""
        # drawing costs by the triangle, rays by the sample
        if len(self.lit.faces) <= FACES_PER_SAMPLE * _count(samples):
            return self.draw(view, samples)
        return self.cast(_rays_of(view, samples))

    def blocks(self, rays: np.ndarray) -> np.ndarray:
        """(n,) bool whether rays (n, 6) in the world meet it."""
        o3d = load_open3d()

        return self.shape.rays.test_occlusions(o3d.core.Tensor(self._localise(rays)), nthreads=1).numpy()

    def _localise(self, rays: np.ndarray) -> np.ndarray:
        if not self.is_moved:
            return rays
        moved = np.empty_like(rays)
        move_rays(self.lit, rays, moved)
        return moved


@dataclass(frozen=True)
class Tracer:
    """An object and what stands around it."""

    body: LitBody
    others: LitBody | None  # its surroundings; None in a studio
    key: Colour  # unit direction to the key light

    def trace(self, view: CameraView, region: tuple[int, int, int, int]) -> TracedRegion:
        """Trace the pixels that can show a mesh, and again with four samples where edges need them.

        Args:
            region: left, top, right, bottom of those that can show the object; with surroundings all are traced.
        """
        left, top, right, bottom = region if self.others is None else (0, 0, view.width, view.height)
        near = np.zeros((bottom - top) * (right - left), bool)
        rows = near.reshape(bottom - top, right - left)
        rows[region[1] - top : region[3] - top, region[0] - left : region[2] - left] = True
        # one sample in each pixel first: most pixels need no more
        centres = Samples(left, top, right, bottom, np.arange(len(near), dtype=np.int32), CENTRE)
        hits = self.see(view, centres, near)
        material, needed = np.full(len(near), -1, np.int32), np.zeros(len(near), bool)
        normal = np.empty((len(near), 3), np.float32)
        for body in (self.body,) if self.others is None else (self.body, self.others):
            describe_hits(body.lit, body.number, view, centres, hits, material=material, normal=normal, needed=needed)
        mark_edges(right - left, hits, material, normal, needed)
        # where neighbours differ in mesh, material or bend, and on paper, whose print is finer than a pixel
        refine = np.flatnonzero(needed).astype(np.int32)
        fine = self.see(view, Samples(left, top, right, bottom, refine, SUBPIXELS), near)
        return TracedRegion(left, top, right, bottom, hits, refine, fine)

    def see(self, view: CameraView, samples: Samples, near: np.ndarray) -> Hits:
        """First hits of samples; those of the part's pixels that are `near` (n,) bool may show the object."""
        if self.others is None:
            return self.body.see(view, samples)
        # surroundings fill the frame and have many faces: always by rays; the object only where it may be
        rays = _rays_of(view, samples)
        hits = self.others.cast(rays)
        chosen, shots = np.flatnonzero(near[samples.pixels]), len(samples.offsets)
        if len(chosen):
            where = (chosen[:, None] * shots + np.arange(shots)).reshape(-1).astype(np.int32)
            take_nearer(hits, self.body.see(view, samples._replace(pixels=samples.pixels[chosen])), where)
        which, to_key = np.empty(len(rays), np.int32), np.empty_like(rays)
        # off the surface that was met, or rays to the light would meet it again
        lift = 2e-4 * self.body.shape.size
        count = fill_key_rays(self.others.lit, hits, rays, self.key, lift, which, to_key)
        which, to_key = which[:count], to_key[:count]
        # what the surroundings shade already is not asked of the object
        free = ~self.others.blocks(to_key)
        free[free] = ~self.body.blocks(to_key[free])
        hits.key_share[which] = free
        return hits


def _miss(count: int, number: int) -> Hits:
    """Hits of rays that have met nothing yet."""
    return Hits(
        np.full(count, np.inf, np.float32), np.full(count, NOTHING, np.uint32), np.zeros((count, 2), np.float32),
        np.full(count, number, np.uint8), np.full(count, -1, np.float32),
    )  # fmt: skip


NO_REGION = TracedRegion(0, 0, 0, 0, _miss(0, 0), np.empty(0, np.int32), _miss(0, 0))
"""That of a camera which sees no mesh."""


def _count(samples: Samples) -> int:
    return len(samples.pixels) * len(samples.offsets)


def _rays_of(view: CameraView, samples: Samples) -> np.ndarray:
    rays = np.empty((_count(samples), 6), np.float32)
    fill_rays(view, samples, rays)
    return rays
