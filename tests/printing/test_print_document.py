"""What the PDF says of itself and to its reader, read by pypdf and pdfplumber."""

import itertools
import time
from dataclasses import replace
from io import BytesIO

import numpy as np
import pdfplumber
import pytest
from printed_pages import make_patch, make_pixels, render
from pypdf import PdfReader

from toolkit.objects.records import Patch
from toolkit.printing import PrintSettings
from toolkit.printing.canvas import PLAIN, _cut, measure_text_mm
from toolkit.printing.document import build_pdf
from toolkit.printing.page import parse_paper


@pytest.fixture(scope="module")
def patch(tmp_path_factory):
    return make_patch(tmp_path_factory.mktemp("patch"), n_px=20)


def words_of(content, page=0):
    with pdfplumber.open(BytesIO(content)) as pdf:
        return pdf.pages[page].extract_text()


def test_reader_is_asked_for_true_size(patch):
    wishes = PdfReader(BytesIO(build_pdf(patch, PrintSettings()).content)).root_object["/ViewerPreferences"]
    assert wishes["/PrintScaling"] == "/None"
    assert wishes["/Duplex"] == "/Simplex"
    assert wishes["/PickTrayByPDFSize"].value is True


def test_metadata_names_class_size_and_pixels(patch):
    from toolkit import __version__

    reader = PdfReader(BytesIO(build_pdf(patch, PrintSettings()).content))
    info = reader.metadata
    assert info.title == "warplane patch, 17.6 mm"
    assert info.creator == f"toolkit {__version__}"
    assert "250 %" in info.subject
    for words in ("class=warplane", "size_mm=17.639", "n_px=20", f"patch_sha256={patch.record.png_sha256}"):
        assert words in info["/Keywords"]
    assert "/CreationDate" not in info
    assert "/ModDate" not in info


def test_fonts_are_embedded_and_colours_are_srgb(patch):
    page = PdfReader(BytesIO(build_pdf(patch, PrintSettings()).content)).pages[0]
    used = {name.split()[0] for name in page.get_contents().get_data().decode("latin-1").split("/")[1:]}
    fonts = [font for name, font in page["/Resources"]["/Font"].items() if name[1:] in used]
    assert fonts
    assert all("/FontFile2" in font["/FontDescriptor"] for font in fonts)
    (form,) = page["/Resources"]["/XObject"].values()
    kind, profile = form["/Resources"]["/ColorSpace"]["/DefaultRGB"]
    assert kind == "/ICCBased"
    assert profile.get_object()["/N"] == 3
    assert b"sRGB" in profile.get_object().get_data().replace(b"\0", b"")


def test_label(patch):
    words = words_of(build_pdf(patch, PrintSettings()).content)
    for part in (
        "warplane",
        "17.6 × 17.6 mm",
        "250 % of 20 × 20 px at 72 dpi",
        patch.record.png_sha256[:12],
        "front",
        "100 mm",
        "actual size",
        "a4 portrait, page 1 of 1",
    ):
        assert part in words


@pytest.mark.slow
def test_tiles_are_named_and_mapped(patch):
    document = build_pdf(patch, PrintSettings(size_mm=300, copies=2))
    reader = PdfReader(BytesIO(document.content))
    rows, columns = document.plan.tiles
    assert len(reader.pages) == 1 + 2 * rows * columns
    first = words_of(document.content)
    assert f"{rows} rows × {columns} columns" in first
    assert all(name in first for name in ("A1", "A2", "B1", "B2"))
    assert "tile A1 of copy 1" in words_of(document.content, 1)
    assert "tile B2 of copy 2" in words_of(document.content, 2 * rows * columns)


@pytest.mark.parametrize(("copies", "pages"), [(1, 1), (2, 1), (3, 2), (5, 3)])
def test_copies_are_packed(patch, copies, pages):
    """Two patches of 85 mm (sheets of 95 mm) fit on A4, one above the other."""
    content = build_pdf(patch, PrintSettings(size_mm=85, copies=copies)).content
    reader = PdfReader(BytesIO(content))
    assert len(reader.pages) == pages
    shown = sum(page.get_contents().get_data().count(b" Do") for page in reader.pages)
    assert shown == copies


def test_same_patch_same_bytes(patch):
    settings = PrintSettings(paper=parse_paper("letter"), size_mm=250)
    first = build_pdf(patch, settings).content
    assert build_pdf(patch, settings).content == first
    other = Patch(make_pixels(20, seed=1), patch.record)
    assert build_pdf(other, settings).content != first


def test_words_do_not_touch_each_other_or_the_bars(tmp_path):
    long = "a-very-long-name-for-a-category-that-nobody-would-want-to-read-on-paper"
    patch = make_patch(tmp_path, name="short", n_px=20, class_name=long)
    content = build_pdf(patch, PrintSettings(paper=parse_paper("135x135mm"), size_mm=20)).content
    with pdfplumber.open(BytesIO(content)) as pdf:
        words = pdf.pages[0].filter(lambda thing: thing.get("upright", True)).extract_words()
    assert len(words) > 50
    for a, b in itertools.combinations(words, 2):
        across = min(a["x1"], b["x1"]) - max(a["x0"], b["x0"])
        down = min(a["bottom"], b["bottom"]) - max(a["top"], b["top"])
        assert min(across, down) < 0.3, (a["text"], b["text"])
    millimetre = 72 / 25.4
    assert max(word["x1"] for word in words) <= 125 * millimetre + 0.1
    assert min(word["x0"] for word in words if word["top"] < 33 * millimetre) >= 17 * millimetre


def test_names_in_other_alphabets(tmp_path):
    patch = make_patch(tmp_path, name="patch", n_px=20, class_name="кофейник 水")
    document = build_pdf(patch, PrintSettings())
    assert "кофейник ?" in words_of(document.content)
    assert PdfReader(BytesIO(document.content)).metadata.title == "кофейник 水 patch, 17.6 mm"


def test_very_long_words_are_cut_in_a_moment():
    """Letters went one by one, each time over the whole line; the same line stands there."""
    started = time.process_time()
    for text in ("x" * 1_000_000, "w i" * 300, "ab", "a"):
        for room_mm in (0.1, 1.0, 30.0):
            shown = _cut(text, PLAIN, 1.2, room_mm)
            kept = shown.removesuffix("…")
            assert text.startswith(kept) and (shown == text or len(kept) <= len(text) - 2)
            assert len(shown) == 1 or measure_text_mm(shown, PLAIN, 1.2) <= room_mm * 1.0001
            longer = f"{text[: len(kept) + 1]}…"
            assert shown == text or len(kept) == len(text) - 2 or measure_text_mm(longer, PLAIN, 1.2) > room_mm * 1.0001
    assert time.process_time() - started < 20


def test_a_margin_that_is_printed_is_mirrored_up_to_the_cut_line(patch):
    # 5 mm of margin are 2.5 texels of 2 mm
    white, bleed = (
        render(build_pdf(patch, PrintSettings(size_mm=40.0, margin=margin)).content, dpi=150)
        for margin in ("white", "bleed")
    )
    left, low, right, high = white.box_mm(white.coloured)
    wide = bleed.box_mm(bleed.coloured)
    assert (right - left, wide[2] - wide[0], wide[3] - wide[1]) == pytest.approx((40, 50, 50), abs=0.5)
    middle = (low + high) / 2
    beside, inside = (bleed.cut_out(left + at - 0.3, middle + 0.7, left + at + 0.3, middle + 1.3) for at in (-1, 1))
    np.testing.assert_allclose(beside.mean(axis=(0, 1)), inside.mean(axis=(0, 1)), atol=3)
    recorded = replace(patch, record=patch.record.model_copy(update={"margin": "bleed"}))
    assert build_pdf(recorded, PrintSettings(size_mm=40.0)).plan.margin == "bleed"
    assert build_pdf(recorded, PrintSettings(size_mm=40.0, margin="white")).plan.margin == "white"
