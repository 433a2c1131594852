"""Two tables of predictions from other programs, compared as two runs are."""

import csv
import json
import random

import pytest
from scipy.stats import binomtest
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.statistics import adjust_holm, mcnemar_mid_p
from toolkit.evaluation.compare_tables import compare_tables


def write(file, heads, rows):
    with file.open("w", newline="") as stream:
        csv.writer(stream).writerows([heads, *rows])
    return file


@pytest.fixture
def tables(tmp_path):
    """300 images of 30 scenes: the second is right where the first is not more often than the other way round."""
    rng = random.Random(4)
    said = [(f"{k}.png", rng.random() < 0.5, rng.random() < 0.7, k // 10) for k in range(300)]
    first = write(tmp_path / "one.csv", ["Image", "correct", "cluster"], [(n, int(a), s) for n, a, _, s in said])
    second = write(
        tmp_path / "two.csv", ["filename", "label", "pred"], [(n, "cat", "cat" if b else "dog") for n, _, b, _ in said]
    )
    return first, second, said


def test_counts_and_tests_agree_with_scipy(tables):
    first, second, said = tables
    found = compare_tables(first, second)
    gained, lost = sum(b and not a for _, a, b, _ in said), sum(a and not b for _, a, b, _ in said)
    assert (found.pooled.only_second, found.pooled.only_first) == (gained, lost)
    exact = binomtest(gained, gained + lost).pvalue
    assert found.pooled.mcnemar_p == pytest.approx(exact)
    # mid-p: the exact p less the probability of what was seen (both tails' halves)
    seen = binomtest(gained, gained + lost).k
    assert seen == gained
    assert mcnemar_mid_p(gained, lost) < exact
    assert found.over_clusters["clusters"] == 30
    assert found.over_clusters["gain"] == pytest.approx((gained - lost) / 300)


def test_mid_p_of_a_published_table():
    """Fagerland, Lydersen and Laake 2013, Table 1 (airway hyper-responsiveness): 1 and 7, exact 0.070, mid-p 0.039."""
    assert mcnemar_mid_p(1, 7) == pytest.approx(0.0391, abs=1e-4)


def test_holm_by_hand():
    """0.01 · 3, 0.02 · 2, and 0.03, which may not be below those before it."""
    assert adjust_holm([0.03, 0.01, 0.02]) == pytest.approx([0.04, 0.03, 0.04])


def test_command_shows_the_result_and_writes_the_page(tables, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["compare", "one.csv", "two.csv", "--json"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["over_clusters"]["clusters"] == 30
    assert (tmp_path / "eval/comparisons/one-vs-two.html").is_file()


@pytest.mark.parametrize(
    ("heads", "rows", "expected"),
    [
        (["a", "b"], [("1", "1")], "no column of image names"),
        (["image"], [("1.png",)], "expected a column correct"),
        (["image", "correct"], [("1.png", "1"), ("1.png", "0")], "appears twice"),
        (["image", "correct"], [("1.png", "perhaps")], "expected 1 or 0"),
        (["image", "correct"], [("1.png",)], "1 cells: expected 2"),
        (["image", "correct"], [("other.png", "1")], "share no image"),
    ],
)
def test_a_table_that_cannot_be_meant_is_one_line(tables, tmp_path, heads, rows, expected):
    bad = write(tmp_path / "bad.csv", heads, rows)
    with pytest.raises(ToolkitError, match=expected) as caught:
        compare_tables(tables[0], bad)
    assert "\n" not in str(caught.value)


def test_a_name_that_leads_out_of_the_folder_is_never_opened(tmp_path):
    images = tmp_path / "images"
    images.mkdir()
    rows = [("../secret.png", "1")]
    files = [write(tmp_path / f"{name}.csv", ["image", "correct"], rows) for name in ("one", "two")]
    pair = compare_tables(*files, images=images).pairs[0]
    assert pair.first.capture.file == images
