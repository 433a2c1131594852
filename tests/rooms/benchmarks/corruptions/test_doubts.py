"""What a benchmark's result must say of its data: copies, folders under another name, images that were trained on."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from hue_network import LABELS, make_hue_classifier, write_photos, write_set
from PIL import Image

from toolkit.boosters.data import list_image_hashes
from toolkit.core.files import sha256_file
from toolkit.core.workspace import make_workspace
from toolkit.evaluation.summaries import open_run
from toolkit.rooms.benchmarks.corruptions import CorruptEvalConfig
from toolkit.rooms.benchmarks.corruptions.benchmark_run import evaluate_benchmark
from toolkit.rooms.benchmarks.corruptions.doubts import find_misnamed


@pytest.fixture
def place(tmp_path):
    space = make_workspace(tmp_path / "space")
    write_set(space)
    return space, write_photos(tmp_path / "data")


def list_notes(place, run="run"):
    space, data = place
    config = CorruptEvalConfig(patches=("paint-16",), corruptions=(("fog", 1),), run=run)
    done = evaluate_benchmark(space, data, make_hue_classifier(), config)
    notes = json.loads(done.files.summary.read_text())["notes"]
    report = done.files.report.read_text()
    assert all(note.split(":")[0].replace("'", "&#39;") in report for note in notes)
    return notes


def test_clean_data_raises_no_doubt(place):
    assert list_notes(place) == []


def test_a_networks_own_warnings_stand_in_the_result(place):
    space, data = place
    doubtful = replace(make_hue_classifier(), notes=("its images may be normalised otherwise",))
    done = evaluate_benchmark(space, data, doubtful, CorruptEvalConfig(corruptions=(("fog", 1),), run="run"))
    content = json.loads(done.files.summary.read_text())
    assert content["notes"] == list(doubtful.notes) and doubtful.notes[0] in done.files.report.read_text()
    assert content["about"]["model"]["network_id"] == open_run(space, "corruptions/run").network.network_id != ""


def test_the_same_weights_with_other_labels_are_another_result(place):
    space, data = place
    network, config = make_hue_classifier(), CorruptEvalConfig(corruptions=(("fog", 1),), run="run")
    for labels in (network.labels, ["green", "red", "blue"]):
        done = evaluate_benchmark(space, data, replace(network, labels=labels), config)
    assert done.files.summary.parent.name == "run-2"


def test_copies_within_a_class_are_told(place):
    for k in (1, 2):
        shutil.copy(place[1] / "red/0.png", place[1] / f"red/{k}.png")
    assert list_notes(place) == ["2 images are copies of others, such as red/1.png of red/0.png: each copy counts"]


def test_an_image_in_two_classes_is_told(place):
    shutil.copy(place[1] / "red/0.png", place[1] / "blue/2.png")
    (note,) = list_notes(place)
    assert note.startswith(
        "2 images are in folders of two classes, such as blue/2.png and red/0.png: they cannot be both"
    )


def test_a_class_folder_copied_under_another_name_is_told(place):
    shutil.rmtree(place[1] / "blue")
    shutil.copytree(place[1] / "red", place[1] / "blue")
    (note,) = list_notes(place)
    assert note.startswith("6 images are in folders of two classes")


def test_a_class_folder_that_was_renamed_is_asked_about(place):
    """The images are not copies: that none is recognised, where all others are, is what gives them away."""
    rng = np.random.default_rng(1)
    colours = {"red": (200, 40, 40), "green": (40, 200, 40), "blue": (200, 40, 40)}  # reds in the folder `blue`
    for label, colour in colours.items():
        for k in range(3):
            pixels = np.clip(np.array(colour) + rng.integers(-20, 20, (40, 44, 3)), 0, 255).astype(np.uint8)
            Image.fromarray(pixels).save(place[1] / label / f"{k}.png")
    assert list_notes(place) == [
        "none of the 3 images of 'blue' is recognised without a corruption, but 100 % of the others: does its folder "
        "have the class's name?"
    ]


def test_a_hard_class_of_few_images_is_no_surprise():
    is_right = np.array([False, False] + [True, False] * 10)
    classes = np.array([0, 0] + [1] * 20)
    assert list(find_misnamed(is_right, classes, {0: "a", 1: "b"})) == []
    many = np.concatenate([[False] * 20, is_right[2:]])
    (note,) = find_misnamed(many, np.array([0] * 20 + [1] * 20), {0: "a", 1: "b"})
    assert note.startswith("none of the 20 images of 'a' is recognised")


def test_unequal_classes_are_told(place):
    (place[1] / "green/0.png").unlink()
    (note,) = list_notes(place)
    assert note.startswith("classes have unequal numbers of images (green 2, ") and "count more" in note


@pytest.mark.parametrize("has_hashes", [True, False])
def test_patches_that_were_trained_on_the_images_are_told(place, has_hashes):
    space, data = place
    used = [sha256_file(data / "red" / f"{k}.png") for k in (0, 1)]
    about = {"sources": [{"source": "data", "use": "class", "found": 3, "used": 2}]}
    about |= list_image_hashes(used) if has_hashes else {}
    for label in LABELS:
        file = space.root / "print/patches/paint-16" / f"{label}.json"
        content = json.loads(file.read_text()) | {"data": about}
        file.write_text(json.dumps(content))
    (note,) = list_notes(place)
    expected = (
        "paint-16 was trained on 2 of these 9 images" if has_hashes else "paint-16 was trained on images of a folder"
    )
    assert note.startswith(expected)


def test_other_training_images_raise_no_doubt(place):
    space, _ = place
    file = space.root / "print/patches/paint-16/red.json"
    about = {"sources": [{"source": "data"}, 7]} | list_image_hashes(["0" * 64])
    file.write_text(json.dumps(json.loads(file.read_text()) | {"data": about}))
    assert list_notes(place) == []
