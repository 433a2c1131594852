"""Small glTFs written by hand, as the specification lays them out, and colours looked up on what is read of them."""

import base64
import io
import json
import struct

import numpy as np
from PIL import Image

COMPONENT_TYPES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
CARD = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
CARD_FACES = np.array([0, 1, 2, 0, 2, 3], "<u2")
CARD_UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "<f4")
"""v runs down: the picture stands upright on the card."""


class Gltf:
    """A glTF that grows; every method that adds something returns its number."""

    def __init__(self):
        self.tree = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
            "accessors": [], "bufferViews": [], "buffers": [],
        }  # fmt: skip
        self.data = b""

    def _add(self, name, entry):
        self.tree.setdefault(name, []).append(entry)
        return len(self.tree[name]) - 1

    def use(self, name, required=False):
        for key in ("extensionsUsed", "extensionsRequired")[: 1 + required]:
            self.tree.setdefault(key, []).append(name)

    def view(self, content, **fields):
        self.data += b"\0" * (-len(self.data) % 4)
        start = len(self.data)
        self.data += content
        return self._add("bufferViews", {"buffer": 0, "byteOffset": start, "byteLength": len(content), **fields})

    def accessor(self, values, stride=None, **fields):
        """Numbers (n,) or (n, k); with `stride`, rows lie so many bytes apart and rubbish lies between them."""
        values = np.asarray(values)
        rows = np.ascontiguousarray(values.reshape(len(values), -1))
        content, more = rows.tobytes(), {}
        if stride is not None:
            table = np.full((len(rows), stride), 0xAB, np.uint8)
            table[:, : rows.shape[1] * rows.itemsize] = rows.view(np.uint8).reshape(len(rows), -1)
            content, more = table.tobytes(), {"byteStride": stride}
        return self._add("accessors", {
            "bufferView": self.view(content, **more), "componentType": COMPONENT_TYPES[rows.dtype.str[1:]],
            "count": len(rows), "type": TYPES[rows.shape[1]], **fields,
        })  # fmt: skip

    def picture(self, pixels, kind="PNG", sampler=None, uri=None, **texture):
        """The number of the texture of a picture (h, w, 3 or 4) uint8."""
        buffer = io.BytesIO()
        Image.fromarray(np.asarray(pixels, np.uint8)).save(buffer, kind, lossless=True)
        return self.image(buffer.getvalue(), f"image/{kind.lower()}", sampler, uri, **texture)

    def image(self, content, kind, sampler=None, uri=None, **texture):
        entry = {"uri": uri} if uri else {"bufferView": self.view(content), "mimeType": kind}
        image = self._add("images", entry)
        if sampler is not None:
            texture["sampler"] = self._add("samplers", sampler)
        return self._add("textures", {"source": image, **texture})

    def material(self, name="skin", **fields):
        return self._add("materials", {"name": name, **fields})

    def mesh(self, attributes, indices=None, material=None, **fields):
        """A mesh of one primitive; attributes are numbers of accessors, or arrays."""
        mesh_fields = {key: fields.pop(key) for key in ("weights",) if key in fields}
        primitive = {"attributes": self._numbers(attributes), **fields}
        if indices is not None:
            primitive["indices"] = indices if isinstance(indices, int) else self.accessor(indices)
        if material is not None:
            primitive["material"] = material
        return self._add("meshes", {"primitives": [primitive], **mesh_fields})

    def _numbers(self, attributes):
        return {name: one if isinstance(one, int) else self.accessor(one) for name, one in attributes.items()}

    def node(self, in_scene=True, **fields):
        number = self._add("nodes", fields)
        if in_scene:
            self.tree["scenes"][0]["nodes"].append(number)
        return number

    def card(self, material=None, uv=CARD_UV, **attributes):
        """A square of 1 m in the scene, with a picture upright on it."""
        attributes = {"POSITION": CARD, **({} if uv is None else {"TEXCOORD_0": uv}), **attributes}
        return self.node(mesh=self.mesh(attributes, CARD_FACES, material))

    def as_glb(self):
        self.tree["buffers"] = self.tree["buffers"] or [{}]
        self.tree["buffers"][0]["byteLength"] = len(self.data)
        text = json.dumps(self.tree).encode()
        text += b" " * (-len(text) % 4)
        data = self.data + b"\0" * (-len(self.data) % 4)
        parts = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(parts)) + parts

    def as_gltf(self):
        uri = f"data:application/octet-stream;base64,{base64.b64encode(self.data).decode()}"
        return json.dumps(self.tree | {"buffers": [{"byteLength": len(self.data), "uri": uri}]})

    def write(self, folder, name="thing.glb"):
        path = folder / name
        if name.endswith(".glb"):
            path.write_bytes(self.as_glb())
        else:
            path.write_text(self.as_gltf())
        return path


def base_colour(texture, **fields):
    """The JSON of a material with a picture."""
    return {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture, **fields}}}


def to_linear(code):
    code = np.asarray(code, float) / 255
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def to_code(linear):
    linear = np.asarray(linear, float)
    return 255 * np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)


def colours_at(mesh, places):
    """(n, 3) codes, 0 to 255, of what is painted at places (n, 2) of the plane z = 0; NaN where there is nothing."""
    found = np.full((len(places), 3), np.nan)
    for face, material in zip(mesh.faces, mesh.face_material, strict=True):
        corners, uv = mesh.vertices[face, :2].astype(float), mesh.uv[face].astype(float)
        edges = np.stack([corners[1] - corners[0], corners[2] - corners[0]], axis=1)
        if abs(np.linalg.det(edges)) < 1e-14:
            continue
        b, c = np.linalg.solve(edges, (places - corners[0]).T)
        weights = np.stack([1 - b - c, b, c], axis=1)
        within = (weights >= -1e-6).all(axis=1)
        found[within] = _look_up(mesh.materials[material].texture, weights[within] @ uv)
    return found


def _look_up(texture, uv):
    """Blended between texels, in linear light; the picture repeats."""
    height, width = texture.shape[:2]
    x, y = (uv * [1, -1] + [0, 1]).T * [[width], [height]] - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - left)[:, None], (y - top)[:, None]
    light = to_linear(texture)

    def at(row, column):
        return light[row % height, column % width]

    upper = at(top, left) * (1 - fx) + at(top, left + 1) * fx
    lower = at(top + 1, left) * (1 - fx) + at(top + 1, left + 1) * fx
    return to_code(upper * (1 - fy) + lower * fy)
