"""Files made to do harm: too deep, too long, no file at all, or a way out of the folder."""

import json
import os
import stat
import time

import pytest
from pydantic import BaseModel

from toolkit.core.errors import ToolkitError
from toolkit.core.files import (
    inside,
    link_file,
    move_file,
    open_whole,
    read_json,
    read_toml,
    sha256_file,
    write_bytes,
)
from toolkit.core.records import RecordLog


class Anything(BaseModel):
    a: dict | list | int | float | str = 0


LEVELS = 100_000


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("deep.json", '{"a": ' + "[" * LEVELS + "]" * LEVELS + "}", "more than 50 levels"),
        ("open.json", '{"a": ' * LEVELS, "more than 50 levels|not JSON"),
        ("deep.toml", "a = " + "[" * LEVELS + "]" * LEVELS, "more than 50 levels|not TOML"),
        ("keys.toml", ".".join(["a"] * 50_000) + " = 1", "more than 50 levels"),
        ("spaced.toml", " . ".join(["'a'"] * 20_000) + " = 1", "more than 50 levels"),
        ("inline.toml", "a = { " + "a." * 50_000 + "a = 1 }", "more than 50 levels"),
        ("letters.toml", "a" * 900_000, "not TOML"),
        ("spaces.toml", "a " * 450_000, "not TOML"),
        ("large.toml", "#" * 2_000_000, "larger than 1 MB"),
        ("number.json", '{"a": ' + "9" * 5000 + "}", "thousands of digits"),
        ("number.toml", "a = " + "9" * 5000, "thousands of digits"),
        ("nan.json", '{"a": NaN}', "NaN is not allowed as a number"),
        ("infinite.json", '{"a": -Infinity}', "-Infinity is not allowed as a number"),
        ("half.json", '{"a": "\\ud800"}', "surrogate pair"),
        ("bytes.json", b'{"a": "\xff"}', "not UTF-8 text at byte 7"),
        ("bytes.toml", b'a = "\xff"', "not UTF-8 text at byte 5"),
    ],
)
def test_a_file_that_no_reader_should_swallow_is_refused_in_one_line(tmp_path, name, content, words):
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    began = time.monotonic()
    with pytest.raises(ToolkitError, match=words) as caught:
        (read_json if name.endswith("json") else read_toml)(file, Anything)
    assert time.monotonic() - began < 20
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400 + len(str(file))


def test_what_people_write_is_not_taken_for_an_attack(tmp_path):
    (tmp_path / "a.toml").write_text("# a. b. c. ... " + "word. " * 40 + '\n[a]\nb.c.d = "1.2.3.4.5.6.7.8"\n')
    assert read_toml(tmp_path / "a.toml", Anything).a == {"b": {"c": {"d": "1.2.3.4.5.6.7.8"}}}
    (tmp_path / "a.json").write_text(json.dumps({"a": "😀 \\u00e9"}))
    assert read_json(tmp_path / "a.json", Anything).a == "😀 \\u00e9"


def test_a_pipe_or_a_device_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.json")
    (tmp_path / "zero.json").symlink_to("/dev/zero")
    for name in ("pipe.json", "zero.json"):
        with pytest.raises(ToolkitError, match="a pipe or a device, expected a plain file"):
            read_json(tmp_path / name, Anything)
        with pytest.raises(OSError, match="a pipe or a device"):
            sha256_file(tmp_path / name)
        with pytest.raises(ToolkitError, match="a pipe or a device"):
            list(RecordLog(tmp_path / name, Anything).read())


def test_a_log_that_cannot_be_read_is_no_empty_log(tmp_path):
    (tmp_path / "log.jsonl").mkdir()
    with pytest.raises(ToolkitError, match="it is a folder, expected a file"):
        list(RecordLog(tmp_path / "log.jsonl", Anything).read())
    (tmp_path / "loop.jsonl").symlink_to("loop.jsonl")
    with pytest.raises(ToolkitError, match="circle"):
        list(RecordLog(tmp_path / "loop.jsonl", Anything).read())
    assert list(RecordLog(tmp_path / "none.jsonl", Anything).read()) == []


@pytest.mark.parametrize("content", ["[" * 100_000 + "\n", '{"a": ' + "9" * 6000 + "}\n", '{"a": "\\ud800"}\n', "\0\n"])
def test_a_hostile_line_of_a_log_is_named(tmp_path, content):
    (tmp_path / "log.jsonl").write_text('{"a": 1}\n' + content)
    with pytest.raises(ToolkitError, match="line 2 is broken") as caught:
        list(RecordLog(tmp_path / "log.jsonl", Anything).read())
    assert len(str(caught.value)) < 400 + len(str(tmp_path))


@pytest.fixture
def root(tmp_path):
    """A folder to write in, with links that lead out of it; `outside` beside it must stay empty."""
    (tmp_path / "outside").mkdir()
    root = tmp_path / "root"
    root.mkdir()
    (root / "link").symlink_to("../outside")
    return root


@pytest.mark.parametrize("path", ["../outside/x", "a/../../outside/x", "link/x", "link/deep/x", "loop/x"])
def test_nothing_is_written_outside_its_root(root, path):
    (root / "loop").symlink_to("loop")
    (root / "file").write_bytes(b"")
    for write in (
        lambda: write_bytes(root / path, b"x", root),
        lambda: move_file(root / "file", root / path, root),
        lambda: link_file(root / "file", root / path, root),
    ):
        with pytest.raises(ToolkitError, match=r"leads outside|cannot write"):
            write()
    assert not list((root.parent / "outside").iterdir())


def test_a_link_in_a_files_place_is_replaced_and_never_followed(root, monkeypatch):
    target = root.parent / "outside" / "precious"
    target.write_bytes(b"mine")
    (root / "a.json").symlink_to(target)
    write_bytes(root / "a.json", b"new", root)
    assert (root / "a.json").read_bytes() == b"new" and not (root / "a.json").is_symlink()
    (root / "log.jsonl").symlink_to(target)
    with pytest.raises(ToolkitError, match="it is a link, which is not followed"):
        RecordLog(root / "log.jsonl", Anything).append(Anything())
    # the temporary name that can be foreseen, and one that is there by chance
    monkeypatch.setattr("toolkit.core.files.secrets.token_hex", lambda _: "0")
    for name in (".b.json.partial", ".b.json.0.partial"):
        (root / name).symlink_to(target)
    with pytest.raises(ToolkitError, match="cannot write"):
        write_bytes(root / "b.json", b"evil")
    assert target.read_bytes() == b"mine"


def test_what_a_killed_run_left_of_a_file_is_taken_and_what_is_being_written_is_not(root):
    (root / ".a.json.partial").write_bytes(b"half of what a killed run would have written")
    with open_whole(root / "a.json") as first:
        with open_whole(root / "a.json") as second:  # as another process would
            second.write(b"second")
        first.write(b"first")
        assert (root / "a.json").read_bytes() == b"second"
    assert (root / "a.json").read_bytes() == b"first"
    assert [one.name for one in root.iterdir() if "partial" in one.name] == []


def test_a_second_name_of_a_file_is_not_written_to(root):
    target = root.parent / "outside" / "precious"
    target.write_bytes(b"mine")
    os.link(target, root / ".a.json.partial")
    write_bytes(root / "a.json", b"new")
    assert target.read_bytes() == b"mine" and (root / "a.json").read_bytes() == b"new"


def test_a_pipe_a_device_or_a_folder_is_never_replaced(root):
    os.mkfifo(root / "pipe")
    (root / "null").symlink_to("/dev/null")
    (root / "out").symlink_to("/proc/self/fd/1")  # as /dev/stdout is
    (root / "folder").symlink_to("../outside")
    if os.geteuid() == 0:
        os.mknod(root / "device", 0o666 | stat.S_IFCHR, os.makedev(1, 3))
    before = {path.name: path.lstat().st_ino for path in root.iterdir()}
    for name in before:
        for write in (
            lambda name=name: write_bytes(root / name, b"x"),
            lambda name=name: move_file(write_bytes(root / "new", b"x"), root / name, root),
            lambda name=name: link_file(write_bytes(root / "new", b"x"), root / name, root),
        ):
            with pytest.raises(ToolkitError, match=r"a pipe or a device, expected a plain file|a folder of that name"):
                write()
    (root / "new").unlink()
    assert {path.name: path.lstat().st_ino for path in root.iterdir()} == before


def test_a_log_is_appended_to_a_plain_file_of_one_name(tmp_path):
    (tmp_path / "plan.json").write_text("{")
    (tmp_path / "log.jsonl").hardlink_to(tmp_path / "plan.json")
    with pytest.raises(ToolkitError, match=r"log\.jsonl: the file has a second name"):
        RecordLog(tmp_path / "log.jsonl", Anything).append(Anything())
    os.mkfifo(tmp_path / "pipe.jsonl")
    with pytest.raises(ToolkitError, match="a pipe or a device"):
        RecordLog(tmp_path / "pipe.jsonl", Anything).append(Anything())
    assert (tmp_path / "plan.json").read_text() == "{"


def test_a_write_that_cannot_be_says_what_is_in_the_way(tmp_path):
    (tmp_path / "afile").write_text("")
    for path in ("afile/sub", "afile/sub/b"):
        with pytest.raises(ToolkitError, match="afile is a file, expected a folder"):
            write_bytes(tmp_path / path, b"")
    with pytest.raises(ToolkitError, match="the name is too long"):
        write_bytes(tmp_path / ("x" * 250), b"")


def test_names_that_no_file_can_have_are_no_paths(tmp_path):
    for path in ("x" * 256, "a/" + "ü" * 200, "a\0b", "\ud800"):
        with pytest.raises(ToolkitError, match="cannot be used"):
            inside(tmp_path, path)
