"""Tables of other programs: encodings, marks between cells, decimal signs, and what is refused in one line."""

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.foreign_tables import read_foreign_table

TEXT = "Path;Label;Score\nä 1.jpg;dog;0,5\n\n;;\nb.jpg; cat ;1,25\n"


@pytest.mark.parametrize("code", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le-bom"])
@pytest.mark.parametrize("mark", [";", "\t", ","])
def test_every_usual_way_gives_the_same_cells(tmp_path, code, mark):
    text = TEXT.replace(",", ".") if mark == "," else TEXT
    text = text.replace(";", mark)
    content = ("\ufeff" + text).encode("utf-16-le") if code == "utf-16-le-bom" else text.encode(code)
    file = tmp_path / "t.csv"
    file.write_bytes(content)
    table = read_foreign_table(file)
    assert table.heads == ("path", "label", "score") and table.mark == mark
    assert [(number, cells[:2]) for number, cells in table.lines] == [(2, ("ä 1.jpg", "dog")), (5, ("b.jpg", "cat"))]
    assert [table.number(cells[2]) for _, cells in table.lines] == [0.5, 1.25]


def test_the_first_line_may_name_the_mark(tmp_path):
    file = tmp_path / "t.csv"
    file.write_text("sep=|\na|b\n1|2\n")
    table = read_foreign_table(file)
    assert table.heads == ("a", "b") and table.lines == ((3, ("1", "2")),)


def test_blanks_before_quotes_and_marks_in_quotes(tmp_path):
    file = tmp_path / "t.csv"
    file.write_text('name, label\n"a, b.jpg", "hot dog"\n')
    assert read_foreign_table(file).lines == ((2, ("a, b.jpg", "hot dog")),)


def test_a_comma_between_cells_is_no_decimal_sign(tmp_path):
    file = tmp_path / "t.csv"
    file.write_text('a,b\n"1,5",x\n')
    table = read_foreign_table(file)
    assert table.number(table.lines[0][1][0]) is None


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("a,b\nä,1\n".encode("latin-1"), "expected UTF-8: save it as CSV UTF-8"),
        (b'a,b\n"x,1\n', "line 2: not a readable CSV table"),
        (b"\xff\xfea\x00,", "not a readable CSV table"),
    ],
)
def test_what_is_no_table_is_one_line(tmp_path, content, words):
    file = tmp_path / "t.csv"
    file.write_bytes(content)
    with pytest.raises(ToolkitError, match=words) as caught:
        read_foreign_table(file)
    assert "\n" not in str(caught.value)


def test_two_columns_of_one_name_are_refused_where_they_are_asked_for(tmp_path):
    file = tmp_path / "t.csv"
    file.write_text("a,a,b\n1,2,3\n")
    table = read_foreign_table(file)
    assert table.find(["c", "b"]) == 2 and table.find(["c"]) is None
    with pytest.raises(ToolkitError, match="two columns are called 'a'"):
        table.find(["a"])
