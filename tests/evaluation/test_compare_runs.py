"""Two runs on the same images: pairs, the exact test, flips, and what cannot be compared."""

import json
import shutil
from math import comb

import pytest
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.compare import compare_runs, write_comparison
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.export import export_predictions
from toolkit.evaluation.summaries import open_run


@pytest.fixture
def two_runs(put, workspace, colour_classifier):
    """Runs `before` and `after`: the same eight racers of which the second run got six others right, and one wrong.

    The images are painted anew in between, so that one network answers otherwise of the same files.
    """
    names = [f"sim/racer/{variant}/{pose}.png" for variant in ("unpatched", "patched") for pose in range(1, 5)]
    for at, name in enumerate(names):
        put(name, "racer" if at < 2 else "warplane")
    evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(run="before"))
    for at, name in enumerate(names):
        put(name, "racer" if at else "warplane")
    evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(run="after"))
    return workspace


def compare(space, first="before", second="after", **options):
    return compare_runs(space, open_run(space, first), open_run(space, second), **options)


def test_images_are_paired_by_path_and_tested_exactly(two_runs):
    found = compare(two_runs)
    assert (found.pooled.both, found.pooled.only_first, found.pooled.only_second, found.pooled.neither) == (1, 1, 6, 0)
    tail = sum(comb(7, k) for k in (0, 1)) / 2**7
    assert found.pooled.mcnemar_p == pytest.approx(2 * tail)
    rows = {(row.object, row.second): row.outcomes.n for row in found.rows}
    assert rows == {("racer", "unpatched"): 4, ("all", "unpatched"): 4, ("racer", "patched"): 4, ("all", "patched"): 4,
                    ("racer", "all"): 8, ("all", "all"): 8}  # fmt: skip
    assert found.verdict == "after: 6 pairs became correct and 1 wrong: not enough to tell"
    assert [pair.is_gained for pair in found.flips] == [True] * 6 + [False]


def test_a_run_whose_pictures_were_replaced_says_so(two_runs):
    (note,) = [one for one in compare(two_runs).notes if "judged other images" in one]
    assert note.startswith("before judged other images than there are in ") and "Run 'toolkit eval' again" in note
    exported = export_predictions(two_runs, ["before", "after"], "csv")
    assert exported.replaced == (note,) and note in exported.warnings() and exported.as_json()["notes"] == [note]
    # images that are gone were not replaced
    shutil.rmtree(two_runs.captures_dir / "sim/racer/patched")
    assert not [one for one in compare(two_runs).notes if "judged other images" in one]


def test_images_that_are_gone_hide_no_replacement(two_runs):
    """A single lost image leaves unknown which the others are; the two runs' own hashes differ all the same."""
    (two_runs.captures_dir / "sim/racer/patched/4.png").unlink()
    lost = "1 of 8 images of before are gone, so it is not known whether the others are those that it judged"
    between = (
        "before and after judged different pictures under the same names: some were shot again, edited or replaced"
    )
    assert {lost, between} <= set(compare(two_runs).notes)
    assert export_predictions(two_runs, ["before"], "csv").replaced == (lost,)
    # of a run whose images are all gone, none is taken for another
    shutil.rmtree(two_runs.captures_dir / "sim")
    notes = compare(two_runs).notes
    assert between in notes and not [note for note in notes if "are gone" in note]
    assert compare(two_runs, "after", "after").notes == ()


def test_a_variant_called_as_the_pooled_rows_counts_once(two_runs, as_older):
    """New captures may not have it; runs of earlier versions may."""
    for run in ("before", "after"):
        as_older(two_runs.eval_dir / run)
        file = two_runs.eval_dir / run / "predictions.csv"
        file.write_text(file.read_text().replace(",patched,", ",all,"))
    found = compare(two_runs)
    assert len(found.pairs) == found.pooled.n == 8
    assert {(row.object, row.second): row.outcomes.n for row in found.rows} == {
        ("racer", "unpatched"): 4, ("all", "unpatched"): 4, ("racer", "all"): 8, ("all", "all"): 8
    }  # fmt: skip


def test_turned_round_gained_is_lost(two_runs):
    there, back = compare(two_runs), compare(two_runs, "after", "before")
    assert back.pooled.only_first == there.pooled.only_second and back.pooled.mcnemar_p == there.pooled.mcnemar_p
    assert back.pooled.gain == pytest.approx(-there.pooled.gain)


def test_a_clear_result_names_the_better_run(two_runs, as_older):
    as_older(two_runs.eval_dir / "before")
    file = two_runs.eval_dir / "before" / "predictions.csv"
    lines = [line.replace(",1,1,1,ok", ",2,0,1,ok") for line in file.read_text().splitlines()]
    file.write_text("\n".join(lines) + "\n")
    found = compare(two_runs)
    assert (found.pooled.only_first, found.pooled.only_second) == (0, 7) and found.pooled.mcnemar_p == 2 / 2**7
    assert found.verdict == "after is correct more often"


def test_copies_elsewhere_are_paired_by_their_bytes(put, workspace, colour_classifier):
    from PIL import Image

    for pose in range(1, 4):
        file = put(f"sim/racer/unpatched/{pose}.png", "racer")
        Image.open(file).rotate(0).resize((64 + pose, 48)).save(file)  # each has bytes of its own
        copy = workspace.captures_dir / f"copied/racer/unpatched/{9 - pose}.png"
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, copy)
    put("copied/racer/unpatched/1.png", "warplane")  # of no image of sim
    for source in ("sim", "copied"):
        config = EvalConfig(run=source, sources=(source,))
        evaluate_captures(workspace.captures_dir, workspace, colour_classifier, config)
    found = compare(workspace, "sim", "copied")
    assert [(pair.first.capture.pose_id, pair.second.capture.pose_id) for pair in found.pairs] == [
        (1, 8),
        (2, 7),
        (3, 6),
    ]
    assert found.unshared == (0, 1)


def test_runs_that_share_no_image_are_refused_in_a_line(put, workspace, colour_classifier):
    put("sim/racer/unpatched/1.png", "racer")
    put("real/racer/unpatched/1.png", "warplane")
    for source in ("sim", "real"):
        config = EvalConfig(run=source, sources=(source,))
        evaluate_captures(workspace.captures_dir, workspace, colour_classifier, config)
    done = CliRunner().invoke(app, ["compare", "sim", "real", "--workspace", str(workspace.root)])
    assert "sim and real share no image" in str(done.exception)
    assert not (workspace.eval_dir / "comparisons").exists()


def test_the_same_fog_of_other_images_is_not_paired_by_its_file(put, workspace, colour_classifier):
    """A corrupted image has the file of the one that it was made of, and is another image."""
    put("sim/racer/unpatched/1.png", "racer")
    evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(run="clear"))
    config = EvalConfig(run="fog", corruptions=(("fog", 3),))
    evaluate_captures(workspace.captures_dir, workspace, colour_classifier, config)
    found = compare(workspace, "clear", "fog")
    assert [pair.second.capture.source for pair in found.pairs] == ["sim"] and found.unshared == (0, 1)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda text: text.replace("true_rank", "place"), "no column 'true_rank'"),
        (lambda text: text.replace(",ok", ",ok").replace("0.", "nought."), "is damaged"),
        (lambda text: text.replace("sim/racer", "../../racer", 1), "leaves its folder"),
        (lambda text: text + "\xff\x00", "is damaged"),
        (lambda text: text + 'sim,"racer', "is damaged"),
    ],
)
def test_damaged_predictions_are_a_line(two_runs, as_older, damage, words):
    as_older(two_runs.eval_dir / "after")
    file = two_runs.eval_dir / "after" / "predictions.csv"
    file.write_text(damage(file.read_text()), encoding="latin-1")
    with pytest.raises(ToolkitError, match=words) as refused:
        compare(two_runs)
    assert "\n" not in str(refused.value)


def test_a_run_without_predictions_is_refused(two_runs):
    (two_runs.eval_dir / "after" / "predictions.csv").unlink()
    with pytest.raises(ToolkitError, match=r"after holds no predictions\.csv: a run of kind 'eval'"):
        compare(two_runs)


def test_the_command_prints_writes_a_page_and_json(two_runs):
    call = ["compare", "before", "after", "--workspace", str(two_runs.root)]
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 0 and "not enough to tell" in done.stdout
    page = two_runs.eval_dir / "comparisons" / "before-vs-after.html"
    text = page.read_text()
    assert text.count("data:image/jpeg") == 7 and "http" not in text.replace("http-equiv", "")
    content = json.loads(CliRunner().invoke(app, [*call, "--json"]).stdout)
    assert content["rows"][-1]["only_second"] == 6 and len(content["flips"]) == 7
    assert content["flips"][0]["first_says"] == "warplane" and content["flips"][0]["second_says"] == "racer"


def test_names_are_escaped_and_images_may_be_gone(two_runs, tmp_path):
    bad = two_runs.eval_dir / "<b>x"
    (two_runs.eval_dir / "after").rename(bad)
    shutil.rmtree(two_runs.captures_dir)
    text = write_comparison(tmp_path / "page.html", compare(two_runs, "before", "<b>x")).read_text()
    assert "<b>x" not in text and "&lt;b&gt;x" in text and "the image is gone" in text


WORLD_COLUMNS = (
    "source,object,variant,pose_id,path,true_index,true_label,top1_index,top1_label,top1_prob,true_prob,true_rank,"
    "correct_top1,correct_top5,status,world,place,weather,severity"
)


def write_world_run(space, name, sky, right):
    """A run of a world: one camera at each of two places, clear and in fog; `right` says of which it is right."""
    share = {"n": 2, "failed": 0, "top1": 0.5, "top1_ci95": [0.1, 0.9]}
    group = {"source": "sim", "object": "racer", "variant": "unpatched", "world": "city/0", "place": "all"}
    content = {"schema_version": 1, "model": {"name": "net"}, "groups": [group | share | {"weather": "clear"}]}
    folder = space.eval_dir / name
    folder.mkdir(parents=True)
    about = {"world_sha256": "ab", "sky": sky, "camera": {"width": 224}}
    (folder / "summary.json").write_text(json.dumps(content | {"pairs": [], "about": about}))
    (folder / "cameras.csv").write_text("place,pose_id\nkerb,1\nlane,1\n")
    lines = []
    for variant in ("unpatched", "patched"):
        for place in ("kerb", "lane"):
            for weather, severity in (("clear", 0), ("fog", 3)):
                rank = 1 if (variant, place, weather) in right else 2
                path = f"{place}/{variant}/0001/{weather}-{severity}.png"
                head = f"sim,racer,{variant},1,{path},0,racer,{rank - 1},says,0.6,0.5,{rank},{int(rank == 1)},1,ok"
                lines.append(f"{head},city/0,{place},{weather},{severity}")
    (folder / "predictions.csv").write_text("\n".join([WORLD_COLUMNS, *lines]) + "\n")


def test_worlds_are_paired_by_camera_place_and_weather(workspace):
    fog = {("patched", "kerb", "fog"), ("patched", "lane", "clear")}
    write_world_run(workspace, "one", "noon", fog)
    write_world_run(workspace, "other", "noon", fog | {("unpatched", "lane", "fog")})
    write_world_run(workspace, "dusk", "dusk", fog)
    found = compare(workspace, "one", "other")
    assert found.pooled.n == 8 and [pair.second.capture.path for pair in found.flips] == [
        "lane/unpatched/0001/fog-3.png"
    ]
    with pytest.raises(ToolkitError, match="share no image"):
        compare(workspace, "one", "dusk")
    done = CliRunner().invoke(app, ["report", "--all", "--workspace", str(workspace.root)])
    assert done.exit_code == 0
    text = (workspace.eval_dir / "index.html").read_text()
    # bare and boosted from one camera, at one place, in one weather: two gained in each run, and one lost in `other`
    assert text.count('data-condition="fog"') == 4 and text.count("<article") == 7
