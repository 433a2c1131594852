"""Whole programs as classifiers: ONNX graphs, exported programs, modules that a function of the user's returns."""

import ast
import json
import logging
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from copy import deepcopy
from dataclasses import replace
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile, ZipFile

import torch
from pydantic import ValidationError
from torch import nn
from torch.export.passes import move_to_device_pass

from toolkit.core.child import is_memory_full, limit_memory
from toolkit.core.console import errors
from toolkit.core.errors import FieldError, ToolkitError, describe_failure, foreign_code
from toolkit.core.files import MOST_JSON_BYTES, explain_validation, sha256_bytes, sha256_file
from toolkit.core.text import escape
from toolkit.imaging.preprocessing import Preprocessing, published_preprocessing
from toolkit.models.architectures import imagenet_labels
from toolkit.models.find import EXPORTED_SUFFIX, ONNX_PREFIX
from toolkit.models.heads import AsEncoder, Features, number_features
from toolkit.models.labels import (
    PYTHON_PREFIX,
    LabelsFile,
    adapt_preprocessing,
    check_size,
    choose_labels,
    read_labels_file,
)
from toolkit.models.network import Classifier, check_hash, choose_device, describe_answers
from toolkit.models.vision import torchvision
from toolkit.models.weights import LOADING_BYTES, TRYING_BYTES, WeightsFile, is_inflated, open_weights

KNOWN_FILES = re.compile(
    r"archive_format|archive_version|byteorder|\.data/[\w.]+|\.format_version|\.storage_alignment|models/model\.json"
    r"|data/(weights/(weight_\d+|model_weights_config\.json)|constants/(tensor_\d+|model_constants_config\.json)"
    r"|sample_inputs/model\.pt)|extra/.*"
)
OPERATOR = re.compile(r"torch\.ops\.aten\.(?!from_file|save|load|open|write|print|format)\w+\.\w+|_operator\.\w+"
                      r"|torch\.sym_\w+|torch\.ops\.higher_order\.wrap_with_set_grad_enabled")  # fmt: skip
WORD = re.compile(r"[\w.+:\[\]-]*")
SIZE_WORDS = re.compile(
    r"[a-z]{1,3}\d+|Symbol|positive|integer|nonnegative|True|False|Max|Min|Mod|Add|Mul|Pow|Integer|Rational|FloorDiv"
    r"|CeilDiv|PythonMod|CleanDiv|Eq|Ne|Lt|Le|Gt|Ge"
)
"""In a symbolic size: the names that torch gives to sizes, and its functions of them."""
TREE_TYPES = ("builtins.tuple", "builtins.list", "builtins.dict")
MOST_NODES = 5_000
"""Torch reads some 200 a second; EfficientNet-B7, the longest of torchvision's, has 1,100."""
MOST_LETTERS, MOST_POWERS = 10_000, 4
"""Bounds of a symbolic size: its letters and its powers."""
SAVE_AGAIN = "copy it again, or save it again with torch.export.save"
ELEMENT_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 2, 7: 4, 8: 8, 12: 1, 13: 2}
"""By torch's numbers for integers, floats, booleans and bfloat16."""
DETECTOR_HINT = "a detector? 'toolkit eval' takes those it knows"
FOREIGN = (".onnx", EXPORTED_SUFFIX)
"""Files of programs, perhaps of somebody else's: they run in a bound of memory."""
IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


def read_exported(path: Path, device: str = "cpu") -> tuple[nn.Module, int | None]:
    """The program as a module for (b, 3, h, w) normalised images, and their side; None: any.

    Raises:
        ToolkitError: as `load_program`; it takes something other than one batch of square colour images.
    """
    module, shapes = load_program(path, device)
    shape = shapes[0] if len(shapes) == 1 else ()
    if len(shape) != 4 or shape[1] != 3:
        found = "×".join(map(str, shape)) if len(shapes) == 1 else f"{len(shapes)} inputs"
        raise ToolkitError(f"{path}: takes {found}: expected one batch of colour images, b×3×h×w")
    batch, _, side, width = shape
    if isinstance(side, int) and isinstance(width, int) and side != width:
        raise ToolkitError(f"{path}: takes images of {side}×{width}: only squares are supported: export it for one")
    fixed = batch if isinstance(batch, int) else None
    return FixedBatch(module, fixed), side if isinstance(side, int) else None


def load_program(path: Path, device: str = "cpu") -> tuple[nn.Module, list[tuple[Any, ...]]]:
    """The program as a module on a device, and the shape of each input; sides that are open are symbols.

    Raises:
        ToolkitError: the file is damaged, of an older format, compiled for one machine, or holds more than tensors and
            standard operators.
    """
    # torch's reader says nothing of use of a strange file
    with (
        foreign_code(lambda _: _damaged(path, "its parts do not fit together")),
        torch.no_grad(), limit_memory(LOADING_BYTES + 6 * path.stat().st_size), without_log(),
    ):  # fmt: skip
        program = torch.export.load(_rebuild(path))
        # its operations may name the device that it was exported on, which moving the module would not change
        if device != "cpu":
            program = move_to_device_pass(program, device)
        module = program.module(check_guards=False)
    for parameter in module.parameters():
        parameter.requires_grad_(False)
    inputs = [node for node in program.graph.nodes if node.name in program.graph_signature.user_inputs]
    return module, [tuple(node.meta["val"].shape) for node in inputs]


@contextmanager
def without_log() -> Iterator[None]:
    """Within, nothing is logged: of a program that it cannot read torch logs a traceback before it raises."""
    before = logging.root.manager.disable
    logging.disable()
    try:
        yield
    finally:
        logging.disable(before)


class FixedBatch(nn.Module):
    """A program that was exported for `count` images, as one that takes any number; None: it does already."""

    def __init__(self, program: nn.Module, count: int | None) -> None:
        super().__init__()
        self.program, self.count = program, count

    def forward(self, batch: torch.Tensor) -> "torch.Tensor | tuple[torch.Tensor, ...]":
        """Image for image in groups of `count`, the last filled up."""
        if self.count is None:
            return self.program(batch)
        parts = []
        for part in batch.split(self.count):
            # filled up by copies of its first image, whose answers are cut off again
            missing = self.count - len(part)
            whole = torch.cat([part, part[:1].expand(missing, -1, -1, -1)]) if missing else part
            answers = self.program(whole)
            several = answers if isinstance(answers, tuple | list) else (answers,)
            parts.append([image[: len(part)] for image in several])
        joined = tuple(torch.cat(one) for one in zip(*parts, strict=True))
        return joined if isinstance(answers, tuple | list) else joined[0]


def _rebuild(path: Path) -> BytesIO:
    try:
        with ZipFile(path) as archive:
            if is_inflated(path, archive):
                raise ToolkitError(f"{path}: its parts are compressed, as torch saves none: {SAVE_AGAIN}")
            names = archive.namelist()
            content = {name.partition("/")[2]: archive.read(name) for name in names}
    except FileNotFoundError:
        raise ToolkitError(f"cannot read {path}: no such file") from None
    except (BadZipFile, OSError, NotImplementedError, RuntimeError):
        raise ToolkitError(
            f"cannot read {path}: not a program of torch.export, or a damaged one: save it with torch.export.save"
        ) from None
    if len(content) != len(names) or "models/model.json" not in content:
        raise ToolkitError(f"{path}: not a program of torch.export 2.9 or later: save it with torch.export.save")
    strange = next((name for name in content if not KNOWN_FILES.fullmatch(name)), None)
    if strange is not None:
        raise _refuse(path, f"the file '{strange[:80]}'")
    # torch would unpickle the sample inputs, which nobody needs here
    samples = content.get("data/sample_inputs/model.pt", b"")
    if samples:
        content["data/sample_inputs/model.pt"] = b""
    for kind in ("weights", "constants"):
        config = content.get(f"data/{kind}/model_{kind}_config.json", b'{"config": {}}')
        _check_payload(path, _load(path, config), {name: len(content[name]) for name in content}, f"data/{kind}/")
    program = _load(path, content["models/model.json"])
    nodes = content["models/model.json"].count(b'"target"')
    if nodes > MOST_NODES or content["models/model.json"].count(b'"expr_str"') > 4 * MOST_NODES:
        raise ToolkitError(f"{path}: has {nodes} operations: up to {MOST_NODES} are read: export it without loops")
    # guards are Python source that torch would compile
    program["guards_code"] = []
    content["models/model.json"] = json.dumps(_clean(path, program)).encode()
    fresh = BytesIO()
    with ZipFile(fresh, "w") as archive:
        for name, data in content.items():
            if not name.startswith("extra/"):
                archive.writestr(f"model/{name}", data)
    fresh.seek(0)
    return fresh


def _refuse(path: Path, what: str) -> ToolkitError:
    return ToolkitError(
        f"{path} holds {escape(what)}, and is not loaded for safety: expected standard operators on plain tensors: "
        "name the code that makes it with python:MODULE:FUNCTION instead"
    )


def _damaged(path: Path, what: str) -> ToolkitError:
    return ToolkitError(f"cannot read {path}: the program is damaged ({escape(what)}): {SAVE_AGAIN}")


def _load(path: Path, content: bytes) -> dict[str, Any]:
    if len(content) > MOST_JSON_BYTES:
        raise ToolkitError(f"{path}: its description is larger than {MOST_JSON_BYTES >> 20} MB, the most that is read")
    loaded = json.loads(content)
    if not isinstance(loaded, dict):
        raise _damaged(path, "its description is no object of JSON")
    return loaded


def _check_payload(path: Path, payload: dict[str, Any], sizes: dict[str, int], folder: str) -> None:
    """Refuse what is pickled, and what torch would fill up: a file that is empty becomes zeros there."""
    kinds: dict[str, int] = {}
    for name, entry in payload["config"].items():
        file = entry["path_name"]
        if entry.get("use_pickle") is not False or not re.fullmatch(r"(weight|tensor)_\d+", file):
            raise _refuse(path, f"'{name[:80]}' as a pickled object")
        meta = entry["tensor_meta"]
        sides, strides = ([int(one["as_int"]) for one in meta[key]] for key in ("sizes", "strides"))
        offset, kind = int(meta["storage_offset"]["as_int"]), int(meta["dtype"])
        if kind not in ELEMENT_BYTES:
            raise _refuse(path, f"'{name[:80]}' in numbers of an unusual kind")
        reach = sum((side - 1) * stride for side, stride in zip(sides, strides, strict=True))
        needed = 0 if 0 in sides else (offset + reach + 1) * ELEMENT_BYTES[kind]
        if sizes.get(folder + file, 0) < needed or min([offset, *sides, *strides]) < 0:
            raise _damaged(path, f"'{name[:80]}' is cut off: {sizes.get(folder + file, 0)} bytes of {needed}")
        if kinds.setdefault(file, kind) != kind:
            raise _damaged(path, f"'{name[:80]}' shares a file with numbers of another kind")


def _clean(path: Path, value: object, key: str = "") -> object:
    """The same JSON without debugging notes, if every text in it is harmless."""
    if isinstance(value, dict):
        for name in value:
            if not WORD.fullmatch(name):
                raise _refuse(path, f"the name '{name[:80]}'")
        return {name: {} if name == "metadata" else _clean(path, one, name) for name, one in value.items()}
    if isinstance(value, list):
        return [_clean(path, one, key) for one in value]
    if isinstance(value, str) and not _is_harmless(key, value):
        what = "the operator" if key in ("target", "as_operator") else "the text"
        raise _refuse(path, f"{what} '{value[:80]}'")
    return value


def _is_harmless(key: str, text: str) -> bool:
    if key in ("target", "as_operator"):
        return OPERATOR.fullmatch(text) is not None
    if key == "expr_str":
        words = re.findall(r"[A-Za-z_]\w*", text)
        is_plain = all(map(SIZE_WORDS.fullmatch, words)) and re.fullmatch(r"[\w\s'+*/(),<>=-]*", text) is not None
        return is_plain and _is_small(text)
    if key in ("in_spec", "out_spec"):
        types = re.findall(r'"type":\s*"([^"]*)"', text)
        return set(types) <= set(TREE_TYPES) and re.fullmatch(r'[\w\s"\[\]{}:,.\\]*', text) is not None
    return WORD.fullmatch(text) is not None


def _is_small(text: str) -> bool:
    """Whether a symbolic size is worked out at once: `Pow(9, Pow(9, 9))` has 370 million digits."""
    if len(text) > MOST_LETTERS or re.search(r"\*\*|<<|>>|\w{20}", text):
        return False
    powers = [
        node for node in ast.walk(ast.parse(text.strip() or "0", mode="eval"))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Pow"
    ]  # fmt: skip
    exponents = [ast.unparse(node.args[1]) if len(node.args) == 2 else "" for node in powers]
    return len(powers) <= MOST_POWERS and all(re.fullmatch(r"(Integer\()?-?\d\)?", one) for one in exponents)


class LogProbabilities(nn.Module):
    """A network that ends in a softmax, as one that gives logits."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, batch: torch.Tensor) -> torch.Tensor:
        """The logarithms of its probabilities."""
        # softmax(log p) = p; a probability of 0 has no logarithm
        return self.network(batch).clamp_min(torch.finfo(torch.float32).tiny).log()


def load_onnx_classifier(path: Path, device: str, features: AsEncoder | None = None) -> Classifier:
    """An ONNX graph that takes images and gives a number for each class or feature; see `read_onnx`.

    Raises:
        ToolkitError: it is none, or ONNX Runtime cannot run it.
    """
    from toolkit.models.onnx_graphs import read_onnx
    from toolkit.models.onnx_networks import OnnxNetwork

    graph = read_onnx(path)
    own, notes = _read_description(path)
    size = check_size(path, graph.size, own)
    network = OnnxNetwork(graph, size)
    how = _plain_preprocessing(size)
    made = assemble(network, f"{ONNX_PREFIX}{path.name}", graph.file, own, how, device, features)
    return replace(made, untrainable=network.untrainable, notes=notes)


def _read_description(path: Path) -> tuple[LabelsFile, tuple[str, ...]]:
    """What the file beside a program says, and a note if it leaves open how images are normalised."""
    own = read_labels_file(path)
    if own.mean is not None or own.std is not None:
        return own, ()
    note = (
        f"{path.name}: no 'mean' and 'std' in a {path.with_suffix('.toml').name} beside it: its images are "
        "normalised by ImageNet's; where it was trained with others, its answers are wrong"
    )
    if own.resize_px is None:
        note += "; say 'resize_px' and 'crop_px' too if its authors cut out the middle, as most ImageNet networks do"
    # said in quiet too, as it can cost half of the right answers
    errors.print(note, markup=False, soft_wrap=True)
    return own, (note,)


def load_exported_classifier(path: Path, device: str, features: AsEncoder | None = None) -> Classifier:
    """A program of `torch.export` that takes images and gives a number for each class or feature; see `read_exported`.

    Raises:
        ToolkitError: it is none, or holds more than standard operations on tensors.
    """
    network, size = read_exported(path, choose_device(device))
    (own, notes), file = _read_description(path), open_weights(path)
    how = _plain_preprocessing(check_size(path, size, own))
    made = assemble(network, path.name, file, own, how, device, features)
    return replace(made, notes=notes)


class Called(NamedTuple):
    """What a function of the user's made: a module, what it says of its images, and the file that stands for both."""

    module: nn.Module
    given: object
    file: WeightsFile


def call_python(model: str) -> Called:
    """What `python:module:function` returns: a module and its preprocessing.

    The module is searched as Python does, and in the current folder.

    Raises:
        ToolkitError: it cannot be imported or called, or returns something else.
    """
    module_name, _, function_name = model.removeprefix(PYTHON_PREFIX).partition(":")
    if not module_name or not function_name:
        raise FieldError("expected python:MODULE:FUNCTION, such as python:my_networks:bolts", {"model": model})
    here = str(Path.cwd())
    # in front for this import alone, at the path's end afterwards
    sys.path.insert(0, here)
    try:
        module = import_module(module_name)
        made = getattr(module, function_name)()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # any the user's code can raise, sys.exit among them
        raise FieldError(_say_why(module_name, function_name, error), {"model": model}) from None
    finally:
        sys.path.remove(here)
        if here not in sys.path:
            sys.path.append(here)  # workers find it as well
    if not isinstance(made, tuple | list) or len(made) != 2 or not isinstance(made[0], nn.Module):
        found = "a list" if isinstance(made, list) else made.__class__.__name__
        if isinstance(made, tuple | list):
            found += f" of {len(made)}: {', '.join(one.__class__.__name__ for one in made)[:80]}"
        raise FieldError(f"expected a torch.nn.Module and its preprocessing, in a tuple; found {found}",
                         {"model": model})  # fmt: skip
    network, source = made[0], Path(getattr(module, "__file__", None) or f"{module_name}.py")
    network.requires_grad_(False).eval().to("cpu")
    return Called(
        network, made[1], WeightsFile(source, _hash_module(network, source), f"{module_name}:{function_name}")
    )


def load_python_classifier(model: str, device: str, features: AsEncoder | None = None) -> Classifier:
    """A classifier or an encoder from `call_python`.

    The preprocessing is a `Preprocessing`, torchvision's `weights.transforms()`, or a mapping with the fields of
    `LabelsFile`, such as `{"size": 224, "mean": …, "std": …, "labels": […]}`.

    Raises:
        ToolkitError: as `call_python`, or its answers are not a number for each class and image.
    """
    network, given, file = call_python(model)
    own = LabelsFile()
    if isinstance(given, Preprocessing):
        how = given
    elif isinstance(given, torchvision.transforms._presets.ImageClassification):
        how = published_preprocessing(given)
    else:
        own = read_mapping(model, given)
        how = _plain_preprocessing(own.crop_px or own.size or 0)
    return assemble(network, model, file, own, how, device, features)


def _say_why(module: str, function: str, error: BaseException) -> str:
    if isinstance(error, ModuleNotFoundError) and error.name in (module, module.partition(".")[0]):
        return f"there is no module '{error.name}': expected {error.name}.py in this folder, or an installed package"
    if isinstance(error, AttributeError) and error.name == function:
        return f"'{module}' has no function '{function}'"
    return f"{function} of {module} ended with an error: {describe_failure(error)}"


def wrap_module(
    module: nn.Module, labels: Sequence[str], size: int = 224, mean: Sequence[float] = IMAGENET_MEAN,
    std: Sequence[float] = IMAGENET_STD, *, name: str = "", device: str = "auto",
) -> Classifier:  # fmt: skip
    """A copy of a PyTorch module in memory as a classifier; the module itself stays as it is.

    Args:
        module: (b, 3, size, size) float images to (b, classes) logits, or probabilities.
        labels: name of each output.
        size: side of the square that it sees, to which an image's central square is resized.
        mean: taken from the sRGB-encoded values in 0 to 1, per channel; by default ImageNet's.
        std: by which they are divided then.
        name: what to call it in results; by default its class.
        device: `auto`, `cpu` or `cuda`.

    Raises:
        ToolkitError: it is no module, a value cannot be used, or it gives something other than one finite number for
            each label and image.
    """
    arch = module.__class__.__name__
    if not isinstance(module, nn.Module):
        raise FieldError("expected a torch.nn.Module", {"module": arch})
    fields = {"labels": list(labels), "size": size, "mean": tuple(mean), "std": tuple(std), "name": name or arch}
    own = read_mapping(arch, fields)
    network = deepcopy(module).requires_grad_(False).eval().to("cpu")
    file = WeightsFile(Path(arch), _hash_module(network, Path(arch)), f"a {arch} in memory")
    return assemble(network, arch, file, own, _plain_preprocessing(own.size or 0), device)


def read_mapping(model: str, given: object) -> LabelsFile:
    """What a function says of its network's images, checked.

    Raises:
        ToolkitError: it is no mapping, a field cannot be used, or no size is said.
    """
    expected = "expected as preprocessing a Preprocessing, torchvision's transforms(), or a dict with 'size'"
    if not isinstance(given, Mapping):
        raise FieldError(f"{expected}; found {given.__class__.__name__}", {"model": model})
    try:
        own = LabelsFile.model_validate(dict(given))
    except ValidationError as error:
        raise FieldError(f"its preprocessing: {explain_validation(error)}", {"model": model}) from None
    if own.size is None and own.crop_px is None:
        raise FieldError(f"{expected}; found {', '.join(map(str, given)) or 'an empty dict'}", {"model": model})
    return own


def _hash_module(network: nn.Module, source: Path) -> str:
    # code and weights both: either may change alone
    parts = [sha256_file(source)] if source.is_file() else []
    for name, value in network.state_dict().items():
        content = value.detach().cpu().contiguous().flatten().view(torch.uint8).numpy().tobytes()
        parts.append(f"{name} {value.dtype} {tuple(value.shape)} {sha256_bytes(content)}")
    return sha256_bytes("\n".join(parts).encode())


def _plain_preprocessing(size: int) -> Preprocessing:
    return Preprocessing(size, size, IMAGENET_MEAN, IMAGENET_STD)


def assemble(
    network: nn.Module, arch: str, file: WeightsFile, own: LabelsFile, how: Preprocessing, device: str,
    features: AsEncoder | None = None,
) -> Classifier:  # fmt: skip
    """Try the network on two images, and join it with its labels.

    Raises:
        ToolkitError: it gives something other than one finite number for each class and image, or its labels are of
            another number of classes.
    """
    check_hash(file, own)
    how, place = adapt_preprocessing(how, own), choose_device(device)
    network = (network if features is None else Features(network, features.tokens, arch)).to(place)
    answers = _try(network, arch, how, place, is_foreign=file.path.suffix in FOREIGN)
    total = answers.sum(1)
    # rows that sum to 1 are probabilities: their logarithms are logits, but for a constant
    if features is None and answers.min() >= 0 and torch.allclose(total, torch.ones_like(total), atol=1e-3):
        network = LogProbabilities(network)
    count = answers.shape[1]
    labels = (
        choose_labels(file.path, own.labels, imagenet_labels(), count) if features is None else number_features(count)
    )
    return Classifier(
        arch=arch, module=network, labels=labels, preprocessing=how, weights=file, device=place,
        is_imagenet=labels == imagenet_labels(), trained_on=own.trained_on or "",
        name=own.name or (file.path.stem if file.path.suffix != ".py" else arch.rpartition(":")[2]),
    )  # fmt: skip


def _try(network: nn.Module, arch: str, how: Preprocessing, device: str, is_foreign: bool) -> torch.Tensor:
    """(2, classes): what it says to grey and to noise."""
    side = how.crop_px
    noise = torch.rand(1, 3, side, side, generator=torch.Generator().manual_seed(0))
    # about what normalised images are: within 1 of nought
    images = torch.cat([torch.full((1, 3, side, side), 0.5), noise]).sub(0.5).mul(2).to(device)
    room = limit_memory(TRYING_BYTES) if is_foreign and device == "cpu" else nullcontext()
    try:
        with torch.no_grad(), room:
            answers = network(images)
    except (ToolkitError, KeyboardInterrupt):
        raise
    except BaseException as error:  # whatever a foreign module raises
        why = describe_failure(error)
        if is_foreign:
            full = f"it takes more than {TRYING_BYTES >> 30} GB"
            why = full if is_memory_full(error) else "its operations do not fit together"
        raise FieldError(f"it fails at two images of {side} px: {why}", {"model": arch}) from None
    if not isinstance(answers, torch.Tensor):
        hint = f" ({DETECTOR_HINT}; here a classifier is expected)" if _has_boxes(answers) else ""
        expected = f"expected one tensor, images × classes{hint}"
        raise FieldError(f"gives {describe_answers(answers)}: {expected}", {"model": arch})
    answers = answers.float().cpu()
    if answers.ndim == 4 and answers.shape[2:] == (1, 1):
        expected = "images × classes: flatten the two last axes"
        raise FieldError(f"gives {describe_answers(answers)}: expected {expected}", {"model": arch})
    if answers.ndim != 2 or len(answers) != 2 or answers.shape[1] < 2:
        hint = f" ({DETECTOR_HINT}; one that ends in features? expected a classifier)" if answers.ndim > 2 else ""
        raise FieldError(f"gives {describe_answers(answers)} for 2 images: expected 2×classes{hint}", {"model": arch})
    if not torch.isfinite(answers).all():
        raise FieldError("gives values that are not a number: its weights are damaged, or it needs other images",
                         {"model": arch})  # fmt: skip
    return answers


def _has_boxes(answers: object) -> bool:
    first = answers[0] if isinstance(answers, tuple | list) and answers else answers
    return isinstance(first, Mapping) and "boxes" in first
