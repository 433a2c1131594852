"""Bad input of every kind, drawn by hypothesis: values, names, documents, and files that were damaged."""

import copy
import csv
import io
import json
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

Path_ = tuple[str | int, ...]

NUMBERS = (
    0, -0.0, -1, 1, 0.5, 1e-320, 5e-324, 1e-9, -1e300, 1e300, 1e308, 2**31, 2**63, 2**64, 10**30, -(10**30), 10**400,
    float("nan"), float("inf"), float("-inf"), True, 100_000, 16_384, 99_999, 100_000_000,
)  # fmt: skip
NAMES = (
    "", " ", ".", "..", "../../../X", "/", "/etc/passwd", "/dev/zero", "/dev/full", "a/b", "a\\b", "C:\\x", "~",
    "-rf", "--help", "-", "x" * 256, "ü" * 200, "con", "all", "a\nb", "a\rb", "a\0b", "\x1b]0;owned\x07", "\x9b31m",
    "\u202egpj.exe", "\u2028", "\ufeff", "\ud800", "\udcff", "[bold]", "[/]", "{}", "{0.__class__}", "%s", "$(id)",
    "`id`", "<script>", "nan", "inf", "1e999", "NaN", "١٢", "²", "00", "0x10", "1_000", "9" * 400, "None", "null",
    "true", "unpatched", "patched", "crate", "racer",
)  # fmt: skip


def _nest(levels: int, of: Any = 0) -> Any:
    for _ in range(levels):
        of = [of]
    return of


numbers = st.sampled_from(NUMBERS) | st.integers() | st.floats()
names = st.sampled_from(NAMES) | st.text(max_size=40)
values = (
    numbers | names | st.none()
    | st.sampled_from([[], {}, [[]], {"": {}}, _nest(200), [0] * 5000, {"a": _nest(60)}]).map(copy.deepcopy)
    | st.lists(numbers, max_size=6) | st.dictionaries(names, numbers, max_size=3)
)  # fmt: skip


def walk(document: Any, here: Path_ = ()) -> Iterator[Path_]:
    """Where every value of a document is."""
    yield here
    pairs = (
        document.items() if isinstance(document, dict) else enumerate(document) if isinstance(document, list) else ()
    )
    for key, child in pairs:
        yield from walk(child, (*here, key))


@st.composite
def documents(draw: st.DrawFn, document: Any) -> Any:
    """A document of which one to three values were replaced, left out, renamed or put in."""
    made = {"document": copy.deepcopy(document)}
    for _ in range(draw(st.integers(1, 3))):
        places = [place for place in walk(made) if len(place)]
        place = draw(st.sampled_from(places))
        holder: Any = made
        for key in place[:-1]:
            holder = holder[key]
        key = place[-1]
        how = draw(st.sampled_from(("replace", "replace", "replace", "leave out", "rename", "put in", "repeat")))
        if len(place) == 1 or how == "replace":
            holder[key] = draw(values)
        elif how == "leave out":
            del holder[key]
        elif how == "rename" and isinstance(holder, dict):
            holder[draw(names)] = holder.pop(key)
        elif how == "repeat" and isinstance(holder, list):
            holder += [copy.deepcopy(holder[key])] * draw(st.sampled_from((1, 100)))
        elif isinstance(holder, dict):
            holder[draw(names)] = draw(values)
    return made["document"]


@st.composite
def json_texts(draw: st.DrawFn, document: Any) -> bytes:
    """A JSON file with something wrong in it, or something that is no JSON at all."""
    kind = draw(st.sampled_from(("document",) * 8 + ("deep", "digits", "bytes", "damaged")))
    if kind == "deep":
        return (draw(st.sampled_from(("[", '{"a":', '[{"a":'))) * 100_000).encode()
    if kind == "digits":
        return json.dumps(document).replace("1", "9" * 5000, 1).encode()
    if kind == "bytes":
        return draw(st.binary(max_size=200))
    if kind == "damaged":
        return draw(damaged(json.dumps(document).encode()))
    return json.dumps(draw(documents(document))).encode()  # surrogates as escapes, NaN as NaN


def write_toml(document: dict[str, Any]) -> str:
    """TOML of what JSON holds: enough for hostile files, some of which it makes no TOML."""

    def show(value: Any) -> str:
        if (isinstance(value, float) and value != value) or value in (float("inf"), float("-inf")):
            return str(value)
        if isinstance(value, dict):
            return "{" + ", ".join(f"{json.dumps(key)} = {show(one)}" for key, one in value.items()) + "}"
        if isinstance(value, list):
            return "[" + ", ".join(map(show, value)) + "]"
        return json.dumps(value)

    if not isinstance(document, dict):
        return show(document)
    return "".join(
        f"{key if key.isidentifier() else json.dumps(key)} = {show(value)}\n" for key, value in document.items()
    )


@st.composite
def toml_texts(draw: st.DrawFn, document: dict[str, Any]) -> bytes:
    """A TOML file with something wrong in it."""
    kind = draw(st.sampled_from(("document",) * 8 + ("keys", "deep", "digits", "bytes", "damaged")))
    if kind == "keys":
        return (draw(st.sampled_from(("a.", "'a' . ", "[a.", "x = {a."))) * 20_000).encode() + b"a = 1"
    if kind == "deep":
        return b"a = " + draw(st.sampled_from((b"[", b"{a = "))) * 50_000
    if kind == "digits":
        return b"length_mm = " + b"9" * 5000
    if kind == "bytes":
        return draw(st.binary(max_size=200))
    if kind == "damaged":
        return draw(damaged(write_toml(document).encode()))
    return write_toml(draw(documents(document))).encode("utf-8", "surrogatepass")


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """Bytes of which some were changed, cut away, repeated or put in; numbers among them become huge."""
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(len(content) - 1, 0)))
        how = draw(st.sampled_from(("flip", "cut", "cut out", "put in", "repeat", "number", "head")))
        if how == "flip":
            content = (
                content[:at] + bytes([content[at] ^ draw(st.integers(1, 255))]) + content[at + 1 :] if content else b"x"
            )
        elif how == "cut":
            content = content[:at]
        elif how == "cut out":
            content = content[:at] + content[at + draw(st.integers(1, 64)) :]
        elif how == "put in":
            content = content[:at] + draw(st.binary(min_size=1, max_size=16)) + content[at:]
        elif how == "repeat":
            content = content[:at] + content[max(at - 32, 0) : at] * draw(st.sampled_from((2, 50))) + content[at:]
        else:  # lengths and counts stand in the first bytes of most formats
            at = draw(st.integers(0, min(len(content), 64))) if how == "head" else at
            order, kind = draw(st.sampled_from("<>")), draw(st.sampled_from("IQHf"))
            number = draw(st.sampled_from((0, 1, 0x7F, 0xFFFF, 0x7FFF, 0x10000000, 0x7FFFFFFF, 0xFFFFFFFF)))
            number = number & 0xFFFF if kind == "H" else number
            packed = struct.pack(order + kind, number)
            content = content[:at] + packed + content[at + len(packed) :]
    return content


FORMULAS = ("+1", "-1 -2", "=1+1", "@SUM(1)", "\t=1", "\r=1", "'=1", "=cmd|' /C calc'!A0")
LONG = ("x" * 2000, "x" * 200_000, "9" * 5000, "0" * 5000 + "1", "a,b" * 10_000, '"' * 3001)
cells = names | numbers.map(lambda one: str(one)[:400]) | st.sampled_from(FORMULAS) | st.sampled_from(LONG)


@st.composite
def tables(draw: st.DrawFn, content: bytes) -> bytes:
    """A CSV file of which cells, heads, columns or lines were changed, or which is none any more."""
    rows = list(csv.reader(io.StringIO(content.decode("utf-8-sig"))))
    for _ in range(draw(st.integers(1, 3))):
        at, column = draw(st.integers(0, len(rows) - 1)), draw(st.integers(0, max(len(rows[0]) - 1, 0)))
        how = draw(st.sampled_from(("cell", "cell", "cell", "column", "head", "cut", "more", "repeat", "lines")))
        if how in ("cell", "head"):
            row = rows[at if how == "cell" else 0]
            row[column : column + 1] = [draw(cells)]
        elif how == "column":  # the same in all lines
            cell = draw(cells)
            for row in rows[1:]:
                row[column : column + 1] = [cell]
        elif how == "cut":
            del rows[at][column:]
        elif how == "more":
            rows[at] += draw(st.lists(cells, max_size=3))
        elif how == "repeat":
            rows += [list(rows[at]) for _ in range(draw(st.sampled_from((1, 2000))))]
        else:
            rows = [rows[0], *draw(st.permutations(rows[1:8]))]
    text = io.StringIO()
    csv.writer(text, delimiter=draw(st.sampled_from(",,,,;\t")), escapechar="\\").writerows(rows)
    encoding = draw(st.sampled_from(("utf-8", "utf-8", "utf-8", "utf-8-sig", "utf-16")))
    made = text.getvalue().encode(encoding, "surrogatepass")
    return draw(damaged(made)) if draw(st.integers(0, 7)) == 0 else made


def put_in_place(file: Path, kind: str) -> None:
    """Something else than a file: a pipe, a device, a folder, a loop of links, a link that leads nowhere."""
    if file.is_dir():
        return
    file.unlink(missing_ok=True)
    if kind == "pipe":
        os.mkfifo(file)
    elif kind == "folder":
        file.mkdir()
    else:
        targets = {"zero": "/dev/zero", "full": "/dev/full", "loop": file.name, "nowhere": "/no/such/place"}
        file.symlink_to(targets[kind])


OTHER_KINDS = ("pipe", "folder", "zero", "full", "loop", "nowhere")
