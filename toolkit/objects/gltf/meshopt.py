"""Buffer views that meshoptimizer compressed: `EXT_meshopt_compression` and `KHR_meshopt_compression`.

Names are those of the specifications. Bytes are read by index, so that damaged data ends in an `IndexError`. No package
has these codecs for all systems.
"""

from typing import Any

import numpy as np

BLOCK_BYTES, BLOCK_VERTICES, GROUP = 8192, 256, 16
WIDTHS = {0: (0, 2, 4, 8), 1: (0, 1, 2, 4, 8)}
"""Bits of a delta in each version of the codec."""
MOST_BYTES = 1 << 30


def decode_view(content: bytes, packed: dict[str, Any]) -> np.ndarray:
    """(count × stride,) uint8: a buffer view as it was before it was compressed.

    Args:
        content: the compressed bytes.
        packed: the extension's JSON.

    Raises:
        ValueError, IndexError, KeyError: the data or its description is damaged.
    """
    count, stride, mode = packed["count"], packed["byteStride"], packed["mode"]
    # checked before arrays are made: a damaged file may state any size
    if not isinstance(count, int) or not isinstance(stride, int) or not 0 <= count * stride <= MOST_BYTES:
        raise ValueError("absurd counts")
    if mode == "ATTRIBUTES":
        if not (0 < stride <= 256 and stride % 4 == 0):
            raise ValueError(f"stride {stride}")
        rows = _apply_filter(_decode_vertices(content, count, stride), packed.get("filter", "NONE"))
        return rows.reshape(-1)
    # indices of two or four bytes
    if stride not in (2, 4):
        raise ValueError(f"stride {stride}")
    if mode not in ("TRIANGLES", "INDICES"):
        raise ValueError(f"mode {mode!r}"[:40])
    index = _decode_triangles(content, count) if mode == "TRIANGLES" else _decode_sequence(content, count)
    return np.array(index, np.int64).astype("<u2" if stride == 2 else "<u4").view(np.uint8)


def _decode_vertices(content: bytes, count: int, stride: int) -> np.ndarray:
    """(count, stride) uint8."""
    version = content[0] & 15
    if content[0] & 0xF0 != 0xA0 or version > 1:
        raise ValueError("no vertex data")
    # behind the data stand the first vertex, to which deltas add up, and in version 1 a channel for each four bytes
    tail = stride + (stride // 4 if version else 0)
    end = len(content) - max(tail, 24 if version else 32)
    last = np.frombuffer(content[len(content) - tail :][:stride], np.uint8)
    channels = content[len(content) - tail + stride :] if version else bytes(stride // 4)
    size = min(BLOCK_BYTES // stride & ~(GROUP - 1), BLOCK_VERTICES)
    out = np.empty((count, stride), np.uint8)
    at = 1
    # blocks of vertices; in each, byte 0 of all its vertices, then byte 1, and so on: equal bytes compress well
    for first in range(0, count, size):
        block = out[first : first + size]
        controls = content[at : at + stride // 4] if version else bytes(stride // 4)
        at += stride // 4 if version else 0
        for k in range(stride):
            control = controls[k // 4] >> (k % 4 * 2) & 3
            if version and control == 3:  # as they are
                block[:, k] = np.frombuffer(content[at : at + len(block)], np.uint8)
                at += len(block)
            elif version and control == 2:
                block[:, k] = 0
            else:
                deltas, at = _decode_bytes(content, at, len(block), WIDTHS[version][control : control + 4])
                block[:, k] = deltas
        # the channel states which deltas four bytes make
        for k in range(0, stride, 4):
            _sum_deltas(block[:, k : k + 4], last[k : k + 4], channels[k // 4])
        last = block[-1].copy()
        if at > end:
            raise ValueError("it is cut")
    return out


def _decode_bytes(content: bytes, at: int, count: int, widths: tuple[int, ...]) -> tuple[np.ndarray, int]:
    """(count,) uint8 deltas of a byte of each vertex, and the place of the next data."""
    groups = -(-count // GROUP)
    header = at
    at += -(-groups // 4)
    out = bytearray(groups * GROUP)
    # two bits of the header give the bits a delta of each group of 16
    for group in range(groups):
        bits = widths[content[header + group // 4] >> (group % 4 * 2) & 3]
        if bits == 0:
            continue
        start = group * GROUP
        whole = content[at : at + 2 * bits]
        at += 2 * bits
        if len(whole) < 2 * bits:
            raise ValueError("it is cut")
        if bits == 8:
            out[start : start + GROUP] = whole
            continue
        # smaller deltas are packed, two, four or eight to a byte
        values = _unpack(whole, bits)
        most = (1 << bits) - 1
        for k, value in enumerate(values):
            if value == most:  # too large for its bits: the whole byte comes behind
                value = content[at]
                at += 1
            out[start + k] = value
    return np.frombuffer(out, np.uint8)[:count], at


def _unpack(whole: bytes, bits: int) -> list[int]:
    if bits == 1:  # the lowest bit first; the others begin with the highest
        return [byte >> k & 1 for byte in whole for k in range(8)]
    if bits == 2:
        return [byte >> k & 3 for byte in whole for k in (6, 4, 2, 0)]
    return [byte >> k & 15 for byte in whole for k in (4, 0)]


def _sum_deltas(block: np.ndarray, last: np.ndarray, channel: int) -> None:
    """Turn deltas (n, 4) of four bytes into values, in place."""
    # the channel's lowest bits: bytes, words of 16 bits, or 32 bits by exclusive or
    kind = channel & 3
    if kind == 2:  # 32 bits, combined by exclusive or
        turn = np.uint32(32 - (channel >> 4) & 31)
        values = np.ascontiguousarray(block).view("<u4")[:, 0]
        if turn:
            values = values << turn | values >> np.uint32(32 - turn)
        summed = np.bitwise_xor.accumulate(values) ^ np.ascontiguousarray(last).view("<u4")[0]
        block[:] = summed[:, None].astype("<u4").view(np.uint8)
        return
    if kind == 3:
        raise ValueError("an unknown channel")
    dtype = "<u1" if kind == 0 else "<u2"
    values = np.ascontiguousarray(block).view(dtype)
    # zigzag: the lowest bit is the sign
    signed = values >> 1 ^ (~(values & 1) + np.array(1, dtype))
    summed = np.cumsum(signed, axis=0, dtype=dtype) + np.ascontiguousarray(last).view(dtype)
    block[:] = summed.astype(dtype).view(np.uint8)


def _read_vbyte(content: bytes, at: int) -> tuple[int, int]:
    """Read a number in seven bits a byte, least first, and the place of the next."""
    value = shift = 0
    while True:
        byte = content[at]
        at += 1
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128 or shift > 28:
            return value, at


def _decode_sequence(content: bytes, count: int) -> list[int]:
    if content[0] & 0xF0 != 0xD0 or content[0] & 15 > 1:
        raise ValueError("no indices")
    at, last, out = 1, [0, 0], []
    # two runs of numbers, told apart by the lowest bit
    for _ in range(count):
        value, at = _read_vbyte(content, at)
        which, value = value & 1, value >> 1
        # zigzag: the lowest bit is the sign
        last[which] = last[which] + (value >> 1 ^ -(value & 1)) & 0xFFFFFFFF
        out.append(last[which])
    return out


class _Triangles:
    """Indices of triangles, each coded by recent edges and vertices: `out` so far, `at` the next number's place."""

    def __init__(self, content: bytes, at: int) -> None:
        self._content, self.at = content, at
        self._edges: list[tuple[int, int]] = [(0, 0)] * 16
        self._vertices = [0] * 16
        self._edge = self._vertex = self._next = self._last = 0
        self.out: list[int] = []

    def add_on_edge(self, code: int, most: int) -> None:
        """Add a recent edge and a vertex; `most` is the first kind of vertex that is coded by its number."""
        # the edge that the code names, counted back in a ring of 16
        a, b = self._edges[self._edge - 1 - (code >> 4) & 15]
        kind = code & 15
        # a recent vertex, the next new vertex, an index in full, or one near the last index
        if 0 < kind < most:
            self._push(a, b, self._vertices[self._vertex - 1 - kind & 15], ((2, 1), (0, 2)))
            return
        if kind == 0:
            c = self._take_next()
        elif kind == 15:
            c = self._read_index()
        else:
            c = self._last = self._last + (kind - (kind ^ 3)) & 0xFFFFFFFF
        self._keep(c)
        self._push(a, b, c, ((2, 1), (0, 2)))

    def add_free(self, kinds: tuple[int, int, int], has_numbers: bool) -> None:
        """Add three vertices: new, recent, or with `has_numbers` coded by their number."""
        # vertices whose index stands in full in the data
        is_told = [has_numbers and kind == 15 for kind in kinds]
        triangle = [
            self._take_next() if kind == 0 else 0 if told else self._vertices[self._vertex - kind & 15]
            for kind, told in zip(kinds, is_told, strict=True)
        ]
        for k in range(3):
            if is_told[k]:
                triangle[k] = self._read_index()
        for k, kind in enumerate(kinds):
            if k == 0 or kind == 0 or is_told[k]:
                self._keep(triangle[k])
        a, b, c = triangle
        self._push(a, b, c, ((1, 0), (2, 1), (0, 2)))

    def restart(self) -> None:
        """Count new vertices from 0 again."""
        self._next = 0

    def _push(self, a: int, b: int, c: int, edges: tuple[tuple[int, int], ...]) -> None:
        triangle = a, b, c
        self.out += triangle
        for first, second in edges:
            self._edges[self._edge] = triangle[first], triangle[second]
            self._edge = self._edge + 1 & 15

    def _keep(self, vertex: int) -> None:
        self._vertices[self._vertex] = vertex
        self._vertex = self._vertex + 1 & 15

    def _take_next(self) -> int:
        self._next += 1
        return self._next - 1

    def _read_index(self) -> int:
        value, self.at = _read_vbyte(self._content, self.at)
        self._last = self._last + (value >> 1 ^ -(value & 1)) & 0xFFFFFFFF
        return self._last


def _decode_triangles(content: bytes, count: int) -> list[int]:
    version = content[0] & 15
    if content[0] & 0xF0 != 0xE0 or version > 1 or count % 3:
        raise ValueError("no triangles")
    table = content[len(content) - 16 :]
    triangles = _Triangles(content, 1 + count // 3)
    # a code for each triangle: on a recent edge, with corners by the table of usual codes, or with corners in full
    for code in content[1 : 1 + count // 3]:
        if code < 0xF0:
            triangles.add_on_edge(code, 13 if version else 15)
        elif code < 0xFE:
            more = table[code & 15]
            triangles.add_free((0, more >> 4, more & 15), False)
        else:
            more = content[triangles.at]
            triangles.at += 1
            if more == 0:
                triangles.restart()
            triangles.add_free((0 if code == 0xFE else 15, more >> 4, more & 15), True)
    if triangles.at > len(content) - 16 or len(triangles.out) != count:
        raise ValueError("it is cut")
    return triangles.out


def _apply_filter(rows: np.ndarray, name: str) -> np.ndarray:
    """Undo a filter of rows (n, stride) uint8."""
    if name == "NONE" or not len(rows):
        return rows
    stride = rows.shape[1]
    if name == "EXPONENTIAL":
        # 24 bits of mantissa and 8 of exponent, both signed
        words = rows.view("<i4")
        return np.ldexp((words << 8 >> 8).astype(np.float32), words >> 24).astype("<f4").view(np.uint8)
    if name == "QUATERNION" and stride == 8:
        values = rows.view("<i2").astype(np.int32)
        # the three smallest components, 1/√2 at most, whose number of the largest is in two bits; |q| = 1 gives the
        # fourth
        x, y, z = (values[:, :3] / (np.sqrt(2.0) * (values[:, 3:] | 3))).T
        w = np.sqrt(np.maximum(1 - x * x - y * y - z * z, 0))
        out = np.empty_like(values)
        for k, axis in enumerate((w, x, y, z)):
            out[np.arange(len(out)), (values[:, 3] & 3) + k & 3] = np.round(axis * 32767)
        return out.astype("<i2").view(np.uint8)
    if name == "OCTAHEDRAL" and stride in (4, 8):
        dtype, most = ("<i1", 127) if stride == 4 else ("<i2", 32767)
        values = rows.view(dtype).astype(np.float32)
        # octahedral normals (Meyer et al. 2010): the lower half of the octahedron is folded over the upper
        x, y = values[:, 0], values[:, 1]
        z = values[:, 2] - np.abs(x) - np.abs(y)
        fold = np.minimum(z, 0)
        x, y = x + np.where(x >= 0, fold, -fold), y + np.where(y >= 0, fold, -fold)
        scale = most / np.maximum(np.sqrt(x * x + y * y + z * z), 1e-20)
        values[:, :3] = np.round(np.stack([x, y, z], axis=1) * scale[:, None])
        return values.astype(dtype).view(np.uint8)
    if name == "COLOR" and stride in (4, 8):
        return _decode_colours(rows, stride)
    raise ValueError(f"filter {name!r}"[:40])


def _decode_colours(rows: np.ndarray, stride: int) -> np.ndarray:
    """Decode YCoCg with alpha; the highest bit of alpha states the number of bits."""
    unsigned, signed = (("<u1", "<i1"), ("<u2", "<i2"))[stride == 8]
    light, alpha = (rows.view(unsigned)[:, k].astype(np.int32) for k in (0, 3))
    orange, green = (rows.view(signed)[:, k].astype(np.int32) for k in (1, 2))
    # all bits below the highest are set: the largest value of that number of bits
    full = alpha.copy()
    for shift in (1, 2, 4, 8):
        full |= full >> shift
    alpha = alpha << 1 & full | alpha & 1
    # YCoCg: red Y + Co - Cg, green Y + Cg, blue Y - Co - Cg
    colours = np.stack([light + orange - green, light + green, light - orange - green, alpha], axis=1)
    most = np.iinfo(unsigned).max
    return np.floor(colours * (most / np.maximum(full, 1))[:, None] + 0.5).clip(0, most).astype(unsigned).view(np.uint8)
