"""The figures: what they show is what the summary says, and they are pictures of the size they should be."""

import io

import numpy as np
import pytest
from made_answers import make_benchmark
from matplotlib.colors import to_rgb
from PIL import Image

from toolkit.imaging.plots import DPI
from toolkit.rooms.benchmarks.corruptions import benchmark_figures as figures
from toolkit.rooms.benchmarks.corruptions.benchmark_figures import (
    FAMILY_COLOURS,
    NOT_DECODED_COLOUR,
    RIGHT_COLOUR,
    WRONG_COLOUR,
    draw_overview,
    draw_variant,
    shade,
)
from toolkit.rooms.benchmarks.corruptions.benchmark_means import summarise


def open_png(content):
    picture = Image.open(io.BytesIO(content))
    picture.load()
    assert picture.format == "PNG"
    assert len(np.unique(np.asarray(picture.convert("L")))) > 20  # not empty
    return picture


@pytest.fixture(scope="module")
def whole():
    return summarise(make_benchmark(n=20, n_classes=5, variants=("unpatched", "patches-100", "qr-100"), fixed=False))


@pytest.mark.slow
def test_sizes_of_the_whole(whole):
    for content in (draw_overview(whole), draw_variant(whole, whole.variants[1])):
        assert open_png(content).width == 10 * DPI


@pytest.mark.parametrize("severities", [(3,), (1, 4)])
def test_smallest(severities):
    variants = {"variants": ("unpatched",), "readers": False, "fixed": False, "clean": False}
    summary = summarise(make_benchmark(n=2, n_classes=2, corruptions=("fog",), severities=severities, **variants))
    assert open_png(draw_overview(summary)).width <= 10 * DPI
    assert open_png(draw_variant(summary, summary.variants[0])).width <= 10 * DPI


def test_clean_alone_has_an_overview():
    benchmark = make_benchmark(n=6, n_classes=2, corruptions=(), variants=("unpatched", "qr-100"))
    open_png(draw_overview(summarise(benchmark)))


def heights(panel, colour):
    wanted = to_rgb(colour)
    return [bar.get_height() for bar in panel.patches if np.allclose(bar.get_facecolor()[:3], wanted, atol=1e-3)]


def levels(panel, colour="#111111"):
    return [
        segment[0][1]
        for lines in panel.collections if np.allclose(lines.get_color()[0][:3], to_rgb(colour), atol=1e-3)
        for segment in lines.get_segments()
    ]  # fmt: skip


def test_bars_are_the_numbers(monkeypatch, whole):
    monkeypatch.setattr(figures, "save_png", lambda figure: figure)
    row = whole.variants[1]
    above, below = draw_variant(whole, row).axes
    noise = [name for name, one in whole.means_of(row).items() if one.family == "noise"]
    means, before = whole.means_of(row), whole.means_of(whole.variants[0])
    assert heights(above, FAMILY_COLOURS["noise"]) == pytest.approx([100 * means[name].top1 for name in noise])
    assert levels(above)[-1] == pytest.approx(100 * whole.variants[0].top1)
    assert levels(above)[:3] == pytest.approx([100 * before[name].top1 for name in noise])
    cells = whole.cells_of(row)
    at_five = heights(below, shade(FAMILY_COLOURS["noise"], 5))
    assert at_five == pytest.approx([100 * cells[name, 5].top1 for name in noise])
    names = [tick.get_text() for tick in below.get_xticklabels()]
    assert names[0] == "Gaussian noise" and names[14] == "JPEG compression" and names[-1] == "mean" and len(names) == 20


def test_readers_bars_add_up(monkeypatch, whole):
    monkeypatch.setattr(figures, "save_png", lambda figure: figure)
    row = whole.variants[-1]
    above, below = draw_variant(whole, row).axes
    for panel, count in ((above, 20), (below, 100)):
        parts = [heights(panel, colour) for colour in (RIGHT_COLOUR, WRONG_COLOUR, NOT_DECODED_COLOUR)]
        assert [len(part) for part in parts] == [count] * 3
        assert np.sum(parts, axis=0) == pytest.approx(np.full(count, 100))
        assert parts[1][-1] > 0
    assert heights(above, WRONG_COLOUR)[-1] == pytest.approx(100 * row.wrong)


def test_every_row_has_a_panel_of_bars_with_its_own_network_unpatched_marked(monkeypatch, whole):
    monkeypatch.setattr(figures, "save_png", lambda figure: figure)
    _, small = draw_overview(whole, {"patches-100": "trained patch"}).subfigs
    shown = {panel.get_title(loc="left"): panel for panel in small.axes if panel.get_visible()}
    boosted = [row for row in whole.variants if row.variant != "unpatched"]
    assert len(shown) == len(boosted) and "trained patch" in shown
    for row, panel in zip(boosted, shown.values(), strict=True):
        assert not panel.lines, "no line through categories"
        means, before = whole.means_of(row), whole.unpatched_of(row)
        drawn = [bar.get_height() for bar in panel.patches]
        assert drawn == pytest.approx([100 * means[name].top1 for name in whole.corruptions])
        marked = [100 * whole.means_of(before)[name].top1 for name in whole.corruptions] if before else []
        assert levels(panel) == pytest.approx(marked)
