"""A patch, a texture, two classifiers of a few steps, whose gradients are kept: alone, or in torchrun's processes.

torchrun --nproc-per-node 2 shared_training.py WORKSPACE COLOURS PHOTOS RESULT
"""

import sys
from pathlib import Path

import numpy as np
import torch
from texture_parts import crate_config
from tiny_network import tiny_classifier, tiny_config, train_tiny

from toolkit.boosters.patch import PatchTask
from toolkit.boosters.texture import TextureTask, train_texture
from toolkit.boosters.transforms.camera import Jitter
from toolkit.core.console import quietly
from toolkit.core.workspace import Workspace
from toolkit.training import classifier_task
from toolkit.training.classifier import train_classifier
from toolkit.training.classifier_config import ClassifierConfig
from toolkit.training.classifier_task import ClassifierTask
from toolkit.training.loop import TrainingTask
from toolkit.training.processes import current, joined

STEPS = 2
ROBUST = "robust"


def train_all(space: Workspace, colours: Path, photos: Path) -> dict[str, np.ndarray]:
    """Every gradient of every step, statistics of batch normalisation, and what each run made."""
    torch.set_num_threads(1)
    kept: dict[str, np.ndarray] = {}
    _compute_in_double()
    _watch(PatchTask, kept)
    _watch(TextureTask, kept)
    _watch(ClassifierTask, kept)
    networks = [tiny_classifier(0), tiny_classifier(1)]
    patch = tiny_config(STEPS, ensemble="normalised", jitter=Jitter())
    final = train_tiny(space.root, photos, patch, networks=networks).patch.record.final
    with quietly():
        texture = train_texture(crate_config(STEPS), networks[:1], space, class_name="jet", workers=0).texture
        config = ClassifierConfig(
            name="own", data=(str(colours),), arch="shufflenet_v2_x0_5", image_px=32, batch=24, epochs=1, held_out=0.2
        )
        classifier = train_classifier(config, space, device="cpu").record
        robust = train_classifier(config.with_overrides(name=ROBUST, robust="l2:0.5"), space, device="cpu").record
    made = (
        ("patch", final),
        ("texture", texture.record.final),
        ("classifier", classifier.final),
        (ROBUST, robust.final),
    )
    for kind, one in made:
        kept |= {f"{kind} {name}": np.array(value) for name, value in one.items()}
    return kept


def _compute_in_double() -> None:
    """The gradients of a classifier's first layers, which rounding moves by per cents in single precision."""
    start, draw, finish = classifier_task.start_network, ClassifierTask._draw_batch, ClassifierTask.finish

    def draw_double(*arguments):
        batch, classes = draw(*arguments)
        return batch.double(), classes

    def finish_single(self, history):
        self.module.float()
        return finish(self, history)

    classifier_task.choose_precision = lambda *_: "float32"
    classifier_task.start_network = lambda *arguments: start(*arguments).double()
    ClassifierTask._draw_batch, ClassifierTask.finish = draw_double, finish_single


def _watch(kind: type[TrainingTask], kept: dict[str, np.ndarray]) -> None:
    adjust = kind.adjust_gradients

    def keep(self: TrainingTask, step: int) -> None:
        called = ROBUST if isinstance(self, ClassifierTask) and self.config.robust else kind.work.kind
        for name, value in self.parameters().items():
            if value.grad is not None:
                kept[f"{called} {step} {name}"] = value.grad.numpy().copy()
        kept.update({f"{called} {step} {name}": value.numpy().copy() for name, value in self.buffers().items()})
        adjust(self, step)

    kind.adjust_gradients = keep


if __name__ == "__main__":
    folder, colours, photos, result = map(Path, sys.argv[1:])
    with joined():
        found = train_all(Workspace(folder), colours, photos)
        np.savez(f"{result}-{current().rank}.npz", **found)
        sys.stdout.write(f"process {current().rank} is done\n")
