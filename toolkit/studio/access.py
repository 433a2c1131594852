"""Who may talk to the studio: the right host name, the right token, and no other web site."""

import hmac
import secrets
from dataclasses import dataclass, field
from http.cookies import SimpleCookie
from urllib.parse import parse_qsl, urlencode

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

TOKEN_BYTES = 24
SAFE_METHODS = ("GET", "HEAD")
QUERY_NAME = "token"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; media-src 'self' blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Nothing from elsewhere, nothing inline: what is not a file of the page does not run."""
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",  # the first address holds the token
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(self), microphone=(), geolocation=()",
}


def make_token() -> str:
    """A random token for one run of the server, 192 bits."""
    return secrets.token_urlsafe(TOKEN_BYTES)


@dataclass(frozen=True)
class Access:
    """Whom the server answers.

    Attributes:
        hosts: values of the Host header that are this server; another one is a web site whose name was bent to this
            address (DNS rebinding).
        token: what every request must bring; None on loopback.
        cookie: name of the cookie that carries it.
    """

    hosts: frozenset[str]
    token: str | None = field(default=None, repr=False)
    cookie: str = "toolkit_studio"

    def is_this_host(self, headers: Headers) -> bool:
        """Whether the request was meant for this server: exactly one Host header, and a known one."""
        named = headers.getlist("host")
        # two Host headers are read otherwise by different programs: neither is believed
        return len(named) == 1 and named[0].lower() in self.hosts

    def is_same_site(self, method: str, headers: Headers) -> bool:
        """Whether a request that changes something comes from this server's own page, or from no page at all."""
        if method in SAFE_METHODS:
            return True
        origin = headers.get("origin")
        # browsers say where a request comes from, and no page can change that
        if origin is not None and origin.lower() not in {f"http://{host}" for host in self.hosts}:
            return False
        # absent where no browser asks, such as curl: such a client brings the token, where there is one
        return headers.get("sec-fetch-site", "same-origin") in ("same-origin", "none")

    def knows(self, token: str | None) -> bool:
        """Compare with the token in a time that tells nothing of it."""
        if self.token is None:
            return True
        return token is not None and hmac.compare_digest(token.encode(), self.token.encode())


class Guard:
    """Refuses every request that `Access` does not admit, with 403 and nothing in it, before anything else sees it."""

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
        # a list, so that all three are compared whichever of them is right
        if not (admitted and any([access.knows(token) for token in brought])):
            await refusal(scope, receive, _add_headers(send))
            return
        # only when the page is opened: a script or a picture that brings the token needs no detour
        if asked is not None and access.token is not None and scope["path"] == "/" and scope["method"] == "GET":
            rest = urlencode([(name, value) for name, value in query if name != QUERY_NAME])
            await self._move_to_cookie(rest)(scope, receive, _add_headers(send))
            return
        await self._app(scope, receive, _add_headers(send))

    def _move_to_cookie(self, rest: str) -> Response:
        """Take the token out of the address bar and the history, once it is known."""
        moved = Response(status_code=303, headers={"location": f"/?{rest}" if rest else "/"})
        # HttpOnly: no script reads it; Lax: it comes along when the page is opened from a link
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
