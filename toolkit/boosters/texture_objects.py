"""Inputs of a texture's training: its objects, photographs, a world, and the first pixels."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.boosters.data import Loaded, choose_images, load_files
from toolkit.boosters.pixels import Network
from toolkit.boosters.texture_config import TextureConfig
from toolkit.core.console import progress
from toolkit.core.errors import FieldError
from toolkit.core.files import sha256_bytes, sha256_json
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import read_image
from toolkit.objects.atlas import Atlas, make_atlas, nearest_covered, take_paint
from toolkit.objects.load import TableObject, load_object, scale_to_world
from toolkit.objects.mesh import hash_paint
from toolkit.objects.painted import check_fit
from toolkit.objects.records import read_texture
from toolkit.rig.views import OutdoorSetting, PaintableObject

MAX_BACKGROUNDS = 256


@dataclass(frozen=True)
class TexturedObject:
    """An object with the atlas of its texture."""

    item: TableObject
    atlas: Atlas

    @property
    def name(self) -> str:
        """Name of the object."""
        return self.item.name

    def subject(self, at_real_size: bool = False) -> PaintableObject:
        """The object for the view stream: the model in millimetres, or at its real size in metres."""
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

    def paint(self) -> np.ndarray:
        """(n, n, 3) uint8 sRGB, its own paint as a texture."""
        return take_paint(self.atlas, self.item.mesh)

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
    # each object has an atlas of its own, and all of them share the texture
    items = [load_object(workspace.object_spec(name)) for name in config.objects]
    atlases = [make_atlas(item.mesh, config.size_px, config.keep, keep_image, config.unwrap) for item in items]
    return [TexturedObject(item, atlas) for item, atlas in zip(items, atlases, strict=True)]


def read_start(file: Path, objects: Sequence[TexturedObject], size_px: int) -> np.ndarray:
    """(n, n, 3) uint8 sRGB of the texture that training begins with.

    Raises:
        ToolkitError: it cannot be read, has another size, or was not trained on these objects.
    """
    texture = read_texture(Path(file))
    if texture.record.n_px != size_px:
        raise FieldError(
            f"is {texture.record.n_px} px a side: expected {size_px}, as {{size_px}} says", {"start": file}
        )
    for item in objects:
        check_fit(item.item, texture)
        stored = texture.corner_uv.get(item.name)
        # the same texels would lie elsewhere on the object
        if item.atlas.unwrapped != (stored is not None) or (
            stored is not None and not np.array_equal(stored, item.atlas.corner_uv)
        ):
            raise FieldError(f"has other texture coordinates of {item.name} than this run makes", {"start": file})
    return texture.pixels


def find_source(objects: Sequence[TexturedObject]) -> np.ndarray:
    """(n, n) int64, which texel each takes its colour from: a texel that any object shows is its own."""
    atlases = [item.atlas for item in objects]
    if len(atlases) == 1:
        return atlases[0].source
    # several objects show different texels of the shared texture: what any of them shows is trained
    return nearest_covered(np.logical_or.reduce([atlas.covered for atlas in atlases]))


def hash_objects(objects: Sequence[TexturedObject]) -> str:
    """Hash of the shapes, their texture coordinates, which faces keep their paint, and that paint."""
    parts: list[Any] = []
    for item in objects:
        uv = sha256_bytes(np.ascontiguousarray(item.atlas.corner_uv).tobytes())
        trained = sha256_bytes(item.atlas.trained.tobytes())
        kept = np.unique(item.atlas.mesh.face_material[~item.atlas.trained])
        # nothing where all is trained: then no paint is seen beside the texture
        paint = [hash_paint(item.atlas.mesh.materials[index] for index in kept)] if len(kept) else []
        parts.append([item.name, item.item.shape_sha256, uv, trained, item.atlas.covered.shape, *paint])
    return sha256_json(parts)


def choose_class(class_name: str | int | None, objects: Sequence[TexturedObject]) -> str | int:
    """Return the class to train for: the requested class, else the class that all objects have.

    Raises:
        FieldError: the objects have several.
    """
    # what was asked for goes before what the specs say
    if class_name is not None:
        return class_name
    classes = {item.name: str(item.item.spec.class_name) for item in objects}
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


def load_backgrounds(config: TextureConfig, network: Network) -> Loaded:
    """Photographs to stand behind the object, as the config asks for them."""
    side = network.preprocessing.resize_px
    if not config.background_share or config.backgrounds is None:
        return Loaded(np.zeros((0, side, side, 3), np.uint8))
    found = choose_images(config.backgrounds, frozenset(), "all", "backgrounds")
    count = min(MAX_BACKGROUNDS, len(found.files))
    with progress("Reading backgrounds", count) as bar:
        # 0xBAC tells these draws from others of the same seed
        rng = np.random.default_rng([config.seed, 0xBAC])
        return load_files(found, count, rng, network.preprocessing, bar.advance)


@dataclass(frozen=True)
class TextureInputs:
    """Inputs of a texture's training, beside its settings and its networks.

    Attributes:
        objects: that wear it.
        backgrounds: photographs; there may be none.
        setting: the world that it is trained in; None: studios.
        start: (n, n, 3) uint8 sRGB first pixels; None: the paint if `max_change` limits it, else noise.
        paint: (n, n, 3) uint8 sRGB that `max_change` is counted from; None without a limit.
        keep_image: (h, w) bool mask of the only object, to be recorded.
    """

    objects: Sequence[TexturedObject]
    backgrounds: Loaded
    setting: OutdoorSetting | None = None
    start: np.ndarray | None = None
    paint: np.ndarray | None = None
    keep_image: np.ndarray | None = None

    @property
    def at_real_size(self) -> list[PaintableObject]:
        """The objects for the view stream; in a world at their real size."""
        return [item.subject(at_real_size=self.setting is not None) for item in self.objects]

    def sha256(self, needs_size: bool) -> str:
        """Return the hash of all pixels and shapes, and of the objects' real sizes if `needs_size`."""
        parts = hash_objects(self.objects) + sha256_bytes(self.backgrounds.images.tobytes())
        if needs_size:
            parts += "".join(f" {item.metres_per_mm!r}" for item in self.objects)
        # the start decides the pixels as the paint does, and without a start it is the paint
        given = (self.paint if self.start is None else self.start, self.paint)
        parts += "".join(sha256_bytes(array.tobytes()) for array in given if array is not None)
        if self.setting is not None:
            parts += json.dumps(self.setting.record([item.mesh for item in self.at_real_size]))
        return parts


def load_inputs(
    config: TextureConfig, objects: Sequence[TexturedObject], keep_image: np.ndarray | None, network: Network,
    workspace: Workspace, start: np.ndarray | None = None,
) -> TextureInputs:  # fmt: skip
    """Load what the config names beside the objects and the start.

    Raises:
        ToolkitError: photographs or the world cannot be used.
    """
    return TextureInputs(
        objects, load_backgrounds(config, network),
        setting=config.open_world(workspace),
        start=start,
        paint=None if config.max_change is None else objects[0].paint(),
        keep_image=keep_image,
    )  # fmt: skip
