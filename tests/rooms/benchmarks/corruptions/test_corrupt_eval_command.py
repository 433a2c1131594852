"""`toolkit train-patches` and `toolkit corrupt-eval` as typed: what they say, write and refuse."""

import json
import re

import pytest
from hue_network import make_hue_classifier, write_photos, write_set
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.objects.records import read_patch


@pytest.fixture
def type_command(tmp_path, monkeypatch):
    """A function (words) -> the result; the classifier is the one that sees hues."""
    space = make_workspace(tmp_path / "space")
    monkeypatch.setattr("toolkit.models.load.load_classifier", lambda *args, **kwargs: make_hue_classifier())

    def run(*words):
        return CliRunner().invoke(app, [*map(str, words), "--workspace", str(space.root)])

    run.space, run.data = space, write_photos(tmp_path / "data")
    return run


def refuse(type_command, *words) -> str:
    result = type_command(*words)
    assert isinstance(result.exception, ToolkitError), result.output  # `main` makes one line and exit code 2 of it
    return str(result.exception)


@pytest.mark.slow
def test_from_training_to_the_report(type_command):
    trained = type_command(
        "train-patches", "--data", type_command.data, "--size-px", 16, "--size-px", 20, "--steps", 4, "--batch", 4,
        "--smoothing", 3, "--last-smoothing", 1, "--corrupt", "noise",
    )  # fmt: skip
    assert trained.exit_code == 0, trained.output
    assert "3 classes, 6 patches" in trained.output
    settings = read_patch(type_command.space.root / "print/patches/patches-16/red.png").record.settings
    assert (settings["smoothing_px"], settings["last_smoothing_px"]) == (3, 1) and settings["corrupted"]
    next_command = re.search(r"next: toolkit (corrupt-eval .*)", trained.output)[1].split()
    done = type_command(*next_command, "--corrupt", "fog:1-2", "--run", "mine")
    assert done.exit_code == 0, done.output
    assert "hue recognises" in done.output and f"{9 * 3 * 3} answers" in done.output
    folder = type_command.space.eval_dir / "corruptions" / "mine"
    assert (folder / "report.html").is_file() and (folder / "cells.csv").is_file()
    again = type_command(*next_command, "--corrupt", "fog:1-2", "--run", "mine", "--json")
    summary = json.loads(again.stdout)
    assert {row["variant"] for row in summary["variants"]} == {"unpatched", "patches-16", "patches-20"}
    assert summary["n"] == 9


@pytest.mark.slow
def test_a_partly_bad_folder_is_evaluated_and_the_bad_part_listed(type_command):
    write_set(type_command.space)
    (type_command.data / "red" / "0.png").write_bytes(b"no picture")
    for file in (type_command.data / "blue").iterdir():
        file.unlink()
    result = type_command("corrupt-eval", "--data", type_command.data, "--patches", "paint-16", "--corrupt", "fog:1")
    assert result.exit_code == 1
    assert "skipped red/0.png: not an image" in result.output
    assert "skipped 1 patches of paint-16: no images of blue; choose classes with --class" in result.output
    named = type_command(
        "corrupt-eval", "--data", type_command.data, "--patches", "paint-16", "--corrupt", "fog:1", "--class", "green"
    )
    assert named.exit_code == 0, named.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--corrupt", "fgo:3"), "no corruption called 'fgo': did you mean fog"),
        (("--corrupt", "fog:6"), "severity '6': expected one of 1 (slight) to 5 (severe)"),
        (("--patches", "none"), "no set of patches called 'none'"),
        (("--class", "mauve"), "no class called 'mauve'"),
        (("--run", "../up"), "--run ../up: expected letters"),
        (("--max-rotation", "400"), "--max-rotation 400"),
    ],
)
def test_what_cannot_be_done_is_one_line(type_command, words, said):
    assert said in refuse(type_command, "corrupt-eval", "--data", type_command.data, *words)


def test_labels_that_are_not_the_classifiers_are_one_line(type_command, tmp_path):
    other = write_photos(tmp_path / "other", 1, ["red", "mauve"])
    assert "'mauve' is not a class of hue" in refuse(type_command, "corrupt-eval", "--data", other)


def test_a_patch_larger_than_the_image_is_one_line(type_command):
    said = refuse(type_command, "train-patches", "--data", type_command.data, "--size-px", 33)
    assert "--size-px 33: expected 8 to 32" in said
