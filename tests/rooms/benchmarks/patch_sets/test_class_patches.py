"""Many class patches in one run: each is what it would be alone, in a set by its size, and a killed run goes on."""

import numpy as np
import pytest
from hue_network import LABELS, PX, make_hue_classifier, write_photos

from toolkit.boosters import patch
from toolkit.boosters.transforms.placement import Placement
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.rooms.benchmarks.patch_sets import ClassPatchesConfig, class_patches, make_flat_config, read_patch_set
from toolkit.rooms.benchmarks.patch_sets.class_patches import train_class_patches
from toolkit.training.images import open_images

QUICK = {"steps": 6, "batch": 4}


@pytest.fixture
def place(tmp_path):
    data = write_photos(tmp_path / "data", 4)
    (data / "red" / "broken.png").write_bytes(b"no picture")
    return make_workspace(tmp_path / "space"), open_images(str(data), make_hue_classifier(), "train")


def train(place, classes, sizes, corrupted=None, **changes):
    workspace, images = place
    config = ClassPatchesConfig(**({"set_name": "hues", "sizes_px": sizes, "images": 20} | changes))
    patch = make_flat_config("default", QUICK | {"corrupted": corrupted}, Placement(), config)
    return train_class_patches(config, patch, images, classes, make_hue_classifier(), workspace)


@pytest.mark.slow
def test_a_set_for_each_size_with_a_patch_for_each_class_that_helps(place):
    made = train(place, (0, 2), (16, 24))
    patches, skipped = made.patches, made.skipped
    assert list(made.lines()) == [
        f"2 classes, 4 patches in {made.folder / 'hues-16'}, {made.folder / 'hues-24'}"
    ] and made.as_json()["sets"] == ["hues-16", "hues-24"]  # fmt: skip
    assert [(one.set_name, one.label) for one in patches] == [
        ("hues-16", "red"), ("hues-16", "blue"), ("hues-24", "red"), ("hues-24", "blue"),
    ]  # fmt: skip
    assert skipped == [("red/broken.png", "not an image, whatever its name says")]
    assert all(one.patched.value > 0.9 for one in patches)
    large = read_patch_set(place[0], "hues-24", LABELS)
    assert large.n_px == 24 and sorted(large.patches) == [0, 2]
    means = large.stack(np.array([0, 2])).mean((2, 3))
    assert (means.argmax(1) == [0, 2]).all()
    record = large.patches[0].record
    assert record.settings["affine"] == {"rotation_deg": 45.0, "scale": [0.9, 1.1], "translate": 0.3}
    assert record.settings["light"] is None and record.data["sources"][0]["use"] == "backgrounds"


@pytest.mark.slow
def test_a_class_has_the_same_patch_whatever_else_is_trained_and_is_not_trained_twice(place, tmp_path):
    train(place, (0, 1, 2), (16,))
    other = make_workspace(tmp_path / "other")
    train((other, place[1]), (1,), (16,))
    name = "print/patches/hues-16/green.png"
    assert (place[0].root / name).read_bytes() == (other.root / name).read_bytes()
    again = train(place, (0, 1, 2), (16,)).patches
    assert [one.patched for one in again] == [None, None, None]


@pytest.mark.slow
def test_corruptions_in_the_loop_make_another_run_and_are_recorded(place):
    train(place, (1,), (16,))
    plain = read_patch_set(place[0], "hues-16", LABELS).patches[1]
    train(place, (1,), (16,), corrupted=("contrast:5",))
    spoilt = read_patch_set(place[0], "hues-16", LABELS).patches[1]
    assert "corrupted" not in plain.record.settings
    assert spoilt.record.settings["corrupted"]["corruptions"] == [["contrast", 5]]
    assert spoilt.record.settings["inputs_sha256"] != plain.record.settings["inputs_sha256"]
    assert "hue_corrupted_patched_top1" in spoilt.record.final


@pytest.mark.slow
def test_a_killed_run_keeps_what_is_finished_and_goes_on(place, monkeypatch):
    real, calls = patch.train_patch, []

    def die_at_the_second(config, class_name, *args, **kwargs):
        calls.append(class_name)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(config, class_name, *args, **kwargs)

    monkeypatch.setattr(patch, "train_patch", die_at_the_second)
    with pytest.raises(KeyboardInterrupt):
        train(place, (0, 1), (16,))
    monkeypatch.undo()
    rest = train(place, (0, 1), (16,)).patches
    assert [one.patched is None for one in rest] == [True, False]


@pytest.mark.slow
def test_images_of_the_class_alone_where_there_are_enough_or_where_asked(place, monkeypatch):
    monkeypatch.setattr(class_patches, "FEW_IMAGES", 4)
    train(place, (1,), (16,))
    found = read_patch_set(place[0], "hues-16", LABELS).patches[1].record
    assert found.data["sources"] == [{"source": "data", "use": "class", "found": 4, "used": 4}]


@pytest.mark.parametrize(
    ("sizes", "changes", "words"),
    [
        ((PX + 1,), {}, "sizes_px 33: expected 8 to 32"),
        ((16,), {"backgrounds": "some"}, "backgrounds some: expected auto, all or class"),
        ((16,), {"images": 1}, "images 1: expected at least 2"),
    ],
)
def test_bad_requests_are_one_line(place, sizes, changes, words):
    with pytest.raises(ToolkitError, match=words):
        train(place, (0,), sizes, **changes)


def test_a_set_name_that_leaves_the_folder_is_refused():
    with pytest.raises(ToolkitError, match=r"set_name '\.\./out': expected letters"):
        ClassPatchesConfig(set_name="../out")
