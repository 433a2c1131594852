"""The list that the empty city is measured against."""

import sys
from pathlib import Path

from toolkit.models.architectures import imagenet_labels
from toolkit.models.labels import imagenet_wnids

sys.path.insert(0, str(Path(__file__).parents[3] / "docs" / "scripts"))
from empty_city import URBAN_CLASSES, urban_indices


def test_every_class_is_one_of_imagenets() -> None:
    labels = imagenet_labels()
    assert len(urban_indices(labels)) == len(set(URBAN_CLASSES)) == 73
    assert {labels[index] for index in urban_indices(labels)} == set(URBAN_CLASSES)


def test_the_crane_is_the_machine() -> None:
    machine = imagenet_wnids().index("n03126707")
    assert machine in urban_indices(imagenet_labels())
    assert imagenet_wnids().index("n02012849") not in urban_indices(imagenet_labels())
