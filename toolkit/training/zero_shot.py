"""Make a classifier of an image tower, a text tower and prompts: what `toolkit zero-shot` runs."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load, save

from toolkit.core.console import notice, progress
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import sha256_json, write_bytes
from toolkit.core.records import hold_folder
from toolkit.core.work import INPUTS
from toolkit.models.heads import Head, join_head
from toolkit.models.network import Classifier
from toolkit.models.text_towers import TextTower
from toolkit.training.classifier import TrainedClassifier
from toolkit.training.classifier_task import find_finished, summarise_answers, write_classifier
from toolkit.training.joined import choose_file, name_encoder

VERSION = 1
"""Raised when the same prompts give another classifier."""
CLIP_SCALE = 100.0
"""Factor of cosines as logits if the tower states none: CLIP's own (Radford et al. 2021, section 2.5)."""
KEPT = ".embeddings"


def make_zero_shot(
    name: str, image: Classifier, text: TextTower, prompts: Mapping[str, Sequence[str]], folder: Path, *,
    scale: float | None = None, restart: bool = False,
) -> TrainedClassifier:  # fmt: skip
    """Write a classifier whose classes are prompts: one file with the image tower and the embeddings of the classes.

    Logits are the cosine of image and class, times the scale of the tower, plus its bias. The text tower is needed
    here alone. Embeddings are kept by the hash of tower and prompts, so that an interrupted run resumes.

    Args:
        name: of the file.
        image: the image tower, as `load_encoder` gives it.
        text: the text tower.
        prompts: of each class, by its label.
        folder: for the classifier, such as the workspace's `rig/classifiers`.
        scale: instead of the tower's own, or of CLIP's 100 if the tower states none.
        restart: make it again.

    Raises:
        ToolkitError: the towers' embeddings differ in size or are not numbers, the name is taken, or the image tower
            cannot be exported.
    """
    file = choose_file(folder, name, image)
    # the scale makes probabilities sharp or flat, and leaves the order as it is
    chosen = scale or text.scale
    if chosen is None:
        chosen = CLIP_SCALE
        notice(f"{text.name} does not say its scale: {chosen:g} is used, as in CLIP; give the scale if it differs")
    settings = {
        "method": "cosine to the mean of each class's normalised prompt embeddings", **name_encoder(image),
        "text_tower": text.name, "text_sha256": text.sha256, "scale": chosen, "bias": text.bias,
        "prompts": {label: list(texts) for label, texts in prompts.items()},
    }  # fmt: skip
    # the order of the classes too, which the hash of a dict leaves out
    inputs = sha256_json([VERSION, settings, list(prompts)])
    with hold_folder(folder, f".{name}.lock"):
        if not restart and (record := find_finished(file, inputs)) is not None:
            return TrainedClassifier(file=file, record=record, was_finished=True)
        # embeddings are kept beside the classifiers: another set of classes shares prompts
        embeddings = embed_classes(prompts, text, folder / KEPT)
        if embeddings.shape[1] != len(image.labels):
            raise FieldError(
                f"gives {len(image.labels)} numbers for an image, and {text.name} {embeddings.shape[1]} for a text: "
                "expected two towers of one network, each with its projection",
                {"image": image.arch},
            )
        # a linear layer on normalised features is the scaled cosine
        head = Head(chosen * embeddings, torch.full((len(prompts),), text.bias), normalise=True)
        # no images are held out: nothing was learnt from images
        labels, nothing = list(prompts), np.zeros(0, np.int64)
        record = write_classifier(
            file, join_head(image, head), image.preprocessing, arch=file.name, labels=labels,
            trained_on=f"prompts, by {image.name} and {text.name}", data={}, seed=0, final={},
            settings={**settings, INPUTS: inputs}, held_out=summarise_answers(labels, nothing, nothing, "no images"),
        )  # fmt: skip
    return TrainedClassifier(file=file, record=record)


def embed_classes(prompts: Mapping[str, Sequence[str]], text: TextTower, kept: Path) -> torch.Tensor:
    """(classes, d) float64 of length 1: the mean of each class's prompt embeddings, each of length 1 before.

    Source: Radford et al. (2021), section 3.1.4.

    Args:
        prompts: of each class.
        text: the tower.
        kept: folder for the embeddings, by the hash of tower and prompts.

    Raises:
        ToolkitError: an embedding is 0 or not a number.
    """
    found = []
    with progress("Embedding prompts", sum(map(len, prompts.values()))) as bar:
        for label, texts in prompts.items():
            file = kept / f"{sha256_json([VERSION, text.sha256, list(texts)])}.safetensors"
            if not file.is_file():
                # each prompt counts alike, whatever the length of its embedding
                each = torch.from_numpy(text.embed(texts)).double()
                mean = (each / each.norm(dim=1, keepdim=True)).mean(0)
                if not torch.isfinite(mean).all() or not mean.norm():
                    raise ToolkitError(f"{text.name}: its embeddings of the prompts of '{label}' are 0 or not numbers")
                write_bytes(file, save({"embedding": mean / mean.norm()}))
            found.append(load(file.read_bytes())["embedding"])
            bar.advance(len(texts))
    return torch.stack(found)
