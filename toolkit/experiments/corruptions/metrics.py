"""From ranks to numbers: shares, means, corruption errors and differences, with what they can show."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from toolkit.captures.read import UNPATCHED
from toolkit.core.errors import ToolkitError
from toolkit.core.severities import SEVERITIES
from toolkit.core.statistics import Interval, mcnemar_p, wilson_interval
from toolkit.corruptions.catalogue import COMMON, CORRUPTIONS, IMAGENET
from toolkit.experiments.corruptions.config import CLEAN, NOT_CORRUPTED, Condition
from toolkit.experiments.corruptions.grid import Benchmark
from toolkit.experiments.corruptions.recognisers import NOT_DECODED, READER, RIGHT, WRONG
from toolkit.experiments.corruptions.summary import Against, Cell, CorruptionMean, Difference, Summary, VariantMean
from toolkit.experiments.corruptions.verdict import describe_mean

ALEXNET_ERRORS = {
    "gaussian_noise": 0.886428,
    "shot_noise": 0.894468,
    "impulse_noise": 0.922640,
    "defocus_blur": 0.819880,
    "glass_blur": 0.826268,
    "motion_blur": 0.785948,
    "zoom_blur": 0.798360,
    "snow": 0.866816,
    "frost": 0.826572,
    "fog": 0.819324,
    "brightness": 0.564592,
    "contrast": 0.853204,
    "elastic_transform": 0.646056,
    "pixelate": 0.717840,
    "jpeg_compression": 0.606500,
}
"""Top-1 error, mean of the five severities on the 50 000 images of ImageNet-C.

Hendrycks and Dietterich, ICLR 2019, Table 1 (there in whole per cent), to the digits of their code in
hendrycks/robustness.
"""

ALEXNET_SOURCE = (
    "errors of AlexNet on ImageNet-C as published (Hendrycks and Dietterich 2019, Table 1; hendrycks/robustness). They "
    "are of ImageNet's 50 000 validation images: on other images, or with patches on them, the quotient does not "
    "compare with a published mCE"
)
UNPATCHED_SOURCE = "errors of the same network on this run's own images without a patch, under the same corruptions"


NO_SPREAD = 1e-12
Estimate = tuple[float, Interval | None]
"""A mean over images, and its interval over classes; None where it cannot be told: one class, or no spread."""


def estimate_share(scores: np.ndarray, classes: np.ndarray) -> Estimate:
    """Mean of `scores` in [0, 1], with a 95 % interval that takes classes, not images, as the independent draws.

    An image's score is the share of the cells (corruptions and severities) in which it was right: cells share images,
    and the images of a class share its patch, so neither cells nor images are independent draws. With total y_c and
    number of images x_c of class c, the mean is the ratio p = Σ y_c / Σ x_c, and

        v = C / (C - 1) · Σ (y_c - p x_c)² / (Σ x_c)²,    p ± t(0.975, C - 1) √v

    the ratio estimator of a sample of C whole clusters (Cochran, Sampling Techniques, 3rd ed. 1977, sections 6.3 and
    9A.1, with no finite population; the same as the cluster-robust variance of a mean). Where all classes are wholly
    right, or wholly wrong, v is 0 and says nothing: then it is Wilson's interval with each class as one trial.

    Args:
        scores: (n,) float.
        classes: (n,) int, the class of each image.
    """
    mean, half, n_classes = _ratio(scores, classes)
    if n_classes == 1:
        return mean, None
    if half > NO_SPREAD:
        return mean, (max(0.0, mean - half), min(1.0, mean + half))
    if min(mean, 1 - mean) < NO_SPREAD:
        return mean, wilson_interval(round(mean) * n_classes, n_classes)
    return mean, None


def estimate_difference(scores: np.ndarray, other: np.ndarray, classes: np.ndarray) -> Estimate:
    """Mean of `scores` less that of `other` on the same images; the interval is that of `estimate_share`, paired."""
    mean, half, n_classes = _ratio(np.asarray(scores, float) - other, classes)
    if n_classes == 1 or half <= NO_SPREAD:
        return mean, None
    return mean, (max(-1.0, mean - half), min(1.0, mean + half))


def _ratio(scores: np.ndarray, classes: np.ndarray) -> tuple[float, float, int]:
    """(ratio, half width of its interval, number of classes)."""
    from scipy.stats import t

    _, member = np.unique(classes, return_inverse=True)
    totals, sizes = np.bincount(member, weights=scores), np.bincount(member)
    n_classes = len(sizes)
    mean = float(totals.sum() / sizes.sum())
    if n_classes == 1:
        return mean, 0.0, 1
    spread = n_classes / (n_classes - 1) * float(((totals - mean * sizes) ** 2).sum())
    return mean, float(t.ppf(0.975, n_classes - 1)) * sqrt(spread) / float(sizes.sum()), n_classes


TOP = 5


@dataclass(frozen=True)
class Series:
    """What one recogniser said of one variant: condition -> (n,) ranks."""

    variant: str
    recogniser: str
    kind: str
    ranks: dict[Condition, np.ndarray]

    def average(self, is_so: Callable[[np.ndarray], np.ndarray], keys: Sequence[Condition]) -> np.ndarray:
        """(n,) share of cells in which this is so of an image: over severities, then over corruptions."""
        shares: dict[str, list[np.ndarray]] = {}
        for corruption, severity in keys:
            shares.setdefault(corruption, []).append(is_so(self.ranks[corruption, severity]))
        return np.mean([np.mean(own, axis=0) for own in shares.values()], axis=0)

    def right(self, keys: Sequence[Condition]) -> np.ndarray:
        """(n,) `average` of being right at the first guess."""
        return self.average(lambda ranks: ranks == RIGHT, keys)

    def top5(self, keys: Sequence[Condition]) -> float | None:
        """Share with the truth among five guesses; None for a reader, and without cells."""
        return float(self.average(lambda ranks: ranks <= TOP, keys).mean()) if self.kind != READER and keys else None

    def answered(self, answer: int, keys: Sequence[Condition]) -> float | None:
        """Share with this answer of a reader; None for a network, and without cells."""
        return float(self.average(lambda ranks: ranks == answer, keys).mean()) if self.kind == READER and keys else None


def summarise(benchmark: Benchmark) -> Summary:
    """Every table of the benchmark.

    Raises:
        ToolkitError: two networks have one name.
        ValueError: a cell has not one rank per image, or the variants have not all the same cells.
    """
    every = _collect(benchmark)
    levels: dict[str, tuple[int, ...]] = {
        name: tuple(sorted(severity for corruption, severity in every[0].ranks if corruption == name))
        for name in CORRUPTIONS
    }
    levels = {name: own for name, own in levels.items() if own}
    common = [(name, severity) for name in levels if name in COMMON for severity in levels[name]]
    is_whole = all(levels.get(name) == SEVERITIES for name in COMMON)
    unpatched = {one.recogniser: one for one in every if one.variant == UNPATCHED}
    references = {"unpatched": UNPATCHED_SOURCE} if unpatched else {}
    if benchmark.about.get("is_imagenet") and benchmark.about.get("parameters") == IMAGENET:
        references["alexnet"] = ALEXNET_SOURCE
    classes, alexnet = benchmark.classes, ALEXNET_ERRORS if "alexnet" in references else {}
    means: list[CorruptionMean] = []
    rows: list[VariantMean] = []
    for one in every:
        own = [
            _mean_corruption(
                one, unpatched.get(one.recogniser), [(name, each) for each in levels[name]], classes, alexnet
            )
            for name in levels
        ]
        means += own
        rows.append(_mean_variant(one, own, common, is_whole, benchmark))
    return Summary(
        about=benchmark.about,
        n=len(benchmark.ids),
        n_classes=len(np.unique(benchmark.classes)),
        corruptions=levels,
        mean_of=describe_mean(levels, is_whole),
        is_whole=is_whole,
        references=references,
        variants=tuple(rows),
        differences=tuple(_compare(every, rows, common, benchmark.classes)),
        means=tuple(means),
        cells=tuple(cell for one in every for cell in _count_cells(one, unpatched.get(one.recogniser), tuple(levels))),
        failed=tuple({"path": path, "reason": reason} for path, reason in benchmark.failed),
        notes=benchmark.notes,
    )


def _collect(benchmark: Benchmark) -> list[Series]:
    """By recogniser as they come, each with `unpatched` first."""
    n = len(benchmark.ids)
    by_row: dict[tuple[str, str], Series] = {}
    for one in benchmark.cells:
        series = by_row.setdefault((one.variant, one.recogniser), Series(one.variant, one.recogniser, one.kind, {}))
        if np.shape(one.ranks) != (n,) or n == 0:
            raise ValueError(f"ranks of {one.variant}, {one.corruption}: {np.shape(one.ranks)} for {n} images")
        if (one.corruption, one.severity) in series.ranks:
            raise ToolkitError(
                f"two networks called '{one.recogniser}' saw {one.variant}: give one another name, or evaluate "
                "them in runs of their own"
            )
        series.ranks[one.corruption, one.severity] = np.asarray(one.ranks)
    if len({frozenset(one.ranks) for one in by_row.values()}) != 1:
        raise ValueError("every variant and recogniser needs ranks under the same corruptions and severities")
    recognisers = list(dict.fromkeys(recogniser for _, recogniser in by_row))
    return sorted(by_row.values(), key=lambda one: (recognisers.index(one.recogniser), one.variant != UNPATCHED))


def _mean_corruption(
    one: Series,
    unpatched: Series | None,
    keys: Sequence[Condition],
    classes: np.ndarray,
    alexnet: Mapping[str, float],
) -> CorruptionMean:
    """Mean over the severities of one corruption, `keys`; `alexnet` has the errors that it may be divided by."""
    name, severities = keys[0][0], tuple(severity for _, severity in keys)
    top1, ci95 = estimate_share(one.right(keys), classes)
    error = 1 - float(one.right(keys).mean())
    ce_alexnet = ce_unpatched = None
    if one.kind != READER:
        if name in alexnet and severities == SEVERITIES:
            ce_alexnet = error / alexnet[name]
        if unpatched is not None:
            reference = 1 - float(unpatched.right(keys).mean())
            ce_unpatched = error / reference if reference > 0 else None
    return CorruptionMean(
        one.variant,
        one.recogniser,
        one.kind,
        corruption=name,
        family=CORRUPTIONS[name].family,
        top1=top1,
        top1_ci95=ci95,
        top5=one.top5(keys),
        wrong=one.answered(WRONG, keys),
        not_decoded=one.answered(NOT_DECODED, keys),
        ce_alexnet=ce_alexnet,
        ce_unpatched=ce_unpatched,
    )


def _mean_variant(
    one: Series, means: Sequence[CorruptionMean], common: Sequence[Condition], is_whole: bool,
    benchmark: Benchmark,
) -> VariantMean:  # fmt: skip
    clean = [NOT_CORRUPTED] if NOT_CORRUPTED in one.ranks else []
    sizes = {entry["name"]: entry.get("patch_px") for entry in benchmark.about.get("variants", [])}
    top1, ci95 = estimate_share(one.right(common), benchmark.classes) if common else (None, None)
    own = [mean for mean in means if mean.corruption in COMMON]
    return VariantMean(
        one.variant,
        one.recogniser,
        one.kind,
        patch_px=sizes.get(one.variant),
        clean_top1=float(one.right(clean).mean()) if clean else None,
        clean_top5=one.top5(clean),
        clean_wrong=one.answered(WRONG, clean),
        clean_not_decoded=one.answered(NOT_DECODED, clean),
        top1=top1,
        top1_ci95=ci95,
        top5=one.top5(common),
        wrong=one.answered(WRONG, common),
        not_decoded=one.answered(NOT_DECODED, common),
        mce_alexnet=_mean_of_all([mean.ce_alexnet for mean in own]) if is_whole else None,
        mce_unpatched=_mean_of_all([mean.ce_unpatched for mean in own]) if is_whole else None,
    )


def _mean_of_all(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known and len(known) == len(values) else None


def _count_cells(one: Series, unpatched: Series | None, corruptions: Sequence[str]) -> list[Cell]:
    order = {name: i for i, name in enumerate((CLEAN, *corruptions))}
    cells = []
    for key in sorted(one.ranks, key=lambda key: (order[key[0]], key[1])):
        ranks = one.ranks[key]
        is_right = ranks == RIGHT
        n, right = len(ranks), int(is_right.sum())
        is_reader = one.kind == READER
        gained = lost = None
        if unpatched is not None and one.variant != UNPATCHED:
            before = unpatched.ranks[key] == RIGHT
            gained, lost = int((is_right & ~before).sum()), int((before & ~is_right).sum())
        cells.append(
            Cell(
                one.variant,
                one.recogniser,
                one.kind,
                *key,
                n=n,
                right=right,
                top1=right / n,
                top1_ci95=wilson_interval(right, n),
                top5=one.top5([key]),
                wrong=int((ranks == WRONG).sum()) if is_reader else None,
                not_decoded=int((ranks == NOT_DECODED).sum()) if is_reader else None,
                gained=gained,
                lost=lost,
                mcnemar_p=mcnemar_p(gained, lost) if gained is not None and lost is not None else None,
            )
        )
    return cells


def _compare(
    every: Sequence[Series], rows: Sequence[VariantMean], common: Sequence[Condition], classes: np.ndarray
) -> list[Difference]:
    if not common:
        return []
    scores = {(one.variant, one.recogniser): one.right(common) for one in every}
    found = []
    for one, row in zip(every, rows, strict=True):
        others: list[tuple[Against, str, str, np.ndarray]] = []
        if one.variant != UNPATCHED and (UNPATCHED, one.recogniser) in scores:
            others.append(("unpatched", UNPATCHED, one.recogniser, scores[UNPATCHED, one.recogniser]))
            before = next(other for other in every if (other.variant, other.recogniser) == (UNPATCHED, one.recogniser))
            if NOT_CORRUPTED in before.ranks:
                others.append(("clean unpatched", UNPATCHED, one.recogniser, before.right([NOT_CORRUPTED])))
        equals = [
            other for other in rows if other.patch_px == row.patch_px is not None and other.variant != row.variant
        ]
        if equals:
            best = max(equals, key=lambda other: other.top1 or 0.0)
            others.append(("best of its size", best.variant, best.recogniser, scores[best.variant, best.recogniser]))
        for against, variant, recogniser, other in others:
            estimate = estimate_difference(scores[one.variant, one.recogniser], other, classes)
            who = (one.variant, one.recogniser)
            found.append(Difference(*who, against, variant, recogniser, *estimate))
    return found
