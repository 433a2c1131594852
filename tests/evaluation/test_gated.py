"""Photographs that failed a gate are marked, and the result is given with and without them."""

import csv
import io

import pytest
from rich.console import Console

from toolkit.core.files import sha256_file
from toolkit.core.statistics import PairedOutcomes
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.predictions_csv import predictions_table
from toolkit.evaluation.tables import print_tables
from toolkit.evaluation.verdict import judge_change
from toolkit.rooms.photos.gates import Gate
from toolkit.rooms.photos.gates.check_captures import CheckLine, open_gates_log

CLIPPED = Gate("over-exposure", 5.0, "% of the object clipped", "take it darker")


@pytest.fixture
def judged(workspace, put):
    """Eight poses of the racer, all right bare; the patch loses poses 1 and 2, of which 2 is 64 % clipped."""
    lines = []
    for pose in range(1, 9):
        put(f"real/racer/unpatched/pose_{pose}.jpg", "racer")
        file = put(f"real/racer/patched/pose_{pose}.jpg", "warplane" if pose < 3 else "racer")
        share = 64.0 if pose == 2 else 1.0
        lines.append(
            CheckLine(
                setup="s", path=f"racer/patched/pose_{pose}.jpg", image_sha256=sha256_file(file),
                results=(CLIPPED.judge(share),), lines=None,
            )
        )  # fmt: skip
    open_gates_log(workspace.captures_dir / "real").append(*lines)
    return workspace


def test_a_failed_photograph_is_marked_and_counted_both_ways(judged, colour_classifier):
    done = evaluate_captures(judged.captures_dir, judged, colour_classifier)
    assert done.notes == ()  # gates.jsonl is the kit's own file
    assert [pair["lost"] for pair in done.summary["pairs"] if pair["object"] == "racer"] == [2]
    gates = done.summary["gates"]
    assert gates["failed"] == [
        {"path": "real/racer/patched/pose_2.jpg", "gates": ["over-exposure 64 % of the object clipped"]}
    ]
    assert [(p["n_pairs"], p["lost"]) for p in gates["pairs_without"] if p["object"] == "racer"] == [(7, 1)]
    text = io.StringIO()
    print_tables(Console(file=text, width=200), done)
    assert "real: 1 photograph failed a gate. patched with them:" in text.getvalue()
    assert (
        "0 gained, 2 lost" in text.getvalue()
        and "without them: 7/7 correct without it, 6/7 with it, 0 gained, 1 lost" in text.getvalue()
    )
    rows = list(csv.DictReader((done.run_dir / "predictions.csv").open()))
    marked = {row["path"]: row["failed_gates"] for row in rows if row["failed_gates"]}
    assert marked == {"real/racer/patched/pose_2.jpg": "over-exposure 64 % of the object clipped"}
    assert predictions_table(done)["failed_gates"].tolist() == [row["failed_gates"] for row in rows]
    page = done.report_file.read_text()
    assert page.count("⚠ over-exposure 64 % of the object clipped") == 2  # on the flip and on the contact sheet
    assert "1 photograph failed a gate" in page and '<span class="gate">⚠ 1</span>' in page


def test_a_photograph_that_was_taken_again_is_no_longer_the_one_that_failed(judged, put, colour_classifier):
    put("real/racer/patched/pose_2.jpg", "racer")
    done = evaluate_captures(judged.captures_dir, judged, colour_classifier)
    assert done.gated == [] and done.passed is None and "failed a gate" not in done.report_file.read_text()


@pytest.mark.parametrize(
    ("gained", "lost", "verdict"),
    [
        (5, 0, "Better in every pair that changed; 5 pairs are too few to be sure: 6 needed"),
        (1, 0, "Better in every pair that changed; 1 pair is too few to be sure: 6 needed"),
        (0, 3, "Worse in every pair that changed; 3 pairs are too few to be sure: 6 needed"),
        (8, 3, "8 pairs became correct and 3 wrong: not enough to tell"),
        (0, 0, "No pair changed"),
        (6, 0, "The patch helps"),
    ],
)
def test_an_unsure_verdict_says_which_way_it_points(gained, lost, verdict):
    """17 to 100 % by 5 gained and none lost is no failure to help; the statistics are those of before."""
    outcomes = PairedOutcomes(both=1, only_first=lost, only_second=gained, neither=0)
    tone, said, why = judge_change("the patch", outcomes)
    assert said == verdict and tone == ("good" if gained == 6 else "open")
    assert f"{gained} became correct and {lost} became wrong (exact McNemar p = " in why


def test_the_gates_are_loaded_only_for_photographs_that_were_judged(workspace, put, colour_classifier, monkeypatch):
    put("real/racer/unpatched/pose_1.jpg", "racer")
    monkeypatch.setattr("toolkit.evaluation.ground_truth.find_offer", None)
    assert evaluate_captures(workspace.captures_dir, workspace, colour_classifier).gated == []
