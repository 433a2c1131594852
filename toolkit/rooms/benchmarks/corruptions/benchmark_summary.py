"""`summary.json` of the corruption benchmark: what was found, in numbers, in words, and as a table on the console."""

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
    """Accuracy of an answerer on a variant, under a corruption and severity (`clean` and 0 where there is none).

    Attributes:
        n, right: images, and how many are right at the first guess (a reader's: read as the right code).
        top1, top1_ci95: share that is right, and Wilson's interval, as if the images were independent draws.
        top5: share with the truth among five guesses; None for a reader.
        wrong, not_decoded: of a reader: another code was read, none was; None for a network.
        gained, lost: images that became right, and wrong, against `unpatched` of the same answerer; None without.
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
    """One corruption, mean over the severities that were run.

    Attributes:
        top1, top1_ci95: share that is right, and its interval over classes (`toolkit.evaluation.metrics`).
        top5: None for a reader.
        wrong, not_decoded: shares, of a reader; None for a network.
        ce_alexnet, ce_unpatched: corruption error: the sum over severities of errors, divided by that of the reference;
            None for a reader and where the reference does not apply (see `Summary.references`).
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

    Attributes:
        patch_px: side of the patch; None where there is none, or unknown.
        clean_top1, clean_top5, clean_wrong, clean_not_decoded: shares on images that are not corrupted; None without.
        top1, top1_ci95, top5, wrong, not_decoded: of the mean, fields as in `CorruptionMean`; None without a corruption
            of the fifteen.
        mce_alexnet, mce_unpatched: mean of the corruption errors over the fifteen; None unless all fifteen were run at
            all five severities.
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
    """Mean corrupted top-1 of a variant less that of another, on the same images.

    Attributes:
        against: `unpatched`: of the same answerer, under the same corruptions; `clean unpatched`: of the same
            answerer, not corrupted; `best of its size`: whoever answers, the other variant of the same patch size
            with the highest mean (the first of equals).
        other_variant, other_answerer: which that is.
        difference, ci95: share, and its interval over classes.
    """

    variant: str
    answerer: str
    against: Against
    other_variant: str
    other_answerer: str
    difference: float
    ci95: Interval | None


class Summary(BaseModel):
    """What `summary.json` holds.

    Attributes:
        about: as in `Benchmark`.
        n: number of images.
        n_classes: number of classes.
        corruptions: severities of each corruption, in the order of the catalogue; all rows have the same.
        mean_of: mean that `variants` have, in words.
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

    def as_json(self) -> dict[str, Any]:
        """The content of the file."""
        return self.model_dump(mode="json")

    @property
    def severities(self) -> tuple[int, ...]:
        """Those run of any corruption."""
        return tuple(sorted({severity for own in self.corruptions.values() for severity in own}))

    @property
    def has_same_severities(self) -> bool:
        """Whether every corruption was run at the same."""
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
        """The same answerer without patches; None for `unpatched` itself and where that was not run."""
        if row.variant == UNPATCHED:
            return None
        return next(
            (bare for bare in self.variants if (bare.variant, bare.answerer) == (UNPATCHED, row.answerer)), None
        )


def is_of(part: BenchmarkCell | CorruptionMean | Difference, row: VariantMean) -> bool:
    """Return whether both have the same variant and answerer."""
    return (part.variant, part.answerer) == (row.variant, row.answerer)


def read_summary(file: Path) -> Summary:
    """Read `summary.json`.

    Raises:
        ToolkitError: the file is missing or damaged, or a field is wrong; the message names file and field.
    """
    return read_json(file, Summary)


def name_corruption(name: str) -> str:
    """`JPEG compression` of `jpeg_compression`."""
    return " ".join(INITIALS.get(word, word) for word in name.split("_"))


def name_levels(severities: Sequence[int]) -> str:
    """`severity 3`, `severities 1, 2, 5`."""
    return f"severit{'y' if len(severities) == 1 else 'ies'} {', '.join(map(str, severities))}"


def describe_mean(corruptions: Mapping[str, Sequence[int]], is_whole: bool) -> str:
    """Which corruptions and severities a mean is taken over, from the severities of each."""
    common = {name: tuple(severities) for name, severities in corruptions.items() if name in COMMON}
    if is_whole:
        return "mean of the 15 common corruptions at 5 severities"
    if not common:
        return "no mean: none of the 15 common corruptions was run"
    levels = set(common.values())
    same = f" at {name_levels(levels.pop())}" if len(levels) == 1 else ""
    if len(common) <= FEW_NAMES:
        own = (name_corruption(name) + ("" if same else f" at {name_levels(common[name])}") for name in common)
        names = f" ({'; '.join(own)})"
    else:
        names = ""
    which = "the 15 common corruptions" if len(common) == len(COMMON) else f"{len(common)} of the 15 corruptions"
    where = same or ("" if names else " at several severities")
    return f"mean of {which}{names}{where}: a part of the benchmark, so no mCE"


def label_row(summary: "Summary", row: "VariantMean") -> str:
    """The variant, and who recognises where that is not the benchmark's own network."""
    is_own = row.answerer == _own_network(summary)
    return row.variant if is_own else f"{row.variant}, {row.answerer}"


def judge_benchmark(summary: "Summary") -> list[Verdict]:
    """A sentence on every variant and answerer: `good`, `bad`, or `open` where nothing is shown.

    `unpatched` is in those that it is compared to, or alone.
    """
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
        return Verdict(
            "open", f"{row.answerer} saw neither clean images with {row.variant} nor any of the 15 corruptions."
        )
    # readers have no baseline: without a patch there is no code to read
    how_many = _format_share(share, ci95)
    if row.kind == READER:
        rest = f"another on {format_percent(wrong)} %, none on {format_percent(not_decoded)} %"
        sentence = f"{row.answerer} reads the right code on {how_many} of {what} images with {row.variant}, {rest}."
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


def _own_network(summary: "Summary") -> str:
    name = (summary.about.get("model") or {}).get("name")
    return name or next((row.answerer for row in summary.variants if row.kind != READER), "")


def build_summary_table(summary: "Summary") -> Table:
    """A line for each variant and answerer: clean, and the mean that its title names."""
    has_mce = any(row.mce_alexnet is not None for row in summary.variants)
    mce = ["mCE %"] if has_mce else []
    heads = ("clean %", "corrupted %", "95 %", "top-5 %", "not decoded %", *mce, "to unpatched", "95 %")
    cells = []
    for row in summary.variants:
        difference = summary.differences_of(row).get("unpatched")
        cells.append(
            [
                label_row(summary, row),
                format_percent(row.clean_top1),
                format_percent(row.top1),
                format_interval(row.top1_ci95),
                "" if row.top5 is None else format_percent(row.top5),
                "" if row.not_decoded is None else format_percent(row.not_decoded),
                *("" if row.mce_alexnet is None else f"{100 * row.mce_alexnet:.1f}" for _ in mce),
                format_points(difference.difference) if difference else "",
                format_points_interval(difference.ci95) if difference else "",
            ]
        )
    title = f"{summary.n} images of {summary.n_classes} classes; {summary.mean_of}"
    return build_table(title, ["variant"], heads, cells)
