"""From the last step to files: validate the rounded texture, dress the objects, draw the turntable, record it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from toolkit import __version__
from toolkit.boosters.linear_view import ViewBatch, batch_views, show_texture
from toolkit.boosters.patch_finish import RIGHT, WRONG, list_shares, name_network, write_caption
from toolkit.boosters.patch_steps import Target
from toolkit.boosters.texture_config import TextureRequest, state_names
from toolkit.boosters.texture_objects import Wearers
from toolkit.boosters.validation import Share, Validation
from toolkit.core.draws import Draws
from toolkit.corruptions.corrupt import corrupt
from toolkit.objects.atlas import wear
from toolkit.objects.export import to_glb
from toolkit.objects.records import Texture, glb_name, write_texture
from toolkit.rig.camera import Camera, distance_to_fill, orbit_pose
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.studio import make_studio
from toolkit.rig.views import DETAIL, FOV_DEG, StreamedView, Subject
from toolkit.training.checkpoint import read_arrays, write_arrays

if TYPE_CHECKING:
    import torch

FORMAT = "toolkit texture checkpoint 1"
OWN = ("texture", "losses", "accuracies")


@dataclass(frozen=True)
class Checkpoint:
    """Where a run stands.

    Attributes:
        inputs_sha256: hash of everything that the run depends on; a run with another hash is another run.
        texture: θ, (3, n, n) float32, not dilated.
        losses, accuracies: (steps made,) float64, one per step.
        optimiser: its state by name, each of θ's shape.
    """

    inputs_sha256: str
    texture: np.ndarray
    losses: np.ndarray
    accuracies: np.ndarray
    optimiser: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def done(self) -> int:
        """How many steps have been made."""
        return len(self.losses)


def write_checkpoint(file: Path, state: Checkpoint) -> None:
    """Write it in one rename.

    Raises:
        ToolkitError: the disk is full or read-only.
    """
    arrays = {name: getattr(state, name) for name in OWN} | state.optimiser
    write_arrays(file, arrays, FORMAT, state.inputs_sha256, state.done)


def read_checkpoint(file: Path, inputs_sha256: str, optimiser: str) -> Checkpoint | None:
    """Read it, None where there is none.

    Raises:
        ToolkitError: it is damaged, or of other inputs.
    """
    names = state_names(optimiser)
    arrays = read_arrays(file, {*OWN, *names}, FORMAT, inputs_sha256)
    if arrays is None:
        return None
    kept = {name: arrays[name] for name in names}
    return Checkpoint(inputs_sha256, arrays["texture"], arrays["losses"], arrays["accuracies"], kept)


BATCH = 16
FOG_SEVERITY = 3


@dataclass(frozen=True)
class WeatherValidation:
    """What one network says of held-out views: the object in its own paint (`bare`) and in the texture (`patched`)."""

    clear: Validation
    fog: Validation


def validate_texture(
    pixels: np.ndarray, views: list[StreamedView], targets: list[Target], seed: int
) -> list[WeatherValidation]:
    """Recognise held-out views in the studio, as they are and in ImageNet-C's fog of severity 3.

    Args:
        pixels: (n, n, 3) uint8 sRGB, dilated.
        views: with the object in its own paint beside them.
        targets: the networks.
        seed: of the fog.
    """
    import torch

    device = targets[0].classifier.device
    texture = torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1))).to(device).float().div(255)
    hits = np.zeros((2, 2, len(targets)), int)  # weather, paint, network
    with torch.inference_mode():
        for start in range(0, len(views), BATCH):
            some = views[start : start + BATCH]
            textured = show_texture(texture, batch_views([one.view for one in some], device))
            bare = torch.from_numpy(np.stack([one.bare for one in some if one.bare is not None])).to(device)
            seeds = [int(n) for n in Draws(seed, start, "validate").of("fog").integers(1 << 62, size=len(some))]
            for paint, photos in enumerate((bare.permute(0, 3, 1, 2).float() / 255, textured)):
                for weather, seen in enumerate((photos, corrupt(photos, "fog", FOG_SEVERITY, seeds))):
                    for k, target in enumerate(targets):
                        hits[weather, paint, k] += int(
                            (target.classifier.logits(seen).argmax(1) == target.class_index).sum()
                        )
    count = len(views)
    return [
        WeatherValidation(
            *(
                Validation(target.classifier.name, Share(int(bare), count), Share(int(textured), count))
                for bare, textured in hits[:, :, k]
            )
        )
        for k, target in enumerate(targets)
    ]


VIEWS, COLUMNS = 8, 4
ELEVATION_DEG, FILL = 30.0, 0.9
GAP_PX, CAPTION_PX = 8, 26
BACKDROP = "concrete"


def plan_turntable(subject: Subject, image_px: int, device: str) -> ViewBatch:
    """Eight views around an object in studio light, of `image_px` a side."""
    mesh = subject.mesh
    studio = make_studio(0, float(mesh.size_mm.max()), BACKDROP)
    renderer = RaycastRenderer(mesh, studio, DETAIL)
    camera = Camera.from_fov(image_px, image_px, FOV_DEG)
    target = np.array([0.0, 0.0, mesh.size_mm[2] / 2])
    views = []
    for azimuth in np.arange(VIEWS) * 360.0 / VIEWS:
        distance = distance_to_fill(camera, mesh.vertices, target, azimuth, ELEVATION_DEG, FILL)
        pose = orbit_pose(target, azimuth, ELEVATION_DEG, distance)
        views.append(renderer.render_linear(camera, pose, mesh.materials[subject.material].texture))
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


RECENT = slice(-10, None)
"""The steps whose mean is recorded: one batch alone is noise."""


@dataclass(frozen=True)
class TextureFiles:
    """Where a run writes.

    Attributes:
        png: the texture; its record and what its objects need lie beside it.
        preview: the turntable.
        training: folder for checkpoints, until the run is finished.
    """

    png: Path
    preview: Path
    training: Path

    def glb(self, item: str) -> Path:
        """An object that wears the texture."""
        return self.png.parent / glb_name(self.png.stem, item)


def write_finished(
    request: TextureRequest,
    wearers: Wearers,
    targets: list[Target],
    state: Checkpoint,
    pixels: np.ndarray,
    files: TextureFiles,
    validations: list[WeatherValidation],
    backgrounds: dict[str, object] | None,
) -> Texture:
    """Write texture, record and dressed objects; `pixels` are (n, n, 3) uint8 sRGB, dilated."""
    clear, fog = [one.clear for one in validations], [one.fog for one in validations]
    objects = [
        {"name": item.name, "mesh_sha256": item.shape_sha256, "keep": list(request.keep)} for item in wearers.items
    ]
    final = {"loss": float(state.losses[RECENT].mean()), "accuracy": float(state.accuracies[RECENT].mean())}
    return write_texture(
        files.png.parent,
        pixels,
        {
            "name": files.png.stem,
            "class_name": targets[0].classifier.labels[targets[0].class_index],
            "class_index": targets[0].class_index,
            "objects": objects,
            "networks": [name_network(target.classifier) for target in targets],
            "data": {"views": wearers.views_of(request), "backgrounds": backgrounds},
            "seed": request.descent.seed,
            "settings": request.settings() | {"inputs_sha256": state.inputs_sha256},
            "final": final | list_shares(clear, "held_out") | list_shares(fog, "held_out_fog"),
            "toolkit_version": __version__,
        },
        corner_uv=wearers.stored_uv(),
        keep_images=wearers.keep_images(),
        glbs={
            item.name: to_glb(wear(atlas, pixels), item.name)
            for item, atlas in zip(wearers.items, wearers.atlases, strict=True)
        },
    )
