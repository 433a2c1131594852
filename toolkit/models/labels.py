"""What the outputs of a network are called, and which class a folder of images is of."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import read_json
from toolkit.core.workspace import PACKAGE_DATA
from toolkit.imaging.preprocessing import Preprocessing

Pixels = Annotated[int, Field(ge=16, le=4096)]
"""A network sees no less; of more, one image fills hundreds of megabytes."""
Mean = Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]
Deviation = Annotated[float, Field(ge=1e-6, le=1000, allow_inf_nan=False)]


class LabelsFile(BaseModel):
    """`WEIGHTS.json` beside `WEIGHTS.pth`: what a user's own classifier sees and says.

    `toolkit train-classifier` writes all of it, and more (`ClassifierRecord`); one written by hand may hold any part.

    Attributes:
        labels: one name per output, in order.
        resize_px, crop_px, mean, std, filter_name: preprocessing, where it differs from the architecture's published
            one.
        arch: name of the network, see `list_architectures`.
        name: what to call the classifier.
        trained_on: in a few words.
        sha256: of the weights' file.
    """

    model_config = ConfigDict(extra="allow", frozen=True)
    labels: list[str] | None = Field(default=None, min_length=1)
    resize_px: Pixels | None = None
    crop_px: Pixels | None = None
    mean: tuple[Mean, Mean, Mean] | None = None
    std: tuple[Deviation, Deviation, Deviation] | None = None
    filter_name: Literal["NEAREST", "BILINEAR", "BICUBIC", "LANCZOS", "BOX", "HAMMING"] | None = None
    arch: str | None = None
    name: str | None = None
    trained_on: str | None = None
    sha256: str | None = Field(default=None, pattern=r"^[0-9a-f]{64}$")


def adapt_preprocessing(published: Preprocessing, own: LabelsFile) -> Preprocessing:
    """The published preprocessing with what the user's labels file says otherwise.

    Raises:
        ToolkitError: the crop is larger than the resized image.
    """
    fields = {key: getattr(own, key) for key in ("resize_px", "crop_px", "mean", "std", "filter_name")}
    adapted = replace(published, **{key: value for key, value in fields.items() if value is not None})
    if adapted.crop_px > adapted.resize_px:
        raise ToolkitError(f"crop_px {adapted.crop_px} is larger than resize_px {adapted.resize_px}: make it smaller")
    return adapted


def read_labels_file(weights: Path) -> LabelsFile:
    """The JSON file beside the weights, all fields empty where there is none; a wrong field is a `ToolkitError`."""
    file = weights.with_suffix(".json")
    return read_json(file, LabelsFile) if file.is_file() else LabelsFile()


def choose_labels(weights: Path, own: list[str] | None, published: list[str], num_classes: int) -> list[str]:
    """Labels of a network's outputs: the user's file, else ImageNet's for 1000 outputs, else plain numbers.

    Raises:
        ToolkitError: the user's file has another number of labels than the network has outputs.
    """
    if own is not None:
        if len(own) != num_classes:
            raise ToolkitError(
                f"{weights.with_suffix('.json')}: field 'labels': expected {num_classes} names, one for each output of "
                f"{weights.name}, found {len(own)}"
            )
        return list(own)
    if num_classes == len(published):
        return list(published)
    return [f"class {index}" for index in range(num_classes)]


@lru_cache(maxsize=1)
def imagenet_wnids() -> tuple[str, ...]:
    """WordNet ids of the 1000 ImageNet classes, in the order of the networks' outputs (which is alphabetical)."""
    return tuple((PACKAGE_DATA / "imagenet_wnids.txt").read_text(encoding="ascii").split())


def index_of_wnid(wnid: str) -> int:
    """Class index of an ImageNet folder name such as `n04552348`.

    Raises:
        ToolkitError: it is none of the 1000.
    """
    try:
        return imagenet_wnids().index(wnid)
    except ValueError:
        raise one_of("ImageNet folder", wnid, list(imagenet_wnids())) from None


def index_of_label(labels: list[str], name: str | int) -> int:
    """Index of a class given by its name, in any case, or by its index.

    Raises:
        ToolkitError: there is no such class (the nearest names are listed), or several share the name.
    """
    if isinstance(name, int):
        return _check_index(labels, name)
    for matches in (_where(labels, name), _where([label.lower() for label in labels], name.lower())):
        if len(matches) == 1:
            return matches[0]
        if matches:
            found = ", ".join(f"{labels[index]} = {index}" for index in matches)
            raise ToolkitError(f"several classes are called '{name}' ({found}): give the index instead")
    if name.isdecimal():
        return _check_index(labels, int(name))
    raise _unknown(labels, name)


def _where(names: list[str], name: str) -> list[int]:
    return [index for index, known in enumerate(names) if known == name]


def _check_index(labels: list[str], index: int) -> int:
    if not 0 <= index < len(labels):
        raise ToolkitError(f"class index {index} is out of range: this network has classes 0 to {len(labels) - 1}")
    return index


def _unknown(labels: list[str], name: str) -> ToolkitError:
    containing = [label for label in labels if len(name) > 2 and name.lower() in label.lower()][:5]
    if containing:
        return ToolkitError(f"no class called '{name}': did you mean {' or '.join(containing)}?")
    if len(labels) > 20:
        error = str(one_of("class", name, labels))
        # a thousand names help nobody
        return ToolkitError(
            error
            if "did you mean" in error
            else f"no class called '{name}': expected one of {len(labels)} names "
            f"such as {', '.join(labels[:3])}, or an index 0 to {len(labels) - 1}"
        )
    return one_of("class", name, labels)
