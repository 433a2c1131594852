"""The classifier that comes with the kit, for a machine without network and weights."""

from pathlib import Path

from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_json, sha256_file
from toolkit.models.architectures import published_weights
from toolkit.models.find import BUNDLED, BUNDLED_DIR, DEFAULT_ARCH, SUFFIX, ClassifierRecord
from toolkit.models.load import load_classifier
from toolkit.models.network import Classifier
from toolkit.models.weights import download, find_local

PATIENCE_S = 5.0
"""How long the network is waited for where there is something else to go on with."""


def bundled_file() -> Path | None:
    """The weights of `rig18`; None where they are not installed."""
    file = BUNDLED_DIR / f"{BUNDLED}{SUFFIX}"
    return file if file.is_file() else None


def read_bundled() -> ClassifierRecord | None:
    """The record of `rig18`, checked against its weights; None where they are not installed.

    Raises:
        ToolkitError: the record is broken, or is of other weights.
    """
    file = bundled_file()
    if file is None:
        return None
    record = read_json(file.with_suffix(".json"), ClassifierRecord)
    if sha256_file(file) != record.sha256:
        raise ToolkitError(f"{file} does not match its record: it was changed or damaged")
    return record


def load_best(device: str) -> tuple[Classifier, str]:
    """ImageNet's ResNet-18 where it can be had, else the bundled classifier; and why, in a sentence.

    Local weights are looked for first, then torchvision's download is tried, shortly.

    Raises:
        ToolkitError: the weights cannot be had and there is no bundled classifier, or a file is damaged.
    """
    if find_local(DEFAULT_ARCH) is not None:
        return load_classifier(DEFAULT_ARCH, device=device), "its weights are on this machine"
    if bundled_file() is None:
        return load_classifier(DEFAULT_ARCH, device=device), "its weights were downloaded"
    try:
        download(DEFAULT_ARCH, str(published_weights(DEFAULT_ARCH).url), PATIENCE_S)
    except ToolkitError:
        why = f"no weights of {DEFAULT_ARCH} on this machine, and none could be downloaded"
        return load_classifier(BUNDLED, device=device), why
    return load_classifier(DEFAULT_ARCH, device=device), "its weights were downloaded"
