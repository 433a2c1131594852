"""Which pairs became right or wrong, and which of them are shown."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from toolkit.evaluation.metrics import Match
from toolkit.evaluation.order import ALONE, rank_variant

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
    shown: tuple[Match, ...]
    counts: tuple[tuple[str, int], ...]

    @property
    def n(self) -> int:
        """How many there are."""
        return sum(count for _, count in self.counts)


def list_flips(matches: Sequence[Match]) -> tuple[FlipList, FlipList]:
    """The pairs that were gained and those that were lost, at most 40 of each shown.

    `patch-alone` is left out: without the object its images are no before and after of one thing.
    """
    pairs = [match for match in matches if match.after.capture.variant != ALONE]
    return _pick("gained", [match for match in pairs if match.is_gained]), _pick(
        "lost", [match for match in pairs if match.is_lost]
    )


def _pick(kind: str, flips: list[Match]) -> FlipList:
    flips.sort(
        key=lambda match: (
            rank_variant(match.after.capture.variant),
            -abs((match.after.true_prob or 0) - (match.before.true_prob or 0)),
        )
    )
    counts = Counter(match.after.capture.variant for match in flips)
    return FlipList(
        kind, tuple(flips[:MAX_FLIPS]), tuple((name, counts[name]) for name in sorted(counts, key=rank_variant))
    )
