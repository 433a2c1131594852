"""Does a booster help in images, placements and views that it was not trained on?"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from toolkit.boosters.data import cut_centres
from toolkit.boosters.linear_view import batch_views, show_texture, tone_map
from toolkit.boosters.pixels import Target, from_picture
from toolkit.boosters.transforms.show import Appearance, show_patch
from toolkit.boosters.transforms.weather import Corrupted, ViewWeather, find_depths
from toolkit.core.draws import Draws
from toolkit.core.statistics import wilson_interval
from toolkit.core.tables import format_interval, format_percent
from toolkit.corruptions.batch import corrupt
from toolkit.rig.views import RenderedView

# a share of so many has a 95 % interval of about 17 points at most
DRAWS = 128
BATCH, TEXTURE_BATCH = 32, 16
FOG_SEVERITY = 3


@dataclass(frozen=True)
class Share:
    """How many of n were recognised, with Wilson's 95 % interval."""

    hits: int
    n: int

    @property
    def value(self) -> float:
        """Between 0 and 1."""
        return self.hits / self.n

    @property
    def ci95(self) -> tuple[float, float]:
        """Lowest and highest plausible share (Wilson 1927)."""
        return wilson_interval(self.hits, self.n)

    def __str__(self) -> str:
        low, high = self.ci95
        return f"{self.value:.0%} ({low:.0%}-{high:.0%}, n = {self.n})"


@dataclass(frozen=True)
class Validation:
    """A network's accuracy on the same images without and with the patch."""

    network: str
    bare: Share
    patched: Share

    @property
    def falls_short(self) -> bool:
        """Whether less than half are recognised with the patch, and not surely more than without."""
        return self.patched.value < 0.5 and self.patched.ci95[0] <= self.bare.value


MOST_NAMED = 3
"""Networks that a line names."""


def compare_shares(
    where: str, validations: Sequence[Validation], names: tuple[str, str], unit: str = "held-out views"
) -> str:
    """Return a line: without the booster and with it, by network; of many networks the mean and the weakest.

    Args:
        where: first words.
        validations: the networks' answers, at least one.
        names: what is shown without the booster, and with it.
        unit: what is counted.
    """
    shown = [f"{answer.network} {_compare(answer)}" for answer in validations]
    # of many networks the mean and the weakest: a list of all would not be read
    if len(validations) > MOST_NAMED:
        weakest = min(validations, key=lambda answer: answer.patched.value)
        means = np.mean([(answer.bare.value, answer.patched.value) for answer in validations], axis=0)
        before, after = map(format_percent, means)
        shown = [
            f"mean of {len(validations)} networks {before} % → {after} %",
            f"weakest {weakest.network} {_compare(weakest)}",
        ]
    return f"{where}, {validations[0].patched.n} {unit}, {' → '.join(names)}: {', '.join(shown)}"


def _compare(answer: Validation) -> str:
    before, after = (format_percent(share.value) for share in (answer.bare, answer.patched))
    return f"{before} % → {after} % (95 % interval {format_interval(answer.patched.ci95)} %)"


def count_placements(images: int, draws: int = DRAWS) -> int:
    """How many placements show each of `images` equally often, at least once, in about `draws`."""
    return max(draws, images) // images * images


def validate_patch(
    patch: torch.Tensor, images: torch.Tensor, targets: list[Target], appearance: Appearance, seed: int, *,
    draws: int = DRAWS, advance: Callable[[int], None] = lambda count: None, corrupted: Corrupted | None = None,
) -> list[Validation]:  # fmt: skip
    """Recognise images without the patch, and with the patch in new random placements.

    Args:
        patch: (3, n, n) in [0, 1], rounded to 8 bits as in its file.
        images: (k, 3, s, s) uint8 sRGB, held out of training.
        targets: the networks.
        appearance: transforms of the patch, drawn independently of the training.
        seed: of the run.
        draws: placements in all. Each image comes equally often in the patched share, and once in the bare share.
        advance: called with how many placements were just answered.
        corrupted: the same corruption of the photographs with and without the patch.
    """
    # a multiple of the images, so that each comes equally often
    count = count_placements(len(images), draws)
    bare, patched = [0] * len(targets), [0] * len(targets)
    # the middle, as the network's own preprocessing cuts it, as in an evaluation
    centres = cut_centres(images, targets[0].classifier.preprocessing.crop_px)
    with torch.inference_mode():
        for start in range(0, count, BATCH):
            which = torch.arange(start, min(start + BATCH, count), device=images.device)
            batch = centres[which % len(images)]
            photos = show_patch(patch, batch, appearance, Draws(seed, start, "validate"))
            # without the patch an image is asked once: in other placements the answer would be the same
            fresh = which < len(images)
            if corrupted is not None:
                # both from the same draw, so that they differ in the patch alone
                photos, batch = (
                    corrupted.change(seen, Draws(seed, start, "validate").of("corrupted")) for seen in (photos, batch)
                )
            for k, target in enumerate(targets):
                patched[k] += target.count_hits(photos)
                bare[k] += target.count_hits(batch[fresh]) if fresh.any() else 0
            advance(len(which))
    return [
        Validation(target.classifier.name, Share(bare[k], len(images)), Share(patched[k], count))
        for k, target in enumerate(targets)
    ]


def list_shares(validations: list[Validation], where: str) -> dict[str, float]:
    """Each network's shares, intervals and counts, as a record's `final` holds them."""
    final: dict[str, float] = {}
    names = [answer.network for answer in validations]
    for k, answer in enumerate(validations):
        # networks of the same name get a number, so that none overwrites the other's figures
        network = answer.network if names.index(answer.network) == k else f"{answer.network}_{k + 1}"
        for what, share in (("patched", answer.patched), ("bare", answer.bare)):
            low, high = share.ci95
            numbers = {"top1": share.value, "low": low, "high": high, "n": float(share.n)}
            final |= {f"{network}_{where}_{what}_{name}": value for name, value in numbers.items()}
    return final


@dataclass(frozen=True)
class WeatherValidation:
    """A network's accuracy on held-out views: the unmodified object (`bare`), and in the texture (`patched`).

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
    views: list[RenderedView], metres_per_unit: Sequence[float], weather: ViewWeather, rng: np.random.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    """Weather over views of objects whose meshes' units are so long at real size, see `ViewBatch.through`."""
    return weather.draw(
        find_depths([view.view for view in views], [metres_per_unit[view.subject] for view in views]), rng
    )


def measure_known(texture: torch.Tensor, views: list[RenderedView], targets: list[Target]) -> float:
    """Share of views in which the networks recognise the object in a texture, (3, n, n) in [0, 1], dilated."""
    hits = 0
    with torch.inference_mode():
        for start in range(0, len(views), TEXTURE_BATCH):
            batch = batch_views([view.view for view in views[start : start + TEXTURE_BATCH]], str(texture.device))
            photos = show_texture(texture, batch)
            hits += sum(target.count_hits(photos) for target in targets)
    return hits / len(views) / len(targets)


def validate_texture(
    pixels: np.ndarray, views: list[RenderedView], targets: list[Target], seed: int, *,
    corrupted: Corrupted | None = None, weather: ViewWeather | None = None, metres_per_unit: Sequence[float] = (),
) -> list[WeatherValidation]:  # fmt: skip
    """Recognise held-out views: as they are, in ImageNet-C's fog of severity 3, and in what it was trained in.

    Args:
        pixels: (n, n, 3) uint8 sRGB, dilated.
        views: with the object in its own paint beside them; for weather with their depth and that paint's light.
        targets: the networks.
        seed: of fog, corruptions and weather.
        corrupted: what each photograph is corrupted by.
        weather: which may be drawn for each view.
        metres_per_unit: of each object's mesh, at real size, for weather.
    """
    texture = from_picture(pixels, targets[0].classifier.device)
    hits: dict[str, np.ndarray] = {}
    with torch.inference_mode():
        for start in range(0, len(views), TEXTURE_BATCH):
            some, draws = views[start : start + TEXTURE_BATCH], Draws(seed, start, "validate")
            shown = list(_show_both(texture, some, draws, corrupted))
            if weather is not None:
                shown.append(("weather", _show_in_weather(texture, some, draws, weather, metres_per_unit)))
            # hits without and with the texture, by condition
            for where, pair in shown:
                counts = [[target.count_hits(photos) for target in targets] for photos in pair]
                hits[where] = hits.get(where, 0) + np.array(counts)
    return [
        WeatherValidation(**{
            where: Validation(target.classifier.name, *(Share(int(count), len(views)) for count in found[:, k]))
            for where, found in hits.items()
        })
        for k, target in enumerate(targets)
    ]  # fmt: skip


Pair = tuple["torch.Tensor", "torch.Tensor"]
"""Photographs of the object in its own paint, and in the texture."""


def _show_both(
    texture: torch.Tensor, views: list[RenderedView], draws: Draws, corrupted: Corrupted | None
) -> Iterator[tuple[str, Pair]]:
    """Views as they are, in fog, and corrupted: both paints alike."""
    device = str(texture.device)
    bare = torch.from_numpy(np.stack([view.bare for view in views if view.bare is not None])).to(device)
    clear = bare.permute(0, 3, 1, 2).float() / 255, show_texture(texture, batch_views([v.view for v in views], device))
    yield "clear", clear
    # the same clouds for both paints
    seeds = [int(n) for n in draws.of("fog").integers(1 << 62, size=len(views))]
    yield "fog", (corrupt(clear[0], "fog", FOG_SEVERITY, seeds), corrupt(clear[1], "fog", FOG_SEVERITY, seeds))
    if corrupted is not None:
        # both from the same draw, so that they differ in the paint alone
        always = corrupted.with_overrides(probability=1.0)
        yield "corrupted", (
            always.change(clear[0], draws.of("corrupted")), always.change(clear[1], draws.of("corrupted")),
        )  # fmt: skip


def _show_in_weather(
    texture: torch.Tensor, views: list[RenderedView], draws: Draws, weather: ViewWeather,
    metres_per_unit: Sequence[float],
) -> Pair:  # fmt: skip
    """Views through weather that is drawn for each, both paints through the same."""
    device, always = str(texture.device), weather.with_overrides(probability=1.0)
    # once for both paints: what differs is the paint
    drawn = draw_weather(views, metres_per_unit, always, weather.rng(draws))
    factor, offset = (part.to(device) for part in drawn)
    lights = np.stack([view.view.bare for view in views if view.view.bare is not None])
    bare = tone_map(torch.from_numpy(lights).to(device).float() * factor + offset).permute(0, 3, 1, 2)
    return bare, show_texture(texture, batch_views([view.view for view in views], device).through(factor, offset))
