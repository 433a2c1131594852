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
from toolkit.models.heads import AsEncoder, ImageFeatures, number_features
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
    """Read a program as a module for (b, 3, h, w) normalised images, and their side; None: any.

    Raises:
        ToolkitError: as `load_program`; it takes something other than a batch of square colour images.
    """
    module, shapes = load_program(path, device)
    shape = shapes[0] if len(shapes) == 1 else ()
    if len(shape) != 4 or shape[1] != 3:
        found = "×".join(map(str, shape)) if len(shapes) == 1 else f"{len(shapes)} inputs"
        raise ToolkitError(f"{path}: takes {found}: expected a batch of colour images, b×3×h×w")
    # symbolic sides are free, numbers are fixed
    batch, _, side, width = shape
    if isinstance(side, int) and isinstance(width, int) and side != width:
        raise ToolkitError(f"{path}: takes images of {side}×{width}: only squares are supported: export it for them")
    fixed = batch if isinstance(batch, int) else None
    return FixedBatch(module, fixed), side if isinstance(side, int) else None


def load_program(path: Path, device: str = "cpu") -> tuple[nn.Module, list[tuple[Any, ...]]]:
    """Read a program as a module on a device, and the shape of each input; open sides are symbols.

    Raises:
        ToolkitError: the file is damaged, of an older format, compiled, or holds more than tensors and standard
            operators.
    """
    # torch's messages about a damaged file do not help
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
    """Log nothing within: torch logs a traceback before it raises an error about a program."""
    before = logging.root.manager.disable
    logging.disable()
    try:
        yield
    finally:
        logging.disable(before)


class FixedBatch(nn.Module):
    """Lets a program for `count` images take any number; None: it does already."""

    def __init__(self, program: nn.Module, count: int | None) -> None:
        super().__init__()
        self.program, self.count = program, count

    def forward(self, batch: torch.Tensor) -> "torch.Tensor | tuple[torch.Tensor, ...]":
        """Ask for groups of `count` images, the last filled up."""
        if self.count is None:
            return self.program(batch)
        parts = []
        for part in batch.split(self.count):
            # filled up by copies of the first image, whose answers are cut off again
            missing = self.count - len(part)
            whole = torch.cat([part, part[:1].expand(missing, -1, -1, -1)]) if missing else part
            answers = self.program(whole)
            several = answers if isinstance(answers, tuple | list) else (answers,)
            parts.append([image[: len(part)] for image in several])
        joined = tuple(map(torch.cat, zip(*parts, strict=True)))
        return joined if isinstance(answers, tuple | list) else joined[0]


def _rebuild(path: Path) -> BytesIO:
    try:
        # what torch would read is checked first: no compression, only known files, no pickles
        with ZipFile(path) as archive:
            if is_inflated(path, archive):
                raise ToolkitError(f"{path}: its parts are compressed, as torch saves none: {SAVE_AGAIN}")
            names = archive.namelist()
            content = {name.partition("/")[2]: archive.read(name) for name in names}
    except FileNotFoundError:
        raise ToolkitError(f"cannot read {path}: no such file") from None
    except (BadZipFile, OSError, NotImplementedError, RuntimeError):
        raise ToolkitError(
            f"cannot read {path}: not a program of torch.export, or damaged: save it with torch.export.save"
        ) from None
    if len(content) != len(names) or "models/model.json" not in content:
        raise ToolkitError(f"{path}: not a program of torch.export 2.9 or later: save it with torch.export.save")
    strange = next((name for name in content if not KNOWN_FILES.fullmatch(name)), None)
    if strange is not None:
        raise _refuse(path, f"the file '{strange[:80]}'")
    # torch would unpickle the sample inputs, which nobody needs here
    if "data/sample_inputs/model.pt" in content:
        content["data/sample_inputs/model.pt"] = b""
    # weights and constants may hide pickled objects, or files that are cut off
    for kind in ("weights", "constants"):
        config = content.get(f"data/{kind}/model_{kind}_config.json", b'{"config": {}}')
        _check_payload(path, _load(path, config), {name: len(content[name]) for name in content}, f"data/{kind}/")
    program = _load(path, content["models/model.json"])
    nodes = content["models/model.json"].count(b'"target"')
    # bombs are refused before torch builds the graph
    if nodes > MOST_NODES or content["models/model.json"].count(b'"expr_str"') > 4 * MOST_NODES:
        raise ToolkitError(f"{path}: has {nodes} operations: up to {MOST_NODES} are read: export it without loops")
    # guards are Python source that torch would compile
    program["guards_code"] = []
    content["models/model.json"] = json.dumps(_clean(path, program)).encode()
    # only what was checked is written into the archive that torch reads
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
    """Refuse pickled tensors, and files that are too short, which torch would fill with zeros."""
    kinds: dict[str, int] = {}
    # each tensor of the file: plain numbers of a known kind, that fit its bytes
    for name, entry in payload["config"].items():
        file = entry["path_name"]
        if entry.get("use_pickle") is not False or not re.fullmatch(r"(weight|tensor)_\d+", file):
            raise _refuse(path, f"'{name[:80]}' as a pickled object")
        meta = entry["tensor_meta"]
        sides, strides = ([int(length["as_int"]) for length in meta[key]] for key in ("sizes", "strides"))
        offset, kind = int(meta["storage_offset"]["as_int"]), int(meta["dtype"])
        if kind not in ELEMENT_BYTES:
            raise _refuse(path, f"'{name[:80]}' in numbers of an unusual kind")
        # the last element of a strided tensor: Σ (side - 1) · stride
        reach = sum((side - 1) * stride for side, stride in zip(sides, strides, strict=True))
        needed = 0 if 0 in sides else (offset + reach + 1) * ELEMENT_BYTES[kind]
        if sizes.get(folder + file, 0) < needed or min([offset, *sides, *strides]) < 0:
            raise _damaged(path, f"'{name[:80]}' is cut off: {sizes.get(folder + file, 0)} bytes of {needed}")
        if kinds.setdefault(file, kind) != kind:
            raise _damaged(path, f"'{name[:80]}' shares a file with numbers of another kind")


def _clean(path: Path, value: object, key: str = "") -> object:
    """Return the JSON without debugging notes; a `ToolkitError` if a text in it is not harmless."""
    if isinstance(value, dict):
        for name in value:
            if not WORD.fullmatch(name):
                raise _refuse(path, f"the name '{name[:80]}'")
        return {name: {} if name == "metadata" else _clean(path, part, name) for name, part in value.items()}
    if isinstance(value, list):
        return [_clean(path, part, key) for part in value]
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
    """Whether a symbolic size takes no time to evaluate, as powers of powers would."""
    if len(text) > MOST_LETTERS or re.search(r"\*\*|<<|>>|\w{20}", text):
        return False
    powers = [
        node for node in ast.walk(ast.parse(text.strip() or "0", mode="eval"))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Pow"
    ]  # fmt: skip
    exponents = [ast.unparse(node.args[1]) if len(node.args) == 2 else "" for node in powers]
    return len(powers) <= MOST_POWERS and all(re.fullmatch(r"(Integer\()?-?\d\)?", text) for text in exponents)


class LogProbabilities(nn.Module):
    """Gives logits of a network that ends in a softmax."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, batch: torch.Tensor) -> torch.Tensor:
        """Return the logarithms of its probabilities."""
        # softmax(log p) = p; a probability of 0 has no logarithm
        return self.network(batch).clamp_min(torch.finfo(torch.float32).tiny).log()


def load_onnx_classifier(path: Path, device: str, features: AsEncoder | None = None) -> Classifier:
    """Load an ONNX graph that takes images and gives a number for each class or feature.

    Raises:
        ToolkitError: it is of another kind, or ONNX Runtime cannot run it.
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
    """Read the description beside a program, and a note if it does not state the normalisation."""
    own = read_labels_file(path)
    if own.mean is not None or own.std is not None:
        return own, ()
    # without a normalisation the answers may be wrong without any error
    note = (
        f"{path.name}: no 'mean' and 'std' in a {path.with_suffix('.toml').name} beside it: its images are "
        "normalised by ImageNet's; if it was trained with others, its answers are wrong"
    )
    if own.resize_px is None:
        note += "; state 'resize_px' and 'crop_px' too if its authors cut out the middle, as most ImageNet networks do"
    # printed in quiet too, as it can cost half of the accuracy
    errors.print(note, markup=False, soft_wrap=True)
    return own, (note,)


def load_exported_classifier(path: Path, device: str, features: AsEncoder | None = None) -> Classifier:
    """Load a program of `torch.export` that takes images and gives a number for each class or feature.

    Raises:
        ToolkitError: as `read_exported` and `assemble`.
    """
    network, size = read_exported(path, choose_device(device))
    (own, notes), file = _read_description(path), open_weights(path)
    how = _plain_preprocessing(check_size(path, size, own))
    made = assemble(network, path.name, file, own, how, device, features)
    return replace(made, notes=notes)


class Called(NamedTuple):
    """Result of the user's function: a module, its preprocessing in any form, and the file of the code."""

    module: nn.Module
    given: object
    file: WeightsFile


def call_python(model: str) -> Called:
    """Call `python:MODULE:FUNCTION`, with MODULE on Python's path or in the current folder.

    Raises:
        ToolkitError: it cannot be imported or called, or does not return a module and its preprocessing.
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
        # the user's error in a line: no module, no function, or what it raised
        why = f"{function_name} of {module_name} ended with an error: {describe_failure(error)}"
        if isinstance(error, ModuleNotFoundError) and error.name in (module_name, module_name.partition(".")[0]):
            why = f"there is no module '{error.name}': expected {error.name}.py in this folder, or an installed package"
        elif isinstance(error, AttributeError) and error.name == function_name:
            why = f"'{module_name}' has no function '{function_name}'"
        raise FieldError(why, {"model": model}) from None
    finally:
        sys.path.remove(here)
        if here not in sys.path:
            sys.path.append(here)  # workers find it as well
    if not isinstance(made, tuple | list) or len(made) != 2 or not isinstance(made[0], nn.Module):
        found = "a list" if isinstance(made, list) else made.__class__.__name__
        if isinstance(made, tuple | list):
            found += f" of {len(made)}: {', '.join(part.__class__.__name__ for part in made)[:80]}"
        raise FieldError(f"expected a torch.nn.Module and its preprocessing, in a tuple; found {found}",
                         {"model": model})  # fmt: skip
    network, source = made[0], Path(getattr(module, "__file__", None) or f"{module_name}.py")
    network.requires_grad_(False).eval().to("cpu")
    return Called(
        network, made[1], WeightsFile(source, _hash_module(network, source), f"{module_name}:{function_name}")
    )


def load_python_classifier(model: str, device: str, features: AsEncoder | None = None) -> Classifier:
    """Load a classifier or an encoder from `call_python`.

    The preprocessing is a `Preprocessing`, torchvision's `weights.transforms()`, or a mapping with the fields of
    `LabelsFile`, such as `{"size": 224, "mean": …, "std": …, "labels": […]}`.

    Raises:
        ToolkitError: as `call_python` and `assemble`.
    """
    network, given, file = call_python(model)
    own = LabelsFile()
    # three ways to say how images are prepared
    if isinstance(given, Preprocessing):
        how = given
    elif isinstance(given, torchvision.transforms._presets.ImageClassification):
        how = published_preprocessing(given)
    else:
        own = read_mapping(model, given)
        how = _plain_preprocessing(own.crop_px or own.size or 0)
    return assemble(network, model, file, own, how, device, features)


def wrap_module(
    module: nn.Module, labels: Sequence[str], size: int = 224, mean: Sequence[float] = IMAGENET_MEAN,
    std: Sequence[float] = IMAGENET_STD, *, name: str = "", device: str = "auto",
) -> Classifier:  # fmt: skip
    """Make a classifier of a copy of a PyTorch module in memory.

    Args:
        module: (b, 3, size, size) float images to (b, classes) logits, or probabilities.
        labels: name of each output.
        size: side of its input, to which an image's central square is resized.
        mean: mean of sRGB-encoded values in 0 to 1; by default ImageNet's.
        std: their standard deviation; by default ImageNet's.
        name: name in results; by default its class.
        device: `auto`, `cpu` or `cuda`.

    Raises:
        ToolkitError: it is no module, a value cannot be used, or as `assemble`.
    """
    arch = module.__class__.__name__
    if not isinstance(module, nn.Module):
        raise FieldError("expected a torch.nn.Module", {"module": arch})
    fields = {"labels": list(labels), "size": size, "mean": tuple(mean), "std": tuple(std), "name": name or arch}
    own = read_mapping(arch, fields)
    network = deepcopy(module).requires_grad_(False).eval().to("cpu")
    # weights in memory have no file: their hash stands for it
    file = WeightsFile(Path(arch), _hash_module(network, Path(arch)), f"a {arch} in memory")
    return assemble(network, arch, file, own, _plain_preprocessing(own.size or 0), device)


def read_mapping(model: str, given: object) -> LabelsFile:
    """Check the preprocessing that a function returned.

    Raises:
        ToolkitError: it is no mapping, a field cannot be used, or the size is missing.
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
        ToolkitError: it does not give a finite number for each class and image, or the number of labels differs.
    """
    check_hash(file, own)
    how, place = adapt_preprocessing(how, own), choose_device(device)
    network = (network if features is None else ImageFeatures(network, features.tokens, arch)).to(place)
    answers = _try(network, arch, how, place, is_foreign=file.path.suffix in FOREIGN)
    total = answers.sum(1)
    # rows that sum to 1 are probabilities: their logarithms are logits, but for a constant
    if features is None and answers.min() >= 0 and torch.allclose(total, torch.ones_like(total), atol=1e-3):
        network = LogProbabilities(network)
    count = answers.shape[1]
    # features have numbers in place of names
    labels = (
        choose_labels(file.path, own.labels, imagenet_labels(), count) if features is None else number_features(count)
    )
    return Classifier(
        arch=arch, module=network, labels=labels, preprocessing=how, weights=file, device=place,
        is_imagenet=labels == imagenet_labels(), trained_on=own.trained_on or "",
        name=own.name or (file.path.stem if file.path.suffix != ".py" else arch.rpartition(":")[2]),
    )  # fmt: skip


def _try(network: nn.Module, arch: str, how: Preprocessing, device: str, is_foreign: bool) -> torch.Tensor:
    """(2, classes) answers to a grey image and to noise."""
    side = how.crop_px
    noise = torch.rand(1, 3, side, side, generator=torch.Generator().manual_seed(0))
    # as large as normalised images, about -1 to 1
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
    # each wrong answer gets the hint that fits: a detector, an encoder, damaged weights
    wrong = f"gives {describe_answers(answers)} for 2 images: expected 2×classes"
    if not isinstance(answers, torch.Tensor):
        first = answers[0] if isinstance(answers, tuple | list) and answers else answers
        has_boxes = isinstance(first, Mapping) and "boxes" in first
        hint = f" ({DETECTOR_HINT}; here a classifier is expected)" if has_boxes else ""
        raise FieldError(f"{wrong} in a single tensor{hint}", {"model": arch})
    answers = answers.float().cpu()
    if answers.ndim == 4 and answers.shape[2:] == (1, 1):
        raise FieldError(f"{wrong}: flatten the two last axes", {"model": arch})
    if answers.ndim != 2 or len(answers) != 2 or answers.shape[1] < 2:
        hint = f" ({DETECTOR_HINT}; features of an encoder? expected a classifier)" if answers.ndim > 2 else ""
        raise FieldError(f"{wrong}{hint}", {"model": arch})
    if not torch.isfinite(answers).all():
        why = "gives values that are not a number: its weights are damaged, or it needs other images"
        raise FieldError(why, {"model": arch})
    return answers
