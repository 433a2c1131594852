"""Labels of a network's outputs, from the many files that people have, and descriptions beside networks."""

import ast
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import explain_validation, read_bytes, read_json, read_toml
from toolkit.core.text import Label
from toolkit.core.workspace import PACKAGE_DATA
from toolkit.imaging.preprocessing import Preprocessing

LEAST_PX, MOST_PX = 16, 4096
MOST_RELATED = 5
MOST_LISTED = 60
"""Longest list of classes in a message; of more, it lists similar names."""
Pixels = Annotated[int, Field(ge=LEAST_PX, le=MOST_PX)]
PYTHON_PREFIX = "python:"
"""Prefix of a model that is code; only the user may name it, no file."""
Mean = Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]
Deviation = Annotated[float, Field(ge=1e-6, le=1000, allow_inf_nan=False)]


class LabelsFile(BaseModel):
    """`NET.toml` or `NET.json` beside `NET.pth` or `NET.onnx`: labels and preprocessing of a user's network.

    All fields may be left out. `toolkit train-classifier` writes a `ClassifierRecord`, which has more fields.

    Attributes:
        labels: name of each output; see `find_labels` for other forms.
        size: side of the network's square input: short for `resize_px` and `crop_px` of this size.
        resize_px, crop_px, filter_name: preprocessing, if it differs from the published.
        mean, std: mean and standard deviation of values in 0 to 1, in the order of `channels`, if they differ.
        channels: order of the colours.
        squash: whether the whole image becomes the square, instead of its middle.
        decoder: a detector's output format.
        letterbox: position of the image in a detector's square input: `corner` is the upper left, `stretch` fills the
            square.
        fill: grey beside the image, 0 to 255.
        arch: name of the network, see `list_architectures`; also `architecture`. Never code.
        name: name of the classifier in reports.
        trained_on: training data in a few words.
        licence: licence of the weights, for `toolkit models`.
        sha256: hash of the weights' file.
    """

    model_config = ConfigDict(extra="allow", frozen=True, populate_by_name=True)
    labels: list[Label] | None = Field(default=None, min_length=1)
    size: Pixels | None = None
    resize_px: Pixels | None = None
    crop_px: Pixels | None = None
    mean: tuple[Mean, Mean, Mean] | None = None
    std: tuple[Deviation, Deviation, Deviation] | None = None
    filter_name: Literal["NEAREST", "BILINEAR", "BICUBIC", "LANCZOS", "BOX", "HAMMING"] | None = None
    channels: Literal["RGB", "BGR"] | None = None
    squash: bool | None = None
    decoder: Literal["yolox", "fastestdet", "yolov8", "end2end", "detr"] | None = None
    letterbox: Literal["corner", "centre", "stretch"] | None = None
    fill: Annotated[int, Field(ge=0, le=255)] | None = None
    arch: str | None = Field(default=None, validation_alias=AliasChoices("arch", "architecture"))
    name: str | None = None
    trained_on: str | None = None
    licence: str | None = None
    sha256: str | None = Field(default=None, pattern=r"^[0-9a-f]{64}$")

    @field_validator("arch")
    @classmethod
    def _refuse_code(cls, arch: str | None) -> str | None:
        # else opening a folder from another person would run code
        if arch is not None and PYTHON_PREFIX in arch:
            raise ValueError("a file may not name code, only you may: expected a network's name, such as resnet18")
        return arch

    @model_validator(mode="before")
    @classmethod
    def _find_labels(cls, content: object) -> object:
        found = find_labels(content)
        if found is None:
            if isinstance(content, Mapping):
                _check_used(content)
            return content
        fields = content if isinstance(content, dict) and not all(str(key).isdecimal() for key in content) else {}
        return {key: value for key, value in fields.items() if not key.isdecimal()} | {"labels": found}


LABEL_KEYS = (
    "labels", "classes", "class_names", "categories", "names", "id2label", "idx_to_class", "class_to_idx", "label2id",
    "label_names", "idx2label", "idx_to_label", "index_to_name", "id_to_class", "class_labels", "label_map",
)  # fmt: skip
"""Keys of the list in checkpoints and files of training scripts; `categories` is torchvision's."""


def find_labels(content: object) -> list[str] | None:
    """Find the names of a network's outputs, in order, in the content of a file; None without any.

    They are a list of names, of COCO's `{"id": …, "name": …}` or of Keras's `[id, name]`. Or they are a mapping between
    names and indices from 0 or 1. Either may lie under a key of `LABEL_KEYS`, at the top or under `meta`.
    """
    named = _as_names(content)
    if named is not None or not isinstance(content, Mapping):
        return named
    for holder in (content, content.get("meta")):
        if not isinstance(holder, Mapping):
            continue
        for key in LABEL_KEYS:
            named = _as_names(holder.get(key))
            if named is not None:
                return named
    return None


def _as_names(content: object) -> list[str] | None:
    if isinstance(content, Mapping) and content:
        # indices with names, or names with indices
        if all(str(key).isdecimal() for key in content):
            keys = _in_order(content, {key: int(key) for key in content})
            content = None if keys is None else [content[key] for key in keys]
        elif all(isinstance(value, int) and not isinstance(value, bool) for value in content.values()):
            content = _in_order(content, content)
    if not isinstance(content, list | tuple) or not content:
        return None
    # COCO's list states the order by its ids
    if all(isinstance(entry, Mapping) and "name" in entry for entry in content):
        by_id = all(isinstance(entry.get("id"), int) for entry in content)
        content = [entry["name"] for entry in (sorted(content, key=lambda entry: entry["id"]) if by_id else content)]
    # Keras's lists have an id before each name
    names = [entry[-1] if isinstance(entry, list | tuple) and entry else entry for entry in content]
    return [str(name) for name in names] if all(isinstance(name, str) for name in names) else None


def _in_order(content: Mapping[Any, object], index: Mapping[Any, Any]) -> list[Any] | None:
    keys = sorted(content, key=lambda key: index[key])
    first = index[keys[0]]
    # MATLAB and people count from 1
    return keys if first in (0, 1) and [index[key] for key in keys] == list(range(first, first + len(keys))) else None


def _check_used(content: Mapping[Any, Any]) -> None:
    """Raise a `ValueError` for names of classes that `find_labels` cannot put into an order."""
    # keys that are numbers were meant as indices
    numbers = [int(key) for key in content if str(key).isdecimal()]
    if numbers and len(numbers) == len(content):
        raise ValueError(
            f"the {len(numbers)} keys from {min(numbers)} to {max(numbers)} leave gaps, or not all values are names: "
            "expected a name for each output, counted from 0 or from 1"
        )
    holders = [holder for holder in (content, content.get("meta")) if isinstance(holder, Mapping)]
    named = [key for holder in holders for key in LABEL_KEYS if holder.get(key) not in (None, [], {})]
    if named:
        raise ValueError(
            f"the field '{named[0]}' is no list of names: expected a name for each output, in order, or indices from 0 "
            "or from 1 with their names"
        )


def join_labels_files(own: LabelsFile, inside: LabelsFile, weights: Path) -> LabelsFile:
    """Complete the description beside a file of weights by that in the weights' file.

    Raises:
        ToolkitError: they differ in mean or deviation: a network is fed as it was trained.
    """
    # fields that the user left out; what both state must agree
    added = {}
    for name in ("labels", "mean", "std"):
        said, found = getattr(own, name), getattr(inside, name)
        if name != "labels" and said and found and any(abs(a - b) > 1e-4 for a, b in zip(said, found, strict=True)):
            raise ToolkitError(
                f"{_file_of_labels(weights)}: field '{name}': {list(said)}, but {weights.name} holds {list(found)}, "
                "with which it was trained: leave the field out"
            )
        if found and not said:
            added[name] = found
    return own.model_copy(update=added)


def adapt_preprocessing(published: Preprocessing, own: LabelsFile) -> Preprocessing:
    """Apply the user's description to the published preprocessing.

    Raises:
        ToolkitError: the crop is larger than the resized image.
    """
    keys = ("resize_px", "crop_px", "mean", "std", "filter_name", "channels", "squash")
    fields = {key: getattr(own, key) for key in keys}
    # `size` alone means both: nothing is cut off
    if own.size is not None:
        published = replace(published, resize_px=own.size, crop_px=own.size)
    adapted = replace(published, **{key: value for key, value in fields.items() if value is not None})
    if adapted.crop_px > adapted.resize_px:
        raise ToolkitError(f"crop_px {adapted.crop_px} is larger than resize_px {adapted.resize_px}: make it smaller")
    return adapted


BESIDE_FILE = "list them as 'labels' in a TOML or JSON file beside it"
FROM_FUNCTION = "return {'size': …, 'labels': ['…', …]} as the preprocessing of its function"
"""Remedy for a network whose classes have no names."""
CODE = ".py"
MOST_TEXT_BYTES = 16 << 20
UNREAD = (".yaml", ".yml", ".csv", ".names", ".labels")
"""Suffixes of other programs' files of labels, under the network's name."""
DESCRIPTIONS = (".toml", ".json", ".txt")
"""Suffixes of descriptions beside a network's file, under its name."""


def read_labels_file(weights: Path) -> LabelsFile:
    """Read `WEIGHTS.toml` or `WEIGHTS.json`, and the names in the lines of `WEIGHTS.txt`; fields may be empty.

    Raises:
        ToolkitError: a field is wrong, the text is none, two files hold the same, or names lie in a file that is not
            read.
    """
    file, toml, text = (weights.with_suffix(suffix) for suffix in (".json", ".toml", ".txt"))
    if file.is_file() and toml.is_file():
        raise ToolkitError(f"{toml} and {file} both describe {weights.name}: delete either")
    said = LabelsFile()
    if toml.is_file():
        said = read_toml(toml, LabelsFile)
    elif file.is_file():
        said = read_json(file, LabelsFile)
    # names in a text file join the fields of the other file, but never twice
    if text.is_file():
        if said.labels is not None:
            other = toml if toml.is_file() else file
            raise ToolkitError(f"{other} and {text} both name the classes of {weights.name}: delete either")
        try:
            return LabelsFile.model_validate(said.model_dump() | {"labels": read_names(text)})
        except ValidationError as error:
            raise ToolkitError(f"{text}: {explain_validation(error)}") from None
    # formats that are not read are refused only if nothing else names the classes
    beside = (weights.with_suffix(suffix) for suffix in UNREAD)
    unread = next((path for path in beside if path.is_file() and _holds_names(path)), None)
    if said.labels is None and unread is not None:
        raise ToolkitError(
            f"{unread} is not read: put the names of the classes of {weights.name} into the lines of {text.name}"
        )
    return said


def _holds_names(file: Path) -> bool:
    """Whether another program's file looks like names of classes, not like settings or a log of the training."""
    with file.open("rb") as stream:
        text = stream.read(1 << 16).decode("utf-8", "replace")
    if file.suffix in (".yaml", ".yml"):
        return re.search(r"^(names|labels|classes|class_names) *:", text, re.MULTILINE) is not None
    rows = [line.split(",") for line in text.splitlines()[:5]]
    return file.suffix != ".csv" or all(len(row) == 2 and row[0].isdecimal() for row in rows[1:] or rows)


def read_lines(text: Path) -> list[str]:
    """Return the lines of a text file that are not empty, without spaces around them.

    Raises:
        ToolkitError: it cannot be read, or is no text.
    """
    try:
        lines = read_bytes(text, MOST_TEXT_BYTES).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ToolkitError(f"cannot read {text}: not UTF-8 text at byte {error.start}: save it as UTF-8") from None
    return [line.strip() for line in lines if line.strip()]


def read_names(text: Path) -> list[str]:
    """Read the names of classes in the lines of a text file, without numbers beside all names or WordNet ids before.

    Raises:
        ToolkitError: the file is empty, or no text.
    """
    lines = read_lines(text)
    if not lines:
        raise ToolkitError(f"{text} is empty: expected the name of a class on each line, or delete the file")
    if lines[0][0] in "[{":
        # printed from Python or as JSON: a list, or indices with their names
        try:
            found = find_labels(ast.literal_eval("\n".join(lines)))
        except (ValueError, SyntaxError, RecursionError, MemoryError, TypeError):
            found = None
        if found is None:
            raise ToolkitError(f"{text}: expected the name of a class on each line, or a list of all: correct it")
        return found
    # an index before each name, or behind it as Places365 has it
    for pattern in (
        r"(?P<index>\d+) *(?P<mark>[:,;\t ]) *(?P<name>.+)",
        r"(?P<name>.+?) *(?P<mark>[:,;\t ]) *(?P<index>\d+)",
    ):
        by_index = {int(row["index"]): row for line in lines if (row := re.fullmatch(pattern, line))}
        keys = _in_order(by_index, {key: key for key in by_index}) if len(by_index) == len(lines) else None
        # "1 cent" is a name: a space alone separates only if the numbers begin at 0
        if keys is None or (keys[0] != 0 and any(row["mark"] == " " for row in by_index.values())):
            continue
        names = [by_index[key]["name"] for key in keys]
        # of "digit 0", "digit 1" the number is part of the name
        if len(names) == 1 or len(set(names)) > 1:
            return names
    wnids = [re.fullmatch(r"n\d{8}\s+(.+)", line) for line in lines]
    return [wnid[1] for wnid in wnids if wnid] if all(wnids) else lines


OTHER_NAMES = re.compile(
    r"(imagenet_?)?(labels?|class(es|_?names|_?index|_?labels)?|names|categories|id2label|config|label_?map)"
    r"\.(txt|json|csv|tsv|ya?ml|names|pbtxt)",
    re.IGNORECASE,
)
"""Usual names of files with labels."""


def _refuse_unused(weights: Path) -> None:
    """Raise a `ToolkitError` for a file of labels in the folder of a network whose classes have no names."""
    read = {weights.with_suffix(suffix) for suffix in DESCRIPTIONS}
    # files that may well be meant as the labels of this network
    for file in sorted(set(weights.parent.iterdir()) - read) if weights.parent.is_dir() else ():
        own = re.match(rf"{re.escape(weights.stem)}({re.escape(weights.suffix)})?[._-]?", file.name)
        rest = file.name[own.end() :] if own else file.name
        if not (OTHER_NAMES.fullmatch(rest) or (own and rest in ("txt", "json", "toml", "pbtxt"))):
            continue
        if rest.lower() == "config.json" and "id2label" not in file.read_text("utf-8", "replace")[:MOST_TEXT_BYTES]:
            continue
        raise ToolkitError(
            f"{file} is not read, and the classes of {weights.name} have no names: call it {weights.stem}.txt (a name "
            f"on each line) or {weights.stem}.json, or move it away"
        )


def choose_labels(weights: Path, own: list[str] | None, published: list[str], num_classes: int) -> list[str]:
    """Return labels of a network's outputs: the user's file, else ImageNet's for 1000 outputs, else plain numbers.

    The first of 1001 outputs is a background, as in TensorFlow's networks for ImageNet.

    Raises:
        ToolkitError: the user's file has another number of labels than the network has outputs, or labels lie in a
            file that is not read.
    """
    if own is not None:
        if len(own) != num_classes:
            where = "the 'labels' that its function returns" if weights.suffix == CODE else "field 'labels'"
            raise ToolkitError(
                f"{_file_of_labels(weights)}: {where}: expected a name for each of the {num_classes} outputs of "
                f"{weights.name}, found {len(own)}"
            )
        return list(own)
    if num_classes == len(published):
        return list(published)
    if len(published) == 1000 and num_classes == 1001:
        return ["background", *published]
    if weights.suffix != CODE:
        _refuse_unused(weights)
    return number_classes(num_classes)


def number_classes(count: int) -> list[str]:
    """Return labels of classes without names."""
    return [f"class {index}" for index in range(count)]


def _file_of_labels(weights: Path) -> Path:
    """Return the file of the user's labels: beside the weights, else the weights."""
    beside = (weights.with_suffix(suffix) for suffix in DESCRIPTIONS if weights.suffix != CODE)
    return next((file for file in beside if file.is_file()), weights)


@lru_cache(maxsize=1)
def imagenet_wnids() -> tuple[str, ...]:
    """Return the WordNet ids of ImageNet's 1000 classes, in the order of the networks' outputs."""
    return tuple((PACKAGE_DATA / "imagenet_wnids.txt").read_text(encoding="ascii").split())


def index_of_wnid(wnid: str) -> int:
    """Return the class index of an ImageNet folder such as `n04552348`; a `ToolkitError` if it is unknown."""
    try:
        return imagenet_wnids().index(wnid)
    except ValueError:
        raise one_of("ImageNet folder", wnid, list(imagenet_wnids())) from None


def index_of_label(labels: list[str], name: str | int, remedy: str = BESIDE_FILE) -> int:
    """Return the index of a class given by its name, in any case, or by its index.

    Args:
        labels: labels of the network.
        name: name of the class, or its index.
        remedy: advice if the classes have no names.

    Raises:
        ToolkitError: there is no such class (the nearest names are listed), or several share the name.
    """
    if isinstance(name, int):
        return _check_index(labels, name)

    # composed accents, as file names of a Mac have them apart
    def fold(text: str) -> str:
        return unicodedata.normalize("NFC", text).lower()

    # exact first: ImageNet has names that differ by case or stand twice
    exact = [index for index, label in enumerate(labels) if label == name]
    for matches in (exact, [index for index, label in enumerate(labels) if fold(label) == fold(name)]):
        if len(matches) == 1:
            return matches[0]
        if matches:
            found = ", ".join(f"{labels[index]} = {index}" for index in matches)
            raise ToolkitError(f"several classes are called '{name}' ({found}): give the index instead")
    if name.isdecimal():
        return _check_index(labels, int(name))
    raise _unknown(labels, name, remedy)


def _check_index(labels: list[str], index: int) -> int:
    if not 0 <= index < len(labels):
        raise ToolkitError(f"class index {index} is out of range: this network has classes 0 to {len(labels) - 1}")
    return index


def search_labels(labels: list[str], text: str) -> list[str]:
    """Return the labels that contain a text of three letters or more: those that end with it as a word first."""
    text = text.lower()
    found = [label for label in labels if text in label.lower()] if len(text) > 2 else []
    return sorted(found, key=lambda label: (text not in label.lower().split(), label.lower().split()[-1] != text))


def _unknown(labels: list[str], name: str, remedy: str) -> ToolkitError:
    if labels == number_classes(len(labels)):
        return ToolkitError(
            f"no class called '{name}': the {len(labels)} classes of this network have no names: {remedy}, or give an "
            "index"
        )
    # the last word of a name tells the kind of object: a toy car is a car
    for word in (name, *reversed(name.split())):
        if related := search_labels(labels, word)[:MOST_RELATED]:
            return ToolkitError(f"no class called '{name}': did you mean {' or '.join(related)}?")
    error = one_of("class", name, labels)
    if len(labels) <= MOST_LISTED or "did you mean" in str(error):
        return error
    names = f"{len(labels)} names such as {', '.join(labels[:3])}"
    return ToolkitError(f"no class called '{name}': expected one of {names}, or an index 0 to {len(labels) - 1}")


def check_size(path: Path, size: int | None, own: LabelsFile) -> int:
    """Return the side of a program's images: its own, or that of its description.

    Raises:
        ToolkitError: neither states it, or they differ.
    """
    described = own.crop_px or own.size
    if size is None and described is None:
        name = path.with_suffix(".toml").name
        raise ToolkitError(f"{path}: takes images of any size: say which in {name}, such as 'size = 224'")
    if None not in (size, described) and size != described:
        raise ToolkitError(f"{path}: takes images of {size} px, and its description says {described}: correct that")
    if not LEAST_PX <= (side := size or described or 0) <= MOST_PX:
        raise ToolkitError(f"{path}: takes images of {side} px: from {LEAST_PX} to {MOST_PX} are supported")
    return side


def plain_name(name: str) -> str:
    """Return a class's name for comparison: lower case, spaces for - and _, accents in a single form."""
    return unicodedata.normalize("NFC", name).lower().replace("_", " ").replace("-", " ").strip()
