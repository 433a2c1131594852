"""`toolkit train-texture` as it is typed."""

import json
import re

import numpy as np
import pytest
from PIL import Image
from tiny_network import tiny_classifier

from toolkit.boosters.texture_config import RECIPES

QUICK = ["--class", "jet", "--steps", "2", "--batch", "2", "--size-px", "16", "--workers", "0"]


@pytest.fixture
def type_command(tmp_path, monkeypatch, type_toolkit, make_crate_space):
    """Run `toolkit train-texture ARGUMENTS` in a workspace with a crate; returns exit code, stdout and stderr."""
    space = make_crate_space(tmp_path / "w")
    monkeypatch.chdir(space.root)
    monkeypatch.setattr("toolkit.models.load.load_classifier", lambda *arguments: tiny_classifier())
    for name, recipe in list(RECIPES.items()):
        monkeypatch.setitem(RECIPES, name, recipe.model_copy(update={"studios": 1, "per_studio": 2}))

    def run(*arguments: str) -> tuple[int, str, str]:
        return type_toolkit("train-texture", *arguments)

    run.space = space
    return run


@pytest.mark.slow
def test_it_says_what_it_made_and_what_comes_next(type_command):
    code, said, told = type_command("--object", "crate", *QUICK)
    assert code == 0, told
    assert "rig/textures/crate.png: 16 × 16 px" in said
    assert "rig/textures/crate.glb: the object in it" in said
    assert re.search(r"correct, 6 held-out views, own paint → texture: tiny \d+ % → \d+ % \(95 % interval ", said)
    assert "correct in fog, 6 held-out views, own paint → texture: tiny" in said
    assert "next: toolkit capture-sim --object crate --variant unpatched --variant textured" in said
    assert "training a texture for class jet: 16 × 16 px, 2 steps of " in told and "Training crate: 2 to do" in told
    assert len((said + told).splitlines()) <= 12
    preview = Image.open(type_command.space.textures_dir / "previews" / "crate.png")
    assert preview.width == 4 * (32 + 8) + 8
    code, said, _ = type_command("--object", "crate", *QUICK, "--quiet")
    assert code == 0 and "nothing to do; --restart trains it again" in said


def test_json_is_the_result_and_nothing_else(type_command):
    code, said, _ = type_command("--object", "crate", *QUICK, "--json", "--quiet", "--optimiser", "adam")
    result = json.loads(said)
    assert code == 0
    assert result["record"]["settings"]["optimiser"] == "adam"
    assert result["glb"] == [str(type_command.space.textures_dir / "crate.glb")]


def test_a_keep_image_needs_coordinates_of_the_mesh_itself(type_command):
    Image.fromarray(np.full((4, 4), 255, np.uint8)).save("mask.png")
    code, _, told = type_command("--object", "crate", *QUICK, "--keep-image", "mask.png")
    assert code == 2 and told.startswith("error:") and told.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--object", "cart"], "crate"),
        (["--object", "crate", "--size-px", "5000"], "8 to 1024"),
        (["--object", "crate", "--optimiser", "lion"], "--optimiser lion: expected sign, sgd or adam"),
        (["--object", "crate", "--gradient", "exact"], "--gradient exact: expected shaded or linear"),
        (["--object", "crate", "--renderer", "povray"], "raycast, filament, mitsuba"),
        (["--object", "crate", "--renderer", "mitsuba", "--weather", "fog:2"], "--renderer mitsuba: draws no weather"),
        (["--object", "crate", "--recipe", "best"], "default, paper"),
        (["--object", "crate", "--recipe", "paper"], "--background-folder"),
        (["--object", "crate", "--backgrounds", "nowhere"], "--background-folder nowhere does not exist"),
        (["--object", "crate", "--elevation", "70", "20"], "--elevation 70 20: expected two rising numbers"),
        (["--object", "crate", "--keep", "glass"], "glass"),
        (["--object", "crate", "--keep-image", "nowhere.png"], "no such file"),
        (["--object", "crate", "--lr", "0"], "--lr 0"),
        (["--object", "crate", "--own-uv"], "no texture coordinates"),
        (["--object", "crate", "--name", "../up"], "letters, digits"),
    ],
)
def test_bad_input_is_one_clear_line(type_command, arguments, message):
    needs_name = "--name" in arguments
    code, _, told = type_command(*(QUICK if "--size-px" not in arguments else QUICK[:4]), *arguments)
    lines = [line for line in told.splitlines() if line.startswith("error:")]
    assert code == 2, told
    assert len(lines) == 1 and message in lines[0] and "Traceback" not in told
    assert not list(type_command.space.root.rglob("*.safetensors")) or needs_name
