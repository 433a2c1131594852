"""Make the patch sets of a baseline, class by class: what is finished is kept, what is missing is made."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from toolkit import __version__
from toolkit.boosters.baselines.baseline_config import (
    APRILTAG,
    BEST_IMAGE,
    FIXED_PATTERN,
    QR,
    BaselineConfig,
)
from toolkit.boosters.baselines.drawn import (
    PAPER_BORDER,
    AprilTags,
    Baseline,
    Choice,
    FixedPatterns,
    QrCodes,
)
from toolkit.boosters.baselines.photos import BestImages, RandomImages
from toolkit.boosters.patch_sets import name_class
from toolkit.core.console import Ticker, progress
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import read_json, sha256_bytes
from toolkit.core.workspace import Workspace
from toolkit.models.network import Classifier
from toolkit.objects.records import NetworkRecord, PatchRecord, read_patch, write_patch
from toolkit.training.images import ImageSet, choose_classes, open_images

METHOD_VERSION = 1
"""Raised when the same inputs give another picture."""


@dataclass(frozen=True)
class MadeSet:
    """One patch set.

    Attributes:
        name: of the set.
        folder: where it lies.
        size_px: side of its pictures.
        made: pictures that this run wrote.
        found: pictures that were there, made from the same inputs.
    """

    name: str
    folder: Path
    size_px: int
    made: int
    found: int


@dataclass(frozen=True)
class MadeBaseline:
    """What a run made, and (path, reason) of what could not be used: images, and classes without one that can."""

    sets: tuple[MadeSet, ...]
    skipped: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class _Place:
    size_px: int
    folder: Path
    name: str


def prepare_baseline(config: BaselineConfig, images: ImageSet | None, classifier: Classifier) -> Baseline:
    """What makes the pictures."""
    classes, border = len(classifier.labels), PAPER_BORDER if config.border is None else config.border
    if config.kind == QR:
        return QrCodes(classes, border)
    if config.kind == APRILTAG:
        return AprilTags(classes, border)
    if config.kind == FIXED_PATTERN:
        return FixedPatterns(config.seed)
    assert images is not None, "checked when the request was made"
    if config.kind == BEST_IMAGE:
        return BestImages(images, classifier)
    return RandomImages(images, classifier, config.seed)


def make_baseline(config: BaselineConfig, classifier: Classifier, workspace: Workspace) -> MadeBaseline:
    """Write `print/patches/NAME-SIZE/` for each size; a class's pictures are whole or absent.

    Args:
        config: what to make.
        classifier: whose classes they are, and whose losses `best-image` compares.
        workspace: where the sets go.

    Raises:
        ToolkitError: an unknown class or one without images, a size that does not suit, a set that is there and was
            made another way, or the disk is full.
    """
    images = None if config.data is None else open_images(config.data, classifier, split="train")
    if images is None:
        named = config.class_names or range(len(classifier.labels))
        classes = sorted({classifier.class_index(name) for name in named})
    else:
        images = choose_classes(images, config.class_names, classifier)
        classes = images.classes
    baseline = prepare_baseline(config, images, classifier)
    places = [_choose_place(config, baseline, classifier, workspace, size) for size in dict.fromkeys(config.sizes_px)]
    for place in places:
        _check_same_way(place, baseline)

    title = f"Making {config.set_name or config.kind}"
    with progress(title, sum(map(baseline.count_work, classes))) as bar:
        made, skipped = _make_pictures(baseline, classifier.labels, classes, places, bar)
    sets = (
        MadeSet(place.name, place.folder, place.size_px, made.count((place, True)), made.count((place, False)))
        for place in places
    )
    return MadeBaseline(tuple(sets), (*(() if images is None else images.refused), *skipped))


def _make_pictures(
    baseline: Baseline, labels: list[str], classes: list[int], places: list[_Place], bar: Ticker
) -> tuple[list[tuple[_Place, bool]], list[tuple[str, str]]]:
    """(place, whether this run wrote it) of each picture that is there in the end, and what could not be used."""
    made: list[tuple[_Place, bool]] = []
    skipped: list[tuple[str, str]] = []
    for index in classes:
        name, key = name_class(labels, index), _hash_inputs(baseline, labels[index], index)
        # all sizes of a class together: choosing is the work, drawing another size is not
        finished = {place: _find_finished(place, name, key, baseline) for place in places}
        records = [record for record in finished.values() if record is not None]
        made += [(place, False) for place, record in finished.items() if record is not None]
        # nothing is chosen anew; what a run before passed over is still said
        if len(records) == len(places):
            skipped += [(one["path"], one["reason"]) for one in records[0].data.get("passed_over", [])]
            bar.advance(baseline.count_work(index))
            continue
        choice = baseline.choose(index, bar.advance)
        skipped += choice.passed_over
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
) -> _Place:
    least, most = baseline.least_px, classifier.preprocessing.crop_px
    why = f" ({baseline.least_because})" if baseline.least_because else ""
    if least > most:
        raise ToolkitError(f"images of {most} px, which {classifier.name} sees, are too small: at least {least}{why}")
    if not least <= size_px <= most:
        raise FieldError(
            f"expected {least}{why} to {most} px, the side of the network's image in pixels", {"sizes_px": size_px}
        )
    name = config.name_set(size_px)
    return _Place(size_px, replace(workspace, patch_set=name).patches_dir, name)


def _check_same_way(place: _Place, baseline: Baseline) -> None:
    """A set that holds pictures of another kind, or of another seed, is neither overwritten nor mixed."""
    for file in sorted(place.folder.glob("*.json")):
        try:
            record = read_json(file, PatchRecord)
        except ToolkitError:
            continue  # it is written anew, or the set's reader names it
        # what is the picture's own is left out: the rest is what a set has in common
        settings = {key: value for key, value in record.settings.items() if key not in ("code", "inputs_sha256")}
        there = settings | {"seed": record.seed, "network": _name_weights(record.networks)}
        wanted = _describe_way(baseline)
        # the method first: where it differs, what else does follows from it
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


def _hash_inputs(baseline: Baseline, label: str, index: int) -> str:
    inputs = [METHOD_VERSION, _describe_way(baseline), label, index, baseline.list_inputs(index)]
    return sha256_bytes(json.dumps(inputs, sort_keys=True).encode())


def _find_finished(place: _Place, name: str, key: str, baseline: Baseline) -> PatchRecord | None:
    file = place.folder / f"{name}.png"
    if not file.is_file():
        return None
    try:
        record = read_patch(file).record
    except ToolkitError:
        return None  # a kill between picture and record leaves a pair that does not match; it is written again
    return record if record.settings.get("inputs_sha256") == key and baseline.is_current(record) else None


def _write(place: _Place, name: str, key: str, baseline: Baseline, choice: Choice, label: str, index: int) -> None:
    assert choice.draw is not None, "asked before"
    code = {} if choice.code is None else {"code": choice.code(place.size_px)}
    write_patch(
        place.folder,
        choice.draw(place.size_px),
        {
            "name": name,
            "class_name": label,
            "class_index": index,
            "networks": baseline.networks,
            "data": choice.data,
            "seed": baseline.seed,
            "settings": {"method": baseline.method, **baseline.settings, **code, "inputs_sha256": key},
            "final": choice.final,
            "toolkit_version": __version__,
        },
    )
