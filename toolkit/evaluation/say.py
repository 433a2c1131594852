"""Numbers in words."""

from dataclasses import dataclass

from toolkit.evaluation.metrics import Group
from toolkit.statistics import wilson_interval

SIGNIFICANT = 0.05


@dataclass(frozen=True)
class Headline:
    """One source and variant in a verdict and a sentence.

    Attributes:
        source, variant: what it is about.
        tone: `good`, `bad` or `open`.
        verdict: a few words.
        sentence: the numbers behind it.
        question: that it answers, where the variants were shot to ask it.
    """

    source: str
    variant: str
    tone: str
    verdict: str
    sentence: str
    question: str = ""

    def as_json(self) -> dict[str, str]:
        """The fields of `summary.json`."""
        return {key: getattr(self, key) for key in ("source", "question", "tone", "verdict", "sentence")}


def say_count(count: int, n: int) -> str:
    """`13 of 18 (72 %, 95 % interval 49-88 %)`."""
    if n == 0:
        return "0 of 0"
    low, high = wilson_interval(count, n)
    return f"{count} of {n} ({100 * count / n:.0f} %, 95 % interval {100 * low:.0f}–{100 * high:.0f} %)"


def say_share(group: Group) -> str:
    """`say_count` of a group's images that are right."""
    return say_count(group.n_top1, group.n)


def say_p(p: float) -> str:
    """`p = 0.031`, or `p < 0.0001`."""
    return "p < 0.0001" if p < 1e-4 else f"p = {p:.2g}"


def say_test(p: float) -> str:
    """`exact McNemar p = 0.031`."""
    return f"exact McNemar {say_p(p)}"
