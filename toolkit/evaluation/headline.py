"""The result in words: does the booster help, is it this booster, and how sure is that."""

from collections.abc import Sequence

from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.evaluation.answers import Pooled, answer_controls, ask_help, pool_rows
from toolkit.evaluation.controls import Comparison
from toolkit.evaluation.metrics import Group, Pair
from toolkit.evaluation.order import ALONE, OWNERS, name_booster
from toolkit.evaluation.say import SIGNIFICANT, Headline, say_share, say_test

ONE_WAY_FLIPS = 6
"""The fewest pairs that must change, all one way, for an exact McNemar p below 0.05: 2 · 0.5⁶ = 0.031."""


def write_headlines(
    arch: str, groups: Sequence[Group], pairs: Sequence[Pair], comparisons: Sequence[Comparison] = ()
) -> list[Headline]:
    """For each source: a headline per booster, or for a source with nothing to compare, then what the controls say."""
    headlines = []
    for source in dict.fromkeys(group.source for group in groups if group.object == POOLED):
        rows = pool_rows(source, groups, pairs, comparisons)
        answers = answer_controls(arch, source, rows)
        for variant in _pick_variants(rows):
            headlines.append(_head(arch, rows, variant, ask_help(variant) if answers else ""))
        headlines += answers
    return headlines


def _pick_variants(rows: Pooled) -> list[str]:
    """What gets a headline of its own: boosters; controls where the booster that they belong to was not shot."""
    boosters = [name for name in rows.groups if name not in (UNPATCHED, ALONE) and OWNERS.get(name) not in rows.groups]
    return boosters or ([UNPATCHED] if UNPATCHED in rows.groups else [])


def _head(arch: str, rows: Pooled, variant: str, question: str) -> Headline:
    group, before = rows.groups[variant], rows.groups.get(UNPATCHED)
    if variant != UNPATCHED and before is not None:
        return _compare(arch, before, group, rows.pairs.get(variant), question)
    sentence = f"{arch} is right on {say_share(group)} of the {variant} images."
    return Headline(group.source, variant, "open", "Accuracy alone, nothing to compare with", sentence, question)


def _compare(arch: str, before: Group, after: Group, pair: Pair | None, question: str) -> Headline:
    name = name_booster(after.variant)
    shares = f"{arch} is right on {say_share(after)} with {name} and on {say_share(before)} without."
    start = name[0].upper() + name[1:]
    if pair is None:
        verdict, why = "Nothing could be paired", "No pose was shot both ways, so no paired test is possible."
        return Headline(after.source, after.variant, "open", verdict, f"{shares} {why}", question)
    of_pairs = f"Of {pair.n_pairs} pairs, {pair.gained} became right and {pair.lost} became wrong"
    sentence = f"{shares} {of_pairs} ({say_test(pair.mcnemar_p)})."
    tone, verdict = "open", "No difference shown"
    if pair.mcnemar_p < SIGNIFICANT:
        tone, verdict = ("good", f"{start} helps") if pair.gained > pair.lost else ("bad", f"{start} harms")
    else:
        sentence += f" It takes at least {ONE_WAY_FLIPS} pairs that change, all one way, for p < {SIGNIFICANT}."
    return Headline(after.source, after.variant, tone, verdict, sentence, question)
