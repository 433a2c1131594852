"""Tags and pictures without a record: as large as stated, and read back from the page."""

import json

import cv2
import numpy as np
import pypdfium2
import pytest
from one_line import error_of
from PIL import Image
from printed_pages import render
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.printing import OwnSettings, PrintSettings
from toolkit.printing.own import measure_reach_mm, print_picture, print_tags, read_tags
from toolkit.rig.markers import DICTIONARIES, find_family, get_dictionary


def read_back(content, dictionary, dpi):
    """(id, four corners in mm) of every tag that OpenCV finds on the pages."""
    how = cv2.aruco.DetectorParameters()
    how.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector, found = cv2.aruco.ArucoDetector(get_dictionary(dictionary), how), []
    for number in range(len(pypdfium2.PdfDocument(content))):
        page = render(content, number, dpi)
        corners, ids, _ = detector.detectMarkers(cv2.cvtColor(page.pixels, cv2.COLOR_RGB2GRAY))
        numbers = [] if ids is None else np.ravel(ids).tolist()
        found += [(k, one[0] / page.per_mm) for k, one in zip(numbers, corners, strict=True)]
    return found


@pytest.mark.parametrize(
    ("tags", "count"),
    [
        ("25h9:0-34", 35),
        ("4x4_50:0-49", 50),
        ("16h5:0-29", 30),
        pytest.param("36h11:0-586", 587, marks=pytest.mark.slow),
    ],
)
def test_every_tag_of_a_family_is_read_back_from_its_page_at_150_dpi(tmp_path, tags, count):
    done = print_tags(OwnSettings(tag=tags), PrintSettings(size_mm=30.0), tmp_path)
    dictionary, ids = read_tags(tags)
    assert len(ids) == count == DICTIONARIES[dictionary]
    found = read_back((tmp_path / f"tags_{tags.split(':')[0]}.pdf").read_bytes(), dictionary, 150)
    assert sorted(k for k, _ in found) == ids
    assert f"{count} tags of" in done.description and done.size_mm == (30, 30)


@pytest.mark.parametrize(("tags", "size_mm"), [("36h11:7", 80.0), ("aruco_original:1000,3", 55.0)])
def test_a_tag_measures_what_was_asked(tmp_path, tags, size_mm):
    file = tmp_path / "tags.pdf"
    print_tags(OwnSettings(tag=tags), PrintSettings(size_mm=size_mm), file)
    dictionary, ids = read_tags(tags)
    found = read_back(file.read_bytes(), dictionary, 600)
    assert sorted(k for k, _ in found) == sorted(ids)
    for _, corners in found:
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
        assert np.abs(sides - size_mm).max() < 0.2
    text = pypdfium2.PdfDocument(file.read_bytes())[0].get_textpage().get_text_range()
    assert f"id {ids[0]}, {size_mm:g} mm" in text and "100" in text


def test_its_border_is_white_and_a_module_wide(tmp_path):
    file = tmp_path / "tags.pdf"
    print_tags(OwnSettings(tag="36h11:0"), PrintSettings(size_mm=80.0), file)
    page = render(file.read_bytes(), 0, 300)
    ((_, corners),) = read_back(file.read_bytes(), "DICT_APRILTAG_36h11", 300)
    (left, top), (right, bottom) = corners.min(0), corners.max(0)
    module = 80 / 8
    whole = page.cut_out(left - module + 0.3, top - module + 0.3, right + module - 0.3, bottom + module - 0.3)
    inside = page.cut_out(left - 0.3, top - 0.3, right + 0.3, bottom + 0.3)
    assert (whole < 128).sum() == (inside < 128).sum() > 0


def test_a_tag_larger_than_a_page_is_tiled_and_copies_are_made(tmp_path):
    done = print_tags(OwnSettings(tag="36h11:1,2"), PrintSettings(size_mm=300.0), tmp_path)
    assert done.tiles == (2, 3) or done.tiles == (3, 2)
    assert done.pages == 2 * 7
    file = tmp_path / "copies.pdf"
    print_tags(OwnSettings(tag="36h11:1,2"), PrintSettings(size_mm=40.0, copies=2), file)
    assert sorted(k for k, _ in read_back(file.read_bytes(), "DICT_APRILTAG_36h11", 150)) == [1, 1, 2, 2]


@pytest.mark.parametrize(
    ("tags", "words"),
    [
        ("36h11:580-590", "36h11 has the tags 0 to 586"),
        ("99h9:1", "no family of tags called '99h9': expected one of 4x4_50"),
        ("36h11", "expected FAMILY:NUMBERS"),
        ("36h11:a", "expected FAMILY:NUMBERS"),
        ("36h11:", "expected FAMILY:NUMBERS"),
        ("36h11:5-2", "expected the smaller number first"),
        ("36h11:-3", "expected FAMILY:NUMBERS"),
    ],
)
def test_tags_that_there_are_not_in_one_line(tags, words):
    assert words in error_of(lambda: read_tags(tags))


def test_families_go_by_their_usual_names():
    assert find_family("tag36h11") == find_family("DICT_APRILTAG_36H11") == "DICT_APRILTAG_36h11"
    assert {find_family(one) for one in DICTIONARIES} == set(DICTIONARIES)
    assert read_tags("25h9: 3, 1-2,2")[1] == [3, 1, 2]


def test_any_picture_is_printed_as_large_as_stated(tmp_path):
    pixels = np.zeros((20, 30, 3), np.uint8)
    pixels[..., 0], pixels[::2, :, 1] = 255, 200
    Image.fromarray(pixels).save(tmp_path / "camouflage.png")
    own = OwnSettings(picture=tmp_path / "camouflage.png", camera_px=640, camera_fov=90)
    done = print_picture(own, PrintSettings(size_mm=120.0), tmp_path)
    page = render((tmp_path / "picture_camouflage.pdf").read_bytes())
    left, top, right, bottom = page.box_mm(page.coloured)
    assert (right - left, bottom - top) == pytest.approx((120, 80), abs=0.2)
    middle = page.cut_out(left + 10, top + 0.5, left + 11, bottom - 0.5)[:, 5, 1]
    assert len(np.flatnonzero(np.diff((middle > 100).astype(int)))) == 19  # every row of texels
    # 4 mm texels, 320 px focal length: one pixel at 1.28 m
    assert measure_reach_mm(4.0, 640, 90) == pytest.approx(1280) and "up to 1.3 m" in done.note
    by_dpi = print_picture(own, PrintSettings(dpi=10.0), tmp_path / "dpi.pdf")
    assert by_dpi.size_mm == pytest.approx((76.2, 50.8))


def test_pictures_that_cannot_be_printed_in_one_line(tmp_path, monkeypatch):
    (tmp_path / "empty.png").write_bytes(b"")
    (tmp_path / "toolkit.toml").write_text("schema_version = 1\n")
    monkeypatch.chdir(tmp_path)
    size = PrintSettings(size_mm=50.0)
    for name in ("empty.png", "missing.png"):
        line = error_of(lambda name=name: print_picture(OwnSettings(picture=tmp_path / name), size, tmp_path))
        assert name in line and "cannot be read" in line
    Image.new("RGBA", (4, 4), (255, 0, 0, 9)).save("clear.png")
    line = error_of(lambda: print_picture(OwnSettings(picture="clear.png"), size, tmp_path))
    assert "100% of it is transparent" in line  # paper has no such place
    Image.new("RGB", (4, 4)).save("x.png")
    assert "states its size" in error_of(lambda: print_picture(OwnSettings(picture="x.png"), PrintSettings(), tmp_path))
    tag = ["--tag", "36h11:1"]
    for words in ([*tag, "--board"], [*tag, "--picture", "x.png"], [*tag, "--all"], [*tag, "--dpi", "72"]):
        assert isinstance(CliRunner().invoke(app, ["print", *words]).exception, ToolkitError), words


def test_the_command_says_where_and_how_far(tmp_path, monkeypatch):
    (tmp_path / "toolkit.toml").write_text("schema_version = 1\n")
    monkeypatch.chdir(tmp_path)
    Image.new("RGB", (10, 10), "red").save("x.png")
    done = CliRunner().invoke(app, ["print", "--picture", "x.png", "--size-mm", "100", "--json"])
    (row,) = json.loads(done.stdout)["printed"]
    assert row["size_mm"] == [100, 100] and row["file"].endswith("print/picture_x.pdf")
    shown = CliRunner().invoke(app, ["print", "--tag", "36h11:0-1", "--size-mm", "40"]).stdout
    assert "2 tags of 36h11, ids 0 to 1; 40.0 × 40.0 mm, 1 page of a4 portrait" in shown
