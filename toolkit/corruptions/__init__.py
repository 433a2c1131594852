"""The corruptions of ImageNet-C and CIFAR-10-C: batched, on CPU or GPU, seeded per image."""

from toolkit.core.severities import SEVERITIES
from toolkit.corruptions.catalogue import COMMON, CORRUPTIONS, FAMILIES, Corruption
from toolkit.corruptions.corrupt import choose_parameters, corrupt, corrupt_picture, find_corruption
from toolkit.corruptions.draws import image_seed

__all__ = [
    "COMMON",
    "CORRUPTIONS",
    "FAMILIES",
    "SEVERITIES",
    "Corruption",
    "choose_parameters",
    "corrupt",
    "corrupt_picture",
    "find_corruption",
    "image_seed",
]
