"""The result in words: does the booster help, and how sure is that."""

from collections.abc import Sequence
from dataclasses import dataclass

from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.evaluation.metrics import Group, Pair

SIGNIFICANT = 0.05
ONE_WAY_FLIPS = 6
"""The fewest pairs that must change, all one way, for an exact McNemar p below 0.05: 2 · 0.5⁶ = 0.031."""


@dataclass(frozen=True)
class Headline:
    """One source and variant in a verdict and a sentence.

    Attributes:
        source, variant: what it is about.
        tone: `good`, `bad` or `open`.
        verdict: a few words.
        sentence: the numbers behind it.
    """

    source: str
    variant: str
    tone: str
    verdict: str
    sentence: str


def write_headlines(arch: str, groups: Sequence[Group], pairs: Sequence[Pair]) -> list[Headline]:
    """One headline for each source and variant, or for a source with nothing to compare."""
    pooled = {(group.source, group.variant): group for group in groups if group.object == POOLED}
    paired = {(pair.source, pair.variant): pair for pair in pairs if pair.object == POOLED}
    headlines = []
    for source, variant in pooled:
        before = pooled.get((source, UNPATCHED))
        if variant == UNPATCHED and any(other[0] == source and other[1] != UNPATCHED for other in pooled):
            continue
        after = pooled[(source, variant)]
        if variant == UNPATCHED or before is None:
            sentence = f"{arch} is right on {say_share(after)} of the {variant} images."
            headlines.append(Headline(source, variant, "open", "Accuracy alone, nothing to compare with", sentence))
        else:
            headlines.append(_compare(arch, before, after, paired.get((source, variant))))
    return headlines


def say_share(group: Group) -> str:
    """`13 of 18 (72 %, 95 % interval 49-88 %)`."""
    if group.top1 is None:
        return "0 of 0"
    low, high = group.top1_ci95
    return f"{group.n_top1} of {group.n} ({100 * group.top1:.0f} %, 95 % interval {100 * low:.0f}–{100 * high:.0f} %)"


def say_p(p: float) -> str:
    """`p = 0.031`, or `p < 0.0001`."""
    return "p < 0.0001" if p < 1e-4 else f"p = {p:.2g}"


def _compare(arch: str, before: Group, after: Group, pair: Pair | None) -> Headline:
    name = "the patch" if after.variant == "patched" else f"'{after.variant}'"
    shares = f"{arch} is right on {say_share(after)} with {name} and on {say_share(before)} without."
    start = name[0].upper() + name[1:]
    if pair is None:
        verdict, why = "Nothing could be paired", "No pose was shot both ways, so no paired test is possible."
        return Headline(after.source, after.variant, "open", verdict, f"{shares} {why}")
    of_pairs = f"Of {pair.n_pairs} pairs, {pair.gained} became right and {pair.lost} became wrong"
    sentence = f"{shares} {of_pairs} (exact McNemar {say_p(pair.mcnemar_p)})."
    if pair.mcnemar_p < SIGNIFICANT:
        tone, verdict = ("good", f"{start} helps") if pair.gained > pair.lost else ("bad", f"{start} harms")
        return Headline(after.source, after.variant, tone, verdict, sentence)
    hint = f"It takes at least {ONE_WAY_FLIPS} pairs that change, all one way, for p < {SIGNIFICANT}."
    return Headline(after.source, after.variant, "open", "No difference shown", f"{sentence} {hint}")
