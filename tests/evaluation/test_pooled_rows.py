"""Pooled rows: the booster and the bare object on the same pairs, and objects of unequal size said."""

import json
from itertools import product

import pytest
from rich.console import Console
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.tables import build_tables, print_tables


@pytest.fixture
def part(put, workspace, colour_classifier):
    """35 bare images of which 7 are right; 11 of them patched too: none of these was right bare, 2 are in the patch."""
    for pose in range(1, 25):
        put(f"sim/warplane/unpatched/{pose}.png", "warplane" if pose <= 7 else "racer")
    for pose in range(1, 12):
        put(f"sim/racer/unpatched/{pose}.png", "warplane")
        put(f"sim/racer/patched/{pose}.png", "racer" if pose <= 2 else "warplane")
    return evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(run="part"))


def read_table(found):
    console = Console(width=200, record=True)
    for table in build_tables(found.groups, found.pairs):
        console.print(table)
    return console.export_text()


def test_bares_share_of_the_same_pairs_stands_beside_it(part, workspace):
    row = next(row for row in part.summary["pairs"] if row["object"] == "all")
    assert (row["n_pairs"], row["n_first"], row["n_second"], row["gained"]) == (11, 0, 2, 2)
    assert [line for line in read_table(part).splitlines() if "0 → 2 of 11" in line]
    assert "0 → 2 of 11" in part.report_file.read_text()
    shown = CliRunner().invoke(app, ["runs", "--workspace", str(workspace.root)], env={"COLUMNS": "200"})
    assert "2/0 of 11, unmodified 0 %" in shown.stdout
    rows = json.loads(CliRunner().invoke(app, ["runs", "--json", "--workspace", str(workspace.root)]).stdout)
    assert (rows[1]["n_pairs"], rows[1]["n_bare"]) == (11, 0)


def test_where_all_are_in_pairs_nothing_is_added(put, workspace, colour_classifier):
    for pose in (1, 2):
        put(f"sim/racer/unpatched/{pose}.png", "warplane")
        put(f"sim/racer/patched/{pose}.png", "racer")
    found = evaluate_captures(workspace.captures_dir, workspace, colour_classifier)
    assert "in pairs" not in read_table(found) and not any("unequal" in note for note in found.notes)


def test_a_pooled_test_of_unequal_objects_says_so(put, workspace, colour_classifier):
    for name, poses in (("racer", 3), ("warplane", 5)):
        for pose in range(1, poses + 1):
            put(f"sim/{name}/unpatched/{pose}.png", "racer")
            put(f"sim/{name}/patched/{pose}.png", name)
    found = evaluate_captures(workspace.captures_dir, workspace, colour_classifier)
    note = "sim: objects have unequal numbers of pairs (racer 3, warplane 5); in row 'all' of patched against unpatched"
    assert any(one.startswith(note) for one in found.summary["notes"])
    assert note.replace("'", "&#39;") in found.report_file.read_text()


def test_the_terminal_shows_the_verdict_first_and_few_rows(put, workspace, colour_classifier, capsys):
    boosters = ["patched", "textured", "grey-patch", "wrong-patch"]

    def show(variants):
        for name, pose in product(("racer", "warplane"), (1, 2)):
            put(f"sim/{name}/unpatched/{pose}.png", "racer" if name == "warplane" else "warplane")
            for variant in variants:
                put(f"sim/{name}/{variant}/{pose}.png", name)
        config = EvalConfig(run="few", replace=True, saliency=False)
        print_tables(
            Console(width=100), evaluate_captures(workspace.captures_dir, workspace, colour_classifier, config)
        )
        return capsys.readouterr().out.splitlines()

    lines = show(boosters[:1])
    assert lines[0].startswith("sim: ") and "of 4 " in lines[0] and len(lines) <= 12
    rows = [line.split() for line in lines if "→" in line and not line.startswith("sim: ")]
    assert [row[:2] for row in rows] == [["racer", "patched"], ["warplane", "patched"], ["all", "patched"]]
    assert rows[-1][2:] == ["0", "→", "4", "of", "4", "4", "0", "0.12"]
    lines = show(boosters)
    assert next(line.split()[0] for line in lines if "→" in line and not line.startswith("sim: ")) == "all"
    assert not [line for line in lines if line.startswith("racer")] and len(lines) <= 20
