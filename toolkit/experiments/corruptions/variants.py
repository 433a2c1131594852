"""The rows of the benchmark's table: what lies on the images, and who is asked about them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from toolkit.boosters.patch_sets import PatchSet, read_patch_set
from toolkit.captures.read import UNPATCHED
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.experiments.corruptions.recognisers import (
    Reader,
    Recogniser,
    find_readers,
    recognise_by_network,
    recognise_by_reader,
)
from toolkit.models.network import Classifier


@dataclass(frozen=True)
class Variant:
    """One way of showing the images.

    Attributes:
        name: `unpatched`, or that of the patch set.
        patches: None for `unpatched`.
        classifier: whose preprocessing the images get, and who is asked.
        readers: are asked as well, where the patches are codes.
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
    """`unpatched`, once for each network, and the variants that `SET` or `SET@MODEL` name.

    Args:
        workspace: whose `print/patches` holds the sets.
        words: `SET` or `SET@MODEL`.
        classifier: who is asked where no other is named.
        load: the classifier of a name.

    Returns:
        The variants, and notes on readers that are not installed.

    Raises:
        ToolkitError: an unknown set or model, a set of other classes, a patch that is larger than the network's image,
            or networks that do not share their labels.
    """
    networks: dict[str, Classifier] = {"": classifier}
    boosted: list[Variant] = []
    notes: list[str] = []
    for word in dict.fromkeys(words):
        name, _, model = word.partition("@")
        network = networks[model] = networks.get(model) or load(model)
        if network.labels != classifier.labels:
            raise FieldError(
                f"{network.name} answers with other classes than {classifier.name}: evaluate it in a run of its own, "
                f"with {{model}} {model}",
                {"patches": word},
            )
        patches = read_patch_set(workspace, name, network.labels)
        crop_px = network.preprocessing.crop_px
        if patches.n_px > crop_px:
            raise FieldError(
                f"its patches of {patches.n_px} px are larger than the {crop_px} px that {network.name} sees: make "
                "smaller ones",
                {"patches": name},
            )
        readers, missing = _find_readers(patches)
        notes += [f"{name} is not read by {reader}: {reason}" for reader, reason in missing]
        boosted.append(Variant(name, patches, network, tuple(readers)))
    distinct = {(one.name, one.weights.sha256): one for one in networks.values()}
    names = [name for name, _ in distinct]
    for name in names:
        if names.count(name) > 1:
            raise ToolkitError(f"two networks of this run are called '{name}': evaluate them in runs of their own")
    variants = [Variant(UNPATCHED, None, classifier)]
    for variant in boosted:
        if all(one.classifier.name != variant.classifier.name for one in variants):
            variants.append(Variant(UNPATCHED, None, variant.classifier))
        variants.append(variant)
    return variants, list(dict.fromkeys(notes))


def _find_readers(patches: PatchSet) -> tuple[list[Reader], list[tuple[str, str]]]:
    if patches.code_kind is None:
        return [], []
    code = next(iter(patches.patches.values())).record.settings["code"]
    return find_readers(code["kind"], code.get("dictionary", ""))


def share_classes(variants: Sequence[Variant], available: Sequence[int]) -> list[int]:
    """Classes that have images and a picture in every set: all variants are shown the same images.

    Raises:
        ToolkitError: there is none.
    """
    shared = set(available)
    for variant in variants:
        if variant.patches is not None:
            shared &= set(variant.patches.patches)
            if not shared:
                raise ToolkitError(
                    f"set '{variant.name}' has no picture for any class that has images and is in the other sets: make "
                    "one for them, or evaluate the sets in runs of their own"
                )
    return sorted(shared)
