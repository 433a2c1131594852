"""Every reader on bad files: a result, or one line that says what is wrong; never another error, never a long wait."""

import shutil

import pytest
from hostile_checks import LONGEST_LINE, count, limited
from hostile_inputs import OTHER_KINDS, put_in_place
from hostile_space import READERS
from hypothesis import given
from hypothesis import strategies as st

from toolkit.core.errors import ToolkitError


def read(reader, root):
    """Its message, or None; the test fails with any other error."""
    try:
        with limited():
            reader.read(root)
    except ToolkitError as error:
        assert 0 < len(str(error)) < LONGEST_LINE and "Value error" not in str(error), str(error)
        return str(error)
    return None


@pytest.fixture(scope="module")
def copy(template, tmp_path_factory):
    """A workspace of this module's own."""
    return shutil.copytree(template, tmp_path_factory.mktemp("readers") / "space")


@pytest.mark.parametrize("name", READERS)
def test_a_whole_file_is_read(copy, name):
    message = read(READERS[name], copy)
    assert message is None or name == "weights", message


@pytest.mark.parametrize("name", READERS)
@given(data=st.data())
def test_bad_content_is_a_line_at_most(copy, name, data):
    reader, file = READERS[name], copy / READERS[name].path
    whole = file.read_bytes()
    try:
        file.write_bytes(data.draw(reader.contents(whole)))
        count("files")
        read(reader, copy)
    finally:
        file.write_bytes(whole)


@pytest.mark.parametrize("kind", OTHER_KINDS)
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_file_is_not_waited_for(copy, name, kind):
    reader, file = READERS[name], copy / READERS[name].path
    whole = file.read_bytes()
    try:
        put_in_place(file, kind)
        count("no files")
        read(reader, copy)
    finally:
        shutil.rmtree(file) if file.is_dir() and not file.is_symlink() else file.unlink()
        file.write_bytes(whole)
