"""Results in words: whether the booster helps, and what the controls show."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from toolkit.captures.capture import UNPATCHED
from toolkit.captures.read import POOLED
from toolkit.core.statistics import SIGNIFICANT, PairedOutcomes
from toolkit.core.tables import format_count, format_test
from toolkit.core.text import count_of
from toolkit.evaluation.metrics import (
    ALONE,
    NOUNS,
    OWNERS,
    PATCHED,
    RIVALS,
    TEXTURED,
    WRONG,
    Comparison,
    Group,
    gather,
    name_booster,
)

STICKER, EITHER = "object or sticker?", "patch or texture?"
MOST = 0.5
ONE_WAY_FLIPS = 6
"""Fewest changed pairs, all in one direction, for an exact McNemar p below 0.05."""
Groups = Mapping[str, Group]
"""Pooled groups of a source, by variant."""
Comparisons = Mapping[tuple[str, str], Comparison]
"""Pooled comparisons of a source, by both variants."""


@dataclass(frozen=True)
class Verdict:
    """A finding in words.

    Attributes:
        tone: `good`, `bad` or `open`.
        sentence: result with its numbers.
        verdict: result in a few words; empty if the sentence is enough.
        question: question that it answers, if the variants were shot for it.
        brief: numbers in a few words; empty if the verdict has them.
    """

    tone: str
    sentence: str
    verdict: str = ""
    source: str = ""
    variant: str = ""
    question: str = ""
    brief: str = ""

    def as_json(self) -> dict[str, str]:
        """Return the fields of `summary.json`."""
        return {key: getattr(self, key) for key in ("source", "question", "tone", "verdict", "sentence")}


def find_tone(interval: tuple[float | None, float | None] | None, none: float = 0.0) -> str:
    """Return `good` or `bad` if the whole interval is above or below no effect, else `open`; an end may be None."""
    low, high = interval or (None, None)
    return "good" if low is not None and low > none else "bad" if high is not None and high < none else "open"


def write_headlines(network: str, groups: Sequence[Group], comparisons: Sequence[Comparison]) -> list[Verdict]:
    """Return for each source a headline for each booster, then the results of the controls."""
    headlines = []
    pooled_of = gather((group for group in groups if group.object == POOLED), lambda group: [group.source])
    rows_of = gather((row for row in comparisons if row.object == POOLED), lambda row: [row.source])
    for source, own in pooled_of.items():
        pooled = {row.variant: row for row in own}
        rows = {(row.first, row.second): row for row in rows_of.get(source, ())}
        answers = _answer_controls(network, pooled, rows)
        # controls have a headline only if their booster was not shot
        boosters = [name for name in pooled if name not in (UNPATCHED, ALONE) and OWNERS.get(name) not in pooled]
        for variant in boosters or ([UNPATCHED] if UNPATCHED in pooled else []):
            question = ask_help(variant) if answers else ""
            headlines.append(_judge_booster(network, pooled, rows.get((UNPATCHED, variant)), variant, question))
        headlines += answers
    return headlines


def ask_help(variant: str) -> str:
    """Return `does the patch help?`; empty for a variant that is not a built-in booster."""
    return f"does the {NOUNS[variant]} help?" if variant in NOUNS else ""


def ask_this(booster: str) -> str:
    """Return `is it this patch?` or `is it this texture?`."""
    return f"is it this {NOUNS[booster]}?"


def _judge_booster(network: str, groups: Groups, row: Comparison | None, variant: str, question: str) -> Verdict:
    after, before = groups[variant], groups.get(UNPATCHED)
    # without the unmodified object there is only an accuracy
    if variant == UNPATCHED or before is None:
        sentence = f"{network} is correct on {_format_group(after)} of the {variant} images."
        verdict = "Accuracy alone, nothing to compare with"
        return Verdict("open", sentence, verdict, after.source, variant, question)
    # accuracy with and without the booster
    name, where = name_booster(variant), ""
    counts = (after.n_top1, after.n), (before.n_top1, before.n)
    if row is not None and {after.n, before.n} != {row.outcomes.n}:  # images without a partner do not count
        counts = (row.outcomes.n_second, row.outcomes.n), (row.outcomes.n_first, row.outcomes.n)
        where = f", at the {row.outcomes.n} poses shot both ways"
    with_it, without = (format_count(*count) for count in counts)
    shares = f"{network} is correct on {with_it} with {name} and on {without} without{where}."
    if row is None:
        verdict, why = "Nothing could be paired", "No pose was shot both ways, so no paired test is possible."
        return Verdict("open", f"{shares} {why}", verdict, after.source, variant, question)
    tone, verdict, why = judge_change(name, row.outcomes)
    found = row.outcomes
    brief = f"{found.n_first} → {found.n_second} of {found.n} correct ({format_test(found.mcnemar_p)})"
    return Verdict(tone, f"{shares} {why}", verdict, after.source, variant, question, brief)


def judge_change(name: str, outcomes: PairedOutcomes) -> tuple[str, str, str]:
    """Return tone, verdict and reason whether `name` helps; the first of each pair is without it."""
    sentence = (
        f"Of {count_of(outcomes.n, 'pair')}, {outcomes.only_second} became correct and {outcomes.only_first} became "
        f"wrong ({format_test(outcomes.mcnemar_p)})."
    )
    start = name[0].upper() + name[1:]
    if outcomes.second_is_better:
        return "good", f"{start} helps", sentence
    if outcomes.first_is_better:
        return "bad", f"{start} harms", sentence
    few = f"It takes at least {ONE_WAY_FLIPS} pairs that change, all one way, for p < {SIGNIFICANT}."
    return "open", describe_unsure(outcomes), f"{sentence} {few}"


def describe_unsure(outcomes: PairedOutcomes) -> str:
    """Return the direction of a result that is not significant; never that there is no effect."""
    gained, lost = outcomes.only_second, outcomes.only_first
    if not gained and not lost:
        return "No pair changed"
    if gained and lost:
        return f"{count_of(gained, 'pair')} became correct and {lost} wrong: not enough to tell"
    count = f"{count_of(gained or lost, 'pair')} {'is' if gained + lost == 1 else 'are'}"
    way = "Better" if gained else "Worse"
    return f"{way} in every pair that changed; {count} too few to be sure: {ONE_WAY_FLIPS} needed"


def _answer_controls(network: str, groups: Groups, rows: Comparisons) -> list[Verdict]:
    """Return the answers that the variants of a source allow."""
    answers = []
    # each booster against its controls, if any was shot
    for booster, names in RIVALS.items():
        rivals = [rows[booster, name] for name in names if (booster, name) in rows]
        if rivals:
            answers.append(_is_it_this(network, booster, rows, rivals))
        alone = groups.get(ALONE)
        if booster == PATCHED and alone is not None and alone.n:
            answers.append(_object_or_sticker(network, alone, rows.get((PATCHED, ALONE))))
    # patch and texture on the same poses
    if (either := rows.get((PATCHED, TEXTURED))) is not None:
        tone, verdict, names = "open", "No difference shown between patch and texture", ("the patch", "the texture")
        if either.outcomes.first_is_better or either.outcomes.second_is_better:
            tone, verdict = "good", f"The {'patch' if either.outcomes.first_is_better else 'texture'} does better"
        sentence = _compare_both(network, either.outcomes, names, names)
        answers.append(Verdict(tone, sentence, verdict, either.source, TEXTURED, EITHER))
    return answers


def _is_it_this(network: str, booster: str, rows: Comparisons, rivals: Sequence[Comparison]) -> Verdict:
    noun = NOUNS[booster]
    # of equal controls the hardest to beat: with the fewest poses that only the booster gains
    best = max(
        rivals,
        key=lambda row: (row.outcomes.n_second / row.outcomes.n, row.outcomes.only_second - row.outcomes.only_first),
    )
    # controls that the booster beats significantly
    beaten = [row for row in rivals if row.outcomes.first_is_better]
    against_none = rows.get((UNPATCHED, booster))
    # without `unpatched`, nothing shows that the booster does not help
    helps = against_none is None or against_none.outcomes.second_is_better
    tone, verdict = "open", f"Not shown to be this {noun}"
    if best.outcomes.second_is_better:
        tone, verdict = "bad", f"It is not this {noun}: '{best.second}' does better"
    elif len(beaten) == len(rivals):
        tone, verdict = ("good", f"It is this {noun}") if helps else (
            "open", f"This {noun} beats its controls, but is not shown to help"
        )  # fmt: skip
    elif not helps:
        verdict = f"No help is shown that this {noun} could have caused"
    elif best in beaten:
        verdict = "Not shown against every control"
    which = f"the best control, '{best.second}'" if len(rivals) > 1 else f"'{best.second}', the only control shot"
    sentence = _compare_both(network, best.outcomes, (f"the {noun}", which), (f"the {noun}", "the control"))
    wrong = rows.get((UNPATCHED, WRONG)) if booster == PATCHED else None
    if wrong is not None:
        sentence += f" {_describe_wrong(wrong)}"
    brief = (
        f"{best.outcomes.n_first} of {best.outcomes.n} correct with the {noun}, {best.outcomes.n_second} with {which}"
    )
    return Verdict(tone, sentence, verdict, best.source, booster, ask_this(booster), brief)


def _compare_both(network: str, found: PairedOutcomes, names: tuple[str, str], short: tuple[str, str]) -> str:
    return (
        f"On the same {found.n} poses {network} is correct on {format_count(found.n_first, found.n)} with {names[0]} "
        f"and on {format_count(found.n_second, found.n)} with {names[1]}: {found.only_first} only with {short[0]} and "
        f"{found.only_second} only with {short[1]} ({format_test(found.mcnemar_p)})."
    )


def _describe_wrong(row: Comparison) -> str:
    """Return a sentence on the effect of another class's patch."""
    found = row.outcomes
    says, count = row.commonest_mistake
    mistake = f"; its commonest mistake is '{says}' ({count} of {found.n})" if says else ""
    return (
        f"With another class's patch the true class is recognised on {format_count(found.n_second, found.n)}, against "
        f"{format_count(found.n_first, found.n)} without a patch ({found.only_second} gained, {found.only_first} lost, "
        f"{format_test(found.mcnemar_p)}), its mean probability goes from {row.prob_first:.2f} to "
        f"{row.prob_second:.2f}{mistake}."
    )


def _object_or_sticker(network: str, alone: Group, row: Comparison | None) -> Verdict:
    # the patch without the object
    low, high = alone.top1_ci95
    sentence = f"The sticker alone, with no object, is enough for {network} in {_format_group(alone)} of its poses"
    if row is None:
        sentence += "; nothing was shot with the patch on the object to compare it with."
    else:
        found = row.outcomes
        sentence += (
            f"; of {found.n} poses shot both ways, patch and object together are correct on "
            f"{format_count(found.n_first, found.n)}: {found.only_first} only with the object, {found.only_second} "
            f"only without it ({format_test(found.mcnemar_p)})."
        )
    needs_object = row is not None and row.outcomes.first_is_better
    # "mostly" needs the whole interval above a half
    if low > MOST:
        tone, verdict = "bad", "The network recognises the sticker, not the object"
        if needs_object:
            verdict = "The network mostly recognises the sticker; the object adds to it"
    elif needs_object and high < MOST:
        tone, verdict = "good", "The network needs the object: the sticker alone is mostly not enough"
    elif needs_object:
        tone, verdict = "open", "Both: the sticker alone is often enough, the object adds to it"
    elif high < MOST:
        tone, verdict = "open", "The sticker alone is mostly not enough; that the object adds to it is not shown"
    else:
        tone, verdict = "open", "The object is not shown to add to the sticker"
    brief = f"{alone.n_top1} of {alone.n} correct with the sticker alone"
    return Verdict(tone, sentence, verdict, alone.source, ALONE, STICKER, brief)


def _format_group(group: Group) -> str:
    return format_count(group.n_top1, group.n)
