"""Does the texture help in views that it was not trained on: clear, in fog, and in the weather that it met?"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from toolkit.boosters.linear_view import batch_views, show_texture, tone_map
from toolkit.boosters.pixels import Target, from_picture
from toolkit.boosters.transforms.weather import Corrupted, Weathered, find_depths
from toolkit.boosters.validation import Share, Validation
from toolkit.core.draws import Draws
from toolkit.corruptions.corrupt import corrupt
from toolkit.rig.views import RenderedView

if TYPE_CHECKING:
    import torch

BATCH = 16
FOG_SEVERITY = 3


@dataclass(frozen=True)
class WeatherValidation:
    """What one network says of held-out views: the object in its own paint (`bare`) and in the texture (`patched`).

    Attributes:
        clear: as they are.
        fog: in ImageNet-C's fog.
        weather: through the weather that it was trained in, where it was.
        corrupted: by the corruptions that it was trained in, where it was.
    """

    clear: Validation
    fog: Validation
    weather: Validation | None = None
    corrupted: Validation | None = None


def draw_weather(
    views: list[RenderedView], metres_per_unit: list[float], weather: Weathered, rng: np.random.Generator
) -> "tuple[torch.Tensor, torch.Tensor]":
    """Weather over views of objects whose meshes' units are so long at real size, see `ViewBatch.through`."""
    return weather.draw(find_depths([one.view for one in views], [metres_per_unit[one.subject] for one in views]), rng)


def measure_known(texture: "torch.Tensor", views: list[RenderedView], targets: list[Target]) -> float:
    """Share of views in which the networks recognise the object in a texture, (3, n, n) in [0, 1], dilated."""
    import torch

    hits = 0
    with torch.inference_mode():
        for start in range(0, len(views), BATCH):
            batch = batch_views([one.view for one in views[start : start + BATCH]], str(texture.device))
            photos = show_texture(texture, batch)
            hits += sum(target.count_hits(photos) for target in targets)
    return hits / len(views) / len(targets)


def validate_texture(
    pixels: np.ndarray, views: list[RenderedView], targets: list[Target], seed: int
) -> list[WeatherValidation]:
    """Recognise held-out views, as they are and in ImageNet-C's fog of severity 3.

    Args:
        pixels: (n, n, 3) uint8 sRGB, dilated.
        views: with the object in its own paint beside them.
        targets: the networks.
        seed: of the fog.
    """
    import torch

    hits = np.zeros((2, 2, len(targets)), int)  # weather, paint, network
    with torch.inference_mode():
        for start, pair in _show_both(pixels, views, targets[0].classifier.device):
            seeds = [int(n) for n in Draws(seed, start, "validate").of("fog").integers(1 << 62, size=len(pair[0]))]
            for paint, photos in enumerate(pair):
                for weather, seen in enumerate((photos, corrupt(photos, "fog", FOG_SEVERITY, seeds))):
                    for k, target in enumerate(targets):
                        hits[weather, paint, k] += target.count_hits(seen)
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


def _show_both(
    pixels: np.ndarray, views: list[RenderedView], device: str
) -> "Iterator[tuple[int, tuple[torch.Tensor, torch.Tensor]]]":
    """Batch by batch the number of its first view, and its photographs in the object's own paint and in the texture."""
    import torch

    texture = from_picture(pixels, device)
    for start in range(0, len(views), BATCH):
        some = views[start : start + BATCH]
        textured = show_texture(texture, batch_views([one.view for one in some], device))
        bare = torch.from_numpy(np.stack([one.bare for one in some if one.bare is not None])).to(device)
        yield start, (bare.permute(0, 3, 1, 2).float() / 255, textured)


def validate_corrupted(
    pixels: np.ndarray, views: list[RenderedView], targets: list[Target], seed: int, corrupted: Corrupted
) -> list[Validation]:
    """Recognise held-out views as `validate_texture`, each photograph corrupted."""
    import torch

    hits, always = np.zeros((2, len(targets)), int), corrupted.with_overrides(probability=1.0)
    with torch.inference_mode():
        for start, pair in _show_both(pixels, views, targets[0].classifier.device):
            for paint, photos in enumerate(pair):
                seen = always.change(photos, Draws(seed, start, "validate").of("corrupted"))
                for k, target in enumerate(targets):
                    hits[paint, k] += target.count_hits(seen)
    return _as_validations(hits, targets, len(views))


def _as_validations(hits: np.ndarray, targets: list[Target], count: int) -> list[Validation]:
    """From (paint, network) hits."""
    return [
        Validation(target.classifier.name, Share(int(hits[0, k]), count), Share(int(hits[1, k]), count))
        for k, target in enumerate(targets)
    ]


def validate_in_weather(
    pixels: np.ndarray, views: list[RenderedView], targets: list[Target], seed: int, *,
    weather: Weathered, metres_per_unit: list[float],
) -> list[Validation]:  # fmt: skip
    """Recognise held-out views that have their depth, each through weather that is drawn for it.

    Args:
        pixels: (n, n, 3) uint8 sRGB, dilated.
        views: with the light of the object in its own paint beside them.
        targets: the networks.
        seed: of the weather.
        weather: which may be drawn.
        metres_per_unit: of each object's mesh, at real size.
    """
    import torch

    device, weather = targets[0].classifier.device, weather.with_overrides(probability=1.0)
    texture = from_picture(pixels, device)
    hits = np.zeros((2, len(targets)), int)  # paint, network
    with torch.inference_mode():
        for start in range(0, len(views), BATCH):
            some = views[start : start + BATCH]
            rng = weather.rng(Draws(seed, start, "validate"))
            factor, offset = (part.to(device) for part in draw_weather(some, metres_per_unit, weather, rng))
            lights = np.stack([one.bare_light for one in some if one.bare_light is not None])
            bare = tone_map(torch.from_numpy(lights).to(device).float() * factor + offset).permute(0, 3, 1, 2)
            textured = show_texture(texture, batch_views([one.view for one in some], device).through(factor, offset))
            for paint, seen in enumerate((bare, textured)):
                for k, target in enumerate(targets):
                    hits[paint, k] += target.count_hits(seen)
    return _as_validations(hits, targets, len(views))
