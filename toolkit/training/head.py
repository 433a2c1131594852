"""Give an encoder a head that names the classes of a folder: what `toolkit head` runs."""

from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load, save
from torch.nn.functional import cross_entropy, linear, normalize

from toolkit.core.console import progress
from toolkit.core.files import delete_folder, sha256_json, write_bytes
from toolkit.core.lazy import scipy
from toolkit.core.records import hold_folder
from toolkit.core.text import join_words
from toolkit.core.work import INPUTS
from toolkit.core.workspace import Workspace
from toolkit.models.heads import LEAST_LENGTH, Head, join_head
from toolkit.models.network import Classifier, check_finite
from toolkit.training.classifier import TrainedClassifier, describe_data, open_sources
from toolkit.training.classifier_task import find_finished, summarise_answers, write_classifier
from toolkit.training.data import Pack, RenderCounts, list_classes, load_training_set
from toolkit.training.head_config import HeadConfig
from toolkit.training.joined import choose_file, name_encoder

METHODS = {"linear": "multinomial logistic regression on features, L-BFGS", "nearest-mean": "nearest mean of features"}
VERSION = 1
"""Raised when the same settings give another head."""
BATCH, BLOCK = 32, 256
"""Images at a time, and images whose features are kept as one file, so that an interrupted run resumes."""
MOST_SCALE = 100.0
"""Largest factor of cosines as logits: CLIP's bound (Radford et al. 2021, section 2.5)."""
STEPS = 200
"""Steps of L-BFGS at most; some dozens are enough."""


def train_head(
    config: HeadConfig, workspace: Workspace, encoder: Classifier, *, out: Path | None = None, workers: int = 1,
    download: bool = False, restart: bool = False,
) -> TrainedClassifier:  # fmt: skip
    """Make a classifier of an encoder and a folder of images; its file holds both parts.

    Features of images that an interrupted run has computed are used again.

    Args:
        config: every setting.
        workspace: whose objects are rendered and whose `rig/classifiers` is written.
        encoder: as `load_encoder` gives it.
        out: folder for the classifier instead of the workspace's.
        workers: processes that render.
        download: fetch CIFAR-10 where it is named and not there.
        restart: forget what an earlier run left.

    Raises:
        ToolkitError: the data cannot be used or has one class, the name is taken, or the encoder cannot be exported.
    """
    folder, how = out or workspace.classifiers_dir, encoder.preprocessing
    file = choose_file(folder, config.name, encoder)
    counts = RenderCounts(config.per_class, config.views, config.held_out, config.seed, how.crop_px)
    sources = open_sources(config.data, workspace, counts, download)
    classes, kept = list_classes(sources), folder / ".training" / config.name
    if restart:
        delete_folder(kept)
    with hold_folder(folder, f".{config.name}.lock"):
        # the head's inputs: method, settings, encoder and images by their hashes
        data = load_training_set(sources, classes, how, kept, workers)
        describe_data(data, sources)
        settings = {"method": METHODS[config.kind], **config.record(), **name_encoder(encoder)}
        inputs = sha256_json([VERSION, settings, data.labels, data.train.sha256, data.held_out.sha256])
        if not restart and (record := find_finished(file, inputs)) is not None:
            return TrainedClassifier(file=file, record=record, skipped=data.skipped, was_finished=True)
        features, held_out = (
            _compute_features(encoder, pack, kept / f"features-{inputs[:16]}", name)
            for name, pack in (("train", data.train), ("held-out", data.held_out))
        )
        # the head is trained on features alone: the encoder runs once for each image
        truth = torch.from_numpy(np.array(data.train.classes))
        head = fit_linear(features, truth, config.l2) if config.kind == "linear" else fit_means(features, truth)
        answers = head(held_out).argmax(1).numpy()
        words = join_words(source.words for source in sources)
        what = "; ".join(dict.fromkeys(source.held_out_words for source in sources))
        record = write_classifier(
            file, join_head(encoder, head), encoder.preprocessing, arch=file.name, labels=list(data.labels),
            trained_on=f"{words}, by features of {encoder.name}", data=data.record, seed=config.seed,
            settings={**settings, INPUTS: inputs}, final=_measure(head(features), truth),
            held_out=summarise_answers(list(data.labels), data.held_out.classes, answers, what),
        )  # fmt: skip
        delete_folder(kept)
    return TrainedClassifier(file=file, record=record, skipped=data.skipped)


def _compute_features(encoder: Classifier, pack: Pack, kept: Path, name: str) -> torch.Tensor:
    """(n, d) float32 of all images; blocks that lie in `kept` are read."""
    found = []
    with progress(f"Computing features ({name})", len(pack.images), quiet=not len(pack.images)) as bar:
        # blocks are kept: an interrupted run computes what is missing
        for start in range(0, len(pack.images), BLOCK):
            file, images = kept / f"{name}-{start:07d}.safetensors", pack.images[start : start + BLOCK]
            if not file.is_file():
                # as the network is shown them already: the pack was made with its own preprocessing
                batches = torch.from_numpy(np.array(images)).permute(0, 3, 1, 2).float().div(255).split(BATCH)
                with torch.no_grad():
                    block = torch.cat([encoder.logits(batch).float().cpu() for batch in batches])
                check_finite(block, encoder.arch, encoder.weights)
                write_bytes(file, save({"features": block}))
            found.append(load(file.read_bytes())["features"])
            bar.advance(len(images))
    return torch.cat(found) if found else torch.zeros(0, len(encoder.labels))


def fit_linear(features: torch.Tensor, truth: torch.Tensor, l2: float) -> Head:
    """Multinomial logistic regression on features (n, d) of classes (n,), which are scaled to deviation 1 for it."""
    values, classes = features.double(), int(truth.max()) + 1
    mean, std = values.mean(0), values.std(0, correction=0)
    std = torch.where(std > LEAST_LENGTH, std, torch.ones_like(std))
    # scaled features: one weight decay then means the same for all of them
    scaled = (values - mean) / std
    weight = torch.zeros(classes, values.shape[1], dtype=torch.float64, requires_grad=True)
    bias = torch.zeros(classes, dtype=torch.float64, requires_grad=True)
    # convex: L-BFGS with a line search finds the optimum, wherever it starts
    solver = torch.optim.LBFGS([weight, bias], max_iter=STEPS, line_search_fn="strong_wolfe")

    def measure() -> torch.Tensor:
        solver.zero_grad()
        loss = cross_entropy(linear(scaled, weight, bias), truth) + 0.5 * l2 * weight.square().sum()
        loss.backward()
        return loss

    solver.step(measure)
    # the scaling of the features goes into the matrix
    weight, bias = weight.detach() / std, bias.detach()
    return Head(weight, bias - weight @ mean, normalise=False)


def fit_means(features: torch.Tensor, truth: torch.Tensor) -> Head:
    """Cosine to each class's mean, of features (n, d) of classes (n,); a scale that fits them best makes it logits."""
    values = normalize(features.double(), eps=LEAST_LENGTH)
    means = normalize(torch.stack([values[truth == k].mean(0) for k in range(int(truth.max()) + 1)]), eps=LEAST_LENGTH)
    cosines = values @ means.T
    best = scipy.optimize.minimize_scalar(
        lambda scale: float(cross_entropy(scale * cosines, truth)), bounds=(1, MOST_SCALE), method="bounded"
    )
    return Head(best.x * means, torch.zeros(len(means)), normalise=True)


def _measure(logits: torch.Tensor, truth: torch.Tensor) -> dict[str, float]:
    right = (logits.argmax(1) == truth).float().mean()
    return {"loss": float(cross_entropy(logits, truth)), "accuracy": float(right)}
