"""The object's spec says how large its patch is: page, rig, shot list and gates agree, and say where they do not."""

import json
import re
from io import BytesIO

import numpy as np
import pytest
from printed_pages import make_patch, render
from pypdf import PdfReader
from typer.testing import CliRunner

from toolkit.cli.app import make_single
from toolkit.cli.print_ import print_patches
from toolkit.cli.rig import plan
from toolkit.core.errors import FieldError
from toolkit.objects.load import load_object
from toolkit.objects.spec import read_spec
from toolkit.printing import PrintSettings
from toolkit.printing.document import Wearer, build_pdf, read_page
from toolkit.printing.print_patches import choose_wearer
from toolkit.rig.variants import find_booster
from toolkit.rooms.photos.gates.check_captures import printed_sides
from toolkit.rooms.photos.gates.check_set import CheckedPhoto, PatchLines


def call(command, *arguments):
    return CliRunner().invoke(make_single(command), list(arguments))


@pytest.fixture
def space(tmp_path, make_crate_space, monkeypatch):
    """An object `crate` whose spec states 40 mm for a patch of 12 px, which is 10.6 mm at 250 % of 72 dpi."""
    space = make_crate_space(tmp_path)
    monkeypatch.chdir(tmp_path)
    return space


def add_object(space, name, class_name, size_mm):
    spec = (space.objects_dir / "crate.toml").read_text().replace('"crate"\nc', f'"{name}"\nc')
    spec = re.sub(r'class = "\w+"', f'class = "{class_name}"', spec)
    (space.objects_dir / f"{name}.toml").write_text(re.sub(r"size_mm = \d+", f"size_mm = {size_mm}", spec))


def test_page_rig_shot_list_and_gates_read_one_size(space):
    assert call(print_patches, "--class", "crate", "--quiet").exit_code == 0
    page = render((space.print_dir / "crate.pdf").read_bytes(), dpi=150)
    inked = (np.ptp(page.pixels.astype(int), axis=2) > 60)[: round(200 * page.per_mm)]  # the strip lies below
    left, _, right, _ = page.box_mm(inked)
    assert right - left == pytest.approx(40, abs=0.4)

    item = load_object(space.object_spec("crate"))
    assert find_booster(space, item, "patched").sizes_mm == (40,)
    lines = PatchLines(np.zeros(3), np.zeros((25, 3)), np.ones(25, bool))
    assert printed_sides(space, [CheckedPhoto("crate", "patched", 1, lines=lines)]) == {("crate", "patched"): (40,)}

    result = call(plan, "--object", "crate", "--shot-list")
    assert result.exit_code == 0 and "print it again" not in result.output, result.output
    words = PdfReader(space.print_dir / "shot_list.pdf").pages[0].extract_text()
    assert "sheet 50.0 mm" in words and "patch 40.0 mm" in words and "Print print/crate.pdf at 100 %" in words


def test_the_shot_list_says_that_a_page_is_of_another_size(space):
    call(print_patches, "--class", "crate", "--size-mm", "30", "--quiet")
    result = call(plan, "--object", "crate", "--shot-list")
    assert "print/crate.pdf is 30.0 mm, the rig mounts crate on crate at 40.0 mm" in " ".join(result.output.split())
    words = " ".join(PdfReader(space.print_dir / "shot_list.pdf").pages[0].extract_text().split())
    assert "toolkit print --object crate" in words and "Print print/crate.pdf" not in words


def test_a_patch_that_two_objects_wear_is_printed_for_each(space):
    make_patch(space.patches_dir, "crates", 20, class_name="crate")
    add_object(space, "big", "crates", 45)
    add_object(space, "small", "crates", 20)
    printed = json.loads(call(print_patches, "--class", "crates", "--json").stdout)
    assert [(one["object"], one["size_mm"]) for one in printed["printed"]] == [("big", 45), ("small", 20)]
    assert printed["notes"] == [] and not (space.print_dir / "crates.pdf").exists()
    with pytest.raises(FieldError, match=r"worn in different sizes \(big 45.0 mm, small 20.0 mm\): give"):
        choose_wearer(space, space.patch("crates"))
    result = call(print_patches, "--class", "crates", "--out", "x.pdf")
    assert "one file for 2 pages (big, small): name a folder, or one object" in str(result.exception)
    printed = json.loads(call(print_patches, "--object", "small", "--json").stdout)["printed"]
    assert [(one["object"], one["size_mm"], one["file"]) for one in printed] == [
        ("small", 20, str(space.print_dir / "small.pdf"))
    ]
    assert "36.0 × 36.0 mm" in call(print_patches, "--class", "crates", "--size-mm", "36").output


def test_another_object_of_the_class_leaves_the_first_ones_page_as_it_was(space):
    """The shipped patch 'coffeepot' is the built-in coffeepot's too, at 88 mm."""
    call(print_patches, "--all")
    before = (space.print_dir / "coffeepot.pdf").read_bytes()
    add_object(space, "moka", "coffeepot", 45)
    result = call(print_patches, "--all")
    assert "print/moka.pdf: 45.0 × 45.0 mm" in result.output and "the rig mounts" not in result.output
    assert (space.print_dir / "coffeepot.pdf").read_bytes() == before


@pytest.mark.parametrize(("at", "way"), [("top", "front"), ("left", "up")])
def test_name_and_arrow_stay_on_the_sheet_that_is_cut_out(tmp_path, at, way):
    patch = make_patch(tmp_path, n_px=20)
    document = build_pdf(patch, PrintSettings(), Wearer("moka-pot", (at,), (40,)))
    (cut,) = document.plan.pages[0].cuts
    inside = []

    def keep(text, transform, matrix, *_):
        x, y = transform[0] * matrix[4] + transform[4], transform[3] * matrix[5] + transform[5]
        x, y = x / 72 * 25.4, y / 72 * 25.4
        if cut.x < x < cut.right and cut.y < y < cut.y + document.plan.margin_mm:
            inside.append(text.strip())

    PdfReader(BytesIO(document.content)).pages[0].extract_text(visitor_text=keep)
    assert " ".join(" ".join(inside).split()) == f"moka-pot {way}"
    page = render(document.content, dpi=300)
    strip = page.cut_out(cut.x, 297 - cut.y - 5, cut.right, 297 - cut.y)
    dark = strip.max(2) < 140
    assert dark.any() and not dark[: round(0.8 * page.per_mm)].any()  # clear of the patch
    assert not dark[-round(0.8 * page.per_mm) :].any()  # and of the cut
    below = page.cut_out(cut.x + 8, 297 - cut.y + 0.5, cut.right - 8, 297 - cut.y + 9)
    assert (below > 200).all()  # nothing that is cut away


def test_a_sheet_without_a_margin_has_the_words_below(tmp_path):
    document = build_pdf(make_patch(tmp_path, n_px=20), PrintSettings(margin_mm=0), Wearer("moka", ("top",), (40,)))
    assert "moka   front" in PdfReader(BytesIO(document.content)).pages[0].extract_text()


def test_read_page_reads_what_print_states(space):
    call(print_patches, "--object", "crate", "--quiet")
    sizes_mm, sha256 = read_page(space.print_dir / "crate.pdf")
    item = load_object(space.object_spec("crate"))
    assert (sizes_mm, sha256) == ((40,), find_booster(space, item, "patched").sha256)
    assert read_page(space.print_dir / "none.pdf") is None
    assert read_spec(space.object_spec("crate")).mounts[0].size_mm == 40
