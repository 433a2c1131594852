"""`summary.json` of the corruption benchmark: results in numbers, in words, and as a table on the console."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict
from rich.table import Table

from toolkit import __version__
from toolkit.captures.capture import UNPATCHED
from toolkit.core.files import read_json
from toolkit.core.statistics import Interval
from toolkit.core.tables import build_table, format_interval, format_percent, format_points, format_points_interval
from toolkit.corruptions.catalogue import COMMON
from toolkit.evaluation.verdict import Verdict, find_tone
from toolkit.rooms.benchmarks.corruptions.recognisers import READER

Against = Literal["unpatched", "clean unpatched", "best of its size"]
FEW_NAMES = 4
INITIALS = {"gaussian": "Gaussian", "jpeg": "JPEG"}


@dataclass(frozen=True)
class BenchmarkCell:
    """Accuracy of an answerer on a variant, under a corruption and severity (`clean` and 0 without).

    Attributes:
        right: number of the `n` images with a correct top-1 answer, or the right code.
        top1_ci95: Wilson's interval, as if the images were independent draws.
        top5: None for a reader.
        wrong: number of images with another code, and `not_decoded` without a code; None for a network.
        gained: images that became correct against `unpatched` of the same answerer, and `lost` wrong; None without.
        mcnemar_p: exact, of gained against lost.
    """

    variant: str
    answerer: str
    kind: str
    corruption: str
    severity: int
    n: int
    right: int
    top1: float
    top1_ci95: Interval
    top5: float | None
    wrong: int | None
    not_decoded: int | None
    gained: int | None
    lost: int | None
    mcnemar_p: float | None


@dataclass(frozen=True)
class CorruptionMean:
    """A corruption, mean over the severities that were run.

    Attributes:
        top1_ci95: interval of top-1 over classes (`toolkit.evaluation.metrics`).
        top5: None for a reader.
        wrong: share of a reader, likewise `not_decoded`; None for a network.
        ce_alexnet: corruption error, the sum of errors over severities divided by AlexNet's.
        ce_unpatched: the same by the error without patches; None for a reader (see `Summary.references`).
    """

    variant: str
    answerer: str
    kind: str
    corruption: str
    family: str
    top1: float
    top1_ci95: Interval | None
    top5: float | None
    wrong: float | None
    not_decoded: float | None
    ce_alexnet: float | None
    ce_unpatched: float | None


@dataclass(frozen=True)
class VariantMean:
    """Accuracy of an answerer on a variant: clean, and the mean that `Summary.mean_of` names.

    Fields are as in `CorruptionMean`, and None without clean images, or without any of the fifteen corruptions.

    Attributes:
        patch_px: side of the patch, if it is known.
        mce_alexnet: mean of the corruption errors over all fifteen at all severities, likewise `mce_unpatched`.
    """

    variant: str
    answerer: str
    kind: str
    patch_px: int | None
    clean_top1: float | None
    clean_top5: float | None
    clean_wrong: float | None
    clean_not_decoded: float | None
    top1: float | None
    top1_ci95: Interval | None
    top5: float | None
    wrong: float | None
    not_decoded: float | None
    mce_alexnet: float | None
    mce_unpatched: float | None


@dataclass(frozen=True)
class Difference:
    """Mean corrupted top-1 of a variant less that of another, on the same images, with its interval over classes.

    Attributes:
        against: `unpatched` or `clean unpatched` of the same answerer, or `best of its size`, the other variant of
            the same patch size with the highest mean of any answerer.
    """

    variant: str
    answerer: str
    against: Against
    other_variant: str
    other_answerer: str
    difference: float
    ci95: Interval | None


class Summary(BaseModel):
    """Content of `summary.json`.

    Attributes:
        about: as in `Benchmark`.
        n: number of images.
        n_classes: number of classes.
        corruptions: severities of each corruption, in the order of the catalogue; all rows have the same.
        mean_of: mean of `variants`, in words.
        is_whole: whether this mean is the benchmark's: fifteen corruptions at five severities.
        references: divisors of a corruption error, in words: `unpatched`, and `alexnet` for ImageNet's labels and
            parameters.
        variants, means, cells, differences: rows by network or decoder, each beginning with `unpatched`.
        failed: path and reason of each unusable image.
        notes: as in `Benchmark`.
        inputs_sha256, cells_sha256, content_sha256: see `toolkit.evaluation.run_files`; None in older files.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_version: Literal[1] = 1
    kind: Literal["benchmark"] = "benchmark"
    about: dict[str, Any]
    n: int
    n_classes: int
    corruptions: dict[str, tuple[int, ...]]
    mean_of: str
    is_whole: bool
    references: dict[str, str]
    variants: tuple[VariantMean, ...]
    differences: tuple[Difference, ...]
    means: tuple[CorruptionMean, ...]
    cells: tuple[BenchmarkCell, ...]
    failed: tuple[dict[str, str], ...]
    notes: tuple[str, ...]
    inputs_sha256: str | None = None
    cells_sha256: str | None = None
    content_sha256: str | None = None
    toolkit_version: str = __version__

    @property
    def severities(self) -> tuple[int, ...]:
        """Severities of any corruption."""
        return tuple(sorted({severity for own in self.corruptions.values() for severity in own}))

    @property
    def has_same_severities(self) -> bool:
        """Whether all corruptions have the same severities."""
        return len(set(self.corruptions.values())) <= 1

    def means_of(self, row: VariantMean) -> dict[str, CorruptionMean]:
        """Return the means of the row's variant and answerer, by corruption."""
        return {mean.corruption: mean for mean in self.means if is_of(mean, row)}

    def cells_of(self, row: VariantMean) -> dict[tuple[str, int], BenchmarkCell]:
        """Return the cells of the row's variant and answerer, by corruption and severity."""
        return {(cell.corruption, cell.severity): cell for cell in self.cells if is_of(cell, row)}

    def differences_of(self, row: VariantMean) -> dict[str, Difference]:
        """Return the differences of the row's variant and answerer, by the variant compared against."""
        return {difference.against: difference for difference in self.differences if is_of(difference, row)}

    def unpatched_of(self, row: VariantMean) -> VariantMean | None:
        """The same answerer without patches; None for `unpatched` itself, or if that was not run."""
        same = (other for other in self.variants if other.answerer == row.answerer and other.variant == UNPATCHED)
        return None if row.variant == UNPATCHED else next(same, None)


def is_of(part: BenchmarkCell | CorruptionMean | Difference, row: VariantMean) -> bool:
    """Return whether both have the same variant and answerer."""
    return (part.variant, part.answerer) == (row.variant, row.answerer)


def read_summary(file: Path) -> Summary:
    """Read `summary.json`; a `ToolkitError` names a missing file or a wrong field."""
    return read_json(file, Summary)


def name_corruption(name: str) -> str:
    """Turn `jpeg_compression` into `JPEG compression`."""
    return " ".join(INITIALS.get(word, word) for word in name.split("_"))


def name_levels(severities: Sequence[int]) -> str:
    """Name severities, as `severity 3` or `severities 1, 2`."""
    return f"severit{'y' if len(severities) == 1 else 'ies'} {', '.join(map(str, severities))}"


def describe_mean(corruptions: Mapping[str, Sequence[int]], is_whole: bool) -> str:
    """Name the corruptions and severities of a mean."""
    common = {name: tuple(severities) for name, severities in corruptions.items() if name in COMMON}
    if is_whole:
        return "mean of the 15 common corruptions at 5 severities"
    if not common:
        return "no mean: none of the 15 common corruptions was run"
    # equal severities are named once, others with each corruption
    levels = set(common.values())
    same = f" at {name_levels(levels.pop())}" if len(levels) == 1 else ""
    own = (name_corruption(name) + ("" if same else f" at {name_levels(common[name])}") for name in common)
    names = f" ({'; '.join(own)})" if len(common) <= FEW_NAMES else ""
    which = "the 15 common corruptions" if len(common) == len(COMMON) else f"{len(common)} of the 15 corruptions"
    where = same or ("" if names else " at several severities")
    return f"mean of {which}{names}{where}: a part of the benchmark, so no mCE"


def label_row(summary: "Summary", row: "VariantMean") -> str:
    """Name the variant, and the answerer if that is not the benchmark's own network."""
    name = (summary.about.get("model") or {}).get("name")
    name = name or next((other.answerer for other in summary.variants if other.kind != READER), "")
    is_own = row.answerer == name
    return row.variant if is_own else f"{row.variant}, {row.answerer}"


def judge_benchmark(summary: "Summary") -> list[Verdict]:
    """A sentence on every variant and answerer; `unpatched` is in those of its comparisons, or alone."""
    compared = {row.answerer for row in summary.variants if summary.unpatched_of(row) is not None}
    return [
        _judge_row(summary, row) for row in summary.variants if row.variant != UNPATCHED or row.answerer not in compared
    ]


def _judge_row(summary: "Summary", row: "VariantMean") -> Verdict:
    what, share, ci95 = "corrupted", row.top1, row.top1_ci95
    wrong, not_decoded = row.wrong, row.not_decoded
    # without any of the fifteen corruptions, clean images are what there is to judge
    if share is None:
        what, share, ci95, wrong, not_decoded = "clean", row.clean_top1, None, row.clean_wrong, row.clean_not_decoded
    if share is None:
        neither = f"{row.answerer} was shown neither clean images with {row.variant} nor any of the 15 corruptions."
        return Verdict("open", neither)
    # readers have no baseline: without a patch there is no code to read
    how_many = _format_share(share, ci95)
    if row.kind == READER:
        rest = f"another on {format_percent(wrong)} %, none on {format_percent(not_decoded)} %"
        sentence = f"{row.answerer} reads the correct code on {how_many} of {what} images with {row.variant}, {rest}."
        return Verdict("open", sentence)
    if row.variant == UNPATCHED:
        return Verdict("open", f"{row.answerer} recognises {how_many} of {what} images, without patches.")
    sentence = f"{row.answerer} recognises {how_many} of {what} images with {row.variant}"
    # networks are compared with their own answers without patches
    before, difference = summary.unpatched_of(row), summary.differences_of(row).get("unpatched")
    if before is None:
        return Verdict("open", f"{sentence}.")
    if difference is None:
        return Verdict("open", f"{sentence}, {_format_share(before.clean_top1 or 0.0, None)} without.")
    sentence += f", {_format_share(before.top1 or 0.0, before.top1_ci95)} without"
    if difference.ci95 is None:
        return Verdict("open", f"{sentence}: {format_points(difference.difference)} points.")
    # an interval that includes zero shows no difference
    tone = find_tone(difference.ci95)
    points = f"{format_points(difference.difference)} points ({format_points_interval(difference.ci95)})"
    return Verdict(tone, f"{sentence}: {points}{'' if tone != 'open' else ', no difference shown'}.")


def _format_share(share: float, ci95: Interval | None) -> str:
    return f"{format_percent(share)} %" + (f" ({format_interval(ci95)})" if ci95 else "")


def build_summary_table(summary: "Summary") -> Table:
    """A line for each variant and answerer: clean, and the mean that its title names."""
    # mCE only if it was measured
    has_mce = any(row.mce_alexnet is not None for row in summary.variants)
    mce = ["mCE %"] if has_mce else []
    heads = ("clean %", "corrupted %", "95 %", "top-5 %", "not decoded %", *mce, "to unpatched", "95 %")
    cells = []
    for row in summary.variants:
        difference = summary.differences_of(row).get("unpatched")
        cells.append([
            label_row(summary, row), format_percent(row.clean_top1), format_percent(row.top1),
            format_interval(row.top1_ci95),
            *("" if share is None else format_percent(share) for share in (row.top5, row.not_decoded)),
            *("" if row.mce_alexnet is None else f"{100 * row.mce_alexnet:.1f}" for _ in mce),
            format_points(difference.difference) if difference else "",
            format_points_interval(difference.ci95) if difference else "",
        ])  # fmt: skip
    title = f"{summary.n} images of {summary.n_classes} classes; {summary.mean_of}"
    return build_table(title, ["variant"], heads, cells)
