"""Networks of the library open_clip: both towers, the tokenizer, and how images are wanted."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from toolkit.core.errors import FieldError, foreign_code
from toolkit.core.extras import import_package
from toolkit.core.files import sha256_bytes
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.find import OPEN_CLIP_PREFIX
from toolkit.models.identity import hash_tensors
from toolkit.models.load import square_preprocessing
from toolkit.models.network import blame_model
from toolkit.models.programs import without_log
from toolkit.models.text_towers import BATCH, TextTower
from toolkit.models.weights import WeightsFile

SCHEMAS = ("hf-hub:", "local-dir:")
"""How open_clip itself names a repository or a folder that holds a network and its weights."""


@dataclass(frozen=True)
class Towers:
    """Both towers of a network: `image` maps (b, 3, px, px) normalised images to (b, d), `file` is for the weights."""

    image: nn.Module
    preprocessing: Preprocessing
    file: WeightsFile
    text: TextTower


@lru_cache(maxsize=1)
def open_towers(model: str) -> Towers:
    """Load the towers of `open_clip:NAME:WEIGHTS`; WEIGHTS is a tag of open_clip or a file.

    `open_clip:hf-hub:ORG/NAME` and `open_clip:local-dir:FOLDER` bring their weights. Only tensors are unpickled.

    Raises:
        ToolkitError: open_clip is not installed, has no such network or weights, or the crop is not supported.
    """
    rest = model.removeprefix(OPEN_CLIP_PREFIX)
    library = import_package("open_clip", "clip", model)
    # a name with a schema brings its own weights, else a tag or file follows the colon
    name, _, weights = (rest, "", "") if rest.startswith(SCHEMAS) else rest.partition(":")
    if not weights and not rest.startswith(SCHEMAS):
        expected = "expected open_clip:NAME:WEIGHTS, such as open_clip:ViT-B-32:laion2b_s34b_b79k"
        raise FieldError(expected, {"model": model})

    with foreign_code(blame_model(model, "open_clip cannot load it")), without_log():
        network = library.create_model(name, weights or None, require_pretrained=True, weights_only=True)
        tokenizer = library.get_tokenizer(name)
    network = network.float().eval().requires_grad_(False)
    # the hash of the tensors stands for that of a file
    sha256 = hash_tensors(network.state_dict()) or ""

    def embed(texts: Sequence[str]) -> np.ndarray:
        with torch.no_grad():
            parts = [network.encode_text(tokenizer(list(texts[k : k + BATCH]))) for k in range(0, len(texts), BATCH)]
        return torch.cat(parts).float().numpy()

    # SigLIP has a bias, CLIP has none
    bias = getattr(network, "logit_bias", None)
    text = TextTower(
        rest, sha256_bytes(f"{sha256} {rest}".encode()), embed, scale=float(network.logit_scale.exp()),
        bias=0.0 if bias is None else float(bias),
    )  # fmt: skip
    # the crop as open_clip's own transforms make it
    wanted: Any = network.visual.preprocess_cfg
    sides = wanted["size"] if isinstance(wanted["size"], tuple | list) else (wanted["size"],)
    how = square_preprocessing(model, sides, wanted["resize_mode"], sides[0], wanted)
    return Towers(network.visual, how, WeightsFile(Path(rest), sha256, rest), text)
