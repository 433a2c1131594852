"""`toolkit export --object NAME --to FORMAT`: what is asked for is written, or refused."""

import zipfile

import pytest

from toolkit.core.workspace import make_workspace


def test_to_names_the_format_of_a_mesh(tmp_path, type_toolkit):
    make_workspace(tmp_path)
    call = ("export", "--object", "eggnog", "--out", tmp_path / "out", "--workspace", tmp_path, "--to")
    code, _, err = type_toolkit(*call, "3mf")
    assert code == 0, err
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["eggnog.3mf"]
    assert zipfile.is_zipfile(tmp_path / "out" / "eggnog.3mf")


@pytest.mark.parametrize("words", [("--object", "eggnog", "--to", "parquet"), ("--to", "3mf")])
def test_a_format_of_the_other_kind_is_refused(tmp_path, type_toolkit, words):
    code, _, err = type_toolkit("export", *words, "--workspace", tmp_path)
    assert code == 2 and words[-1] in err and len(err.strip().splitlines()) == 1
    assert not (tmp_path / "print").exists()
