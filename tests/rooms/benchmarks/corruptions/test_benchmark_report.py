"""The results folder: files, what the page says, and that it needs nothing but itself."""

import csv
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest
from made_answers import make_benchmark
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.rooms.benchmarks.corruptions.benchmark_means import summarise
from toolkit.rooms.benchmarks.corruptions.benchmark_run import write_benchmark
from toolkit.rooms.benchmarks.corruptions.benchmark_summary import build_summary_table, judge_benchmark, read_summary

VOID = {"meta", "img", "br", "rect", "circle", "link", "input"}


class Page(HTMLParser):
    """Text and addresses of a page; fails where tags do not match."""

    def __init__(self, html):
        super().__init__()
        self.open, self.words, self.addresses = [], [], []
        self.feed(html)
        assert not self.open, self.open

    def handle_starttag(self, tag, attributes):
        if tag not in VOID:
            self.open.append(tag)
        self.addresses += [value for name, value in attributes if name in ("src", "href")]

    def handle_endtag(self, tag):
        assert tag in VOID or self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    cells = [("gaussian_noise", 1), ("gaussian_noise", 2), ("fog", 1), ("fog", 2), ("spatter", 1), ("spatter", 2)]
    benchmark = make_benchmark(
        n=24, n_classes=6, cells=cells, variants=("unpatched", "qr-100"), fixed=False, name="try <1>",
        failed=(("a/<img src=x>.png", "no image & no file"),), notes=("frost is <b>drawn</b>",),
    )  # fmt: skip
    return benchmark, write_benchmark(tmp_path_factory.mktemp("runs") / "one", benchmark)


@pytest.mark.slow
def test_all_files_and_none_besides(made):
    benchmark, files = made
    folder = files.summary.parent
    assert sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file()) == sorted(
        ["cells.csv", "report.html", "summary.json"] + [file.relative_to(folder).as_posix() for file in files.figures]
    )
    assert len(files.figures) == 1 + 2 + 3
    for file in files.figures:
        with Image.open(file) as picture:
            picture.load()
            assert picture.format == "PNG"
    read, made_of = (
        {name: value for name, value in vars(found).items() if not name.endswith("_sha256")}
        for found in (read_summary(files.summary), summarise(benchmark))
    )
    assert read == made_of


def test_page_needs_nothing_else(made):
    _, files = made
    page = Page(files.report.read_text(encoding="utf-8"))
    assert page.addresses and all(one.startswith(("#", "data:image/png;base64,")) for one in page.addresses)
    assert sum(one.startswith("data:") for one in page.addresses) == len(files.figures)
    ids = set(re.findall(r'id="([^"]+)"', files.report.read_text(encoding="utf-8")))
    assert {one[1:] for one in page.addresses if one.startswith("#")} <= ids


def test_page_says_it_in_words_first(made):
    _, files = made
    summary = read_summary(files.summary)
    text = Page(files.report.read_text(encoding="utf-8")).text
    for sentence in (one.sentence for one in judge_benchmark(summary)):
        assert sentence in text
        assert text.index(sentence) < text.index("Overview")
    assert summary.mean_of in text and "No mCE here" in text and "mCE %, of" not in text
    for word in ("JPEG", "rotation deg 45", "ab" * 32, "resnet18-f37072fd.pth", "24 images of 6 classes"):
        assert (word in text) == (word != "JPEG")  # JPEG was not run
    assert "spatter" in text and "extra, not in the mean" in text


def test_names_are_escaped(made):
    _, files = made
    html = files.report.read_text(encoding="utf-8")
    assert "<img src=x>" not in html and "a/&lt;img src=x&gt;.png" in html
    assert "<b>drawn</b>" not in html and "no image &amp; no file" in html and "<title>try &lt;1&gt;" in html


def test_hostile_names_of_variants(tmp_path):
    name, kept = "<script>alert(1)</script>/../x", {"variants": ("unpatched", "patches-60"), "fixed": False}
    benchmark = make_benchmark(n=4, n_classes=2, corruptions=("fog",), severities=(1,), readers=False, **kept)
    answers = tuple(replace(one, variant=name) if one.variant != "unpatched" else one for one in benchmark.cells)
    about = benchmark.about | {"variants": [{"name": name, "patch_px": 60}]}
    files = write_benchmark(tmp_path / "run", replace(benchmark, cells=answers, about=about))
    assert "<script>alert" not in files.report.read_text(encoding="utf-8")
    assert all(file.parent == tmp_path / "run" / "figures" for file in files.figures)
    assert len({file.name.lower() for file in files.figures}) == 3
    shown = str(build_summary_table(read_summary(files.summary)).columns[0]._cells)
    assert name in shown.replace("/ ", "/")  # a long name may be broken after a slash


def test_cells_table_has_every_cell(made):
    benchmark, files = made
    with files.cells.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(benchmark.cells)
    by_key = {(r["variant"], r["answerer"], r["corruption"], int(r["severity"])): r for r in rows}
    for one in benchmark.cells:
        row = by_key[one.variant, one.recogniser, one.corruption, one.severity]
        assert int(row["right"]) == (one.ranks == 1).sum() and int(row["n"]) == 24
        assert float(row["ci95_low"]) <= float(row["top1"]) <= float(row["ci95_high"])
        if one.kind == "reader":
            assert int(row["wrong"]) == (one.ranks == 2).sum() and int(row["not_decoded"]) == (one.ranks == 0).sum()
            assert row["top5"] == "" and row["mcnemar_p"] == ""
        else:
            assert float(row["top5"]) == pytest.approx((one.ranks <= 5).mean()) and row["wrong"] == ""
    assert by_key["unpatched", "resnet18", "clean", 0]["family"] == ""
    assert by_key["unpatched", "resnet18", "spatter", 1]["family"] == "extra"


@pytest.mark.slow
def test_same_answers_same_bytes(made, tmp_path):
    benchmark, _ = made
    smaller = replace(benchmark, cells=tuple(one for one in benchmark.cells if one.variant == "unpatched"))
    first, second = write_benchmark(tmp_path / "a", smaller), write_benchmark(tmp_path / "b", smaller)
    for one, other in zip(first.figures, second.figures, strict=True):
        assert one.read_bytes() == other.read_bytes()
    assert first.report.read_bytes() == second.report.read_bytes()
    assert first.summary.read_bytes() == second.summary.read_bytes()


def test_another_benchmark_of_that_name_goes_beside(tmp_path, made):
    benchmark = replace(made[0], cells=tuple(one for one in made[0].cells if one.corruption == "clean"))
    first = write_benchmark(tmp_path / "run", benchmark)
    before = first.summary.read_bytes()
    other = write_benchmark(tmp_path / "run", replace(benchmark, about=benchmark.about | {"seed": 9}))
    assert other.summary.parent.name == "run-2" and first.summary.read_bytes() == before
    assert read_summary(other.summary).notes[-1] == f"{tmp_path / 'run'} holds another result, and stays as it is"
    assert write_benchmark(tmp_path / "run", benchmark).summary.parent.name == "run"


def test_table_for_the_terminal(made):
    table = build_summary_table(read_summary(made[1].summary))
    assert table.row_count == 5 and "mCE %" not in [column.header for column in table.columns]


def test_unwritable_folder_is_one_line(tmp_path, made):
    (tmp_path / "run").write_text("a file")
    with pytest.raises(ToolkitError, match="cannot write"):
        write_benchmark(tmp_path / "run", make_benchmark(n=2, n_classes=2, corruptions=(), variants=("unpatched",),
                                                         fixed=False, readers=False))  # fmt: skip
