"""Does the texture help on views that it was not trained on, clear and in fog?"""

from dataclasses import dataclass

import numpy as np

from toolkit.boosters.textures.picture import batch_views, show_texture
from toolkit.boosters.training import Target
from toolkit.boosters.validation import Share, Validation
from toolkit.corruptions.corrupt import corrupt
from toolkit.draws import Draws
from toolkit.rig.view_stream import StreamedView

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
