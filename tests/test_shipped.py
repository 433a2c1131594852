"""What the repository ships hangs together: patches, textures, the bundled classifier, and the example workspace.

The root of the repository is a workspace. Its example files are made by `toolkit print` and `scripts/make-example`;
here they are compared with what the kit makes of the same inputs now.
"""

import csv
import json
import re
import subprocess
from collections import defaultdict
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from toolkit.core.files import sha256_file
from toolkit.core.workspace import PACKAGE_DATA, Workspace, make_workspace, open_workspace
from toolkit.models.load import bundled_file, read_bundled
from toolkit.objects.load import BUILTIN
from toolkit.objects.records import read_patch
from toolkit.rig import PAIR
from toolkit.rooms.worlds.content.everyday import MAKERS

ROOT = Path(__file__).parents[1]
SETS = (None, "rig18")


@pytest.mark.parametrize("patch_set", SETS)
def test_every_object_has_a_patch_no_longer_than_a_third_of_it(patch_set, tmp_path):
    from toolkit.objects.spec import read_spec

    space = Workspace(tmp_path).with_patches(patch_set)
    for name in BUILTIN:
        patch, spec = read_patch(space.patch(name)), read_spec(space.object_spec(name))
        assert patch.record.class_name == spec.class_name
        assert patch.size_mm <= spec.length_mm / 3


@pytest.mark.parametrize("patch_set", SETS)
@pytest.mark.parametrize("name", BUILTIN)
def test_its_page_is_of_the_shipped_patch(name, patch_set):
    from pypdf import PdfReader

    text = PdfReader(ROOT / "print" / (patch_set or "") / f"{name}.pdf").pages[0].extract_text()
    png = PACKAGE_DATA / "patches" / (patch_set or "") / f"{name}.png"
    assert sha256_file(png)[:12] in text.replace(" ", "")


def test_rig18_is_whole_small_and_not_imagenets():
    record, file = read_bundled(), bundled_file()
    assert sorted(record.labels) == sorted(MAKERS)
    assert file.stat().st_size < 25e6
    assert record.held_out.n >= 10 * len(record.labels)
    assert record.held_out.accuracy == pytest.approx(record.held_out.correct / record.held_out.n)
    assert "not ImageNet" in record.trained_on or "ImageNet" not in record.trained_on


def test_the_patches_of_rig18_were_trained_on_it():
    sha256 = sha256_file(bundled_file())
    for name in BUILTIN:
        record = read_patch(PACKAGE_DATA / "patches" / "rig18" / f"{name}.png").record
        assert [network.sha256 for network in record.networks] == [sha256]


def test_every_object_has_a_texture_that_fits_it(tmp_path):
    from toolkit.objects.load import load_object
    from toolkit.rig.applied.texture import find_texture

    space = Workspace(tmp_path)
    for name in BUILTIN:
        item = load_object(space.object_spec(name))
        texture = find_texture(space, item)
        assert texture.record.name == name
        assert texture.record.class_name == item.spec.class_name
        assert texture.record.settings["recipe"] == "default"


def tracked_files():
    done = subprocess.run(["git", "ls-files", "-s", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        pytest.skip("needs the repository's index, which is not here")
    rows = [row.split(None, 3) for row in done.stdout.split("\0") if row]
    return {path: digest for _, digest, _, path in rows}


def test_no_bytes_are_tracked_twice():
    places = defaultdict(list)
    for path, digest in tracked_files().items():
        places[digest].append(path)
    assert [paths for paths in places.values() if len(paths) > 1] == []


@pytest.mark.parametrize("folder", ["print", "rig", "captures", "eval"])
def test_each_folder_of_the_workspace_says_what_it_holds_and_holds_an_example(folder):
    tracked = [path for path in tracked_files() if path.startswith(f"{folder}/")]
    assert f"{folder}/README.md" in tracked and len(tracked) > 2
    ignored = subprocess.run(
        ["git", "check-ignore", "--no-index", *tracked], cwd=ROOT, capture_output=True, check=False
    )
    assert ignored.stdout == b""


@pytest.mark.parametrize(
    "path",
    [
        "print/board.pdf", "print/patches/mug.png", "print/patches/parts/mug.png", "rig/shots.json",
        "rig/objects/mug.toml", "rig/preview/mug-sheet.png", "rig/textures/mug.png", "rig/classifiers/x.safetensors",
        "captures/sim/manifest.jsonl", "captures/real/racer/patched/1.jpg", "eval/resnet18/report.html",
    ],
)  # fmt: skip
def test_what_is_made_in_the_example_is_not_tracked_by_accident(path):
    tracked_files()  # skips where there is no repository
    assert subprocess.run(["git", "check-ignore", "-q", "--no-index", path], cwd=ROOT, check=False).returncode == 0


def test_the_examples_plan_and_guide_are_what_the_kit_makes(tmp_path):
    from toolkit.rig.plan import open_plan, read_plan

    space = make_workspace(tmp_path)
    open_plan(space)
    assert read_plan(ROOT / "rig" / "plan.json") == read_plan(space.plan_file)
    assert (ROOT / "rig/objects/README.txt").read_text() == (space.objects_dir / "README.txt").read_text()
    assert (ROOT / "toolkit.toml").read_text() == (space.root / "toolkit.toml").read_text()


@pytest.mark.slow
def test_the_examples_previews_are_of_its_plan():
    """Within what another font or another processor changes."""
    from toolkit.captures.shoot import ShootSettings, studio_for
    from toolkit.objects.load import load_object
    from toolkit.rig.plan import read_plan
    from toolkit.rig.plan_pictures import draw_contact_sheet, draw_positions

    plan, item = read_plan(ROOT / "rig" / "plan.json"), load_object(open_workspace(ROOT).object_spec("racer"))
    camera, poses = plan.camera, plan.objects["racer"]
    drawn = {
        "racer-positions.png": draw_positions(item, poses),
        "racer-sheet.jpg": draw_contact_sheet(item, camera, poses, studio_for(item, ShootSettings())),
    }
    for name, content in drawn.items():
        assert_same_picture(ROOT / "rig" / "preview" / name, Image.open(BytesIO(content)), 4)


def assert_same_picture(file, again, tolerance):
    """Mean difference of sRGB values of 0 to 255, of pictures a quarter as large."""
    small = [np.asarray(picture.convert("RGB").reduce(4), float) for picture in (Image.open(file), again)]
    assert small[0].shape == small[1].shape
    assert np.abs(small[0] - small[1]).mean() < tolerance


@pytest.mark.slow
def test_the_examples_captures_are_what_the_rig_shoots(tmp_path):
    from toolkit.captures.manifest import read_manifest
    from toolkit.captures.shoot import shoot_plan
    from toolkit.rig.plan import read_plan

    folder = ROOT / "captures" / "example"
    lines = [json.loads(line) for line in (folder / "manifest.jsonl").read_text().splitlines()]
    assert {(line["object"], line["variant"]) for line in lines} == {(n, v) for n in BUILTIN for v in PAIR}
    assert len(lines) == 8 == len(read_manifest(folder))
    poses = read_plan(ROOT / "rig" / "plan.json").objects
    patches = open_workspace(ROOT).patches()
    for line in lines:
        assert sha256_file(folder / line["path"]) == line["image_sha256"]
        booster = sha256_file(patches[line["object"]]) if line["variant"] == "patched" else None
        assert line["booster_sha256"] == booster
        pose = next(pose for pose in poses[line["object"]] if pose.id == line["pose_id"])
        np.testing.assert_allclose(line["T_world_camera"], pose.matrix(), atol=1e-5)

    space, plan = make_workspace(tmp_path), read_plan(ROOT / "rig" / "plan.json")
    one = plan.model_copy(update={"objects": {"eggnog": [pose for pose in poses["eggnog"] if pose.id == 8]}})
    shoot_plan(space, one, ["eggnog"], source="example")
    for variant in PAIR:
        path = f"example/eggnog/{variant}/pose_08.jpg"
        assert_same_picture(ROOT / "captures" / path, Image.open(space.captures_dir / path), 2)


def test_the_examples_report_is_of_its_pictures():
    """Its table counts what its rows say, and each row is of a tracked picture and of the class of its object."""
    rows = list(csv.DictReader((ROOT / "eval/example/predictions.csv").open()))
    summary = json.loads((ROOT / "eval/example/summary.json").read_text())
    assert sorted(row["path"] for row in rows) == sorted(
        str(file.relative_to(ROOT / "captures")) for file in (ROOT / "captures" / "example").rglob("*.jpg")
    )
    for group in summary["groups"]:
        own = [r for r in rows if r["variant"] == group["variant"] and group["object"] in ("all", r["object"])]
        assert group["n"] == len(own)
        assert group["top1"] == pytest.approx(sum(int(row["correct_top1"]) for row in own) / len(own))
    report = (ROOT / "eval/example/report.html").read_text()
    assert "http" not in re.sub(r"http://www.w3.org/\S+", "", report) and "pose_08.jpg" in report


def test_the_examples_report_is_what_the_network_says(real_weights):
    import torch

    from toolkit.imaging.read import read_image
    from toolkit.models.load import load_classifier

    (file,) = real_weights.glob("resnet18-*.pth")
    summary = json.loads((ROOT / "eval/example/summary.json").read_text())
    if sha256_file(file) != summary["model"]["sha256"]:
        pytest.skip("the example was made with other weights of ResNet-18")
    classifier = load_classifier("resnet18", file, device="cpu")
    rows = list(csv.DictReader((ROOT / "eval/example/predictions.csv").open()))
    images = [classifier.preprocess(read_image(ROOT / "captures" / row["path"])) for row in rows]
    with torch.no_grad():
        answers = classifier.logits(torch.stack(images)).softmax(dim=1)
    for row, probabilities in zip(rows, answers, strict=True):
        assert int(probabilities.argmax()) == int(row["top1_index"])
        assert float(probabilities[int(row["true_index"])]) == pytest.approx(float(row["true_prob"]), abs=0.01)


def test_the_example_holds_the_objects_in_their_textures():
    from toolkit.objects.records import read_texture

    for name in BUILTIN:
        record = read_texture(PACKAGE_DATA / "textures" / f"{name}.png").record
        assert sha256_file(ROOT / "rig" / "textures" / f"{name}.glb") == record.objects[0].glb_sha256
