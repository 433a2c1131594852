"""Write a classifier that was joined of an encoder and a head, and its record, as any other of the workspace."""

from pathlib import Path
from typing import Any

from toolkit import __version__
from toolkit.core.errors import FieldError
from toolkit.core.files import sha256_bytes, write_bytes, write_json
from toolkit.models.find import BUNDLED, SUFFIX, ClassifierRecord, HeldOut
from toolkit.models.heads import Head, file_suffix, join_head
from toolkit.models.labels import DESCRIPTIONS
from toolkit.models.network import Classifier
from toolkit.models.weights import SUFFIXES


def choose_file(folder: Path, name: str, encoder: Classifier) -> Path:
    """The file that a joined classifier of this name is written to.

    Raises:
        ToolkitError: another network has the name, or a file that describes one.
    """
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


def write_joined(
    file: Path, encoder: Classifier, head: Head, *, labels: list[str], trained_on: str, data: dict[str, Any], seed: int,
    settings: dict[str, Any], final: dict[str, float], held_out: HeldOut,
) -> ClassifierRecord:  # fmt: skip
    """Write the file with both parts and, last, its record.

    Raises:
        ToolkitError: the encoder cannot be exported, or the file cannot be written.
    """
    content, how = join_head(encoder, head), encoder.preprocessing
    record = ClassifierRecord(
        name=file.stem, arch=file.name, trained_on=trained_on, labels=labels, resize_px=how.resize_px,
        crop_px=how.crop_px, mean=how.mean, std=how.std, filter_name=how.filter_name,
        channels="BGR" if how.channels == "BGR" else None, squash=how.squash or None, data=data, seed=seed,
        settings=settings, final=final, held_out=held_out, sha256=sha256_bytes(content), toolkit_version=__version__,
    )  # fmt: skip
    write_bytes(file, content)
    write_json(file.with_suffix(".json"), record.model_dump(mode="json"))
    return record
