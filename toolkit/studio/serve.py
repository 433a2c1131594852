"""Open the door: which address, which port, and the server's life until Ctrl-C."""

import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.studio.access import Access, make_token

if TYPE_CHECKING:
    import asyncio

    import uvicorn
    from starlette.types import ASGIApp

LOOPBACK = "127.0.0.1"
USUAL_PORT = 8765
"""Tried first, so that a page that is open finds a restarted server again."""
UNROUTED = ("192.0.2.1", 9)
"""An address that is nobody's (RFC 5737); asking for the way there sends nothing."""
PATIENCE_S = 20.0
"""For the first line of a request to its last header; a phone takes milliseconds."""
EXTRA = "pip install '.[studio]' in the kit's folder"


@dataclass(frozen=True)
class Listener:
    """A socket that listens, and who is let in.

    Attributes:
        address, port: where it listens.
        access: whom the server answers.
        listener: the socket.
    """

    address: str
    port: int
    access: Access
    listener: socket.socket = field(repr=False)

    @property
    def url(self) -> str:
        """To open in a browser, with the token where there is one."""
        base = f"http://{self.address}:{self.port}/"
        return f"{base}?token={self.access.token}" if self.access.token else base


def listen(lan: bool = False, port: int | None = None, address: str | None = None) -> Listener:
    """Bind the address, so that trouble with it is said before anything is promised.

    Args:
        lan: listen to the local network, with a token, instead of to this machine alone.
        port: None tries the usual one, then takes any that is free.
        address: of this machine in the local network; None finds it.

    Raises:
        ToolkitError: the port is taken or not allowed, or no address of the local network is known.
    """
    host = (address or find_lan_address()) if lan else LOOPBACK
    listener = _bind(host, USUAL_PORT if port is None else port, port is None)
    # port 0 lets the system choose: it is known only now
    bound = listener.getsockname()[1]
    names = {host} if lan else {LOOPBACK, "localhost", "[::1]"}
    token = make_token() if lan else None
    # the port in the cookie's name: cookies are shared by all ports of a host
    access = Access(frozenset(f"{name}:{bound}" for name in names), token, f"toolkit_studio_{bound}")
    return Listener(host, bound, access, listener)


def find_lan_address() -> str:
    """This machine's address in the local network.

    Raises:
        ToolkitError: it has none.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(UNROUTED)
            found = str(probe.getsockname()[0])
        except OSError:
            found = LOOPBACK
    if found.startswith("127.") or found == "0.0.0.0":
        raise FieldError("{lan}: this machine has no address in a local network: join one, or name it by {address}", {})
    return found


def show_code(url: str, say: Callable[[str], object]) -> None:
    """Say a QR code of half blocks, line by line."""
    import io

    import segno

    buffer = io.StringIO()
    # the least correction makes the smallest code: a screen has no dirt to mend
    segno.make(url, error="l", micro=False).terminal(buffer, compact=True, border=2)
    for line in buffer.getvalue().splitlines():
        say(line)


def require_extra() -> None:
    """A `ToolkitError` that names the extra where what the studio needs is not installed."""
    from importlib.util import find_spec

    missing = [name for name in ("fastapi", "uvicorn") if find_spec(name) is None]
    if missing:
        raise ToolkitError(f"toolkit studio needs {' and '.join(missing)}, which the extra 'studio' brings: {EXTRA}")


def make_server(app: "ASGIApp") -> "uvicorn.Server":
    """A server that ends when its `should_exit` is set; what is being answered then is finished, for some seconds."""
    import uvicorn

    return uvicorn.Server(
        uvicorn.Config(
            app, log_level="warning", access_log=False, server_header=False, timeout_graceful_shutdown=3, ws="none",
            http=_make_protocol(),
        )
    )  # fmt: skip


def _make_protocol() -> "type[asyncio.Protocol]":
    from uvicorn.protocols.http.h11_impl import H11Protocol

    class Impatient(H11Protocol):
        """Closes a connection on which no whole request has come for a while: it would be kept open for ever."""

        _patience: "asyncio.TimerHandle | None" = None

        def connection_made(self, transport: "asyncio.Transport") -> None:  # type: ignore[override]
            super().connection_made(transport)
            self._wait()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            # not at every byte: a slow trickle would keep it open for ever
            if self._patience is None:
                self._wait()

        def connection_lost(self, exc: Exception | None) -> None:
            if self._patience is not None:
                self._patience.cancel()
            super().connection_lost(exc)

        def _wait(self) -> None:
            self._patience = self.loop.call_later(PATIENCE_S, self._judge)

        def _judge(self) -> None:
            self._patience = None
            if self.cycle is None or self.cycle.response_complete:
                self.transport.close()
            else:  # a request is being answered; who reads its body has a limit of its own
                self._wait()

    return Impatient


@contextmanager
def end_on_signal(server: "uvicorn.Server") -> Iterator[None]:
    """Ctrl-C and SIGTERM end the server, also before it runs, and interrupt nothing else.

    As an exception, a Ctrl-C is lost where Python happens to be in a callback, as it is while modules are imported.
    """

    def end(*_: object) -> None:
        server.should_exit = True

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _bind(host: str, port: int, any_will_do: bool) -> socket.socket:
    listener = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    # else the port of a server that was stopped is taken for a minute
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen()
        return listener
    except (OSError, OverflowError) as error:
        listener.close()
        if any_will_do and port:
            return _bind(host, 0, False)
        raise FieldError(_explain(host, port, error), {}) from None


def _explain(host: str, port: int, error: OSError | OverflowError) -> str:
    import errno

    code = getattr(error, "errno", None)
    if code == errno.EADDRINUSE:
        return f"port {port} of {host} is taken, perhaps by another studio: stop it, or choose another {{port}}"
    if code == errno.EACCES:
        return f"port {port} may not be used: choose a {{port}} above 1023"
    if code == errno.EADDRNOTAVAIL:
        return f"{host} is no address of this machine: leave {{address}} out, or name one that is"
    return f"cannot listen on {host} port {port}: {getattr(error, 'strerror', None) or error}"
