"""The rig against photographs: statistics against published numbers, counts by hand, and what is shown of them."""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from scipy.stats import binomtest, spearmanr

from toolkit.captures.capture import Capture
from toolkit.core.statistics import cohen_kappa, paired_difference_interval, rank_correlation
from toolkit.evaluation.evaluate import MAX_CARDS, SIDE, evaluate_captures, place_prob, view_sim_real
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.results import compare_predictions
from toolkit.evaluation.sim_real import compare_sim_real, place_of
from toolkit.evaluation.tables import print_sim_real


@pytest.mark.parametrize(
    ("counts", "published"),
    [
        ((36, 12, 2, 0), (0.0569, 0.3404)),
        ((18, 12, 2, 18), (0.0562, 0.3290)),
        ((53, 0, 0, 1), (-0.0729, 0.0729)),
        ((0, 30, 0, 0), (0.8395, 1.0)),
    ],
)
def test_the_interval_of_a_paired_difference_is_newcombes(counts, published):
    """Method 10 in the examples of Newcombe, Statistics in Medicine 17 (1998), 2635-2650."""
    assert paired_difference_interval(*counts) == pytest.approx(published, abs=6e-5)
    both, first, second, neither = counts
    low, high = paired_difference_interval(both, second, first, neither)
    assert (-high, -low) == pytest.approx(published, abs=6e-5)
    assert paired_difference_interval(0, 0, 0, 0) == (-1, 1)


@pytest.mark.parametrize(
    ("counts", "published"), [((20, 5, 10, 15), 0.4), ((45, 15, 25, 15), 0.1304), ((25, 35, 5, 35), 0.2593)]
)
def test_kappa_is_cohens(counts, published):
    """The textbook tables of 50 and 100 cases."""
    assert cohen_kappa(*counts) == pytest.approx(published, abs=5e-5)


def test_kappa_is_undefined_where_nothing_differs():
    assert cohen_kappa(0, 0, 0, 0) is cohen_kappa(9, 0, 0, 0) is cohen_kappa(0, 0, 0, 7) is None
    assert cohen_kappa(0, 0, 3, 5) == 0  # one judge says no to everything: no better than chance
    assert cohen_kappa(4, 0, 0, 4) == 1 and cohen_kappa(0, 4, 4, 0) == -1


def test_rank_correlation_is_scipys_and_its_interval_bonett_and_wrights():
    draw = np.random.default_rng(4)
    x = draw.normal(size=18)
    y = np.round(x + draw.normal(size=18), 1)
    found = rank_correlation(list(x), list(y))
    assert found.rho == pytest.approx(spearmanr(x, y).statistic) and found.n == 18
    z = np.arctanh(found.rho) + np.array([-1, 1]) * 1.959964 * np.sqrt((1 + found.rho**2 / 2) / 15)
    assert found.ci95 == pytest.approx(np.tanh(z), abs=1e-6)
    few = [rank_correlation(range(n), [1, 0, *range(2, n)]) for n in (2, 3, 4, 5)]
    assert [(one.rho is None, one.ci95 is None) for one in few] == [
        (True, True),
        (False, True),
        (False, True),
        (False, False),
    ]


@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_the_interval_of_a_rank_correlation_covers(rho):
    """Normal pairs of correlation rho have Spearman's 6/π·asin(rho/2): it is in 95 % of the intervals."""
    draw, true = np.random.default_rng(0), 6 / np.pi * np.arcsin(rho / 2)
    inside = 0
    for _ in range(200):
        x, y = draw.multivariate_normal([0, 0], [[1, rho], [rho, 1]], 24).T
        low, high = rank_correlation(list(x), list(y)).ci95
        inside += low <= true <= high
    assert 0.91 < inside / 200 < 0.99


def test_rank_correlation_says_why_there_is_none():
    assert rank_correlation([0.1] * 6, [1, 2, 3, 4, 5, 6]).why == "all equal"
    assert rank_correlation([1, 2, 3, 4, 5, 6], [0.1] * 6).rho is None
    assert rank_correlation([1, 2], [1, 2]).why == "too few"
    assert (rank_correlation([1, 2, 3, 4], [1, 3, 2, 4]).rho, rank_correlation([1, 2, 3, 4], [1, 3, 2, 4]).ci95) == (
        pytest.approx(0.8), None,
    )  # fmt: skip
    perfect = rank_correlation([1, 2, 3, 4, 5, 6], [2, 4, 5, 6, 7, 9])
    assert (perfect.rho, perfect.ci95) == (pytest.approx(1), None)


def one(source, pose_id, right, variant="patched", name="racer", prob=None, file=None, **more):
    path = f"{source}/{name}/{variant}/{file or f'pose_{pose_id:02d}.jpg'}"
    capture = Capture(source, name, variant, pose_id, Path(path), path, **more)
    prob = (0.6 if right else 0.1) if prob is None else prob
    return Prediction(capture, 0, name, 0 if right else 1, "guess", 0.6, prob, 1 if right else 4)


def series(source, marks, variant="patched", name="racer", **more):
    """One image per character: `+` right, `-` wrong, `.` none; probabilities that grow with the pose."""
    return [
        one(source, i, mark == "+", variant, name, 0.01 * i, **more)
        for i, mark in enumerate(marks, 1)
        if mark != "."
    ]  # fmt: skip


def test_gap_and_its_parts_are_counted_pose_by_pose():
    (found,) = compare_sim_real([*series("real", "+--+-.++"), *series("sim", "++++-+.+")])
    row = found.rows[0]
    counts = row.outcomes
    assert (counts.n, counts.both, counts.only_first, counts.only_second) == (6, 3, 2, 0)
    assert (counts.n_first, counts.n_second) == (5, 3)
    assert counts.gain == pytest.approx(-1 / 3)
    assert counts.gain_ci95 == paired_difference_interval(3, 0, 2, 1)
    assert counts.mcnemar_p == pytest.approx(binomtest(0, 2).pvalue)
    assert [place_of(pair) for pair in found.wrong] == [("racer", "patched", 2), ("racer", "patched", 3)]
    assert row.rank.rho == pytest.approx(1)  # both series grow with the pose
    assert found.unmatched_real == (
        ("real/racer/patched/pose_07.jpg", "sim has no image of racer, patched, pose 7"),
    )  # fmt: skip
    assert [path for path, _ in found.unmatched_sim] == ["sim/racer/patched/pose_06.jpg"]


def test_pooled_rows_stand_last_and_add_up():
    seen = [
        shot
        for name, real, sim in (("b", "+-", "++"), ("a", "--+", "-++"))
        for variant in ("unpatched", "patched")
        for shot in (*series("real", real, variant, name), *series("sim", sim, variant, name))
    ]
    (found,) = compare_sim_real(seen)
    assert [(row.object, row.second, row.outcomes.n, row.outcomes.only_first) for row in found.rows] == [
        ("a", "unpatched", 3, 1), ("a", "patched", 3, 1), ("b", "unpatched", 2, 1), ("b", "patched", 2, 1),
        ("all", "unpatched", 5, 2), ("all", "patched", 5, 2),
    ]  # fmt: skip


def test_gains_are_foreseen_or_not():
    seen = [
        *series("real", "-----+++", "unpatched"), *series("real", "++---+-.", "patched"),
        *series("sim", "--+--+++", "unpatched"), *series("sim", "+-++-++-", "patched"),
    ]  # fmt: skip
    forecast, pooled = compare_sim_real(seen)[0].forecasts
    # of the seven poses with all four images, photographs gain 1 and 2, the rig 1 and 4
    found = forecast.outcomes
    assert (found.n, found.both, found.only_first, found.only_second, found.neither) == (7, 1, 1, 1, 4)
    assert (forecast.sim_lost, forecast.real_lost) == (0, 1)
    assert found.kappa == pytest.approx((5 / 7 - (4 + 25) / 49) / (1 - (4 + 25) / 49))
    assert (forecast.sim_gain, forecast.real_gain) == (pytest.approx(2 / 7), pytest.approx(1 / 7))
    assert replace(pooled, object="racer") == forecast
    assert compare_sim_real([*series("real", "+"), *series("sim", "+")])[0].forecasts == ()  # nothing bare


def test_which_sources_are_compared():
    def pairs(*sources):
        shots = [shot for source in sources for shot in series(source, "++")]
        return [(found.sim, found.real) for found in compare_sim_real(shots)]

    assert pairs("real", "sim", "sim-rig18") == [("sim", "real"), ("sim-rig18", "real")]
    assert pairs("photos-b", "real", "sim-like-real") == [("sim-like-real", "real")]
    assert pairs("real", "photos-b") == pairs("sim", "sim-rig18") == []
    rendered = series("shelf", "++", is_rendered=True)
    assert [found.sim for found in compare_sim_real([*series("real", "++"), *rendered])] == ["shelf"]
    assert compare_sim_real([*series("real", "++"), *series("sim", "++", name="eggnog")]) == []


def test_another_patch_is_not_compared():
    sim = [one("sim", i, True, booster_sha256="a" * 64) for i in (1, 2, 3)]
    real = [one("real", i, True, booster_sha256=sha) for i, sha in ((1, "a" * 64), (2, "b" * 64), (3, None))]
    (found,) = compare_sim_real([*sim, *real])
    assert [place_of(pair)[2] for pair in found.pairs] == [1, 3]  # a photograph sorted by hand says nothing: taken
    ((path, reason),) = found.unmatched_real
    assert path == "real/racer/patched/pose_02.jpg" and "sim has another patch or texture there" in reason


def test_several_photographs_of_a_pose_are_paired_by_name_or_the_first_is():
    real = [one("real", 1, True, file=name) for name in ("pose_01.heic", "pose_01.jpg", "pose_01_b.jpg")]
    like = [one("sim-like-real", 1, True, file=name) for name in ("pose_01.heic.jpg", "pose_01.jpg", "pose_01_b.jpg")]
    (found,) = compare_sim_real([*real, *like])
    assert {(pair.first.capture.file.name, pair.second.capture.file.name) for pair in found.pairs} == {
        ("pose_01.heic.jpg", "pose_01.heic"), ("pose_01.jpg", "pose_01.jpg"), ("pose_01_b.jpg", "pose_01_b.jpg"),
    }  # fmt: skip
    by_hand = [one("real", 1, True, file=name) for name in ("IMG_1.jpg", "IMG_001.jpg")]
    (found,) = compare_sim_real([*by_hand, one("sim", 1, True)])
    assert [pair.second.capture.file.name for pair in found.pairs] == ["IMG_1.jpg"]
    assert found.unmatched_real == (("real/racer/patched/IMG_001.jpg", "another image of pose 1 is compared"),)


def test_unread_images_and_those_without_a_pose_are_in_no_pair():
    unread = replace(one("real", 2, True), status="broken", true_rank=None)
    nameless = replace(one("real", 3, True).capture, pose_id=None)
    real = [one("real", 1, True), unread, replace(one("real", 3, True), capture=nameless)]
    (found,) = compare_sim_real([*real, *series("sim", "+++")])
    assert len(found.pairs) == 1
    assert found.unmatched_real == (("real/racer/patched/pose_03.jpg", "no pose number in its name"),)


def headline(real, sim):
    return compare_predictions("net", [*real, *sim]).headlines[-1]


@pytest.mark.parametrize(
    ("real", "sim", "words"),
    [
        ("--", "--", "No pose was gained in the photographs, and the rig predicted none."),
        ("--", "+-", "No pose was gained in the photographs, and the rig predicted 1."),
        ("++", "+-", "The rig predicted 1 of the 2 poses gained in the photographs."),
        ("+-", "++", "The rig predicted 1 of the 1 poses gained in the photographs; it predicted 1 more that were not"),
    ],
)
def test_gains_are_told_in_words(real, sim, words):
    bare = [*series("real", "--", variant="unpatched"), *series("sim", "--", variant="unpatched")]
    sentence = headline([*bare, *series("real", real)], series("sim", sim)).sentence
    assert words.rstrip(".") in sentence


def test_the_headline_is_no_surer_than_the_numbers():
    much = headline(series("real", "-" * 9 + "+"), series("sim", "+" * 10))
    assert much.source == "sim and real" and much.verdict.startswith("The rig promises too much")
    assert "a gap of −90 points" in much.sentence and "p = 0.0039" in much.sentence
    little = headline(series("real", "+" * 10), [one("sim", i, False, prob=0.5) for i in range(1, 11)])
    assert (little.tone, little.verdict) == ("bad", "The rig promises too little")
    assert "probability: all equal" in little.sentence
    shuffled = [one("sim", i, True, prob=0.1 + 0.07 * ((7 * i) % 12)) for i in range(1, 13)]
    assert headline(series("real", "+" * 12), shuffled).tone == "open"
    noisy = [one("sim", i, i > 6, prob=0.05 * (i + (-1) ** i)) for i in range(1, 13)]
    assert headline(series("real", "------++++++"), noisy).tone == "good"
    assert headline(series("real", "++"), series("sim", "++")).tone == "open"


def printed(found) -> str:
    console = Console(width=80, record=True, file=io.StringIO())
    print_sim_real(console, found)
    return console.export_text()


def test_the_console_tells_the_gap_the_wrong_poses_and_what_was_left_out():
    seen = [
        shot
        for name in ("coffeepot", "warplane")
        for variant, real, sim in (("unpatched", "-" * 18, "-" * 18), ("patched", "+-" * 9, "+" * 17 + "."))
        for shot in (*series("real", real, variant, name), *series("sim", sim, variant, name))
    ]
    text = printed(compare_sim_real(seen))
    assert "sim and real: 70 pairs of images of the same pose" in text
    assert "  coffeepot patched: pose 2−, 4−, 6−, 8−, 10−, 12−, 14−, 16−" in text
    assert "not compared, real: 2 images, the first real/coffeepot/patched/pose_18.jpg: sim has no image" in text
    low, high = (round(100 * end) for end in paired_difference_interval(9, 0, 8, 0))
    assert f"−47 (−{-low} to −{-high}) 0.0078" in " ".join(text.split())  # 2 · 0.5⁸
    tables = [line for line in text.splitlines() if line.startswith(("object", "coffeepot", "warplane", "all", "   "))]
    assert len(tables) >= 10 and max(map(len, tables)) <= 80
    assert printed([]) == ""


def test_probabilities_are_placed_by_their_odds():
    assert (place_prob(0), place_prob(0.001), place_prob(0.999), place_prob(1)) == pytest.approx((0, 0, SIDE, SIDE))
    assert place_prob(0.5) == pytest.approx(SIDE / 2)
    assert place_prob(0.2) + place_prob(0.8) == pytest.approx(SIDE)


def test_the_chart_marks_what_the_rig_got_wrong():
    (view,) = view_sim_real(compare_sim_real([*series("real", "+-+-"), *series("sim", "++--")]))
    (points,) = view.charts.values()
    assert [point.kind for point in points] == ["both", "sim", "real", "neither"]
    assert all(point.x == pytest.approx(SIDE - point.y) for point in points)  # equal probabilities: the diagonal
    assert "racer, pose 2: 2 % in the rig, 2 % in the photograph" in points[1].words
    assert [card.title for card in view.cards] == ["racer · patched · pose 2", "racer · patched · pose 3"]
    many = [*series("real", "-" * 60), *[one("sim", i, True, prob=1 - 0.001 * i) for i in range(1, 61)]]
    (view,) = view_sim_real(compare_sim_real(many))
    assert len(view.cards) == MAX_CARDS and view.cards[0].title.endswith("pose 1")


def test_a_run_writes_it_to_summary_and_report(workspace, put, colour_classifier):
    says = {
        "sim": {"unpatched": ["eggnog", "eggnog", "racer"], "patched": ["racer", "racer", "racer"]},
        "real": {"unpatched": ["eggnog", "eggnog", "racer"], "patched": ["racer", "eggnog", "racer"]},
    }
    for source, variants in says.items():
        for variant, labels in variants.items():
            for i, label in enumerate(labels, 1):
                put(f"{source}/racer/{variant}/pose_{i:02d}.png", label)
    result = evaluate_captures(workspace.captures_dir, workspace, colour_classifier)
    (entry,) = json.loads((result.run_dir / "summary.json").read_text())["sim_real"]
    assert (entry["sim"], entry["real"], entry["n"], entry["unmatched_sim"]) == ("sim", "real", 6, [])
    row = next(row for row in entry["rows"] if (row["object"], row["variant"]) == ("racer", "patched"))
    assert (row["sim_top1"], row["real_top1"], row["sim_only"]) == (1, pytest.approx(2 / 3), 1)
    assert row["gap"] == pytest.approx(-1 / 3) and row["gap_ci95"][0] < row["gap"] < row["gap_ci95"][1]
    (gain, _) = entry["gains"]
    assert (gain["both"], gain["sim_only"], gain["real_only"], gain["neither"]) == (1, 1, 0, 1)
    (wrong,) = entry["wrong"]
    assert (wrong["pose_id"], wrong["sim_right"], wrong["real_right"], wrong["real_says"]) == (2, True, False, "eggnog")
    page = result.report_file.read_text()
    section = page[page.index('id="sim-real"') : page.index('id="poses"')]
    assert "Predicted wrongly: 1 of 6" in section and section.count('<img src="data:image/jpeg') == 2
    assert '<div class="variant">simulated images</div>' in section
    assert '<div class="variant">photographs</div>' in section
    assert section.count("<title>racer, pose") == 6
    assert "http" not in section and 'src="/' not in section


def test_a_run_without_photographs_says_nothing_of_them(workspace, put, colour_classifier):
    put("sim/racer/patched/pose_01.png", "racer")
    result = evaluate_captures(workspace.captures_dir, workspace, colour_classifier)
    assert json.loads((result.run_dir / "summary.json").read_text())["sim_real"] == []
    assert "sim-real" not in result.report_file.read_text()


def test_a_rig_that_was_shot_anew_from_elsewhere_is_not_compared():
    """Photographs at 44°, the rig at 75°: no pair at pose 2, and the reason is listed; pose 1 agrees."""

    def shot(source, pose_id, elevation_deg):
        up, out = 500 * np.sin(np.radians(elevation_deg)), 500 * np.cos(np.radians(elevation_deg))
        rows = ((1.0, 0.0, 0.0, out), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, up), (0.0, 0.0, 0.0, 1.0))
        path = f"{source}/racer/unpatched/{pose_id}.png"
        capture = Capture(source, "racer", "unpatched", pose_id, Path(path), path, T_world_camera=rows)
        return Prediction(capture, 0, "racer", 0, "racer", 0.6, 0.6, 1)

    (found,) = compare_sim_real([shot("sim", 1, 44), shot("sim", 2, 75), shot("real", 1, 40), shot("real", 2, 44)])
    assert [place_of(pair)[2] for pair in found.pairs] == [1]
    (sim,), (real,) = found.unmatched_sim, found.unmatched_real
    assert sim[0] == "sim/racer/unpatched/2.png" and "31° apart" in sim[1] and "--like" in real[1]
    moved = compare_predictions("net", [shot("sim", 1, 75), shot("real", 1, 44)])
    assert not moved.sim_real and [path for path, _ in moved.unpaired] == ["real/racer/unpatched/1.png"]
