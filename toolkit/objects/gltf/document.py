"""A glTF file before anything is built of it: its JSON and its buffers."""

import base64
import binascii
import json
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote, unquote_to_bytes

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.files import explain_read_error, inside, open_plain
from toolkit.objects.gltf.meshopt import decode_view
from toolkit.objects.named_files import find_named

MOST_TEXT_BYTES = 512 << 20
MOST_VIEWED_BYTES = 1 << 30
"""Parts of a buffer are copied, and may overlap."""
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
MAGIC, GLB_1 = b"glTF", b"\1\0\0\0"
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942


class DamagedGltf(Exception):
    """The file breaks the specification; the text says how, in a few words."""


@dataclass
class Document:
    """A glTF file: its JSON, the binary chunk of a GLB, and notes on features that are left out, a sentence each."""

    path: Path
    tree: dict[str, Any]
    binary: np.ndarray
    notes: list[str] = field(default_factory=list)
    _buffers: dict[int, np.ndarray] = field(default_factory=dict)
    _views: dict[int, np.ndarray] = field(default_factory=dict)

    def rows(self, name: str) -> list[dict[str, Any]]:
        """Return a list of the JSON, such as `nodes`."""
        return rows(self.tree, name)

    def row(self, name: str, index: Any) -> dict[str, Any]:
        """Return an entry of such a list."""
        found = self.rows(name)
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(found):
            raise DamagedGltf(f"{name} has {len(found)} entries, none is number {index!r}")
        return found[index]

    def view(self, index: Any) -> np.ndarray:
        """(n,) uint8 bytes of a buffer view, decompressed."""
        view = self.row("bufferViews", index)
        if index not in self._views:
            # compressed in either spelling of the extension
            name, packed = next(((name, found) for name in MESHOPT if (found := extension(view, name))), ("", None))
            if packed is None:
                self._views[index] = self._cut(view, index)
            else:
                try:
                    self._views[index] = decode_view(self._cut(packed, index).tobytes(), packed)
                except (ValueError, IndexError, KeyError) as error:
                    raise DamagedGltf(f"{name}: the data of buffer view {index} are damaged ({error})") from None
        return self._views[index]

    def _cut(self, view: dict[str, Any], index: int) -> np.ndarray:
        start, length = view.get("byteOffset", 0), view.get("byteLength", 0)
        data = self._buffer(view.get("buffer"))
        if not isinstance(start, int) or not isinstance(length, int) or not 0 <= start <= start + length <= len(data):
            raise DamagedGltf(f"buffer view {index} reaches outside of its buffer of {len(data)} bytes")
        return data[start : start + length]

    def _buffer(self, index: Any) -> np.ndarray:
        buffer = self.row("buffers", index)
        if index not in self._buffers:
            # a GLB's first buffer is its own binary chunk
            uri = buffer.get("uri")
            if uri is None and index == 0:
                self._buffers[index] = self.binary
            elif uri is None:
                raise DamagedGltf(f"buffer {index} has no data")
            else:
                self._buffers[index] = np.frombuffer(self.load_uri(uri), np.uint8)
        return self._buffers[index]

    def load_uri(self, uri: Any) -> bytes:
        """Return the content of a URI or its file; a `ToolkitError` for a missing file or one outside the folder."""
        if not isinstance(uri, str):
            raise DamagedGltf("a URI is no text")
        # content within the URI, or a file beside the glTF
        if uri.startswith("data:"):
            head, _, body = uri.partition(",")
            try:
                # some exporters leave out the signs that fill up the last group of four
                return base64.b64decode(f"{body}===") if head.endswith(";base64") else unquote_to_bytes(body)
            except binascii.Error:
                raise DamagedGltf("a data URI is no base64") from None
        file = inside(self.path.parent, name_of_uri(self.path.parent, uri))
        try:
            with open_plain(file) as stream:
                return stream.read()
        except OSError as error:
            raise explain_read_error(file, error) from None


def name_of_uri(folder: Path, uri: str) -> str:
    """Return the path of a URI: decoded, or as it stands if the exporter did not encode it, else as `find_named`."""
    decoded = unquote(uri)
    for name in (decoded, uri, decoded.replace("\\", "/")):
        with suppress(OSError, ValueError):
            if (folder / name).is_file():
                return name
    with suppress(ToolkitError, OSError, ValueError):
        if (found := find_named(folder, decoded)) is not None:
            return str(found.relative_to(folder))
    return decoded


def rows(tree: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """Return a list of objects in a JSON object; anything else counts as empty."""
    found = tree.get(name)
    return [entry if isinstance(entry, dict) else {} for entry in found] if isinstance(found, list) else []


def extension(tree: dict[str, Any], name: str) -> dict[str, Any] | None:
    """Return an extension of a JSON object, if it is there."""
    all_of_it = tree.get("extensions")
    found = all_of_it.get(name) if isinstance(all_of_it, dict) else None
    return found if isinstance(found, dict) else None


def read_document(path: Path) -> Document:
    """Read a GLB or the JSON of a glTF, whichever its bytes are.

    Raises:
        ToolkitError: it cannot be read, is no glTF 2.0, or holds more text than `MOST_TEXT_BYTES`.
    """
    try:
        with open_plain(path) as file:
            # its bytes tell a GLB, whatever its name ends in
            head = file.read(4)
            is_binary = head == MAGIC
            content = head + (file.read() if is_binary else file.read(MOST_TEXT_BYTES))
    except OSError as error:
        raise explain_read_error(path, error) from None
    if is_binary and content[4:8] == GLB_1:
        _refuse_version(path, "1.0")
    # a GLB has its JSON in the first chunk
    text, binary = _split(content) if is_binary else (content, b"")
    if len(text) > MOST_TEXT_BYTES:
        raise ToolkitError(f"{path}: over {MOST_TEXT_BYTES >> 20} MB of text: export it as .glb")
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        refuse(path)
    if not isinstance(tree, dict):
        refuse(path)
    # without a version it is read as 2.0
    asset = tree.get("asset")
    version = str(asset.get("version", "2.0")) if isinstance(asset, dict) else "2.0"
    if not version.startswith("2"):
        _refuse_version(path, version[:20])
    return Document(path, tree, np.frombuffer(binary, np.uint8))


def _refuse_version(path: Path, version: str) -> NoReturn:
    raise ToolkitError(
        f"{path}: glTF {version}, expected 2.0: convert it (npx gltf-pipeline -i OLD -o NEW.glb), or export it again"
    )


def _split(content: bytes) -> tuple[bytes, memoryview | bytes]:
    """Return the JSON and the binary chunk of a GLB; other chunks are ignored, as the specification asks."""
    text: bytes = b""
    binary: memoryview | bytes = b""
    start = 12  # behind magic, version and length
    while start + 8 <= len(content):
        length, kind = struct.unpack_from("<II", content, start)
        chunk = memoryview(content)[start + 8 : start + 8 + length]
        if kind == JSON_CHUNK and not text:
            text = bytes(chunk)
        elif kind == BINARY_CHUNK and not len(binary):
            binary = chunk
        start += 8 + length
    return text, binary


def refuse(path: Path, reason: str = "it is damaged, cut or of another kind") -> NoReturn:
    """Raise the `ToolkitError` for a file that breaks the specification."""
    raise ToolkitError(
        f"{path}: not a readable {path.suffix} mesh: {reason}: open it in Blender and export it again"
    ) from None


def named_files(path: Path) -> Iterator[str]:
    """Yield the paths of buffers and pictures that a file names; none for a file that is no glTF: reading says so."""
    try:
        tree = read_document(path).tree
    except ToolkitError:
        return
    for entry in rows(tree, "buffers") + rows(tree, "images"):
        uri = entry.get("uri")
        if isinstance(uri, str) and not uri.startswith("data:"):
            yield name_of_uri(path.parent, uri)
