"""Which images a data set has, what they show, and which are refused."""

import numpy as np
import pytest
from hue_network import LABELS, make_hue_classifier, write_photos
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.imaging.read import UnreadableImage
from toolkit.rooms.benchmarks.patch_sets import name_class
from toolkit.training.images import choose_classes, match_classes, open_images


@pytest.fixture(scope="module")
def hue():
    return make_hue_classifier()


def test_folders_are_classes_by_label_and_the_split_is_found(tmp_path, hue):
    write_photos(tmp_path / "data" / "train", 4)
    write_photos(tmp_path / "data" / "val", 2, ["red", "BLUE"])
    test = open_images(str(tmp_path / "data"), hue)
    assert test.name == "data/val"
    assert [(one.id, one.class_index) for one in test.images] == [
        ("BLUE/0.png", 2), ("BLUE/1.png", 2), ("red/0.png", 0), ("red/1.png", 0),
    ]  # fmt: skip
    assert len(open_images(str(tmp_path / "data"), hue, "train").images) == 12
    assert len(open_images(str(tmp_path / "data" / "val"), hue, "train").images) == 4
    with Image.open(tmp_path / "data/val/red/1.png") as picture:
        np.testing.assert_array_equal(test.read(test.images[3]), np.asarray(picture))
    assert test.load(test.images[3], hue.preprocessing).shape == (32, 32, 3)


def test_imagenet_classes_by_wordnet_id_and_label_and_never_by_a_name_of_two(tmp_path):
    from torchvision.models import ResNet18_Weights

    class Imagenet:
        labels = ResNet18_Weights.IMAGENET1K_V1.meta["categories"]
        is_imagenet = True

        def describe(self):
            return "a network of ImageNet's 1000 classes"

    assert match_classes(["n04552348", "sports_car", "Cardigan"], Imagenet(), tmp_path) == {
        "n04552348": 895, "sports_car": 817, "Cardigan": 264,
    }  # fmt: skip
    with pytest.raises(ToolkitError, match=r"2 classes are called 'CARDIGAN' \(264, 474\).*WordNet id"):
        match_classes(["CARDIGAN"], Imagenet(), tmp_path)
    with pytest.raises(ToolkitError, match="n04552348 and warplane are the same class"):
        match_classes(["n04552348", "warplane"], Imagenet(), tmp_path)
    assert name_class(Imagenet.labels, 474) == "cardigan_474"
    assert name_class(Imagenet.labels, 895) == "warplane"
    assert len({name_class(Imagenet.labels, k).lower() for k in (264, 474, 895)}) == 3


def test_labels_that_do_not_match_the_classifier_are_one_clear_error(tmp_path, hue):
    write_photos(tmp_path / "data", 1, ["red", "mauve", "teal"])
    with pytest.raises(
        ToolkitError, match=r"data/mauve: 'mauve' is not a class of hue .* \(2 of 3 folders\).*with model"
    ):
        open_images(str(tmp_path / "data"), hue)


@pytest.mark.parametrize(
    ("make", "words"), [("nothing", "does not exist"), ("file", "is a file"), ("empty", "no images")]
)
def test_what_is_no_data_set_is_refused(tmp_path, hue, make, words):
    path = tmp_path / "data"
    if make == "file":
        path.write_text("x")
    elif make == "empty":
        path.mkdir()
    with pytest.raises(ToolkitError, match=words):
        open_images(str(path), hue)


def test_loose_images_and_links_that_leave_are_listed(tmp_path, hue):
    data = write_photos(tmp_path / "data", 1)
    Image.new("RGB", (40, 40)).save(data / "loose.png")
    Image.new("RGB", (40, 40)).save(tmp_path / "outside.png")
    (data / "red" / "link.png").symlink_to(tmp_path / "outside.png")
    found = open_images(str(data), hue)
    assert len(found.images) == 3
    assert dict(found.refused).keys() == {"data/loose.png", "data/red/link.png"}


def test_an_image_too_small_to_show_anything_is_unreadable(tmp_path, hue):
    data = write_photos(tmp_path / "data", 1)
    Image.new("RGB", (7, 60)).save(data / "red" / "0.png")
    found = open_images(str(data), hue)
    with pytest.raises(UnreadableImage, match="7×60 px, too small to be shown at 32 px"):
        found.load(found.images[2], hue.preprocessing)


def test_some_images_of_each_class_are_drawn_by_the_seed(tmp_path, hue):
    found = open_images(str(write_photos(tmp_path / "data", 9)), hue)
    drawn = [one.id for one in found.draw(4, 0).images]
    assert drawn == sorted(drawn) and len(drawn) == 12
    assert sum(one.startswith("blue/") for one in drawn) == 4
    assert [one.id for one in found.only([2]).draw(4, 0).images] == [one for one in drawn if one.startswith("blue/")]
    assert [one.id for one in found.draw(4, 1).images] != drawn
    assert found.draw(20, 0).images == found.images


def test_classes_are_chosen_by_name_and_one_without_images_is_an_error(tmp_path, hue):
    found = open_images(str(write_photos(tmp_path / "data", 2, ["red", "blue"])), hue)
    assert choose_classes(found, [], hue) is found
    assert {one.class_index for one in choose_classes(found, ["Blue"], hue).images} == {2}
    with pytest.raises(ToolkitError, match="class 'green' has no images in data"):
        choose_classes(found, ["green"], hue)
    with pytest.raises(ToolkitError, match="no class called 'mauve'"):
        choose_classes(found, ["mauve"], hue)
    assert LABELS[2] == "blue"
