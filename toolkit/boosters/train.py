"""Train a booster from Python: what a notebook has to say, and the recipe for everything else; places tried out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from toolkit.boosters import patch, patch_config, texture, texture_config
from toolkit.boosters.patch import TrainedPatch
from toolkit.boosters.pixel_config import DataConfig
from toolkit.boosters.pixels import Network
from toolkit.boosters.texture import TrainedTexture
from toolkit.boosters.validation import Validation
from toolkit.core.errors import FieldError
from toolkit.core.text import join_words
from toolkit.core.workspace import Workspace, copy_objects
from toolkit.models.network import Classifier
from toolkit.objects.spec import ObjectSpec, PatchMount, read_spec, write_mounts


def train_patch(
    workspace: Workspace, class_name: str | int, classifiers: Classifier | Sequence[Classifier],
    data: Sequence[str | Path] = ("rig",), *, recipe: str = "default", size_px: int = 100, images: int = 256,
    seed: int = 0, name: str | None = None, out: Path | None = None, restart: bool = False, **settings: Any,
) -> TrainedPatch:  # fmt: skip
    """Train a patch that makes classifiers see a class, into `print/patches/NAME.png` and its record.

    Interrupted runs resume, and a finished run is returned as it is: the same arguments give the same pixels.

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
            `toolkit.boosters.patch_config.PatchConfig`.

    Returns:
        `patch` (its `pixels` are (n, n, 3) uint8 sRGB), `files`, and per network its accuracy on held-out images with
        the patch and without.

    Raises:
        ToolkitError: an unknown class, recipe or setting, a value out of its range, data that cannot be used, or
            the disk is full.
    """
    sources = DataConfig(sources=tuple(map(str, data)), images=images, seed=seed)
    config = patch_config.make_config(recipe, {**settings, "size_px": size_px, "seed": seed}, sources)
    networks = as_list(classifiers)
    return patch.train_patch(config, class_name, networks, sources, workspace, name=name, out=out, restart=restart)


def train_texture(
    workspace: Workspace, objects: str | Sequence[str], classifiers: Classifier | Sequence[Classifier], *,
    class_name: str | None = None, recipe: str = "default", size_px: int = 200, keep: Sequence[str] = (),
    backgrounds: Path | None = None, seed: int = 0, name: str | None = None, out: Path | None = None,
    restart: bool = False, workers: int | None = None, **settings: Any,
) -> TrainedTexture:  # fmt: skip
    """Train the whole surface of an object, into `rig/textures/NAME.png`, its record, and a GLB of the object in it.

    Interrupted runs resume, and a finished run is returned as it is.

    Args:
        workspace: whose objects are meant, and where the texture is written.
        objects: name of the object; several of the same class share a texture.
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
        workers: threads that render ahead; 0: none; by default a thread for each core.
        settings: instead of the recipe's: steps, batch, lr, reuse and so on, by the names of
            `toolkit.boosters.texture_config.TextureConfig`.

    Returns:
        `texture` (its `pixels` are (n, n, 3) uint8 sRGB), `files`, and per network its accuracy on held-out views in
        the texture and in the object's own paint, in clear conditions and in fog.

    Raises:
        ToolkitError: an unknown object, recipe or setting, a value out of its range, photographs that cannot be
            used, or the disk is full.
    """
    config = texture_config.make_config(recipe, {
        **settings, "objects": (objects,) if isinstance(objects, str) else tuple(objects), "size_px": size_px,
        "keep": tuple(keep), "backgrounds": backgrounds, "seed": seed,
    })  # fmt: skip
    return texture.train_texture(
        config, as_list(classifiers), workspace, class_name=class_name, name=name, out=out, restart=restart,
        workers=workers,
    )  # fmt: skip


@dataclass(frozen=True)
class PreparedPatch:
    """A patch that is ready to be trained.

    Attributes:
        config, class_name, data: as `toolkit.boosters.patch.train_patch` takes them.
        misfit: a line, where the rig mounts it at another size than it is trained for; else empty.
    """

    config: patch_config.PatchConfig
    class_name: str | int
    data: DataConfig
    misfit: str = ""


def prepare_patch(
    workspace: Workspace, recipe: str, overrides: Mapping[str, Any], data: DataConfig, *,
    object_name: str | None = None, class_name: str | int | None = None, print_profile: Path | None = None,
    seed: int = 0,
) -> PreparedPatch:  # fmt: skip
    """Complete what was asked for: by an object's spec, and with no more renders than the steps can use.

    Args:
        workspace: whose objects are meant.
        recipe: `default` or `paper`.
        overrides: settings that are not the recipe's.
        data: the images; may be without sources where an object is named.
        object_name: whose class, size and renders are taken where nothing else is said.
        class_name: what the patch shall be recognised as.
        print_profile: file of a printer that was measured.
        seed: of every random draw.

    Raises:
        ToolkitError: neither class nor object, no images, an unknown object, or as `make_config`.
    """
    # a measured printer replaces the printers that are drawn
    if print_profile is not None:
        overrides = patch_config.use_printer(overrides, print_profile)
    sources, misfit = data.sources, ""
    if object_name is not None:
        # what the object's spec says, unless it was asked for otherwise
        spec = read_spec(workspace.object_spec(object_name))
        class_name = spec.class_name if class_name is None else class_name
        # a patch that is trained for an object is seen on it, beside whatever folders were named
        sources = sources if data.rig_source else (*sources, f"rig:{object_name}")
        overrides = patch_config.size_by_spec(overrides, spec)
        misfit = _describe_misfit(object_name, spec, overrides.get("size_mm"))
    if class_name is None:
        raise FieldError("{class_name} is missing: name it, or the object with {object_name}", {})
    if not sources:
        raise FieldError("{sources} is missing: expected a folder of images, or 'rig' for renders of the object", {})
    images = DataConfig(sources=sources, backgrounds=data.backgrounds, images=data.images, seed=seed)
    config = patch_config.make_config(recipe, {**overrides, "seed": seed}, images)
    if images.rig_source is not None:  # what was asked for by number is kept
        fewer_views, fewer_images = patch_config.limit_renders(config, images)
        config = config if "mounted_views" in overrides else fewer_views
        images = images if "images" in data.model_fields_set else fewer_images
    return PreparedPatch(config, class_name, images, misfit)


def _describe_misfit(name: str, spec: ObjectSpec, asked_mm: float | None) -> str:
    others_mm = [f"{mount.size_mm:g}" for mount in spec.mounts if mount.size_mm not in (None, asked_mm)]
    if not asked_mm or not others_mm:
        return ""
    return (
        f"{name}: trained for {asked_mm:g} mm, but the rig mounts its patch at {join_words(others_mm)} mm: set "
        "size_mm under [patch] in its spec"
    )


def train_for_object(
    workspace: Workspace, name: str, networks: Sequence[Network], overrides: Mapping[str, Any], seed: int = 0
) -> TrainedPatch:
    """Train the patch of an object on renders of it, as `toolkit train-patch --object NAME` does.

    Raises:
        ToolkitError: an unknown object, or as `train_patch`.
    """
    renders = DataConfig(sources=(f"rig:{name}",))
    asked = prepare_patch(workspace, "default", overrides, renders, object_name=name, seed=seed)
    return patch.train_patch(asked.config, asked.class_name, networks, asked.data, workspace, name=name)


def try_place(
    workspace: Workspace, name: str, networks: Sequence[Network], mounts: Sequence[PatchMount], steps: int,
    seed: int = 0,
) -> list[Validation]:  # fmt: skip
    """Train a patch briefly in a place, and measure it on held-out views; grey paper stands in for `bare`.

    In as many places as there are mounts, a mount for each sheet. Nothing of it is kept.
    """
    # a copy of the objects: a trial writes its mounts into no file of the user's
    with TemporaryDirectory() as folder:
        space = copy_objects(workspace, Path(folder))
        write_mounts(workspace.object_spec(name), space.objects_dir / f"{name}.toml", mounts)
        return train_for_object(space, name, networks, {"steps": steps}, seed).on_object


def as_list(classifiers: Classifier | Sequence[Classifier]) -> list[Classifier]:
    """Return a network or several as a list."""
    return [classifiers] if isinstance(classifiers, Classifier) else list(classifiers)
