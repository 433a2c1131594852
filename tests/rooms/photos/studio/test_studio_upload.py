import errno
import re
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from PIL import Image

from toolkit.core.files import explain_write_error
from toolkit.rooms.photos.studio import upload
from toolkit.rooms.photos.studio.upload import UploadFolders

NAME = re.compile(r"\d{8}-\d{6}-\d{6}-[0-9a-f]{32}\.(jpg|png)")


def everything_in(space):
    folders = (space.root / ".studio", space.captures_dir)
    return [path for folder in folders for path in folder.rglob("*") if path.is_file()]


def test_an_upload_is_measured_and_waits_under_a_generated_name(desk, photo):
    answer = desk.send(
        1, photo(), **{"content-disposition": 'attachment; filename="../../evil.php"', "x-file-name": "x"}
    )
    verdict = answer.json()
    assert answer.status_code == 200 and verdict["good"] and not verdict["there"]
    assert [(gate["name"], gate["status"]) for gate in verdict["gates"]] == [
        ("brightness", "passed"), ("brightness", "not checked"),
    ]  # fmt: skip
    (file,) = everything_in(desk.space)
    assert NAME.fullmatch(file.name) and file.read_bytes() == photo()
    assert desk.statuses() == ["waiting", "open", "open", "open"]


def test_a_photograph_that_fails_a_gate_is_said_to(desk, photo):
    verdict = desk.send(1, photo(level=20)).json()
    assert not verdict["good"] and verdict["gates"][0]["advice"] == "use more light"


def test_the_kind_goes_by_the_content(desk, photo):
    assert desk.send(1, photo(kind="PNG")).status_code == 200
    assert [file.suffix for file in everything_in(desk.space)] == [".png"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"<?php echo 1;", "cannot be read"),
        (b"GIF89a" + bytes(20), "cannot be read"),
        (b"\xff\xd8\xff\xe0" + bytes(400), "cannot be read"),
        (b"<svg xmlns='http://www.w3.org/2000/svg'/>", "cannot be read"),
        (b"", "empty"),
    ],
)
def test_what_is_no_photograph_is_refused_and_deleted(desk, content, words):
    answer = desk.send(1, content)
    assert answer.status_code == 415 and words in answer.json()["error"]
    assert everything_in(desk.space) == [] and desk.statuses()[0] == "open"


def test_what_was_cut_short_and_what_is_a_picture_alone_are_refused(desk, photo):
    cut = desk.send(1, photo(size=(400, 300))[:9000])
    drawing = desk.send(1, photo(kind="GIF"))
    assert cut.status_code == drawing.status_code == 415 and "GIF" in drawing.json()["error"]
    assert everything_in(desk.space) == []


@pytest.mark.parametrize("kind", ["multipart/form-data; boundary=x", "text/plain", "image/jpeg"])
def test_only_bare_bytes_are_taken_which_no_form_can_send(desk, photo, kind):
    assert desk.send(1, photo(), **{"content-type": kind}).status_code == 415
    assert everything_in(desk.space) == []


def test_a_large_upload_is_refused_whether_it_says_so_or_not(reopen, photo):
    desk = reopen(most_bytes=10_000)
    large = photo(size=(400, 300))
    read = []

    def blocks():
        for start in range(0, 10 * len(large), 4096):
            read.append(start)
            yield large[start : start + 4096] or bytes(4096)

    announced, streamed = desk.send(1, large), desk.send(1, blocks())
    assert announced.status_code == streamed.status_code == 413
    assert "larger than" in streamed.json()["error"] and everything_in(desk.space) == []


@pytest.mark.parametrize(
    ("number", "status"), [("0", 404), ("5", 404), ("-1", 404), ("..%2f..%2fetc", 404), ("1.5", 422), ("a", 422)]
)
def test_a_shot_is_a_number_of_the_list_and_never_a_path(desk, photo, number, status):
    assert desk.send(number, photo()).status_code == status
    assert everything_in(desk.space) == []


def test_a_full_disk_is_said_in_one_line_and_leaves_nothing(desk, photo, monkeypatch):
    def fill(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("toolkit.core.files.os.fsync", fill)
    answer = desk.send(1, photo())
    assert answer.status_code == 507 and "disk is full" in answer.json()["error"]
    assert everything_in(desk.space) == []


def test_a_disk_that_fills_while_a_photograph_is_kept_loses_nothing(desk, photo, monkeypatch):
    sha256 = desk.send(1, photo()).json()["sha256"]

    def fail(path, content, root=None):
        raise explain_write_error(path, OSError(errno.ENOSPC, "full"))

    with monkeypatch.context() as patch:
        patch.setattr("toolkit.rooms.photos.importing.store.write_bytes", fail)
        answer = desk.keep(1, sha256)
        assert answer.status_code == 507 and "disk is full" in answer.json()["error"]
    assert desk.statuses()[0] == "waiting"
    assert desk.keep(1, sha256).status_code == 200 and desk.statuses()[0] == "done"


def test_what_a_stopped_server_left_half_is_swept_away(desk, reopen):
    half = UploadFolders(desk.space.root).new_incoming()
    half.write_bytes(b"half")
    reopen()
    assert not half.exists()


def test_any_other_trouble_of_the_disk_is_one_line_too(desk, photo, monkeypatch):
    desk.send(1, photo())

    def fail(self, step):
        raise OSError(errno.EROFS, "Read-only file system", "waiting")

    monkeypatch.setattr(UploadFolders, "drop_waiting", fail)
    answer = desk.client.post("/api/shots/1/discard")
    assert answer.status_code == 507 and "read-only" in answer.json()["error"]


def test_a_picture_of_too_many_pixels_is_refused_before_it_is_decoded(tmp_path, monkeypatch):
    file = tmp_path / "wide.png"
    Image.new("1", (9000, 8000)).save(file)
    monkeypatch.setattr(upload, "load_pixels", lambda photo: pytest.fail("it was decoded"))
    with pytest.raises(upload.Refused, match="72 megapixels: set the camera to 64 or fewer") as refused:
        upload.open_upload(file)
    assert refused.value.status == 413


def test_photographs_are_decoded_one_at_a_time(tmp_path, monkeypatch):
    file, within, most = tmp_path / "photo.png", [], []
    Image.new("RGB", (64, 64)).save(file)

    def decode(photo):
        within.append(photo)
        most.append(len(within))
        time.sleep(0.02)
        within.pop()
        return np.zeros((64, 64, 3), np.uint8)

    monkeypatch.setattr(upload, "load_pixels", decode)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(upload.open_upload, [file] * 8))
    assert most == [1] * 8
