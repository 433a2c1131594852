"""What the controls say, in words: is it this patch or texture, which is better, is the object read or the sticker."""

from collections.abc import Sequence
from dataclasses import dataclass

from toolkit.captures.read import POOLED, UNPATCHED
from toolkit.evaluation.controls import Comparison
from toolkit.evaluation.metrics import Group, Pair
from toolkit.evaluation.order import ALONE, NOUNS, PATCHED, RIVALS, TEXTURED, WRONG
from toolkit.evaluation.say import SIGNIFICANT, Headline, say_count, say_share, say_test

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
