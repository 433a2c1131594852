"""Tables of any size and with any text: written for spreadsheets, read back as they were."""

import csv
import io

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from toolkit.captures.capture import Capture
from toolkit.core.errors import ToolkitError
from toolkit.core.tables import FormattedNumber, decode_cell, encode_csv
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.predictions_csv import encode_predictions, read_predictions
from toolkit.evaluation.summaries import Run

FORMULAS = ("=cmd|' /C calc'!A0", "+1+1", "-2+3", "@SUM(A1)", "\t=1", "'=1", "''+1", "'", "'a", "-", "=")


def write_run(folder, predictions):
    (folder / "predictions.csv").write_text(encode_predictions(predictions), newline="")
    return Run("run", folder, "eval", ())


def make_prediction(folder, name, variant, pose, label="jet", right=True):
    path = f"sim/{name}/{variant}/pose_{pose}.jpg"
    capture = Capture("sim", name, variant, pose, folder / path, path)
    return Prediction(capture, 3, "jet", 3 if right else 4, label, 0.5, 0.5, 1 if right else 9)


@given(texts=st.lists(st.sampled_from(FORMULAS) | st.text(max_size=12), min_size=1))
@example(texts=["a\0b"])
def test_no_cell_is_a_formula_and_every_text_comes_back(texts):
    written = encode_csv(["text"] * len(texts), [texts])
    cells = list(csv.reader(io.StringIO(written, newline="")))[1]
    assert [decode_cell(cell) for cell in cells] == [text.replace("\0", "␀") for text in texts] and "\0" not in written
    assert not any(cell.startswith(tuple("=+-@\t\r\n")) for cell in cells)


def test_numbers_stay_numbers():
    row = [-0.5, -3, 1e-05, -1e-05, FormattedNumber("-0.5 2.0 -3.5 4.0"), None, True]
    assert encode_csv(["x"] * len(row), [row]).splitlines()[1] == "-0.5,-3,1e-05,-1e-05,-0.5 2.0 -3.5 4.0,,True"
    assert encode_csv(["+x"], [["+1"], ["-1 -2"]]).splitlines() == ["'+x", "'+1", "'-1 -2"], "folders of that name"


def test_labels_that_are_formulas_are_read_back(tmp_path):
    said = [make_prediction(tmp_path, "car", "patched", k, label) for k, label in enumerate(FORMULAS)]
    said.append(make_prediction(tmp_path, "car", "patched", 99, "x" * 100_000))
    run = write_run(tmp_path, said)
    text = (tmp_path / "predictions.csv").read_text()
    assert ",=cmd" not in text and ",@SUM" not in text and ",'=cmd|' /C calc'!A0," in text
    assert [one.top1_label for one in read_predictions(run, tmp_path)] == [one.top1_label for one in said]


def test_a_file_is_found_through_links_and_not_outside(tmp_path):

    captures = tmp_path / "captures"
    (captures / "sim" / "car" / "patched").mkdir(parents=True)
    there, link = (captures / "sim" / "car" / "patched" / f"pose_{k}.jpg" for k in (0, 1))
    there.write_bytes(b"x")
    link.symlink_to(there)
    run = write_run(tmp_path, [make_prediction(captures, "car", "patched", k) for k in (0, 1, 2)])
    assert [one.capture.file for one in read_predictions(run, captures)] == [
        there,
        there,
        there.with_name("pose_2.jpg"),
    ]
    link.unlink()
    link.symlink_to(tmp_path / "predictions.csv")
    with pytest.raises(ToolkitError, match="leaves its folder"):
        read_predictions(run, captures)


@pytest.mark.parametrize(
    ("column", "cell"),
    [
        ("top1_prob", "nan"), ("top1_prob", "-inf"), ("true_prob", "1e400"), ("true_prob", "-0.1"), ("top1_prob", "2"),
        ("true_rank", "0"), ("true_rank", "9" * 30), ("true_index", "9" * 5000), ("top1_index", "-1"),
        ("top1_index", str(2**31)), ("pose_id", "9" * 5000), ("pose_id", "-3"),
    ],
)  # fmt: skip
def test_a_number_that_none_can_be_is_a_line(tmp_path, column, cell):
    run = write_run(tmp_path, [make_prediction(tmp_path, "car", "patched", k) for k in (1, 2)])
    file = tmp_path / "predictions.csv"
    heads, first, second = csv.reader(file.read_text().splitlines())
    second[heads.index(column)] = cell
    with file.open("w", newline="") as stream:
        csv.writer(stream).writerows([heads, first, second])
    with pytest.raises(
        ToolkitError, match=r"predictions\.csv is damaged \('.*: expected a (whole number|prob)"
    ) as said:
        read_predictions(run, tmp_path)
    assert len(str(said.value)) < 300
