"""The result in words: does the booster help, is it this booster, what do the controls say, how sure is that."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.core.statistics import mcnemar_p, wilson_interval
from toolkit.evaluation.metrics import (
    ALONE,
    NOUNS,
    OWNERS,
    PATCHED,
    RIVALS,
    TEXTURED,
    WRONG,
    Group,
    Pair,
    index_poses,
    name_booster,
)
from toolkit.evaluation.predict import Prediction
from toolkit.rig.variants import CONTROLS_OF

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


STICKER, EITHER = "object or sticker?", "patch or texture?"
MOST = 0.5


@dataclass(frozen=True)
class Pooled:
    """The pooled rows of one source, by variant."""

    groups: dict[str, Group]
    pairs: dict[str, Pair]
    comparisons: dict[tuple[str, str], Comparison]


def pool_rows(source: str, groups: Sequence[Group], pairs: Sequence[Pair], comparisons: Sequence[Comparison]) -> Pooled:
    """What is needed to answer for one source."""
    return Pooled(
        {row.variant: row for row in groups if (row.source, row.object) == (source, POOLED)},
        {row.variant: row for row in pairs if (row.source, row.object) == (source, POOLED)},
        {(row.first, row.second): row for row in comparisons if (row.source, row.object) == (source, POOLED)},
    )


def answer_controls(arch: str, source: str, rows: Pooled) -> list[Headline]:
    """The answers that the variants of a source allow, none where there are no controls and no two boosters."""
    answers = []
    for booster, names in RIVALS.items():
        rivals = [rows.comparisons[booster, name] for name in names if (booster, name) in rows.comparisons]
        if rivals:
            answers.append(_is_this(arch, source, booster, rows, rivals))
        alone = rows.groups.get(ALONE)
        if booster == PATCHED and alone is not None and alone.n:
            answers.append(_object_or_sticker(arch, source, alone, rows))
    either = rows.comparisons.get((PATCHED, TEXTURED))
    if either is not None:
        answers.append(_patch_or_texture(arch, source, either))
    return answers


def ask_help(variant: str) -> str:
    """`does the patch help?`, empty for a variant that is no booster of this kit."""
    return f"does the {NOUNS[variant]} help?" if variant in NOUNS else ""


def ask_this(booster: str) -> str:
    """`is it this patch?` or texture."""
    return f"is it this {NOUNS[booster]}?"


def _is_this(arch: str, source: str, booster: str, rows: Pooled, rivals: Sequence[Comparison]) -> Headline:
    noun = NOUNS[booster]
    # of equal ones the hardest to beat: with the fewest poses that only the booster got right
    best = max(rivals, key=lambda row: (row.n_second / row.n_pairs, row.only_second - row.only_first))
    beaten = [row for row in rivals if row.mcnemar_p < SIGNIFICANT and row.only_first > row.only_second]
    helps = rows.pairs.get(booster)
    tone, verdict = "open", f"Not shown to be this {noun}"
    if best.mcnemar_p < SIGNIFICANT and best.only_second > best.only_first:
        tone, verdict = "bad", f"It is not this {noun}: '{best.second}' does better"
    elif len(beaten) == len(rivals) and (helps is None or not _helps(helps)):
        verdict = f"This {noun} beats its controls, but is not shown to help"
    elif len(beaten) == len(rivals):
        tone, verdict = "good", f"It is this {noun}"
    elif helps is not None and not _helps(helps):
        verdict = f"No help shown, so none to put down to this {noun}"
    elif best in beaten:
        verdict = "Not shown against every control"
    which = f"the best control, '{best.second}'" if len(rivals) > 1 else f"'{best.second}', the only control shot"
    sentence = (
        f"On the same {best.n_pairs} poses {arch} is right on {say_count(best.n_first, best.n_pairs)} with the {noun} "
        f"and on {say_count(best.n_second, best.n_pairs)} with {which}: {best.only_first} only with the {noun} and "
        f"{best.only_second} only with the control ({say_test(best.mcnemar_p)})."
    )
    wrong = rows.comparisons.get((UNPATCHED, WRONG)) if booster == PATCHED else None
    if wrong is not None:
        sentence += f" {_say_wrong(wrong)}"
    return Headline(source, booster, tone, verdict, sentence, ask_this(booster))


def _patch_or_texture(arch: str, source: str, row: Comparison) -> Headline:
    tone, verdict = "open", "No difference shown between patch and texture"
    if row.mcnemar_p < SIGNIFICANT:
        tone, verdict = "good", f"The {'patch' if row.only_first > row.only_second else 'texture'} does better"
    sentence = (
        f"On the same {row.n_pairs} poses {arch} is right on {say_count(row.n_first, row.n_pairs)} with the patch and "
        f"on {say_count(row.n_second, row.n_pairs)} with the texture: {row.only_first} only with the patch and "
        f"{row.only_second} only with the texture ({say_test(row.mcnemar_p)})."
    )
    return Headline(source, TEXTURED, tone, verdict, sentence, EITHER)


def _say_wrong(row: Comparison) -> str:
    """What another class's patch does to the true class."""
    says = f"; its commonest mistake is '{row.says}' ({row.n_says} of {row.n_pairs})" if row.says else ""
    return (
        f"With another class's patch the true class is recognised on {say_count(row.n_second, row.n_pairs)}, against "
        f"{say_count(row.n_first, row.n_pairs)} bare ({row.only_second} gained, {row.only_first} lost, "
        f"{say_test(row.mcnemar_p)}), its mean probability going from {row.prob_first:.2f} to {row.prob_second:.2f}"
        f"{says}."
    )


def _object_or_sticker(arch: str, source: str, alone: Group, rows: Pooled) -> Headline:
    low, high = alone.top1_ci95
    row = rows.comparisons.get((PATCHED, ALONE))
    sentence = f"The sticker alone, with no object, is enough for {arch} in {say_share(alone)} of its poses"
    if row is None:
        sentence += "; nothing was shot with the patch on the object to compare it with."
    else:
        sentence += (
            f"; of {row.n_pairs} poses shot both ways, patch and object together are right on "
            f"{say_count(row.n_first, row.n_pairs)}: {row.only_first} only with the object, {row.only_second} only "
            f"without it ({say_test(row.mcnemar_p)})."
        )
    needs_object = row is not None and row.mcnemar_p < SIGNIFICANT and row.only_first > row.only_second
    if low > MOST:
        tone, verdict = "bad", "It is the sticker that is read"
        if needs_object:
            verdict = "Mostly the sticker is read; the object adds to it"
    elif needs_object and high < MOST:
        tone, verdict = "good", "The object is read: the sticker alone is mostly not enough"
    elif needs_object:
        tone, verdict = "open", "Both: the sticker alone is often enough, the object adds to it"
    elif high < MOST:
        tone, verdict = "open", "The sticker alone is mostly not enough, nor is the patched object shown to be better"
    else:
        tone, verdict = "open", "The object is not shown to add to the sticker"
    return Headline(source, ALONE, tone, verdict, sentence, STICKER)


def _helps(pair: Pair) -> bool:
    return pair.mcnemar_p < SIGNIFICANT and pair.gained > pair.lost


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
        return _headline_compare(arch, before, group, rows.pairs.get(variant), question)
    sentence = f"{arch} is right on {say_share(group)} of the {variant} images."
    return Headline(group.source, variant, "open", "Accuracy alone, nothing to compare with", sentence, question)


def _headline_compare(arch: str, before: Group, after: Group, pair: Pair | None, question: str) -> Headline:
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
