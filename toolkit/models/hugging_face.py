"""Networks of the Hugging Face hub, or of a folder that transformers wrote: `hf:ORG/NAME`, `hf:FOLDER`."""

import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import torch
from PIL import Image
from torch import nn

from toolkit.core.errors import FieldError, foreign_code
from toolkit.core.extras import import_package
from toolkit.core.files import load_json, sha256_bytes, sha256_file
from toolkit.imaging.preprocessing import Preprocessing, resize_and_crop
from toolkit.models.architectures import imagenet_labels
from toolkit.models.find import HF_PREFIX
from toolkit.models.heads import AsEncoder
from toolkit.models.labels import LabelsFile, number_classes, plain_name
from toolkit.models.network import Classifier, blame_model
from toolkit.models.programs import assemble, without_log
from toolkit.models.weights import HUB_TIMEOUT_S, WeightsFile, find_commit

REPOSITORY = re.compile(r"(?P<name>[\w.-]+/[\w.-]+)(@(?P<revision>[\w./-]+))?")
WANTED = ["*.json", "*.safetensors"]
"""Names of the files that are fetched."""
LIKE_IMAGENET = 900
"""So many of 1000 names must be ImageNet's in its order; the hub's networks spell some of them otherwise."""
ROUNDING = 2.0
"""Mean difference, in levels of 255, between transformers' images and ours: its resizing rounds in other places."""


class FirstOutput(nn.Module):
    """A network of transformers that gives a single tensor: its logits, or its features."""

    def __init__(self, network: nn.Module, outputs: tuple[str, ...]) -> None:
        super().__init__()
        self.network, self.outputs = network, outputs

    def forward(self, batch: torch.Tensor) -> torch.Tensor:
        """(b, 3, h, w) normalised images to the first of `outputs` that there is."""
        answers = self.network(pixel_values=batch, return_dict=True)
        return next(value for name in self.outputs if (value := answers.get(name)) is not None)


def load_hub_network(model: str, device: str, features: AsEncoder | None = None) -> Classifier:
    """Load a classifier, or with `features` an encoder, through transformers; no code of a repository is run.

    The network's `arch` names the commit: `hf:ORG/NAME@COMMIT` loads the same network again.

    Args:
        model: `hf:ORG/NAME`, `hf:ORG/NAME@REVISION`, or `hf:FOLDER` with the files of `save_pretrained`.
        device: `auto`, `cpu` or `cuda`.
        features: asks for an encoder.

    Raises:
        ToolkitError: transformers is not installed, the network cannot be fetched, is of another kind, needs its own
            code, has no weights in safetensors, or its preprocessing is not supported.
    """
    import_package("huggingface_hub", "hub", model)
    library = import_package("transformers", "hub", model)
    library.logging.disable_progress_bar()
    library.logging.set_verbosity_error()
    # files of the network: described, in safetensors, without code
    folder, name = _find_folder(model)
    files = sorted(folder.glob("*.safetensors"))
    if not files:
        raise FieldError("has no weights in safetensors, and no others are read", {"model": model})
    for described in ("config.json", "preprocessor_config.json"):
        if not (folder / described).is_file():
            raise FieldError(
                f"has no {described}: expected what save_pretrained of transformers writes", {"model": model}
            )
        if "auto_map" in load_json(folder / described):
            raise FieldError("needs its own code, which is not run: choose another network", {"model": model})
    network, missing = _load(library, folder, model, is_encoder=features is not None)
    # a hash for all parts of the weights, in the order of their names
    hashes = [sha256_file(file) for file in files]
    sha256 = hashes[0] if len(files) == 1 else sha256_bytes(" ".join(hashes).encode())
    own = LabelsFile(name=name.partition("@")[0].rpartition("/")[2])
    if features is None:
        if missing:
            raise FieldError(
                f"its weights lack {missing[0]}: 'toolkit head {model}' makes a classifier of it",
                {"model": model},
            )
        own = own.model_copy(update={"labels": _read_labels(network.config.id2label, model)})
        wrapped = FirstOutput(network, ("logits",))
    else:
        # a pooler that the weights lack would be random
        pooled = () if any("pooler" in key for key in missing) else ("pooler_output",)
        wrapped = FirstOutput(network, (*pooled, "last_hidden_state"))
    how = _read_preprocessing(library, folder, model)
    file = WeightsFile(files[0], sha256, f"{name}/{files[0].name}")
    return assemble(wrapped, f"{HF_PREFIX}{name}", file, own, how, device, features)


def _find_folder(model: str) -> tuple[Path, str]:
    """Return the folder with the network's files, and `ORG/NAME@COMMIT`, or the folder's name."""
    from huggingface_hub import snapshot_download

    rest = model.removeprefix(HF_PREFIX)
    if Path(rest).is_dir():
        return Path(rest), Path(rest).absolute().name
    found = REPOSITORY.fullmatch(rest)
    if found is None:
        expected = "expected hf:ORG/NAME, hf:ORG/NAME@REVISION, or hf:FOLDER"
        raise FieldError(f"{expected}; there is no folder {rest}", {"model": model})
    name, revision = found["name"], found["revision"]
    # it may not be on this machine: the hub's library then raises an error
    with suppress(Exception):
        kept = Path(snapshot_download(name, revision=revision, local_files_only=True))
        if list(kept.glob("*.safetensors")):
            return kept, f"{name}@{kept.name}"
    # by its commit, which records then name
    why = "name a folder with it as hf:FOLDER; it cannot be fetched from the Hugging Face hub"
    with foreign_code(blame_model(model, why, 160)):
        commit = find_commit(name, "config.json", revision)
        folder = snapshot_download(name, revision=commit, allow_patterns=WANTED, etag_timeout=HUB_TIMEOUT_S)
    return Path(folder), f"{name}@{commit}"


def _load(library: ModuleType, folder: Path, model: str, is_encoder: bool) -> tuple[Any, list[str]]:
    """Return the network in single precision, and the names that its weights lack."""
    kind = library.AutoModel if is_encoder else library.AutoModelForImageClassification
    with foreign_code(blame_model(model, "transformers cannot load it")), without_log():
        network, about = kind.from_pretrained(
            folder, local_files_only=True, use_safetensors=True, trust_remote_code=False, output_loading_info=True
        )
    missing = sorted(map(str, (*about["missing_keys"], *about["mismatched_keys"])))
    return network.float().eval().requires_grad_(False), missing


def _read_labels(named: Mapping[Any, str], model: str) -> list[str]:
    """Return the names of the classes; ImageNet's own names if they are its 1000 in order, with synonyms."""
    # keys are numbers as text: as text they would sort 10 before 2
    labels = [str(named[key]) for key in sorted(named, key=int)]
    if len(labels) < 2:
        raise FieldError(f"has {len(labels)} outputs: expected a classifier of at least two classes", {"model": model})
    published = imagenet_labels()
    if all(re.fullmatch(r"LABEL_\d+", label) for label in labels):  # transformers' own, if nobody named them
        return published if len(labels) == len(published) else number_classes(len(labels))
    # TensorFlow's networks have a class 0 for "none of these"
    extra = len(labels) - len(published)
    if extra in (0, 1):
        pairs = zip(labels[extra:], published, strict=True)
        alike = sum(plain_name(ours) in map(plain_name, theirs.split(",")) for theirs, ours in pairs)
        if alike >= LIKE_IMAGENET:
            return [*labels[:extra], *published]
    return labels


def _read_preprocessing(library: ModuleType, folder: Path, model: str) -> Preprocessing:
    """Translate an image processor, and compare both on a picture; a `ToolkitError` if they differ."""
    with foreign_code(blame_model(model, "its image processor fails")):
        with without_log():
            processor = library.AutoImageProcessor.from_pretrained(
                folder, local_files_only=True, trust_remote_code=False
            )
        how = _translate(processor.to_dict())
        # random colours, enlarged smoothly: resampling, crop and normalisation all show in them
        draws = np.random.default_rng(0).integers(0, 256, (6, 8, 3), np.uint8)
        picture = Image.fromarray(draws).resize((2 * how.resize_px, 3 * how.resize_px // 2), Image.Resampling.BICUBIC)
        theirs = processor(images=picture, return_tensors="pt")["pixel_values"][0].numpy()
    # ours in the same units: normalisation is undone, then levels of 255 are compared
    mean, std = (np.reshape(values, (3, 1, 1)) for values in (how.mean, how.std))
    ours = resize_and_crop(np.asarray(picture), how).transpose(2, 0, 1) / 255
    if theirs.shape != ours.shape or np.abs(theirs * std + mean - ours).mean() * 255 > ROUNDING:
        raise FieldError(
            f"its {processor.__class__.__name__} prepares images in a way that is not supported: expected resizing, a "
            "square, and mean and deviation of each colour",
            {"model": model},
        )
    return how


def _translate(said: Mapping[str, Any]) -> Preprocessing:
    """Translate a processor's settings; the caller compares the results."""
    size, cut = _read_side(said.get("size")), _read_side(said.get("crop_size"))
    # a short edge keeps the aspect; height and width squash
    short, whole = size.get("shortest_edge"), size.get("height")
    resize_px = px = int(short or whole or cut.get("height") or 0)
    squash = short is None
    if said.get("do_center_crop"):
        px = int(cut.get("height") or px)
    elif short and said.get("crop_pct"):
        # ConvNeXt's: from 384 px on it sees the whole image
        squash = px >= 384
        resize_px = px if squash else int(px / said["crop_pct"])
    # mean and deviation are of values after rescaling, ours are of 0 to 1
    factor = 255 * (said.get("rescale_factor") or 1 / 255) if said.get("do_rescale", True) else 255.0
    is_normalised = said.get("do_normalize", True)
    mean, std = said.get("image_mean") if is_normalised else None, said.get("image_std") if is_normalised else None
    filter_name = Image.Resampling(said.get("resample") or Image.Resampling.BILINEAR).name
    return Preprocessing(
        resize_px, px, _triple(mean or 0.0, factor), _triple(std or 1.0, factor), filter_name,
        squash=squash,
    )  # fmt: skip


def _read_side(said: Any) -> dict[str, int]:
    return {"height": said, "width": said} if isinstance(said, int) else dict(said or {})


def _triple(values: Any, factor: float) -> tuple[float, float, float]:
    red, green, blue = values if isinstance(values, list | tuple) else [values] * 3
    return red / factor, green / factor, blue / factor
