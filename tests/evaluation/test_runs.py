"""All results of a workspace as one table: what is read of each experiment, what is chosen, what is refused."""

import json

import pytest
from made_answers import make_benchmark
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.compare import compare_runs
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.predictions_csv import DETECTION_COLUMNS, read_predictions
from toolkit.evaluation.summaries import CLEAR, MEAN, find_runs, open_run, parse_where, pick_rows
from toolkit.rooms.benchmarks.corruptions.benchmark_means import summarise


@pytest.fixture
def evaluated(put, workspace, colour_classifier):
    """A workspace with the run `night`: racer and warplane, two poses; the patch gains one of the racer."""
    for name in ("racer", "warplane"):
        for pose in (1, 2):
            put(f"sim/{name}/unpatched/{pose}.png", "coffeepot" if (name, pose) == ("racer", 2) else name)
            put(f"sim/{name}/patched/{pose}.png", name)
    evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(run="night"))
    return workspace


def write_summary(workspace, name, content):
    file = workspace.eval_dir / name / "summary.json"
    file.parent.mkdir(parents=True)
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    return file


def write_world(workspace, name="grid"):
    """A run of a world: two weathers, two places and both together."""
    groups, pairs = [], []
    for weather, severity in (("clear", 0), ("fog", 3)):
        for place in ("kerb", "all"):
            at = {"source": "city", "object": "all", "world": "city", "place": place, "weather": weather}
            at |= {"severity": severity, "visibility_m": None}
            for variant in ("unpatched", "patched"):
                share = {
                    "n": 4,
                    "failed": 0,
                    "top1": 0.5,
                    "top5": 1.0,
                    "top1_ci95": [0.15, 0.85],
                    "mean_true_prob": 0.4,
                }
                groups.append(at | {"variant": variant} | share)
            pairs.append(at | {"variant": "patched", "n_pairs": 4, "gained": 2, "lost": severity, "mcnemar_p": 0.5})
    content = {"schema_version": 1, "model": {"arch": "resnet18"}, "groups": groups, "pairs": pairs}
    return write_summary(workspace, name, content)


def write_landing(workspace, name="landing/first"):
    cells = [
        {"pad": pad, "regressor": "small", "world": "apron", "weather": "fog", "severity": 2, "gains": "gentle",
         "n": 50, "success": share, "success_ci95": [0.1, 0.9], "crashed": 1, "missed": 2, "lost": 3, "timed_out": 4}
        for pad, share in (("plain", 0.4), ("boosted", 0.8))
    ]  # fmt: skip
    at = "small/apron/fog:2/gentle"
    pairs = [
        {"cell": f"boosted/{at}", "against": f"plain/{at}", "gained": 20, "lost": 0, "mcnemar_p": 0.001},
        {
            "cell": f"boosted/{at}",
            "against": "boosted/large/apron/fog:2/gentle",
            "gained": 3,
            "lost": 3,
            "mcnemar_p": 1,
        },
    ]
    return write_summary(workspace, name, {"schema_version": 1, "cells": cells, "pairs": pairs})


def write_detections(workspace, name, found):
    """A detector's run on the racer alone, whose groups have no row of all objects."""
    group = {
        "source": "sim",
        "object": "racer",
        "variant": "unpatched",
        "n": 2,
        "failed": 0,
        "found": found.count(1) / 2,
    }
    group |= {"recall50": 1.0, "ap50": 0.4, "ap50_95": 0.2, "mean_score": 0.3, "found_ci95": [0.1, 0.9]}
    content = {"schema_version": 1, "kind": "detections", "model": {"name": "yolo"}, "groups": [group], "pairs": []}
    file = write_summary(workspace, name, content)
    rows = [f"sim,racer,unpatched,{k},sim/racer/unpatched/{k}.png,car,,{one},0.5,0.6,,dog,0.7,ok" for k, one in
            enumerate(found, 1)]  # fmt: skip
    (file.parent / "detections.csv").write_text("\n".join([",".join(DETECTION_COLUMNS), *rows]) + "\n")


def test_a_run_has_the_numbers_of_its_summary(evaluated):
    summary = json.loads((evaluated.eval_dir / "night" / "summary.json").read_text())
    rows = open_run(evaluated, "night").rows
    assert [(row.object, row.variant, row.n, row.share) for row in rows] == [
        (one["object"], one["variant"], one["n"], one["top1"]) for one in summary["groups"]
    ]
    pooled = next(row for row in rows if (row.object, row.variant) == ("all", "patched"))
    assert (pooled.gained, pooled.lost, pooled.p, pooled.network) == (1, 0, 1.0, "colours")
    assert (pooled.kind, pooled.condition, pooled.severity) == ("eval", CLEAR, 0)


def test_every_experiment_is_a_row(evaluated):
    write_world(evaluated)
    write_landing(evaluated)
    benchmark = summarise(make_benchmark(corruptions=("fog",), severities=(1, 2), readers=False, fixed=False))
    write_summary(evaluated, "corruptions/photographs-net", benchmark.model_dump(mode="json"))
    runs, refused = find_runs(evaluated)
    assert not refused
    assert {run.name: run.kind for run in runs} == {
        "corruptions/photographs-net": "benchmark", "grid": "world-eval", "landing/first": "landing", "night": "eval",
    }  # fmt: skip
    by_name = {run.name: run.rows for run in runs}
    fog = next(row for row in by_name["grid"] if (row.condition, row.place, row.variant) == ("fog", "all", "patched"))
    assert (fog.severity, fog.world, fog.gained, fog.lost) == (3, "city", 2, 3)
    boosted = by_name["landing/first"][1]
    assert (boosted.variant, boosted.metric, boosted.share, boosted.condition) == ("boosted", "success", 0.8, "fog")
    assert (boosted.gained, boosted.lost, by_name["landing/first"][0].gained) == (20, 0, None)
    own = by_name["corruptions/photographs-net"]
    mean = next(row for row in own if (row.condition, row.variant) == (MEAN, "patches-100"))
    each = [row.share for row in own if row.variant == "patches-100" and row.condition == "fog"]
    assert mean.share == pytest.approx(sum(each) / 2) and len(each) == 2


def test_a_summary_says_its_kind_wherever_it_lies(evaluated):
    (evaluated.eval_dir / "sweeps" / "light").mkdir(parents=True)
    (evaluated.eval_dir / "night").rename(evaluated.eval_dir / "sweeps" / "light" / "net")
    assert open_run(evaluated, "sweeps/light/net").kind == "eval"


def test_an_older_summary_without_a_kind_is_told_by_what_it_holds(evaluated, as_older):
    file = as_older(evaluated.eval_dir / "night") / "summary.json"
    content = json.loads(file.read_text())
    assert content.pop("kind") == "eval"
    file.write_text(json.dumps(content))
    write_summary(evaluated, "sweeps/light/net", content)
    benchmark = summarise(make_benchmark(corruptions=("fog",), severities=(1,), readers=False)).model_dump(mode="json")
    assert benchmark.pop("kind") == "benchmark"
    write_summary(evaluated, "corruptions/old", benchmark)
    write_world(evaluated)
    write_landing(evaluated)
    runs, refused = find_runs(evaluated)
    assert not refused
    assert {run.name: run.kind for run in runs} == {
        "corruptions/old": "benchmark", "grid": "world-eval", "landing/first": "landing", "night": "eval",
        "sweeps/light/net": "sweep",
    }  # fmt: skip


def test_one_place_has_no_interval(evaluated):
    file = write_world(evaluated)
    content = json.loads(file.read_text())
    content["groups"][0]["top1_ci95"] = None
    file.write_text(json.dumps(content))
    assert open_run(evaluated, "grid").rows[0].ci95 is None


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ([], {("all", "unpatched"), ("all", "patched")}),
        (["variant=patched"], {("all", "patched")}),
        (["object=racer"], {("racer", "unpatched"), ("racer", "patched")}),
        (["object=*", "top1<0.6"], {("racer", "unpatched")}),
        (["gained>=1"], {("all", "patched")}),
        (["model!=colours"], set()),
        (["weather=clean", "run=ni?ht", "variant!=un*"], {("all", "patched")}),
        (["lost<1"], {("all", "patched")}),  # unpatched has no pairs, which is not the same as none lost
    ],
)
def test_conditions_choose_rows(evaluated, words, found):
    rows = pick_rows(open_run(evaluated, "night").rows, [parse_where(one) for one in words])
    assert {(row.object, row.variant) for row in rows} == found


def test_parts_are_shown_where_all_is_asked_for(evaluated):
    write_world(evaluated)
    rows = open_run(evaluated, "grid").rows
    assert {row.place for row in pick_rows(rows)} == {"all"}
    assert {row.condition for row in pick_rows(rows)} == {"clear", "fog"}  # weathers are results, no parts
    assert {row.place for row in pick_rows(rows, everything=True)} == {"all", "kerb"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("racer", "'racer' is not a condition: expected FIELD=VALUE"),
        ("objct=racer", "no field of a run called 'objct': did you mean object?"),
        ("object>racer", "> compares numbers"),
        ("share>much", "> compares numbers"),
        ("share>nan", "> compares numbers"),
    ],
)
def test_a_condition_that_means_nothing_is_refused(text, words):
    with pytest.raises(ToolkitError, match=words):
        parse_where(text)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            {"schema_version": 2, "groups": []},
            "was written by a newer toolkit (schema_version 2, expected at most 1)",
        ),
        ({"hello": 1}, "is not a result of toolkit: expected a schema_version"),
        ([1, 2], "is not a result of toolkit"),
        ({"schema_version": True, "groups": []}, "is not a result of toolkit"),
        ({"schema_version": 1, "losses": [3]}, "is not a result of toolkit: expected groups or cells"),
        ({"schema_version": 1, "kind": "eval"}, "is not a result of toolkit: expected groups or cells"),
        ({"schema_version": 1, "groups": 5}, "is damaged (field 'groups'"),
        ({"schema_version": 1, "kind": "wraps", "groups": []}, "has an unknown kind 'wraps'"),
        (
            {"schema_version": 1, "model": {}, "groups": [{"source": "sim"}], "pairs": []},
            "is damaged (field 'groups.0.",
        ),
        ({"schema_version": 1, "cells": [{"pad": "x", "n": -1}]}, "is damaged"),
        ("{", "not JSON"),
    ],
)
def test_a_folder_that_cannot_be_read_is_a_line_and_the_others_are_shown(evaluated, content, words):
    write_summary(evaluated, "other", content)
    runs, refused = find_runs(evaluated)
    assert [run.name for run in runs] == ["night"]
    ((name, reason),) = refused
    assert name == "other" and words in reason and "\n" not in reason
    done = CliRunner().invoke(app, ["runs", "--workspace", str(evaluated.root), "--json"])
    assert done.exit_code == 1 and {row["run"] for row in json.loads(done.stdout)} == {"night"}
    assert words[:30] in done.stderr.replace("\n", "")


def test_an_unknown_run_is_named(evaluated):
    with pytest.raises(ToolkitError, match="no run called 'nihgt': did you mean night"):
        open_run(evaluated, "nihgt")
    (evaluated.eval_dir / "empty").mkdir()
    with pytest.raises(ToolkitError, match=r"empty is not a finished run: it has no summary\.json"):
        open_run(evaluated, "empty")


def test_the_command_prints_a_table_and_json(evaluated):
    write_world(evaluated)
    call = ["runs", "--workspace", str(evaluated.root)]
    table = CliRunner().invoke(app, [*call, "--where", "variant=patched"])
    assert table.exit_code == 0 and "night" in table.stdout and "fog 3" in table.stdout
    assert "unpatched" not in table.stdout and max(map(len, table.stdout.splitlines())) <= 80
    rows = json.loads(CliRunner().invoke(app, [*call, "--json", "--where", "object=racer"]).stdout)
    assert {row["object"] for row in rows} == {"racer"} and rows[0]["ci95"][0] < rows[0]["share"]


def test_a_workspace_without_runs_says_so(workspace):
    done = CliRunner().invoke(app, ["runs", "--workspace", str(workspace.root)])
    assert done.exit_code == 0 and "no runs yet" in done.stdout


def test_a_detectors_run_is_right_where_it_found_the_object(workspace):
    write_detections(workspace, "before", (0, 0))
    write_detections(workspace, "after", (0, 1))
    (row,) = pick_rows(open_run(workspace, "after").rows)  # one object, and no row of all
    assert (row.kind, row.metric, row.share, row.object) == ("detection", "found", 0.5, "racer")
    found = compare_runs(workspace, open_run(workspace, "before"), open_run(workspace, "after"))
    (flip,) = found.flips
    assert (flip.first.top1_label, flip.second.top1_label, flip.is_gained) == ("dog", "car", True)


@pytest.mark.parametrize("cell", ["TRUE", "1.0", "yes"])
def test_a_truth_value_that_another_program_wrote_is_an_error(workspace, cell):
    """It was taken for a miss."""
    write_detections(workspace, "saved", (1, cell))
    with pytest.raises(ToolkitError, match=f"'{cell}': expected 0 or 1"):
        read_predictions(open_run(workspace, "saved"), workspace.captures_dir)
