"""The ghost of a pose: a line drawing of the object, to be laid over the camera's picture."""

from dataclasses import dataclass
from functools import lru_cache
from threading import Lock

import cv2
import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import encode_image
from toolkit.objects.load import load_object
from toolkit.objects.mesh import Mesh, load_open3d, make_ray_scene
from toolkit.rig.camera import Camera, pixel_rays
from toolkit.rig.plan import CapturePlan
from toolkit.rig.variants import VARIANTS, apply_booster, find_booster

SIDE_PX = 720
# ITU-R BT.709's weights of red, green and blue in brightness
LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)
LINE, SHEET_LINE = (255, 255, 255), (255, 190, 60)
HALO = (10, 14, 20)
CREASE_COSINE = 0.86
"""Faces that meet at 30° or more make a line; the facets of a round thing do not."""
JUMP = 0.012
"""Relative step in depth between neighbours that makes a line, beyond the slope of the surface."""
PAINT_STEP = 0.2
"""Step in brightness of the paint, 0 to 1, that makes a thin line."""
PAINT_BLUR_PX = 2.0
"""Smaller speckles make no lines."""
KEPT_SCENES = 4
KEPT_GHOSTS = 96
"""The shots of a session of a few objects; each is about 30 kB."""


@dataclass(frozen=True)
class _Rendered:
    """Depth of pixels (h, w, ...), inf for nothing, face normal, whether it is the sheet, brightness."""

    depth: np.ndarray
    normal: np.ndarray
    is_paper: np.ndarray
    brightness: np.ndarray


class _Stage:
    """An object in a variant; materials from `first_of_sheet` on are a sheet's."""

    def __init__(self, mesh: Mesh, first_of_sheet: int) -> None:
        self._mesh, self._scene = mesh, make_ray_scene(mesh)
        self._first_of_sheet = first_of_sheet

    def look(self, camera: Camera, T_world_camera: np.ndarray) -> _Rendered:
        o3d = load_open3d()
        h, w = camera.height, camera.width
        # pixel centres are at half integers
        y, x = np.mgrid[:h, :w].astype(np.float32) + np.float32(0.5)
        rays = pixel_rays(camera, T_world_camera, np.stack([x, y], axis=-1).reshape(-1, 2))
        found = self._scene.cast_rays(o3d.core.Tensor(rays))
        depth, normal = found["t_hit"].numpy(), found["primitive_normals"].numpy().copy()
        hit = np.isfinite(depth)
        triangle, at = found["primitive_ids"].numpy()[hit].astype(np.int64), found["primitive_uvs"].numpy()[hit]
        # the sheet's lines get another colour, and paint shows as edges of brightness
        is_paper, brightness = np.zeros(h * w, bool), np.zeros(h * w, np.float32)
        is_paper[hit] = self._mesh.face_material[triangle] >= self._first_of_sheet
        brightness[hit] = self._read_paint(triangle, at)
        shape = (h, w)
        return _Rendered(
            depth.reshape(shape), normal.reshape(h, w, 3), is_paper.reshape(shape), brightness.reshape(shape)
        )

    def _read_paint(self, triangle: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Brightness 0 to 1, sRGB-encoded, of the nearest texel."""
        corners = self._mesh.uv[self._mesh.faces[triangle]]
        # barycentric: the weight of the first corner is what the other two leave
        uv = corners[:, 0] * (1 - at.sum(axis=1, keepdims=True)) + corners[:, 1] * at[:, :1] + corners[:, 2] * at[:, 1:]
        material, value = self._mesh.face_material[triangle], np.zeros(len(triangle), np.float32)
        for number, layer in enumerate(self._mesh.materials):
            chosen = material == number
            high, wide = layer.texture.shape[:2]
            column = np.floor(uv[chosen, 0] * wide).astype(int) % wide
            # v counts up, rows count down; a texture repeats outside of [0, 1]
            row = np.floor((1 - uv[chosen, 1]) * high).astype(int) % high
            value[chosen] = layer.texture[row, column].astype(np.float32) @ LUMA / 255
        return value


class GhostRenderer:
    """Draws the ghosts of a plan's poses, each once; safe to call from several threads."""

    def __init__(self, workspace: Workspace, plan: CapturePlan) -> None:
        self._workspace, self._plan, self._lock = workspace, plan, Lock()
        self._stage = lru_cache(KEPT_SCENES)(self._make_stage)
        self._drawn = lru_cache(KEPT_GHOSTS)(self._draw)

    def draw(self, name: str, variant: str, pose_id: int) -> bytes:
        """PNG of the square in the middle of the plan's frame, as wide as its shorter side; clear without the object.

        Raises:
            ToolkitError: the object cannot be loaded, or has no such pose.
        """
        with self._lock:
            return self._drawn(name, variant, pose_id)

    def _draw(self, name: str, variant: str, pose_id: int) -> bytes:
        pose = next((pose for pose in self._plan.objects.get(name, []) if pose.id == pose_id), None)
        if pose is None:
            raise ToolkitError(f"the plan has no pose {pose_id} of '{name}': run 'toolkit plan --shot-list' again")
        seen = self._stage(name, variant).look(square_camera(self._plan.camera), pose.matrix())
        return encode_image(paint_lines(seen), "PNG", compress_level=6)

    def _make_stage(self, name: str, variant: str) -> _Stage:
        item = load_object(self._workspace.object_spec(name))
        try:
            booster = find_booster(self._workspace, item, variant) if variant in VARIANTS else None
        except ToolkitError:
            booster = None  # a sheet that is not here can be photographed all the same
        mesh = apply_booster(item, booster)
        if booster is None or not booster.sizes_mm:
            return _Stage(mesh, len(mesh.materials))
        return _Stage(mesh, 0 if booster.alone else len(item.mesh.materials))


def square_camera(camera: Camera) -> Camera:
    """The camera that sees the square in the middle of a plan's frame, as wide as the frame's shorter side."""
    shorter = min(camera.width, camera.height)
    return Camera.from_focal_px(SIDE_PX, SIDE_PX, camera.fx * SIDE_PX / shorter)


def paint_lines(seen: _Rendered) -> np.ndarray:
    """(h, w, 4) uint8: white lines with a dark halo, the sheet's in amber, a little white inside the outline."""
    solid = np.isfinite(seen.depth)
    strong = _outlines(seen, solid)
    sheet = _steps(seen.is_paper)
    # beside an outline no line of paint: the two would merge
    paint = _paint_steps(seen, solid) & ~cv2.dilate(strong.astype(np.uint8), np.ones((5, 5))).astype(bool)
    line = np.maximum(_soften(strong, 1.0), 0.4 * _soften(paint, 0.6))
    amber = _soften(sheet, 1.1)
    halo = 0.55 * cv2.GaussianBlur(np.maximum(_soften(strong, 2.0), amber), (0, 0), 2.2)
    body = np.where(seen.is_paper, 0.16, 0.07) * solid
    colour = np.empty((*solid.shape, 3), np.float32)
    colour[:] = LINE
    colour[seen.is_paper] = SHEET_LINE
    alpha = body.astype(np.float32)
    for over, share in ((HALO, halo), (LINE, line), (SHEET_LINE, amber)):
        # the "over" of two colours with alpha
        total = share + alpha * (1 - share)
        weight = (share / np.maximum(total, 1e-6))[..., None]
        colour = colour * (1 - weight) + np.array(over, np.float32) * weight
        alpha = total
    return np.dstack([colour, 255 * alpha]).clip(0, 255).round().astype(np.uint8)


def _outlines(seen: _Rendered, solid: np.ndarray) -> np.ndarray:
    """(h, w) bool: the silhouette, steps in depth, and creases."""
    lines = _steps(solid)
    inverse = np.where(solid, 1 / np.where(solid, seen.depth, 1), 0)  # linear over a plane, so that slopes drop out
    for axis in (0, 1):
        before, after = np.roll(inverse, 1, axis), np.roll(inverse, -1, axis)
        # both neighbours have to be of the object: next to nothing no slope is known
        whole = solid & np.roll(solid, 1, axis) & np.roll(solid, -1, axis)
        lines |= whole & (np.abs(before + after - 2 * inverse) > JUMP * inverse)
        beside = np.roll(seen.normal, -1, axis)
        # both signs: the mesh's faces may look either way
        cosine = np.abs(np.einsum("hwc,hwc->hw", seen.normal, beside))
        lines |= whole & (cosine < CREASE_COSINE)
    return lines


def _paint_steps(seen: _Rendered, solid: np.ndarray) -> np.ndarray:
    smooth = cv2.GaussianBlur(seen.brightness, (0, 0), PAINT_BLUR_PX)
    inside = cv2.erode(solid.astype(np.uint8), np.ones((5, 5))).astype(bool) & ~seen.is_paper
    # Sobel's weights sum to 8 times the slope per pixel
    x, y = cv2.Sobel(smooth, cv2.CV_32F, 1, 0) / 8, cv2.Sobel(smooth, cv2.CV_32F, 0, 1) / 8
    return inside & (np.hypot(x, y) > PAINT_STEP / 3)


def _steps(mask: np.ndarray) -> np.ndarray:
    """(h, w) bool: pixels whose right or lower neighbour is on the other side of the mask's edge."""
    right, below = np.zeros_like(mask), np.zeros_like(mask)
    right[:, :-1] = mask[:, 1:] != mask[:, :-1]
    below[:-1] = mask[1:] != mask[:-1]
    return right | below


def _soften(lines: np.ndarray, width_px: float) -> np.ndarray:
    """(h, w) float32 in [0, 1]: lines of that width with smooth edges."""
    return np.clip(2.4 * cv2.GaussianBlur(lines.astype(np.float32), (0, 0), width_px), 0, 1)
