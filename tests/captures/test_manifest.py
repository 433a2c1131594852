"""The manifest: appended line by line, and whole whatever stopped the writer."""

import errno
import json

import pytest

from toolkit.captures.manifest import MANIFEST, CaptureRecord, append_record, is_finished, read_manifest
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes


def record(path="crate/patched/pose_01.jpg", **fields):
    return CaptureRecord(path=path, object="crate", variant="patched", **fields)


def test_what_is_appended_is_read_back_and_the_last_line_wins(tmp_path):
    T_world_camera = [[1.0, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]
    first = record(pose_id=1, T_world_camera=T_world_camera, made={"seed": 3}, image_sha256="0" * 64)
    append_record(tmp_path, first)
    append_record(tmp_path, record("crate/patched/pose_02.jpg"))
    assert read_manifest(tmp_path) == {
        first.path: first,
        "crate/patched/pose_02.jpg": record("crate/patched/pose_02.jpg"),
    }
    newer = record(pose_id=9)
    append_record(tmp_path, newer)
    assert read_manifest(tmp_path)[first.path] == newer
    assert len((tmp_path / MANIFEST).read_text().splitlines()) == 3


def test_without_a_manifest_there_are_no_records(tmp_path):
    assert read_manifest(tmp_path) == {}


@pytest.mark.parametrize("lost", [1, 2, 30, 100])
def test_a_line_cut_short_by_a_kill_costs_that_line_at_most(tmp_path, lost):
    append_record(tmp_path, record("crate/patched/a.jpg"))
    append_record(tmp_path, record("crate/patched/b.jpg"))
    file = tmp_path / MANIFEST
    file.write_bytes(file.read_bytes()[:-lost])
    whole = {"crate/patched/a.jpg"} | ({"crate/patched/b.jpg"} if lost == 1 else set())  # only the line's end is gone
    assert set(read_manifest(tmp_path)) == whole
    append_record(tmp_path, record("crate/patched/c.jpg"))
    assert set(read_manifest(tmp_path)) == whole | {"crate/patched/c.jpg"}
    for line in file.read_text().splitlines():
        json.loads(line)


def test_a_file_that_is_one_broken_line_starts_anew(tmp_path):
    (tmp_path / MANIFEST).write_bytes(b'{"path": "crate/pat')
    assert read_manifest(tmp_path) == {}
    append_record(tmp_path, record())
    assert set(read_manifest(tmp_path)) == {record().path}


@pytest.mark.parametrize("name", ["größe 1.jpg", "a\u2028b.jpg", "a\x85b.jpg", 'quo"te.jpg', "back\\slash.jpg"])
def test_any_file_name_survives(tmp_path, name):
    append_record(tmp_path, record(f"crate/patched/{name}"))
    append_record(tmp_path, record())
    assert list(read_manifest(tmp_path)) == [f"crate/patched/{name}", record().path]


def test_windows_line_ends_and_empty_lines_are_read(tmp_path):
    append_record(tmp_path, record())
    file = tmp_path / MANIFEST
    file.write_bytes(b"\r\n" + file.read_bytes().replace(b"\n", b"\r\n") + b"\r\n")
    assert set(read_manifest(tmp_path)) == {record().path}


@pytest.mark.parametrize("broken", ['{"path": 3}', "not json", "[]", '{"path": "a", "object": "b"}'])
def test_a_broken_line_in_the_middle_is_named_by_its_number(tmp_path, broken):
    append_record(tmp_path, record("crate/patched/a.jpg"))
    with (tmp_path / MANIFEST).open("a") as file:
        file.write(broken + "\n")
    append_record(tmp_path, record())
    with pytest.raises(ToolkitError, match=r"manifest\.jsonl: line 2 is broken .*: delete that line"):
        read_manifest(tmp_path)


@pytest.mark.parametrize("path", ["../../etc/passwd", "/etc/passwd", "crate/../../x.jpg", "a\0b"])
def test_no_path_leaves_the_folder(tmp_path, path):
    (tmp_path / "sim").mkdir()
    append_record(tmp_path / "sim", record(path))
    with pytest.raises(ToolkitError, match=r"leaves its folder|cannot be used"):
        read_manifest(tmp_path / "sim")


def test_finished_means_same_inputs_and_whole_file(tmp_path):
    (tmp_path / "crate").mkdir()
    (tmp_path / "crate/a.jpg").write_bytes(b"picture")
    done = record("crate/a.jpg", image_sha256=sha256_bytes(b"picture"), inputs_sha256="1" * 64)
    assert is_finished(tmp_path, done, "1" * 64)
    assert not is_finished(tmp_path, done, "2" * 64)
    assert not is_finished(tmp_path, None, "1" * 64)
    (tmp_path / "crate/a.jpg").write_bytes(b"pictura")
    assert not is_finished(tmp_path, done, "1" * 64)
    (tmp_path / "crate/a.jpg").unlink()
    assert not is_finished(tmp_path, done, "1" * 64)


def test_a_full_disk_is_one_line(tmp_path, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("toolkit.core.records.os.fsync", full)
    with pytest.raises(ToolkitError, match=r"cannot write .*manifest\.jsonl: the disk is full"):
        append_record(tmp_path, record())


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("T_world_camera", [[1, 0, 0, 0]] * 3),
        ("T_world_camera", [[1, 0, 0, 0], [0, 1, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
        ("T_world_camera", [[float("nan")] * 4] * 4),
        ("T_world_camera", [[float("inf")] * 4] * 4),
        ("T_world_camera", [[1e300] * 4] * 4),
        ("intrinsics", {"width": 640}),
        ("intrinsics", {"width": 0, "height": 1, "fx": 1, "fy": 1, "cx": 0, "cy": 0}),
        ("intrinsics", {"width": float("inf"), "height": 1, "fx": 1, "fy": 1, "cx": 0, "cy": 0}),
        ("pose_id", 10**30),
        ("pose_id", -1),
        ("made", {"distortion": ["a"]}),
        ("made", {"distortion": [float("nan")]}),
        ("made", {"distortion": [0] * 15}),
    ],
)
def test_numbers_that_describe_no_camera_are_named(tmp_path, field, value):
    line = {"path": "a.jpg", "object": "a", "variant": "b", field: value}
    (tmp_path / MANIFEST).write_text(json.dumps(line) + "\n")
    with pytest.raises(ToolkitError, match=f"line 1 is broken .*{field}"):
        read_manifest(tmp_path)


def test_a_manifest_that_is_a_folder_is_no_empty_manifest(tmp_path):
    (tmp_path / MANIFEST).mkdir()
    with pytest.raises(ToolkitError, match="it is a folder, expected a file"):
        read_manifest(tmp_path)
