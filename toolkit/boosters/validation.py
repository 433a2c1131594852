"""Does the patch help on images, and in placements, that it was not trained on?"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from toolkit.boosters.data import cut_centres
from toolkit.boosters.pixels import Target
from toolkit.boosters.transforms.show import Appearance, show_patch
from toolkit.boosters.transforms.weather import Corrupted
from toolkit.core.draws import Draws
from toolkit.core.statistics import wilson_interval

if TYPE_CHECKING:
    import torch

DRAWS = 128
BATCH = 32


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
    """One network's answer: the same images, bare and with the patch."""

    network: str
    bare: Share
    patched: Share

    @property
    def falls_short(self) -> bool:
        """Whether less than half are recognised with the patch, and not surely more than without."""
        return self.patched.value < 0.5 and self.patched.ci95[0] <= self.bare.value


def count_placements(images: int, draws: int = DRAWS) -> int:
    """How many placements show each of `images` equally often, at least once, in about `draws`."""
    return max(draws, images) // images * images


def validate_patch(
    patch: "torch.Tensor",
    images: "torch.Tensor",
    targets: list[Target],
    appearance: Appearance,
    seed: int,
    *,
    draws: int = DRAWS,
    advance: Callable[[int], None] = lambda count: None,
    corrupted: Corrupted | None = None,
) -> list[Validation]:
    """Recognise images bare and with the patch in fresh random placements.

    Args:
        patch: (3, n, n) in [0, 1], as printed: rounded to 8 bits.
        images: (k, 3, s, s) uint8 sRGB, held out of training.
        targets: the networks.
        appearance: what happens to the patch; drawn anew, never as in training.
        seed: of the run.
        draws: placements in all; each image comes equally often, so that fewer images than this come several times
            in the patched share, and once in the bare one.
        advance: called with how many placements were just answered.
        corrupted: how the photographs are corrupted, with the patch and bare alike.
    """
    import torch

    count = count_placements(len(images), draws)
    bare, patched = [0] * len(targets), [0] * len(targets)
    centres = cut_centres(images, targets[0].classifier.preprocessing.crop_px)
    with torch.inference_mode():
        for start in range(0, count, BATCH):
            which = torch.arange(start, min(start + BATCH, count), device=images.device)
            batch = centres[which % len(images)]
            photos = show_patch(patch, batch, appearance, Draws(seed, start, "validate"))
            fresh = which < len(images)
            if corrupted is not None:
                photos, batch = (
                    corrupted.change(seen, Draws(seed, start, "validate").of(f"corrupted {what}"))
                    for what, seen in (("patched", photos), ("bare", batch))
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
        network = answer.network if names.index(answer.network) == k else f"{answer.network}_{k + 1}"
        for what, share in (("patched", answer.patched), ("bare", answer.bare)):
            low, high = share.ci95
            numbers = {"top1": share.value, "low": low, "high": high, "n": float(share.n)}
            final |= {f"{network}_{where}_{what}_{name}": value for name, value in numbers.items()}
    return final
