"""A picture of the object turning, in the texture as it is being trained, with what the network says of each view."""

from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from toolkit.boosters.preview import RIGHT, WRONG, write_caption
from toolkit.boosters.textures.picture import ViewBatch, batch_views, show_texture
from toolkit.boosters.training import Target
from toolkit.rig.camera import Camera, distance_to_fill, orbit_pose
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.studio import make_studio
from toolkit.rig.view_stream import DETAIL, FOV_DEG, Subject

if TYPE_CHECKING:
    import torch

VIEWS, COLUMNS = 8, 4
ELEVATION_DEG, FILL = 30.0, 0.9
GAP_PX, CAPTION_PX = 8, 26
BACKDROP = "concrete"


def plan_turntable(subject: Subject, image_px: int, device: str) -> ViewBatch:
    """Eight views around an object in studio light, of `image_px` a side."""
    mesh = subject.mesh
    studio = make_studio(0, float(mesh.size_mm.max()), BACKDROP)
    renderer = RaycastRenderer(mesh, studio, DETAIL)
    camera = Camera(image_px, image_px, FOV_DEG)
    target = np.array([0.0, 0.0, mesh.size_mm[2] / 2])
    views = []
    for azimuth in np.arange(VIEWS) * 360.0 / VIEWS:
        distance = distance_to_fill(camera, mesh.vertices, target, azimuth, ELEVATION_DEG, FILL)
        pose = orbit_pose(target, azimuth, ELEVATION_DEG, distance)
        views.append(renderer.take_apart(camera, pose, mesh.materials[subject.material].texture))
    return batch_views(views, device)


def draw_turntable(texture: "torch.Tensor", batches: list[ViewBatch], target: Target) -> np.ndarray:
    """(h, w, 3) uint8 sRGB: eight views of each object, the network's first guess under each.

    Args:
        texture: (3, n, n) sRGB-encoded in [0, 1], dilated.
        batches: of `plan_turntable`, one for each object.
        target: the network that labels them.
    """
    import torch

    with torch.inference_mode():
        photos = torch.cat([show_texture(texture, batch) for batch in batches])
        chances = target.classifier.logits(photos).float().softmax(1).cpu()
    side = photos.shape[-1]
    rows = -(-len(photos) // COLUMNS)
    size = (COLUMNS * (side + GAP_PX) + GAP_PX, rows * (side + CAPTION_PX + GAP_PX) + GAP_PX)
    sheet = Image.new("RGB", size, "white")
    for k, (photo, chance) in enumerate(zip(photos, chances, strict=True)):
        row, column = divmod(k, COLUMNS)
        corner = (GAP_PX + column * (side + GAP_PX), GAP_PX + row * (side + CAPTION_PX + GAP_PX))
        sheet.paste(Image.fromarray((photo.permute(1, 2, 0).cpu().numpy() * 255).round().astype(np.uint8)), corner)
        best = int(chance.argmax())
        colour = RIGHT if best == target.class_index else WRONG
        write_caption(sheet, corner, target.classifier.labels[best], float(chance[best]), colour, side)
    return np.asarray(sheet)
