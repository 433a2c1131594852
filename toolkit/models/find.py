"""Find the network that a name means: in the workspace, bundled, or published; and the records of classifiers."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from toolkit.core.config import FileRecord, Later
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import read_json
from toolkit.core.text import Label, is_folder_name, list_some
from toolkit.core.workspace import PACKAGE_DATA
from toolkit.models.architectures import imagenet_labels, list_architectures
from toolkit.models.labels import PYTHON_PREFIX, index_of_label, read_labels_file, search_labels
from toolkit.models.weights import SUFFIXES, check_named, weights_folder

BUNDLED = "rig18"
BUNDLED_DIR = PACKAGE_DATA / "classifiers"
SETS_DIR = BUNDLED_DIR / "sets"
DEFAULT_ARCH = "resnet18"
OPEN_CLIP_PREFIX = "open_clip:"
SUFFIX = ".safetensors"
TIMM_PREFIX, TORCHVISION_PREFIX, ONNX_PREFIX = "timm:", "torchvision:", "onnx:"
SET_PREFIX = "set:"
"""Prefix of sets of networks, of the workspace or built in."""
HF_PREFIX = "hf:"
"""Prefix of networks of the Hugging Face hub, which bring their weights."""
EXPORTED_SUFFIX = ".pt2"


class ClassShare(FileRecord):
    """Correct answers to held-out images of a class."""

    n: int
    correct: int


class UnderAttack(FileRecord):
    """Correct answers of a robust network to held-out images under an attack by projected gradient ascent.

    Attributes:
        norm, eps: norm of the attack, `l2` or `linf`, and its radius for values in 0 to 1.
        steps, step_size: number and size of its steps.
        n, correct, accuracy, ci95: as in `HeldOut`.
    """

    norm: str
    eps: float
    steps: int
    step_size: float
    n: int
    correct: int
    accuracy: float
    ci95: tuple[float, float]


class HeldOut(FileRecord):
    """Accuracy of the written weights on images that were not used in training.

    Attributes:
        n, correct: counts of all classes together.
        accuracy: their ratio; None if nothing was held out.
        ci95: Wilson's 95 % interval of the accuracy.
        per_class: counts by label.
        confusions: the most frequent mistakes, (true label, answer, count).
        what: difference between these images and the training images.
        under_attack: accuracy of a robust network under an attack; else absent.
    """

    n: int
    correct: int
    accuracy: float | None
    ci95: tuple[float, float]
    per_class: dict[str, ClassShare]
    confusions: list[tuple[str, str, int]]
    what: str
    under_attack: Annotated[UnderAttack | None, Later()] = None


class AnswerCounts(FileRecord):
    """A network's answers to `n` photographs: how many are correct, and how many agree with the teacher's."""

    n: int
    correct: int
    agreed: int


class Refinement(FileRecord):
    """A network that was refined by its own answers.

    Attributes:
        teacher, teacher_sha256: original network and hash of its weights' file.
        attack: norm, eps, steps and step size of the attack in the test, each network by its own gradient.
        before, after: predictions on held-out photographs.
        before_attacked, after_attacked: predictions on the first photographs under the attack.
        step: training step of these weights, counted from 1.
    """

    teacher: str
    teacher_sha256: str
    attack: dict[str, Any]
    before: AnswerCounts
    after: AnswerCounts
    before_attacked: AnswerCounts
    after_attacked: AnswerCounts
    step: int


def _check_member(name: str) -> str:
    # a file names no code to run, and no file elsewhere
    if not is_folder_name(name.removeprefix(TIMM_PREFIX)):
        raise ValueError("expected the name of a network, or timm:NAME")
    return name


class NetworkSet(FileRecord):
    """`rig/classifiers/NAME.json`: networks that boosters are trained on together, under a common name.

    Attributes:
        name: name of the set.
        networks: names of its networks: files beside it or in TOOLKIT_WEIGHTS, published networks, `timm:NAME`.
        turns: training steps of a round that use a network, by its name; 1 if it is not listed.
        inputs_sha256: hash of everything that decides the weights; None if the set was not made by a training.
    """

    schema_version: Literal[1] = 1
    name: str
    networks: list[Annotated[str, AfterValidator(_check_member)]] = Field(min_length=2)
    turns: dict[str, Annotated[int, Field(ge=1, le=100)]] = Field({})
    inputs_sha256: str | None = Field(None, pattern=r"^[0-9a-f]{64}$")

    @model_validator(mode="after")
    def _check_turns(self) -> "NetworkSet":
        if strange := set(self.turns) - set(self.networks):
            raise ValueError(f"turns: {', '.join(sorted(strange))}: expected names that 'networks' lists")
        return self


class ClassifierRecord(FileRecord):
    """A classifier's labels and preprocessing, as in `LabelsFile`, and its training.

    Attributes:
        name: file name without suffix.
        arch: name of the network, see `list_architectures`.
        trained_on: training data in a few words, shown with the network's results.
        labels: label of each output.
        resize_px, crop_px, mean, std, filter_name: preprocessing of an image, sRGB-encoded.
        channels, squash: other preprocessing than `RGB` and the middle of an image; else absent.
        data: sources with counts, and hashes of the pixels for training and held out.
        seed: seed of every random draw.
        settings: every hyper-parameter.
        final: mean loss and accuracy of the last steps, on augmented training images.
        held_out: accuracy of the weights as written.
        refined: results of `toolkit refine-network`; else absent.
        sha256: hash of the weights' file.
        toolkit_version: version of the program that trained it.
    """

    schema_version: int = 1
    name: str
    arch: str
    trained_on: str
    labels: list[Label] = Field(min_length=2)
    resize_px: int = Field(gt=0)
    crop_px: int = Field(gt=0)
    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    filter_name: str
    channels: Annotated[Literal["RGB", "BGR"] | None, Later()] = None
    squash: Annotated[bool | None, Later()] = None
    data: dict[str, Any]
    seed: int
    settings: dict[str, Any]
    final: dict[str, float]
    held_out: HeldOut
    refined: Annotated[Refinement | None, Later()] = None
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    toolkit_version: str


@dataclass(frozen=True)
class Found:
    """A network to load: its `arch`, as in `find_classifier`, and its file; None for published weights and for code."""

    arch: str
    weights: Path | None


def find_classifier(model: str | None = None, weights: Path | None = None, folder: Path | None = None) -> Found:
    """Find the network that a name and a file of weights mean.

    | name | network |
    |---|---|
    | `NAME` | in `folder`, among the bundled classifiers, else in `list_architectures` |
    | `torchvision:NAME`, `timm:NAME` | of that library |
    | `onnx:FILE`, `FILE.pt2` | a whole program |
    | `python:MODULE:FUNCTION` | made by the user's code |
    | `hf:ORG/NAME` | of the Hugging Face hub |
    | file of a state dict | as the record beside it says |
    | None | as the record beside the weights says, else a ResNet-18 |

    Args:
        model: a name.
        weights: a file; None: the network's own, or the published weights.
        folder: the workspace's `rig/classifiers`.

    Raises:
        ToolkitError: the name is unknown, or a classifier with its own weights was given others.
    """
    # the record beside the weights may name the network
    if model is None:
        arch = None if weights is None else read_labels_file(check_named(Path(weights))).arch
        return Found((arch or DEFAULT_ARCH).removeprefix(TORCHVISION_PREFIX), weights)
    if model.startswith(TIMM_PREFIX):
        return Found(model, weights)
    # names with weights of their own: programs, the hub, the workspace's classifiers
    own, file = list_own(folder), None if model.startswith(HF_PREFIX) else _find_file(model)
    if weights is not None and brings_weights(model, folder):
        raise FieldError(f"{model} has its own weights: leave one out", {"model": model, "weights": weights})
    if model.startswith((PYTHON_PREFIX, HF_PREFIX)):
        return Found(model, None)
    file = file or own.get(model)
    if file is not None:
        if model.startswith(ONNX_PREFIX) or file.suffix == ".onnx":
            return Found(f"{ONNX_PREFIX}{file.name}", file)
        return Found(file.name if file.suffix == EXPORTED_SUFFIX else _arch_of(check_named(file)), file)
    # not found: what the name could have meant
    if model == BUNDLED:
        raise FieldError(
            f"{BUNDLED_DIR / BUNDLED}{SUFFIX} is missing from this installation: install the package again, or train "
            "another with 'toolkit train-classifier --data everyday --name NAME'",
            {"model": BUNDLED},
        )
    if (several := read_set(model, folder)) is not None:
        raise FieldError(
            f"is a set of {len(several.networks)} networks, for train-patch and train-texture: "
            f"name a single network here, such as {several.networks[-1]}",
            {"model": model},
        )
    known, name = list_architectures(), model.removeprefix(TORCHVISION_PREFIX)
    if name not in known and may_be_detector(name):
        raise FieldError("is a detector: 'toolkit eval' takes it, here a classifier is expected", {"model": model})
    if name not in known:
        raise one_of("model", name, known if name != model else [*own, *known])
    return Found(name, weights)


def read_set(name: str, folder: Path | None) -> NetworkSet | None:
    """Read the set of networks of that name in `folder`, or by `set:NAME` a built-in set too; None if there is none.

    Raises:
        ToolkitError: its file is damaged, or there is no such set.
    """
    plain = name.removeprefix(SET_PREFIX)
    if not is_folder_name(plain):
        return None
    # a network of the same name wins over a set
    file = None if folder is None else folder / f"{plain}.json"
    if file is not None and file.is_file() and plain not in list_own(folder) and plain not in list_architectures():
        return read_json(file, NetworkSet)
    if name == plain:
        return None
    if not (built_in := SETS_DIR / f"{plain}.json").is_file():
        raise one_of("model", name, [f"{SET_PREFIX}{path.stem}" for path in sorted(SETS_DIR.glob("*.json"))])
    return read_json(built_in, NetworkSet)


def expand_sets(models: Sequence[str] | None, folder: Path | None) -> list[tuple[str, int]]:
    """(name, training steps of a round) of each network; a set stands for its networks.

    Raises:
        ToolkitError: a set's file is damaged, there is no such set, or files of its networks are missing.
    """
    found: list[tuple[str, int]] = []
    # a set gives its networks with the number of steps that each trains in a round
    for name in models or ():
        several = read_set(name, folder)
        if several is None:
            found.append((name, 1))
            continue
        places = {member: _find_member(member, folder) for member in several.networks}
        if missing := [f"{member}.onnx" for member, place in places.items() if place is None]:
            expected = f"is without {list_some(missing, 8)}: put the files into rig/classifiers, or into the folder "
            raise FieldError(f"{expected}that TOOLKIT_WEIGHTS names", {"model": name})
        found += [(place, several.turns.get(member, 1)) for member, place in places.items() if place is not None]
    return found


def _find_member(name: str, folder: Path | None) -> str | None:
    """The value of `--model` for a network of a set; None if its file is missing."""
    if name.startswith(TIMM_PREFIX) or name in list_own(folder) or name in list_architectures():
        return name
    weights = weights_folder()
    file = None if weights is None else weights / f"{name}.onnx"
    return None if file is None or not file.is_file() else f"{ONNX_PREFIX}{file}"


def brings_weights(model: str, folder: Path | None = None) -> bool:
    """Whether a name stands for a network and its weights, so that no file of weights goes with it.

    Raises:
        ToolkitError: it names a file that is not there.
    """
    if model.startswith((PYTHON_PREFIX, HF_PREFIX)):
        return True
    is_file = not model.startswith(TIMM_PREFIX) and _find_file(model) is not None
    return is_file or model in list_own(folder)


def is_program(arch: str) -> bool:
    """Whether an `arch` is a whole program, with its preprocessing in a file beside it."""
    return arch.startswith((ONNX_PREFIX, PYTHON_PREFIX)) or arch.endswith(EXPORTED_SUFFIX)


def pair_weights(
    models: Sequence[str] | None, weights: Sequence[Path] | None, folder: Path | None = None
) -> list[tuple[str | None, Path | None]]:
    """Pair networks with files of weights, in the order given: a file for each, or for each that brings none.

    Raises:
        ToolkitError: there are more or fewer files.
    """
    # without names, each file's record says which network it is for
    names: list[str | None] = list(models) if models else [None] * max(1, len(weights or ()))
    given: list[Path | None] = list(weights) if weights else [None] * len(names)
    # a file for each network, or only for those that bring none
    if len(given) == len(names):
        return list(zip(names, given, strict=True))
    bare = [name is None or not brings_weights(name, folder) for name in names]
    if sum(bare) != len(given):
        expected = f"expected a file for each of the {sum(bare)} that bring none" if sum(bare) else "they bring theirs"
        raise FieldError(f"{len(names)} of {{model}} and {len(given)} of {{weights}}: {expected}", {})
    files = iter(given)
    return [(name, next(files) if is_bare else None) for name, is_bare in zip(names, bare, strict=True)]


def may_be_detector(model: str | None) -> bool:
    """Whether a name may mean a detector: no classifier's, an ONNX file, or code."""
    if model is None or model.startswith((TIMM_PREFIX, HF_PREFIX)):
        return False
    if model.startswith((ONNX_PREFIX, PYTHON_PREFIX)) or model.endswith(".onnx"):
        return True
    name = model.removeprefix(TORCHVISION_PREFIX)
    return name.startswith(("fasterrcnn", "retinanet", "fcos", "ssd"))


def _find_file(model: str) -> Path | None:
    """Return the file that `onnx:FILE` or a path means, a `ToolkitError` if it is missing; None for another name."""
    path = Path(model.removeprefix(ONNX_PREFIX))
    is_file = model.startswith(ONNX_PREFIX) or path.suffix in (".onnx", EXPORTED_SUFFIX, *SUFFIXES)
    if is_file and not path.is_file():
        raise FieldError("no such file", {"model": model})
    return path if is_file else None


def list_own(folder: Path | None = None) -> dict[str, Path]:
    """List the files of the bundled classifiers and of those in `folder`, by name; a file of `folder` wins."""
    places = [BUNDLED_DIR] if folder is None else [BUNDLED_DIR, folder]
    # of several files the last wins: the kit's own format
    suffixes = (*SUFFIXES[:-1], EXPORTED_SUFFIX, ".onnx", SUFFIX)
    return {path.stem: path for place in places for suffix in suffixes for path in sorted(place.glob(f"*{suffix}"))}


def search_classes(text: str, folder: Path | None = None) -> list[str]:
    """Return ImageNet's labels, and those of the classifiers of `folder`, that contain a text: whole words first."""
    own = [label for weights in list_own(folder).values() for label in read_labels_file(weights).labels or []]
    return search_labels(list(dict.fromkeys([*imagenet_labels(), *own])), text)


def find_class(given: str, folder: Path | None = None) -> str:
    """Return a label of the classifiers of `folder`, or ImageNet's, by its name in any case or its index.

    Raises:
        ToolkitError: no label is called so.
    """
    # the user's own classes come before ImageNet's
    for weights in list_own(folder).values():
        if given in (read_labels_file(weights).labels or []):
            return given
    labels = imagenet_labels()
    try:
        return labels[index_of_label(labels, given)]
    except ToolkitError as error:
        own = "" if folder is None else f", and the labels of the classifiers in {folder}"
        raise FieldError(
            f"{{class_name}}: {error} (ImageNet's names count{own}; 'toolkit models --classes WORD' searches them)",
            {},
        ) from None


def _arch_of(weights: Path) -> str:
    arch = read_labels_file(weights).arch
    if arch is None:
        raise FieldError(
            f"{weights}: no record {weights.stem}.json with the field 'arch' beside it, or {weights.stem}.toml with "
            "'architecture': name its network with {model}, and the file with {weights}",
            {},
        )
    return arch.removeprefix(TORCHVISION_PREFIX)
