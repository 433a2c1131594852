"""A wrap's pages and cut files, measured by programs that share no code with what wrote them."""

import io
import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import cv2
import ezdxf
import numpy as np
import pdfplumber
import pypdf
import pypdfium2
import pytest
import shapely
import trimesh
from shapely.affinity import scale as stretch_outline

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.objects.load import load_object
from toolkit.printing import PrintSettings, WrapSettings
from toolkit.rooms.wraps.config import WrapConfig
from toolkit.rooms.wraps.printing.print_wrap import CUT, order_pieces, print_wrap
from toolkit.rooms.wraps.printing.wrap_words import place_numbers, smooth_outline
from toolkit.rooms.wraps.wrap import BLEED_MM, read_wrap, write_wrap
from toolkit.rooms.wraps.wrap_plan import plan_wrap

MM_PER_INCH = 25.4


@pytest.fixture(scope="module")
def space(tmp_path_factory):
    """A ring, 110 mm across, whose ends have holes, with a wrap in saturated colours that no word or mark has."""
    space = make_workspace(tmp_path_factory.mktemp("space"))
    ring = trimesh.creation.annulus(25, 55, 40, sections=64)
    ring.export(space.objects_dir / "ring.obj")
    (space.objects_dir / "ring.toml").write_text(
        'class = "ring"\nmesh = "ring.obj"\nlength_mm = 110\nup = "z"\nfront = "x"\n'
    )
    item = load_object(space.object_spec("ring"))
    wrap = getattr(plan := plan_wrap(item, WrapConfig(pieces=8, views=16, texel_mm=2.0)), "wrap", plan)
    n = wrap.record.n_px
    rng = np.random.default_rng(1)
    pixels = np.zeros((n, n, 3), np.uint8)
    pixels[..., 1] = 255
    pixels[..., :2] = np.stack([rng.integers(0, 60, (n, n)), rng.integers(140, 256, (n, n))], axis=-1)
    write_wrap(space.wraps_dir / "ring", replace(wrap, pixels=pixels))
    return space


@pytest.fixture(scope="module")
def wrap(space):
    return read_wrap(space.wrap("ring"))


@pytest.fixture(scope="module")
def printed(space):
    return print_wrap(space, "ring", wanted=WrapSettings(cut="dxf"))


def raster(printed, page, dpi):
    """(h, w, 3) uint8 pixels of a page, counted from 1."""
    with_page = pypdfium2.PdfDocument(printed.file)[page - 1]
    return np.asarray(with_page.render(scale=dpi / 72).to_pil().convert("RGB"))


def outlines_on_pages(wrap, printed):
    found = {}
    for one in printed.placed:
        outline = wrap.pieces[one.number - 1].outline()
        found[one.number] = (one.page, shapely.transform(outline, one.to_page))
    return found


@pytest.mark.slow
def test_every_edge_is_where_the_flat_piece_has_it(wrap, printed, tmp_path):
    """The cut line alone, drawn at 600 dpi, is within 0.2 mm of the outlines, and runs along all of them."""
    outlines = outlines_on_pages(wrap, printed)
    per_mm = 600 / MM_PER_INCH
    for page in {page for page, _ in outlines.values()}:
        pixels = raster(printed, page, 600).astype(int)
        magenta = (pixels[..., 1] < 80) & (pixels[..., 0] > 150) & (pixels[..., 2] > 90)
        rows, columns = np.nonzero(magenta)
        places = np.stack([(columns + 0.5) / per_mm, (len(pixels) - rows - 0.5) / per_mm], axis=1)
        edges = shapely.union_all([outline.boundary for at, outline in outlines.values() if at == page])
        assert shapely.distance(edges, shapely.points(places)).max() < 0.2
        spots = shapely.points(shapely.get_coordinates(shapely.segmentize(edges, 1.0)))
        far = cv2.distanceTransform((~magenta).astype(np.uint8), cv2.DIST_L2, 5)
        x, y = shapely.get_coordinates(spots).T
        at = far[(len(pixels) - y * per_mm).astype(int), (x * per_mm).astype(int)] / per_mm
        assert at.max() < 0.2


def test_the_flattened_triangles_fill_the_printed_outline(wrap, printed):
    """The outline is the triangles' own; the areas of all pieces are what the record says is covered."""
    total = 0.0
    for record, piece in zip(wrap.record.pieces, wrap.pieces, strict=True):
        outline = piece.outline()
        area = sum(shapely.Polygon(corners).area for corners in piece.flat_mm)
        assert outline.area == pytest.approx(area, rel=1e-3)
        total += outline.area
        assert shapely.Polygon(record.outline_mm[0], record.outline_mm[1:]).area == pytest.approx(
            outline.area, rel=1e-4
        )
    assert len({one.number for one in printed.placed}) == len(wrap.pieces)


def test_areas_add_up_to_what_is_covered(space, wrap):
    item = load_object(space.object_spec("ring"))
    corners = item.mesh.vertices[item.mesh.faces].astype(float)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    covered = wrap.record.covered_surface * area.sum()
    assert sum(piece.outline().area for piece in wrap.pieces) == pytest.approx(covered, rel=0.005)


def test_no_piece_lies_on_another_nor_off_the_page(wrap, printed):
    outlines = outlines_on_pages(wrap, printed)
    for (one, (page, first)), (other, (at, second)) in combinations(outlines.items(), 2):
        if page == at:
            assert first.buffer(BLEED_MM).distance(second.buffer(BLEED_MM)) > 0.5, (one, other)
    for page, outline in outlines.values():
        width, height = printed.sizes_mm[page - 1]
        assert shapely.box(10, 10, width - 10, height - 10).contains(outline.buffer(BLEED_MM))


def test_the_page_read_back_by_the_map_is_the_canvas(wrap, printed):
    """At 150 dpi, away from cuts and folds; and no texel is on the pages twice but in the bleed."""
    per_mm, record = 150 / MM_PER_INCH, wrap.record
    pages = {one.page: raster(printed, one.page, 150) for one in printed.placed}
    seen = np.zeros((record.n_px, record.n_px), int)
    difference = []
    for one, piece, at in zip(printed.placed, wrap.pieces, record.pieces, strict=True):
        low = np.array(at.origin_px)
        size = np.ceil(np.array([at.width_mm, at.height_mm]) / record.texel_mm).astype(int)
        column, row = np.meshgrid(*(np.arange(start, start + side) for start, side in zip(low, size, strict=True)))
        flat = (np.stack([column, row], axis=-1) + 0.5 - low) * record.texel_mm
        inside = shapely.contains_xy(piece.outline(), flat[..., 0], flat[..., 1])
        seen[record.n_px - 1 - row[inside], column[inside]] += 1
        marked = [piece.outline().boundary, *(shapely.LineString(fold) for fold in at.folds_mm)]
        clear = inside & (shapely.distance(shapely.union_all(marked), shapely.points(flat)) > 0.4)
        x, y = np.moveaxis(one.to_page(flat[clear]) * per_mm, -1, 0)
        page = pages[one.page]
        found = page[(len(page) - y).astype(int), x.astype(int)].astype(int)
        truth = wrap.pixels[record.n_px - 1 - row[clear], column[clear]].astype(int)
        difference.append(np.abs(found - truth))
    assert seen.max() == 1
    assert np.concatenate(difference).mean() < 2
    assert len(np.concatenate(difference)) > 2000


@pytest.mark.slow
def test_bleed_reaches_past_the_cut_and_no_further(wrap, printed):
    """Green is on the page as far as 1.5 mm outside the outlines."""
    per_mm = 300 / MM_PER_INCH
    outlines = outlines_on_pages(wrap, printed)
    for page in {page for page, _ in outlines.values()}:
        pixels = raster(printed, page, 300).astype(int)
        green = (pixels[..., 1] > 120) & (pixels[..., 0] < 90) & (pixels[..., 2] < 90)
        whole = shapely.union_all([outline for at, outline in outlines.values() if at == page])
        rows, columns = np.nonzero(green)
        places = shapely.points((columns + 0.5) / per_mm, (len(pixels) - rows - 0.5) / per_mm)
        away = shapely.distance(whole, places)
        assert away.max() == pytest.approx(BLEED_MM, abs=0.15)


def test_the_cut_line_is_a_spot_colour_on_a_layer_of_its_own(printed):
    reader = pypdf.PdfReader(printed.file)
    groups = [group.get_object()["/Name"] for group in reader.trailer["/Root"]["/OCProperties"]["/OCGs"]]
    assert groups == [CUT] == ["CutContour"]
    numbers = {one.page for one in printed.placed}
    for number, page in enumerate(reader.pages, start=1):
        spaces = [space.get_object() for space in page["/Resources"].get("/ColorSpace", {}).values()]
        assert number not in numbers or "/CutContour" in [space[1] for space in spaces if space[0] == "/Separation"]
        content = page.get_contents().get_data().decode("latin-1")
        layers = re.findall(r"/OC /(\w+) BDC(.*?)EMC", content, re.DOTALL)
        assert len(layers) == sum(one.page == number for one in printed.placed)
        if layers:
            marked = page["/Resources"]["/Properties"]["/CutContour"].get_object()
            assert (marked["/Type"], marked["/Name"]) == ("/OCG", "CutContour")
        # strokes alone, in that ink and no other
        assert all(re.search(r"\bSCN\b", drawn) and " S" in drawn and " f" not in drawn for _, drawn in layers)


def test_the_layer_can_be_hidden(printed):
    """With the layer off, no magenta is left."""
    writer = pypdf.PdfWriter(clone_from=printed.file)
    settings = writer.root_object["/OCProperties"]["/D"]
    settings[pypdf.generic.NameObject("/OFF")] = settings.pop("/ON")
    hidden = io.BytesIO()
    writer.write(hidden)
    page = pypdfium2.PdfDocument(hidden.getvalue())[printed.placed[0].page - 1]
    pixels = np.asarray(page.render(scale=2).to_pil().convert("RGB")).astype(int)
    assert not ((pixels[..., 0] - pixels[..., 1] > 60) & (pixels[..., 2] - pixels[..., 1] > 60)).any()


def read_dxf(file):
    document = ezdxf.readfile(file)
    assert document.header["$INSUNITS"] == 4  # millimetres
    found = {}
    for name, group in document.groups:
        rings = [np.array(line.get_points("xy")) for line in group]
        assert all(line.closed and line.dxf.layer == CUT for line in group)
        found[int(name.removeprefix("piece-"))] = shapely.Polygon(rings[0], rings[1:])
    return found


def read_svg(file):
    text = Path(file).read_text()
    height = float(re.search(r'height="([\d.]+)mm"', text)[1])
    found = {}
    for number, path in re.findall(r'<path id="piece-(\d+)" d="([^"]+)"', text):
        rings = [
            np.array([tuple(map(float, point.split(","))) for point in re.findall(r"[-\d.]+,[-\d.]+", turn)])
            for turn in path.split("Z") if turn.strip()
        ]  # fmt: skip
        found[int(number)] = stretch_outline(shapely.Polygon(rings[0], rings[1:]), 1, -1, origin=(0, height / 2))
    return found


@pytest.mark.parametrize(("kind", "read"), [("dxf", read_dxf), pytest.param("svg", read_svg, marks=pytest.mark.slow)])
def test_cut_files_hold_the_outlines_of_the_record(space, wrap, printed, kind, read, tmp_path):
    if kind != "dxf":
        printed = print_wrap(space, "ring", wanted=WrapSettings(cut=kind), out=tmp_path)
    found = {}
    for file in printed.cut_files:
        found |= read(file)
    assert sorted(found) == [one.number for one in wrap.record.pieces]
    for one, record in zip(printed.placed, wrap.record.pieces, strict=True):
        truth = shapely.Polygon(
            one.to_page(np.array(record.outline_mm[0])), [one.to_page(np.array(ring)) for ring in record.outline_mm[1:]]
        )
        assert shapely.hausdorff_distance(found[one.number], truth) < 0.001
        assert found[one.number].symmetric_difference(truth).area < 1e-4 * truth.length


@pytest.mark.slow
def test_the_same_wrap_gives_the_same_bytes(space, printed, tmp_path):
    again = print_wrap(space, "ring", wanted=WrapSettings(cut="dxf"), out=tmp_path)
    for one, other in zip((printed.file, *printed.cut_files), (again.file, *again.cut_files), strict=True):
        assert Path(one).read_bytes() == Path(other).read_bytes()


def test_outlines_of_an_earlier_print_are_named(space, tmp_path, capsys):
    """On smaller paper the same pieces take more pages: their outlines would be cut as well."""
    small = print_wrap(space, "ring", PrintSettings(paper="a5"), WrapSettings(cut="svg"), tmp_path)
    assert "earlier print" not in capsys.readouterr().err
    large = print_wrap(space, "ring", PrintSettings(paper="a2"), WrapSettings(cut="svg"), tmp_path)
    left = [Path(file).name for file in small.cut_files if file not in large.cut_files]
    assert left and f"{', '.join(left)}: outlines of an earlier print" in " ".join(capsys.readouterr().err.split())
    print_wrap(space, "ring", PrintSettings(paper="a2"), WrapSettings(cut="dxf"), tmp_path)
    assert "ring-wrap-2.svg" in capsys.readouterr().err


@pytest.fixture(scope="module")
def net(tmp_path_factory):
    """A printed net of a box of bluish green, and its wrap."""
    space = make_workspace(tmp_path_factory.mktemp("net"))
    trimesh.creation.box((60, 40, 30)).export(space.objects_dir / "box.obj")
    (space.objects_dir / "box.toml").write_text('class = "box"\nmesh = "box.obj"\nlength_mm = 60\n')
    wrap = plan_wrap(load_object(space.object_spec("box")), WrapConfig(net=True, views=8, texel_mm=1.0))
    wrap = write_wrap(space.wraps_dir / "box", replace(wrap, pixels=np.full_like(wrap.pixels, (0, 200, 90))))
    return print_wrap(space, "box", wanted=WrapSettings(cut="svg")), wrap


def test_the_tabs_of_a_net_are_printed_and_cut_out_with_it(net):
    printed, wrap = net
    pixels, per_mm = raster(printed, 2, 150), 150 / MM_PER_INCH
    cut = read_svg(printed.cut_files[0])
    for one in printed.placed:
        record = wrap.record.pieces[one.number - 1]
        tabs = [shapely.Polygon(one.to_page(np.array(tab.outline_mm))) for tab in record.tabs]
        assert tabs and cut[one.number].area == pytest.approx(record.area_mm2 + sum(tab.area for tab in tabs), rel=1e-4)
        for tab in tabs:
            inner, bleed = tab.buffer(-1).exterior, tab.buffer(BLEED_MM - 0.5).exterior
            outside = [spot for spot in bleed.coords if cut[one.number].distance(shapely.Point(spot)) > 0.4]
            assert len(outside) > 4
            for x, y in [*inner.coords, *outside]:
                seen = pixels[round(len(pixels) - y * per_mm), round(x * per_mm)].astype(int)
                assert np.abs(seen - (0, 200, 90)).max() < 12, (seen, x, y)


@pytest.fixture(scope="module")
def by_hand(space, tmp_path_factory):
    return print_wrap(space, "ring", out=tmp_path_factory.mktemp("hand"))


def test_scissors_get_a_black_line_in_a_white_one_and_no_layer(wrap, by_hand):
    """Along the outline black, beside it white to 0.5 mm, and the picture beyond."""
    per_mm = 600 / MM_PER_INCH
    assert "CutContour" not in pypdf.PdfReader(by_hand.file).pages[1].extract_text()
    assert "/OCProperties" not in pypdf.PdfReader(by_hand.file).trailer["/Root"]
    one = by_hand.placed[0]
    outline = shapely.transform(smooth_outline(wrap.pieces[one.number - 1].outline()), one.to_page)
    marked = [
        shapely.transform(shapely.LineString(fold), one.to_page) for fold in wrap.record.pieces[one.number - 1].folds_mm
    ]
    pixels = raster(by_hand, one.page, 600).astype(int)

    def look(ring):
        spots = shapely.get_coordinates(shapely.segmentize(ring, 2.0))
        clear = [spot for spot in spots if all(shapely.Point(spot).distance(line) > 1 for line in marked)]
        x, y = (np.array(clear) * per_mm).T
        return pixels[(len(pixels) - y).astype(int), x.astype(int)]

    assert np.mean(look(outline.exterior).max(axis=1) < 80) > 0.95
    assert np.mean(look(outline.buffer(0.33).exterior).min(axis=1) > 200) > 0.9
    green = look(outline.buffer(-0.8).exterior)
    assert np.mean((green[:, 1] > 120) & (green[:, 0] < 90)) > 0.9


def test_the_pages_say_where_the_order_stands_and_that_nothing_was_trained(by_hand, printed):
    first, second = (pypdf.PdfReader(by_hand.file).pages[page].extract_text() for page in (0, 1))
    assert "NOT TRAINED" in first and "NOT TRAINED" in second
    assert "Page 1 lists the order" in second and "black line" in second
    assert "not trained" in by_hand.describe() and not by_hand.is_trained
    assert "CutContour" in pypdf.PdfReader(printed.file).pages[1].extract_text()


def test_teeth_go_and_straight_edges_and_darts_stay():
    """A comb of 1 mm teeth on a rectangle with a dart, 1 mm wide and 20 mm long."""
    teeth = [(60 - x, 30 + (2 if k % 2 else 0)) for k, x in enumerate(np.arange(0, 20, 0.5))]
    comb = shapely.Polygon([(0, 0), (60, 0), (60, 30), *teeth, (40, 30), (0, 30)])
    dart = shapely.Polygon([(20, 0), (21, 0), (20.5, 20)])
    outline = comb.difference(dart)
    smooth = smooth_outline(outline)
    assert len(shapely.get_coordinates(smooth)) < 16 < len(shapely.get_coordinates(outline))
    assert smooth.intersection(dart.buffer(-0.1)).area < 0.5 * dart.buffer(-0.1).area
    assert shapely.hausdorff_distance(smooth.exterior, outline.exterior) < 2.1
    plain = shapely.box(0, 0, 50, 30)
    assert smooth_outline(plain).symmetric_difference(plain).area < 1e-6


def test_numbers_find_paper_on_a_crowded_page_or_none():
    page = shapely.box(0, 0, 100, 100)
    pieces = [shapely.box(0, 0, 100, 40), shapely.box(0, 46, 100, 100)]
    first, second = place_numbers(page, pieces, [14.0, 14.0])
    assert first is not None and second is not None and abs(first[0] - second[0]) >= 14
    assert all(40 < y < 46 for _, y in (first, second))
    assert place_numbers(page, [page], [14.0]) == [None]


@pytest.mark.slow
def test_a_roll_takes_all_pieces_on_one_length(space, wrap, tmp_path):
    printed = print_wrap(space, "ring", wanted=WrapSettings(roll_mm=600), out=tmp_path)
    assert printed.pages == 2
    assert "of a roll, 2 pages" in printed.describe()
    width, height = pypdfium2.PdfDocument(printed.file)[1].get_size()
    assert width / 72 * MM_PER_INCH == pytest.approx(600)
    tops = [outline.bounds[3] for _, outline in outlines_on_pages(wrap, printed).values()]
    assert height / 72 * MM_PER_INCH < max(max(tops), 100) + 60


@pytest.mark.slow
def test_a_piece_larger_than_the_page_is_tiled(space, wrap, tmp_path):
    printed = print_wrap(space, "ring", PrintSettings(paper="135x135mm"), out=tmp_path)
    tiled = [one for one in printed.placed if one.tiles != (1, 1)]
    assert tiled
    assert f"piece {tiled[0].number} in" in printed.describe()
    assert printed.pages == len(pypdfium2.PdfDocument(printed.file))


def test_what_it_cannot_do_is_one_clear_line(space, tmp_path):
    for settings, words in ((PrintSettings(copies=2), "copies"), (PrintSettings(size_mm=50.0), "size_mm")):
        with pytest.raises(ToolkitError, match=words):
            print_wrap(space, "ring", settings)
    with pytest.raises(ToolkitError, match="no wrap called 'rong'"):
        print_wrap(space, "rong")
    with pytest.raises(ToolkitError, match="no wrap called 'ring': known: coffeepot"):
        print_wrap(make_workspace(tmp_path), "ring")


def test_pieces_are_stuck_on_beside_those_that_are_there(wrap):
    order = order_pieces(wrap.record.pieces)
    assert sorted(order) == [one.number for one in wrap.record.pieces]
    seams = {one.number: {seam.piece for seam in one.seams} - {one.number} for one in wrap.record.pieces}
    reached = {order[0]}
    for number in order[1:]:
        neighbours = {other for one in reached for other in seams[one]} - reached
        assert not neighbours or number in neighbours
        reached.add(number)


def test_the_first_page_numbers_every_piece_and_holds_the_strip(printed, wrap):
    text = pypdf.PdfReader(printed.file).pages[0].extract_text()
    for one in wrap.record.pieces:
        assert f"piece {one.number}" in text
    assert "toolkit knows these colours" in text
    assert all(side in text for side in ("front", "left", "back", "right", "top", "bottom"))
    assert wrap.record.map_sha256[:12] in text


def test_every_piece_has_its_number_beside_it(printed, wrap):
    """In bold digits of 4 mm or more, upright, off all pictures."""
    outlines = outlines_on_pages(wrap, printed)
    with pdfplumber.open(printed.file) as pdf:
        for one in printed.placed:
            page = pdf.pages[one.page - 1]
            (mark,) = [
                char for char in page.chars
                if char["text"] == str(one.number) and "Bold" in char["fontname"]
                and char["upright"] and 0.72 * char["size"] / 72 * MM_PER_INCH >= 4
            ]  # fmt: skip
            left, low, right, high = (mark[side] / 72 * MM_PER_INCH for side in ("x0", "y0", "x1", "y1"))
            middle = shapely.Point((left + right) / 2, (low + high) / 2)
            row = shapely.box(left, low, left + 14, high)  # number, arrow and word
            assert outlines[one.number][1].distance(row) < 8
            assert all(outline.distance(middle) > BLEED_MM for at, outline in outlines.values() if at == one.page)
