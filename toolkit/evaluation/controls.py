"""A booster against its controls, pose by pose: another patch, noise, grey, the patch with no object under it."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.captures.variants import CONTROLS_OF
from toolkit.evaluation.metrics import index_poses
from toolkit.evaluation.order import PATCHED, TEXTURED, WRONG
from toolkit.evaluation.predict import Prediction
from toolkit.statistics import mcnemar_p, wilson_interval

COMPARED = (
    *((booster, control) for booster, controls in CONTROLS_OF.items() for control in controls),
    (PATCHED, TEXTURED),
    (UNPATCHED, WRONG),
)
"""What is compared, in this order."""


@dataclass(frozen=True)
class Comparison:
    """Two variants on the same poses; `object` is `all` for the pooled row of a source.

    Attributes:
        first, second: the variants: a booster and its control, `patched` and `textured`, or `unpatched` and
            `wrong-patch`.
        n_pairs: poses seen in both and read in both.
        n_first, n_second: on how many of these each is right.
        only_first, only_second: on how many one is right and the other is wrong.
        mcnemar_p: exact, two-sided, of `only_first` against `only_second`.
        prob_first, prob_second: mean probability of the true class.
        says, n_says: the commonest wrong first guess with `second`, and how often; None and 0 where it is always right.
    """

    source: str
    object: str
    first: str
    second: str
    n_pairs: int
    n_first: int
    n_second: int
    only_first: int
    only_second: int
    mcnemar_p: float
    prob_first: float
    prob_second: float
    says: str | None
    n_says: int

    def as_json(self) -> dict[str, Any]:
        """The fields of `summary.json`: those above, and the Wilson intervals of both shares."""
        intervals = {
            f"{name}_ci95": list(wilson_interval(count, self.n_pairs))
            for name, count in (("first", self.n_first), ("second", self.n_second))
        }
        return asdict(self) | intervals


def compare_controls(predictions: Sequence[Prediction]) -> list[Comparison]:
    """What `COMPARED` lists, by source and object, `all` last.

    Of several images of one pose the first that was read is taken. What was not shot is not compared.
    """
    pairs: dict[tuple[str, str, str, str], list[tuple[Prediction, Prediction]]] = defaultdict(list)
    for (source, name), variants in index_poses(predictions).items():
        for first, second in COMPARED:
            before, after = variants.get(first, {}), variants.get(second, {})
            shared = [(before[pose], after[pose]) for pose in sorted(before.keys() & after.keys())]
            read = [pair for pair in shared if pair[0].is_read and pair[1].is_read]
            for owner in (name, POOLED) if read else ():
                pairs[(source, owner, first, second)] += read
    return [_compare(key, pairs[key]) for key in sorted(pairs, key=_row_order)]


def _row_order(key: tuple[str, str, str, str]) -> tuple:
    source, name, first, second = key
    return source, name == POOLED, name, COMPARED.index((first, second))


def _compare(key: tuple[str, str, str, str], pairs: list[tuple[Prediction, Prediction]]) -> Comparison:
    n = len(pairs)
    only_first = sum(one.correct_top1 and not two.correct_top1 for one, two in pairs)
    only_second = sum(two.correct_top1 and not one.correct_top1 for one, two in pairs)
    wrong = Counter(two.top1_label for _, two in pairs if not two.correct_top1)
    says, n_says = min(wrong.items(), key=lambda item: (-item[1], item[0] or ""), default=(None, 0))
    return Comparison(
        *key,
        n,
        sum(one.correct_top1 for one, _ in pairs),
        sum(two.correct_top1 for _, two in pairs),
        only_first,
        only_second,
        mcnemar_p(only_first, only_second),
        sum(one.true_prob or 0.0 for one, _ in pairs) / n,
        sum(two.true_prob or 0.0 for _, two in pairs) / n,
        says,
        n_says,
    )
