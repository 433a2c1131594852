"""The corruption benchmark's part of docs/results.md, from the records that `make docs-benchmark` leaves."""

from pathlib import Path

from toolkit.benchmark.answers import CLEAN
from toolkit.benchmark.summary import Summary, VariantMean, read_summary
from toolkit.benchmark.text import name_row, say_corruption, say_interval, say_percent, say_points, say_points_interval
from toolkit.corruptions import COMMON

RECORDS = Path(__file__).parent / "records" / "benchmark"
"""`summary.json` of each run, by name; its overview is `figures/benchmark-NAME.png`."""
TITLES = {
    "photographs": "Photographs of 40 ImageNet classes",
    "cifar": "CIFAR-10",
}


def write_benchmark_results() -> list[str]:
    """Markdown lines; none where there is no record."""
    lines: list[str] = []
    for name, title in TITLES.items():
        if (file := RECORDS / f"{name}.json").is_file():
            lines += _write_run(name, title, read_summary(file))
    if not lines:
        return []
    return [
        "", "## Corruption benchmark", "",
        "Images without and with a patch of their class, under the fifteen corruptions of ImageNet-C at five",
        "severities ([docs/benchmark.md](benchmark.md)). *Corrupted* is the mean over the 75; intervals are over",
        "classes, as the images of a class share its patch; the change is paired by image. mCE is against AlexNet's",
        "published errors, and so not comparable with mCEs on ImageNet's 50 000 images; *relative* is against the same",
        "network's unpatched images.",
        *lines,
    ]  # fmt: skip


def _write_run(name: str, title: str, summary: Summary) -> list[str]:
    model = summary.about["model"]
    lines = [
        "", f"### {title}", "",
        f"{summary.n} images of {summary.n_classes} classes, {model['name']} ({model['weights']}, SHA-256 "
        f"{model['sha256'][:12]}), images of {summary.about['image_px']} px, corruptions' parameters "
        f"{summary.about['parameters']}, seed {summary.about['seed']}.", "",
        f"![{title}: all variants](figures/benchmark-{name}.png)", "",
        "| variant | answered by | clean top-1 | corrupted top-1 | 95 % | change to unpatched | 95 % | "
        "corrupted top-5 | mCE | relative | wrong | not decoded |", "|---" * 12 + "|",
    ]  # fmt: skip
    changes = {(one.variant, one.answerer): one for one in summary.differences if one.against == "unpatched"}
    for row in summary.variants:
        change = changes.get((row.variant, row.answerer))
        cells = [
            row.variant, row.answerer, say_percent(row.clean_top1), f"**{say_percent(row.top1)}**",
            say_interval(row.top1_ci95), say_points(change.difference) if change else "",
            say_points_interval(change.ci95) if change else "", _percent(row.top5), _percent(row.mce_alexnet),
            _percent(row.mce_unpatched), _percent(row.wrong), _percent(row.not_decoded),
        ]  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    return [*lines, "", *_write_cells(summary)]


def _percent(share: float | None) -> str:
    return "" if share is None else say_percent(share)


def _write_cells(summary: Summary) -> list[str]:
    """Top-1 of every variant in every cell, and of the clean images."""
    rows: list[VariantMean] = list(summary.variants)
    top1 = {(one.variant, one.answerer, one.corruption, one.severity): one.top1 for one in summary.cells}
    lines = [
        "<details><summary>Top-1 (%) of every corruption at every severity</summary>", "",
        f"| corruption | severity | {' | '.join(name_row(summary, row) for row in rows)} |",
        "|---" * (2 + len(rows)) + "|",
    ]  # fmt: skip
    for name, severity in [(CLEAN, 0), *((name, severity) for name in COMMON for severity in range(1, 6))]:
        cells = [say_percent(top1.get((row.variant, row.answerer, name, severity))) for row in rows]
        lines.append(f"| {say_corruption(name)} | {severity or ''} | {' | '.join(cells)} |")
    return [*lines, "", "</details>"]
