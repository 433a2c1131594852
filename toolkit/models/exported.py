"""Read a program of torch.export (`.pt2`), of which torch's own reader would unpickle parts and run others as code.

Torch unpickles payloads that are marked so, evaluates symbolic sizes as Python, compiles guards and names into source,
and looks up operators anywhere in `torch`. So the archive is first read here, refused where it holds anything but plain
tensors and standard operators, stripped of what only debugging needs, and handed to torch as a fresh one.
"""

import ast
import json
import re
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import torch
from torch import nn

from toolkit.core.errors import ToolkitError
from toolkit.core.files import MOST_JSON_BYTES
from toolkit.core.limits import limit_memory
from toolkit.models.weights import LOADING_BYTES, is_inflated

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
"""Of a symbolic size."""
SAVE_AGAIN = "copy it again, or save it again with torch.export.save"
ELEMENT_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 2, 7: 4, 8: 8, 12: 1, 13: 2}
"""By torch's numbers for integers, floats, booleans and bfloat16."""


def read_exported(path: Path) -> tuple[nn.Module, int | None]:
    """The program as a module for (b, 3, h, w) normalised images, and their side; None: any.

    Raises:
        ToolkitError: the file is damaged, of an older format, compiled for one machine, or holds more than tensors and
            standard operators.
    """
    try:
        with torch.no_grad(), limit_memory(LOADING_BYTES + 6 * path.stat().st_size):
            program = torch.export.load(_rebuild(path))
            module = program.module(check_guards=False)
    except ToolkitError:
        raise
    except Exception:  # torch's reader trips over a strange file in many ways, and says nothing of use
        raise _damaged(path, "its parts do not fit together") from None
    inputs = [node for node in program.graph.nodes if node.name in program.graph_signature.user_inputs]
    shape = tuple(inputs[0].meta["val"].shape) if len(inputs) == 1 else ()
    if len(shape) != 4 or shape[1] != 3:
        found = "×".join(map(str, shape)) if len(inputs) == 1 else f"{len(inputs)} inputs"
        raise ToolkitError(f"{path}: takes {found}: expected one batch of colour images, b×3×h×w")
    batch, _, side, width = shape
    if isinstance(side, int) and isinstance(width, int) and side != width:
        raise ToolkitError(f"{path}: takes images of {side}×{width}: only squares are supported: export it for one")
    for one in module.parameters():
        one.requires_grad_(False)
    fixed = batch if isinstance(batch, int) else None
    return FixedBatch(module, fixed), side if isinstance(side, int) else None


class FixedBatch(nn.Module):
    """A program that was exported for `count` images, as one that takes any number; None: it does already."""

    def __init__(self, program: nn.Module, count: int | None) -> None:
        super().__init__()
        self.program, self.count = program, count

    def forward(self, batch: torch.Tensor) -> torch.Tensor:
        """Image for image in groups of `count`, the last filled up."""
        if self.count is None:
            return self.program(batch)
        parts = []
        for part in batch.split(self.count):
            # filled up by copies of its first image, whose answers are cut off again
            missing = self.count - len(part)
            whole = torch.cat([part, part[:1].expand(missing, -1, -1, -1)]) if missing else part
            parts.append(self.program(whole)[: len(part)])
        return torch.cat(parts)


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
        raise ToolkitError(f"{path}: not a program of torch.export 2.8 or later: save it with torch.export.save")
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
        f"{path} holds {what}, and is not loaded for safety: expected standard operators on plain tensors: "
        "name the code that makes it with python:MODULE:FUNCTION instead"
    )


def _damaged(path: Path, what: str) -> ToolkitError:
    return ToolkitError(f"cannot read {path}: the program is damaged ({what}): {SAVE_AGAIN}")


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
        raise _refuse(path, f"{what} '{' '.join(value.split())[:80]}'")
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
