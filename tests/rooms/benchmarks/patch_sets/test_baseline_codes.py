"""Codes as pictures: read by libraries that did not draw them."""

import cv2
import numpy as np
import pytest
import zxingcpp

from toolkit.rooms.benchmarks.patch_sets.baselines.drawn import (
    AprilTags,
    QrCodes,
    Words,
    choose_dictionary,
    draw_modules,
    draw_word,
)

CLASSES = 1000


def draw(baseline, index, size_px):
    return baseline.choose(index, lambda done: None).draw(size_px)


@pytest.mark.parametrize(("size_px", "border"), [(46, 1), (60, 1), (100, 1), (101, 1), (224, 1), (100, 4)])
def test_other_libraries_read_the_qr_code_of_each_class(size_px, border):
    baseline = QrCodes(CLASSES, border)
    for index in (0, 9, 10, 751, 999):
        picture = draw(baseline, index, size_px)
        assert picture.shape == (size_px, size_px, 3)
        assert picture.dtype == np.uint8
        found = zxingcpp.read_barcodes(picture)
        assert [code.text for code in found] == [str(index)]
        assert cv2.QRCodeDetector().detectAndDecode(cv2.copyMakeBorder(picture, *[8] * 4, 0, value=(255,) * 3))[0] == (
            str(index)
        )


def test_the_code_is_the_smallest_at_the_highest_level():
    found = zxingcpp.read_barcodes(draw(QrCodes(CLASSES), 999, 100))[0]
    code = QrCodes(CLASSES).choose(999, lambda done: None).code(100)
    assert code == {
        "kind": "qr", "text": "999", "version": 1, "error_correction": "H", "modules": 21, "module_px": 4,
    }  # fmt: skip
    assert found.ec_level == "H"
    assert QrCodes(10**17).modules == 21, "17 digits fill version 1 at level H"
    assert QrCodes(10**18).modules == 25


@pytest.mark.parametrize("size_px", [46, 47, 60, 92, 100])
def test_modules_are_equal_squares_of_black_and_white_with_the_rest_as_margin(size_px):
    baseline = QrCodes(CLASSES)
    grey = draw(baseline, 5, size_px)[..., 0]
    module_px = size_px // 23
    first = (size_px - 21 * module_px) // 2
    code = grey[first : first + 21 * module_px, first : first + 21 * module_px]
    blocks = code.reshape(21, module_px, 21, module_px)
    assert (blocks == blocks[:, :1, :, :1]).all(), "each module is one colour"
    assert set(np.unique(grey)) == {0, 255}
    outside = grey.copy()
    outside[first : first + 21 * module_px, first : first + 21 * module_px] = 255
    assert (outside == 255).all()
    assert min(first, size_px - first - len(code)) >= module_px, "a whole module of white at each side"


def test_modules_drawn_one_by_one():
    black = np.array([[True, False], [True, True]])
    expected = np.full((9, 9), 255)
    for row, column in ((0, 0), (1, 0), (1, 1)):
        expected[2 + 2 * row : 4 + 2 * row, 2 + 2 * column : 4 + 2 * column] = 0
    assert (draw_modules(black, 1, 9) == expected[..., None]).all()


@pytest.mark.parametrize(
    ("classes", "dictionary", "family"),
    [(10, "36h11", cv2.aruco.DICT_APRILTAG_36h11), (587, "36h11", cv2.aruco.DICT_APRILTAG_36h11),
     (588, "36h10", cv2.aruco.DICT_APRILTAG_36h10), (1000, "36h10", cv2.aruco.DICT_APRILTAG_36h10)],
)  # fmt: skip
@pytest.mark.parametrize("size_px", [40, 60, 100])
def test_tags_carry_the_index_of_their_class(classes, dictionary, family, size_px):
    baseline = AprilTags(classes)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(family), cv2.aruco.DetectorParameters())
    assert choose_dictionary(classes) == baseline.settings["dictionary"] == dictionary
    for index in (0, 1, classes // 2, classes - 1):
        scene = np.full((160, 160, 3), 120, np.uint8)
        scene[30 : 30 + size_px, 20 : 20 + size_px] = draw(baseline, index, size_px)
        assert detector.detectMarkers(scene)[1].ravel().tolist() == [index]
        assert baseline.choose(index, lambda done: None).code(size_px) == {
            "kind": "apriltag", "text": str(index), "dictionary": dictionary, "modules": 8, "module_px": size_px // 10,
        }  # fmt: skip


def test_a_tag_is_the_published_one():
    """Tag 0 of 36h11 is 0xd5d628584 in AprilTag's own list, read row by row from the top left."""
    picture = draw(AprilTags(10), 0, 10)[..., 0]
    bits = (picture[2:8, 2:8] == 255).ravel()
    words = [
        int("".join(str(int(bit)) for bit in np.rot90(bits.reshape(6, 6), turns).ravel()), 2) for turns in range(4)
    ]
    assert 0xD5D628584 in words
    assert (picture[1, 1:9] == 0).all()
    assert (picture[0] == 255).all()


@pytest.mark.parametrize("text", ["ox", "racer", "sports car", "black-footed ferret", "yellow lady's slipper"])
@pytest.mark.parametrize("size_px", [32, 100, 224])
def test_a_word_fills_its_square_in_black_on_white(text, size_px):
    picture = draw_word(text, size_px)
    assert picture.shape == (size_px, size_px, 3) and picture.dtype == np.uint8
    rows, columns = (np.flatnonzero((picture[..., 0] < 128).any(axis)) for axis in (1, 0))
    height, width = np.ptp(rows) + 1, np.ptp(columns) + 1
    assert 0.75 * size_px <= max(height, width) <= size_px - 2
    # in the middle, to a pixel or two
    assert abs(rows[0] + rows[-1] - (size_px - 1)) <= 5 and abs(columns[0] + columns[-1] - (size_px - 1)) <= 5
    assert (picture == 255).mean() > 0.4


def test_a_word_is_that_of_its_class_and_two_words_take_two_lines():
    words = Words(["sports_car", "ox"])
    assert np.array_equal(draw(words, 0, 100), draw_word("sports car", 100))
    gap = (draw(words, 0, 100)[..., 0] < 128).any(1)
    rows = np.flatnonzero(gap)
    assert not gap[rows[0] : rows[-1]].all(), "a white gap between the lines"
    assert words.choose(0, lambda done: None).code is None
    assert words.least_px == 32
