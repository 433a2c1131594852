"""The three questions that the controls answer, on made-up outcomes whose counts are known."""

import json
from pathlib import Path

import pytest
from scipy.stats import binomtest

from toolkit.captures.capture import Capture
from toolkit.evaluation import metrics
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.metrics import rank_variant
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.results import compare_predictions
from toolkit.evaluation.verdict import EITHER, STICKER, ask_help, ask_this
from toolkit.rig.variants import CONTROLS_OF, VARIANTS

HELPS, THIS_PATCH = ask_help("patched"), ask_this("patched")


def shoot(name="racer", source="sim", n=18, **right):
    """Predictions of `n` poses for each variant; `patch_alone=3`: right in the first three poses."""
    made = []
    for variant, n_right in right.items():
        variant = variant.replace("_", "-")
        for pose in range(1, n + 1):
            path = f"{source}/{name}/{variant}/{pose}.png"
            capture = Capture(source, name, variant, pose, Path(path), path)
            is_right = pose <= n_right
            says = (0, name) if is_right else (7, "packet" if pose % 3 else "bobsled")
            made.append(Prediction(capture, 0, name, *says, 0.6, 0.6 if is_right else 0.1, 1 if is_right else 4))
    return made


def compare_controls(predictions):
    return metrics.compare_controls(metrics.index_poses(predictions))


def answer(predictions, question):
    found = [one for one in compare_predictions("net", predictions).headlines if one.question == question]
    assert len(found) <= 1
    return found[0] if found else None


STRONG = {"unpatched": 2, "patched": 17, "wrong_patch": 1, "random_patch": 4, "grey_patch": 3}


def test_order_of_variants():
    names = [*reversed(VARIANTS), "qr-code", "sticker"]
    expected = [
        "unpatched",
        "patched",
        "textured",
        "wrapped",
        "qr-code",
        "sticker",
        "wrong-patch",
        "random-patch",
        "grey-patch",
        "camouflage",
        "patch-alone",
        "random-texture",
        "grey-texture",
    ]
    assert sorted(names, key=rank_variant) == expected


def test_counts_against_the_binomial_test():
    rows = {(row.object, row.first, row.second): row for row in compare_controls(shoot(**STRONG, patch_alone=9))}
    row = rows["racer", "patched", "random-patch"]
    found = row.outcomes
    assert (found.n, found.n_first, found.n_second, found.only_first, found.only_second) == (18, 17, 4, 13, 0)
    assert found.mcnemar_p == pytest.approx(binomtest(13, 13, 0.5).pvalue)
    assert row.prob_second == pytest.approx((4 * 0.6 + 14 * 0.1) / 18)
    assert rows["all", "patched", "patch-alone"].outcomes.only_first == 8
    wrong = rows["all", "unpatched", "wrong-patch"]
    assert (wrong.outcomes.n_first, wrong.outcomes.n_second, wrong.outcomes.only_first) == (2, 1, 1)
    # wrong in poses 2 to 18, of which 3, 6, …, 18 are called bobsled
    assert wrong.commonest_mistake == ("packet", 11)
    interval = binomtest(17, 18).proportion_ci(0.95, method="wilson")
    assert row.as_json()["first_ci95"] == pytest.approx([interval.low, interval.high])


def test_poses_are_matched_and_unread_ones_left_out():
    seen = shoot(patched=3, grey_patch=0, n=3)
    broken = Prediction(seen[-1].capture, 0, "racer", status="empty")
    lonely = shoot(n=5, patched=5)[-1]
    rows = compare_controls([*seen[:-1], broken, lonely])
    assert [(row.object, row.outcomes.n, row.outcomes.only_first) for row in rows] == [("racer", 2, 2), ("all", 2, 2)]
    assert compare_controls(shoot(unpatched=3, patched=3)) == []


def test_pooled_over_objects_but_not_over_sources():
    seen = shoot("a", patched=18, grey_patch=1) + shoot("b", patched=18, grey_patch=2)
    seen += shoot("a", source="real", n=4, patched=4, grey_patch=4)
    rows = {(row.source, row.object): row for row in compare_controls(seen)}
    assert (rows["sim", "all"].outcomes.n, rows["sim", "all"].outcomes.n_second) == (36, 3)
    assert (rows["real", "all"].outcomes.n, rows["real", "all"].outcomes.n_second) == (4, 4)


def test_it_is_this_patch():
    found = answer(shoot(**STRONG), THIS_PATCH)
    assert (found.tone, found.verdict) == ("good", "It is this patch")
    assert "17 of 18 (94 %, 95 % interval 74–99 %) with the patch" in found.sentence
    assert "4 of 18 (22 %, 95 % interval 9–45 %) with the best control, 'random-patch'" in found.sentence
    assert "exact McNemar p = 0.00024" in found.sentence  # 2 · 0.5¹³
    assert "on 1 of 18 (6 %, 95 % interval 1–26 %), against 2 of 18" in found.sentence
    assert "(0 gained, 1 lost, exact McNemar p = 1)" in found.sentence and "'packet' (11 of 18)" in found.sentence


@pytest.mark.parametrize(
    ("changed", "tone", "verdict"),
    [
        ({"grey_patch": 14}, "open", "Not shown to be this patch"),
        ({"patched": 3, "grey_patch": 15}, "bad", "It is not this patch: 'grey-patch' does better"),
        ({"unpatched": 17}, "open", "This patch beats its controls, but is not shown to help"),
        ({"unpatched": 4, "patched": 4}, "open", "No help is shown that this patch could have caused"),
    ],
)
def test_when_it_is_not_shown_to_be_this_patch(changed, tone, verdict):
    found = answer(shoot(**(STRONG | changed)), THIS_PATCH)
    assert (found.tone, found.verdict) == (tone, verdict)


def test_every_control_must_be_beaten():
    seen = shoot(unpatched=0, patched=18, random_patch=9) + shoot(n=4, wrong_patch=0)
    found = answer(seen, THIS_PATCH)
    assert found.verdict == "Not shown against every control"  # 4 poses of wrong-patch cannot give p < 0.05
    assert "'random-patch'" in found.sentence


@pytest.mark.parametrize(
    ("alone", "patched", "tone", "words"),
    [
        (16, 18, "bad", "The network recognises the sticker, not the object"),
        (8, 10, "open", "not shown to add"),
        (0, 18, "good", "The network needs the object"),
        (9, 18, "open", "Both"),
        (12, 18, "open", "Both"),  # two thirds of 18: the interval reaches below a half
        (0, 2, "open", "mostly not enough; that"),
    ],
)
def test_object_or_sticker(alone, patched, tone, words):
    found = answer(shoot(unpatched=0, patched=patched, patch_alone=alone), STICKER)
    assert found.tone == tone and words in found.verdict
    assert f"in {alone} of 18" in found.sentence and f"{patched} of 18" in found.sentence


def test_sticker_numbers_in_words():
    found = answer(shoot(patched=18, patch_alone=16), STICKER)
    assert "16 of 18 (89 %, 95 % interval 67–97 %) of its poses" in found.sentence
    assert "2 only with the object, 0 only without it (exact McNemar p = 0.5)" in found.sentence
    found = answer(shoot(unpatched=1, patch_alone=16), STICKER)
    assert "nothing was shot with the patch on the object" in found.sentence


def test_controls_get_no_headline_beside_the_patch():
    full = compare_predictions("net", shoot(**STRONG, patch_alone=16)).headlines
    assert [one.question for one in full] == [HELPS, THIS_PATCH, STICKER]
    bare = compare_predictions("net", shoot(unpatched=2, grey_patch=3, patch_alone=3)).headlines
    assert [(one.variant, one.question) for one in bare] == [("grey-patch", ""), ("patch-alone", STICKER)]
    assert [one.question for one in compare_predictions("net", shoot(unpatched=2, patched=9)).headlines] == [""]


def test_the_sticker_alone_is_no_flip():
    gained, _ = compare_predictions("net", shoot(**STRONG, patch_alone=16)).flips
    assert gained.counts == (("patched", 15), ("random-patch", 2), ("grey-patch", 1))
    assert [pair.second.capture.variant for pair in gained.shown] == ["patched"] * 15 + ["random-patch"] * 2 + [
        "grey-patch"
    ]


def test_summary_and_report(put, workspace, colour_classifier):
    for pose in range(1, 9):
        for variant in ("unpatched", "patched", *CONTROLS_OF["patched"]):
            says = "racer" if variant in ("patched", "patch-alone") else "eggnog"
            put(f"sim/racer/{variant}/pose_{pose:02d}.png", says)
    result = evaluate_captures(workspace.captures_dir, workspace, colour_classifier)
    controls = json.loads((result.run_dir / "summary.json").read_text())["controls"]
    assert [one["question"] for one in controls["answers"]] == [HELPS, THIS_PATCH, STICKER]
    assert [one["tone"] for one in controls["answers"]] == ["good", "good", "bad"]
    assert len(controls["comparisons"]) == 2 * (1 + len(CONTROLS_OF["patched"]))
    first = controls["comparisons"][0]
    assert (first["first"], first["second"], first["only_first"], first["says"]) == (
        "patched",
        "wrong-patch",
        8,
        "eggnog",
    )
    html = result.report_file.read_text(encoding="utf-8")
    assert "The network recognises the sticker, not the object" in html and 'id="controls"' in html
    assert html.index(">wrong-patch<") < html.index(">grey-patch<") < html.index(">patch-alone<")
    assert 'class="deck wide"' in html


def test_without_controls_nothing_is_added(put, workspace, colour_classifier):
    put("sim/racer/unpatched/1.png", "eggnog")
    put("sim/racer/patched/1.png", "racer")
    result = evaluate_captures(workspace.captures_dir, workspace, colour_classifier)
    assert result.summary["controls"] == {"comparisons": [], "answers": []}
    assert 'id="controls"' not in result.report_file.read_text(encoding="utf-8")


GREEN = {"unpatched": 2, "textured": 17, "random_texture": 4, "grey_texture": 3}


def test_it_is_this_texture():
    """The controls of the texture are for the texture, as the patch's are for the patch."""
    lines = compare_predictions("net", shoot(**GREEN)).headlines
    assert [one.question for one in lines] == [ask_help("textured"), ask_this("textured")]
    assert [one.verdict for one in lines] == ["The texture helps", "It is this texture"]
    assert "17 of 18 (94 %, 95 % interval 74–99 %) with the texture and on 2 of 18" in lines[0].sentence
    assert "4 of 18 (22 %, 95 % interval 9–45 %) with the best control, 'random-texture'" in lines[1].sentence
    assert "13 only with the texture" in lines[1].sentence
    words = " ".join(one.verdict + one.sentence + one.question for one in lines)
    assert "patch" not in words and "sticker" not in words
    found = answer(shoot(**(GREEN | {"grey_texture": 14})), ask_this("textured"))
    assert found.verdict == "Not shown to be this texture" and "'grey-texture'" in found.sentence


@pytest.mark.parametrize(
    ("patched", "textured", "tone", "verdict"),
    [
        (5, 17, "good", "The texture does better"),
        (17, 5, "good", "The patch does better"),
        (15, 17, "open", "No difference shown between patch and texture"),
    ],
)
def test_patch_or_texture(patched, textured, tone, verdict):
    seen = shoot(unpatched=1, patched=patched, textured=textured)
    found = answer(seen, EITHER)
    assert (found.tone, found.verdict) == (tone, verdict)
    lost, won = max(0, patched - textured), max(0, textured - patched)
    assert f"{lost} only with the patch and {won} only with the texture" in found.sentence
    assert [one.question for one in compare_predictions("net", seen).headlines] == [
        ask_help("patched"), ask_help("textured"), EITHER,
    ]  # fmt: skip


def test_a_texture_beside_nothing_but_the_bare_object():
    (only,) = compare_predictions("net", shoot(unpatched=2, textured=9)).headlines
    assert (only.variant, only.question, only.verdict) == ("textured", "", "The texture helps")
    assert "Of 18 pairs, 7 became correct and 0 became wrong" in only.sentence
    (lonely,) = compare_predictions("net", shoot(unpatched=2, grey_texture=9)).headlines
    assert lonely.variant == "grey-texture" and "'grey-texture'" in lonely.verdict


def test_report_of_every_variant(put, workspace, colour_classifier):
    for pose in range(1, 9):
        for variant in VARIANTS:
            put(f"sim/racer/{variant}/{pose}.png", "racer" if variant in ("patched", "textured") else "eggnog")
    result = evaluate_captures(workspace.captures_dir, workspace, colour_classifier)
    assert [one["question"] for one in result.summary["controls"]["answers"]] == [
        HELPS, ask_help("textured"), ask_help("wrapped"), THIS_PATCH, STICKER, ask_this("textured"), EITHER,
    ]  # fmt: skip
    assert {pair["variant"] for pair in result.summary["pairs"]} == set(VARIANTS) - {"unpatched"}
    html = result.report_file.read_text(encoding="utf-8")
    for word in ("The texture helps", "It is this texture", "It is this patch", "it is this texture</i> need p"):
        assert word in html
    places = [html.index(f'<td class="text">{name}</td>') for name in ("unpatched", "patched", "textured")]
    assert places == sorted(places)


def test_missing_controls_of_photographs_are_planned_not_rendered(put, workspace, colour_classifier):
    for variant in ("unpatched", "patched"):
        put(f"real/racer/{variant}/1.png", "racer")
    html = evaluate_captures(workspace.captures_dir, workspace, colour_classifier).report_file.read_text("utf-8")
    assert "toolkit plan --shot-list --object racer --variant wrong-patch" in html and "capture-sim" not in html


def test_report_says_how_to_shoot_controls_that_are_missing(put, workspace, colour_classifier):
    for variant in ("unpatched", "patched", "textured"):
        put(f"sim/racer/{variant}/1.png", "racer")
    html = evaluate_captures(workspace.captures_dir, workspace, colour_classifier).report_file.read_text(
        encoding="utf-8"
    )
    assert "Patch and texture</h2>" in html and "Controls" not in html
    assert "No control of the patch was shot" in html and "--variant grey-patch" in html
    assert "toolkit capture-sim --object racer --variant wrong-patch" in html, "other objects were not evaluated"
    assert "No control of the texture was shot" in html and "--variant grey-texture" in html
    assert html.index("<img ") < html.index('id="table"'), "a picture stands above the table"
    assert html.index('id="sheet"') < html.index('id="method"')
