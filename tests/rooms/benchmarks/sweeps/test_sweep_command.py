"""`toolkit sweep` on the command line: what it prints and its exit codes."""

import json

import pytest


@pytest.fixture
def run(space, redness, monkeypatch, type_toolkit):
    """A function (arguments) -> exit code, stdout, stderr of `toolkit sweep ...`."""
    monkeypatch.setattr("toolkit.models.load.load_classifier", lambda *_, **__: redness)
    monkeypatch.setenv("COLUMNS", "200")
    return lambda *arguments: type_toolkit("sweep", *arguments, "--workspace", space.root)


@pytest.mark.slow
def test_table_and_files_are_named(run):
    code, out, err = run("size", "--object", "crate", "--values", "40")
    assert code == 0 and "shooting: 4 to do" in err  # images, not values
    assert "40mm (40 %)" in out and "unpatched" in out
    assert "4 images shot, 0 kept; 4 classified" in out
    assert "sweep-redness.csv" in out and "sweep-redness.png" in out and "report.html" in out


def test_a_part_that_is_not_possible_is_exit_code_1_and_json_says_why(run):
    code, out, _ = run("size", "--values", "40,70", "--variant", "patched", "--json")
    content = json.loads(out)
    assert code == 1 and content["skipped"][0]["label"] == "70mm"
    code, _, err = run("size", "--values", "40,70", "--variant", "patched", "--quiet")
    assert code == 1 and "1 not possible:" in err and "70mm: crate: a patch of 70 mm is over half" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["ligth"], "error: no axis called 'ligth': did you mean light?"),
        (["light", "--values", "dimm"], "error: no light called 'dimm': did you mean dim?"),
        (["size", "--values", "big"], "error: --values big: expected the printed side of the patch in mm"),
        (["light", "--variant", "patchd"], "error: no variant called 'patchd': did you mean patched"),
        (["light", "--object", "crat"], "error: no object called 'crat': did you mean crate?"),
        (["light", "--run", "a/b"], "error: --run a/b: expected letters, digits"),
    ],
)
def test_mistakes_are_one_line_and_exit_code_2(run, space, arguments, words):
    code, _, err = run(*arguments)
    assert code == 2 and err.startswith(words) and len(err.strip().splitlines()) == 1
    assert not (space.eval_dir / "sweeps").exists()
