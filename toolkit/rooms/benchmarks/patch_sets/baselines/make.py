"""Make the patch sets of a baseline, class by class; finished pictures are kept."""

from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from toolkit import __version__
from toolkit.boosters.pixels import record_network
from toolkit.core.console import Ticker, progress
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import read_json
from toolkit.core.threads import map_ahead
from toolkit.core.work import INPUTS, Work, find_made
from toolkit.core.workspace import Workspace
from toolkit.evaluation.summaries import list_reasons
from toolkit.imaging.read import UnreadableImage
from toolkit.models.network import Classifier
from toolkit.models.predict import predict
from toolkit.objects.records import NetworkRecord, PatchRecord, read_patch, write_patch
from toolkit.rooms.benchmarks.patch_sets import name_class
from toolkit.rooms.benchmarks.patch_sets.baselines import APRILTAG, BEST_IMAGE, FIXED_PATTERN, QR, WORD, BaselineConfig
from toolkit.rooms.benchmarks.patch_sets.baselines.drawn import (
    PAPER_BORDER,
    Advance,
    AprilTags,
    Baseline,
    Choice,
    FixedPatterns,
    QrCodes,
    Words,
)
from toolkit.training.images import ImageSet, LabelledImage, choose_classes, open_images

BATCH = 64
Skipped = list[tuple[str, str]]
BASELINES = Work("baseline", 1, old_at=0)


class _Photos(Baseline):
    def __init__(self, images: ImageSet, classifier: Classifier) -> None:
        self.images, self.classifier = images, classifier
        self.networks = []
        self.settings = {"filter": classifier.preprocessing.filter_name.lower()}
        self.by_class: dict[int, list[LabelledImage]] = defaultdict(list)
        for image in images.images:
            self.by_class[image.class_index].append(image)

    def list_inputs(self, index: int) -> list[str]:
        """Names of the images of the class."""
        return [image.id for image in self.by_class[index]]

    def is_current(self, record: PatchRecord) -> bool:
        """Whether the chosen image is unchanged; the others, which may be millions, are not read again."""
        chosen = LabelledImage(str(record.data.get("image")), record.class_index)
        with suppress(OSError):  # an unreadable file is listed when the class is made again
            is_there = chosen in self.by_class[chosen.class_index]
            return is_there and self.images.hash_image(chosen.id) == record.data.get("image_sha256")
        return False

    def _choose(self, image: LabelledImage | None, index: int, skipped: Skipped, **figures: Any) -> Choice:
        if image is None:
            return Choice(None, passed_over=tuple(skipped))
        # source and figures of the choice for the record
        data = {
            "source": self.images.name, "image": image.id, "image_sha256": self.images.hash_image(image.id),
            "found": len(self.by_class[index]), **{key: figures[key] for key in figures if key != "loss"},
            "passed_over": list_reasons(skipped),
        }  # fmt: skip
        final = {"loss": figures["loss"]} if "loss" in figures else {}
        return Choice(partial(self._draw, image), data=data, final=final, passed_over=tuple(skipped))

    def _draw(self, image: LabelledImage, size_px: int) -> np.ndarray:
        picture = Image.fromarray(self.images.read_pixels(image.id, size_px))
        side = min(picture.size)
        left, top = (picture.width - side) / 2, (picture.height - side) / 2
        filter_name = self.classifier.preprocessing.filter_name  # Pillow's are antialiased
        # the middle square
        square = (left, top, left + side, top + side)
        return np.asarray(picture.resize((size_px, size_px), Image.Resampling[filter_name], box=square))


class BestImages(_Photos):
    """The image of each class with the lowest cross-entropy loss, after the classifier's preprocessing."""

    method = "training image with the lowest loss"

    def __init__(self, images: ImageSet, classifier: Classifier) -> None:
        super().__init__(images, classifier)
        self.networks = [record_network(classifier)]

    def count_work(self, index: int) -> int:
        """All images of the class are compared."""
        return len(self.by_class[index])

    def choose(self, index: int, advance: Advance) -> Choice:
        """Return the best image of a class, the first by name of equals; output that is not finite is an error."""
        best, least, compared = None, np.inf, 0
        skipped: Skipped = []
        for images, pixels in self._read(self.by_class[index], skipped, advance):
            losses = measure_losses(self.classifier, pixels, index)
            compared += len(losses)
            # strictly less: of equally good images the first stays
            if losses.min() < least:
                best, least = images[int(losses.argmin())], float(losses.min())
        return self._choose(best, index, skipped, compared=compared, loss=least)

    def _read(
        self, images: list[LabelledImage], skipped: Skipped, advance: Advance
    ) -> Iterator[tuple[list[LabelledImage], np.ndarray]]:
        """Decode batches in threads, so that memory does not grow with the class."""

        def load(image: LabelledImage) -> np.ndarray | str:
            try:
                return self.images.load(image, self.classifier.preprocessing)
            except UnreadableImage as error:
                return error.reason

        loaded = zip(images, map_ahead(load, images), strict=True)
        # memory holds a batch, whatever the number of images
        while part := list(islice(loaded, BATCH)):
            skipped += [(image.id, what) for image, what in part if isinstance(what, str)]
            usable = [(image, pixels) for image, pixels in part if not isinstance(pixels, str)]
            if usable:
                yield [image for image, _ in usable], np.stack([pixels for _, pixels in usable])
            advance(len(part))


class RandomImages(_Photos):
    """A random image of each class, drawn by seed and class; unreadable images are replaced."""

    method = "random training image"

    def __init__(self, images: ImageSet, classifier: Classifier, seed: int) -> None:
        super().__init__(images, classifier)
        self.seed = seed

    def choose(self, index: int, advance: Advance) -> Choice:
        """Return an image of a class."""
        images, skipped = self.by_class[index], Skipped()
        chosen = None
        # an order of all, so that the next image takes the place of an unreadable image
        for k in Draws(self.seed, index, "random image").of("order").permutation(len(images)):
            try:
                self.images.load(images[k], self.classifier.preprocessing)
            except UnreadableImage as error:
                skipped.append((images[k].id, error.reason))
                continue
            chosen = images[k]
            break
        advance(1)
        return self._choose(chosen, index, skipped)


def measure_losses(classifier: Classifier, pixels: np.ndarray, index: int) -> np.ndarray:
    """(b,) float64 cross-entropy of images (b, crop, crop, 3) uint8 sRGB with class `index`, natural logarithm.

    Raises:
        ToolkitError: the network's output is not finite.
    """
    # double precision: the best of many images may differ from the next by little
    losses = -predict(list(pixels), classifier).log_softmax(dim=1)[:, index].numpy()
    if not np.isfinite(losses).all():
        raise ToolkitError(f"{classifier.weights.name}: the network gives class {index} no probability at all")
    return losses


@dataclass(frozen=True)
class MadeSet:
    """A patch set with numbers of new pictures, and of pictures found from the same inputs."""

    name: str
    folder: Path
    size_px: int
    made: int = 0
    found: int = 0


@dataclass(frozen=True)
class MadeBaseline:
    """Sets of a run, and (path, reason) of unusable images, and of classes without usable images."""

    sets: tuple[MadeSet, ...]
    skipped: tuple[tuple[str, str], ...]

    def as_json(self) -> dict[str, Any]:
        """All of it for a script."""
        sets = [asdict(patch_set) | {"folder": str(patch_set.folder)} for patch_set in self.sets]
        return {"sets": sets, "skipped": list_reasons(self.skipped)}

    def lines(self) -> Iterator[str]:
        """A line for each set."""
        for made in self.sets:
            if made.made:
                pictures = f"{made.made} {'picture' if made.made == 1 else 'pictures'} of {made.size_px} px"
                yield f"{made.folder}: {pictures}{f', {made.found} made before' if made.found else ''}"
            elif made.found:
                yield f"{made.folder}: its {made.found} pictures were made from these inputs before: nothing to do"
            else:
                yield f"{made.folder}: nothing made"


def prepare_baseline(config: BaselineConfig, images: ImageSet | None, classifier: Classifier) -> Baseline:
    """Return the baseline of a kind."""
    classes, border = len(classifier.labels), PAPER_BORDER if config.border is None else config.border
    if config.kind == QR:
        return QrCodes(classes, border)
    if config.kind == APRILTAG:
        return AprilTags(classes, border)
    if config.kind == WORD:
        return Words(classifier.labels)
    if config.kind == FIXED_PATTERN:
        return FixedPatterns(config.seed)
    assert images is not None, "checked when the request was made"
    if config.kind == BEST_IMAGE:
        return BestImages(images, classifier)
    return RandomImages(images, classifier, config.seed)


def make_baseline(config: BaselineConfig, classifier: Classifier, workspace: Workspace) -> MadeBaseline:
    """Write `print/patches/NAME-SIZE/` for each size; a class's pictures are whole or absent.

    The classes, and the losses of `best-image`, are those of the classifier.

    Raises:
        ToolkitError: an unknown class or a class without images, an unsuitable size, a set that was made in another
            way, or the disk is full.
    """
    # the classes, by the data or by name
    images = None if config.data is None else open_images(config.data, classifier, split="train")
    if images is None:
        named = config.class_names or range(len(classifier.labels))
        classes = sorted({classifier.class_index(name) for name in named})
    else:
        images = choose_classes(images, config.class_names, classifier)
        classes = images.classes
    baseline = prepare_baseline(config, images, classifier)
    # a folder for each size; a folder made in another way is refused, never mixed
    places = [_choose_place(config, baseline, classifier, workspace, size) for size in dict.fromkeys(config.sizes_px)]
    for place in places:
        _check_same_way(place, baseline)

    title = f"Making {config.set_name or config.kind}"
    with progress(title, sum(map(baseline.count_work, classes))) as bar:
        made, skipped = _make_pictures(baseline, classifier.labels, classes, places, bar)
    sets = (replace(place, made=made.count((place, True)), found=made.count((place, False))) for place in places)
    return MadeBaseline(tuple(sets), (*(() if images is None else images.refused), *skipped))


def _make_pictures(
    baseline: Baseline, labels: list[str], classes: list[int], places: list[MadeSet], bar: Ticker
) -> tuple[list[tuple[MadeSet, bool]], list[tuple[str, str]]]:
    """(place, whether this run wrote it) of each finished picture, and (path, reason) of failures."""
    made: list[tuple[MadeSet, bool]] = []
    skipped: list[tuple[str, str]] = []
    for index in classes:
        name, inputs = name_class(labels, index), baseline.list_inputs(index)
        # a key for each class: another way to draw makes other pictures
        key = BASELINES.key(_describe_way(baseline), labels[index], index, inputs)
        # all sizes of a class together: choosing is the work, drawing another size is not
        finished = {place: _find_finished(place, name, key, baseline) for place in places}
        records = [record for record in finished.values() if record is not None]
        made += [(place, False) for place, record in finished.items() if record is not None]
        # finished: images that an earlier run passed over are reported again
        if len(records) == len(places):
            skipped += [(skip["path"], skip["reason"]) for skip in records[0].data.get("passed_over", [])]
            bar.advance(baseline.count_work(index))
            continue
        choice = baseline.choose(index, bar.advance)
        skipped += choice.passed_over
        # a class without a readable image is reported, the others go on
        if choice.draw is None:
            skipped.append((f"class '{labels[index]}'", "none of its images can be read"))
            continue
        for place, record in finished.items():
            if record is None:
                _write(place, name, key, baseline, choice, labels[index], index)
                made.append((place, True))
    return made, skipped


def _choose_place(
    config: BaselineConfig, baseline: Baseline, classifier: Classifier, workspace: Workspace, size_px: int
) -> MadeSet:
    least, most = baseline.least_px, classifier.preprocessing.crop_px
    why = f" ({baseline.least_because})" if baseline.least_because else ""
    if least > most:
        raise ToolkitError(f"images of {most} px, which {classifier.name} sees, are too small: at least {least}{why}")
    if not least <= size_px <= most:
        raise FieldError(
            f"expected {least}{why} to {most} px, the side of the network's image in pixels", {"sizes_px": size_px}
        )
    name = config.name_set(size_px)
    return MadeSet(name, replace(workspace, patch_set=name).patches_dir, size_px)


def _check_same_way(place: MadeSet, baseline: Baseline) -> None:
    """Refuse to overwrite or mix a set with pictures of another kind or seed."""
    for file in sorted(place.folder.glob("*.json")):
        try:
            record = read_json(file, PatchRecord)
        except ToolkitError:
            continue  # it is written again, or the set's reader names it
        # without the settings of a single picture
        settings = {key: value for key, value in record.settings.items() if key not in ("code", INPUTS)}
        there = settings | {"seed": record.seed, "network": _name_weights(record.networks)}
        wanted = _describe_way(baseline)
        # the method first, as other differences follow from it
        for key in sorted(there | wanted, key=lambda key: key != "method"):
            if there.get(key) != wanted.get(key):
                raise FieldError(
                    f"{place.folder} holds pictures made with {key} {there.get(key)!r}, not {wanted.get(key)!r}: name "
                    "another set with {set_name}, or remove that folder",
                    {},
                )


def _describe_way(baseline: Baseline) -> dict[str, Any]:
    return {
        "method": baseline.method, **baseline.settings, "seed": baseline.seed,
        "network": _name_weights(baseline.networks),
    }  # fmt: skip


def _name_weights(networks: list[NetworkRecord]) -> str:
    return " ".join(f"{network.arch} {network.sha256[:12]}" for network in networks)


def _find_finished(place: MadeSet, name: str, key: str, baseline: Baseline) -> PatchRecord | None:
    file = place.folder / f"{name}.png"
    record = find_made(key, lambda: read_patch(file).record, lambda made: made.settings.get(INPUTS), file)
    return record if record is not None and baseline.is_current(record) else None


def _write(place: MadeSet, name: str, key: str, baseline: Baseline, choice: Choice, label: str, index: int) -> None:
    assert choice.draw is not None, "asked before"
    code = {} if choice.code is None else {"code": choice.code(place.size_px)}
    write_patch(place.folder, choice.draw(place.size_px), {
        "name": name, "class_name": label, "class_index": index, "networks": baseline.networks, "data": choice.data,
        "seed": baseline.seed, "settings": {"method": baseline.method, **baseline.settings, **code, INPUTS: key},
        "final": choice.final, "toolkit_version": __version__,
    })  # fmt: skip
