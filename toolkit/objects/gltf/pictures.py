"""Pictures of a glTF: found, decoded, and laid out so that they repeat, whatever their sampler does at the edges."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.imaging.colour import LINEAR_OF_CODE
from toolkit.imaging.read import MAX_TEXTURE_PX, decode_texture_file
from toolkit.objects.gltf.compressed import BASISU, decode_ktx
from toolkit.objects.gltf.document import Document, extension
from toolkit.objects.paint import tint_texture

TRANSFORM = "KHR_texture_transform"
SOURCES = ("EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds")
"""Extensions that name a picture of another format."""
CLAMP, MIRROR, REPEAT, NEAREST = 33071, 33648, 10497, 9728
MOST_TILES = 4
"""A clamped picture is extended by so many of its sides; farther out it is looked up texel by texel."""
FARTHEST_UV = 1e6
"""Largest texture coordinate: beyond it, float32 no longer tells texels apart."""
SHARP_PX = 512
"""Texels of a picture smaller than this that is not to be blurred are repeated until it has this size."""


@dataclass(frozen=True)
class GltfPicture:
    """A decoded picture.

    Attributes:
        pixels: (h, w, 3) uint8, sRGB-encoded, or plain numbers; row 0 is v = 0 of glTF.
        alpha: (h, w) uint8; None if it does not count.
        wraps: glTF's modes beyond the edges, for u and v.
    """

    pixels: np.ndarray
    alpha: np.ndarray | None
    wraps: tuple[int, int] = (REPEAT, REPEAT)

    @property
    def size(self) -> np.ndarray:
        """(2,) width and height, texels."""
        return np.array(self.pixels.shape[1::-1])

    def pick(self, choose: Callable[[np.ndarray], np.ndarray]) -> "GltfPicture":
        """Return the picture of other texels: `choose` takes them from pixels, and from alpha."""
        return replace(self, pixels=choose(self.pixels), alpha=None if self.alpha is None else choose(self.alpha))


@dataclass
class Pictures:
    """The pictures of a file, each decoded once."""

    document: Document
    _decoded: dict[tuple[int, bool], GltfPicture] = field(default_factory=dict)
    _tinted: dict[tuple[int, bytes], tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    def read(self, index: Any, with_alpha: bool = False) -> GltfPicture:
        """Return the picture of a texture.

        Raises:
            ToolkitError: it is missing, empty or damaged; the message names it.
        """
        texture = self.document.row("textures", index)
        # with alpha and without are decoded apart
        key = (index, with_alpha)
        if key not in self._decoded:
            picture = self._decode(texture, with_alpha)
            sampler = self.document.row("samplers", texture["sampler"]) if "sampler" in texture else {}
            # a sampler without blending: texels are enlarged, as the rig blends between them
            if sampler.get("magFilter") == NEAREST and (times := SHARP_PX // int(picture.size.max())) > 1:
                picture = picture.pick(lambda texels: texels.repeat(times, axis=0).repeat(times, axis=1))
            wraps = (sampler.get("wrapS", REPEAT), sampler.get("wrapT", REPEAT))
            self._decoded[key] = replace(picture, wraps=wraps)
        return self._decoded[key]

    def tint(self, pixels: np.ndarray, factor: np.ndarray) -> np.ndarray:
        """Return `tint_texture`, the same array for all parts that share a picture and a factor."""
        key = (id(pixels), factor.tobytes())
        if key not in self._tinted:
            self._tinted[key] = pixels, tint_texture(pixels, factor)  # kept, so that no other array gets its number
        return self._tinted[key][1]

    def _decode(self, texture: dict[str, Any], with_alpha: bool) -> GltfPicture:
        """Return the first source of a texture that can be read, widely known formats first."""
        sources = picture_sources(texture)
        if not sources:
            others = ", ".join(sorted(map(str, texture.get("extensions", {}))))[:80]
            raise ToolkitError(
                f"{self.document.path}: a texture names no picture that toolkit reads"
                f"{f' (it has {others})' if others else ''}: save its pictures as PNG or JPEG"
            )
        # a later source is tried if an earlier does not decode
        for source in sources[:-1]:
            try:
                return self._load(source, with_alpha)
            except ToolkitError:
                continue
        return self._load(sources[-1], with_alpha)

    def _load(self, index: Any, with_alpha: bool) -> GltfPicture:
        image = self.document.row("images", index)
        name = str(self.document.path)
        # inside the file, or a file beside it
        if "bufferView" in image:
            content = self.document.view(image["bufferView"]).tobytes()
        else:
            uri = image.get("uri")
            content = self.document.load_uri(uri)
            name = name if str(uri).startswith("data:") else f"{name}: {uri}"
        if content.startswith(b"\xabKTX") or image.get("mimeType") == "image/ktx2":
            content = decode_ktx(self.document, content, f"picture {index}")
        return GltfPicture(*decode_texture_file(content, name, with_alpha))


def picture_sources(texture: dict[str, Any]) -> list[Any]:
    """Return the numbers of a texture's pictures, in the order in which they are tried."""
    named = [(extension(texture, name) or {}).get("source") for name in SOURCES]
    named += [texture.get("source"), (extension(texture, BASISU) or {}).get("source")]
    return [source for source in named if source is not None]


def texture_coordinates(slot: dict[str, Any], sets: dict[int, np.ndarray]) -> np.ndarray | str:
    """(n, 2) texture coordinates of a material's slot, v down; else why there are none."""
    # the transform may name another set of coordinates
    moved = extension(slot, TRANSFORM) or {}
    wanted = moved.get("texCoord", slot.get("texCoord", 0))
    uv = sets.get(wanted)
    if uv is None:
        return f"a part has no TEXCOORD_{wanted}"
    if not (np.abs(uv) <= FARTHEST_UV).all():
        return f"TEXCOORD_{wanted} is not finite or far too large"
    uv = uv if uv.dtype.kind == "f" else uv.astype(np.float64)  # integers that a transform scales
    if not {"offset", "rotation", "scale"} & set(moved):
        return uv
    # scale, then turn, then shift, in glTF's direction of v
    cosine, sine = np.cos(moved.get("rotation", 0.0)), np.sin(moved.get("rotation", 0.0))
    scaled = uv.astype(np.float64) * np.array(moved.get("scale", (1, 1)), float)
    turned = scaled @ np.array([[cosine, sine], [-sine, cosine]]).T
    return turned + np.array(moved.get("offset", (0, 0)), float)


def lay_out(picture: GltfPicture, uv: np.ndarray) -> tuple[GltfPicture, np.ndarray] | None:
    """Return a picture that repeats, and texture coordinates for it, from (..., 2) coordinates, v down.

    None: it would be far too large, so each look-up must follow the sampler.
    """
    uv = uv.copy()
    for axis, wrap in enumerate(picture.wraps):
        size = int(picture.size[axis])
        low, high = (float(bound) * size for bound in (uv[..., axis].min(), uv[..., axis].max()))
        if wrap not in (CLAMP, MIRROR) or (low >= 0.5 and high <= size - 0.5):
            continue
        # the texels that look-ups reach, written out: a mirrored picture is then twice as long and repeats
        first, behind = (0, 2 * size) if wrap == MIRROR else (int(np.floor(low - 0.5)), int(np.ceil(high + 0.5)) + 1)
        if not size or behind - first > min((MOST_TILES + 1) * size + 4, MAX_TEXTURE_PX):
            return None
        # how the sampler counts beyond the picture
        index = wrap_index(np.arange(first, behind), size, wrap)
        picture = picture.pick(partial(np.take, indices=index, axis=1 - axis))
        uv[..., axis] = (uv[..., axis] * size - first) / (behind - first)
    return replace(picture, wraps=(REPEAT, REPEAT)), uv


def wrap_index(index: np.ndarray, size: int, wrap: int) -> np.ndarray:
    """Return the texel of an axis of `size` for an index that may lie beyond it."""
    if wrap == CLAMP:
        return index.clip(0, size - 1)
    if wrap == MIRROR:
        index = index % (2 * size)
        return np.minimum(index, 2 * size - 1 - index)
    return index % size


def look_up(picture: GltfPicture, uv: np.ndarray) -> np.ndarray:
    """(n, 3) linear light at (n, 2), v down, blended between texels."""
    width, height = picture.size
    # texel centres are at halves
    x, y = (uv * [width, height] - 0.5).T
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    found = np.zeros((len(uv), 3), np.float32)
    # four neighbours, each by its distance; how they wrap is the sampler's
    for column, right in ((left, x - left), (left + 1, left + 1 - x)):
        for row, down in ((top, y - top), (top + 1, top + 1 - y)):
            weight = (1 - np.abs(right)) * (1 - np.abs(down))
            texels = picture.pixels[
                wrap_index(row, int(height), picture.wraps[1]), wrap_index(column, int(width), picture.wraps[0])
            ]
            found += weight[:, None].astype(np.float32) * LINEAR_OF_CODE[texels]
    return found
