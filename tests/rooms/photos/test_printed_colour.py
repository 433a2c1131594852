"""Printed colours, page size and strip, against a printer and a camera that are known; ΔE00 against published pairs."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from printed_photos import (
    A4_MM,
    PATCH_MM,
    STRIP_CORNER_MM,
    ink,
    page_corners,
    paint_page,
    photograph_page,
    shipped_patch,
)
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.imaging.colour import delta_e2000, lab_of_linear, linear_to_srgb, srgb_to_linear
from toolkit.imaging.printer import raise_terms, read_print_profile
from toolkit.printing.marks import STRIP
from toolkit.printing.page import parse_paper
from toolkit.rooms.photos.prints.align import map_points
from toolkit.rooms.photos.prints.colours import compare_colours, measure_error, read_colours
from toolkit.rooms.photos.prints.find import find_page, find_patch, measure_on_page, rectify_patch
from toolkit.rooms.photos.prints.fit_profile import MODELS, fit_colours, read_strip

PATCH, CLASS = "rig18/warplane", "warplane"
"""A chart with colours enough: how well a printer is told depends on how many a patch holds."""
# Sharma, Wu and Dalal (2005), table 1: L, a, b of both, and their difference
SHARMA = [
    (50, 2.6772, -79.7751, 50, 0, -82.7485, 2.0425), (50, 3.1571, -77.2803, 50, 0, -82.7485, 2.8615),
    (50, 2.8361, -74.0200, 50, 0, -82.7485, 3.4412), (50, -1.3802, -84.2814, 50, 0, -82.7485, 1.0000),
    (50, -1.1848, -84.8006, 50, 0, -82.7485, 1.0000), (50, -0.9009, -85.5211, 50, 0, -82.7485, 1.0000),
    (50, 0, 0, 50, -1, 2, 2.3669), (50, -1, 2, 50, 0, 0, 2.3669),
    (50, 2.4900, -0.0010, 50, -2.4900, 0.0009, 7.1792), (50, 2.4900, -0.0010, 50, -2.4900, 0.0010, 7.1792),
    (50, 2.4900, -0.0010, 50, -2.4900, 0.0011, 7.2195), (50, 2.4900, -0.0010, 50, -2.4900, 0.0012, 7.2195),
    (50, -0.0010, 2.4900, 50, 0.0009, -2.4900, 4.8045), (50, -0.0010, 2.4900, 50, 0.0011, -2.4900, 4.7461),
    (50, 2.5, 0, 50, 0, -2.5, 4.3065), (50, 2.5, 0, 73, 25, -18, 27.1492), (50, 2.5, 0, 61, -5, 29, 22.8977),
    (50, 2.5, 0, 56, -27, -3, 31.9030), (50, 2.5, 0, 58, 24, 15, 19.4535), (50, 2.5, 0, 50, 3.1736, 0.5854, 1.0000),
    (50, 2.5, 0, 50, 3.2972, 0, 1.0000), (50, 2.5, 0, 50, 1.8634, 0.5757, 1.0000),
    (50, 2.5, 0, 50, 3.2592, 0.3350, 1.0000), (60.2574, -34.0099, 36.2677, 60.4626, -34.1751, 39.4387, 1.2644),
    (63.0109, -31.0961, -5.8663, 62.8187, -29.7946, -4.0864, 1.2630),
    (61.2901, 3.7196, -5.3901, 61.4292, 2.2480, -4.9620, 1.8731),
    (35.0831, -44.1164, 3.7933, 35.0232, -40.0716, 1.5901, 1.8645),
    (22.7233, 20.0904, -46.6940, 23.0331, 14.9730, -42.5619, 2.0373),
    (36.4612, 47.8580, 18.3852, 36.2715, 50.5065, 21.2231, 1.4146),
    (90.8027, -2.0831, 1.4410, 91.1528, -1.6435, 0.0447, 1.4441),
    (90.9257, -0.5406, -0.9208, 88.6381, -0.8985, -0.7239, 1.5381),
    (6.7747, -0.2908, -2.4247, 5.8714, -0.0985, -2.2286, 0.6377),
    (2.0776, 0.0795, -1.1350, 0.9033, -0.0636, -0.5514, 0.9082),
]  # fmt: skip


@pytest.mark.parametrize("row", SHARMA)
def test_differences_are_the_published_ones(row):
    assert delta_e2000(np.array(row[:3]), np.array(row[3:6])) == pytest.approx(row[6], abs=5e-5)
    assert delta_e2000(np.array(row[3:6]), np.array(row[:3])) == pytest.approx(row[6], abs=5e-5)


def test_lab_of_known_colours():
    """White and middle grey by definition; sRGB's red, green and blue as published for D65."""
    np.testing.assert_allclose(lab_of_linear(np.ones(3)), [100, 0, 0], atol=0.01)
    np.testing.assert_allclose(lab_of_linear(np.full(3, 0.184187)), [50, 0, 0], atol=0.01)
    np.testing.assert_allclose(
        lab_of_linear(np.eye(3)), [[53.24, 80.09, 67.20], [87.73, -86.18, 83.18], [32.30, 79.19, -107.86]], atol=0.02
    )


@pytest.fixture(scope="module")
def page():
    """The page's photo, the patch in it, and its strip."""
    photo = photograph_page(paint_page(shipped_patch(PATCH)), page_corners())
    return photo, find_patch(photo, shipped_patch(PATCH)), read_strip(photo)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1.0, 0.97, 0.94])
def test_the_scale_of_the_page_is_measured_by_its_edges(scale):
    photo = photograph_page(paint_page(shipped_patch(PATCH), scale), page_corners(0.15, -7), blur_px=0.9)
    measure = measure_on_page(photo, find_patch(photo, shipped_patch(PATCH)), parse_paper("a4"))
    assert np.sqrt(np.prod(measure)) == pytest.approx(scale * PATCH_MM, rel=0.004)
    assert np.abs(find_page(photo) - page_corners(0.15, -7)).max() < 1.0


@pytest.mark.slow
def test_another_sheet_or_none_gives_no_size(page):
    photo, sighting, _ = page
    assert measure_on_page(photo, sighting, parse_paper("140x297mm")) is None
    cut = photo[250:]
    assert measure_on_page(cut, find_patch(cut, shipped_patch(PATCH)), parse_paper("a4")) is None
    assert find_page(np.full((300, 400, 3), 60, np.uint8)) is None


def test_the_strip_is_read_cell_by_cell(page):
    photo, _, strip = page
    truth = ink(STRIP.srgb / 255)
    seen = linear_to_srgb(strip.seen_linear / strip.white_linear)
    assert strip.names == STRIP.names and not strip.clipped.any()
    assert np.abs(seen - linear_to_srgb(truth)).max() < 0.03  # the light falls off across the strip
    corner = map_points(strip.homography, np.zeros((1, 2)))[0]
    to_photo = np.array(STRIP_CORNER_MM) / A4_MM
    top, bottom = (page_corners()[[k, j]] for k, j in ((0, 1), (3, 2)))
    near = (1 - to_photo[1]) * (top[0] + to_photo[0] * (top[1] - top[0])) + to_photo[1] * (
        bottom[0] + to_photo[0] * (bottom[1] - bottom[0])
    )
    assert np.linalg.norm(corner - near) < 40  # bilinear, so only roughly where the perspective has it
    assert read_strip(photo[:700]) is None
    assert read_strip(np.full((200, 300, 3), 255, np.uint8)) is None


def test_the_printed_colour_error_is_the_printers(page):
    """Against the printer itself, drawn as the camera averages it, without light, noise or JPEG."""
    photo, sighting, strip = page
    patch = shipped_patch(PATCH)
    colours = read_colours(photo, sighting, PATCH_MM, strip.white_linear)
    found = compare_colours(colours, patch)
    meant, printed = colours.draw(srgb_to_linear(patch / 255)), colours.draw(ink(patch / 255), 0.8)
    truth = measure_error(printed, meant)
    assert found.error.median == pytest.approx(truth.median, rel=0.05)
    bias = (linear_to_srgb(printed) - linear_to_srgb(meant)).mean(axis=0)
    np.testing.assert_allclose(found.bias, bias, atol=0.012)
    assert found.white_from == "margin"
    perfect = photograph_page(paint_page(patch, printer=lambda x: srgb_to_linear(x).astype(float)), page_corners())
    same = compare_colours(read_colours(perfect, find_patch(perfect, patch), PATCH_MM), patch)
    assert np.abs(same.bias).max() < 0.02 and same.error.median < 0.45 * found.error.median


@pytest.mark.slow
@pytest.mark.parametrize("with_strip", [False, True])
def test_fitting_recovers_the_printer(page, with_strip):
    photo, sighting, strip = page
    colours = read_colours(photo, sighting, PATCH_MM, strip.white_linear)
    fitted = fit_colours([colours], shipped_patch(PATCH), [strip] if with_strip else [])
    cube = np.stack(np.meshgrid(*[np.linspace(0, 1, 6)] * 3), -1).reshape(-1, 3)
    said = raise_terms(cube, fitted.power, fitted.exponents) @ fitted.coefficients
    error = measure_error(said, ink(cube))
    assert error.median < 1.0 and error.p95 < 2.5
    assert fitted.held_out.median < 2 < 8 < fitted.without.median
    assert fitted.tried["matrix"] > 2 * fitted.held_out.median  # inks do not mix as light does
    assert fitted.strip_cells == (len(STRIP.swatches) if with_strip else 0)


@pytest.mark.slow
def test_a_plain_matrix_is_kept_where_it_is_enough():
    matrix = np.array([[0.8, 0.1, 0.05], [0.05, 0.75, 0.1], [0.05, 0.05, 0.7]])
    offset = np.array([0.05, 0.06, 0.08])

    def printer(encoded):
        linear = np.asarray(encoded, float) ** 2.2
        full = linear @ matrix.T + offset
        return full / (matrix.sum(axis=1) + offset)

    photo = photograph_page(paint_page(shipped_patch(PATCH), printer=printer), page_corners(), quality=0, noise=0.002)
    sighting = find_patch(photo, shipped_patch(PATCH))
    fitted = fit_colours([read_colours(photo, sighting, PATCH_MM)], shipped_patch(PATCH))
    assert (fitted.model, fitted.power) == ("matrix", 2.2)
    corners = np.array([[0, 0, 0], [1, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    said = raise_terms(corners, 2.2, MODELS["matrix"]) @ fitted.coefficients
    np.testing.assert_allclose(said, printer(corners), atol=0.02)


def test_a_margin_that_is_printed_over_is_no_white(page):
    photo, sighting, strip = page
    with pytest.raises(ToolkitError, match="no white is seen"):
        read_colours(photo, sighting, PATCH_MM, margin="bleed")
    assert read_colours(photo, sighting, PATCH_MM, strip.white_linear, margin="bleed").white_from == "strip"


def test_without_a_margin_the_strip_is_the_white(page):
    photo, sighting, strip = page
    corners = sighting.corners_px
    middle = corners.mean(axis=0)
    mask = np.zeros(photo.shape[:2], np.uint8)
    cv2.fillConvexPoly(mask, np.round(middle + 1.25 * (corners - middle)).astype(np.int32), 1)
    cv2.fillConvexPoly(mask, np.round(middle + 1.004 * (corners - middle)).astype(np.int32), 0)
    cut = np.where(mask[..., None] > 0, np.uint8(60), photo)
    with pytest.raises(ToolkitError, match="no white is seen") as caught:
        read_colours(cut, sighting, PATCH_MM)
    assert "\n" not in str(caught.value)
    colours = read_colours(cut, sighting, PATCH_MM, strip.white_linear)
    assert colours.white_from == "strip"
    assert np.median(np.abs(colours.seen - read_colours(photo, sighting, PATCH_MM).seen)) < 0.05


def test_a_white_desk_is_not_the_paper():
    """A sticker cut tight, whose paper has 0.8 of the light of the desk that it lies on."""
    rng = np.random.default_rng(3)
    patch = rng.integers(0, 256, (20, 20, 3), dtype=np.uint8)
    patch[rng.random((20, 20)) < 0.3] = 255
    photo = photograph_page(paint_page(patch, printer=lambda x: 0.8 * ink(x), with_strip=False), page_corners())
    sighting = find_patch(photo, patch)
    colours = read_colours(photo, sighting, PATCH_MM, patch_pixels=patch)
    truth = colours.draw(ink(patch / 255), 0.8)
    assert colours.white_from == "texels"
    assert np.median(colours.seen / truth) == pytest.approx(1, abs=0.04)
    by_margin = read_colours(photo, sighting, PATCH_MM)
    assert np.median(by_margin.seen / truth) < 0.85, "which the margin alone cannot tell"


def test_an_overexposed_print_is_refused(page):
    _, sighting, _ = page
    photo = photograph_page(paint_page(shipped_patch(PATCH)), page_corners(), exposure=30.0)
    with pytest.raises(ToolkitError, match="over-exposed"):
        read_colours(photo, sighting, PATCH_MM)


def test_a_straightened_print_looks_like_its_file(page):
    photo, sighting, _ = page
    n_px = len(shipped_patch(PATCH))
    straight = rectify_patch(photo, sighting, n_px)
    assert straight.shape == (n_px, n_px, 3)
    assert np.corrcoef(straight.ravel().astype(float), shipped_patch(PATCH).ravel())[0, 1] > 0.8


@pytest.mark.slow
def test_the_command_writes_a_profile_and_says_what_is_wrong(page, tmp_path):
    lab = tmp_path / "lab"
    (lab / "rig").mkdir(parents=True)
    small = photograph_page(paint_page(shipped_patch(CLASS), 0.94), page_corners())
    Image.fromarray(small).save(tmp_path / "small.jpg", quality=92)
    Image.fromarray(np.full((99, 99, 3), 90, np.uint8)).save(tmp_path / "nothing.png")
    (tmp_path / "broken.jpg").write_bytes(b"no picture")

    def run(*words: str):
        return CliRunner().invoke(app, ["print-profile", *words, "--workspace", str(lab)])

    names = [str(tmp_path / name) for name in ("small.jpg", "nothing.png", "broken.jpg")]
    result = run(*names, "--class", CLASS, "--name", "copier", "--by", "A. Tester", "--json")
    assert result.exit_code == 1, result.output  # two of three could not be used
    told = json.loads(result.stdout)
    assert [Path(one["path"]).name for one in told["skipped"]] == ["nothing.png", "broken.jpg"]
    assert told["photos"][0]["size_mm"] == pytest.approx(0.94 * PATCH_MM, rel=0.004)
    assert any("94.0%" in line or "93.9%" in line or "94.1%" in line for line in told["warnings"])
    profile = read_print_profile(lab / "print" / "profiles" / "copier.json")
    assert profile.patch == CLASS and profile.made.by == "A. Tester" and profile.strip_cells == len(STRIP.swatches)
    assert profile.held_out.median < 4 < 8 < profile.without.median  # chroma of a JPEG is coarser than its texels

    wrong = run(names[0], "--class", "racer")
    assert wrong.exit_code != 0 and "'racer' was not found in it" in str(wrong.exception)
    assert "expected letters" in str(run(names[0], "--class", CLASS, "--name", "../x").exception)
