"""Files that are whole or absent, and paths that stay where they belong."""

import errno
import hashlib
import json
import os
from pathlib import Path

import pytest
from pydantic import BaseModel, Field

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import (
    inside,
    read_json,
    read_toml,
    real_path,
    sha256_bytes,
    sha256_file,
    walk_folders,
    write_bytes,
    write_json,
)


class Inner(BaseModel):
    width_mm: float = Field(gt=0)


class Outer(BaseModel):
    name: str
    parts: list[Inner] = []


def fail_with(code):
    def fail(*_):
        raise OSError(code, os.strerror(code))

    return fail


@pytest.mark.parametrize("step", ["fsync", "replace"])
@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EIO])
def test_a_failed_write_leaves_the_old_content_and_nothing_else(tmp_path, monkeypatch, step, code):
    file = write_bytes(tmp_path / "a.json", b"old")
    owner = ("toolkit.core.files.os.fsync", fail_with(code)) if step == "fsync" else (Path, "replace", fail_with(code))
    monkeypatch.setattr(*owner)
    words = {errno.ENOSPC: "disk is full", errno.EROFS: "read-only", errno.EACCES: "permission denied"}
    with pytest.raises(ToolkitError, match=words.get(code, os.strerror(code))) as caught:
        write_bytes(file, b"new, and longer")
    assert str(file) in str(caught.value) and "\n" not in str(caught.value)
    assert file.read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_nobody_ever_reads_half_a_file(tmp_path, monkeypatch):
    """Until the rename, the old content is what a reader finds."""
    file = write_bytes(tmp_path / "a.bin", b"old")
    seen = []
    real = Path.replace
    monkeypatch.setattr(Path, "replace", lambda self, to: (seen.append(file.read_bytes()), real(self, to))[1])
    write_bytes(file, b"new")
    assert seen == [b"old"] and file.read_bytes() == b"new"


def test_folders_are_made_and_a_file_in_their_place_is_refused(tmp_path):
    assert write_bytes(tmp_path / "a/b/c.bin", b"x").read_bytes() == b"x"
    (tmp_path / "file").write_text("")
    with pytest.raises(ToolkitError, match="cannot write"):
        write_bytes(tmp_path / "file/below.bin", b"x")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ToolkitError, match="cannot write"):
        write_bytes(tmp_path / "folder", b"x")


def test_hashes_are_sha256(tmp_path):
    content = bytes(range(256)) * 9000  # over one block
    (tmp_path / "a").write_bytes(content)
    assert sha256_file(tmp_path / "a") == sha256_bytes(content) == hashlib.sha256(content).hexdigest()
    assert sha256_bytes(b"") == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"


def test_json_is_readable_and_never_holds_what_json_has_not(tmp_path):
    file = write_json(tmp_path / "a.json", {"name": "größe", "x": [1, 2.5]})
    assert json.loads(file.read_text(encoding="utf-8")) == {"name": "größe", "x": [1, 2.5]}
    assert "größe" in file.read_text(encoding="utf-8") and file.read_text().endswith("\n")
    with pytest.raises(ValueError):
        write_json(tmp_path / "b.json", float("nan"))
    assert not (tmp_path / "b.json").exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('{"name": 3}', r"field 'name': .*, found 3"),
        ("{}", r"field 'name' is missing"),
        ('{"name": "a", "parts": [{"width_mm": 2}, {"width_mm": -1}]}', r"field 'parts\.1\.width_mm': .*, found -1"),
        ("[]", r"edited\.json: expected named fields, found \[\]"),
        ('{"name": ', "not JSON at line 1"),
        ('{\n"name":\n}', "not JSON at line 3"),
        ("\xff", "not JSON|cannot read"),
    ],
)
def test_a_wrong_field_is_named(tmp_path, content, words):
    file = tmp_path / "edited.json"
    file.write_text(content, encoding="latin-1")
    with pytest.raises(ToolkitError, match=words) as caught:
        read_json(file, Outer)
    assert "edited.json" in str(caught.value) and "\n" not in str(caught.value)


def test_toml_names_its_field_and_line_too(tmp_path):
    file = tmp_path / "edited.toml"
    file.write_text('name = "a"\n[[parts]]\nwidth_mm = 3\n')
    assert read_toml(file, Outer).parts[0].width_mm == 3
    file.write_text('name = "a"\n[[parts]]\nwidth_mm = "wide"\n')
    with pytest.raises(ToolkitError, match=r'edited\.toml: field \'parts\.0\.width_mm\': .*found "wide"'):
        read_toml(file, Outer)
    file.write_text("name = \n")
    with pytest.raises(ToolkitError, match=r"edited\.toml: not TOML: .*line 1"):
        read_toml(file, Outer)


def test_missing_files_and_folders_are_one_line(tmp_path):
    for read in (read_json, read_toml):
        for path in (tmp_path / "none", tmp_path):
            with pytest.raises(ToolkitError, match="cannot read"):
                read(path, Outer)


def test_inside_gives_paths_in_the_folder(tmp_path):
    assert inside(tmp_path, "a/../b.txt") == tmp_path / "b.txt"
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    assert inside(tmp_path, "link/x") == tmp_path / "real" / "x"


@pytest.mark.parametrize("path", ["../x", "a/../../x", "/etc/passwd", "..", "out/x", "loop/x", "a\0b"])
def test_inside_refuses_what_leaves_it(tmp_path, path):
    root = tmp_path / "root"
    root.mkdir()
    (root / "out").symlink_to(tmp_path)
    (root / "loop").symlink_to("loop")
    with pytest.raises(ToolkitError, match=r"leaves its folder|cannot be used"):
        inside(root, path)


def test_a_sibling_with_the_same_beginning_is_outside(tmp_path):
    (tmp_path / "sim").mkdir()
    (tmp_path / "simulated").mkdir()
    with pytest.raises(ToolkitError, match="leaves its folder"):
        inside(tmp_path / "sim", "../simulated/x")


def test_unknown_names_get_the_nearest_known_ones():
    assert str(one_of("object", "racr", ["racer", "eggnog"])) == "no object called 'racr': did you mean racer?"
    assert str(one_of("object", "zzz", ["racer", "eggnog"])) == "no object called 'zzz': known: racer, eggnog"


def test_links_in_a_circle_have_a_place(tmp_path):
    (tmp_path / "first").symlink_to(tmp_path / "second")
    (tmp_path / "second").symlink_to(tmp_path / "first")
    assert real_path(tmp_path / "first").parent == tmp_path.resolve()
    (tmp_path / "there").symlink_to(tmp_path)
    assert real_path(tmp_path / "there") == tmp_path.resolve()


@pytest.mark.parametrize(("length", "found"), [(78, f'"{"x" * 78}"'), (79, f'"{"x" * 76}...')])
def test_what_is_found_in_place_of_a_number_is_said_as_far_as_a_line_holds(length, found, tmp_path):
    class Sheet(BaseModel):
        size_mm: float

    file = tmp_path / "sheet.json"
    file.write_text(json.dumps({"size_mm": "x" * length}))
    with pytest.raises(ToolkitError) as raised:
        read_json(file, Sheet)
    assert f", found {found}: correct the file" in str(raised.value)


def test_a_walk_is_that_of_os_walk(tmp_path):
    for path in ("b/c/x", "b/y", "a/z", ".h/x"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).touch()
    (tmp_path / "a" / "up").symlink_to(tmp_path)
    (tmp_path / "gone").symlink_to("nowhere")
    (tmp_path / "loop").symlink_to("loop")
    expected = {folder: (sorted(folders), sorted(names)) for folder, folders, names in os.walk(tmp_path)}
    assert {str(one): (folders, names) for one, folders, names in walk_folders(tmp_path)} == expected
    said = []
    assert not list(walk_folders(tmp_path / "none", said.append)) and len(said) == 1
