"""The studio's server: address, port, access, and its life until Ctrl-C."""

import hmac
import secrets
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.cookies import SimpleCookie
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl, urlencode

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from toolkit.core.errors import FieldError

if TYPE_CHECKING:
    import asyncio

    import uvicorn
    from starlette.types import ASGIApp


TOKEN_BYTES = 24
SAFE_METHODS = ("GET", "HEAD")
QUERY_NAME = "token"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; media-src 'self' blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Only files of the page run: nothing from elsewhere, nothing inline."""
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",  # the first address holds the token
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(self), microphone=(), geolocation=()",
}
LOOPBACK = "127.0.0.1"
USUAL_PORT = 8765
"""Tried first, so that an open page finds a restarted server."""
UNROUTED = ("192.0.2.1", 9)
"""An address without a host (RFC 5737); asking for the route there sends nothing."""
PATIENCE_S = 20.0
"""Limit from the first line of a request to its last header; a phone takes milliseconds."""


def make_token() -> str:
    """A random token for a run of the server, 192 bits."""
    return secrets.token_urlsafe(TOKEN_BYTES)


@dataclass(frozen=True)
class Access:
    """Requests that the server answers.

    Attributes:
        hosts: values of the Host header for this server; others are DNS rebinding.
        token: that every request must hold; None on loopback.
        cookie: name of the token's cookie.
    """

    hosts: frozenset[str]
    token: str | None = field(default=None, repr=False)
    cookie: str = "toolkit_studio"

    def is_this_host(self, headers: Headers) -> bool:
        """Whether the request is for this server: a single Host header, and a known host."""
        named = headers.getlist("host")
        # programs differ in which of two Host headers they read: neither counts
        return len(named) == 1 and named[0].lower() in self.hosts

    def is_same_site(self, method: str, headers: Headers) -> bool:
        """Whether a request that changes something comes from this server's own page, or from no page at all."""
        if method in SAFE_METHODS:
            return True
        origin = headers.get("origin")
        # browsers name the origin of a request, and no page can change that
        if origin is not None and origin.lower() not in {f"http://{host}" for host in self.hosts}:
            return False
        # absent without a browser, as in curl: such a client needs the token, if the server has a token
        return headers.get("sec-fetch-site", "same-origin") in ("same-origin", "none")

    def knows(self, token: str | None) -> bool:
        """Compare with the token in constant time."""
        return self.token is None or (token is not None and hmac.compare_digest(token.encode(), self.token.encode()))


class Guard:
    """Refuses every request that `Access` does not admit, with an empty 403, before anything else sees it."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The ASGI call."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal = Response(status_code=403)
        # the page uses no websocket: 1008 is "policy violation" (RFC 6455)
        if scope["type"] != "http":
            await send({"type": "websocket.close", "code": 1008})
            return
        headers, access = Headers(scope=scope), self._access
        query = parse_qsl(scope.get("query_string", b"").decode("latin-1"), keep_blank_values=True)
        asked = next((value for name, value in query if name == QUERY_NAME), None)
        admitted = access.is_this_host(headers) and access.is_same_site(scope["method"], headers)
        brought = [asked, _read_cookie(headers, access.cookie), _read_bearer(headers)]
        # a list, so that all three are always compared
        if not (admitted and any([access.knows(token) for token in brought])):
            await refusal(scope, receive, _add_headers(send))
            return
        # only when the page is opened: a script or a picture with the token needs no detour
        if asked is not None and access.token is not None and scope["path"] == "/" and scope["method"] == "GET":
            rest = urlencode([(name, value) for name, value in query if name != QUERY_NAME])
            await self._move_to_cookie(rest)(scope, receive, _add_headers(send))
            return
        await self._app(scope, receive, _add_headers(send))

    def _move_to_cookie(self, rest: str) -> Response:
        """Move a known token from the address bar and the history to a cookie."""
        moved = Response(status_code=303, headers={"location": f"/?{rest}" if rest else "/"})
        # HttpOnly: no script reads it; Lax: links to the page send it
        moved.set_cookie(self._access.cookie, self._access.token or "", httponly=True, samesite="lax", path="/")
        return moved


def _read_cookie(headers: Headers, name: str) -> str | None:
    jar: SimpleCookie = SimpleCookie()
    try:
        jar.load(headers.get("cookie", ""))
    except Exception:  # http.cookies raises several kinds on what is no cookie
        return None
    return jar[name].value if name in jar else None


def _read_bearer(headers: Headers) -> str | None:
    kind, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() if kind.lower() == "bearer" and token else None


def _add_headers(send: Send) -> Send:
    async def send_with(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers[name] = value
            if "cache-control" not in headers:
                # answers change with every photograph
                headers["cache-control"] = "no-store"
        await send(message)

    return send_with


@dataclass(frozen=True)
class Listener:
    """A socket that listens at an address and port, and its access."""

    address: str
    port: int
    access: Access
    listener: socket.socket = field(repr=False)

    @property
    def url(self) -> str:
        """Address to open in a browser, with any token."""
        base = f"http://{self.address}:{self.port}/"
        return f"{base}?token={self.access.token}" if self.access.token else base


def listen(lan: bool = False, port: int | None = None, address: str | None = None) -> Listener:
    """Bind the address before anything is shown.

    Args:
        lan: listen to the local network, with a token, instead of to this machine alone.
        port: None tries the usual port, then any free port.
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
    """Return this machine's address in the local network; a `ToolkitError` without an address."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(UNROUTED)
            found = str(probe.getsockname()[0])
        except OSError:
            found = LOOPBACK
    if found.startswith("127.") or found == "0.0.0.0":
        raise FieldError("{lan}: this machine has no address in a local network: join a network, or give {address}", {})
    return found


def show_code(url: str, say: Callable[[str], object]) -> None:
    """Print a QR code of half blocks, line by line."""
    import io

    import segno

    buffer = io.StringIO()
    # the least correction makes the smallest code, and a screen has no dirt
    segno.make(url, error="l", micro=False).terminal(buffer, compact=True, border=2)
    for line in buffer.getvalue().splitlines():
        say(line)


def make_server(app: "ASGIApp") -> "uvicorn.Server":
    """A server that ends when its `should_exit` is set, after some seconds for open requests."""
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
        """Closes a connection without a whole request for a while, which would be kept open for ever."""

        _patience: "asyncio.TimerHandle | None" = None

        def connection_made(self, transport: "asyncio.Transport") -> None:  # type: ignore[override]
            super().connection_made(transport)
            self._wait()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            # not at every byte, or a slow trickle would keep it open for ever
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
            else:  # a request is being answered; its body has another limit
                self._wait()

    return Impatient


@contextmanager
def end_on_signal(server: "uvicorn.Server") -> Iterator[None]:
    """End the server by Ctrl-C and SIGTERM, also before it runs, and interrupt nothing else.

    As an exception, a Ctrl-C would be lost in a callback, as Python is in while modules are imported.
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
    # without this the port of a stopped server is taken for a minute
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
        return f"{host} is not an address of this machine: leave {{address}} out, or correct it"
    return f"cannot listen on {host} port {port}: {getattr(error, 'strerror', None) or error}"
