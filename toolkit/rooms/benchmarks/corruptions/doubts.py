"""Doubts about a benchmark's result: copies, misnamed folders, images used in training."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from toolkit.boosters.data import HASH_DIGITS, IMAGE_HASHES
from toolkit.rooms.benchmarks.corruptions.cells import Shard, Variant
from toolkit.rooms.benchmarks.patch_sets import PatchSet
from toolkit.training.images import ImageSet

SURPRISING = 0.001
"""Probability below which it is no chance that no image of a class is recognised."""


def list_doubts(images: ImageSet, shards: Sequence[Shard], variants: Sequence[Variant]) -> Iterator[str]:
    """A sentence on each copy, and on each set of patches that was trained on these images, by their hashes."""
    hashes = {image.id: sha256 for shard in shards for image, sha256 in zip(shard.images, shard.hashes, strict=True)}
    labels = variants[0].classifier.labels
    counts = Counter(image.class_index for image in images.images)
    (most, n_most), (fewest, n_fewest) = counts.most_common()[0], counts.most_common()[-1]
    if n_fewest < n_most:
        unequal = f"{labels[fewest]} {n_fewest}, {labels[most]} {n_most}"
        yield f"classes have unequal numbers of images ({unequal}): larger classes count more in all shares and tests"
    yield from _find_copies({image.id: image.class_index for image in images.images}, hashes, labels)
    for name, patches in {variant.name: variant.patches for variant in variants if variant.patches is not None}.items():
        yield from _find_trained(name, patches, images.name, set(hashes.values()))


def _find_copies(class_of: Mapping[str, int], hashes: Mapping[str, str], labels: Sequence[str]) -> Iterator[str]:
    # copies within a class count twice, copies in two classes are wrong in either
    same: dict[str, list[str]] = {}
    for id, sha256 in hashes.items():
        same.setdefault(sha256, []).append(id)
    copies = [ids for ids in same.values() if len(ids) > 1]
    crossed = [ids for ids in copies if len({class_of[id] for id in ids}) > 1]
    alike = [ids for ids in copies if ids not in crossed]
    if crossed:
        # the first of another class than the first image
        first = crossed[0][0]
        other = next(id for id in crossed[0] if class_of[id] != class_of[first])
        yield (
            f"{sum(map(len, crossed))} images are in folders of two classes, such as {first} and {other}: they cannot "
            f"be both '{labels[class_of[first]]}' and '{labels[class_of[other]]}'"
        )
    if alike:
        extra = sum(len(ids) - 1 for ids in alike)
        yield f"{extra} images are copies of others, such as {alike[0][1]} of {alike[0][0]}: each copy counts"


def find_misnamed(is_right: np.ndarray, classes: np.ndarray, labels: Mapping[int, str]) -> Iterator[str]:
    """A sentence on each class without recognised images, though images of the others mostly are.

    `is_right` (n,) bool is of clean images without patches, `classes` (n,) int their class indices.
    """
    for index, label in labels.items():
        own = classes == index
        share = float(is_right[~own].mean()) if not own.all() else 0.0
        if not is_right[own].any() and (1 - share) ** int(own.sum()) < SURPRISING:
            yield (
                f"none of the {int(own.sum())} images of '{label}' is recognised without a corruption, but "
                f"{np.round(100 * share):.0f} % of the others: does its folder have the class's name?"
            )


def _find_trained(name: str, patches: PatchSet, data: str, hashes: set[str]) -> Iterator[str]:
    """Whether the patches of a set were trained on images of this data."""
    # hashes are recorded by their first digits
    short, trained, is_alike = {sha256[:HASH_DIGITS]: sha256 for sha256 in hashes}, set[str](), False
    for patch in patches.patches.values():
        about = patch.record.data
        # hashes of the training images are proof; without them a folder of the same name is a hint
        listed, sources = str(about.get(IMAGE_HASHES, "")).split(), about.get("sources")
        trained |= {short[digits] for digits in listed if digits in short}
        known = sources if isinstance(sources, list) else []
        names = [source.get("source") for source in known if isinstance(source, dict)]
        is_alike |= not listed and data in names
    if trained:
        yield f"{name} was trained on {len(trained)} of these {len(hashes)} images: accuracy on new images may be lower"
    elif is_alike:
        same = f"{name} was trained on images of a folder that is called {data} as well"
        yield f"{same}: if these are the same images, accuracy on new images may be lower"
