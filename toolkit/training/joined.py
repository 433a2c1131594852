"""Files of classifiers that are joined of an encoder and a head."""

from pathlib import Path
from typing import Any

from toolkit.core.errors import FieldError
from toolkit.models.find import BUNDLED, SUFFIX
from toolkit.models.heads import file_suffix
from toolkit.models.labels import DESCRIPTIONS
from toolkit.models.network import Classifier
from toolkit.models.weights import SUFFIXES


def choose_file(folder: Path, name: str, encoder: Classifier) -> Path:
    """The file that a joined classifier of this name is written to.

    Raises:
        ToolkitError: another network has the name, or a file that describes one.
    """
    # any other file of this name would be taken for the same network
    file = folder / f"{name}{file_suffix(encoder)}"
    own = {file.suffix, ".json"} if file.is_file() else {file.suffix}
    others = {*SUFFIXES, SUFFIX, ".onnx", ".pt2", *DESCRIPTIONS} - own
    taken = next((path for suffix in sorted(others) if (path := file.with_suffix(suffix)).is_file()), None)
    if taken is not None:
        raise FieldError(f"{taken} is there already: choose another {{name}}, or move it away", {"name": name})
    if name == BUNDLED:
        raise FieldError("is the name of the bundled classifier: choose another", {"name": name})
    return file


def name_encoder(encoder: Classifier) -> dict[str, Any]:
    """The fields of a record that decide an encoder's features."""
    return {
        "encoder": encoder.arch, "encoder_weights": encoder.weights.name, "encoder_sha256": encoder.weights.sha256,
        "encoder_preprocessing": encoder.preprocessing.describe(),
    }  # fmt: skip
