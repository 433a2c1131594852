"""A texture all over an object, in place of its paint."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_json, sha256_bytes
from toolkit.core.workspace import Workspace
from toolkit.objects.atlas import Atlas, apply_texture, make_atlas
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh
from toolkit.objects.records import (
    COMMAND,
    Texture,
    TexturedObjectRecord,
    TextureRecord,
    encode_png,
    read_texture,
    read_usable,
)
from toolkit.rig.applied.base import AppliedBooster, BoosterKind, draw_control


@dataclass(frozen=True)
class TextureBooster(AppliedBooster):
    """A booster all over the object: its pixels take the place that a texture has there.

    Attributes:
        texture: whose place and atlas it takes.
    """

    texture: Texture = field(kw_only=True)

    def apply(self, item: TableObject) -> Mesh:
        """Return the painted object; raises as `check_fit`."""
        return paint_object(item, self.texture, self.pixels)

    def describe(self, item: TableObject) -> dict[str, Any]:
        """Return the hash of its pixels, and the atlas that they lie on."""
        entry = check_fit(item, self.texture)
        atlas = entry.model_dump(include={"unwrapped", "uv_sha256", "keep", "keep_image_sha256"})
        return {"texture": self.sha256, "atlas": atlas}

    def note(self) -> dict[str, Any]:
        """Return its name, and its side in texels."""
        return {"booster": self.name, "booster_px": len(self.pixels)}


def find_texture_booster(
    workspace: Workspace, item: TableObject, variant: str, perfect: bool = False, seed: int = 0
) -> TextureBooster:
    """Return an object's texture (`textured`), or noise or grey in its place.

    Raises:
        ToolkitError: the texture is missing or broken, or the object's mesh has changed.
    """
    own = find_texture(workspace, item)
    if variant == TEXTURE.variant:
        return TextureBooster(own.pixels, own.record.png_sha256, own.record.name, texture=own)
    pixels = draw_control(variant, item, own.record.n_px)
    return TextureBooster(pixels, sha256_bytes(encode_png(pixels)), variant, texture=own)


TEXTURE = BoosterKind("textured", "texture", find_texture_booster, ("random-texture", "grey-texture"), is_painted=True)


def find_texture(workspace: Workspace, item: TableObject) -> Texture:
    """The texture of an object: the one that bears its name, else the first by name that was trained on it.

    Broken textures of other names are left out, see `read_usable`.

    Raises:
        ToolkitError: there is none, its files do not match, or the object's mesh is another than it was trained on.
    """
    textures = dict(sorted(workspace.textures().items()))
    for name, record in read_usable(_read_texture_record, textures, item.name):
        # one that lacks its record is refused by `read_texture`, and only where it is the object's by its name
        if name == item.name if record is None else record.entry(item.name):
            texture = read_texture(textures[name])
            check_fit(item, texture)
            return texture
    raise ToolkitError(
        f"no texture for object '{item.name}': train one with '{COMMAND} --object {item.name}', or leave the variants "
        "with textures out"
    )


def _read_texture_record(png_file: Path) -> TextureRecord | None:
    record_file = png_file.with_suffix(".json")
    return read_json(record_file, TextureRecord) if record_file.is_file() else None


def check_fit(item: TableObject, texture: Texture) -> TexturedObjectRecord:
    """What the record says of an object, if the object is still the one that the texture was trained on.

    Raises:
        ToolkitError: the texture is not for it, or its mesh changed.
    """
    name, again = texture.record.name, f"train again with '{COMMAND} --object {item.name}'"
    entry = texture.record.entry(item.name)
    if entry is None:
        raise ToolkitError(f"texture '{name}' was not trained on object '{item.name}': {again}")
    if not item.has_shape(entry.mesh_sha256):
        raise ToolkitError(f"{item.name}: the object's mesh changed after training of its texture '{name}': {again}")
    corner_uv = texture.corner_uv.get(item.name)
    if corner_uv is not None and len(corner_uv) != len(item.mesh.faces):
        raise ToolkitError(
            f"{item.name}: texture '{name}' has coordinates of {len(corner_uv)} triangles, the object has "
            f"{len(item.mesh.faces)}: {again}"
        )
    return entry


def fit_texture(item: TableObject, texture: Texture) -> Atlas:
    """The atlas that a texture was trained on, rebuilt from the object's mesh and what is stored beside the texture.

    Raises:
        ToolkitError: as `check_fit`.
    """
    entry = check_fit(item, texture)
    return make_atlas(
        item.mesh, texture.record.n_px, entry.keep, texture.keep_images.get(item.name),
        unwrap=entry.unwrapped, corner_uv=texture.corner_uv.get(item.name),
    )  # fmt: skip


def paint_object(item: TableObject, texture: Texture, pixels: np.ndarray) -> Mesh:
    """The object with pixels (n, n, 3) uint8 sRGB where a texture of it has its own; raises as `check_fit`."""
    return apply_texture(fit_texture(item, texture), pixels)
