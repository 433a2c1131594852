"""How many test images two or more networks get right, clean and under attack.

attack_networks.py WORKSPACE DATA ATTACK OUT NAME...
"""

import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn.functional import cross_entropy

from toolkit.core.files import read_json, write_json
from toolkit.core.statistics import wilson_interval
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.models.find import ClassifierRecord
from toolkit.models.load import load_classifier
from toolkit.models.network import Classifier
from toolkit.models.predict import predict
from toolkit.training.classifier_config import Attack, ClassifierConfig
from toolkit.training.classifier_task import find_worst_images
from toolkit.training.images import open_images

BATCH, STEPS = 100, 20


def attack_network(space: Workspace, data: str, name: str, attack: Attack) -> dict[str, Any]:
    """Counts of one network, and how it was trained."""
    classifier = load_classifier(name, device="cpu", folder=space.classifiers_dir)
    record = read_json(space.classifiers_dir / f"{name}.json", ClassifierRecord)
    images = open_images(data, classifier, "test")
    truth = np.array([one.class_index for one in images.images])
    clean, attacked = np.zeros_like(truth), np.zeros_like(truth)
    for start in range(0, len(truth), BATCH):
        part = slice(start, start + BATCH)
        batch = torch.stack([classifier.preprocess(images.read(one)) for one in images.images[part]])
        classes = torch.from_numpy(truth[part])
        worst = find_worst_images(batch, partial(measure_losses, classifier, classes), attack)
        clean[part], attacked[part] = (predict(x, classifier).argmax(1).numpy() for x in (batch, worst))
    n, robust = len(truth), record.settings.get("robust")
    counts = {f"{key}correct": int((found == truth).sum()) for key, found in (("", clean), ("attacked_", attacked))}
    return {
        "network": name, "arch": record.arch, "sha256": record.sha256, "epochs": record.settings["epochs"],
        "images": record.data["trained_on"]["images"], "trained_norm": robust and robust["norm"],
        "trained_eps": robust and robust["eps"], "trained_steps": robust and robust["steps"], "n": n, **counts,
        "ci95": wilson_interval(counts["correct"], n), "attacked_ci95": wilson_interval(counts["attacked_correct"], n),
        "norm": attack.norm, "eps": attack.eps, "steps": attack.steps,
    }  # fmt: skip


def measure_losses(classifier: Classifier, classes: torch.Tensor, images: torch.Tensor) -> torch.Tensor:
    """Cross-entropy of each image."""
    return cross_entropy(classifier.logits(images), classes, reduction="none")


def main(folder: str, data: str, words: str, out: str, *names: str) -> None:
    """Attack every network in as many steps as `train-classifier` tests with."""
    attack = ClassifierConfig(name="net", robust=words).with_overrides({"robust.steps": STEPS}).robust
    assert attack is not None
    space = open_workspace(Path(folder))
    write_json(Path(out), [attack_network(space, data, name, attack) for name in names])


if __name__ == "__main__":
    main(*sys.argv[1:])
