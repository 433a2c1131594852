"""Tables of predictions from anybody: damaged ones are a line, long ones of any shape take work in proportion."""

import csv
import io
import os
import sys
from pathlib import Path

import pytest
from hostile_checks import count, limited
from hostile_inputs import OTHER_KINDS, damaged, names, numbers, put_in_place
from hypothesis import given
from hypothesis import strategies as st

from toolkit.captures.capture import Capture
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.evaluation.compare import compare_runs
from toolkit.evaluation.compare_tables import CLUSTER, GUESS, IMAGE, RIGHT, TRUTH, compare_tables
from toolkit.evaluation.metrics import index_poses, list_flips, pair_with_unpatched
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.predictions_csv import encode_predictions, read_predictions
from toolkit.evaluation.results import compare_predictions
from toolkit.evaluation.summaries import Run

N_ROWS = 20_000 if "FUZZ" in os.environ else 100
VARIANTS = ("unpatched", "patched")
SHAPES = {
    "groups of ten": lambda k: ("sim", f"o{k // 20}", VARIANTS[k // 10 % 2], k % 10),
    "one object": lambda k: ("sim", "o", VARIANTS[k % 2], k // 2),
    "many sources": lambda k: (f"s{k // 2}", "o", VARIANTS[k % 2], 1),
    "renderings of many sources": lambda k: (f"sim-like-s{k // 2}" if k % 2 else f"s{k // 2}", "o", "patched", 1),
    "renderings of other objects": lambda k: (f"sim-{k}" if k % 2 else f"s{k}", f"o{k}", "patched", 1),
    "many variants": lambda k: ("sim", "o", f"v{k}" if k % 2 else "unpatched", k // 2),
    "variants of their own": lambda k: ("sim", f"o{k // 2}", f"v{k}" if k % 2 else "unpatched", 1),
    "without partners": lambda k: ("sim", "o", f"v{k}" if k % 2 else "unpatched", k),
    "without poses": lambda k: ("sim", f"o{k // 20}", VARIANTS[k % 2], None),
    "all of one pose": lambda k: ("sim", "o", f"v{k}" if k % 2 else "unpatched", 1),
    "folders in folders": lambda k: ("sim", "/".join(f"{k}"), VARIANTS[k % 2], k),
}


def make_rows(folder, n, place_of):
    for k in range(n):
        source, name, variant, pose = place_of(k)
        path = f"{source}/{name}/{variant}/{k}.jpg"
        capture = Capture(source, name, variant, pose, folder / path, path)
        right = k * 7919 % 13 > 5
        yield Prediction(capture, 3, "jet", 3 if right else 4, "jet" if right else f"{k}", 0.5, 0.5, 1 if right else 9)


def write_run(folder, content: bytes) -> Run:
    folder.mkdir(exist_ok=True)
    (folder / "predictions.csv").write_bytes(content)
    (folder / "summary.json").write_text("{}")
    return Run("run", folder, "eval", ())


def count_lines(call) -> int:
    """How many lines of Python are run, a comprehension's once for each item."""
    lines = 0

    def trace(frame, event, argument):
        nonlocal lines
        lines += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    finally:
        sys.settrace(before)
    return lines


@pytest.mark.parametrize("shape", SHAPES)
def test_rows_of_any_shape_take_work_in_proportion(tmp_path, shape):
    """Ten times the rows take ten times the lines of Python; with FUZZ they are 200,000, and groups up to 100,000."""
    space, lines = make_workspace(tmp_path / "space"), []
    for n in (N_ROWS, 10 * N_ROWS):
        run = write_run(tmp_path / f"{n}", encode_predictions(make_rows(tmp_path, n, SHAPES[shape])).encode())

        def work(run=run, n=n):
            found = read_predictions(run, tmp_path)
            list_flips(pair_with_unpatched(index_poses(found)))
            compare_predictions("net", found)
            assert compare_runs(space, run, run, tmp_path).pooled.n == n

        if not lines:
            work()  # what is imported or kept once is not counted
        lines.append(count_lines(work))
        count("rows")
    assert lines[1] < 11 * lines[0], lines


WHOLE = encode_predictions(make_rows(Path("nowhere"), 4, SHAPES["one object"])).encode()


@given(content=damaged(WHOLE))
def test_a_damaged_table(tmp_path_factory, content):
    run = write_run(tmp_path_factory.getbasetemp() / "damaged", content)
    count("tables")
    try:
        with limited():
            compare_predictions("net", read_predictions(run, run.folder))
    except ToolkitError as error:
        said = str(error)
        assert "\n" not in said and len(said) < 1000 and "Error" not in said, said


HEADS = st.sampled_from((*IMAGE[:3], *RIGHT[:2], *TRUTH[:2], *GUESS[:2], *CLUSTER)) | names
CELLS = st.sampled_from(("a.png", "b.png", "1", "0", "true", "cat", "=1+1", "'=1", "../../a.png", "pipe", "9" * 5000))


@st.composite
def foreign_tables(draw) -> bytes:
    """A CSV of anybody's: heads that are known, odd or twice; rows too short, too long, quoted by half."""
    heads = draw(st.lists(HEADS, max_size=5))
    if draw(st.booleans()):
        heads += ["image", draw(st.sampled_from(RIGHT)), "cluster"]
    row = st.lists(CELLS | names | numbers.map(str), min_size=len(heads), max_size=len(heads)) | st.lists(CELLS)
    text, mark = io.StringIO(), draw(st.sampled_from(",,,;\t"))
    csv.writer(text, delimiter=mark).writerows([heads, *draw(st.lists(row, max_size=6))])
    content = text.getvalue().encode(draw(st.sampled_from(("utf-8", "utf-8-sig", "utf-16", "utf-7"))), "surrogatepass")
    return draw(damaged(content)) if draw(st.integers(0, 3)) == 0 else content


RIGHTLY = b"image,correct,cluster\na.png,1,x\nb.png,0,x\n1,1,y\n"


@given(first=foreign_tables() | st.just(RIGHTLY), second=foreign_tables(), kind=st.sampled_from((None, *OTHER_KINDS)))
def test_foreign_tables_are_compared_or_a_line(sandbox, first, second, kind):
    space = sandbox.renew()
    (space / "one.csv").write_bytes(first)
    (space / "other.csv").write_bytes(second)
    if kind is not None and len(first) % 3 == 0:
        put_in_place(space / "other.csv", kind)
    count("foreign tables")
    sandbox.run("compare", "one.csv", "other.csv", *(("--cluster", "cluster") if len(second) % 2 else ()))


@pytest.mark.parametrize("shape", ["names", "clusters", "one cluster", "columns", "long cell"])
def test_foreign_tables_take_work_in_proportion(tmp_path, shape):
    """Ten times the lines take ten times the work, whatever they say."""
    lines = []
    for n in (N_ROWS, 10 * N_ROWS):
        more = {"columns": [f"c{k}" for k in range(n)], "long cell": ["x" * n]}.get(shape, [])
        rows = [(f"{k}.png", k % 3 % 2, {"clusters": k, "one cluster": 1}.get(shape, ""), *more) for k in range(n)]
        files = [tmp_path / f"{side}-{n}.csv" for side in ("one", "other")]
        for at, file in enumerate(files):
            with file.open("w", newline="") as stream:
                said = rows if shape in ("names", "clusters", "one cluster") else rows[: 3 + at]
                csv.writer(stream).writerows([["image", "correct", "cluster", *more], *said])
        lines.append(count_lines(lambda files=files: compare_tables(*files).as_json()))
        count("rows")
    assert lines[1] < 11 * lines[0], lines
