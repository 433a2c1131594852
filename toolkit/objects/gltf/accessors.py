"""Numbers of a glTF: accessors of any component type, normalised, interleaved or sparse."""

from typing import Any

import numpy as np

from toolkit.objects.gltf.document import DamagedGltf, Document

COMPONENT_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def read_accessor(document: Document, index: Any) -> np.ndarray:
    """(n, k) numbers; normalised integers become float32 fractions; `DamagedGltf` for an unknown type or place."""
    accessor = document.row("accessors", index)
    count = accessor.get("count")
    dtype, width = COMPONENT_TYPES.get(accessor.get("componentType", 0)), COMPONENTS.get(accessor.get("type", ""))
    if dtype is None or width is None or not isinstance(count, int) or count < 0:
        raise DamagedGltf(f"accessor {index} is of an unknown type")
    # an accessor without a view is all zeros, and its sparse part fills them in
    if "bufferView" in accessor:
        values = _cut(document, accessor, (count, width), dtype, f"accessor {index}")
    else:
        values = np.zeros((count, width), dtype)
    if isinstance(accessor.get("sparse"), dict):
        values = _replace(document, values, accessor["sparse"], f"accessor {index}")
    return normalise(values) if accessor.get("normalized") is True else values


def normalise(values: np.ndarray) -> np.ndarray:
    """Convert integers to glTF's fractions, float32; floats stay."""
    if values.dtype.kind == "f":
        return values
    # the least signed integer counts as -1 too (glTF 2.0, 3.11)
    return np.maximum(values / np.float64(np.iinfo(values.dtype).max), -1).astype(np.float32)


def _cut(document: Document, place: dict[str, Any], shape: tuple[int, int], dtype: str, name: str) -> np.ndarray:
    """Return rows of a buffer view, which may be interleaved with others."""
    data = document.view(place["bufferView"])
    start = place.get("byteOffset", 0)
    stride = document.row("bufferViews", place["bufferView"]).get("byteStride", 0)
    count, width = shape
    row_bytes = width * np.dtype(dtype).itemsize
    # views of compressed data state the stride of what was in them
    if not isinstance(stride, int) or not isinstance(start, int) or start < 0 or stride < 0:
        raise DamagedGltf(f"{name} begins or steps nowhere")
    stride = stride or row_bytes
    length = (count - 1) * stride + row_bytes if count else 0
    if start + length > len(data) or stride < row_bytes:
        raise DamagedGltf(f"{name} reaches outside of its buffer view of {len(data)} bytes")
    # packed tightly, or interleaved with other attributes
    if stride == row_bytes:
        return np.frombuffer(data[start : start + length], dtype).reshape(shape)
    rows = np.lib.stride_tricks.as_strided(data[start : start + length], (count, row_bytes), (stride, 1))
    return np.ascontiguousarray(rows).view(dtype)


def _replace(document: Document, values: np.ndarray, sparse: dict[str, Any], name: str) -> np.ndarray:
    # a sparse accessor states indices, and the values of these rows
    count = sparse.get("count", 0)
    where, what = sparse.get("indices"), sparse.get("values")
    if not isinstance(count, int) or not isinstance(where, dict) or not isinstance(what, dict) or count < 0:
        raise DamagedGltf(f"{name} is sparse without its values")
    kind = COMPONENT_TYPES.get(where.get("componentType", 0))
    if kind not in ("<u1", "<u2", "<u4"):
        raise DamagedGltf(f"{name} is sparse with indices of an unknown type")
    rows = _cut(document, where, (count, 1), kind, name)[:, 0]
    if count and rows.max() >= len(values):
        raise DamagedGltf(f"{name} is sparse beyond its {len(values)} rows")
    # the view may be another accessor's too
    values = values.copy()
    values[rows] = _cut(document, what, (count, values.shape[1]), values.dtype.str, name)
    return values
