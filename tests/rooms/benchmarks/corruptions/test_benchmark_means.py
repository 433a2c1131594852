"""The benchmark's numbers against sums by hand, plain loops and SciPy."""

import json
from dataclasses import replace

import numpy as np
import pytest
from made_answers import make_benchmark
from scipy.stats import binomtest

from toolkit.core.errors import ToolkitError
from toolkit.core.files import write_json
from toolkit.core.tables import format_percent
from toolkit.corruptions.catalogue import COMMON, CORRUPTIONS
from toolkit.rooms.benchmarks.corruptions import CLEAN
from toolkit.rooms.benchmarks.corruptions.benchmark_means import ALEXNET_ERRORS, summarise
from toolkit.rooms.benchmarks.corruptions.benchmark_summary import judge_benchmark, read_summary
from toolkit.rooms.benchmarks.corruptions.grid import Benchmark, CellRanks
from toolkit.rooms.benchmarks.corruptions.recognisers import NETWORK, READER

# AlexNet's errors by severity on ImageNet-C, as others list them: the published ones are their means
ALEXNET_BY_SEVERITY = {
    "gaussian_noise": (0.69528, 0.82542, 0.93554, 0.98138, 0.99452),
    "shot_noise": (0.71224, 0.85108, 0.93574, 0.98182, 0.99146),
    "impulse_noise": (0.78374, 0.89808, 0.9487, 0.9872, 0.99548),
    "defocus_blur": (0.65624, 0.73202, 0.85036, 0.91364, 0.94714),
    "glass_blur": (0.64308, 0.75054, 0.88806, 0.91622, 0.93344),
    "motion_blur": (0.5843, 0.70048, 0.82108, 0.8975, 0.92638),
    "zoom_blur": (0.70008, 0.76992, 0.80784, 0.84198, 0.87198),
    "snow": (0.71726, 0.88392, 0.86468, 0.9187, 0.94952),
    "frost": (0.6139, 0.79734, 0.8879, 0.89942, 0.9343),
    "fog": (0.67474, 0.7605, 0.84378, 0.8726, 0.945),
    "brightness": (0.4514, 0.48502, 0.54048, 0.62166, 0.7244),
    "contrast": (0.64548, 0.7615, 0.88874, 0.9776, 0.9927),
    "elastic_transform": (0.52596, 0.70116, 0.55686, 0.64076, 0.80554),
    "pixelate": (0.52218, 0.5462, 0.73728, 0.87092, 0.91262),
    "jpeg_compression": (0.51002, 0.54718, 0.57294, 0.65458, 0.74778),
}


def by_hand(variants, **about):
    """Four images of two classes; variants: (variant, answerer, kind) -> {(corruption, severity): ranks}."""
    answers = tuple(
        CellRanks(*row, *key, np.array(ranks, np.int32))
        for row, cells in variants.items()
        for key, ranks in cells.items()
    )
    sizes = [{"name": name, "patch_px": 100 if name != "unpatched" else None} for name, _, _ in variants]
    about = {"name": "hand", "model": {"name": "net"}, "is_imagenet": True, "parameters": "imagenet"} | about
    return Benchmark(about | {"variants": sizes}, tuple("abcd"), np.array([7, 7, 9, 9]), {7: "x", 9: "y"}, answers)


HAND = {
    ("unpatched", "net", NETWORK): {
        (CLEAN, 0): [1, 1, 1, 4], ("fog", 1): [1, 2, 6, 9], ("fog", 2): [3, 3, 6, 9], ("spatter", 1): [1, 1, 1, 1],
    },
    ("codes", "net", NETWORK): {
        (CLEAN, 0): [1, 1, 1, 1], ("fog", 1): [1, 1, 1, 7], ("fog", 2): [1, 5, 6, 1], ("spatter", 1): [9, 9, 9, 9],
    },
    ("codes", "zbar", READER): {
        (CLEAN, 0): [1, 1, 1, 2], ("fog", 1): [1, 0, 2, 0], ("fog", 2): [0, 0, 0, 0], ("spatter", 1): [1, 1, 1, 1],
    },
}  # fmt: skip


def test_cells_and_means_by_hand():
    summary = summarise(by_hand(HAND))
    assert [(row.variant, row.answerer) for row in summary.variants] == [key[:2] for key in HAND]
    plain, boosted, reader = summary.variants
    cell = summary.cells_of(boosted)["fog", 1]
    assert (cell.n, cell.right, cell.top1, cell.top5, cell.gained, cell.lost) == (4, 3, 0.75, 0.75, 2, 0)
    assert cell.mcnemar_p == pytest.approx(2 * 0.5**2)
    assert summary.cells_of(boosted)["spatter", 1].mcnemar_p == pytest.approx(2 * 0.5**4)
    ci = binomtest(3, 4).proportion_ci(method="wilson")
    assert cell.top1_ci95 == pytest.approx((ci.low, ci.high))
    cell = summary.cells_of(reader)["fog", 1]
    assert (cell.right, cell.wrong, cell.not_decoded, cell.top5, cell.gained) == (1, 1, 2, None, None)
    # fog alone is in the mean: (1 + 0) of 8, (3 + 2) of 8
    assert (plain.clean_top1, plain.clean_top5, plain.top1, plain.top5) == (0.75, 1.0, 0.125, 0.5)
    assert (boosted.top1, boosted.top5) == (0.625, 0.75)
    assert (reader.top1, reader.wrong, reader.not_decoded, reader.top5) == (0.125, 0.125, 0.75, None)
    assert reader.clean_wrong == 0.25 and reader.clean_not_decoded == 0
    fog = summary.means_of(boosted)["fog"]
    assert fog.ce_unpatched == pytest.approx(3 / 7) and fog.ce_alexnet is None  # two severities of five
    assert summary.means_of(boosted)["spatter"].ce_unpatched is None  # nothing to divide by
    assert summary.means_of(reader)["fog"].ce_unpatched is None
    assert boosted.mce_unpatched is None and not summary.is_whole
    assert (
        summary.mean_of
        == "mean of 1 of the 15 corruptions (fog) at severities 1, 2: a part of the benchmark, so no mCE"
    )


def test_differences_by_hand():
    summary = summarise(by_hand(HAND))
    boosted, reader = summary.variants[1:]
    found = summary.differences_of(boosted)
    # fog, share of two severities by image: with 1 .5 .5 .5, without .5 0 0 0, clean without 1 1 1 0
    assert found["unpatched"].difference == pytest.approx(0.5) and found["unpatched"].ci95 is None  # no spread
    assert found["clean unpatched"].difference == pytest.approx(0.625 - 0.75)
    assert "best of its size" not in found  # codes alone have that size
    assert summary.differences_of(reader) == {}
    others = HAND | {("image", "net", NETWORK): HAND["unpatched", "net", NETWORK]}
    summary = summarise(by_hand(others))
    image = next(row for row in summary.variants if row.variant == "image")
    best = summary.differences_of(image)["best of its size"]
    assert (best.other_variant, best.other_answerer, best.difference) == ("codes", "net", pytest.approx(-0.5))
    assert summary.differences_of(reader)["best of its size"].other_variant == "image"


def test_means_over_severities_first():
    cells = [("fog", 1), ("fog", 2), ("fog", 3), ("snow", 5)]
    benchmark = make_benchmark(n=11, n_classes=3, cells=cells, variants=("unpatched",), fixed=False, readers=False)
    shares = {(a.corruption, a.severity): float(np.mean(a.ranks == 1)) for a in benchmark.cells}
    fog = (shares["fog", 1] + shares["fog", 2] + shares["fog", 3]) / 3
    summary = summarise(benchmark)
    assert summary.variants[0].top1 == pytest.approx((fog + shares["snow", 5]) / 2)
    assert "snow at severity 5; fog at severities 1, 2, 3" in summary.mean_of


@pytest.fixture(scope="module")
def whole():
    variants = ("unpatched", "patches-100", "best-image-100")
    return make_benchmark(n=40, n_classes=8, variants=variants, fixed=True, readers=True)


def test_whole_benchmark_against_loops(whole):
    summary = summarise(whole)
    assert summary.is_whole and set(summary.references) == {"alexnet", "unpatched"}
    unpatched = {(a.recogniser, a.corruption, a.severity): a.ranks for a in whole.cells if a.variant == "unpatched"}
    for row in summary.variants:
        ranks = {
            (a.corruption, a.severity): a.ranks
            for a in whole.cells if (a.variant, a.recogniser) == (row.variant, row.answerer)
        }  # fmt: skip
        hits = errors = 0
        ces, relative = [], []
        for name in COMMON:
            of_reference = 0
            own = 0
            for level in range(1, 6):
                for i, rank in enumerate(ranks[name, level]):
                    hits, errors, own = hits + (rank == 1), errors + (rank != 1), own + (rank != 1)
                    if row.kind == NETWORK:
                        before = unpatched[row.answerer, name, level]
                        of_reference += before[i] != 1
            ces.append(own / 200 / (sum(ALEXNET_BY_SEVERITY[name]) / 5))
            relative.append(own / of_reference if of_reference else None)
        assert row.top1 == pytest.approx(hits / (hits + errors))
        if row.kind == NETWORK:
            assert row.mce_alexnet == pytest.approx(np.mean(ces), rel=1e-5)
            assert row.mce_unpatched == pytest.approx(np.mean(relative))
        else:
            assert row.mce_alexnet is None and row.mce_unpatched is None
    assert summary.variants[0].mce_unpatched == 1


def test_extra_corruptions_are_in_no_mean(whole):
    worse = tuple(
        replace(one, ranks=np.full_like(one.ranks, 2)) if one.corruption not in (CLEAN, *COMMON) else one
        for one in whole.cells
    )
    before, after = summarise(whole), summarise(replace(whole, cells=worse))
    assert before.variants == after.variants and before.differences == after.differences
    assert before.means != after.means
    assert {one.corruption for one in after.means} == set(CORRUPTIONS)


@pytest.mark.parametrize("change", [{"parameters": "cifar"}, {"is_imagenet": False}])
def test_alexnet_is_no_reference_elsewhere(whole, change):
    summary = summarise(replace(whole, about=whole.about | change))
    assert set(summary.references) == {"unpatched"}
    assert all(row.mce_alexnet is None for row in summary.variants)
    assert summary.variants[0].mce_unpatched is not None


def test_alexnet_errors_are_the_published_ones():
    assert tuple(ALEXNET_ERRORS) == COMMON
    for name, errors in ALEXNET_BY_SEVERITY.items():
        assert ALEXNET_ERRORS[name] == pytest.approx(np.mean(errors), abs=2e-6), name
    # table 1 of the paper, in per cent
    table = (88.6, 89.4, 92.3, 82.0, 82.6, 78.6, 79.8, 86.7, 82.7, 81.9, 56.5, 85.3, 64.6, 71.8, 60.7)
    assert [100 * one for one in ALEXNET_ERRORS.values()] == pytest.approx(table, abs=0.051)


def test_refuses_what_cannot_be_compared():
    fewer = HAND | {("codes", "zbar", READER): {(CLEAN, 0): [1, 1, 1, 2]}}
    with pytest.raises(ValueError, match="same corruptions"):
        summarise(by_hand(fewer))
    with pytest.raises(ValueError, match="for 4 images"):
        summarise(by_hand({("unpatched", "net", NETWORK): {(CLEAN, 0): [1, 1]}}))
    twice = by_hand(HAND)
    with pytest.raises(ToolkitError, match="two networks called 'net'"):
        summarise(replace(twice, cells=twice.cells + twice.cells[:1]))


def test_summary_reads_back(tmp_path, whole):
    summary = summarise(replace(whole, failed=(("a.png", "no image"),), notes=("a note",)))
    file = write_json(tmp_path / "summary.json", summary.model_dump(mode="json"))
    assert read_summary(file) == summary
    content = json.loads(file.read_text())
    content["cells"][3]["top1"] = "many"
    write_json(file, content)
    with pytest.raises(ToolkitError, match=r"cells\.3\.top1"):
        read_summary(file)


@pytest.mark.parametrize(
    ("share", "said"),
    [
        (None, "–"),
        (0, "0"),
        (0.0004, "0.1"),
        (0.004, "0.4"),
        (0.614, "61"),
        (0.9999, "99.9"),
        (1 - 1e-16, "100"),
        (1, "100"),
    ],
)
def test_percent_hides_no_exception(share, said):
    assert format_percent(share) == said


def test_sentences():
    lines = [one.sentence for one in judge_benchmark(summarise(by_hand(HAND)))]
    assert len(lines) == 2  # unpatched is said with what it is compared to
    assert lines[0].startswith("net recognises 62 % (") and "of corrupted images with codes, 12 % (" in lines[0]
    assert lines[0].endswith("without: +50 points.")
    assert lines[1].startswith("zbar reads the correct code on 12 % (")
    assert lines[1].endswith("with codes, another on 12 %, none on 75 %.")
    alone = [one.sentence for one in judge_benchmark(summarise(by_hand({key: HAND[key] for key in list(HAND)[:1]})))]
    assert len(alone) == 1 and alone[0].endswith("of corrupted images, without patches.")
