"""Networks of the library open_clip: both towers, the tokenizer, and how images are wanted."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from toolkit.core.errors import FieldError, describe_failure, foreign_code
from toolkit.core.files import sha256_bytes
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.find import OPEN_CLIP_PREFIX
from toolkit.models.identity import hash_tensors
from toolkit.models.programs import without_log
from toolkit.models.text_towers import BATCH, TextTower
from toolkit.models.weights import WeightsFile

SCHEMAS = ("hf-hub:", "local-dir:")
"""How open_clip itself names a repository or a folder that holds a network and its weights."""


@dataclass(frozen=True)
class Towers:
    """Both towers of a network.

    Attributes:
        image: (b, 3, px, px) normalised images to (b, d).
        preprocessing: of images.
        file: stands for the weights; the hash is that of their numbers.
        text: the other tower.
    """

    image: nn.Module
    preprocessing: Preprocessing
    file: WeightsFile
    text: TextTower


@lru_cache(maxsize=1)
def open_towers(model: str) -> Towers:
    """The towers of `open_clip:NAME:WEIGHTS`, where WEIGHTS is a tag of open_clip or a file.

    `open_clip:hf-hub:ORG/NAME` and `open_clip:local-dir:FOLDER` bring their weights. Nothing is unpickled but tensors.

    Raises:
        ToolkitError: open_clip is not installed, it has no such network or weights, or the network wants images that
            are cut another way.
    """
    rest = model.removeprefix(OPEN_CLIP_PREFIX)
    try:
        import open_clip as library
    except ImportError as error:
        raise FieldError(
            f"open_clip is not installed ({error}): pip install '.[clip]' in the kit's folder", {"model": model}
        ) from None
    name, _, weights = (rest, "", "") if rest.startswith(SCHEMAS) else rest.partition(":")
    if not weights and not rest.startswith(SCHEMAS):
        expected = "expected open_clip:NAME:WEIGHTS, such as open_clip:ViT-B-32:laion2b_s34b_b79k"
        raise FieldError(expected, {"model": model})

    def explain(error: Exception) -> FieldError:
        return FieldError(f"open_clip cannot load it: {describe_failure(error)}", {"model": model})

    with foreign_code(explain), without_log():
        network = library.create_model(name, weights or None, require_pretrained=True, weights_only=True)
        tokenizer = library.get_tokenizer(name)
    network = network.float().eval().requires_grad_(False)
    sha256 = hash_tensors(network.state_dict()) or ""

    def embed(texts: Sequence[str]) -> np.ndarray:
        with torch.no_grad():
            parts = [network.encode_text(tokenizer(list(texts[k : k + BATCH]))) for k in range(0, len(texts), BATCH)]
        return torch.cat(parts).float().numpy()

    bias = getattr(network, "logit_bias", None)
    text = TextTower(
        rest, sha256_bytes(f"{sha256} {rest}".encode()), embed, scale=float(network.logit_scale.exp()),
        bias=0.0 if bias is None else float(bias),
    )  # fmt: skip
    return Towers(network.visual, _read_preprocessing(model, network), WeightsFile(Path(rest), sha256, rest), text)


def _read_preprocessing(model: str, network: nn.Module) -> Preprocessing:
    """The kit's words for open_clip's."""
    wanted: Any = network.visual.preprocess_cfg  # type: ignore[union-attr]
    size = wanted["size"]
    sides = set(size) if isinstance(size, tuple | list) else {size}
    if len(sides) != 1 or wanted["resize_mode"] not in ("shortest", "squash"):
        raise FieldError(
            f"wants images of {size} with resize mode '{wanted['resize_mode']}': only a square of an image is "
            "supported, its middle or the whole of it: choose another network",
            {"model": model},
        )
    px = sides.pop()
    return Preprocessing(
        px, px, tuple(wanted["mean"]), tuple(wanted["std"]), wanted["interpolation"].upper(),
        squash=wanted["resize_mode"] == "squash",
    )  # fmt: skip
