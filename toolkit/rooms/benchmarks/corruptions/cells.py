"""Variants, and cells of the grid: a shard's images in a variant, corrupted and ranked, keyed by their inputs."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field

from toolkit.boosters.apply import boost_images
from toolkit.captures.capture import UNPATCHED
from toolkit.core.draws import image_seed
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.threads import map_ahead
from toolkit.core.work import Work
from toolkit.core.workspace import Workspace
from toolkit.corruptions.batch import corrupt
from toolkit.corruptions.catalogue import CORRUPTIONS, choose_parameters
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.imaging.read import UnreadableImage
from toolkit.models.network import Classifier
from toolkit.models.predict import ask_in_parts
from toolkit.rooms.benchmarks.corruptions import NOT_CORRUPTED, Condition, CorruptEvalConfig
from toolkit.rooms.benchmarks.corruptions.recognisers import (
    Reader,
    Recogniser,
    find_readers,
    recognise_by_network,
    recognise_by_reader,
)
from toolkit.rooms.benchmarks.patch_sets import PatchSet, read_patch_set
from toolkit.training.images import ImageSet, LabelledImage

CELLS = Work("cell", 2, old_at=0)
"""In the first version, the last digits of an answer could depend on the size of its shard."""
FAILED = -1
"""The rank of an image that could not be used."""


@dataclass(frozen=True)
class Variant:
    """Images without patches (`unpatched`), or with those of a set.

    Attributes:
        patches: None for `unpatched`.
        classifier: that answers, and gives the preprocessing.
        readers: that answer as well, if the patches are codes.
    """

    name: str
    patches: PatchSet | None
    classifier: Classifier
    readers: tuple[Reader, ...] = ()

    @property
    def recognisers(self) -> tuple[Recogniser, ...]:
        """The network, then the readers."""
        return (recognise_by_network(self.classifier), *map(recognise_by_reader, self.readers))


def open_variants(
    workspace: Workspace, words: Sequence[str], classifier: Classifier, load: Callable[[str], Classifier]
) -> tuple[list[Variant], list[str]]:
    """Open `unpatched`, once for each network, and the variants that `SET` or `SET@MODEL` name.

    Args:
        workspace: whose `print/patches` holds the sets.
        words: `SET` or `SET@MODEL`.
        classifier: answers for `SET`.
        load: returns the classifier of a name.

    Returns:
        The variants, and notes on readers that are not installed.

    Raises:
        ToolkitError: an unknown set or model, a set of other classes, a patch that is larger than the network's image,
            or networks that do not share their labels.
    """
    # by the word after `@`: each network is loaded once, however many sets it answers
    networks: dict[str, Classifier] = {"": classifier}
    boosted: list[Variant] = []
    notes: list[str] = []
    # each patch set, with the network that is named after its `@`
    for word in dict.fromkeys(words):
        name, _, model = word.partition("@")
        network = networks[model] = networks.get(model) or load(model)
        if network.labels != classifier.labels:
            others = f"{network.name} answers with other classes than {classifier.name}"
            raise FieldError(f"{others}: evaluate it in a separate run, with {{model}} {model}", {"patches": word})
        patches = read_patch_set(workspace, name, network.labels)
        crop_px = network.preprocessing.crop_px
        if patches.n_px > crop_px:
            larger = f"its patches of {patches.n_px} px are larger than the {crop_px} px that {network.name} sees"
            raise FieldError(f"{larger}: make smaller patches", {"patches": name})
        # codes are decoded beside the network's answers, if a decoder is installed
        readers, missing = list[Reader](), list[tuple[str, str]]()
        if patches.code_kind is not None:
            # all codes of a set have the same kind, so the first decides
            code = next(iter(patches.patches.values())).record.settings["code"]
            readers, missing = find_readers(code["kind"], code.get("dictionary", ""))
        notes += [f"{name} is not read by {reader}: {reason}" for reader, reason in missing]
        boosted.append(Variant(name, patches, network, tuple(readers)))
    distinct = {(network.name, network.weights.sha256): network for network in networks.values()}
    names = [name for name, _ in distinct]
    for name in names:
        # results are kept by the network's name
        if names.count(name) > 1:
            raise ToolkitError(f"two networks of this run are called '{name}': evaluate them in separate runs")
    # every network needs its own baseline without patches, and needs it once
    variants = [Variant(UNPATCHED, None, classifier)]
    for variant in boosted:
        if all(known.classifier.name != variant.classifier.name for known in variants):
            variants.append(Variant(UNPATCHED, None, variant.classifier))
        variants.append(variant)
    return variants, list(dict.fromkeys(notes))


def share_classes(variants: Sequence[Variant], available: Sequence[int]) -> list[int]:
    """Return the classes with images and a picture in every set, so that all variants have the same images.

    Raises:
        ToolkitError: there are none.
    """
    shared = set(available)
    for variant in variants:
        if variant.patches is not None:
            shared &= set(variant.patches.patches)
            if not shared:
                raise ToolkitError(
                    f"set '{variant.name}' has no picture for the classes of the images and the other sets: make "
                    "pictures for them, or evaluate the sets in separate runs"
                )
    return sorted(shared)


class CellLine(BaseModel):
    """Line of `cells.jsonl`: the ranks of a shard's images in a cell."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    key: str = Field(pattern=r"^[0-9a-f]{64}$")
    ranks: list[int]


@dataclass(frozen=True)
class Shard:
    """Images that are in memory together, and the hashes of their files."""

    images: tuple[LabelledImage, ...]
    hashes: tuple[str, ...]


def cut_shards(images: ImageSet, size: int) -> Iterable[Shard]:
    """The images in parts of `size`; files are read once for their hashes."""
    for start in range(0, len(images.images), size):
        part = images.images[start : start + size]
        yield Shard(part, tuple(images.hash_image(image.id) for image in part))


def name_cell(
    shard: Shard, variant: Variant, recogniser: Recogniser, condition: Condition, config: CorruptEvalConfig
) -> str:
    """Key of the ranks of a shard's images in a cell."""
    how = variant.classifier.preprocessing
    patches = variant.patches
    # by the pictures' hashes: a set that is trained again has other cells
    pictures = patches and [patches.patches[image.class_index].record.png_sha256 for image in shard.images]
    given = None
    if condition != NOT_CORRUPTED:
        corruption, severity = condition
        chosen = choose_parameters(how.crop_px, how.crop_px)
        # the parameters as well: other numbers are another cell
        given = [corruption, severity, CORRUPTIONS[corruption].parameters[chosen][severity - 1]]
    # images without patches and corruptions have no random draws: their answers serve every seed
    return CELLS.key(
        [[image.id, image.class_index] for image in shard.images], shard.hashes, how.describe(), pictures,
        None if patches is None else config.placement.model_dump(), None if patches is given is None else config.seed,
        given, recogniser.identity,
    )  # fmt: skip


@dataclass(frozen=True)
class ShardImages:
    """The usable images of a shard, in a variant.

    Attributes:
        pixels: (k, 3, m, m) uint8 sRGB, on the CPU.
        classes: (k,) int64.
        seeds: of each image's random draws.
        texts: of their codes; empty without codes.
        usable: (n,) bool, which of the shard's images these are.
    """

    pixels: torch.Tensor
    classes: np.ndarray
    seeds: list[int]
    ids: list[str]
    texts: list[str]
    usable: np.ndarray


def load_shard(images: ImageSet, shard: Shard, how: Preprocessing) -> tuple[np.ndarray, np.ndarray]:
    """Decode a shard on several threads: (k, m, m, 3) uint8 sRGB of usable images, and (n,) bool which those are."""

    def load(image: LabelledImage) -> np.ndarray | None:
        try:
            return images.load(image, how)
        except UnreadableImage:
            return None

    loaded = list(map_ahead(load, shard.images))
    usable = np.array([pixels is not None for pixels in loaded])
    empty = np.zeros((0, how.crop_px, how.crop_px, 3), np.uint8)
    return (np.stack([pixels for pixels in loaded if pixels is not None]) if usable.any() else empty), usable


def apply_variant(
    pixels: np.ndarray, shard: Shard, usable: np.ndarray, variant: Variant, config: CorruptEvalConfig
) -> ShardImages:
    """Put each image's patch on `pixels` of `load_shard`, rounded to 8 bits, as in a file."""
    # unreadable images are left out of all variants alike
    used = [image for image, is_usable in zip(shard.images, usable, strict=True) if is_usable]
    ids = [image.id for image in used]
    # by the seed and the image's name alone, so that all variants have the same places
    seeds = [image_seed(config.seed, id) for id in ids]
    classes = np.array([image.class_index for image in used], np.int64)
    bare = torch.from_numpy(np.ascontiguousarray(pixels.transpose(0, 3, 1, 2)))
    patches = variant.patches
    if patches is None:
        return ShardImages(bare, classes, seeds, ids, [], usable)

    def place(part: list[int]) -> torch.Tensor:
        pictures = torch.from_numpy(patches.stack(classes[part]))
        with torch.inference_mode():
            images = bare[part].float().div_(255)
            # rounded, as in a file: the corruption begins from 8 bits
            return _round(boost_images(images, pictures, config.placement, [seeds[k] for k in part])).byte()

    boosted = torch.cat([bare[:0], *ask_in_parts(place, len(used), "cpu")])
    texts = [] if patches.code_kind is None else [patches.code_text(int(index)) for index in classes]
    return ShardImages(boosted, classes, seeds, ids, texts, usable)


def corrupt_images(images: ShardImages, part: Sequence[int], condition: Condition, device: str = "cpu") -> torch.Tensor:
    """(k, 3, m, m) float sRGB-encoded pixels of some of the images, corrupted and rounded to 8 bits."""
    batch = images.pixels[list(part)].to(device).float().div_(255)
    if condition == NOT_CORRUPTED:
        return batch
    return _round(corrupt(batch, *condition, [images.seeds[k] for k in part])).div_(255)


def rank_images(
    images: ShardImages, condition: Condition, recognisers: Sequence[Recogniser], device: str
) -> list[np.ndarray]:
    """Rank all images by each recogniser, (k,) int32, see `Recogniser`; output that is not finite is an error."""

    def work(part: list[int]) -> torch.Tensor:
        texts = [images.texts[k] for k in part] if images.texts else []
        with torch.inference_mode():
            batch = corrupt_images(images, part, condition, device)
            found = [recogniser.rank(batch, images.classes[part], texts) for recogniser in recognisers]
        return torch.from_numpy(np.stack(found, axis=1))

    nothing = torch.zeros(0, len(recognisers), dtype=torch.int32)
    ranks = torch.cat([nothing, *ask_in_parts(work, len(images.ids), device, images.ids)])
    return list(ranks.numpy().T)


def _round(images: torch.Tensor) -> torch.Tensor:
    """Values from 0 to 1 in 8-bit levels, still float."""
    return images.mul(255).round_()
