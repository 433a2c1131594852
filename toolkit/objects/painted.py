"""A texture on the object that it was made for."""

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.objects.atlas import Atlas, apply_texture, make_atlas
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh
from toolkit.objects.records import COMMAND, Texture, TexturedObjectRecord


def check_fit(item: TableObject, texture: Texture) -> TexturedObjectRecord:
    """Return the record of an object; a `ToolkitError` if the texture is not for it, or its mesh changed."""
    name, again = texture.record.name, f"train again with '{COMMAND} --object {item.name}'"
    # an atlas fits only the very triangles that it was made for
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
    """Rebuild the atlas that a texture was trained on; raises as `check_fit`."""
    entry = check_fit(item, texture)
    return make_atlas(
        item.mesh, texture.record.n_px, entry.keep, texture.keep_images.get(item.name),
        unwrap=entry.unwrapped, corner_uv=texture.corner_uv.get(item.name),
    )  # fmt: skip


def paint_object(item: TableObject, texture: Texture, pixels: np.ndarray) -> Mesh:
    """Paint the object with pixels (n, n, 3) uint8 sRGB in the place of a texture; raises as `check_fit`."""
    return apply_texture(fit_texture(item, texture), pixels)
