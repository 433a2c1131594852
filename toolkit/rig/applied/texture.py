"""A texture all over an object, in place of its paint."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_json, sha256_bytes
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh
from toolkit.objects.painted import check_fit, paint_object
from toolkit.objects.records import (
    COMMAND,
    Texture,
    TextureRecord,
    encode_png,
    keep_name,
    read_texture,
    read_usable,
    uv_name,
)
from toolkit.rig.applied.base import (
    AppliedBooster,
    BoosterKind,
    StoredBooster,
    StoredTraining,
    draw_control,
    read_trainings,
)


@dataclass(frozen=True)
class TextureBooster(AppliedBooster):
    """A booster all over the object: its pixels take the place that a texture has there."""

    texture: Texture = field(kw_only=True)  # whose place and atlas it takes

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


def list_texture_files(workspace: Workspace, item: TableObject) -> list[Path]:
    """Return record and picture of an object's texture, and what it takes to dress its objects again."""
    record = find_texture(workspace, item).record
    return [*_list_files(workspace.textures()[record.name], record)]


def _list_files(png: Path, record: TextureRecord) -> Iterator[Path]:
    yield from (png.with_suffix(".json"), png)
    for item in record.objects:
        if item.uv_sha256 is not None:
            yield png.with_name(uv_name(png.stem, item.name))
        if item.keep_image_sha256 is not None:
            yield png.with_name(keep_name(png.stem, item.name))


def read_stored_texture(png: Path) -> StoredBooster:
    """Read a texture; raises as `read_texture`."""
    made = read_texture(png)
    record = made.record
    return StoredBooster(
        made.pixels, record.png_sha256, record.class_name, record.class_index, record.networks,
        (*_list_files(png, record),), check=lambda item: check_fit(item, made),
    )  # fmt: skip


def list_texture_trainings(workspace: Workspace) -> Iterator[StoredTraining]:
    """Yield the training of every texture."""
    return read_trainings(workspace.textures().values(), TextureRecord)


TEXTURE = BoosterKind(
    "textured", "texture", find_texture_booster, ("random-texture", "grey-texture"), is_painted=True,
    files=list_texture_files, read=read_stored_texture, list_trainings=list_texture_trainings, folder="rig/textures",
)  # fmt: skip


def find_texture(workspace: Workspace, item: TableObject) -> Texture:
    """The texture of an object: by its name, else the first by name that was trained on it.

    Broken textures of other names are left out, see `read_usable`.

    Raises:
        ToolkitError: there is none, its files do not match, or the object's mesh is another than it was trained on.
    """
    # by name, so that every run takes the same of several
    textures = dict(sorted(workspace.textures().items()))
    for name, record in read_usable(_read_texture_record, textures, item.name):
        # a texture without a record is refused by `read_texture`, and only where it is the object's by its name
        if name == item.name if record is None else record.entry(item.name):
            texture = read_texture(textures[name])
            check_fit(item, texture)
            return texture
    raise ToolkitError(
        f"no texture for object '{item.name}': run '{COMMAND} --object {item.name}', or leave the variants "
        "with textures out"
    )


def _read_texture_record(png_file: Path) -> TextureRecord | None:
    record_file = png_file.with_suffix(".json")
    return read_json(record_file, TextureRecord) if record_file.is_file() else None
