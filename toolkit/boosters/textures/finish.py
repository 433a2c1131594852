"""From the last step to files: round and dilate the texture, validate that, dress the objects, record it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toolkit import __version__
from toolkit.boosters.finish import list_shares, name_network
from toolkit.boosters.textures.checkpoint import Checkpoint
from toolkit.boosters.textures.request import TextureRequest
from toolkit.boosters.textures.validation import WeatherValidation
from toolkit.boosters.textures.wearers import Wearers
from toolkit.boosters.training import Target
from toolkit.objects.atlas import wear
from toolkit.objects.export import to_glb
from toolkit.textures import Texture, glb_name, write_texture

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
