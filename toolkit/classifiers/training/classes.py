"""Which classes a network in training tells apart, and which of them each image is of."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from toolkit.classifiers.class_folders import match_classes
from toolkit.classifiers.network import Classifier
from toolkit.classifiers.training.sources import Source
from toolkit.errors import ToolkitError


@dataclass(frozen=True)
class TrainingClasses:
    """The outputs of a network and the data's names for them.

    Attributes:
        labels: one per output.
        index_of: output by the label of an image, its folder's name.
    """

    labels: tuple[str, ...]
    index_of: dict[str, int]

    @property
    def used(self) -> list[int]:
        """Outputs that have images, sorted."""
        return sorted(set(self.index_of.values()))


def list_classes(sources: Sequence[Source]) -> TrainingClasses:
    """The classes of the data, by name.

    Raises:
        ToolkitError: fewer than two.
    """
    labels = tuple(sorted({item.label for source in sources for item in source.train}))
    if len(labels) < 2:
        only = f"found only '{labels[0]}'" if labels else "found none"
        raise ToolkitError(f"a classifier needs at least two classes: {only}: add another --data or class folder")
    return TrainingClasses(labels, {label: index for index, label in enumerate(labels)})


def keep_classes(sources: Sequence[Source], classifier: Classifier) -> TrainingClasses:
    """All classes of a classifier; the data's are found among them by WordNet id or by label.

    Raises:
        ToolkitError: the data has a class that the classifier has not.
    """
    index_of: dict[str, int] = {}
    for source in sources:
        names = sorted({item.label for item in source.train})
        index_of |= match_classes(names, classifier, Path(source.record["source"]), "--init")
    return TrainingClasses(tuple(classifier.labels), index_of)
