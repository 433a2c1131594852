"""Refine a network from its settings to files: what `toolkit refine-network` runs."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolkit.core.console import notice
from toolkit.core.errors import FieldError
from toolkit.core.files import sha256_bytes
from toolkit.core.locks import hold_folder
from toolkit.core.workspace import Workspace
from toolkit.models.find import Answers, ClassifierRecord, is_program
from toolkit.models.network import Classifier
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.classifier import CHECKPOINT_EVERY_S
from toolkit.training.data import keep_classes, load_training_set, open_photographs, store_preprocessing
from toolkit.training.loop import fit
from toolkit.training.processes import current
from toolkit.training.refine_config import HELD_OUT, METHOD_VERSION, RefineConfig
from toolkit.training.refine_task import KEPT, RefineInputs, RefineTask


@dataclass(frozen=True)
class RefinedNetworks:
    """What a run made.

    Attributes:
        name: that `--model` takes for all of them.
        folder: of their files.
        records: of each network.
        skipped: (path, reason) of photographs that could not be used.
        resumed_from: steps that an earlier run had made.
        was_finished: whether there was nothing left to do.
    """

    name: str
    folder: Path
    records: list[ClassifierRecord]
    skipped: tuple[tuple[str, str], ...]
    resumed_from: int
    was_finished: bool

    def as_json(self) -> dict[str, Any]:
        """All of it for a script."""
        return {
            "model": self.name,
            "files": [str(self.folder / f"{one.name}.safetensors") for one in self.records],
            "was_finished": self.was_finished,
            "resumed_from": self.resumed_from,
            "skipped": [{"path": path, "reason": reason} for path, reason in self.skipped],
            "records": [one.model_dump(mode="json") for one in self.records],
        }

    def lines(self) -> Iterator[str]:
        """The same for people."""
        if self.was_finished:
            yield f"{self.name} was refined with these inputs before: nothing to do; --restart refines it again"
        for one in self.records:
            if one.refined is not None:
                attack = f"{one.refined.attack['norm']} {one.refined.attack['eps']:g}"
                clean = _compare(one.refined.before, one.refined.after)
                yield f"{one.name}: held-out photographs, {clean}"
                yield f"  under attack ({attack}), {_compare(one.refined.before_attacked, one.refined.after_attacked)}"
        yield f"next: toolkit train-patch --object OBJECT --model {self.name}"


def _compare(before: Answers, after: Answers) -> str:
    return (
        f"right {before.correct} → {after.correct} of {after.n}, as the network before {before.agreed} → {after.agreed}"
    )


def refine_network(
    config: RefineConfig,
    workspace: Workspace,
    teacher: Classifier,
    *,
    out: Path | None = None,
    restart: bool = False,
    checkpoint_every_s: float = CHECKPOINT_EVERY_S,
) -> RefinedNetworks:
    """Refine a network by its own answers, or take it up where an interrupted run of the same settings left it.

    What binds a booster to one network is in its sharp and brittle features; refined surrogates have fewer of them:
    slightly robust (Springer et al. 2021), flat (Foret et al. 2021; Izmailov et al. 2018), or many along a path of SGD
    at a high constant rate (LGV; Gubri et al. 2022).

    Args:
        config: every setting.
        workspace: whose `rig/classifiers` is written.
        teacher: the network, which is left as it is.
        out: folder for the networks instead of the workspace's.
        restart: forget what an earlier run left.
        checkpoint_every_s: how much work a kill may cost.

    Raises:
        ToolkitError: the network cannot be trained, or the data or a checkpoint cannot be used, or the disk is full.
    """
    if teacher.untrainable or is_program(teacher.arch):
        why = teacher.untrainable or "it is a program, and no weights of a network that can be built"
        raise FieldError(
            f"cannot be refined: {why}: expected a network of torchvision or timm", {"model": teacher.arch}
        )
    folder = out or workspace.classifiers_dir
    training = folder / ".training" / config.name
    if restart and current().is_first:
        shutil.rmtree(training, ignore_errors=True)
    sources = [open_photographs(one, HELD_OUT) for one in dict.fromkeys(config.data)]
    classes = keep_classes(sources, teacher, "model")
    stored = store_preprocessing(teacher.preprocessing, teacher.preprocessing.resize_px)
    with hold_folder(folder, f".{config.name}.lock"):
        data = load_training_set(sources, classes, stored, training, workers=1, every_class=False)
    held_out = len(data.held_out.images)
    notice(f"data: {len(data.train.images)} photographs to refine with, {held_out} held out")
    inputs_sha256 = sha256_bytes(
        json.dumps(
            [METHOD_VERSION, config.name, config.record(), teacher.arch, teacher.weights.sha256,
             teacher.preprocessing.describe(), data.train.sha256, data.held_out.sha256],
            sort_keys=True,
        ).encode()
    )  # fmt: skip
    inputs = RefineInputs(teacher, data, sources[0].held_out_words)
    task = RefineTask(config, inputs, folder, training, inputs_sha256)
    fitted = fit(
        task, config.fit_config(), Checkpoint(training, inputs_sha256, restart, checkpoint_every_s, ("data-*", KEPT))
    )
    return RefinedNetworks(config.name, folder, fitted.made, data.skipped, fitted.resumed_from, fitted.was_finished)
