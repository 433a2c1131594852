"""The pairs that a variant changed against `unpatched`: gained, and lost; which of them are shown."""

from collections import Counter
from dataclasses import dataclass

from toolkit.evaluation.metrics import ALONE, Pair, Poses, pair_with_unpatched, rank_variant

MAX_FLIPS = 40


@dataclass(frozen=True)
class FlipList:
    """Pairs that changed one way.

    Attributes:
        kind: `gained` or `lost`.
        shown: the pairs that are shown: by variant, boosters before controls, the surest of each first.
        counts: (variant, how many there are), in the order of `rank_variant`.
    """

    kind: str
    shown: tuple[Pair, ...]
    counts: tuple[tuple[str, int], ...]

    @property
    def n(self) -> int:
        """How many there are."""
        return sum(count for _, count in self.counts)


def list_flips(poses: Poses) -> tuple[FlipList, FlipList]:
    """The pairs that were gained and those that were lost against `unpatched`, at most 40 of each shown.

    `patch-alone` is left out: without the object its images are no before and after of one thing.
    """
    pairs = [pair for name, own in pair_with_unpatched(poses).items() if name != ALONE for pair in own]
    gained, lost = [pair for pair in pairs if pair.is_gained], [pair for pair in pairs if pair.is_lost]
    return _pick_flips("gained", gained), _pick_flips("lost", lost)


def _pick_flips(kind: str, flips: list[Pair]) -> FlipList:
    flips.sort(key=lambda pair: (rank_variant(pair.second.capture.variant), -abs(pair.change)))
    counts = Counter(pair.second.capture.variant for pair in flips)
    return FlipList(kind, tuple(flips[:MAX_FLIPS]), tuple(counts.items()))
