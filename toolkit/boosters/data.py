"""All training images of a run, in memory, with a part held out: from folders, or renders of the object."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolkit import __version__
from toolkit.boosters.pixel_config import RIG, DataConfig, count_held_out, is_rig_source
from toolkit.core.console import notice, progress
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import inside, real_path, sha256_bytes, sha256_file, write_bytes
from toolkit.core.lazy import torch
from toolkit.core.workspace import Workspace
from toolkit.imaging.preprocessing import Preprocessing, resize_and_crop
from toolkit.imaging.read import UnreadableImage, find_files, read_image, show_path
from toolkit.models.labels import imagenet_wnids, plain_name
from toolkit.objects.load import load_object
from toolkit.objects.spec import read_spec
from toolkit.training.renders import RENDERS

if TYPE_CHECKING:
    from toolkit.boosters.pixels import Network


def stack_on_device(images: np.ndarray, device: str) -> "torch.Tensor":
    """(k, s, s, 3) uint8 to a (k, 3, s, s) uint8 tensor on `device`: a batch is then cut without another copy."""
    return torch.from_numpy(np.ascontiguousarray(images.transpose(0, 3, 1, 2))).to(device)


def draw_batch(images: "torch.Tensor", rng: np.random.Generator, count: int, image_px: int) -> "torch.Tensor":
    """Random images, each cut to `image_px` at a random place and mirrored half of the time.

    Args:
        images: (k, 3, s, s) uint8 sRGB.
        rng: draws which, where and whether.
        count: how many; none comes twice where there are enough.
        image_px: side of the result, at most s.

    Returns:
        (count, 3, image_px, image_px) float32 sRGB-encoded in [0, 1].
    """
    if count == 0:
        return torch.empty(0, 3, image_px, image_px, device=images.device)
    which = rng.choice(len(images), count, replace=count > len(images))
    # where to cut and whether to mirror, for each image
    corners = rng.integers(0, images.shape[-1] - image_px + 1, (count, 2))
    mirrored = rng.random(count) < 0.5
    cuts = [images[k, :, y : y + image_px, x : x + image_px] for k, (y, x) in zip(which, corners, strict=True)]
    cuts = [cut.flip(-1) if flip else cut for cut, flip in zip(cuts, mirrored, strict=True)]
    return torch.stack(cuts).float().div_(255)


def cut_centres(images: "torch.Tensor", image_px: int) -> "torch.Tensor":
    """The middle of each image, as the network's own preprocessing cuts it: float32 sRGB-encoded in [0, 1]."""
    start = round((images.shape[-1] - image_px) / 2)
    return images[:, :, start : start + image_px, start : start + image_px].float().div_(255)


@dataclass(frozen=True)
class FolderImages:
    """The files that a folder offers.

    Attributes:
        folder: where they lie.
        files: parts relative to the folder, sorted.
        use: `class` when all show the class, `backgrounds` when they may show anything.
        refused: (path, reason) of files that must not be opened.
    """

    folder: Path
    files: tuple[tuple[str, ...], ...]
    use: str
    refused: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Loaded:
    """Images of a source.

    Attributes:
        images: (k, s, s, 3) uint8 sRGB.
        skipped: (path, reason) of what could not be used.
        record: for the booster's record: source, use, how many were found and used; None where none were asked for.
        hashes: SHA-256 of the files that were used; none of renders.
    """

    images: np.ndarray
    skipped: tuple[tuple[str, str], ...] = ()
    record: dict[str, Any] | None = None
    hashes: tuple[str, ...] = ()


def names_of_class(classifier: "Network", index: int, typed: str) -> frozenset[str]:
    """Names of the class's folder, in lower case: the WordNet id, the label, the user's own words."""
    names = {typed, classifier.labels[index]}
    if classifier.is_imagenet:
        names.add(imagenet_wnids()[index])
    return frozenset(plain_name(name) for name in names)


def choose_images(
    folder: Path, names: frozenset[str], backgrounds: str = "auto", field: str = "sources"
) -> FolderImages:
    """The images in a folder that train a class.

    Args:
        folder: an ImageFolder (`n04552348/…`, `warplane/…`, at any depth), or any folder with images.
        names: what a folder of the class may be called, see `names_of_class`.
        backgrounds: `class` takes images of the class only, `all` takes every image, `auto` those of the class where
            there are any and else every image. The paper samples y = C_targ; the patch learns from both.
        field: which names the folder, for errors.

    Raises:
        ToolkitError: no such folder, no images in it, or with `class` none of the class.
    """
    folder = Path(folder)
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        renders = ", or 'rig' for renders of the object" if field == "sources" else ""
        raise FieldError(f"{{{field}}} {folder} {what}: expected a folder of images{renders}", {})
    found = find_files(folder)
    if not found.images:
        others = f" ({len(found.others)} other files)" if found.others else ""
        raise FieldError(f"no images in it{others}: expected .jpg, .png, .webp, .tif or .heic files", {field: folder})
    # images of the class are recognised by a folder's name, the given folder's too
    inside_class = plain_name(real_path(folder).name) in names
    own = tuple(
        parts for parts in found.images if inside_class or any(plain_name(part) in names for part in parts[:-1])
    )
    if backgrounds == "class" and not own:
        raise FieldError(
            f"no sub-folder called {' or '.join(sorted(names))}: name one so, or use {{backgrounds}} all",
            {field: folder},
        )
    if own and backgrounds != "all":
        return FolderImages(folder, own, "class", found.refused)
    # without images of the class, all are backgrounds
    use = "class" if len(own) == len(found.images) else "backgrounds"
    return FolderImages(folder, found.images, use, found.refused)


IMAGE_HASHES, HASH_DIGITS, MOST_HASHES = "images_sha256", 12, 2000
"""Field of `data` in records, and how much of each hash it holds: enough to find an image again."""


def list_image_hashes(hashes: Sequence[str]) -> dict[str, Any]:
    """Which images were used, for the record, so that a test on them is known; nothing of very many."""
    shown = " ".join(sorted(sha256[:HASH_DIGITS] for sha256 in hashes))
    return {IMAGE_HASHES: shown} if 0 < len(hashes) <= MOST_HASHES else {}


def load_files(
    choice: FolderImages, count: int, rng: np.random.Generator, how: Preprocessing, advance: Callable[[], None]
) -> Loaded:
    """Decode up to `count` images, chosen at random; an unreadable image is skipped and replaced.

    Args:
        choice: the files.
        count: at most so many.
        rng: chooses.
        how: the network's preprocessing; images are kept square at its `resize_px`, so that training can cut at random.
        advance: called after each image.

    Raises:
        ToolkitError: none of them can be read.
    """
    # cut later, at random: the whole square is kept
    square = replace(how, crop_px=how.resize_px)
    images: list[np.ndarray] = []
    hashes: list[str] = []
    skipped = list(choice.refused)
    # in random order, until enough images could be read
    for k in rng.permutation(len(choice.files)):
        if len(images) == count:
            break
        parts = choice.files[k]
        try:
            pixels = read_image(choice.folder.joinpath(*parts), how.resize_px)
        except UnreadableImage as error:
            skipped.append((show_path((choice.folder.name, *parts)), error.reason))
            continue
        images.append(resize_and_crop(pixels, square))
        hashes.append(sha256_file(choice.folder.joinpath(*parts)))
        advance()
    if not images:
        path, reason = skipped[-1]
        raise ToolkitError(f"{choice.folder}: none of its {len(choice.files)} images can be read; {path}: {reason}")
    record = {"source": choice.folder.name, "use": choice.use, "found": len(choice.files), "used": len(images)}
    return Loaded(np.stack(images), tuple(skipped), record, tuple(hashes))


def choose_object(workspace: Workspace, source: str, names: frozenset[str]) -> str:
    """Return the object to render: named after the colon, else the object whose class is trained.

    Raises:
        ToolkitError: there is none, or several have that class.
    """
    # a name after the colon wins
    _, colon, name = source.partition(":")
    if colon:
        workspace.object_spec(name)
        return name
    # else the only object whose class is meant
    specs = {name: read_spec(file) for name, file in workspace.object_specs().items()}
    fitting = [
        name for name, spec in specs.items() if spec.mesh and str(spec.class_name).lower().replace("_", " ") in names
    ]
    if len(fitting) == 1:
        return fitting[0]
    known = ", ".join(fitting or sorted(specs))
    what = "several objects have" if fitting else "no object has"
    raise FieldError(
        f"{what} the class {' or '.join(sorted(names))}: say {{sources}} rig:NAME, of {known}", {"sources": RIG}
    )


def load_renders(workspace: Workspace, name: str, count: int, *, seed: int, how: Preprocessing, keep: Path) -> Loaded:
    """Render `count` images of an object, or take those that an interrupted run of the same inputs left in `keep`.

    Rendering takes longer than reading, and a GPU driver need not give the same bits twice: a run that goes on must
    see the images that it began with.
    """
    spec_file = workspace.object_spec(name)
    # a mesh file counts by its bytes, a built-in object by its name
    spec = read_spec(spec_file)
    mesh = spec.mesh
    if not mesh.startswith("builtin:") and (path := inside(spec_file.parent, mesh)).is_file():
        mesh = sha256_file(path)
    # renders of another release may differ: they are not gone on with
    settings = (count, seed, how.resize_px, how.filter_name, __version__)
    key = RENDERS.key(spec.model_dump(mode="json"), mesh, *settings)
    # named by its inputs, so that a changed object or seed is rendered again
    file = keep / f"renders-{key[:16]}.npy"
    record = {"source": f"{RIG}:{name}", "use": "class", "found": count, "used": count}
    kept = _read_kept(file, (count, how.resize_px, how.resize_px, 3))
    if kept is not None:
        return Loaded(kept, (), record)
    images = render_object(workspace, name, count, seed, how.resize_px)
    buffer = BytesIO()
    np.save(buffer, images, allow_pickle=False)
    write_bytes(file, buffer.getvalue())
    return Loaded(images, (), record)


def render_object(workspace: Workspace, name: str, count: int, seed: int, image_px: int) -> np.ndarray:
    """(count, image_px, image_px, 3) uint8 sRGB: the unmodified object in random studios, from random poses."""
    from toolkit.rig.views import ViewSettings, render_pictures

    mesh = load_object(workspace.object_spec(name)).mesh
    with progress(f"rendering {name} to train on", count) as bar:
        taken = []
        for picture in render_pictures(mesh, count, ViewSettings(image_px=image_px), seed):
            taken.append(picture)
            bar.advance()
    return np.stack(taken)


def _read_kept(file: Path, shape: tuple[int, ...]) -> np.ndarray | None:
    try:
        images = np.load(file, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None  # absent or damaged: rendered again
    return images if images.shape == shape and images.dtype == np.uint8 else None


@dataclass(frozen=True)
class TrainingData:
    """Training images of a run.

    Attributes:
        train, held_out: (k, s, s, 3) uint8 sRGB.
        skipped: (path, reason) of files that could not be used.
        record: for the patch's record: sources with counts, and the hash of all pixels.
        is_held_out: False for a single image, which then serves for both.
    """

    train: np.ndarray
    held_out: np.ndarray
    skipped: tuple[tuple[str, str], ...]
    record: dict[str, Any]
    is_held_out: bool

    @property
    def sha256(self) -> str:
        """Hash of all pixels in their order."""
        return self.record["sha256"]


def load_data(
    config: DataConfig, names: frozenset[str], how: Preprocessing, workspace: Workspace, keep: Path
) -> TrainingData:
    """Load every source and hold out a fifth of each.

    Args:
        config: which.
        names: what a folder or an object of the class may be called.
        how: the network's preprocessing.
        workspace: whose objects `rig` renders.
        keep: folder for renders until the run is finished.

    Raises:
        ToolkitError: a source has no images that can be used.
    """
    # the number of images is shared evenly between the sources
    shares = [len(part) for part in np.array_split(np.arange(config.images), len(config.sources))]
    loaded: list[Loaded] = []
    for k, (source, count) in enumerate(zip(config.sources, shares, strict=True)):
        if is_rig_source(source):
            name = choose_object(workspace, source, names)
            loaded.append(load_renders(workspace, name, count, seed=config.seed, how=how, keep=keep))
            continue
        choice = choose_images(Path(source), names, config.backgrounds)
        rng = Draws(config.seed, k, "data").of("files")
        with progress(f"Reading {choice.folder.name}", min(count, len(choice.files))) as bar:
            loaded.append(load_files(choice, count, rng, how, bar.advance))
    return divide_images(loaded, config)


def divide_images(loaded: list[Loaded], config: DataConfig) -> TrainingData:
    """Join the images of all sources and hold out a fifth of each."""
    train: list[np.ndarray] = []
    held_out: list[np.ndarray] = []
    for source in loaded:
        # the first fifth of each source, so that each is in both parts
        count = count_held_out(len(source.images))
        held_out.append(source.images[:count])
        train.append(source.images[count:])
    images, rest = np.concatenate(train), np.concatenate(held_out)
    # pixels, not files: the same folder decoded otherwise is another run
    sha256 = sha256_bytes(np.concatenate([images, rest]).tobytes())
    record: dict[str, Any] = {
        "sources": [source.record for source in loaded],
        "train": len(images),
        "held_out": len(rest),
        "skipped": sum(len(source.skipped) for source in loaded),
        "sha256": sha256,
        "backgrounds": config.backgrounds,
        "seed": config.seed,
        **list_image_hashes([sha256 for source in loaded for sha256 in source.hashes]),
    }
    skipped = tuple(line for source in loaded for line in source.skipped)
    return TrainingData(images, rest if len(rest) else images, skipped, record, len(rest) > 0)


FEW_IMAGES = 32
"""A class with fewer is trained on images of all classes, where the user leaves it open."""


def describe_data(data: TrainingData) -> None:
    """Print what is taken of folders; of renders there are as many as are asked for."""
    # renders are as many as were asked for, so that there is nothing to tell of them
    folders = [source for source in data.record["sources"] if not is_rig_source(source["source"])]
    for source in folders:
        what = "of the class" if source["use"] == "class" else "as backgrounds, whatever they show"
        notice(f"data: {source['used']} of {source['found']} images from {source['source']}, {what}")
    if not data.is_held_out:
        notice("data: there is one image only: it serves for training and for validation")
    elif len(data.train) < FEW_IMAGES and any(source["use"] == "class" for source in folders):
        notice(f"data: {len(data.train)} images to train on, which is few: backgrounds 'all' takes every image")
