"""The readers of codes: what they read, what they leave, and the cast that decides it."""

import sys

import cv2
import numpy as np
import pytest
import segno
import torch

from toolkit.core.errors import ToolkitError
from toolkit.corruptions.batch import corrupt
from toolkit.rooms.benchmarks.corruptions.recognisers import (
    NOT_DECODED,
    RIGHT,
    WRONG,
    Reader,
    find_readers,
    judge_texts,
    read_codes,
)
from toolkit.rooms.benchmarks.patch_sets.baselines.drawn import AprilTags, QrCodes


def name_readers(kind, dictionary="36h11"):
    return [pytest.param(reader, id=f"{kind}-{reader.name}") for reader in find_readers(kind, dictionary)[0]]


QR_READERS = name_readers("qr")
ALL_READERS = QR_READERS + name_readers("apriltag") + name_readers("apriltag", "36h10")


def draw(baseline, index, size_px):
    return baseline.choose(index, lambda done: None).draw(size_px)


def put(picture, scene_px=160, at=(30, 20)):
    scene = np.tile(np.linspace(60, 190, scene_px).astype(np.uint8)[:, None, None], (1, scene_px, 3))
    scene[at[0] : at[0] + len(picture), at[1] : at[1] + len(picture)] = picture
    return scene


def test_readers_are_named_with_their_versions():
    readers, missing = find_readers("qr")
    names = [reader.name for reader in readers] + [name for name, _ in missing]
    assert sorted(names) == ["opencv", "pyzbar", "zxing-cpp"]
    assert all(reader.version[0].isdigit() for reader in readers)
    assert [reader.name for reader in find_readers("apriltag")[0]] == ["opencv"]


@pytest.mark.parametrize("reader", QR_READERS)
def test_a_code_of_another_maker_is_read(reader):
    matrix = np.array(segno.make_qr("1234", error="m", version=2, boost_error=False).matrix, bool)
    picture = np.where(np.pad(matrix, 4), 0, 255).astype(np.uint8).repeat(4, 0).repeat(4, 1)
    assert reader.read(np.repeat(picture[..., None], 3, 2)) == ("1234",)


@pytest.mark.parametrize("reader", QR_READERS)
def test_colour_counts_by_its_brightness(reader):
    """Dark blue on yellow: alike in green and red, opposite in blue, the channel that BGR readers take for red."""
    code = draw(QrCodes(1000), 751, 120)
    coloured = np.where(code == 0, np.uint8([10, 20, 120]), np.uint8([250, 240, 90])).astype(np.uint8)
    assert reader.read(put(coloured)) == ("751",)


@pytest.mark.parametrize("dictionary", ["36h11", "36h10"])
def test_tags_are_read_in_their_own_family(dictionary):
    reader = find_readers("apriltag", dictionary)[0][0]
    tags = AprilTags(100 if dictionary == "36h11" else 1000)
    assert reader.read(put(draw(tags, 7, 60))) == ("7",)
    assert reader.read(put(cv2.rotate(draw(tags, 7, 60), cv2.ROTATE_90_CLOCKWISE))) == ("7",)
    assert reader.read(put(255 - np.zeros((60, 60, 3), np.uint8))) == ()


@pytest.mark.slow
@pytest.mark.parametrize("reader", ALL_READERS)
def test_no_picture_is_too_odd(reader, capfd):
    rng = np.random.default_rng(0)
    code = put(draw(QrCodes(1000), 5, 100))
    odd = [np.zeros((0, 5, 3), np.uint8), *(np.full((h, w, 3), 9, np.uint8) for h, w in ((1, 1), (1, 300), (2, 2)))]
    odd += [rng.integers(0, 256, (224, 224, 3), np.uint8) for _ in range(2)]
    odd += [
        np.where(rng.random((120, 120, 1)) < share, code[:120, :120], 255 - code[:120, :120]) for share in (0.9, 0.97)
    ]
    odd += [code[::-1, ::-1], code[:, :70], cv2.resize(code, (31, 500))]
    for picture in odd:
        assert isinstance(reader.read(picture), tuple)
    assert capfd.readouterr() == ("", "")


def test_texts_are_judged():
    assert judge_texts((), "7") == NOT_DECODED
    assert judge_texts(("7",), "7") == RIGHT
    assert judge_texts(("17",), "7") == WRONG
    assert judge_texts(("17", "7"), "7") == RIGHT
    images = torch.zeros(3, 3, 4, 4)
    answers = iter([("1",), ("1",), ()])
    ranks = read_codes(Reader("fake", "1", lambda grey: next(answers)), images, ["1", "2", "3"])
    assert ranks.tolist() == [RIGHT, WRONG, NOT_DECODED]
    assert ranks.dtype == np.int32


@pytest.mark.slow
@pytest.mark.parametrize("corruption", ["gaussian_noise", "contrast", "jpeg_compression", "fog"])
def test_the_cast_to_8_bits_rounds_where_the_release_blackens(corruption):
    """`255 * uint8(x)` leaves of a corrupted picture only what is exactly 1: the release's reader had no chance."""
    classes = [3, 42, 99, 512, 640, 751, 808, 999]
    pictures = np.stack([put(draw(QrCodes(1000), index, 100)) for index in classes])
    images = torch.from_numpy(pictures).permute(0, 3, 1, 2).float() / 255
    corrupted = corrupt(images, corruption, 1, list(range(len(classes))), parameters="imagenet")
    cast = (corrupted.numpy().astype(np.uint8) * 255).transpose(0, 2, 3, 1)
    texts = [str(index) for index in classes]
    for reader in find_readers("qr")[0]:
        ranks = read_codes(reader, corrupted, texts)
        released = [judge_texts(reader.read(one), text) for one, text in zip(cast, texts, strict=True)]
        assert released.count(RIGHT) == 0
        assert (ranks == RIGHT).sum() > len(classes) / 2, reader.name
        assert (ranks == WRONG).sum() == 0


def test_what_is_missing_is_named_with_what_to_do(monkeypatch):
    for module in ("zxingcpp", "pyzbar.pyzbar"):
        monkeypatch.setitem(sys.modules, module, None)
    readers, missing = find_readers("qr")
    assert [reader.name for reader in readers] == ["opencv"]
    assert [name for name, _ in missing] == ["zxing-cpp", "pyzbar"]
    assert "pip install zxing-cpp" in missing[0][1]
    assert "libzbar0" in missing[1][1]


def test_unknown_kinds_and_families():
    with pytest.raises(ToolkitError, match=r"no code called 'barcode'.*qr"):
        find_readers("barcode")
    with pytest.raises(ToolkitError, match=r"no family of AprilTags called '36h12'.*36h1"):
        find_readers("apriltag", "36h12")
