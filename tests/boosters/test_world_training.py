"""Training in a world as it is typed: what is made and recorded, and what is refused in one line."""

import json

import numpy as np
import pytest
import trimesh
from PIL import Image
from tiny_network import tiny_classifier

from toolkit.boosters import patch_config, texture_config

SPOTS = ["--world", "yard.glb", "--quiet"]
TEXTURE = ["train-texture", "--object", "crate", "--class", "jet", "--steps", "2", "--batch", "2", "--size-px", "16"]
PATCH = [
    "train-patch", "--object", "crate", "--class", "jet", "--steps", "2", "--batch", "2", "--size-px", "16",
    "--images", "2", "--mounted-views", "5",
]  # fmt: skip
LENGTH_M = 5.0


def write_yard(file, extents=(60, 50, 1)) -> None:
    """A slab of one paint, z up as OBJ and PLY have it, turned for glTF."""
    slab = trimesh.creation.box(extents)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.new("RGB", (8, 8), (120, 140, 90)))
    slab.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(slab.vertices), 2)), material=material)
    slab.apply_transform(np.array([[0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]], float))
    slab.export(file)


@pytest.fixture
def type_command(tmp_path, monkeypatch, type_toolkit, make_crate_space):
    """Run `toolkit ARGUMENTS` in a workspace with a crate of 5 m and a yard; returns exit code, stdout and stderr."""
    space = make_crate_space(tmp_path / "w")
    spec = space.objects_dir / "crate.toml"
    spec.write_text(spec.read_text().replace("[patch]", f"world_length_m = {LENGTH_M}\n[patch]"))
    monkeypatch.chdir(space.root)
    monkeypatch.setattr("toolkit.models.load.load_classifier", lambda *arguments: tiny_classifier())
    for name, recipe in list(texture_config.RECIPES.items()):
        less = {"studios": 1, "per_studio": 2, "held_out": 1}
        monkeypatch.setitem(texture_config.RECIPES, name, recipe.model_copy(update=less))
    write_yard(space.root / "yard.glb")

    type_toolkit.space = space
    return type_toolkit


def test_a_texture_of_a_world_in_weather(type_command):
    code, said, told = type_command(
        *TEXTURE, *SPOTS[:2], "--weather", "fog:4", "--time", "overcast", "--workers", "0", "--verbose"
    )
    assert code == 0, told
    assert "yard 1, overcast/1; on " in told and "held out: " in told
    assert "visibility 20 m" in told
    assert "correct in its weather" in said
    record = json.loads((type_command.space.textures_dir / "crate.json").read_text())
    seen = record["data"]["views"]["world"]
    assert (seen["name"], seen["seed"], seen["skies"]) == ("yard", 1, ["overcast/1"])
    assert len(seen["sha256"]) == 64 and not set(seen["places"]) & set(seen["held_out_places"])
    assert record["settings"]["world"] == "yard.glb" and record["settings"]["background_share"] == 0
    assert record["settings"]["views"]["ranges"]["elevation_deg"] == [2, 75]
    code, said, _ = type_command(*TEXTURE, *SPOTS, "--weather", "fog:4", "--time", "overcast", "--workers", "0")
    assert code == 0 and "nothing to do; --restart trains it again" in said
    write_yard(type_command.space.root / "yard.glb", (60, 48, 1))
    code, said, _ = type_command(*TEXTURE, *SPOTS, "--weather", "fog:4", "--time", "overcast", "--workers", "0")
    assert code == 0 and "nothing to do" not in said  # another world


def test_a_patch_of_a_world_in_weather(type_command):
    code, said, told = type_command(*PATCH, *SPOTS[:2], "--weather", "dust:3", "--weather", "rain:5")
    assert code == 0, told
    assert "world: yard 1, noon/1; on " in told
    assert "correct in its weather" in said
    record = json.loads((type_command.space.patches_dir / "crate.json").read_text())
    assert record["data"]["world"]["name"] == "yard"
    assert record["size_mm"] == 40  # on the model; on the crate of 5 m it is 2 m
    assert record["settings"]["mounted_fill"] == [0.3, 1.0]


@pytest.mark.parametrize("command", [TEXTURE, PATCH])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--weather", "hail:3"], "no weather called 'hail': known: clear, fog"),
        (["--weather", "fog:7"], "severity '7': expected one of 1 (slight) to 5 (severe)"),
        (["--world", "citty"], "world"),
        (["--world", "nowhere.glb"], "nowhere.glb"),
        (["--world", "yard.glb", "--time", "midnight"], "midnight"),
        (["--world", "yard.glb", "--world-scale", "0"], "--world-scale 0: expected above 0"),
        (["--world", "yard.glb", "--world-scale", "0.05"], "yard"),
        (["--world", "grass", "--world-scale", "2"], "in metres"),
        (["--world", "yard.glb", "--world-seed", "-1"], "--world-seed -1: expected at least 0"),
    ],
)
def test_bad_input_is_one_clear_line(type_command, command, arguments, message):
    code, _, told = type_command(*command, "--quiet", *arguments)
    lines = told.splitlines()
    assert code == 2, told
    assert len(lines) == 1 and lines[0].startswith("error:") and message in lines[0]


def test_a_world_needs_the_object_and_its_real_size(type_command):
    code, _, told = type_command(*PATCH, *SPOTS, "--mounted-share", "0")
    assert code == 2 and "--weather and --world need the object itself: add --data rig, --mounted-share above 0" in told
    code, _, told = type_command(*TEXTURE, *SPOTS, "--background-folder", "photos")
    assert code == 2 and "--world yard.glb: stands behind the object already: leave --background-folder out" in told
    spec = type_command.space.objects_dir / "crate.toml"
    spec.write_text(spec.read_text().replace(f"world_length_m = {LENGTH_M}", "world_length_m = 70"))
    for command in (TEXTURE, PATCH):
        code, _, told = type_command(*command, *SPOTS)
        assert code == 2 and "yard has no place for an object that reaches" in told and told.count("\n") == 1
    spec.write_text(spec.read_text().replace("world_length_m = 70\n", ""))
    for command in (TEXTURE, PATCH):
        for asked in (SPOTS, ["--weather", "fog", "--quiet"]):
            code, _, told = type_command(*command, *asked)
            assert code == 2 and "crate' has no real size, which weather and worlds need: add world_length_m" in told


def test_a_recipe_in_a_world_has_its_ranges_unless_others_are_asked_for():
    made = texture_config.make_config("paper", {"objects": ("crate",), "world": "city"})
    assert (made.elevation_deg, made.fill, made.background_share) == ((2.0, 75.0), (0.3, 1.0), 0.0)
    made = texture_config.make_config("default", {"objects": ("crate",), "world": "city", "fill": (0.3, 0.5)})
    assert made.fill == (0.3, 0.5)
    assert "world" not in texture_config.make_config("default", {"objects": ("crate",)}).record()
    data = patch_config.DataConfig(sources=("rig:crate",))
    assert patch_config.make_config("default", {"world": "city"}, data).mounted_fill == (0.3, 1.0)
    assert patch_config.make_config("default", {}, data).mounted_fill == (0.2, 0.95)
