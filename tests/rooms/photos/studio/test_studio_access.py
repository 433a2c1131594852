import hmac
import re
from html.parser import HTMLParser
from importlib.resources import files

import pytest

from toolkit.rooms.photos.studio.serve import Access, Guard, make_token

TOKEN = "a-token-of-this-test"
ADDRESSES = [
    "/",
    "/page.js",
    "/api/state",
    "/api/shots/1",
    "/api/shots/1/ghost.png",
    "/nowhere",
    "/docs",
    "/openapi.json",
]


@pytest.fixture
def guarded(reopen):
    return reopen(token=TOKEN)


@pytest.mark.parametrize("address", ADDRESSES)
@pytest.mark.parametrize("tokens", [{}, {"params": {"token": "wrong"}}, {"headers": {"authorization": "Bearer wrong"}}])
def test_nothing_is_answered_without_the_token(guarded, address, tokens):
    answer = guarded.client.get(address, **tokens)
    assert (answer.status_code, answer.content) == (403, b"")


def test_nothing_is_written_without_the_token(guarded, photo):
    assert guarded.send(1, photo()).status_code == 403
    assert guarded.client.post("/api/shots/1/skip").status_code == 403
    assert not list(guarded.session.folders.incoming_dir.iterdir())
    assert not guarded.session.folders.skip_mark(guarded.session.find_step(1)).exists()


@pytest.mark.parametrize(
    "given",
    [
        {"headers": {"authorization": f"Bearer {TOKEN}"}},
        {"params": {"token": TOKEN}},
        {"headers": {"cookie": f"other=1; toolkit_studio={TOKEN}"}},
    ],
    ids=["header", "query", "cookie"],
)
def test_the_token_opens(guarded, given):
    assert guarded.client.get("/api/state", **given).status_code == 200


def test_the_address_with_the_token_becomes_a_cookie_and_leaves_the_address_bar(guarded):
    answer = guarded.client.get("/", params={"token": TOKEN})
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    cookie = answer.headers["set-cookie"]
    assert TOKEN in cookie and "HttpOnly" in cookie and re.search("SameSite=lax", cookie, re.IGNORECASE)
    assert guarded.client.get("/").status_code == 200  # with the cookie that was set


def test_tokens_are_compared_in_constant_time(monkeypatch):
    compared = []
    monkeypatch.setattr(hmac, "compare_digest", lambda a, b: compared.append((a, b)) or a == b)
    access = Access(frozenset(), TOKEN)
    assert access.knows(TOKEN) and not access.knows("x") and not access.knows(None) and not access.knows("ü")
    assert len(compared) == 3


def test_tokens_are_long_and_never_the_same():
    tokens = {make_token() for _ in range(50)}
    assert len(tokens) == 50 and min(map(len, tokens)) >= 32


def test_the_token_is_not_shown_in_a_traceback():
    assert TOKEN not in repr(Access(frozenset(), TOKEN))


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8765", "127.0.0.1:9999", "127.0.0.1", ""])
def test_another_host_name_is_refused(desk, host):
    answer = desk.client.get("/api/state", headers={"host": host})
    assert (answer.status_code, answer.content) == (403, b"")


def test_localhost_is_this_host(desk):
    assert desk.client.get("/api/state", headers={"host": "LOCALHOST:8765"}).status_code == 200


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"origin": "http://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"sec-fetch-site": "cross-site"}, 403),
        ({"sec-fetch-site": "same-site"}, 403),
        ({"origin": "http://127.0.0.1:8765", "sec-fetch-site": "same-origin"}, 200),
        ({}, 200),
    ],
)
def test_another_site_cannot_change_anything(desk, headers, status):
    assert desk.client.post("/api/shots/1/skip", headers=headers).status_code == status
    assert (desk.statuses()[0] == "skipped") == (status == 200)


def test_answers_carry_a_strict_policy_and_no_cors(desk):
    for address in ("/", "/api/state", "/nowhere"):
        headers = desk.client.get(address, headers={"origin": "http://evil.example"}).headers
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy and "unsafe" not in policy and "http" not in policy
        assert not [name for name in headers if name.startswith("access-control")]
        assert headers["x-content-type-options"] == "nosniff" and headers["referrer-policy"] == "no-referrer"


def test_websockets_are_closed():
    import asyncio

    async def unreachable(scope, receive, send):
        raise AssertionError("the guard let it through")

    sent = []

    async def send(message):
        sent.append(message)

    asyncio.run(Guard(unreachable, Access(frozenset()))({"type": "websocket"}, None, send))
    assert sent == [{"type": "websocket.close", "code": 1008}]


def test_the_page_holds_nothing_inline_and_nothing_from_elsewhere():
    found = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag, attributes):
            names = dict(attributes)
            if tag == "style" or (tag == "script" and not names.get("src")):
                found.append(tag)
            found.extend(name for name in names if name == "style" or name.startswith("on"))
            found.extend(v for k, v in names.items() if k in ("src", "href") and not v.startswith(("/", "data:image/")))

    folder = files("toolkit.rooms.photos.studio")
    Reader().feed((folder / "page.html").read_text())
    assert found == []
    for name in ("page.js", "parts.js", "camera.js"):
        assert "innerHTML" not in (folder / name).read_text()
