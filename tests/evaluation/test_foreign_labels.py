"""Labels of other programs: what is certainly the same is one label, all else is refused with one of each."""

import csv
from pathlib import Path

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.evaluation.compare_tables import compare_tables, spell

REPORTS = Path(__file__).parents[3] / "shared/reports/compare"
TRUTHS = [f"golden cat {k % 4}" for k in range(40)]
FIRST = [truth if k % 3 else "golden dog" for k, truth in enumerate(TRUTHS)]
SECOND = [truth if k % 4 else "golden dog" for k, truth in enumerate(TRUTHS)]


@pytest.fixture
def write(tmp_path):
    """A table of 40 images from the truths and the predictions."""

    def to_file(name, guesses, truths=TRUTHS, **more):
        heads, columns = ["image", "label", "pred", *more], [truths, guesses, *more.values()]
        rows = [(f"{k}.png", *cells) for k, cells in enumerate(zip(*columns, strict=True))]
        with (tmp_path / f"{name}.csv").open("w", newline="") as stream:
            csv.writer(stream).writerows([heads, *rows])
        return tmp_path / f"{name}.csv"

    return to_file


def counts(found):
    one = found.pooled
    return one.both, one.only_first, one.only_second, one.neither


@pytest.mark.parametrize(
    "respell",
    [
        str.upper,
        lambda label: f" {label}  ",
        lambda label: label.replace(" ", "_"),
        lambda label: label.replace(" ", "-"),
        lambda label: label.replace("golden ", "Golden  "),
    ],
)
def test_case_blanks_and_underscores_change_nothing(write, respell):
    plain = compare_tables(write("one", FIRST), write("two", SECOND))
    spelled = compare_tables(write("one", FIRST), write("two", [respell(label) for label in SECOND]))
    assert counts(spelled) == counts(plain) != (0, 0, 0, 0)


def test_numbers_are_the_same_with_decimals(write):
    whole = [str(k % 4) for k in range(40)]
    found = compare_tables(write("one", whole, whole), write("two", [f"{cell}.0" for cell in whole], whole))
    assert counts(found) == (40, 0, 0, 0)


def test_the_truth_of_an_image_may_not_differ(write):
    other = ["golden dog", *TRUTHS[1:]]
    with pytest.raises(ToolkitError, match=r"the truth of '0\.png' is 'golden cat 0' in .*'golden dog' in .*1 of 40"):
        compare_tables(write("one", FIRST), write("two", SECOND, other))


def test_names_and_numbers_one_to_one_are_the_same_truth(write):
    names = sorted({*TRUTHS, *SECOND})
    as_numbers = [[str(names.index(label)) for label in labels] for labels in (SECOND, TRUTHS)]
    found = compare_tables(write("one", FIRST), write("two", *as_numbers))
    assert counts(found) == counts(compare_tables(write("one", FIRST), write("three", SECOND)))
    assert "the same labels in two ways" in found.notes[0]


def test_names_against_other_names_are_refused_even_one_to_one(write):
    other = {label: f"class {k}" for k, label in enumerate(sorted({*TRUTHS, *SECOND}))}
    with pytest.raises(ToolkitError, match="the truth of"):
        compare_tables(write("one", FIRST), write("two", *([other[one] for one in col] for col in (SECOND, TRUTHS))))


def test_numbers_against_names_in_one_table_are_refused(write):
    with pytest.raises(ToolkitError, match="no true label is ever predicted: the truth is written '0', the prediction"):
        compare_tables(write("one", FIRST), write("two", SECOND, [str(k % 4) for k in range(40)]))


def test_counting_from_one_is_refused(write):
    truths, guesses = [str(k % 4 + 1) for k in range(40)], [str(k % 4 if k % 5 else 3) for k in range(40)]
    with pytest.raises(
        ToolkitError, match="may count from 0 and the other from 1: the truth is '2' and the prediction '1'"
    ):
        compare_tables(write("one", guesses, truths), write("two", guesses, truths))


def test_two_classes_that_differ_by_case_stay_two(write):
    """ImageNet has a dog 'Cardigan' and a jacket 'cardigan'."""
    truths = ["Cardigan", "cardigan"] * 20
    turned = [*truths[:20], *(label.swapcase() if label[0] == "C" else "Cardigan" for label in truths[20:])]
    turned = [{"cARDIGAN": "cardigan"}.get(label, label) for label in turned]
    assert counts(compare_tables(write("one", truths, truths), write("two", turned, truths))) == (20, 20, 0, 0)
    with pytest.raises(ToolkitError, match="'Cardigan' and 'cardigan' may be the same label"):
        compare_tables(write("one", truths, truths), write("two", ["cardigan"] * 40, truths))


def test_a_network_that_is_never_right_is_no_other_spelling(write):
    never = ["golden dog"] * 40
    assert counts(compare_tables(write("one", never), write("two", SECOND)))[0] == 0


def test_a_column_that_says_what_is_right_needs_no_labels(write):
    found = compare_tables(write("one", ["x"] * 40, correct=[0] * 40), write("two", SECOND))
    assert counts(found)[:2] == (0, 0)


@pytest.mark.parametrize("words", [("1", "0"), ("1.0", "0.0"), ("TRUE", "FALSE"), ("WAHR", "FALSCH"), ("yes", "no")])
def test_right_and_wrong_in_words(write, words):
    rightly = [words[truth != guess] for truth, guess in zip(TRUTHS, SECOND, strict=True)]
    found = compare_tables(write("one", SECOND), write("two", SECOND, correct=rightly))
    assert counts(found) == counts(compare_tables(write("one", SECOND), write("two", SECOND)))


def test_truth_and_prediction_are_columns_of_one_kind(tmp_path, write):
    """A table with numbers and names of both: the truth's number is not compared with the prediction's name."""
    file = tmp_path / "both.csv"
    lines = [f"{k}.png,{k % 4},{truth},{truth}" for k, truth in enumerate(TRUTHS)]
    file.write_text("\n".join(["image,true_index,true_label,top1_label", *lines]))
    assert compare_tables(file, write("two", SECOND)).pooled.n_first == 40


def test_what_images_share_is_said_by_a_column_or_their_folders(write, tmp_path):
    found = compare_tables(write("one", FIRST, scene=[k // 10 for k in range(40)]), write("two", SECOND))
    assert found.over_clusters["clusters"] == 4 and "by column 'scene'" in found.cluster_sentence
    alone = compare_tables(write("a", FIRST), write("b", SECOND))
    assert "Each image counts as an independent draw" in alone.cluster_sentence
    files = []
    for name, guesses in (("c", FIRST), ("d", SECOND)):
        file = tmp_path / f"{name}.csv"
        rows = zip(TRUTHS, guesses, strict=True)
        file.write_text(
            "image,label,pred\n" + "\n".join(f"cup{k // 8}/{k}.png,{a},{b}" for k, (a, b) in enumerate(rows))
        )
        files.append(file)
    found = compare_tables(*files)
    assert found.over_clusters["clusters"] == 5 and "by the images' folders" in found.cluster_sentence


@pytest.mark.skipif(not REPORTS.is_dir(), reason="needs the reports' tables beside the checkout")
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("b.csv", "counted"), ("c_trail.csv", "counted"), ("c_case.csv", "counted"), ("b_sp.csv", "counted"),
        ("c_sep.csv", "counted"), ("b_x.csv", "counted"), ("b_t.csv", "counted"), ("c_correct.csv", "counted"),
        ("c_correctde.csv", "counted"), ("c_correctf.csv", "counted"), ("c_correctyn.csv", "counted"),
        ("c_under.csv", "the truth of 'img_000.jpg' is 'dog' in .* and 'golden_dog'"),
        ("c_idx.csv", "no true label is ever predicted: the truth is written '207', the prediction 'cat'"),
        ("c_1based.csv", "may count from 0 and the other from 1: the truth is '208' and the prediction '207'"),
        ("b_dup.csv", "appears twice"), ("b_case.csv", "share no image"), ("b_dir.csv", "share no image"),
    ],
)  # fmt: skip
def test_the_tables_of_the_reports(name, expected):
    if expected == "counted":
        expected_counts = counts(compare_tables(REPORTS / "a.csv", REPORTS / "b.csv"))
        assert counts(compare_tables(REPORTS / "a.csv", REPORTS / name)) == expected_counts
        assert counts(compare_tables(REPORTS / "a_x.csv", REPORTS / name)) == expected_counts
        return
    with pytest.raises(ToolkitError, match=expected) as caught:
        compare_tables(REPORTS / "a.csv", REPORTS / name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("label", "plain"),
    [("007", "7"), ("207.0", "207"), ("-1.", "-1"), ("1_2", "1 2"), ("9007199254740993", "9007199254740993"),
     ("0", "0"), ("1.5", "1.5"), ("nan", "nan"), ("Caf\u00e9", "caf\u00e9"), ("Cafe\u0301", "caf\u00e9")],
)  # fmt: skip
def test_a_label_as_it_is_compared(label, plain):
    assert spell(label) == plain


def test_a_line_without_a_truth_is_refused(write):
    with pytest.raises(ToolkitError, match=r"line 2: image '0\.png' has no true label"):
        compare_tables(write("one", FIRST, ["", *TRUTHS[1:]]), write("two", SECOND))


def test_numbers_of_two_lists_of_labels_are_no_other_truth(tmp_path):
    """Our own tables hold both: a class has another number for another network, and the same name."""
    files = []
    for name, number in (("one", 751), ("two", 23)):
        lines = [f"{k}.png,{number},racer,{number},racer,1" for k in range(3)]
        files.append(tmp_path / f"{name}.csv")
        files[-1].write_text("\n".join(["path,true_index,true_label,top1_index,top1_label,correct_top1", *lines]))
    assert counts(compare_tables(*files)) == (3, 0, 0, 0)
