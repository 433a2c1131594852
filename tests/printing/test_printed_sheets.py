"""Several sheets of one object on paper: each true to size on a page of its own, and drawn where it goes."""

import json
import re
from io import BytesIO

import pytest
from printed_pages import make_patch, render
from pypdf import PdfReader
from typer.testing import CliRunner

from toolkit.cli.app import make_single
from toolkit.cli.print_ import print_patches
from toolkit.cli.rig import plan
from toolkit.printing import PrintSettings
from toolkit.printing.document import Wearer, build_pdf, read_page

TWO_TABLES = '[[patch]]\nat = "top"\nsize_mm = 40\n\n[[patch]]\nat = "left"\nsize_mm = 25\nrotation_deg = 90\n'


@pytest.fixture
def space(tmp_path, make_crate_space, monkeypatch):
    space = make_crate_space(tmp_path)
    file = space.objects_dir / "crate.toml"
    file.write_text(file.read_text().partition("[patch]")[0] + TWO_TABLES)
    monkeypatch.chdir(tmp_path)
    return space


def call(command, *arguments):
    return CliRunner().invoke(make_single(command), list(arguments))


def test_every_sheet_is_a_page_at_its_own_size_and_says_which_it_is(tmp_path):
    patch = make_patch(tmp_path, n_px=20)
    document = build_pdf(patch, PrintSettings(), Wearer("mug", ("top", "left"), (60, 35.5)))
    pages = PdfReader(BytesIO(document.content)).pages
    assert len(pages) == 2 and [plan.side_mm for plan in document.plans] == [60, 35.5]
    for index, (side_mm, at, way) in enumerate(((60, "top", "front"), (35.5, "left", "up"))):
        (cut,) = document.plans[index].pages[0].cuts
        page = render(document.content, page=index, dpi=150)
        height = document.plans[index].frame.paper.height_mm
        part = page.cut_out(cut.x + 1, height - cut.top + 1, cut.right - 1, height - cut.y - 4)
        ink = (part.astype(int).max(axis=2) - part.min(axis=2)) > 60
        rows, columns = ink.any(axis=1).nonzero()[0], ink.any(axis=0).nonzero()[0]
        assert (columns[-1] - columns[0] + 1) / page.per_mm == pytest.approx(side_mm, abs=0.5)
        assert (rows[-1] - rows[0] + 1) / page.per_mm == pytest.approx(side_mm, abs=0.5)
        text = " ".join(pages[index].extract_text().split())
        assert f"sheet {index + 1} of 2, page {index + 1} of 2" in text
        assert f"mug, sheet {index + 1} of 2 ({at}) {way}" in text and f"{side_mm:.1f} × {side_mm:.1f} mm" in text


def test_one_sheet_is_the_page_that_it_was(tmp_path):
    """A wearer with one sheet decides nothing but size and name."""
    patch = make_patch(tmp_path, n_px=20)
    document = build_pdf(patch, PrintSettings(), Wearer("mug", ("left",), (35.5,)))
    words = PdfReader(BytesIO(document.content)).pages[0].extract_text()
    assert "sheet 1" not in words and "page 1 of 1" in words and document.plan is document.plans[0]


def test_the_command_prints_all_and_says_so(space):
    done = call(print_patches, "--object", "crate", "--json")
    assert done.exit_code == 0, done.output
    (printed,) = json.loads(done.stdout)["printed"]
    assert [(one["at"], one["size_mm"], one["cut_mm"]) for one in printed["sheets"]] == [
        ("top", 40, 50),
        ("left", 25, 35),
    ]
    assert printed["pages"] == 2 and json.loads(done.stdout)["notes"] == []
    sizes_mm, _ = read_page(space.print_dir / "crate.pdf")
    assert sizes_mm == (40, 25)
    said = " ".join(call(print_patches, "--class", "crate").output.split())
    assert "print/crate.pdf: 2 sheets, 1 on its top 40.0 mm, 2 on its left 25.0 mm, 2 pages of a4" in said
    assert "the rig mounts" not in said
    said = " ".join(call(print_patches, "--class", "crate", "--size-mm", "25").output.split())
    assert "the rig mounts crate on crate at 40.0 and 25.0 mm" in said


def test_a_single_sheets_json_has_no_list(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path)
    done = call(print_patches, "--object", "crate", "--workspace", str(space.root), "--json")
    assert "sheets" not in json.loads(done.stdout)["printed"][0]


def test_a_sheet_that_does_not_lie_is_named(space):
    file = space.objects_dir / "crate.toml"
    file.write_text(file.read_text().replace("size_mm = 25", "size_mm = 46"))
    said = " ".join(call(print_patches, "--object", "crate").output.split())
    assert "crate: sheet 2, a patch of 46 mm does not fit flat on its left" in said


def test_the_shot_list_draws_the_place_of_each(space):
    assert call(print_patches, "--object", "crate", "--quiet").exit_code == 0
    done = call(plan, "--object", "crate", "--shot-list")
    assert done.exit_code == 0 and "print it again" not in done.output, done.output
    first, second, *more = [" ".join(page.extract_text().split()) for page in PdfReader("print/shot_list.pdf").pages]
    assert "stick the 2 sheets of the patch on" in first + " ".join(more)
    assert "take the 2 sheets of the patch off" in first + " ".join(more)
    assert "Where sheet 1 of 2 goes, seen from above" in first and "sheet 50.0 mm patch 40.0 mm" in first
    assert "Where sheet 2 of 2 goes, seen from the left" in second and "sheet 35.0 mm patch 25.0 mm" in second
    assert "turned 90° counter-clockwise" in second and "cut sheet 2 at the corner marks" in second
    assert re.search(r"crate, page 2 of \d", second)
