"""The grid: its answers against a loop over single images, what is computed again and what is not, and bad input."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from hue_network import LABELS, make_hue_classifier, write_photos, write_set
from PIL import Image

from toolkit.boosters.apply import boost_images
from toolkit.boosters.transforms.placement import Placement
from toolkit.core.draws import image_seed
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.corruptions.batch import corrupt
from toolkit.rooms.benchmarks.corruptions import CorruptEvalConfig, grid
from toolkit.rooms.benchmarks.corruptions.cells import open_variants, share_classes
from toolkit.rooms.benchmarks.corruptions.grid import Grid, run_grid
from toolkit.rooms.benchmarks.corruptions.recognisers import rank_classes
from toolkit.training.images import open_images

CORRUPTIONS = (("fog", 3), ("gaussian_noise", 2), ("jpeg_compression", 4))


@pytest.fixture
def place(tmp_path):
    workspace = make_workspace(tmp_path / "space")
    write_set(workspace)
    write_photos(tmp_path / "data")
    return workspace, tmp_path / "data", tmp_path / "cells.jsonl"


def evaluate(place, sets=("paint-16",), seed=0, corruptions=CORRUPTIONS, classifier=None):
    workspace, data, cells = place
    classifier = classifier or make_hue_classifier()
    variants, _ = open_variants(workspace, sets, classifier, lambda name: make_hue_classifier(name))
    images = open_images(str(data), classifier)
    images = images.only(share_classes(variants, images.classes))
    grid = Grid(images, tuple(variants), CorruptEvalConfig(corruptions=corruptions, seed=seed))
    return run_grid(grid, cells), classifier


def test_answers_are_those_of_a_loop_over_single_images(place):
    result, classifier = evaluate(place, seed=5)
    images = open_images(str(place[1]), classifier)
    how = classifier.preprocessing
    for answers in result.cells:
        ranks = []
        for image in images.images:
            seed = image_seed(5, image.id)
            pixels = torch.from_numpy(images.load(image, how).transpose(2, 0, 1).copy())[None].float() / 255
            if answers.variant != "unpatched":
                picture = torch.zeros(1, 3, 16, 16)
                picture[:, image.class_index] = 1
                pixels = torch.round(boost_images(pixels, picture, Placement(), [seed]) * 255) / 255
            if answers.severity:
                pixels = torch.round(corrupt(pixels, answers.corruption, answers.severity, [seed]) * 255) / 255
            logits = classifier.logits(pixels)[0].tolist()
            order = sorted(range(3), key=lambda k: (-logits[k], k))
            ranks.append(order.index(image.class_index) + 1)
        np.testing.assert_array_equal(answers.ranks, ranks, err_msg=f"{answers.variant} {answers.corruption}")
    patched = [one for one in result.cells if one.variant == "paint-16" and one.corruption == "clean"]
    assert (patched[0].ranks == 1).all()
    assert result.computed == 2 * 4 * 9 and result.kept == 0


def test_nothing_is_asked_twice_and_a_killed_run_goes_on(place, monkeypatch):
    real, calls = grid.rank_images, []

    def die_at_the_third(*args):
        calls.append(args)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(*args)

    monkeypatch.setattr(grid, "rank_images", die_at_the_third)
    with pytest.raises(KeyboardInterrupt):
        evaluate(place)
    monkeypatch.undo()
    second, network = evaluate(place)
    assert (second.kept, second.computed, network.module.seen) == (2 * 9, 6 * 9, 6 * 12)  # passes are whole
    third, network = evaluate(place)
    assert (third.kept, third.computed, network.module.seen) == (8 * 9, 0, 0)
    fresh, _ = evaluate((*place[:2], place[2].with_name("other.jsonl")))
    for one, other in zip(third.cells, fresh.cells, strict=True):
        np.testing.assert_array_equal(one.ranks, other.ranks)


def test_a_line_cut_by_a_kill_costs_that_cell_alone(place):
    evaluate(place)
    lines = place[2].read_text()
    place[2].write_text(lines[:-20])
    again, _ = evaluate(place)
    assert again.computed == 9
    assert evaluate(place)[0].computed == 0


def test_changed_inputs_are_computed_again_and_only_these(place, monkeypatch):
    monkeypatch.setattr(grid, "SHARD_IMAGES", 3)
    first, _ = evaluate(place)
    Image.fromarray(np.full((40, 44, 3), 90, np.uint8)).save(place[1] / "green" / "1.png")
    assert evaluate(place)[0].computed == 3 * 8  # one shard
    write_set(place[0], classes=(2,), settings={"method": "other"})
    assert evaluate(place)[0].computed == 0  # the same pixels
    write_set(place[0], "paint-20", 20)
    assert evaluate(place, ("paint-16", "paint-20"))[0].computed == 9 * 4
    assert evaluate(place, corruptions=(*CORRUPTIONS, ("snow", 1)))[0].computed == 9 * 2
    assert evaluate(place, seed=1)[0].computed == 9 * 7  # all but the clean bare images
    assert evaluate(place, classifier=make_hue_classifier("other"))[0].computed == 9 * 8
    assert first.computed == 9 * 8


def test_an_image_does_not_depend_on_the_shard_or_the_data_around_it(place, monkeypatch):
    whole, _ = evaluate(place)
    monkeypatch.setattr(grid, "SHARD_IMAGES", 2)
    parts, _ = evaluate((*place[:2], place[2].with_name("b.jsonl")))
    for one, other in zip(whole.cells, parts.cells, strict=True):
        np.testing.assert_array_equal(one.ranks, other.ranks)


def test_unreadable_images_are_listed_and_the_rest_is_evaluated_as_ever(place):
    (place[1] / "red" / "1.png").write_bytes(b"no picture")
    Image.new("RGB", (6, 90)).save(place[1] / "blue" / "0.png")
    for computed in (9 * 8, 0):
        result, _ = evaluate(place)
        assert result.computed == computed
        assert len(result.ids) == 7 and all(len(one.ranks) == 7 for one in result.cells)
        reasons = dict(result.failed)
        assert "not an image" in reasons["red/1.png"] and "too small" in reasons["blue/0.png"]


def test_no_image_at_all_is_an_error(place):
    for file in place[1].rglob("*.png"):
        file.write_bytes(b"x")
    with pytest.raises(ToolkitError, match=r"data: none of its 9 images can be used; .*not an image"):
        evaluate(place)


def test_another_network_answers_for_its_set_and_has_its_own_bare_images(place):
    result, _ = evaluate(place, ("paint-16", "paint-16@second"))
    rows = {(one.variant, one.recogniser) for one in result.cells}
    assert rows == {("unpatched", "hue"), ("unpatched", "second"), ("paint-16", "hue"), ("paint-16", "second")}


def test_classes_without_a_picture_are_left_out_for_all(place):
    write_set(place[0], "two-16", classes=(0, 2))
    result, _ = evaluate(place, ("paint-16", "two-16"))
    assert set(result.classes) == {0, 2} and result.labels == {0: "red", 2: "blue"}
    write_set(place[0], "one-16", classes=(1,))
    with pytest.raises(ToolkitError, match="'one-16' has no picture for the classes"):
        evaluate(place, ("two-16", "one-16"))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda space: write_set(space, "bad", 40), "patches of 40 px are larger than the 32 px"),
        (lambda space: (write_set(space, "bad", 16, (0,)), write_set(space, "bad", 12, (1,))), "of 12 and 16 px"),
        (lambda space: _relabel(space), "made for class 1 'lime', but index 1 of this classifier is 'green'"),
        (lambda space: None, "no set of patches called 'bad'"),
    ],
)
def test_sets_that_cannot_be_used_are_one_line(place, make, words):
    make(place[0])
    with pytest.raises(ToolkitError, match=words):
        evaluate(place, ("bad",))


def test_codes_are_read_and_counted_apart(place):
    from toolkit.objects.records import write_patch
    from toolkit.rooms.benchmarks.corruptions.recognisers import NOT_DECODED, RIGHT

    for index, label in enumerate(LABELS):
        tag = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), index, 24)
        pixels = np.stack([np.pad(tag, 4, constant_values=255)] * 3, axis=2)
        code = {"kind": "apriltag", "text": str(index), "dictionary": "36h11"}
        record = {
            "name": label, "class_name": label, "class_index": index, "networks": [], "data": {}, "seed": 0,
            "settings": {"method": "tag", "code": code}, "final": {}, "toolkit_version": "0",
        }  # fmt: skip
        write_patch(place[0].root / "print/patches/tag-32", pixels, record)
    result, _ = evaluate(place, ("tag-32",), corruptions=(("gaussian_noise", 5),))
    read = {(one.recogniser, one.corruption): one for one in result.cells if one.kind == "reader"}
    assert read.keys() == {("opencv", "clean"), ("opencv", "gaussian_noise")}
    assert set(read["opencv", "clean"].ranks) <= {RIGHT, NOT_DECODED}
    about = next(one for one in result.about["variants"] if one["name"] == "tag-32")
    assert about["readers"][0][0] == "opencv" and 0 <= about["share_whole"] <= 1
    json.dumps(result.about)


def test_ranks_of_ties_go_to_the_lower_index_and_bad_weights_are_named():
    network = make_hue_classifier()
    batch = torch.full((2, 3, 8, 8), 0.5)
    np.testing.assert_array_equal(rank_classes(network, batch, np.array([0, 2])), [1, 3])
    with pytest.raises(ToolkitError, match=r"hue\.pth: the network's output is not a number"):
        rank_classes(network, batch * torch.nan, np.array([0, 1]))


def _relabel(space):
    write_set(space, "bad")
    file = space.root / "print/patches/bad/green.json"
    file.write_text(file.read_text().replace('"class_name": "green"', '"class_name": "lime"'))


def test_ranks_do_not_depend_on_the_size_of_a_shard(place, monkeypatch):
    class ByShape(torch.nn.Module):
        def forward(self, batch):  # the best class is another in a pass of another size
            return batch.mean((2, 3)) + torch.nn.functional.one_hot(torch.tensor(len(batch) % 3), 3)

    def ask(size):
        monkeypatch.setattr(grid, "SHARD_IMAGES", size)
        classifier = replace(make_hue_classifier(), module=ByShape())
        found, _ = evaluate((*place[:2], place[2].with_name(f"{size}.jsonl")), classifier=classifier)
        return [one.ranks.tolist() for one in found.cells]

    assert ask(9) == ask(1) == ask(5)
