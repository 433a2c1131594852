"""Pictures of an object in memory, as `shoot_plan` would write them."""

from collections.abc import Sequence

import numpy as np

from toolkit.captures.shoot import ShootSettings, studio_for
from toolkit.core.errors import ToolkitError
from toolkit.objects.load import TableObject
from toolkit.objects.records import Patch, Texture
from toolkit.rig.camera import Camera
from toolkit.rig.plan import Pose
from toolkit.rig.renderer import make_renderer
from toolkit.rig.shading import tone_map
from toolkit.rig.variants import Paint, Print, dress


def render(
    item: TableObject,
    poses: Sequence[Pose],
    camera: Camera | None = None,
    booster: Patch | Texture | None = None,
    settings: ShootSettings | None = None,
) -> np.ndarray:
    """Photograph an object in the virtual studio, bare, with a patch on it or in a texture.

    The light is baked once for all poses. The pixels are those that `shoot_plan` writes with the same settings as PNG.

    Args:
        item: from `load_object`.
        poses: where the camera stands, such as `plan.objects["racer"]`; degrees and millimetres.
        camera: its pixels and field of view; 640 × 480 px and 40 degrees by default.
        booster: a patch is mounted where the object's spec says and at the size it states, else the patch's record.
        settings: seed, backdrop, light and renderer.

    Returns:
        (n, h, w, 3) uint8 sRGB, one picture for each pose.

    Raises:
        ToolkitError: an unknown backdrop, light or renderer, a patch that is too large for the object, or a texture
            that was trained on another.
    """
    settings, camera = settings or ShootSettings(), camera or Camera.from_fov()
    if settings.rehearsal is not None:
        raise ToolkitError("a rehearsal is of photographs in files: shoot them with shoot_plan")
    mesh = dress(item, _put_on(item, booster))
    renderer = make_renderer(settings.renderer, mesh, studio_for(item, settings))
    lights = renderer.render_many((camera, pose.matrix()) for pose in poses)
    pictures = [tone_map(light, (settings.seed, pose.id)) for light, pose in zip(lights, poses, strict=True)]
    return np.stack(pictures) if pictures else np.zeros((0, camera.height, camera.width, 3), np.uint8)


def _put_on(item: TableObject, booster: Patch | Texture | None) -> Print | Paint | None:
    if booster is None:
        return None
    named = booster.pixels, booster.record.png_sha256, booster.record.name
    if isinstance(booster, Texture):
        return Paint(*named, booster)
    return Print(*named, item.spec.sizes_mm(booster.size_mm))
