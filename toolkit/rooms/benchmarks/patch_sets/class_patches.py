"""`toolkit train-patches`: a patch for each of many classes, each a unit of work."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from toolkit.boosters.data import FEW_IMAGES, Loaded, TrainingData, divide_images
from toolkit.boosters.patch_config import PatchConfig, check_size
from toolkit.boosters.pixels import Network
from toolkit.core.console import notice, quietly
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import write_bytes
from toolkit.core.workspace import Workspace
from toolkit.engine import EngineConfig
from toolkit.engine.local import InProcess
from toolkit.engine.units import Engine, Shared, Unit, done_unit, run_resumable
from toolkit.evaluation.summaries import list_reasons
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.imaging.read import UnreadableImage
from toolkit.objects.records import read_patch
from toolkit.rooms.benchmarks.patch_sets import ClassPatchesConfig, name_class
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.images import ImageSet
from toolkit.training.processes import current

if TYPE_CHECKING:
    from toolkit.boosters.validation import Share, Validation


@dataclass(frozen=True)
class ClassPatch:
    """A patch of a run: its set and class, and accuracies on held-out images, None if it was finished before."""

    set_name: str
    label: str
    patched: "Share | None"
    bare: "Share | None"


@dataclass(frozen=True)
class ClassPatches:
    """Patches of a run by sizes and classes, and (path, reason) of unusable images and failed patches."""

    patches: list[ClassPatch]
    skipped: list[tuple[str, str]]
    folder: Path
    n_classes: int

    @property
    def sets(self) -> list[str]:
        """Names of the sets."""
        return list(dict.fromkeys(patch.set_name for patch in self.patches))

    def as_json(self) -> dict[str, Any]:
        """All of it for a script."""
        patches = [asdict(patch) for patch in self.patches]
        return {"sets": self.sets, "patches": patches, "skipped": list_reasons(self.skipped)}

    def lines(self) -> Iterator[str]:
        """Numbers of classes and patches, and their folders."""
        folders = ", ".join(str(self.folder / name) for name in self.sets)
        yield f"{self.n_classes} classes, {len(self.patches)} patches in {folders}"


@dataclass(frozen=True)
class Order:
    """A patch to train for a class, and the name of its files in the folder `out`; `restart` discards earlier steps."""

    config: PatchConfig
    class_index: int
    label: str
    name: str
    out: Path
    restart: bool


Made: TypeAlias = "tuple[Validation | None, dict[str, bytes]]"
"""Accuracies on held-out images; and the files by their path in the set, the record last, for the driver to write."""


def train_class_patches(
    config: ClassPatchesConfig, patch: PatchConfig, images: ImageSet, classes: Sequence[int], network: Network,
    workspace: Workspace, *, restart: bool = False, engine: EngineConfig | None = None,
) -> ClassPatches:  # fmt: skip
    """Train every patch that is not finished; a failed patch is listed, and the others are trained.

    An interrupted run resumes in the middle of a patch. On Ray, whose nodes do not see the workspace, half-done patches
    begin again. The engine changes no result. Memory holds the images of a class, or of all, and a patch at a time.

    Args:
        config: sets, sizes and images.
        patch: settings of every patch but its size, see `make_flat_config`.
        images: of these classes, and of others.
        classes: indices of the classes to train.
        network: the classifier.
        workspace: gets the sets.
        restart: discard earlier steps.
        engine: trains the patches; by default this process.

    Raises:
        ToolkitError: a size that does not fit the network, no patch could be trained, workers within torchrun, or the
            disk is full.
    """
    engine = engine or EngineConfig()
    # torchrun shares each patch over its processes, an engine shares out whole patches
    is_torchrun = current().count > 1
    if is_torchrun and engine != EngineConfig():
        raise FieldError("{engine} and {workers} share patches, torchrun shares each patch: choose either", {})
    folder = workspace.root / "print" / "patches"
    orders = {
        f"{order.out.name}/{order.name}": order
        for order in _list_orders(config, patch, classes, network, folder, restart)
    }
    # images are decoded for a class at a time, patches kept as they are finished
    source = _Source(images, config, network.preprocessing)
    done: dict[str, ClassPatch] = {}

    def keep(name: str, order: Order, made: Made) -> None:
        answer, files = made
        for path, content in files.items():
            write_bytes(order.out / path, content, order.out)
        shares = (None, None) if answer is None else (answer.patched, answer.bare)
        done[name] = ClassPatch(order.out.name, order.label, *shares)
        told = f"{shares[0]} of held-out images with it, {shares[1]} without" if answer else "finished before"
        notice(f"{name}: {told}")

    # an error in any of torchrun's processes has to stop all of them
    opened = InProcess(raises=True) if is_torchrun else engine.open(gpus=int(network.device != "cpu"))
    with opened as workers:
        units = _list_units(orders, source, network, workspace, workers, is_here=engine.engine == "local")
        ran = run_resumable(f"Training {len(orders)} patches", orders, orders, units, keep, workers, folder)
    # nothing was trained: the first reason is the command's own
    if source.refused and not done:
        raise next(iter(source.refused.values()))
    lost = [(name, str(error)) for name, error in source.refused.items()]
    made = [done[name] for name in orders if name in done]
    return ClassPatches(made, [*source.skipped, *lost, *ran.failed], folder, len(classes))


def _list_orders(
    config: ClassPatchesConfig, patch: PatchConfig, classes: Sequence[int], network: Network, folder: Path,
    restart: bool,
) -> Iterator[Order]:  # fmt: skip
    """Each patch by size and class."""
    for size_px in dict.fromkeys(config.sizes_px):
        check_size(size_px, network.preprocessing.crop_px, "sizes_px")
        sized, out = patch.with_overrides(size_px=size_px), folder / f"{config.set_name}-{size_px}"
        for index in classes:
            yield Order(sized, index, network.labels[index], name_class(network.labels, index), out, restart)


def _list_units(
    orders: Mapping[str, Order], source: "_Source", network: Network, workspace: Workspace, engine: Engine,
    is_here: bool,
) -> Iterator[Unit[Made]]:  # fmt: skip
    """A unit for each patch; its images tell whether it is finished."""
    from toolkit.boosters.booster import read_finished
    from toolkit.boosters.patch import RENDERS, choose_files, hash_patch

    # the network travels once to each worker
    shared, held = engine.share(network), None
    for name, order in orders.items():
        # images of a class that cannot be read cost this class alone
        try:
            data = source.load(order.class_index)
        except ToolkitError as error:
            source.refused[name] = error
            continue
        key = hash_patch(order.config, order.class_index, [network], data, order.name)
        files = choose_files(workspace, order.out, order.name)
        if not order.restart and read_finished(read_patch, files, key):
            # left by a kill after the patch and before its clean-up
            Checkpoint(files.training, key, shared=RENDERS).remove()
            yield Unit((name,), done_unit, ((None, {}),), name)
            continue
        # shared once for all patches of the same images, which are trained in turn
        if held is None or held[0] is not data:
            held = data, engine.share(data)
        yield Unit((name,), train_unit, (shared, held[1], order, workspace, is_here), name)


def train_unit(
    network: Shared[Network], data: Shared[TrainingData], order: Order, workspace: Workspace, is_here: bool
) -> Iterator[Made]:
    """Do the work of a unit: `train_patch`, in the workspace if it `is_here`, else in a temporary folder."""
    from toolkit.boosters.patch import train_patch

    # workers elsewhere do not see the workspace: their files come back as bytes
    with quietly(), nullcontext(order.out) if is_here else TemporaryDirectory() as folder:
        trained = train_patch(
            order.config, order.class_index, [network.get()], data.get(), workspace,
            name=order.name, out=Path(folder), restart=order.restart,
        )  # fmt: skip
        made = trained.files
        written = () if is_here else (made.preview, made.png, made.png.with_suffix(".json"))
        files = {str(file.relative_to(folder)): file.read_bytes() for file in written}
    yield next(iter(trained.validations), None), files


class _Source:
    """Training images of each class, (path, reason) of unusable images, and errors of patches without images."""

    def __init__(self, images: ImageSet, config: ClassPatchesConfig, how: Preprocessing) -> None:
        self._images, self._config, self._how = images, config, how
        self.skipped = list(images.refused)
        self.refused: dict[str, ToolkitError] = {}
        # memory holds the images of a class at a time, or those of all classes once
        self._load = lru_cache(maxsize=1)(self._decode)

    def load(self, class_index: int) -> TrainingData:
        """Those of the class, or of all classes."""
        # images of the class alone, if there are enough of them
        count = sum(image.class_index == class_index for image in self._images.images)
        wanted = self._config.backgrounds
        own = wanted == "class" or (wanted == "auto" and count >= FEW_IMAGES)
        if own and not count:
            expected = f"class {class_index} has no images in {self._images.name}"
            raise FieldError(expected, {"backgrounds": wanted})
        return self._load(class_index if own else None)

    def _decode(self, class_index: int | None) -> TrainingData:
        found = [image for image in self._images.images if class_index in (None, image.class_index)]
        # whole squares at `resize_px`, so that training can cut at random
        square = replace(self._how, crop_px=self._how.resize_px)
        pixels: list[np.ndarray] = []
        hashes: list[str] = []
        skipped: list[tuple[str, str]] = []
        # in random order, until enough images could be read
        for k in Draws(self._config.seed, 0, "data").of("files").permutation(len(found)):
            if len(pixels) == self._config.images:
                break
            try:
                pixels.append(self._images.load(found[k], square))
                hashes.append(self._images.hash_image(found[k].id))
            except UnreadableImage as error:
                skipped.append((found[k].id, error.reason))
        self.skipped += [line for line in skipped if line not in self.skipped]
        if not pixels:
            path, reason = skipped[-1]
            raise ToolkitError(f"{self._images.name}: none of its {len(found)} images can be read; {path}: {reason}")
        use = "class" if class_index is not None else "backgrounds"
        # the record says what the images stood for
        record = {"source": self._images.name, "use": use, "found": len(found), "used": len(pixels)}
        loaded = Loaded(np.stack(pixels), tuple(skipped), record, tuple(hashes))
        return divide_images([loaded], self._config.data())
