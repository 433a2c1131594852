"""What the outputs of a network are called, and which class a folder of images is of."""

import ast
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeGuard

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import explain_validation, read_bytes, read_json, read_toml
from toolkit.core.text import Label
from toolkit.core.workspace import PACKAGE_DATA
from toolkit.imaging.preprocessing import Preprocessing

LEAST_PX, MOST_PX = 16, 4096
MOST_LISTED = 60
"""A message lists so many names of classes; of more, those like the one that was given."""
Pixels = Annotated[int, Field(ge=LEAST_PX, le=MOST_PX)]
"""A network sees no less; of more, one image fills hundreds of megabytes."""
PYTHON_PREFIX = "python:"
"""Prefix of a model that is code; only whoever starts the kit may name it, no file."""
Mean = Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]
Deviation = Annotated[float, Field(ge=1e-6, le=1000, allow_inf_nan=False)]


class LabelsFile(BaseModel):
    """`NET.toml` or `NET.json` beside `NET.pth` or `NET.onnx`: what a user's own network sees and says.

    `toolkit train-classifier` writes all of it, and more (`ClassifierRecord`); one written by hand may hold any part.

    Attributes:
        labels: one name per output, in order; see `find_labels` for other forms.
        size: side of the network's square input, if it is an image's whole central square. Short for `resize_px` and
            `crop_px` of this size.
        resize_px, crop_px, filter_name: preprocessing, if it differs from the architecture's published preprocessing.
        mean, std: mean and standard deviation of values in 0 to 1, in the order of `channels`, if they differ from the
            published values.
        channels: order of the colours.
        squash: whether the whole image becomes the square, whatever its aspect ratio, instead of its middle.
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
        """Whoever opens a folder that was sent to them would run the code in it."""
        if arch is not None and PYTHON_PREFIX in arch:
            raise ValueError(
                "a file may not name code, you alone may, as the model: expected a network's name, such as resnet18"
            )
        return arch

    @model_validator(mode="before")
    @classmethod
    def _find_labels(cls, content: object) -> object:
        found = find_labels(content)
        if found is None:
            if isinstance(content, Mapping):
                _check_used(content)
            return content
        kept = {key: value for key, value in content.items() if not key.isdecimal()} if _is_named(content) else {}
        return kept | {"labels": found}


LABEL_KEYS = (
    "labels", "classes", "class_names", "categories", "names", "id2label", "idx_to_class", "class_to_idx", "label2id",
    "label_names", "idx2label", "idx_to_label", "index_to_name", "id_to_class", "class_labels", "label_map",
)  # fmt: skip
"""What training scripts call the list, in their checkpoints and beside them; `categories` is torchvision's."""


def find_labels(content: object) -> list[str] | None:
    """The names of a network's outputs in what a file holds, in their order; None where it holds none.

    A list of names, or of COCO's `{"id": …, "name": …}`; a mapping of indices to names, or of names to indices, from 0
    or from 1; or either under one of `LABEL_KEYS`, which may itself lie under `meta`. Of Keras's `[id, name]` the name
    counts.
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
        if all(str(key).isdecimal() for key in content):
            keys = _in_order(content, {key: int(key) for key in content})
            content = None if keys is None else [content[key] for key in keys]
        elif all(isinstance(value, int) and not isinstance(value, bool) for value in content.values()):
            content = _in_order(content, content)
    if not isinstance(content, list | tuple) or not content:
        return None
    if all(isinstance(one, Mapping) and "name" in one for one in content):
        by_id = all(isinstance(one.get("id"), int) for one in content)
        content = [one["name"] for one in (sorted(content, key=lambda one: one["id"]) if by_id else content)]
    names = [one[-1] if isinstance(one, list | tuple) and one else one for one in content]
    return [str(name) for name in names] if all(isinstance(name, str) for name in names) else None


def _in_order(content: Mapping[Any, object], index: Mapping[Any, Any]) -> list[Any] | None:
    keys = sorted(content, key=lambda key: index[key])
    first = index[keys[0]]
    # MATLAB and people count from 1
    return keys if first in (0, 1) and [index[key] for key in keys] == list(range(first, first + len(keys))) else None


def _check_used(content: Mapping[Any, Any]) -> None:
    """A `ValueError` for names of classes that are there, and that `find_labels` cannot put into an order."""
    numbers = [int(key) for key in content if str(key).isdecimal()]
    if numbers and len(numbers) == len(content):
        raise ValueError(
            f"the {len(numbers)} keys from {min(numbers)} to {max(numbers)} leave gaps, or not all values are names: "
            "expected a name for each output, counted from 0 or from 1"
        )
    holders = [one for one in (content, content.get("meta")) if isinstance(one, Mapping)]
    named = [key for holder in holders for key in LABEL_KEYS if holder.get(key) not in (None, [], {})]
    if named:
        raise ValueError(
            f"the field '{named[0]}' is no list of names: expected a name for each output, in order, or indices from 0 "
            "or from 1 with their names"
        )


def _is_named(content: object) -> TypeGuard[dict[str, Any]]:
    return isinstance(content, dict) and not all(str(key).isdecimal() for key in content)


def join_labels_files(own: LabelsFile, inside: LabelsFile, weights: Path) -> LabelsFile:
    """What lies beside a file of weights, and where it is silent what the weights' file itself says.

    Raises:
        ToolkitError: they differ in mean or deviation: a network is fed as it was trained.
    """
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
    """The published preprocessing with what the user's file says otherwise.

    Raises:
        ToolkitError: the crop is larger than the resized image.
    """
    keys = ("resize_px", "crop_px", "mean", "std", "filter_name", "channels", "squash")
    fields = {key: getattr(own, key) for key in keys}
    if own.size is not None:
        published = replace(published, resize_px=own.size, crop_px=own.size)
    adapted = replace(published, **{key: value for key, value in fields.items() if value is not None})
    if adapted.crop_px > adapted.resize_px:
        raise ToolkitError(f"crop_px {adapted.crop_px} is larger than resize_px {adapted.resize_px}: make it smaller")
    return adapted


BESIDE_FILE = "list them as 'labels' in a TOML or JSON file beside it"
FROM_FUNCTION = "return {'size': …, 'labels': ['…', …]} as the preprocessing of its function"
"""How the classes of a network get names."""
CODE = ".py"
MOST_TEXT_BYTES = 16 << 20
UNREAD = (".yaml", ".yml", ".csv", ".names", ".labels")
"""Under its name, other programs' files of labels."""
DESCRIPTIONS = (".toml", ".json", ".txt")
"""What may lie beside a network's file, under its name."""


def read_labels_file(weights: Path) -> LabelsFile:
    """`WEIGHTS.toml` or `WEIGHTS.json`, and the names in `WEIGHTS.txt`, one a line; empty fields where there is none.

    Raises:
        ToolkitError: a field is wrong, the text is none, two files say the same, or names lie in one that is not read.
    """
    file, toml, text = (weights.with_suffix(suffix) for suffix in (".json", ".toml", ".txt"))
    if file.is_file() and toml.is_file():
        raise ToolkitError(f"{toml} and {file} both describe {weights.name}: delete one of them")
    said = LabelsFile()
    if toml.is_file():
        said = read_toml(toml, LabelsFile)
    elif file.is_file():
        said = read_json(file, LabelsFile)
    if text.is_file():
        if said.labels is not None:
            other = toml if toml.is_file() else file
            raise ToolkitError(f"{other} and {text} both name the classes of {weights.name}: delete one of them")
        try:
            return LabelsFile.model_validate(said.model_dump() | {"labels": read_names(text)})
        except ValidationError as error:
            raise ToolkitError(f"{text}: {explain_validation(error)}") from None
    beside = (weights.with_suffix(suffix) for suffix in UNREAD)
    unread = next((one for one in beside if one.is_file() and _holds_names(one)), None)
    if said.labels is None and unread is not None:
        raise ToolkitError(
            f"{unread} is not read: put the names of the classes of {weights.name}, one a line, into {text.name}"
        )
    return said


def _holds_names(file: Path) -> bool:
    """Whether a file of another program looks like names of classes, not like settings or a log of the training."""
    with file.open("rb") as stream:
        text = stream.read(1 << 16).decode("utf-8", "replace")
    if file.suffix in (".yaml", ".yml"):
        return re.search(r"^(names|labels|classes|class_names) *:", text, re.MULTILINE) is not None
    rows = [line.split(",") for line in text.splitlines()[:5]]
    return file.suffix != ".csv" or all(len(row) == 2 and row[0].isdecimal() for row in rows[1:] or rows)


def read_lines(text: Path) -> list[str]:
    """The lines of a text file that are not empty, without spaces around them.

    Raises:
        ToolkitError: it cannot be read, or is no text.
    """
    try:
        lines = read_bytes(text, MOST_TEXT_BYTES).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ToolkitError(f"cannot read {text}: not UTF-8 text at byte {error.start}: save it as UTF-8") from None
    return [line.strip() for line in lines if line.strip()]


def read_names(text: Path) -> list[str]:
    """The names of classes in a text file, one a line; numbers and WordNet ids before all of them are left out.

    Raises:
        ToolkitError: the file is empty, or no text.
    """
    lines = read_lines(text)
    if not lines:
        raise ToolkitError(f"{text} is empty: expected the name of a class on each line, or delete the file")
    if lines[0][0] in "[{":
        return _read_literal(text, "\n".join(lines))
    by_index = {int(one[1]): one for line in lines if (one := re.fullmatch(r"(\d+) *([:,;\t ]) *(.+)", line))}
    keys = _in_order(by_index, {key: key for key in by_index}) if len(by_index) == len(lines) else None
    # "1 cent" is a name: a space alone is taken for a separator only where the numbers begin at 0
    if keys is not None and (keys[0] == 0 or all(one[2] != " " for one in by_index.values())):
        return [by_index[key][3] for key in keys]
    wnids = [re.fullmatch(r"n\d{8}\s+(.+)", line) for line in lines]
    return [wnid[1] for wnid in wnids if wnid] if all(wnids) else lines


def _read_literal(file: Path, text: str) -> list[str]:
    """Names that somebody printed from Python or as JSON: a list, or indices with their names."""
    try:
        found = find_labels(ast.literal_eval(text))
    except (ValueError, SyntaxError, RecursionError, MemoryError, TypeError):
        found = None
    if found is None:
        raise ToolkitError(f"{file}: expected the name of a class on each line, or one list of all: correct it")
    return found


OTHER_NAMES = re.compile(
    r"(imagenet_?)?(labels?|class(es|_?names|_?index|_?labels)?|names|categories|id2label|config|label_?map)"
    r"\.(txt|json|csv|tsv|ya?ml|names|pbtxt)",
    re.IGNORECASE,
)
"""What labels of a network are called in other places than beside its file under its name."""


def _refuse_unused(weights: Path) -> None:
    """A `ToolkitError` for a file of labels in the folder of a network whose classes have no names otherwise."""
    read = {weights.with_suffix(suffix) for suffix in DESCRIPTIONS}
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
    """Labels of a network's outputs: the user's file, else ImageNet's for 1000 outputs, else plain numbers.

    Of 1001 outputs the first is a background, as in TensorFlow's networks for ImageNet.

    Raises:
        ToolkitError: the user's file has another number of labels than the network has outputs, or labels lie in a
            file that is not read.
    """
    if own is not None:
        if len(own) != num_classes:
            where = "the 'labels' that its function returns" if weights.suffix == CODE else "field 'labels'"
            raise ToolkitError(
                f"{_file_of_labels(weights)}: {where}: expected {num_classes} names, one for each output of "
                f"{weights.name}, found {len(own)}"
            )
        return list(own)
    if num_classes == len(published):
        return list(published)
    # TensorFlow's networks have a class 0 for "none of these"
    if len(published) == 1000 and num_classes == 1001:
        return ["background", *published]
    if weights.suffix != CODE:
        _refuse_unused(weights)
    return _number_classes(num_classes)


def _number_classes(count: int) -> list[str]:
    return [f"class {index}" for index in range(count)]


def _file_of_labels(weights: Path) -> Path:
    """Where the user's labels came from: beside the weights, else inside them."""
    beside = (weights.with_suffix(suffix) for suffix in DESCRIPTIONS if weights.suffix != CODE)
    return next((file for file in beside if file.is_file()), weights)


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


def index_of_label(labels: list[str], name: str | int, remedy: str = BESIDE_FILE) -> int:
    """Index of a class given by its name, in any case, or by its index.

    Args:
        labels: of the network.
        name: of the class, or its index.
        remedy: what to do where the classes have no names.

    Raises:
        ToolkitError: there is no such class (the nearest names are listed), or several share the name.
    """
    if isinstance(name, int):
        return _check_index(labels, name)

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


def _unknown(labels: list[str], name: str, remedy: str) -> ToolkitError:
    if labels == _number_classes(len(labels)):
        return ToolkitError(
            f"no class called '{name}': the {len(labels)} classes of this network have no names: {remedy}, or give an "
            "index"
        )
    # two letters are in too many names to be a hint
    containing = [label for label in labels if len(name) > 2 and name.lower() in label.lower()][:5]
    if containing:
        return ToolkitError(f"no class called '{name}': did you mean {' or '.join(containing)}?")
    if len(labels) > MOST_LISTED:
        error = str(one_of("class", name, labels))
        return ToolkitError(
            error
            if "did you mean" in error
            else f"no class called '{name}': expected one of {len(labels)} names "
            f"such as {', '.join(labels[:3])}, or an index 0 to {len(labels) - 1}"
        )
    return one_of("class", name, labels)


def check_size(path: Path, size: int | None, own: LabelsFile) -> int:
    """The side of a program's images: its own, or what its description says of one that takes any.

    Raises:
        ToolkitError: neither says, or they differ.
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
    """A class's name as it is compared: in lower case, with spaces for - and _, accents however they are stored."""
    return unicodedata.normalize("NFC", name).lower().replace("_", " ").replace("-", " ").strip()
