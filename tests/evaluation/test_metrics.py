"""Intervals and tests against a second implementation, closed forms and published numbers."""

import sys
from dataclasses import replace
from itertools import product
from math import comb, cos, radians, sin
from pathlib import Path
from types import ModuleType

import pytest
from scipy.stats import binomtest

from toolkit.captures.capture import Capture
from toolkit.core.child import run_python
from toolkit.core.errors import ToolkitError
from toolkit.core.statistics import mcnemar_p, wilson_interval
from toolkit.core.tables import format_count, format_interval, format_p, format_test
from toolkit.evaluation.metrics import (
    compare_unpatched,
    count_no_pairs,
    explain_unpaired,
    group_predictions,
    index_poses,
    pair_variants,
    pair_with_unpatched,
)
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.tables import list_unpaired
from toolkit.evaluation.verdict import ONE_WAY_FLIPS, write_headlines


@pytest.mark.parametrize(("k", "n"), [(0, 18), (1, 18), (9, 18), (17, 18), (18, 18), (61, 72), (1, 1), (499, 1000)])
def test_wilson_against_scipy(k, n):
    expected = binomtest(k, n).proportion_ci(0.95, method="wilson")
    assert wilson_interval(k, n) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_wilson_against_published_numbers():
    # Newcombe, Statistics in Medicine 17 (1998), table I, method 3
    for (k, n), published in {(81, 263): (0.2553, 0.3662), (15, 148): (0.0624, 0.1605), (0, 20): (0, 0.1611)}.items():
        assert wilson_interval(k, n) == pytest.approx(published, abs=5e-5)


def test_wilson_of_nothing_says_nothing():
    assert wilson_interval(0, 0) == (0.0, 1.0)
    for k, n in ((5, 3), (-1, 3), (0, -1)):
        with pytest.raises(ToolkitError, match=f"{k} successes of {n} trials: expected 0 to {n}"):
            wilson_interval(k, n)


@pytest.mark.parametrize(
    ("gained", "lost"), [(0, 0), (1, 0), (5, 0), (6, 0), (18, 0), (0, 18), (12, 3), (3, 12), (7, 7)]
)
def test_mcnemar_against_the_closed_form(gained, lost):
    n = gained + lost
    tail = sum(comb(n, i) for i in range(min(gained, lost) + 1)) / 2**n
    assert mcnemar_p(gained, lost) == pytest.approx(min(1.0, 2 * tail))


@pytest.mark.parametrize("has_parts", [True, False])
def test_mcnemar_is_scipys_test_to_the_bit(monkeypatch, has_parts):
    if not has_parts:  # an earlier SciPy has them elsewhere
        monkeypatch.setitem(sys.modules, "scipy.special._ufuncs", ModuleType("_ufuncs"))
    mcnemar_p.cache_clear()
    for gained, lost in [*product(range(1, 9), range(9)), (40, 77), (500, 300)]:
        assert mcnemar_p(gained, lost) == float(binomtest(gained, gained + lost, 0.5).pvalue)


def test_mcnemar_does_not_load_scipys_statistics():
    code = "import sys; from toolkit.core.statistics import mcnemar_p; mcnemar_p(3, 1)"
    assert run_python(f"{code}; print('scipy.stats' in sys.modules)").stdout.split() == [b"False"]


def test_six_one_way_flips_are_the_fewest():
    assert mcnemar_p(ONE_WAY_FLIPS, 0) < 0.05 < mcnemar_p(ONE_WAY_FLIPS - 1, 0)


def one(pose_id, variant, rank, name="racer", source="sim", status="ok", tag=""):
    path = f"{source}/{name}/{variant}/{pose_id}{tag}.png"
    capture = Capture(source, name, variant, pose_id, Path(path), path)
    if status != "ok":
        return Prediction(capture, 0, name, status=status)
    return Prediction(capture, 0, name, 0 if rank == 1 else 7, "guess", 0.6, 0.5 / rank, rank)


def test_eighteen_one_way_flips():
    predictions = [one(pose, "unpatched", 7) for pose in range(1, 19)]
    predictions += [one(pose, "patched", 1) for pose in range(1, 19)]
    racer, pooled = compare_unpatched(pair_with_unpatched(index_poses(predictions)))
    assert (racer.object, pooled.object) == ("racer", "all")
    assert (racer.outcomes.n, racer.outcomes.only_second, racer.outcomes.only_first) == (18, 18, 0)
    assert racer.outcomes.mcnemar_p == pytest.approx(2 * 0.5**18)
    assert explain_unpaired(predictions, index_poses(predictions), pair_with_unpatched(index_poses(predictions))) == []
    groups = {(group.object, group.variant): group for group in group_predictions(predictions)}
    assert groups["racer", "unpatched"].top1 == 0
    assert groups["racer", "patched"].as_json() == {
        "source": "sim",
        "object": "racer",
        "variant": "patched",
        "n": 18,
        "failed": 0,
        "top1": 1.0,
        "top5": 1.0,
        "top1_ci95": [pytest.approx(0.8241, abs=1e-4), 1.0],
        "mean_true_prob": pytest.approx(0.5),
    }
    (headline,) = write_headlines("net", group_predictions(predictions), [racer, pooled])
    assert headline.tone == "good" and headline.verdict == "The patch helps"
    assert "18 of 18" in headline.sentence and "p < 0.0001" in headline.sentence


def test_rows_are_counted_and_ordered():
    predictions = [
        one(1, "patched", 1, "zebra"),
        one(1, "unpatched", 3, "zebra"),
        one(1, "unpatched", 6, "ant"),
        one(2, "unpatched", 0, "ant", status="empty"),
        one(1, "patched", 1, "ant", source="real"),
    ]
    rows = [(g.source, g.object, g.variant, g.n, g.failed, g.n_top1, g.n_top5) for g in group_predictions(predictions)]
    assert rows == [
        ("real", "ant", "patched", 1, 0, 1, 1),
        ("real", "all", "patched", 1, 0, 1, 1),
        ("sim", "ant", "unpatched", 1, 1, 0, 0),
        ("sim", "zebra", "unpatched", 1, 0, 0, 1),
        ("sim", "zebra", "patched", 1, 0, 1, 1),
        ("sim", "all", "unpatched", 2, 1, 0, 1),
        ("sim", "all", "patched", 1, 0, 1, 1),
    ]


def test_what_has_no_partner_is_listed():
    predictions = [
        one(1, "unpatched", 1),
        one(1, "patched", 4),
        one(2, "patched", 1),
        one(3, "unpatched", 1, status="truncated"),
        one(3, "patched", 1),
        one(4, "unpatched", 1),
        one(None, "patched", 1),
        one(1, "unpatched", 1, name="alone"),
    ]
    poses = index_poses(predictions)
    (row, _) = compare_unpatched(pair_with_unpatched(poses))
    assert row.as_pair() == {
        "source": "sim", "object": "racer", "variant": "patched", "n_pairs": 1, "n_first": 1, "n_second": 0,
        "gained": 0, "lost": 1, "mcnemar_p": 1.0,
    }  # fmt: skip
    reasons = dict(explain_unpaired(predictions, poses, pair_with_unpatched(poses)))
    assert set(reasons) == {f"sim/racer/{p}.png" for p in ("patched/2", "patched/3", "unpatched/4", "patched/None")}
    assert "no unpatched image of pose 2" in reasons["sim/racer/patched/2.png"]
    assert "could not be read" in reasons["sim/racer/patched/3.png"]
    assert "no patched image of pose 4" in reasons["sim/racer/unpatched/4.png"]
    assert "number" in reasons["sim/racer/patched/None.png"]


def test_of_two_images_of_a_pose_the_first_that_was_read_is_paired():
    predictions = [
        one(1, "unpatched", 1, status="truncated", tag="a"),
        one(1, "unpatched", 5, tag="b"),
        one(1, "unpatched", 1, tag="c"),
        one(1, "patched", 1),
    ]
    poses = index_poses(predictions)
    pairs = pair_variants(poses, "unpatched", "patched")
    assert [(pair.first.capture.path, pair.is_gained) for pair in pairs] == [("sim/racer/unpatched/1b.png", True)]
    assert explain_unpaired(predictions, poses, pair_with_unpatched(poses)) == []


def test_several_variants_each_against_unpatched():
    predictions = [one(pose, "unpatched", 2) for pose in range(8)]
    predictions += [one(pose, "patched", 1) for pose in range(8)]
    predictions += [one(pose, "qr-code", 3) for pose in range(8)]
    pairs = compare_unpatched(pair_with_unpatched(index_poses(predictions)))
    assert [(p.object, p.second, p.outcomes.only_second) for p in pairs] == [
        ("racer", "patched", 8),
        ("racer", "qr-code", 0),
        ("all", "patched", 8),
        ("all", "qr-code", 0),
    ]
    headlines = write_headlines("net", group_predictions(predictions), pairs)
    assert [(h.variant, h.tone) for h in headlines] == [("patched", "good"), ("qr-code", "open")]
    assert "at least 6 pairs" in headlines[1].sentence


def test_an_object_that_was_shot_bare_alone_is_not_counted_against_the_patch():
    predictions = [one(pose, "unpatched", 2) for pose in range(8)]
    predictions += [one(pose, "patched", 1 + pose % 2) for pose in range(8)]
    predictions += [one(pose, "unpatched", 1, name="known") for pose in range(8)]
    (headline,) = write_headlines(
        "net", group_predictions(predictions), compare_unpatched(pair_with_unpatched(index_poses(predictions)))
    )
    assert headline.sentence.startswith("net is correct on 4 of 8 (50 %")
    assert "with the patch and on 0 of 8 (0 %" in headline.sentence
    assert "without, at the 8 poses shot both ways. Of 8 pairs, 4 became correct" in headline.sentence


def test_p_in_words():
    assert [format_p(p) for p in (1.0, 0.03125, 2e-6, None)] == ["1", "0.031", "< 0.0001", ""]
    assert [format_interval(one) for one in ((0.55, 0.67), (0.0, 1.0), None)] == ["55–67", "0–100", ""]
    assert format_count(13, 18) == "13 of 18 (72 %, 95 % interval 49–88 %)" and format_count(0, 0) == "0 of 0"
    assert [format_test(p) for p in (1.0, 2e-6)] == ["exact McNemar p = 1", "exact McNemar p < 0.0001"]


def seen_from(found, elevation_deg, distance_mm=500.0, *, by_plan=True, focal_length=1.1):
    """The prediction of an image whose camera is known."""
    up, out = sin(radians(elevation_deg)) * distance_mm, cos(radians(elevation_deg)) * distance_mm
    rows = ((1.0, 0.0, 0.0, out), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, up), (0.0, 0.0, 0.0, 1.0))
    capture = replace(found.capture, T_world_camera=rows, is_by_plan=by_plan, focal_length=focal_length)
    return replace(found, capture=capture)


def test_a_variant_that_was_shot_by_another_plan_is_set_aside():
    """The bare object at 35°, textured at 44° from a plan before: one pose number, two places."""
    bare, same, stale = one(1, "unpatched", 9), one(1, "textured", 1), one(2, "textured", 1)
    seen = [seen_from(bare, 35), seen_from(one(2, "unpatched", 9), 35), seen_from(same, 35.5), seen_from(stale, 44)]
    poses = index_poses(seen)
    assert [pair.second.capture.pose_id for pair in pair_variants(poses, "unpatched", "textured")] == [1]
    reasons = dict(explain_unpaired(seen, poses, pair_with_unpatched(poses)))
    assert sorted(reasons) == ["sim/racer/textured/2.png", "sim/racer/unpatched/2.png"]
    assert reasons["sim/racer/textured/2.png"] == "no pair: other cameras (9° apart) than sim/racer/unpatched/2.png"
    no_pairs = count_no_pairs(poses)
    (line,) = list_unpaired(list(reasons.items()), no_pairs)
    assert line == "1 pair not formed, sim/textured: other cameras than the unpatched: shoot both again"
    missing = ("sim/racer/textured/7.png", "no unpatched image of pose 7")
    assert len(list_unpaired([*reasons.items(), missing], no_pairs)) == 3


@pytest.mark.parametrize(
    ("other", "apart"),
    [
        ({"elevation_deg": 35, "distance_mm": 600}, "500 and 600 mm away"),
        ({"elevation_deg": 35, "focal_length": 1.5}, "with another lens"),
        ({"elevation_deg": 35, "distance_mm": 600, "focal_length": 1.5, "by_plan": False}, None),
        ({"elevation_deg": 44, "by_plan": False}, None),
        ({"elevation_deg": 52, "by_plan": False}, "17° apart"),
        (None, None),
    ],
)
def test_cameras_are_one_within_the_stated_tolerances(other, apart):
    """Renders by a plan closely, what is held by hand loosely, and an unknown camera by its number alone."""
    bare, second = seen_from(one(1, "unpatched", 9), 35), one(1, "patched", 1)
    second = seen_from(second, **other) if other else second
    assert bare.capture.compare_cameras(second.capture) == apart
