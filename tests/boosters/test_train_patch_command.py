"""`toolkit train-patch` as it is typed."""

import json
import re
from dataclasses import replace

import pytest
from tiny_network import tiny_classifier, write_photos

QUICK = ["--steps", "3", "--batch", "2", "--size-px", "16", "--quiet"]


@pytest.fixture
def type_command(tmp_path, monkeypatch, type_toolkit):
    """Run `toolkit train-patch ARGUMENTS` in an empty folder; returns exit code, stdout and stderr."""
    loaded = []

    def load_tiny(arch, weights, device, folder):
        loaded.append((arch, weights))
        return replace(tiny_classifier(), name=arch or "tiny")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("toolkit.models.load.load_classifier", load_tiny)

    def run(*arguments: str) -> tuple[int, str, str]:
        return type_toolkit("train-patch", *arguments)

    run.loaded = loaded
    return run


@pytest.mark.slow
def test_it_says_what_it_made_and_what_comes_next(type_command, tmp_path):
    write_photos(tmp_path / "photos", 6)
    code, said, told = type_command("--class", "jet", "--data", "photos", *QUICK[:-1])
    assert code == 0, told
    assert type_command.loaded == [(None, None)], "the default network is the loader's choice"
    assert re.search(r"print/patches/jet.png: 16 px, 14 mm on paper; preview: .*print/previews/jet.png\n", said)
    assert re.search(
        r"correct, pasted flat, 128 placements in held-out images, without → with the patch: tiny \d", said
    )
    assert "next: toolkit print --patch-file" in said and "jet.png" in said
    assert "as backgrounds, whatever they show" in told
    assert "Training jet: 3 to do" in told
    assert "\nrecipe: default\n" in told
    assert "training a patch for class jet: 16 × 16 px, 3 steps of 2 images, on tiny\n" in told
    assert len((said + told).splitlines()) <= 12, "it fits the first screen"
    assert "quality 40 to 95" not in told
    code, said, _ = type_command("--class", "jet", "--data", "photos", *QUICK)
    assert code == 0
    assert "nothing to do; --restart trains it again" in said
    code, _, told = type_command("--class", "jet", "--data", "photos", *QUICK[:-1], "--restart", "--verbose")
    assert code == 0 and "quality 40 to 95, probability 0.3" in told, "every setting"


@pytest.mark.slow
def test_corrupted_photographs_are_answered_apart(type_command, tmp_path):
    write_photos(tmp_path / "photos", 6)
    code, said, told = type_command("--class", "jet", "--data", "photos", "--corrupt", "blur:5", *QUICK)
    assert code == 0, told
    assert re.search(
        r"pasted flat, 128 .*\ncorrect with corruptions, 128 placements, without → with the patch: tiny ", said
    )


@pytest.mark.slow
@pytest.mark.parametrize(("share", "fill"), [(0, (0.2, 0.95)), (0, (0.6, 0.95)), (1, (0.2, 0.95))])
def test_a_patch_that_gains_nothing_on_its_object_is_not_printed_unwarned(
    type_command, make_crate_space, tmp_path, monkeypatch, share, fill
):
    make_crate_space(tmp_path / "w")
    monkeypatch.setattr("toolkit.boosters.pixels.Target.count_hits", lambda self, photos: share * len(photos))
    few = ["--mounted-views", "5", "--images", "5", "--workspace", "w", "--mounted-fill", *map(str, fill)]
    code, said, told = type_command("--object", "crate", "--class", "jet", *few, *QUICK[:-1])
    assert code == 0, told
    assert "correct on the object, 1 held-out views, grey paper → patch: tiny" in said and "pasted flat" not in said
    assert re.search(r"before training, with grey paper on the object: tiny \d of 1 ", told)
    assert len([line for line in (said + told).splitlines() if not line.startswith("note:")]) <= 12
    assert ("without a patch the object is never recognised" in told) == (share == 0)
    assert ("not shown to do better than grey paper" in told) == (share == 0)
    assert ("--mounted-fill 0.6 0.95" in told) == (share == 0 and fill[0] < 0.6)


@pytest.mark.slow
def test_json_is_the_result_and_nothing_else(type_command, tmp_path):
    write_photos(tmp_path / "photos", 6)
    code, said, _ = type_command("--class", "3", "--data", "photos", "--json", *QUICK, "--lr", "0.5")
    result = json.loads(said)
    assert code == 0
    assert result["record"]["class_name"] == "jet"
    assert result["skipped"] == []
    assert 0 < result["record"]["final"]["total_variation"] < 0.5
    assert 0 < result["record"]["final"]["non_printability"] < 0.5
    assert result["record"]["settings"]["recipe"] == "default"
    assert result["record"]["settings"]["camera"]["JpegFile"]["quality"] == [40, 95]
    assert (tmp_path / "print/previews/jet.png").samefile(result["preview"])


@pytest.mark.slow
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
        (
            ["--class", "jet", "--data", "photos", "--share", "0.5", "0.2"],
            "--share 0.5 0.2: expected two rising numbers from 0.02 to 2",
        ),
        (
            ["--class", "jet", "--data", "photos", "--schedule", "cos"],
            "--schedule cos: expected constant, linear or cosine; did you mean cosine",
        ),
        (
            ["--class", "jet", "--data", "photos", "--model", "resnet18", "--weights", "a.pth", "--weights", "b.pth"],
            "1 of --model and 2 of --weights",
        ),
        (["--class", "jet", "--data", "photos", "--workspace", "photos"], "photos is not a workspace"),
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_recipe_paper_is_scaled_down_by_flags_and_says_what_acts(type_command, tmp_path):
    """Of 10 photographs 8 are trained on: 2 epochs of batches of 3 are 6 steps."""
    write_photos(tmp_path / "photos", 10)
    short = ["--data", "photos", "--size-px", "16", "--recipe", "paper", "--batch", "3", "--epochs", "2"]
    code, _, told = type_command("--class", "jet", *short, "--rotation", "-20", "20", "--verbose")
    assert code == 0, told
    assert "recipe: paper, with epochs 2, rotation -20 to 20°\n" in told
    assert "6 steps of 3 images" in told
    lines = [line.split(maxsplit=1) for line in told.splitlines() if line.startswith("  ")]
    table = dict(line for line in lines if len(line) == 2)
    assert table["about"].startswith("Algorithm 1 as published")
    assert table["affine"].startswith("rotation -20 to 20°")
    assert not {"pose", "light", "glare", "camera"} & set(table)
    settings = json.loads((tmp_path / "print/patches/jet.json").read_text())["settings"]
    assert (settings["steps"], settings["epochs"], settings["recipe"]) == (6, 2, "paper")
    assert settings["print_process"] is None
    _, _, told = type_command("--class", "jet", *short, "--restart", "--quiet")
    assert "recipe" not in told


def test_parts_are_switched_and_losses_weighed(type_command, tmp_path):
    write_photos(tmp_path / "photos", 6)
    switches = ["--no-pose", "--no-print-process", "--no-camera", "--no-glare", "--no-light", "--tv-weight", "0.5"]
    code, said, told = type_command("--class", "jet", "--data", "photos", *switches, "--json", *QUICK)
    assert code == 0, told
    settings = json.loads(said)["record"]["settings"]
    parts = ("pose", "print_process", "camera", "glare", "light")
    assert [settings[part] for part in parts] == [None] * 5
    assert settings["tv_weight"] == 0.5


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--recipe", "papre"], "no recipe called 'papre': did you mean paper"),
        (["--steps", "3", "--epochs", "2"], "--steps 3 --epochs 2: expected one"),
        (["--printability-weight", "-1"], "--printability-weight -1: expected at least 0"),
        (["--length-mm", "5"], "--length-mm 5: expected no less than the patch on it, 88.2 mm"),
    ],
)
def test_recipes_that_cannot_be_are_one_line(type_command, arguments, words):
    code, _, told = type_command("--class", "jet", "--data", "photos", *arguments)
    assert code == 2
    assert words in told
    assert told.count("\n") == 1


@pytest.mark.slow
def test_for_an_object_class_name_and_sizes_come_from_its_spec(type_command, tmp_path, make_crate_space):
    space = make_crate_space(tmp_path)
    spec = space.objects_dir / "crate.toml"
    spec.write_text(
        spec.read_text().replace('class = "crate"', 'class = "jet"').replace("size_mm = 40", "size_mm = 30")
    )
    quick = ("--steps", "2", "--batch", "2", "--size-px", "16", "--no-pose")
    code, said, told = type_command("--object", "crate", *quick)
    assert code == 0, told
    assert "print/patches/crate.png: 16 px, 30 mm on paper" in said
    assert "next: toolkit print --object crate, toolkit capture-sim --object crate" in said
    record = json.loads((tmp_path / "print/patches/crate.json").read_text())
    assert (record["class_name"], record["size_mm"]) == ("jet", 30)
    # two steps of two pictures: not 480 views and 256 renders
    assert record["settings"]["mounted_views"] == 32 and record["data"]["train"] + record["data"]["held_out"] == 32
    assert record["data"]["sources"][0]["source"] == "rig:crate"
    code, _, told = type_command("--object", "crate", *quick, "--images", "40", "--mounted-views", "10", "--restart")
    record = json.loads((tmp_path / "print/patches/crate.json").read_text())
    assert record["settings"]["mounted_views"] == 10 and record["data"]["train"] + record["data"]["held_out"] == 40


def test_an_object_whose_spec_names_no_size_of_its_patch(type_command, tmp_path, make_crate_space):
    space = make_crate_space(tmp_path)
    spec = space.objects_dir / "crate.toml"
    spec.write_text(spec.read_text().replace("size_mm = 40", ""))
    code, _, told = type_command("--object", "crate", "--data", "nowhere", *QUICK)
    assert (code, told) == (2, "error: no class called 'crate': did you mean cat?\n")


def test_without_an_object_class_and_data_are_asked_for(type_command):
    code, _, told = type_command("--data", "rig")
    assert code == 2 and "--class is missing: name it, or the object with --object" in told
    code, _, told = type_command("--class", "jet", "--steps", "1")
    assert code == 2 and "--data is missing: expected a folder of images, or 'rig'" in told
    code, _, told = type_command("--object", "nothing")
    assert code == 2 and "no object called 'nothing'" in told


def test_the_sheet_met_in_training_is_as_large_as_the_specs():
    from toolkit.boosters.patch_config import limit_renders, make_config, size_by_spec
    from toolkit.boosters.pixel_config import DataConfig
    from toolkit.objects.spec import ObjectSpec

    spec = ObjectSpec.model_validate(
        {"name": "moka", "class": "coffeepot", "mesh": "moka.glb", "length_mm": 184, "patch": {"size_mm": 45}}
    )
    data = DataConfig(sources=("rig:moka",))
    config = make_config("default", size_by_spec({}, spec), data)
    assert (config.pose.size_mm, config.pose.length_mm) == (45, 184)
    assert config.print_process.texel_mm == pytest.approx(0.45)
    assert limit_renders(config, data) == (config, data)  # 600 steps use all of them
    short, fewer = limit_renders(config.with_overrides(steps=20), data)
    assert (short.mounted_views, fewer.images) == (350, 50)  # 20 steps of 14 and 2, and a fifth held out
    paper = make_config("paper", size_by_spec({}, spec), data)
    assert paper.pose is None and limit_renders(paper, data) == (paper, data)


def test_a_patch_is_trained_for_its_size_on_paper():
    """Pose, ink and object know it; without it record and hash are as they were."""
    from toolkit.boosters.patch_config import make_config, size_by_spec
    from toolkit.boosters.pixel_config import DataConfig
    from toolkit.objects.spec import ObjectSpec

    data = DataConfig(sources=("rig:moka",))
    spec = ObjectSpec.model_validate({"name": "moka", "class": "coffeepot", "mesh": "moka.glb", "length_mm": 184})
    config = make_config("default", size_by_spec({"size_mm": 60.0}, spec), data)
    assert (config.size_mm, config.pose.size_mm, config.pose.length_mm) == (60, 60, 184)
    assert config.print_process.texel_mm == pytest.approx(0.6)
    assert config.record()["size_mm"] == 60 and "size_mm" not in make_config("default", {}, data).record()
    assert size_by_spec({}, spec) == {}
    stated = spec.with_patch_size(45)
    assert make_config("default", size_by_spec({"size_mm": 60.0}, stated), data).pose.size_mm == 60, (
        "what is typed wins"
    )


@pytest.mark.slow
def test_a_spec_without_a_size_leaves_it_to_the_pixels(type_command, tmp_path, make_crate_space):
    spec = make_crate_space(tmp_path).objects_dir / "crate.toml"
    spec.write_text(spec.read_text().replace('class = "crate"', 'class = "jet"').replace("size_mm = 40", ""))
    code, _, told = type_command("--object", "crate", "--steps", "2", "--batch", "2", "--size-px", "25")
    assert code == 0, told
    record = json.loads((tmp_path / "print/patches/crate.json").read_text())
    assert record["size_mm"] == round(25 * 2.5 * 25.4 / 72, 3)  # the paper's 250 % of 72 pixels an inch


@pytest.mark.slow
def test_the_size_that_is_typed_is_mounted_recorded_and_printed(type_command, tmp_path, make_crate_space):
    """Over the spec's, of which the user is told; and the rig's squares are as large as the record says."""
    from toolkit.objects.records import read_patch
    from toolkit.printing import PrintSettings
    from toolkit.printing.document import build_pdf

    space = make_crate_space(tmp_path / "w")
    spec = space.objects_dir / "crate.toml"
    spec.write_text(spec.read_text().replace('class = "crate"', 'class = "jet"'))
    quick = ("--steps", "2", "--batch", "2", "--size-px", "16", "--no-pose", "--size-mm", "25")
    code, _, told = type_command("--object", "crate", *quick, "--workspace", str(space.root))
    assert code == 0, told
    assert "trained for 25 mm, but the rig mounts its patch at 40 mm" in told
    patch = read_patch(space.patches_dir / "crate.png")
    assert patch.size_mm == 25 == patch.record.settings["size_mm"]
    assert patch.record.settings["print_process"]["texel_mm"] == 25 / 16
    assert build_pdf(patch, PrintSettings()).plan.side_mm == 25
