"""Calls to a program that speaks msgpack-rpc over TCP, one at a time.

A request is [0, id, method, arguments], its reply [1, id, error, result]: the specification of msgpack-rpc, as rpclib,
the server in AirSim's family, speaks it.
"""

import contextlib
import re
import socket
import time
from collections.abc import Sequence

from toolkit.core.errors import ToolkitError
from toolkit.core.limits import limit_memory
from toolkit.core.text import shorten

REQUEST, REPLY = 0, 1
MOST_REPLY_BYTES = 256 << 20
"""Of one reply: three pictures of 4096² with depth as text-book floats."""
MOST_BYTES = 1 << 30
"""Of one reply as Python holds it, where a byte may become an object of its own."""
MOST_LEVELS = 8
"""Of an error's words within one another."""
CHUNK_BYTES = 1 << 20
LONGEST_WORDS = 300
ARGUMENT_COUNT = re.compile(r"invalid number of arguments\. Expected: (\d+)")
NOT_FOUND = re.compile(r"Function '\w+' .*not found|could not find function", re.IGNORECASE)


class CallError(ToolkitError):
    """The server answered a call with an error.

    Attributes:
        words: the server's own.
    """

    def __init__(self, where: str, method: str, words: str) -> None:
        self.words = words
        super().__init__(f"{where} refuses {method}: {shorten(words, LONGEST_WORDS)}")

    @property
    def expected_arguments(self) -> int | None:
        """How many arguments the server's function takes, where their number was the error."""
        found = ARGUMENT_COUNT.search(self.words)
        return int(found[1]) if found else None

    @property
    def is_unknown(self) -> bool:
        """Whether the server has no such function."""
        return NOT_FOUND.search(self.words) is not None


class Connection:
    """A connection to a msgpack-rpc server; a context manager that closes it.

    Attributes:
        where: the server's address as errors name it.
        timeout_s: longest wait for one reply.
    """

    def __init__(self, host: str, port: int, where: str, timeout_s: float = 60.0) -> None:
        """Connect.

        Raises:
            ToolkitError: msgpack is not installed, or nobody answers.
        """
        try:
            import msgpack
        except ImportError as error:
            message = (
                f"a simulator needs msgpack, which is not installed ({error}): pip install '.[airsim]' in the kit's "
                "folder"
            )
            raise ToolkitError(message) from None
        self.where, self.timeout_s = where, timeout_s
        self._pack = msgpack.Packer()
        # raw: pictures come as text or as bytes, by the server's version
        self._unpacker = msgpack.Unpacker(raw=True, strict_map_key=False, max_buffer_size=MOST_REPLY_BYTES)
        self._calls = 0
        try:
            self._socket = socket.create_connection((host, port), timeout=min(timeout_s, 10.0))
        except OSError as error:
            raise ToolkitError(
                f"{where}: no answer ({error.strerror or error}): start the simulator, press Play, and check host "
                "and port (ApiServerPort in its settings.json)"
            ) from None

    def __enter__(self) -> "Connection":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Hang up."""
        with contextlib.suppress(OSError):
            self._socket.close()

    def call(self, method: str, *arguments: object) -> object:
        """The result of a server's function; texts in it are bytes.

        Raises:
            CallError: the server answers with an error.
            ToolkitError: no answer in time, no connection any more, or an answer that is no msgpack-rpc.
        """
        self._calls += 1
        try:
            self._socket.settimeout(self.timeout_s)
            self._socket.sendall(self._pack.pack([REQUEST, self._calls, method, list(arguments)]))
            with limit_memory(MOST_BYTES):
                reply = self._receive(method)
        except MemoryError:
            raise ToolkitError(
                f"{self.where}: its answer to {method} takes over {MOST_BYTES >> 30} GB: ask for smaller pictures"
            ) from None
        except TimeoutError:
            raise ToolkitError(
                f"{self.where}: no answer to {method} within {self.timeout_s:g} s: see whether the simulator still runs"
            ) from None
        except OSError as error:
            raise self._lost(method, str(error.strerror or error)) from None
        # a reply is [1, number of the call, error, result] (msgpack-rpc's specification)
        if not isinstance(reply, list) or len(reply) != 4 or reply[:2] != [REPLY, self._calls]:
            raise self._no_rpc(method)
        if reply[2] is not None:
            raise CallError(self.where, method, _words_of(reply[2]))
        return reply[3]

    def _receive(self, method: str) -> object:
        import msgpack

        end = time.monotonic() + self.timeout_s
        while True:
            try:
                return self._unpacker.unpack()
            except msgpack.OutOfData:
                pass
            except (ValueError, TypeError, msgpack.UnpackException):  # a map's key may be a list
                raise self._no_rpc(method) from None
            # what is left of the whole: a server that sends a byte now and then must not hold us for ever
            self._socket.settimeout(max(end - time.monotonic(), 1e-3))
            content = self._socket.recv(CHUNK_BYTES)
            if not content:
                raise self._lost(method, "it closed the connection")
            try:
                self._unpacker.feed(content)
            except msgpack.BufferFull:
                raise ToolkitError(
                    f"{self.where}: its answer to {method} is larger than {MOST_REPLY_BYTES >> 20} MB: ask for smaller "
                    "pictures"
                ) from None

    def _lost(self, method: str, why: str) -> ToolkitError:
        return ToolkitError(f"{self.where}: lost during {method} ({why}): see the simulator's window or its log")

    def _no_rpc(self, method: str) -> ToolkitError:
        return ToolkitError(
            f"{self.where}: what answers {method} does not speak msgpack-rpc: expected a simulator of AirSim's family; "
            "check the port"
        )


def _words_of(error: object, levels: int = MOST_LEVELS) -> str:
    """A server's error in words: a text, or a list or map with one in it."""
    if isinstance(error, bytes):
        return error.decode("utf-8", errors="replace")
    if isinstance(error, dict):
        error = list(error.values())
    if isinstance(error, Sequence) and not isinstance(error, str):
        return ", ".join(_words_of(one, levels - 1) for one in error[:MOST_LEVELS]) if levels else ""
    return str(error)
