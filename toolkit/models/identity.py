"""Which network it is: its architecture, weights, labels and preprocessing, together, as results name them."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.models.find import BUNDLED_DIR, is_program
from toolkit.models.network import AnyNetwork
from toolkit.models.weights import SUFFIXES, cache_dir, open_weights, read_state_dict, weights_folder

if TYPE_CHECKING:
    import torch

ID_DIGITS = 10
"""Digits of a network's hash: enough to tell those apart that somebody compares."""
KNOWN_TENSORS: Mapping[str, str] = {
    "a8ac1eaeb4d438c0cd513609d432f2b2415caa7627f9237d48f97b2d9218f798":
        "6d6b0272dc75eb82c249584d29e8824bed0645fb643d5651b33213f6d4851709",
    "ea1a2119f3a6f10272af76fc296a7548de0e2c83fb398fa264c2897b4ab2c592":
        "289df286d298d5f3a13bfd94b81574116aae2c254519f7b4f040fd758e9dc666",
}  # fmt: skip
"""Hash of a file -> `hash_tensors` of it: ResNet-18 and MobileNetV2, of which shipped boosters name the files alone."""


class WeightsId(Protocol):
    """What records say of weights."""

    @property
    def weights(self) -> str:
        """Name of their file."""

    @property
    def sha256(self) -> str:
        """Hash of their file."""

    @property
    def tensors_sha256(self) -> str | None:
        """See `hash_tensors`."""


def hash_tensors(state: "Mapping[str, torch.Tensor]") -> str | None:
    """SHA-256 of the real numbers of a network, whatever they are called and however they are stored.

    Numbers of half precision count as the single ones that they are read as. None: there are no numbers.
    """
    import torch

    hashes = []
    for value in state.values():
        if not value.is_floating_point():
            continue  # counters and tables of indices: files leave them out
        numbers = value.detach().to("cpu", torch.float32).contiguous()
        hashes.append(f"{tuple(numbers.shape)} {hashlib.sha256(numbers.numpy().tobytes()).hexdigest()}")
    return sha256_bytes("\n".join(sorted(hashes)).encode()) if hashes else None


def hash_network_tensors(network: AnyNetwork) -> str | None:
    """`hash_tensors` of a loaded network; None of one that keeps its numbers to itself, as some ONNX graphs do."""
    # a detector that is trained against lies within
    module = getattr(getattr(network, "detector", network), "module", None)
    # a program is more than its numbers, and two may share them
    return None if module is None or is_program(network.arch) else hash_tensors(module.state_dict())


def is_same_network(
    record: WeightsId, weights_sha256: str, tensors_sha256: str | None, folder: Path | None = None
) -> bool:
    """Whether a record names a network: the same file of weights, or another one with the same numbers.

    Args:
        record: older ones do without the hash of the numbers: it is taken from their file, if that is at hand.
        weights_sha256: of the network's file.
        tensors_sha256: of its numbers; None where they are not known.
        folder: where else to look for files than in the weights' folder and torch's cache.
    """
    if record.sha256 == weights_sha256:
        return True
    if tensors_sha256 is None:
        return False
    return tensors_sha256 == (record.tensors_sha256 or find_file_tensors(record.weights, record.sha256, folder))


@lru_cache(maxsize=256)
def find_file_tensors(name: str, sha256: str, folder: Path | None = None) -> str | None:
    """`hash_tensors` of the weights file of that name and hash, if it is known or at hand."""
    if sha256 in KNOWN_TENSORS:
        return KNOWN_TENSORS[sha256]
    if Path(name).name != name or Path(name).suffix not in SUFFIXES:
        return None
    for place in filter(None, (folder, BUNDLED_DIR, weights_folder(), cache_dir())):
        try:
            file = open_weights(place / name) if (place / name).is_file() else None
            if file is not None and file.sha256 == sha256:
                return hash_tensors(read_state_dict(file))
        except ToolkitError:  # another file of that name, or a damaged one
            continue
    return None


def hash_labels(labels: Sequence[str]) -> str:
    """SHA-256 of the names of all outputs in their order."""
    return sha256_bytes(json.dumps(list(labels), ensure_ascii=False).encode())


def describe_network(network: AnyNetwork) -> dict[str, Any]:
    """A network as `model` of `summary.json` names it.

    `network_id` stands for architecture, numbers, labels and preprocessing together.
    """
    preprocessing = _describe_preprocessing(network)
    tensors, labels = hash_network_tensors(network), hash_labels(network.labels)
    whole = json.dumps([network.arch, tensors or network.weights.sha256, labels, preprocessing])
    return {
        "name": network.name, "arch": network.arch, "weights": network.weights.name, "sha256": network.weights.sha256,
        "tensors_sha256": tensors, "labels_sha256": labels, "preprocessing": preprocessing,
        "network_id": sha256_bytes(whole.encode())[:ID_DIGITS],
    }  # fmt: skip


def _describe_preprocessing(network: AnyNetwork) -> str:
    how = getattr(network, "preprocessing", None)
    if how is not None:
        return str(how.describe())
    # a detector fits images to its square, and its family says how they are normalised
    side, family = getattr(network, "image_px", 0), getattr(network, "decoder", None)
    words = f"fitted to {side}×{side} px" if side else "of any size"
    return words if family is None else f"{words}, {family.describe()}"
