"""What answers instead of a simulator: numbers, maps and pictures that are none, and more of them than memory holds."""

import math
import socket
import struct
import threading

import pytest
from hostile_checks import count, limited
from hostile_inputs import values
from hypothesis import example, given
from hypothesis import strategies as st

msgpack = pytest.importorskip("msgpack")

from toolkit.core.errors import ToolkitError  # noqa: E402
from toolkit.rooms.worlds.airsim import (  # noqa: E402
    Connection,
    _Image,
    unpack_pose,
)

HEAD = b"\x94\x01\x01"
"""Of the first reply: a list of four, a reply, its number."""
POSE = {
    "position": {"x_val": 0.0, "y_val": 0.0, "z_val": 0.0},
    "orientation": {"w_val": 1.0, "x_val": 0.0, "y_val": 0.0, "z_val": 0.0},
}
IMAGE = {
    "image_data_uint8": b"", "image_data_float": [1.0] * 4, "width": 2, "height": 2,
    "camera_position": POSE["position"], "camera_orientation": POSE["orientation"],
}  # fmt: skip


def ask(content: bytes):
    """What a call gives when these bytes come back, or None after a line."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer():
            connection, _ = server.accept()
            with connection:
                connection.recv(1000)
                try:
                    connection.sendall(content)
                except OSError:
                    return  # hung up on

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        try:
            with Connection(*server.getsockname(), "here", 20) as connection:
                return said_in_a_line(lambda: connection.call("simGetImages"))
        finally:
            thread.join()


def said_in_a_line(call):
    count("replies")
    try:
        with limited():
            return call()
    except ToolkitError as error:
        said = str(error)
        assert "\n" not in said and len(said) < 1000 and "Error" not in said, said
        return None


NESTED = 500
BOMBS = {
    "empty lists": HEAD + b"\xc0\xdd" + struct.pack(">I", 60 << 20) + b"\x90" * (60 << 20),
    "list that is not sent": HEAD + b"\xc0\xdd\xff\xff\xff\xff",
    "deep": HEAD + b"\xc0" + b"\x91" * 100_000 + b"\x00",
    "deep words": HEAD + b"\x91" * NESTED + b"\x00\xc0",
    "map with a list for a key": HEAD + b"\xc0\x81\x90\x00",
    "long words": HEAD + b"\xdb" + struct.pack(">I", 30 << 20) + b"x" * (30 << 20) + b"\xc0",
    "other kind": HEAD + b"\xc0\xc7\x01\x7fx" + b"x",
}


@pytest.mark.parametrize("kind", BOMBS)
def test_a_reply_that_is_none_is_a_line(kind):
    ask(BOMBS[kind])


def test_a_whole_reply_is_read():
    assert ask(HEAD + b"\xc0" + msgpack.packb([1.5, "a"])) == [1.5, b"a"]


FIELDS = st.sampled_from(sorted(IMAGE))
ODD = values | st.sampled_from(
    [[256], [-1], ["x"], [None] * 4, [[1.0]] * 4, [b""] * 4, b"\x89PNG\r\n\x1a\n", {"x_val": 1e-320}]
)


@given(name=FIELDS, value=ODD)
def test_an_image_that_is_none_is_a_line(name, value):
    def read():
        image = _Image.read(IMAGE | {name: value}, "here")
        image.read_depth()
        image.decode()

    said_in_a_line(read)


@pytest.mark.filterwarnings("error")
def test_a_depth_beyond_single_precision_is_endless():
    depth = _Image.read(IMAGE | {"image_data_float": [1.0, 1e300, -1e300, 2.0]}, "here").read_depth()
    assert depth.tolist() == [[1.0, math.inf], [math.inf, 2.0]]


@example(part="orientation", axis="w", value=10**400)
@given(part=st.sampled_from(sorted(POSE)), axis=st.sampled_from("wxyz"), value=ODD)
def test_a_pose_that_is_none_is_a_line(part, axis, value):
    said_in_a_line(lambda: unpack_pose(POSE | {part: POSE[part] | {f"{axis}_val": value}}, "here"))


def test_a_turn_of_no_length_is_no_pose():
    none = {f"{axis}_val": 1e-320 for axis in "wxyz"}
    assert said_in_a_line(lambda: unpack_pose(POSE | {"orientation": none}, "here")) is None
