"""Text towers of networks such as CLIP: prompts to embeddings, by an ONNX graph, an exported program or open_clip."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from toolkit.core.child import limit_memory
from toolkit.core.errors import FieldError, ToolkitError, describe_failure, foreign_code
from toolkit.core.extras import import_package
from toolkit.core.files import load_json, sha256_bytes, sha256_file
from toolkit.core.text import join_words
from toolkit.models.find import EXPORTED_SUFFIX, ONNX_PREFIX
from toolkit.models.heads import choose_output
from toolkit.models.weights import TRYING_BYTES, open_weights

TOKENIZER = "tokenizer.json"
BATCH = 64
"""Prompts at a time."""
MOST_TOKENS = 4096
"""A length beyond stands for none: `tokenizer_config.json` says 10^30 where there is no bound."""


@dataclass(frozen=True)
class TextTower:
    """Turns prompts into embeddings.

    Attributes:
        name: name in records.
        sha256: hash of weights, tokenizer and length.
        embed: texts to (n, d) float32, of any length.
        scale, bias: factor of the cosine of two embeddings, None if it is unknown, and a summand.
    """

    name: str
    sha256: str
    embed: Callable[[Sequence[str]], np.ndarray]
    scale: float | None = None
    bias: float = 0.0


class _Runner(NamedTuple):
    """A tower that takes numbers of tokens and texts (None: any), and the function of ids and their mask."""

    tokens: int | None
    texts: int | None
    ask: Callable[[np.ndarray, np.ndarray], list[np.ndarray]]


def load_text_tower(model: str, tokenizer: Path | None = None) -> TextTower:
    """Load a text tower in a file, with the tokenizer beside it.

    Args:
        model: `onnx:FILE`, a path of an ONNX graph or of a `.pt2`. It takes token ids (n, tokens), and perhaps their
            mask as a second input, and gives (n, d).
        tokenizer: a `tokenizer.json` of the library tokenizers; by default beside the tower, or in the folder above.

    Raises:
        ToolkitError: a file is missing or damaged, or the tower takes or gives something else.
    """
    path = Path(model.removeprefix(ONNX_PREFIX))
    if path.suffix not in (".onnx", EXPORTED_SUFFIX):
        raise FieldError("expected an ONNX graph, a .pt2 or open_clip:NAME:WEIGHTS", {"text": model})
    if not path.is_file():
        raise FieldError("no such file", {"text": model})
    # exporters put the tokenizer beside the tower, or above a folder `onnx`
    places = [path.with_name(TOKENIZER), path.absolute().parent.parent / TOKENIZER]
    file = tokenizer or next((place for place in places if place.is_file()), None)
    if file is None:
        raise FieldError(f"no {TOKENIZER} beside it: copy it there, or name it with {{tokenizer}}", {"text": model})
    runner, weights = _open_onnx(path) if path.suffix == ".onnx" else _open_program(path)
    tokenize, length = _open_tokenizer(file, runner.tokens)
    # the embeddings depend on tower, tokenizer and length together
    sha256 = sha256_bytes(f"{weights} {sha256_file(file)} {length}".encode())
    return TextTower(path.name, sha256, partial(_embed, runner, tokenize, path))


def _embed(runner: _Runner, tokenize: Callable[[list[str]], Any], path: Path, texts: Sequence[str]) -> np.ndarray:
    parts = []
    size = runner.texts or BATCH
    for start in range(0, len(texts), size):
        part = list(texts[start : start + size])
        # a tower for a fixed number gets copies, whose embeddings are cut off again
        filled = part + part[:1] * (size - len(part) if runner.texts else 0)
        answers = runner.ask(*tokenize(filled))
        found = answers[choose_output([answer.ndim for answer in answers])]
        if found.ndim != 2 or len(found) != len(filled):
            shape = "×".join(map(str, found.shape))
            raise ToolkitError(f"{path}: gives {shape} for {len(filled)} texts: expected an embedding for each, n×d")
        parts.append(found[: len(part)].astype(np.float32))
    return np.concatenate(parts)


def _open_onnx(path: Path) -> tuple[_Runner, str]:
    from toolkit.models.onnx_graphs import hash_whole, list_inputs, load_model, run_inputs, start_session

    model = load_model(path)
    # ids first: some exporters sort inputs by their names
    inputs = sorted(list_inputs(model), key=lambda entry: "mask" in entry.name)
    shapes = [tuple(dim.dim_value or None for dim in entry.type.tensor_type.shape.dim) for entry in inputs]
    length, count = _check_shapes(path, shapes)
    with limit_memory(TRYING_BYTES + 6 * model.ByteSize()):
        session = start_session(model, path, torch.get_num_threads())

    def ask(ids: np.ndarray, mask: np.ndarray) -> list[np.ndarray]:
        # element type 6 is int32; the mask is left out if the tower takes ids alone
        kinds = (np.int32 if entry.type.tensor_type.elem_type == 6 else np.int64 for entry in inputs)
        given = {entry.name: value.astype(kind) for entry, value, kind in zip(inputs, (ids, mask), kinds, strict=False)}
        return list(run_inputs(session, path, given, f"{len(ids)} texts of {ids.shape[1]} tokens"))

    return _Runner(length, count, ask), hash_whole(path).sha256


def _open_program(path: Path) -> tuple[_Runner, str]:
    from toolkit.models.programs import load_program

    module, shapes = load_program(path)
    plain = [tuple(side if isinstance(side, int) else None for side in shape) for shape in shapes]
    length, count = _check_shapes(path, plain)

    def ask(ids: np.ndarray, mask: np.ndarray) -> list[np.ndarray]:
        what = f"{path}: fails at {len(ids)} texts"
        with foreign_code(lambda error: ToolkitError(f"{what}: {describe_failure(error)}")), torch.no_grad():
            # the mask only if the program takes two inputs
            answers = module(*map(torch.from_numpy, (ids, mask)[: len(shapes)]))
        several = answers if isinstance(answers, tuple | list) else (answers,)
        return [image.float().numpy() for image in several if isinstance(image, torch.Tensor)]

    return _Runner(length, count, ask), open_weights(path).sha256


def _check_shapes(path: Path, shapes: list[tuple[int | None, ...]]) -> tuple[int | None, int | None]:
    """Return the numbers of tokens and texts of a tower; None: any."""
    if len(shapes) not in (1, 2) or any(len(shape) != 2 for shape in shapes):
        found = join_words("×".join("?" if side is None else str(side) for side in shape) for shape in shapes)
        raise ToolkitError(f"{path}: takes {found or 'nothing'}: expected token ids, n×tokens, and perhaps their mask")
    return shapes[0][1], shapes[0][0]


def _open_tokenizer(file: Path, length: int | None) -> tuple[Callable[[list[str]], Any], int | None]:
    """Return the function of texts to (ids, mask), both (n, tokens) int64, and the number of tokens, if it is fixed."""
    library = import_package("tokenizers", "clip", str(file))
    with foreign_code(lambda error: ToolkitError(f"cannot read {file}: {describe_failure(error)}")):
        tokenizer = library.Tokenizer.from_file(str(file))
    # length and padding stand in either of two files; the first sensible number counts
    beside = file.with_name("tokenizer_config.json")
    config = load_json(beside) if beside.is_file() else {}
    padding, cut = tokenizer.padding or {}, tokenizer.truncation or {}
    bounds = (length, padding.get("length"), cut.get("max_length"), config.get("model_max_length"))
    length = next((int(most) for most in bounds if isinstance(most, int | float) and 0 < most <= MOST_TOKENS), None)
    # a token may be described by a mapping
    token = padding.get("pad_token") or config.get("pad_token") or ""
    token = token.get("content", "") if isinstance(token, dict) else str(token)
    number = padding.get("pad_id", tokenizer.token_to_id(token) or 0)
    tokenizer.enable_padding(pad_id=number, pad_token=token or "[PAD]", length=length)
    if length is not None:
        tokenizer.enable_truncation(length)

    def tokenize(texts: list[str]) -> tuple[np.ndarray, np.ndarray]:
        found = tokenizer.encode_batch(texts)
        ids, mask = zip(*((encoding.ids, encoding.attention_mask) for encoding in found), strict=True)
        return np.array(ids, np.int64), np.array(mask, np.int64)

    return tokenize, length
