"""The objects that wear a texture, made ready for it."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.boosters.texture_config import TextureConfig
from toolkit.core.errors import FieldError
from toolkit.core.files import sha256_bytes
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import read_image
from toolkit.objects.atlas import Atlas, make_atlas, nearest_covered
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.records import read_texture
from toolkit.rig.variants import check_fit
from toolkit.rig.views import PaintableObject
from toolkit.worlds.place import scale_to_world


@dataclass(frozen=True)
class TexturedObject:
    """An object with the atlas of its texture."""

    item: TableObject
    atlas: Atlas

    @property
    def name(self) -> str:
        """Of the object."""
        return self.item.name

    def subject(self, at_real_size: bool = False) -> PaintableObject:
        """What the view stream renders: the model, millimetres, or what it is a model of, metres."""
        material = int(self.atlas.mesh.face_material[self.atlas.trained][0])
        if not at_real_size:
            return PaintableObject(self.atlas.mesh, material, self.item.mesh)
        spec = self.item.spec
        painted, bare = (scale_to_world(mesh, spec, spec.real_length_m) for mesh in (self.atlas.mesh, self.item.mesh))
        return PaintableObject(painted, material, bare)

    @property
    def metres_per_mm(self) -> float:
        """Scale to its real size; raises a `ToolkitError` where its spec does not state it."""
        return self.item.spec.metres_per_mm

    def describe(self) -> str:
        """How large its mesh is, and what of it the texture covers."""
        atlas = self.atlas
        where = "new texture coordinates" if atlas.unwrapped else "its own texture coordinates"
        kept = 1 - atlas.trained.mean()
        paint = f", {kept:.0%} of its triangles keep their paint" if kept else ""
        used = f"{atlas.covered.mean():.0%} of the texture used"
        return f"{self.name}, {len(atlas.mesh.faces)} triangles, {where}, {used}{paint}"


def load_objects(workspace: Workspace, config: TextureConfig, keep_image: np.ndarray | None) -> list[TexturedObject]:
    """Load the objects and make their atlases.

    Raises:
        ToolkitError: an unknown object, a mesh or mask that cannot be used, or nothing left to train.
    """
    items = [load_object(workspace.object_spec(name)) for name in config.objects]
    atlases = [make_atlas(item.mesh, config.size_px, config.keep, keep_image, config.unwrap) for item in items]
    return [TexturedObject(item, atlas) for item, atlas in zip(items, atlases, strict=True)]


def read_start(file: Path, objects: list[TexturedObject], size_px: int) -> np.ndarray:
    """(n, n, 3) uint8 sRGB of the texture that training goes on from.

    Raises:
        ToolkitError: it cannot be read, has another size, or was not trained on these objects.
    """
    texture = read_texture(Path(file))
    if texture.record.n_px != size_px:
        raise FieldError(
            f"is {texture.record.n_px} px a side: expected {size_px}, as {{size_px}} says", {"start": file}
        )
    for one in objects:
        check_fit(one.item, texture)
        stored = texture.corner_uv.get(one.name)
        if one.atlas.unwrapped != (stored is not None) or (
            stored is not None and not np.array_equal(stored, one.atlas.corner_uv)
        ):
            raise FieldError(f"has other texture coordinates of {one.name} than this run makes", {"start": file})
    return texture.pixels


def find_source(objects: list[TexturedObject]) -> np.ndarray:
    """(n, n) int64, which texel each takes its colour from: a texel that any object shows is its own."""
    atlases = [one.atlas for one in objects]
    if len(atlases) == 1:
        return atlases[0].source
    return nearest_covered(np.logical_or.reduce([atlas.covered for atlas in atlases]))


def hash_objects(objects: list[TexturedObject]) -> str:
    """Hash of the shapes, their texture coordinates and what is kept."""
    parts: list[Any] = []
    for one in objects:
        uv = sha256_bytes(np.ascontiguousarray(one.atlas.corner_uv).tobytes())
        trained = sha256_bytes(one.atlas.trained.tobytes())
        parts.append([one.name, one.item.shape_sha256, uv, trained, one.atlas.covered.shape])
    return sha256_bytes(json.dumps(parts).encode())


def choose_class(class_name: str | int | None, objects: list[TexturedObject]) -> str | int:
    """The class to train for: the one asked for, else the one that all objects have.

    Raises:
        FieldError: the objects have several.
    """
    if class_name is not None:
        return class_name
    classes = {one.name: str(one.item.spec.class_name) for one in objects}
    if len(set(classes.values())) > 1:
        found = ", ".join(f"{name}: {label}" for name, label in classes.items())
        raise FieldError(f"the objects have several classes ({found}): say which is trained with {{class_name}}", {})
    return next(iter(classes.values()))


def read_keep_image(file: Path) -> np.ndarray:
    """(h, w) bool, true where a picture is brighter than middle grey.

    Raises:
        ToolkitError: it cannot be read.
    """
    if not Path(file).is_file():
        raise FieldError("no such file: expected a picture, white where the paint is kept", {"keep_image": file})
    return read_image(Path(file)).mean(axis=2) >= 128
