"""Clients that send nothing, too much at once, or what is no photograph."""

import asyncio
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from http.client import HTTPResponse

import pytest

from toolkit.rooms.photos.studio import serve, upload
from toolkit.rooms.photos.studio.app import UPLOAD_TYPE


@pytest.fixture
def address(desk, monkeypatch):
    """Where a real server listens whose patience is short."""
    monkeypatch.setattr(serve, "PATIENCE_S", 0.4)
    monkeypatch.setattr(upload, "BLOCK_S", 0.4)
    listener = socket.create_server(("127.0.0.1", 0))
    server = serve.make_server(desk.app)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    yield listener.getsockname()
    server.should_exit = True
    thread.join(5)


HEAD = b"POST /api/shots/1/photo HTTP/1.1\r\nhost: 127.0.0.1:8765\r\ncontent-type: application/octet-stream\r\n"


@pytest.mark.parametrize("sent", [b"", b"GET / HT", b"GET / HTTP/1.1\r\nhost: 127.0.0.1:8765\r\n", b"\0" * 9])
def test_a_connection_without_a_whole_request_is_closed(address, sent):
    with socket.create_connection(address, timeout=5) as client:
        client.sendall(sent)
        began = time.monotonic()
        while client.recv(4096):
            pass
        assert time.monotonic() - began < 3


def test_a_request_that_dribbles_is_closed_too(address):
    with socket.create_connection(address, timeout=5) as client:
        began = time.monotonic()
        try:
            while time.monotonic() - began < 4:
                client.sendall(b"G")
                time.sleep(0.1)
        except OSError:
            pass
        assert time.monotonic() - began < 3


def test_a_body_that_stops_coming_is_refused(address, desk):
    with socket.create_connection(address, timeout=5) as client:
        client.sendall(HEAD + b"content-length: 5000\r\n\r\nhalf")
        answer = client.recv(4096)
    assert b" 408 " in answer.splitlines()[0]
    assert not list(desk.session.folders.incoming_dir.iterdir())


def test_a_usual_request_is_answered_and_the_connection_kept(address):
    with socket.create_connection(address, timeout=5) as client:
        for _ in range(2):
            client.sendall(b"GET /api/state HTTP/1.1\r\nhost: 127.0.0.1:8765\r\n\r\n")
            answer = HTTPResponse(client)
            answer.begin()
            assert answer.status == 200 and answer.read()


def test_eight_at_once_for_one_pose_are_kept_or_told_of_the_later_one(desk, photo):
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda seed: desk.send(1, photo(seed)), range(24)))
    assert {answer.status_code for answer in answers} <= {200, 409}
    assert any(answer.status_code == 200 for answer in answers)
    assert all("later photograph" in one.json()["error"] for one in answers if one.status_code == 409)
    assert desk.statuses()[0] == "waiting"


@pytest.mark.parametrize("size", [(1, 20000), (20000, 1), (8, 8), (40, 900)])
def test_a_picture_that_shows_nothing_is_no_photograph(desk, photo, size):
    answer = desk.send(1, photo(size=size, kind="PNG"))
    assert answer.status_code == 415 and "too small to be measured" in answer.json()["error"]


def test_a_length_of_thousands_of_digits_is_too_large(desk):
    headers = {"content-type": UPLOAD_TYPE, "content-length": "9" * 5000}  # more digits than int() takes
    answer = desk.client.post("/api/shots/1/photo", content=b"x", headers=headers)
    assert answer.status_code == 413 and list(answer.json()) == ["error"]


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/api/shots/x"), ("GET", "/api/shots/99999999999999999999"), ("GET", "/api/shots/0"),
        ("GET", "/nowhere"),
        ("POST", "/api/shots/1/keep"), ("POST", "/api/shots/1/skip?skipped=maybe"), ("DELETE", "/api/state"),
        ("POST", "/api/shots/1/photo"), ("GET", "/api/shots/1/photo.jpg?large=x"), ("GET", "/api/shots/1/verdict"),
    ],
)  # fmt: skip
def test_every_error_has_one_shape(desk, method, path):
    answer = desk.client.request(method, path)
    assert 400 <= answer.status_code < 500
    assert list(answer.json()) == ["error"] and isinstance(answer.json()["error"], str)


def test_a_defect_has_that_shape_too(desk, monkeypatch):
    from fastapi.testclient import TestClient

    def fail(*_):
        raise ZeroDivisionError

    monkeypatch.setattr(type(desk.session), "list_shots", fail)
    answer = TestClient(desk.app, base_url="http://127.0.0.1:8765", raise_server_exceptions=False).get("/api/state")
    assert answer.status_code == 500 and "a defect of the studio: ZeroDivisionError" in answer.json()["error"]


def test_the_limit_of_a_block_is_not_that_of_a_whole_photograph(monkeypatch):
    monkeypatch.setattr(upload, "BLOCK_S", 0.2)

    async def drip():
        for _ in range(4):
            await asyncio.sleep(0.1)
            yield b"x"

    async def collect():
        return [block async for block in upload._in_time(drip())]

    assert asyncio.run(collect()) == [b"x"] * 4
