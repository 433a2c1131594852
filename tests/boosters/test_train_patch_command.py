"""`toolkit train-patch` as it is typed."""

import json
import sys

import pytest
from tiny_network import tiny_classifier, write_photos

from toolkit.cli import main

QUICK = ["--steps", "3", "--batch", "2", "--size-px", "16", "--quiet"]


@pytest.fixture
def type_command(tmp_path, monkeypatch, capsys):
    """Run `toolkit train-patch ARGUMENTS` in an empty folder; returns exit code, stdout and stderr."""
    loaded = []

    def load_tiny(arch, weights, device, quiet):
        loaded.append((arch, weights))
        return tiny_classifier()

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("toolkit.classifiers.network.load_classifier", load_tiny)

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["toolkit", "train-patch", *arguments])
        with pytest.raises(SystemExit) as stopped:
            main()
        return (int(stopped.value.code or 0), *capsys.readouterr())

    run.loaded = loaded
    return run


def test_it_says_what_it_made_and_what_comes_next(type_command, tmp_path):
    write_photos(tmp_path / "photos", 6)
    code, said, told = type_command("--class", "jet", "--data", "photos", *QUICK[:-1])
    assert code == 0, told
    assert type_command.loaded == [("resnet18", None)]
    assert "print/patches/jet.png: 16 px, 14 mm on paper at 250 %" in said
    assert "tiny on held-out images:" in said
    assert "n = 128" in said
    assert "next: toolkit print --class jet" in said
    assert "as backgrounds, whatever they show" in told
    assert "Training jet: 3 to do" in told
    code, said, _ = type_command("--class", "jet", "--data", "photos", *QUICK)
    assert code == 0
    assert "nothing to do; --restart trains it again" in said


def test_json_is_the_result_and_nothing_else(type_command, tmp_path):
    write_photos(tmp_path / "photos", 6)
    code, said, _ = type_command("--class", "3", "--data", "photos", "--json", *QUICK)
    result = json.loads(said)
    assert code == 0
    assert result["record"]["class_name"] == "jet"
    assert result["skipped"] == []
    assert (tmp_path / "print/previews/jet.png").samefile(result["preview"])


def test_bad_images_are_listed_and_the_exit_code_says_so(type_command, tmp_path):
    folder = write_photos(tmp_path / "photos", 6)
    (folder / "photo_03.png").write_bytes((folder / "photo_03.png").read_bytes()[:80])
    code, said, told = type_command("--class", "jet", "--data", "photos", *QUICK)
    assert code == 1
    assert "skipped photos/photo_03.png: truncated" in told
    assert "jet.png" in said, "the good part is done"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--class", "jett", "--data", "photos"], "no class called 'jett': did you mean jet"),
        (["--class", "jet", "--data", "nowhere", "--size-px", "16"], "--data nowhere does not exist"),
        (["--class", "jet", "--data", "photos", "--size-px", "400"], "--size-px 400: expected 8 to 32"),
        (["--class", "jet", "--data", "photos", "--share", "0.5", "0.2"], "share range 0.5 to 0.2"),
        (["--class", "jet", "--data", "photos", "--schedule", "cos"], "no schedule called 'cos'"),
        (
            ["--class", "jet", "--data", "photos", "--weights", "a.pth", "--weights", "b.pth"],
            "1 --model and 2 --weights",
        ),
        (["--class", "jet", "--data", "photos", "--workspace", "photos"], "photos is no workspace"),
        (["--class", "jet", "--data", "rig", "--size-px", "16"], "no object has the class jet"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(type_command, tmp_path, arguments, words):
    write_photos(tmp_path / "photos", 2)
    code, said, told = type_command(*arguments)
    assert code == 2
    assert words in told
    assert told.count("\n") == 1
    assert said == ""


def test_models_and_weights_go_together(type_command, tmp_path):
    write_photos(tmp_path / "photos", 4)
    networks = ["--model", "resnet18", "--weights", "a.pth", "--model", "mobilenet_v2", "--weights", "b.pth"]
    code, _, told = type_command("--class", "jet", "--data", "photos", *networks, *QUICK)
    assert code == 0, told
    assert [(arch, str(file)) for arch, file in type_command.loaded] == [
        ("resnet18", "a.pth"),
        ("mobilenet_v2", "b.pth"),
    ]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--data", "photos", "--mounted-share", "0.5"], "needs the object in the rig: add --data rig"),
        (["--data", "photos", "--mounted-share", "1.5"], "--mounted-share 1.5: expected 0 to 1"),
        (["--data", "photos", "--mounted-views", "1"], "--mounted-views 1: expected at least 2"),
    ],
)
def test_mounted_views_that_cannot_be_had(type_command, tmp_path, arguments, told):
    write_photos(tmp_path / "photos", 6)
    code, _, said = type_command("--class", "jet", *arguments, *QUICK)
    assert code == 2
    assert told in said
    assert len(said.strip().splitlines()) == 1
