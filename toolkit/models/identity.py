"""The identity of a network in results: its architecture, weights, labels and preprocessing together."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.core.lazy import torch
from toolkit.models.find import BUNDLED_DIR, is_program
from toolkit.models.network import AnyNetwork
from toolkit.models.weights import SUFFIXES, cache_dir, open_weights, read_state_dict, weights_folder

ID_DIGITS = 10
"""Digits of a network's hash: enough for the networks that somebody compares."""
KNOWN_TENSORS: Mapping[str, str] = {
    "a8ac1eaeb4d438c0cd513609d432f2b2415caa7627f9237d48f97b2d9218f798":
        "6d6b0272dc75eb82c249584d29e8824bed0645fb643d5651b33213f6d4851709",
    "ea1a2119f3a6f10272af76fc296a7548de0e2c83fb398fa264c2897b4ab2c592":
        "289df286d298d5f3a13bfd94b81574116aae2c254519f7b4f040fd758e9dc666",
}  # fmt: skip
"""Hash of a file -> its `hash_tensors`: ResNet-18 and MobileNetV2, whose files the shipped boosters name."""


class WeightsId(Protocol):
    """Weights as records name them."""

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
    """SHA-256 of the numbers of a network in single precision, whatever their names and format; None without any."""
    hashes = []
    for value in state.values():
        if not value.is_floating_point():
            continue  # counters and tables of indices: files leave them out
        numbers = value.detach().to("cpu", torch.float32).contiguous()
        hashes.append(f"{tuple(numbers.shape)} {hashlib.sha256(numbers.numpy().tobytes()).hexdigest()}")
    return sha256_bytes("\n".join(sorted(hashes)).encode()) if hashes else None


def hash_network_tensors(network: AnyNetwork) -> str | None:
    """Return `hash_tensors` of a loaded network; None if its numbers are hidden, as in some ONNX graphs."""
    # a wrapper holds the detector
    module = getattr(getattr(network, "detector", network), "module", None)
    # a program is more than its numbers, and two may share them
    return None if module is None or is_program(network.arch) else hash_tensors(module.state_dict())


def is_same_network(
    record: WeightsId, weights_sha256: str, tensors_sha256: str | None, folder: Path | None = None
) -> bool:
    """Whether a record names a network: the same file of weights, or another file with the same numbers.

    Args:
        record: an older record has no hash of the numbers: its file is hashed if it is found.
        weights_sha256: hash of the network's file.
        tensors_sha256: hash of its numbers; None if they are not known.
        folder: searched before the weights' folder and torch's cache.
    """
    if record.sha256 == weights_sha256:
        return True
    if tensors_sha256 is None:
        return False
    return tensors_sha256 == (record.tensors_sha256 or find_file_tensors(record.weights, record.sha256, folder))


@lru_cache(maxsize=256)
def find_file_tensors(name: str, sha256: str, folder: Path | None = None) -> str | None:
    """Return `hash_tensors` of the weights file of that name and hash, if it is known or found."""
    if sha256 in KNOWN_TENSORS:
        return KNOWN_TENSORS[sha256]
    # hashes of published files are known: they need not be there
    if Path(name).name != name or Path(name).suffix not in SUFFIXES:
        return None
    for place in filter(None, (folder, BUNDLED_DIR, weights_folder(), cache_dir())):
        try:
            file = open_weights(place / name) if (place / name).is_file() else None
            if file is not None and file.sha256 == sha256:
                return hash_tensors(read_state_dict(file))
        except ToolkitError:  # another file of that name, or damaged
            continue
    return None


def hash_labels(labels: Sequence[str]) -> str:
    """SHA-256 of the names of all outputs in their order."""
    return sha256_bytes(json.dumps(list(labels), ensure_ascii=False).encode())


def describe_network(network: AnyNetwork) -> dict[str, Any]:
    """Describe a network as `model` of `summary.json`; `network_id` is a hash of all of it."""
    how, side = getattr(network, "preprocessing", None), getattr(network, "image_px", 0)
    if how is not None:
        preprocessing = str(how.describe())
    else:  # a detector fits images to its square, and its family decides the normalisation
        family = getattr(network, "decoder", None)
        preprocessing = f"fitted to {side}×{side} px" if side else "of any size"
        preprocessing += "" if family is None else f", {family.describe()}"
    # a file that was saved again has other bytes, but the same numbers
    tensors, labels = hash_network_tensors(network), hash_labels(network.labels)
    whole = json.dumps([network.arch, tensors or network.weights.sha256, labels, preprocessing])
    return {
        "name": network.name, "arch": network.arch, "weights": network.weights.name, "sha256": network.weights.sha256,
        "tensors_sha256": tensors, "labels_sha256": labels, "preprocessing": preprocessing,
        "network_id": sha256_bytes(whole.encode())[:ID_DIGITS],
    }  # fmt: skip
