"""Train a booster from Python: what a notebook has to say, and the recipe for everything else."""

from collections.abc import Sequence
from dataclasses import fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from toolkit.boosters import patch, patch_recipes, texture, texture_recipes
from toolkit.boosters.data import DataRequest
from toolkit.boosters.patch import TrainedPatch
from toolkit.boosters.texture import TrainedTexture
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.models.network import Classifier

Choices = TypeVar("Choices", patch_recipes.Choices, texture_recipes.Choices)


def train_patch(
    workspace: Workspace,
    class_name: str | int,
    classifiers: Classifier | Sequence[Classifier],
    data: Sequence[str | Path] = ("rig",),
    *,
    recipe: str = "default",
    size_px: int = 100,
    images: int = 256,
    seed: int = 0,
    name: str | None = None,
    out: Path | None = None,
    restart: bool = False,
    **settings: Any,
) -> TrainedPatch:
    """Train a patch that makes classifiers see a class, into `print/patches/NAME.png` and its record.

    An interrupted run goes on where it stopped, and one that was finished before comes back as it is: the same
    arguments give the same pixels.

    Args:
        workspace: whose objects are rendered, and where the patch is written.
        class_name: a label of the classifiers, an index, or a WordNet id.
        classifiers: the networks that shall see it; the labels and the preprocessing of the first lead.
        data: `rig` (or `rig:OBJECT`) for renders of the object with the patch mounted on it; folders of photographs.
        recipe: `default`, or `paper` for Algorithm 1 as published.
        size_px: side of the patch in texels; on paper 0.88 mm each, at 250 % of 72 dpi.
        images: kept in memory at most, a fifth of them held out.
        seed: of every random draw.
        name: of the files; by default from the class.
        out: folder for the patch instead of the workspace's.
        restart: forget what an earlier run left.
        settings: instead of the recipe's: steps, epochs, batch, lr, mounted_views and so on, by the names of
            `toolkit.boosters.patch_recipes.Choices`.

    Returns:
        `patch` (its `pixels` are (n, n, 3) uint8 sRGB), `files`, and per network how often it answers right on held-out
        images with the patch and without.

    Raises:
        ToolkitError: an unknown class, recipe or setting, one that is out of its range, data that cannot be used, or
            the disk is full.
    """
    choices = _choose(patch_recipes.Choices, settings)
    sources = DataRequest(tuple(map(str, data)), images=images, seed=seed)
    request = patch_recipes.make_request(recipe, choices, str(class_name), sources, size_px, seed, name)
    return patch.train_patch(request, _as_list(classifiers), workspace, out, restart)


def train_texture(
    workspace: Workspace,
    objects: str | Sequence[str],
    classifiers: Classifier | Sequence[Classifier],
    *,
    class_name: str | None = None,
    recipe: str = "default",
    size_px: int = 200,
    keep: Sequence[str] = (),
    backgrounds: Path | None = None,
    seed: int = 0,
    name: str | None = None,
    out: Path | None = None,
    restart: bool = False,
    workers: int | None = None,
    **settings: Any,
) -> TrainedTexture:
    """Train the whole surface of an object, into `rig/textures/NAME.png`, its record, and a GLB of the object in it.

    An interrupted run goes on where it stopped, and one that was finished before comes back as it is.

    Args:
        workspace: whose objects are meant, and where the texture is written.
        objects: name of the object; several of one class share one texture.
        classifiers: the networks that shall see its class; the labels and the preprocessing of the first lead.
        class_name: a label of the classifiers, an index, or a WordNet id; by default the objects' own class.
        recipe: `default`, or `paper` for Algorithm 2 as published, which needs `backgrounds`.
        size_px: side of the texture in texels, 8 to 1024.
        keep: names of materials that keep their paint.
        backgrounds: folder of photographs to stand behind the object.
        seed: of every random draw.
        name: of the files; by default the object's.
        out: folder for the texture instead of the workspace's.
        restart: forget what an earlier run left.
        workers: processes that render; 0: none; by default one for each core but one.
        settings: instead of the recipe's: steps, batch, lr, reuse and so on, by the names of
            `toolkit.boosters.texture_recipes.Choices`.

    Returns:
        `texture` (its `pixels` are (n, n, 3) uint8 sRGB), `files`, and per network how often it answers right on
        held-out views in the texture and in the object's own paint, clear and in fog.

    Raises:
        ToolkitError: an unknown object, recipe or setting, one that is out of its range, photographs that cannot be
            used, or the disk is full.
    """
    networks = _as_list(classifiers)
    request = texture_recipes.make_request(
        recipe, _choose(texture_recipes.Choices, settings), (objects,) if isinstance(objects, str) else tuple(objects),
        seed, networks[0].preprocessing.crop_px, backgrounds,
        class_name=class_name, size_px=size_px, keep=tuple(keep), name=name,
    )  # fmt: skip
    return texture.train_texture(request, networks, workspace, out, restart, workers=workers)


def _as_list(classifiers: Classifier | Sequence[Classifier]) -> list[Classifier]:
    return [classifiers] if isinstance(classifiers, Classifier) else list(classifiers)


def _choose(kind: type[Choices], settings: dict[str, Any]) -> Choices:
    known = [one.name for one in fields(kind)]
    for name in settings:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"
            raise ToolkitError(f"no setting called '{name}': {hint}")
    return kind(**settings)
