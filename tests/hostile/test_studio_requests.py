"""The studio's addresses from anybody in the network: each request has an answer in a line, and none leaves a trace."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import unquote

import pytest
from hostile_checks import count, limited, look_at
from hostile_inputs import NAMES, NUMBERS, damaged, json_texts
from hostile_space import encode
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("fastapi", reason="needs the extra 'studio' (FastAPI)")

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import open_workspace
from toolkit.rooms.photos.studio.app import make_app
from toolkit.rooms.photos.studio.predictor import Predictor
from toolkit.rooms.photos.studio.serve import Access
from toolkit.rooms.photos.studio.session import open_session

HOST = "127.0.0.1:8765"
TOKEN = "a-token"
WHOLE = encode("JPEG", size=(160, 120)), encode("PNG", size=(64, 48)), encode("WEBP", size=(64, 48))
PLACES = ("", "ghost.png", "photo.jpg", "waiting.jpg", "verdict", "keep", "discard", "skip", "undo", "photo")


def no_network():
    raise ToolkitError("no network here")


@pytest.fixture(scope="module")
def studio(template, tmp_path_factory):
    """The application on a workspace of its own, which lies in a folder that must not change."""
    import shutil

    root = tmp_path_factory.mktemp("studio")
    space = open_workspace(shutil.copytree(template, root / "space"))
    (root / "precious.txt").write_text("mine")
    session = open_session(space)
    app = make_app(session, Access(frozenset({HOST}), TOKEN), Predictor(session, no_network), most_bytes=100_000)
    return root, session, app


def ask(app, method, address, headers=(), blocks=(b"",)):
    """Status, kind and content of an answer; what the application raises comes out."""
    raw, _, query = address.partition(b"?")
    head = [(b"host", HOST.encode()), (b"authorization", f"Bearer {TOKEN}".encode()), *headers]
    scope = {
        "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": method, "scheme": "http",
        "path": unquote(raw.decode("latin-1")), "raw_path": raw, "query_string": query, "root_path": "",
        "headers": head, "client": ("127.0.0.1", 9), "server": ("127.0.0.1", 8765),
    }  # fmt: skip
    rest, answer = list(blocks), []

    async def receive():
        if rest:
            return {"type": "http.request", "body": rest.pop(0), "more_body": bool(rest)}
        return {"type": "http.disconnect"}

    async def send(message):
        answer.append(message)

    asyncio.run(app(scope, receive, send))
    kind = dict(answer[0]["headers"]).get(b"content-type", b"")
    return answer[0]["status"], kind, b"".join(one.get("body", b"") for one in answer[1:])


def check(studio, *request, **options):
    root, session, app = studio
    before = look_at(root)
    count("requests")
    with limited():
        status, kind, content = ask(app, *request, **options)
    said = f"{request!a} {options!a}\n{status} {content[:2000]!a}"
    assert status < 500 and b"Traceback" not in content, said
    if status >= 400 and kind.startswith(b"application/json"):
        assert len(content) < 1000 and b"\\n" not in content and b"Error" not in content, said
    assert look_at(root) == before, said
    assert not list(session.folders.incoming_dir.glob("*")), said
    return status


numbers = st.sampled_from(NUMBERS).map(str) | st.integers(0, 40).map(str) | st.sampled_from(NAMES) | st.text(max_size=9)
words = numbers | st.sampled_from(("..", "%2e%2e", "%2f..%2f..", "%00", "..%5c", "rig", "plan.json", "%c0%ae", "/"))


def as_address(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass").replace(b"\n", b"%0a").replace(b" ", b"%20")


addresses = (
    st.tuples(numbers, st.sampled_from(PLACES), numbers, numbers).map(
        lambda it: as_address(f"/api/shots/{it[0]}/{it[1]}?sha256={it[2]}&skipped={it[3]}&large={it[3]}")
    )
    | st.lists(words, max_size=6).map(lambda parts: as_address("/" + "/".join(parts)))
    | st.sampled_from((b"/", b"/api/state", b"/api/state?token=" + b"x" * 60_000))
)
HEADS = (b"content-length", b"content-type", b"origin", b"cookie", b"range", b"host", b"x-forwarded-for")
ODD = st.binary(max_size=40) | st.sampled_from(
    (b"-1", b"1e9", b"5", b"9" * 5000, b"application/octet-stream", b"bytes=9-1")
)
headers = st.lists(st.tuples(st.sampled_from(HEADS), ODD), max_size=4)
methods = st.sampled_from(("GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "TRACE", "\u00e4"))


@given(method=methods, address=addresses, sent=headers, body=json_texts({"shot": 1, "skipped": True}))
def test_a_request_that_is_none(studio, method, address, sent, body):
    check(studio, method, address, headers=sent, blocks=[body[:200_000]])


UPLOAD = ((b"content-type", b"application/octet-stream"),)


@given(data=st.data(), number=st.integers(1, 4))
def test_an_upload_that_is_no_photograph(studio, data, number):
    content = data.draw(st.sampled_from(WHOLE).flatmap(damaged) | st.binary(max_size=2000))
    cut = data.draw(st.lists(st.integers(0, len(content)), max_size=3).map(sorted))
    blocks = [content[a:b] for a, b in zip([0, *cut], [*cut, len(content)], strict=True)]
    lengths = [(b"content-length", value) for value in data.draw(st.lists(ODD, max_size=1))]
    check(studio, "POST", f"/api/shots/{number}/photo".encode(), headers=[*UPLOAD, *lengths], blocks=blocks)


def test_an_upload_without_end_is_refused(studio):
    blocks = [b"\xff\xd8" + b"x" * 50_000] * 100
    assert check(studio, "POST", b"/api/shots/1/photo", headers=UPLOAD, blocks=blocks) == 413


def test_many_at_once_are_answered_in_turn(studio):
    """Uploads, decisions and pictures of one shot from sixteen sides; afterwards the state is told."""
    asked = [("POST", b"/api/shots/1/photo", UPLOAD, [WHOLE[k % 3]]) for k in range(16)]
    asked += [("POST", b"/api/shots/1/" + what, (), [b""]) for what in (b"discard", b"undo", b"skip") * 4]
    asked += [("GET", b"/api/shots/1/" + what, (), [b""]) for what in (b"waiting.jpg", b"verdict", b"ghost.png") * 4]
    with limited(60), ThreadPoolExecutor(16) as pool:
        answers = list(pool.map(lambda one: ask(studio[2], *one), asked))
    count("requests", len(asked))
    assert {status for status, _, _ in answers} <= {200, 404, 409, 415}, answers
    assert ask(studio[2], "GET", b"/api/state")[0] == 200
    assert not list(studio[1].folders.incoming_dir.iterdir())


def test_without_its_token_nothing_is_told(studio):
    for address in (b"/", b"/api/state", b"/api/shots/1/photo.jpg", b"/?token=", b"/?token=%ff"):
        asked = [(b"authorization", b"Bearer \xff"), (b"cookie", b"toolkit_studio=\xff; =;;")]
        app = studio[2]
        status, _, content = ask(app, "GET", address, headers=[*asked, (b"host", b"elsewhere")])
        assert (status, content) == (403, b"")
