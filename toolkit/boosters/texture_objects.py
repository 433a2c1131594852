"""The objects that wear a texture, made ready for it."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.boosters.texture_config import TextureRequest
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import read_image
from toolkit.objects.atlas import Atlas, make_atlas, nearest_covered
from toolkit.objects.load import TableObject, load_object
from toolkit.rig.views import Subject


@dataclass(frozen=True)
class Wearers:
    """Objects, each with its atlas.

    Attributes:
        items: as the rig photographs them.
        atlases: of each, for one size of texture.
        keep_image: (h, w) bool, of the only object; None without one.
    """

    items: tuple[TableObject, ...]
    atlases: tuple[Atlas, ...]
    keep_image: np.ndarray | None = None

    @property
    def source(self) -> np.ndarray:
        """(n, n) int64, which texel each takes its colour from: a texel that any object shows is its own."""
        if len(self.atlases) == 1:
            return self.atlases[0].source
        return nearest_covered(np.logical_or.reduce([atlas.covered for atlas in self.atlases]))

    @property
    def sha256(self) -> str:
        """Hash of the shapes, their texture coordinates and what is kept."""
        parts: list[Any] = []
        for item, atlas in zip(self.items, self.atlases, strict=True):
            uv = sha256_bytes(np.ascontiguousarray(atlas.corner_uv).tobytes())
            parts.append([item.name, item.shape_sha256, uv, sha256_bytes(atlas.trained.tobytes()), atlas.covered.shape])
        return sha256_bytes(json.dumps(parts).encode())

    def subjects(self) -> list[Subject]:
        """What the view stream renders."""
        return [
            Subject(atlas.mesh, int(atlas.mesh.face_material[atlas.trained][0]), item.mesh)
            for item, atlas in zip(self.items, self.atlases, strict=True)
        ]

    def stored_uv(self) -> dict[str, np.ndarray]:
        """(m, 3, 2) texture coordinates by object, of those that were unwrapped."""
        pairs = zip(self.items, self.atlases, strict=True)
        return {item.name: atlas.corner_uv for item, atlas in pairs if atlas.unwrapped}

    def keep_images(self) -> dict[str, np.ndarray]:
        """The mask by object."""
        return {} if self.keep_image is None else {self.items[0].name: self.keep_image}

    def views_of(self, request: TextureRequest) -> dict[str, Any]:
        """How many views were rendered to train on, for the record."""
        return {
            "rendered": request.groups * request.views.studios * request.views.per_studio,
            "used": request.descent.steps * request.descent.batch,
            "objects": [item.name for item in self.items],
        }


def dress_objects(workspace: Workspace, request: TextureRequest) -> Wearers:
    """Load the objects and make their atlases.

    Raises:
        ToolkitError: an unknown object, a mesh or mask that cannot be used, or nothing left to train.
    """
    mask = None if request.keep_image is None else read_keep_image(request.keep_image)
    items = tuple(load_object(workspace.object_spec(name)) for name in request.objects)
    atlases = tuple(make_atlas(item.mesh, request.size_px, request.keep, mask, request.unwrap) for item in items)
    return Wearers(items, atlases, mask)


def choose_class(request: TextureRequest, items: tuple[TableObject, ...]) -> str:
    """The class to train for: the one asked for, else the one that all objects have.

    Raises:
        ToolkitError: the objects have several.
    """
    if request.class_name is not None:
        return request.class_name
    classes = {item.name: str(item.spec.class_name) for item in items}
    if len(set(classes.values())) > 1:
        found = ", ".join(f"{name}: {label}" for name, label in classes.items())
        raise ToolkitError(f"the objects have several classes ({found}): say which is trained with --class")
    return next(iter(classes.values()))


def read_keep_image(file: Path) -> np.ndarray:
    """(h, w) bool, true where a picture is brighter than middle grey.

    Raises:
        ToolkitError: it cannot be read.
    """
    if not Path(file).is_file():
        raise ToolkitError(f"--keep-image {file}: no such file: expected a picture, white where the paint is kept")
    return read_image(Path(file)).mean(axis=2) >= 128
