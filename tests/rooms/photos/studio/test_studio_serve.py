import io
import socket
import subprocess
import sys

import cv2
import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.rooms.photos.studio import require_extra, serve
from toolkit.rooms.photos.studio.serve import listen, show_code


@pytest.fixture
def taken():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        yield other.getsockname()[1]


def test_loopback_is_the_default_and_needs_no_token():
    door = listen()
    with door.listener:
        assert door.address == "127.0.0.1" == door.listener.getsockname()[0]
        assert door.access.token is None and door.url == f"http://127.0.0.1:{door.port}/"
        assert f"localhost:{door.port}" in door.access.hosts


def test_a_taken_port_is_said(taken):
    with pytest.raises(ToolkitError, match=f"port {taken} of 127.0.0.1 is taken.*choose another port"):
        listen(port=taken)


def test_without_a_wish_any_free_port_will_do(taken, monkeypatch):
    monkeypatch.setattr(serve, "USUAL_PORT", taken)
    door = listen()
    with door.listener:
        assert door.port not in (0, taken)


def test_the_local_network_gets_its_address_and_a_token(monkeypatch):
    monkeypatch.setattr(serve, "find_lan_address", lambda: "127.0.0.2")  # every 127.x is this machine
    door = listen(lan=True)
    with door.listener:
        assert door.listener.getsockname()[0] == "127.0.0.2"
        assert door.access.hosts == {f"127.0.0.2:{door.port}"}
        assert door.url == f"http://127.0.0.2:{door.port}/?token={door.access.token}" and len(door.access.token) >= 32


def test_an_address_of_another_machine_is_said():
    with pytest.raises(ToolkitError, match=r"192\.0\.2\.7 is not an address of this machine"):
        listen(lan=True, address="192.0.2.7")


def test_no_network_is_said(monkeypatch):
    class Deaf(socket.socket):
        def connect(self, address):
            raise OSError(101, "Network is unreachable")

    monkeypatch.setattr(serve.socket, "socket", Deaf)
    with pytest.raises(ToolkitError, match=r"no address in a local network.*give address"):
        listen(lan=True)


def test_the_code_in_the_terminal_is_read_by_another_library():
    pytest.importorskip("segno", reason="needs the extra 'studio' (segno)")
    url = "http://192.168.1.23:8765/?token=" + "x" * 32
    text = io.StringIO()
    show_code(url, lambda line: text.write(f"{line}\n"))
    rows = [row for row in text.getvalue().split("\n") if row.strip("\x1b[0m ")]
    halves = {"█": (1, 1), "▀": (1, 0), "▄": (0, 1), " ": (0, 0)}
    cells = [[halves[sign] for sign in row if sign in halves] for row in rows]
    width = max(map(len, cells))
    dots = np.zeros((2 * len(cells), width), np.uint8)
    for i, row in enumerate(cells):
        for j, (upper, lower) in enumerate(row):
            dots[2 * i, j], dots[2 * i + 1, j] = upper, lower
    picture = cv2.copyMakeBorder(
        np.kron(dots * 255, np.ones((6, 6), np.uint8)), *[48] * 4, cv2.BORDER_CONSTANT, value=255
    )
    found = [cv2.QRCodeDetector().detectAndDecode(one)[0] for one in (picture, 255 - picture)]
    assert url in found


def test_what_is_not_installed_is_named_with_its_extra(monkeypatch):
    monkeypatch.setattr("toolkit.rooms.photos.studio.find_spec", lambda name: None if name == "uvicorn" else object())
    with pytest.raises(ToolkitError, match=r"needs uvicorn, .*pip install '\.\[studio\]'"):
        require_extra()


WITHOUT = """
import sys
sys.modules |= dict.fromkeys(("fastapi", "starlette", "uvicorn", "h11", "anyio"))
sys.argv = ["toolkit", "studio"]
from toolkit.__main__ import main
main()
"""


def test_the_command_names_the_extra_too(tmp_path):
    """Nothing of the extra is imported before it is asked for."""
    make_workspace(tmp_path)
    done = subprocess.run([sys.executable, "-c", WITHOUT], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("error: toolkit studio needs fastapi and uvicorn") and done.stderr.count("\n") <= 2


def test_all_that_is_needed_is_here():
    require_extra()
