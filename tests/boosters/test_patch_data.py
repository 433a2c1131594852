"""Which images a run trains on, and what it says of those it cannot use."""

import numpy as np
import pytest
from tiny_network import tiny_classifier, write_photos

from toolkit.boosters import data
from toolkit.boosters.data import (
    choose_images,
    choose_object,
    cut_centres,
    draw_batch,
    load_data,
    names_of_class,
    stack_on_device,
)
from toolkit.boosters.pixel_config import DataConfig, is_rig_source
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.workspace import Workspace
from toolkit.models.labels import imagenet_wnids

HOW = tiny_classifier().preprocessing
JET = frozenset({"jet"})


def load(tmp_path, *sources, names=JET, **changes):
    config = DataConfig(sources=tuple(str(source) for source in sources), **changes)
    return load_data(config, names, HOW, Workspace(tmp_path), tmp_path / "keep")


def test_images_of_the_class_are_taken_where_it_has_a_folder(tmp_path):
    write_photos(tmp_path / "d" / "train" / "Jet", 5)
    write_photos(tmp_path / "d" / "train" / "cat", 7)
    choice = choose_images(tmp_path / "d", JET)
    assert (choice.use, len(choice.files)) == ("class", 5)
    assert (choose_images(tmp_path / "d", JET, "all").use, len(choose_images(tmp_path / "d", JET, "all").files)) == (
        "backgrounds",
        12,
    )


def test_without_a_folder_of_the_class_every_image_is_a_background_and_recorded_so(tmp_path):
    write_photos(tmp_path / "d" / "cat", 4)
    write_photos(tmp_path / "d", 3)
    record = load(tmp_path, tmp_path / "d").record
    assert record["sources"] == [{"source": "d", "use": "backgrounds", "found": 7, "used": 7}]
    # so that a test on these very images is known
    files = [*(tmp_path / "d").glob("*.png"), *(tmp_path / "d/cat").glob("*.png")]
    assert record["images_sha256"].split() == sorted(sha256_file(file)[:12] for file in files)
    assert record["train"] + record["held_out"] == 7
    with pytest.raises(ToolkitError, match="no sub-folder called jet"):
        choose_images(tmp_path / "d", JET, "class")


def test_a_folder_that_is_itself_named_for_the_class_is_of_the_class(tmp_path):
    assert choose_images(write_photos(tmp_path / "jet", 3), JET).use == "class"


def test_wordnet_id_label_and_spelling_all_name_the_class():
    class ImageNet:
        labels = ["x"] * 817 + ["sports car"]
        is_imagenet = True

    names = names_of_class(ImageNet(), 817, "Sports_Car")
    assert names == {"sports car", imagenet_wnids()[817]}
    assert imagenet_wnids()[817] == "n04285008"


def test_cap_and_choice_by_seed(tmp_path):
    folder = write_photos(tmp_path / "d", 20)
    first, again, other = (load(tmp_path, folder, images=10, seed=seed) for seed in (1, 1, 2))
    assert len(first.train) + len(first.held_out) == 10
    assert len(first.held_out) == 2
    assert first.sha256 == again.sha256 != other.sha256


def test_held_out_images_are_not_trained_on(tmp_path):
    data = load(tmp_path, write_photos(tmp_path / "d", 15))
    trained = {image.tobytes() for image in data.train}
    assert len(trained) == 12
    assert not trained & {image.tobytes() for image in data.held_out}


def test_a_single_image_serves_for_both_and_says_so(tmp_path):
    data = load(tmp_path, write_photos(tmp_path / "d", 1))
    assert not data.is_held_out
    assert data.record["held_out"] == 0
    assert np.array_equal(data.train, data.held_out)


def test_bad_images_are_skipped_with_their_reason_and_others_take_their_place(tmp_path):
    folder = write_photos(tmp_path / "d", 8)
    whole = (folder / "photo_00.png").read_bytes()
    (folder / "photo_00.png").write_bytes(whole[: len(whole) // 2])
    (folder / "photo_01.png").write_bytes(b"")
    (folder / "photo_02.jpg").write_bytes(b"no image at all")
    (folder / "notes.txt").write_text("not counted")
    data = load(tmp_path, folder)
    reasons = dict(data.skipped)
    assert set(reasons) == {"d/photo_00.png", "d/photo_01.png", "d/photo_02.jpg"}
    assert "truncated" in reasons["d/photo_00.png"]
    assert "empty" in reasons["d/photo_01.png"]
    assert len(data.train) + len(data.held_out) == 6
    assert data.record["skipped"] == 3


@pytest.mark.parametrize(
    ("prepare", "words"),
    [
        (lambda d: None, "does not exist"),
        (lambda d: d.write_text("x"), "is a file"),
        (lambda d: d.mkdir(), "no images in it"),
        (lambda d: (d.mkdir(), (d / "a.txt").write_text("x")), r"no images in it \(1 other files\)"),
        (lambda d: (d.mkdir(), (d / "a.jpg").write_bytes(b"x")), "none of its 1 images can be read; d/a.jpg: not an"),
    ],
)
def test_a_folder_that_cannot_be_used_is_one_clear_line(tmp_path, prepare, words):
    prepare(tmp_path / "d")
    with pytest.raises(ToolkitError, match=words) as caught:
        load(tmp_path, tmp_path / "d")
    assert "\n" not in str(caught.value)


def test_no_source_and_too_few_images_are_refused():
    with pytest.raises(ToolkitError, match="sources : expected a folder of images, or 'rig' for renders"):
        DataConfig(sources=())
    with pytest.raises(ToolkitError, match="images 3: expected at least 2 for each of 2 sources"):
        DataConfig(sources=("a", "b"), images=3)
    with pytest.raises(ToolkitError, match="did you mean all"):
        DataConfig(sources=("a",), backgrounds="al")


def test_sources_share_the_cap(tmp_path):
    first, second = write_photos(tmp_path / "a", 9), write_photos(tmp_path / "jet", 9, seed=1)
    record = load(tmp_path, first, second, images=10).record
    assert [(source["use"], source["used"]) for source in record["sources"]] == [("backgrounds", 5), ("class", 5)]


def fake_rig(monkeypatch, calls):
    def render_object(workspace, name, count, seed, image_px):
        calls.append((name, count, seed))
        rng = np.random.default_rng(len(calls))  # never the same pixels twice, as with a moody driver
        return rng.integers(0, 256, (count, image_px, image_px, 3), np.uint8)

    monkeypatch.setattr(data, "render_object", render_object)


def test_renders_are_made_once_per_run_and_kept_until_it_ends(tmp_path, monkeypatch):
    calls = []
    fake_rig(monkeypatch, calls)
    names = frozenset({"warplane"})
    first, again = (load(tmp_path, "rig", names=names, images=6, seed=3) for _ in range(2))
    assert calls == [("warplane", 6, 3)]
    assert first.sha256 == again.sha256
    assert first.record["sources"] == [{"source": "rig:warplane", "use": "class", "found": 6, "used": 6}]
    kept = next((tmp_path / "keep").glob("renders-*.npy"))
    kept.write_bytes(kept.read_bytes()[:100])
    load(tmp_path, "rig:warplane", names=names, images=6, seed=3)
    assert len(calls) == 2, "a damaged store is rendered anew"


def test_the_rig_needs_an_object_of_the_class(tmp_path):
    assert is_rig_source("rig")
    assert is_rig_source("rig:racer")
    assert not is_rig_source("./rig")
    with pytest.raises(ToolkitError, match="no object has the class jet: say sources rig:NAME"):
        choose_object(Workspace(tmp_path), "rig", JET)
    assert choose_object(Workspace(tmp_path), "rig:racer", JET) == "racer"
    with pytest.raises(ToolkitError, match="no object called 'racr': did you mean racer"):
        choose_object(Workspace(tmp_path), "rig:racr", JET)


def test_batches_are_cut_from_the_images_and_none_comes_twice():
    source = np.random.default_rng(0).integers(0, 256, (6, 12, 12, 3), np.uint8)
    stack = stack_on_device(source, "cpu")
    batch = draw_batch(stack, np.random.default_rng(1), 6, 8)
    windows = {
        (view[y : y + 8, x : x + 8].tobytes()): k
        for k, image in enumerate(source)
        for view in (image, image[:, ::-1])
        for y in range(5)
        for x in range(5)
    }
    found = [windows[(cut.permute(1, 2, 0) * 255).round().byte().numpy().tobytes()] for cut in batch]
    assert sorted(found) == list(range(6))
    centre = (cut_centres(stack, 8)[2] * 255).round().byte().permute(1, 2, 0).numpy()
    assert np.array_equal(centre, source[2, 2:10, 2:10])
