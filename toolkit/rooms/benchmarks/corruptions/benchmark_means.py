"""From ranks to numbers: shares, means, corruption errors and differences, with their intervals."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolkit.captures.capture import UNPATCHED
from toolkit.core.errors import ToolkitError
from toolkit.core.statistics import PairedOutcomes, wilson_interval
from toolkit.corruptions.catalogue import COMMON, CORRUPTIONS, IMAGENET, SEVERITIES
from toolkit.evaluation.metrics import describe_change, estimate_difference, estimate_share
from toolkit.evaluation.summaries import list_reasons
from toolkit.rooms.benchmarks.corruptions import CLEAN, NOT_CORRUPTED, Condition
from toolkit.rooms.benchmarks.corruptions.benchmark_summary import (
    Against,
    BenchmarkCell,
    CorruptionMean,
    Difference,
    Summary,
    VariantMean,
    describe_mean,
)
from toolkit.rooms.benchmarks.corruptions.grid import Benchmark
from toolkit.rooms.benchmarks.corruptions.recognisers import NOT_DECODED, READER, RIGHT, WRONG

ALEXNET_ERRORS = {
    "gaussian_noise": 0.886428, "shot_noise": 0.894468, "impulse_noise": 0.922640, "defocus_blur": 0.819880,
    "glass_blur": 0.826268, "motion_blur": 0.785948, "zoom_blur": 0.798360, "snow": 0.866816,
    "frost": 0.826572, "fog": 0.819324, "brightness": 0.564592, "contrast": 0.853204,
    "elastic_transform": 0.646056, "pixelate": 0.717840, "jpeg_compression": 0.606500,
}  # fmt: skip
"""AlexNet's mean top-1 error over the severities of ImageNet-C, in the digits of hendrycks/robustness (Hendrycks and
Dietterich, ICLR 2019, Table 1)."""

ALEXNET_SOURCE = (
    "errors of AlexNet on ImageNet-C as published (Hendrycks and Dietterich 2019, Table 1; hendrycks/robustness). They "
    "are of ImageNet's 50 000 validation images: on other images, or with patches on them, the quotient does not "
    "compare with a published mCE"
)
UNPATCHED_SOURCE = "errors of the same network on this run's own images without a patch, under the same corruptions"
TOP = 5


@dataclass(frozen=True)
class Series:
    """Answers of a network or reader to a variant: condition -> (n,) ranks."""

    variant: str
    answerer: str
    kind: str
    ranks: dict[Condition, np.ndarray]

    @property
    def who(self) -> dict[str, Any]:
        """First fields of all its rows."""
        return {"variant": self.variant, "answerer": self.answerer, "kind": self.kind}

    def average(self, is_so: Callable[[np.ndarray], np.ndarray], keys: Sequence[Condition]) -> np.ndarray:
        """(n,) share of cells in which `is_so` holds for an image: over severities, then over corruptions."""
        shares: dict[str, list[np.ndarray]] = {}
        for corruption, severity in keys:
            shares.setdefault(corruption, []).append(is_so(self.ranks[corruption, severity]))
        # every corruption counts alike, however many of its severities were run
        return np.mean([np.mean(own, axis=0) for own in shares.values()], axis=0)

    def right(self, keys: Sequence[Condition]) -> np.ndarray:
        """(n,) `average` of top-1."""
        return self.average(lambda ranks: ranks == RIGHT, keys)

    def error(self, keys: Sequence[Condition]) -> float:
        """Top-1 error."""
        return 1 - float(self.right(keys).mean())

    def others(self, keys: Sequence[Condition]) -> dict[str, Any]:
        """Shares `top5` of a network, `wrong` and `not_decoded` of a reader; None for the others, and without cells."""
        is_so = {"top5": lambda ranks: ranks <= TOP}
        if self.kind == READER:
            is_so = {"wrong": lambda ranks: ranks == WRONG, "not_decoded": lambda ranks: ranks == NOT_DECODED}
        found = {name: float(self.average(correct, keys).mean()) for name, correct in is_so.items() if keys}
        return dict.fromkeys(("top5", "wrong", "not_decoded")) | found

    def mean(self, keys: Sequence[Condition], classes: np.ndarray) -> dict[str, Any]:
        """`others`, and `top1` with its interval over classes, as images of a class share its patch."""
        top1, ci95 = estimate_share(self.right(keys), classes) if keys else (None, None)
        return {"top1": top1, "top1_ci95": ci95, **self.others(keys)}


def summarise(benchmark: Benchmark) -> Summary:
    """Every table of the benchmark.

    Raises:
        ToolkitError: two networks have the same name.
        ValueError: the ranks of a cell do not match the images, or the variants have different cells.
    """
    every = _collect(benchmark)
    found = {name: sorted(severity for other, severity in every[0].ranks if other == name) for name in CORRUPTIONS}
    levels: dict[str, tuple[int, ...]] = {name: tuple(own) for name, own in found.items() if own}
    common = [(name, severity) for name in levels if name in COMMON for severity in levels[name]]
    # mCE is defined for all fifteen corruptions at all five severities
    is_whole = all(levels.get(name) == SEVERITIES for name in COMMON)
    unpatched = {series.answerer: series for series in every if series.variant == UNPATCHED}
    references = {"unpatched": UNPATCHED_SOURCE} if unpatched else {}
    # AlexNet's errors are of ImageNet's labels under ImageNet-C's own parameters
    if benchmark.about.get("is_imagenet") and benchmark.about.get("parameters") == IMAGENET:
        references["alexnet"] = ALEXNET_SOURCE
    alexnet = ALEXNET_ERRORS if "alexnet" in references else {}
    # rows of each network or reader, against its own images without patches
    rows, means, cells = list[VariantMean](), list[CorruptionMean](), list[BenchmarkCell]()
    for series in every:
        before = unpatched.get(series.answerer)
        own = [_mean_corruption(series, before, name, levels[name], benchmark.classes, alexnet) for name in levels]
        rows.append(_mean_variant(series, own, common, is_whole, benchmark))
        means += own
        cells += _count_cells(series, before, tuple(levels))
    return Summary(
        about=benchmark.about, n=len(benchmark.ids), n_classes=len(np.unique(benchmark.classes)), corruptions=levels,
        mean_of=describe_mean(levels, is_whole), is_whole=is_whole, references=references, variants=tuple(rows),
        differences=tuple(_compare(every, rows, common, benchmark.classes)), means=tuple(means), cells=tuple(cells),
        failed=tuple(list_reasons(benchmark.failed)), notes=benchmark.notes,
    )  # fmt: skip


def _collect(benchmark: Benchmark) -> list[Series]:
    """Group ranks by answerer, in their order, each with `unpatched` first."""
    n = len(benchmark.ids)
    # the same network twice in a run would mix its ranks
    by_row: dict[tuple[str, str], Series] = {}
    for cell in benchmark.cells:
        who = (cell.variant, cell.recogniser)
        series = by_row.setdefault(who, Series(*who, cell.kind, {}))
        if np.shape(cell.ranks) != (n,) or n == 0:
            raise ValueError(f"ranks of {cell.variant}, {cell.corruption}: {np.shape(cell.ranks)} for {n} images")
        if (cell.corruption, cell.severity) in series.ranks:
            raise ToolkitError(
                f"two networks called '{cell.recogniser}' answered {cell.variant}: rename a network, or evaluate them "
                "in separate runs"
            )
        series.ranks[cell.corruption, cell.severity] = np.asarray(cell.ranks)
    # means over other cells would be other means
    if len({frozenset(series.ranks) for series in by_row.values()}) != 1:
        raise ValueError("every variant and answerer needs ranks under the same corruptions and severities")
    # rows follow the order of the answerers, each with its unmodified images first
    answerers = list(dict.fromkeys(answerer for _, answerer in by_row))
    return sorted(by_row.values(), key=lambda series: (answerers.index(series.answerer), series.variant != UNPATCHED))


def _mean_corruption(
    series: Series, unpatched: Series | None, name: str, severities: tuple[int, ...], classes: np.ndarray,
    alexnet: Mapping[str, float],
) -> CorruptionMean:  # fmt: skip
    """Mean over the severities of a corruption; `alexnet` has AlexNet's errors, if they apply."""
    keys, is_network = [(name, severity) for severity in severities], series.kind != READER
    ce_alexnet = ce_unpatched = None
    if is_network and name in alexnet and severities == SEVERITIES:
        # CE of Hendrycks and Dietterich (2019): the error over AlexNet's, both summed over the five severities
        ce_alexnet = series.error(keys) / alexnet[name]
    # a network without an error has nothing to divide by
    if is_network and unpatched is not None and unpatched.error(keys) > 0:
        ce_unpatched = series.error(keys) / unpatched.error(keys)
    return CorruptionMean(
        **series.who, corruption=name, family=CORRUPTIONS[name].family, **series.mean(keys, classes),
        ce_alexnet=ce_alexnet, ce_unpatched=ce_unpatched,
    )  # fmt: skip


def _mean_variant(
    series: Series, means: Sequence[CorruptionMean], common: Sequence[Condition], is_whole: bool, benchmark: Benchmark
) -> VariantMean:
    # means over the whole benchmark only, as mean corruption errors are defined for it
    clean = [NOT_CORRUPTED] if NOT_CORRUPTED in series.ranks else []
    sizes = {entry["name"]: entry.get("patch_px") for entry in benchmark.about.get("variants", [])}
    own = [mean for mean in means if is_whole and mean.corruption in COMMON]
    return VariantMean(
        **series.who, patch_px=sizes.get(series.variant),
        clean_top1=float(series.right(clean).mean()) if clean else None,
        **{f"clean_{name}": share for name, share in series.others(clean).items()},
        **series.mean(common, benchmark.classes),
        mce_alexnet=_mean_of_all([mean.ce_alexnet for mean in own]),
        mce_unpatched=_mean_of_all([mean.ce_unpatched for mean in own]),
    )  # fmt: skip


def _mean_of_all(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    # mCE is the mean over all fifteen: if a corruption is missing there is no mCE
    return sum(known) / len(known) if known and len(known) == len(values) else None


def _count_cells(series: Series, unpatched: Series | None, corruptions: Sequence[str]) -> Iterator[BenchmarkCell]:
    # clean images first, then corruptions in the benchmark's order
    order = {name: i for i, name in enumerate((CLEAN, *corruptions))}
    for key in sorted(series.ranks, key=lambda key: (order[key[0]], key[1])):
        ranks = series.ranks[key]
        is_right = ranks == RIGHT
        n, right = len(ranks), int(is_right.sum())
        is_reader = series.kind == READER
        change: dict[str, Any] = dict.fromkeys(("gained", "lost", "mcnemar_p"))
        if unpatched is not None and series.variant != UNPATCHED:
            # paired with the same images without patches
            before = unpatched.ranks[key] == RIGHT
            change = describe_change(PairedOutcomes.count(zip(before.tolist(), is_right.tolist(), strict=True)))
        yield BenchmarkCell(
            **series.who, corruption=key[0], severity=key[1], n=n, right=right, top1=right / n,
            top1_ci95=wilson_interval(right, n), top5=series.others([key])["top5"],
            wrong=int((ranks == WRONG).sum()) if is_reader else None,
            not_decoded=int((ranks == NOT_DECODED).sum()) if is_reader else None,
            **change,
        )  # fmt: skip


def _compare(
    every: Sequence[Series], rows: Sequence[VariantMean], common: Sequence[Condition], classes: np.ndarray
) -> Iterator[Difference]:
    if not common:
        return
    # scores of single images: differences are paired image by image
    scores = {(series.variant, series.answerer): series.right(common) for series in every}
    bare = {series.answerer: series for series in every if series.variant == UNPATCHED}
    for series, row in zip(every, rows, strict=True):
        others: list[tuple[Against, str, str, np.ndarray]] = []
        before = bare.get(series.answerer)
        # the same answerer without patches, and clean
        if series.variant != UNPATCHED and before is not None:
            others.append(("unpatched", UNPATCHED, series.answerer, scores[UNPATCHED, series.answerer]))
            if NOT_CORRUPTED in before.ranks:
                others.append(("clean unpatched", UNPATCHED, series.answerer, before.right([NOT_CORRUPTED])))
        # the fairest rival: the best other set whose patches have the same size
        sized = [other for other in rows if other.patch_px == row.patch_px is not None]
        equals = [other for other in sized if other.variant != row.variant]
        if equals:
            best = max(equals, key=lambda other: other.top1 or 0.0)
            others.append(("best of its size", best.variant, best.answerer, scores[best.variant, best.answerer]))
        for against, variant, answerer, other in others:
            difference, ci95 = estimate_difference(scores[series.variant, series.answerer], other, classes)
            yield Difference(series.variant, series.answerer, against, variant, answerer, difference, ci95)
