"""Object specs: what a person may write, and which field is named when it is wrong."""

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.objects.spec import read_spec

GOOD = {"name": '"mug"', "class": '"coffee mug"', "mesh": '"mug.glb"', "length_mm": "120"}


def write(folder, patch="", **fields):
    content = "\n".join(f"{key} = {value}" for key, value in (GOOD | fields).items() if value is not None)
    file = folder / "mug.toml"
    file.write_text(f"{content}\n{patch}")
    return file


def test_defaults_and_everything_named(tmp_path):
    spec = read_spec(write(tmp_path))
    assert (spec.name, spec.class_name, spec.up, spec.front) == ("mug", "coffee mug", "y", "z")
    assert [(mount.at, mount.size_mm) for mount in spec.mounts] == [("top", None)]
    patch = '[patch]\nat = "left"\nsize_mm = 40\noffset_mm = [3, -4]\nrotation_deg = 90'
    spec = read_spec(write(tmp_path, patch, **{"class": "504", "up": '"-y"'}))
    assert (spec.class_name, spec.up) == (504, "-y")
    assert (spec.mounts[0].at, spec.mounts[0].size_mm, spec.mounts[0].offset_mm) == ("left", 40, (3, -4))


@pytest.mark.parametrize(
    ("mesh", "axes"),
    [("mug.glb", "yz"), ("a/mug.GLTF", "yz"), ("mug.obj", "zx"), ("mug.stl", "zx"), ("builtin:racer", "zx")],
)
def test_a_mesh_stands_as_its_format_says_unless_told_otherwise(tmp_path, mesh, axes):
    """glTF's specification: +y is up and +z to the front; the other formats state nothing."""
    spec = read_spec(write(tmp_path, mesh=f'"{mesh}"'))
    assert (spec.up, spec.front) == tuple(axes)
    spec = read_spec(write(tmp_path, mesh=f'"{mesh}"', up='"-x"'))
    assert (spec.up, spec.front) == ("-x", axes[1])


def test_the_name_is_the_files_and_may_be_left_out(tmp_path):
    assert read_spec(write(tmp_path, name=None)).name == "mug"
    file = write(tmp_path, name=None).rename(tmp_path / "my mug.toml")
    with pytest.raises(ToolkitError, match=r"expected a file name of letters.*found 'my mug': rename the file"):
        read_spec(file)


def test_a_model_may_state_what_it_is_a_model_of(tmp_path):
    assert read_spec(write(tmp_path)).world_length_m is None
    assert read_spec(write(tmp_path, world_length_m="4.5")).world_length_m == 4.5


@pytest.mark.parametrize(
    ("fields", "patch", "words"),
    [
        ({"name": '"cup"'}, "", "'name': expected 'mug' as the file's, found 'cup'"),
        ({"name": '"../mug"'}, "", "field 'name'"),
        ({"class": None}, "", "field 'class' is missing"),
        ({"length_mm": "-3"}, "", "field 'length_mm'.*found -3"),
        ({"length_mm": "nan"}, "", "field 'length_mm'"),
        ({"world_length_m": "0"}, "", "field 'world_length_m'.*found 0"),
        ({"mesh": "3"}, "", "field 'mesh'.*found 3"),
        ({"up": '"w"'}, "", "field 'up'.*found \"w\""),
        ({"lenght_mm": "3"}, "", "there is no field 'lenght_mm'"),
        ({}, '[patch]\nat = "bottom"', r"field 'patch\.at'.*found \"bottom\""),
        ({}, "[patch]\nsize_mm = 0", r"field 'patch\.size_mm'"),
        ({}, "[patch]\nsize_mm = inf", r"field 'patch\.size_mm'"),
        ({}, "[patch]\nrotation_deg = nan", r"field 'patch\.rotation_deg'"),
        ({}, "[patch]\noffset_mm = [1]", r"field 'patch\.offset_mm"),
        ({"mesh": "unquoted"}, "", "not TOML"),
    ],
)
def test_a_wrong_field_is_named(tmp_path, fields, patch, words):
    with pytest.raises(ToolkitError, match=words) as caught:
        read_spec(write(tmp_path, patch, **fields))
    assert "mug.toml" in str(caught.value) and "\n" not in str(caught.value)
