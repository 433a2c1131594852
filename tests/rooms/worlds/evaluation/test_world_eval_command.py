"""`toolkit world-eval` as typed: what it says, and what it refuses in one line."""

import json

import pytest
from typer.testing import CliRunner
from walled_field import make_onlooker, stand_in

from toolkit.cli import app
from toolkit.core.errors import ToolkitError


@pytest.fixture
def type_command(tmp_path, monkeypatch, make_crate_space):
    """A function (words) -> the result."""
    space = make_crate_space(tmp_path)
    monkeypatch.setattr("toolkit.models.load.load_classifier", lambda *args, **kwargs: make_onlooker())

    def run(*words):
        given = ["world-eval", "--object", "crate", *map(str, words), "--workspace", str(space.root)]
        return CliRunner().invoke(app, given)

    run.space = space
    return run


def test_it_says_what_was_found(type_command, monkeypatch) -> None:
    stand_in(monkeypatch)
    words = ("--variant", "unpatched", "--variant", "patched", "--places", 2, "--grid", "3x3x2", "--length-m", 4)
    result = type_command(*words, "--weather", "fog:1-2", "--sample", 5)
    assert result.exit_code == 0, result.output
    assert "fog:2  visibility 70 m, extinction 42.8 /km" in result.output
    assert "36 points of the grid" in result.output and "inside a building" in result.output
    assert "In clear air onlooker has the crate among its first five guesses on" in result.output
    assert "60 answers; table, figures and report:" in result.output
    assert (type_command.space.eval_dir / "world-city-crate-onlooker" / "report.html").is_file()
    again = type_command(*words, "--weather", "fog:1-2", "--sample", 5, "--json")
    assert json.loads(again.stdout)["about"]["grid"]["sample"] == 5


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--world", "ctiy"), "no world called 'ctiy': did you mean city"),
        (("--world", "nowhere.glb"), "nowhere.glb"),
        (("--world", "grass", "--world-scale", "2"), "--world-scale 2: the world grass is in metres"),
        (("--weather", "fgo:1"), "no weather called 'fgo': did you mean fog"),
        (("--weather", "fog:6"), "severity '6': expected one of 1 (slight) to 5 (severe)"),
        (("--grid", "10x10"), "--grid 10x10: expected cameras along, across and up"),
        (("--grid", "0x1x1"), "--grid 0x1x1: expected cameras"),
        (("--grid", "999x999x2"), "--grid 999x999x2: expected at most 1,000,000 cameras"),
        (("--variant", "patch-alone"), "shows a patch on a table without its object"),
        (("--variant", "textred"), "no variant called 'textred'"),
        (("--time", "night"), "no time of day called 'night'"),
        (("--run", "../up"), "--run ../up: expected letters"),
        (("--places", "0"), "--places 0"),
        (("--on", "moon"), "--on moon"),
        (("--on", "water"), "has no free place for an object"),
        (("--extent", "0.1"), "--extent 0.1"),
        (("--length-m", "-3"), "--length-m -3"),
        (("--sample", "0"), "--sample 0"),
        (("--renderer", "unreal://host"), "--renderer unreal://host: expected raycast or airsim://HOST"),
        (("--renderer", "airsim://"), "--renderer airsim://: expected raycast or airsim://HOST"),
        (("--renderer", "airsim://127.0.0.1:9", "--time", "dusk"), "--time dusk: goes with --renderer raycast"),
        (("--renderer", "airsim://127.0.0.1:9", "--engine", "ray"), "--engine ray: expected local with a simulator"),
    ],
)
def test_what_cannot_be_meant_is_one_line(type_command, words, said) -> None:
    result = type_command("--world", "grass", "--variant", "unpatched", *words)
    assert isinstance(result.exception, ToolkitError | SystemExit), result.output
    text = str(result.exception) + result.output
    assert said in text
    assert not (type_command.space.eval_dir / "worlds").exists()


def test_a_missing_booster_says_how_to_get_one(type_command) -> None:
    result = type_command("--variant", "textured")
    assert "no texture for object 'crate': run 'toolkit train-texture" in str(result.exception)
