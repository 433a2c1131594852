"""Views of an object with a sheet mounted on it, taken apart so that any patch can be put on the sheet afterwards.

Light falls on the sheet in proportion to its colour, so a picture is linear in the patch's linear colours:
`picture = dark + gain · patch(uv)`, with exact geometry, occlusion, bending and light in the three buffers.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from toolkit.core.console import progress
from toolkit.core.workspace import Workspace
from toolkit.objects.load import load_object
from toolkit.objects.records import TAPE_MARGIN_MM
from toolkit.rig.camera import Camera
from toolkit.rig.mount import attach, mount_patch
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.views import NEAR_VIEWS, PER_STUDIO, ViewRanges, random_pose, random_studio

FOV_DEG = 30.5
"""Of the square picture: what the middle of a 4:3 frame of 40° shows."""


@dataclass(frozen=True)
class MountedView:
    """One view.

    Attributes:
        dark: (s, s, 3) float32 linear picture with a black patch, in exposure units.
        gain: (s, s, 3) float32, what a white patch adds.
        uv: (4, s, s, 2) float32 place on the patch, u right and v up in [0, 1], of four samples per pixel; NaN where a
            sample does not see the patch.
    """

    dark: np.ndarray
    gain: np.ndarray
    uv: np.ndarray


def render_mounted_views(
    workspace: Workspace,
    object_name: str,
    size_mm: float,
    count: int,
    seed: int,
    image_px: int,
    quiet: bool = False,
    ranges: ViewRanges = NEAR_VIEWS,
) -> Iterator[MountedView]:
    """Yield `count` views from random poses, lights and backdrops; see `render_training_images` for their ranges.

    View i depends on (seed, i) alone, and none is a pose of a plan.

    Args:
        workspace: whose object it is.
        object_name: as in its spec.
        size_mm: side of the printed patch, unless the object's spec states one.
        count: how many.
        seed: of all draws.
        image_px: side of the square pictures.
        quiet: no progress bar.
        ranges: where the camera may stand.

    Raises:
        ToolkitError: an unknown object, or a sheet that cannot be mounted.
    """
    item = load_object(workspace.object_spec(object_name))
    side_mm = item.spec.patch.size_mm or size_mm
    camera = Camera.from_fov(image_px, image_px, FOV_DEG)
    dressed = [
        attach(
            item.mesh, mount_patch(item.mesh, np.full((64, 64, 3), v, np.uint8), side_mm, item.spec.patch, item.name)
        )
        for v in (0, 255)
    ]
    with progress(f"rendering {object_name} with its sheet", count, quiet) as bar:
        for start in range(0, count, PER_STUDIO):
            studio = random_studio(seed, start, float(item.mesh.size_mm.max()))
            black, white = (RaycastRenderer(mesh, studio) for mesh in dressed)
            for i in range(start, min(start + PER_STUDIO, count)):
                T_world_camera = random_pose(np.random.default_rng([seed, i, 2]), item.mesh, camera, ranges)
                dark = black.render(camera, T_world_camera)
                gain = np.maximum(white.render(camera, T_world_camera) - dark, 0)
                uv = _on_patch(black.sheet_samples(camera, T_world_camera), side_mm)
                gain[np.isnan(uv[..., 0]).all(axis=0)] = 0
                yield MountedView(dark, gain, uv)
                bar.advance()


def _on_patch(sheet_uv: np.ndarray, size_mm: float) -> np.ndarray:
    """From places on the sheet to places on the patch, without the margin."""
    side_mm = size_mm + 2 * TAPE_MARGIN_MM
    uv = (sheet_uv * side_mm - TAPE_MARGIN_MM) / size_mm
    uv[((uv < 0) | (uv > 1)).any(axis=-1)] = np.nan
    return uv.astype(np.float32)
