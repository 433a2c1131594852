"""Objects in a trained texture: which one is theirs, whether it still fits, and dressing them in it."""

from typing import TYPE_CHECKING

import numpy as np

from toolkit.errors import ToolkitError
from toolkit.files import read_json
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh
from toolkit.textures import COMMAND, Texture, TexturedObject, TextureRecord, read_texture
from toolkit.workspace import Workspace

if TYPE_CHECKING:
    from toolkit.objects.atlas import Atlas


def find_texture(workspace: Workspace, item: TableObject) -> Texture:
    """The texture of an object: the one that bears its name, else the first by name that was trained on it.

    Raises:
        ToolkitError: there is none, its files do not match, or the object's mesh is another than it was trained on.
    """
    textures = workspace.textures()
    for name in sorted(textures, key=lambda name: (name != item.name, name)):
        record_file = textures[name].with_suffix(".json")
        # one that lacks its record is refused by `read_texture`, and only where it is the object's by its name
        listed = record_file.is_file() and read_json(record_file, TextureRecord).entry(item.name)
        if listed or (name == item.name and not record_file.is_file()):
            texture = read_texture(textures[name])
            check_fit(item, texture)
            return texture
    raise ToolkitError(
        f"no texture for object '{item.name}': train one with '{COMMAND} --object {item.name}', or leave the variants "
        "with textures out"
    )


def check_fit(item: TableObject, texture: Texture) -> TexturedObject:
    """What the record says of an object, if the object is still the one that the texture was trained on.

    Raises:
        ToolkitError: the texture is not for it, or its mesh changed.
    """
    name, again = texture.record.name, f"train again with '{COMMAND} --object {item.name}'"
    entry = texture.record.entry(item.name)
    if entry is None:
        raise ToolkitError(f"texture '{name}' was not trained on object '{item.name}': {again}")
    if item.shape_sha256 != entry.mesh_sha256:
        raise ToolkitError(f"{item.name}: the object's mesh changed after training of its texture '{name}': {again}")
    corner_uv = texture.corner_uv.get(item.name)
    if corner_uv is not None and len(corner_uv) != len(item.mesh.faces):
        raise ToolkitError(
            f"{item.name}: texture '{name}' has coordinates of {len(corner_uv)} triangles, the object has "
            f"{len(item.mesh.faces)}: {again}"
        )
    return entry


def fit_texture(item: TableObject, texture: Texture) -> "Atlas":
    """The atlas that a texture was trained on, rebuilt from the object's mesh and what is stored beside the texture.

    Raises:
        ToolkitError: as `check_fit`.
    """
    from toolkit.objects.atlas import make_atlas

    entry = check_fit(item, texture)
    return make_atlas(
        item.mesh, texture.record.n_px, entry.keep, texture.keep_images.get(item.name), entry.unwrapped,
        texture.corner_uv.get(item.name),
    )  # fmt: skip


def paint_object(item: TableObject, texture: Texture, pixels: np.ndarray) -> Mesh:
    """The object with pixels (n, n, 3) uint8 sRGB where a texture of it has its own; raises as `check_fit`."""
    from toolkit.objects.atlas import wear

    return wear(fit_texture(item, texture), pixels)
