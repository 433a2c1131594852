"""Train a classifier from its settings to files: what `toolkit train-classifier` runs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolkit.core.console import notice
from toolkit.core.errors import FieldError
from toolkit.core.files import delete_folder
from toolkit.core.records import hold_folder
from toolkit.core.text import join_words
from toolkit.core.work import WorkResult
from toolkit.core.workspace import Workspace
from toolkit.models.find import ClassifierRecord
from toolkit.models.load import load_classifier
from toolkit.models.network import choose_device
from toolkit.models.weights import WeightsFile, find_weights
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.classifier_config import ClassifierConfig, ClassPictures, check_fit
from toolkit.training.classifier_task import ClassifierInputs, ClassifierTask
from toolkit.training.data import (
    DataSource,
    RenderCounts,
    TrainingSet,
    keep_classes,
    list_classes,
    load_training_set,
    open_source,
    store_preprocessing,
)
from toolkit.training.loop import fit
from toolkit.training.processes import current

CHECKPOINT_EVERY_S = 30.0
RENDERS = ("data-*",)
"""Folders beside the checkpoints that other runs may need."""


@dataclass(frozen=True, kw_only=True)
class TrainedClassifier(WorkResult):
    """Result of a run.

    Attributes:
        file: the weights; the record lies beside them.
        record: how they came to be.
    """

    file: Path
    record: ClassifierRecord

    def as_json(self) -> dict[str, Any]:
        """All of it for a script."""
        return {"classifier": str(self.file), **self.describe_run(), "record": self.record.model_dump(mode="json")}

    def lines(self) -> Iterator[str]:
        """What it is, or that it was there."""
        if self.was_finished:
            yield self.was_there(self.file)
        else:
            size_mb, record = self.file.stat().st_size / 1e6, self.record
            yield f"{self.file}: {record.arch}, {len(record.labels)} classes, {size_mb:.1f} MB"


def train_classifier(
    config: ClassifierConfig, workspace: Workspace, pictures: ClassPictures | None = None, *, out: Path | None = None,
    device: str = "auto", workers: int = 1, download: bool = False, restart: bool = False, keep_data: bool = False,
    checkpoint_every_s: float = CHECKPOINT_EVERY_S,
) -> TrainedClassifier:  # fmt: skip
    """Train a classifier, or take it up where an interrupted run of the same settings left it.

    Args:
        config: every setting.
        workspace: whose objects are rendered and whose `rig/classifiers` is written.
        pictures: what every image carries by its class.
        out: folder for the classifier instead of the workspace's.
        device: `auto`, `cpu` or `cuda`.
        workers: processes that render.
        download: fetch CIFAR-10 where it is named and not there.
        restart: forget what an earlier run left.
        keep_data: keep the rendered and decoded images afterwards, for another training.
        checkpoint_every_s: how much work a kill may cost.

    Raises:
        ToolkitError: the settings, the data or a checkpoint cannot be used, or the disk is full.
    """
    device = choose_device(device)
    # the folder of the network, and of what is kept on the way
    folder = out or workspace.classifiers_dir
    training = folder / ".training" / config.name
    # a single process deletes, however many train
    if restart and current().is_first:
        delete_folder(training)
    # what is learnt, and from which weights
    init = None if config.init is None else find_weights(config.arch, config.init)
    counts = RenderCounts(config.per_class, config.views, config.held_out, config.seed, config.stored_px)
    sources = open_sources(config.data, workspace, counts, download)
    # with the start's own labels, only its classes may be in the data
    kept = load_classifier(config.arch, config.init, "cpu") if config.keep_labels else None
    classes = list_classes(sources) if kept is None else keep_classes(sources, kept)
    # fail before the photographs are decoded, which may take minutes
    check_fit(config.arch, len(classes.labels), config.image_px)
    # stored a little larger than the network sees them, so that training can cut at random
    stored = store_preprocessing(config.preprocessing(), config.stored_px)
    # another run of the same name waits until the photographs are decoded
    with hold_folder(folder, f".{config.name}.lock"):
        data = load_training_set(sources, classes, stored, training, workers)
    describe_data(data, sources)
    inputs = ClassifierInputs(data, classes.used, pictures, init, _name_data(config, sources, pictures, init))
    task = ClassifierTask(config, inputs, folder / f"{config.name}.safetensors", device)
    checkpoint = Checkpoint(training, task.key, restart, checkpoint_every_s, () if keep_data else RENDERS)
    fitted = fit(task, config.fit_config(len(data.train.images)), checkpoint)
    return TrainedClassifier(
        file=task.file, record=fitted.made, skipped=data.skipped, resumed_from=fitted.resumed_from,
        was_finished=fitted.was_finished,
    )  # fmt: skip


def open_sources(data: Sequence[str], workspace: Workspace, counts: RenderCounts, download: bool) -> list[DataSource]:
    """What each `--data` offers.

    Raises:
        ToolkitError: there is none, or as `open_source`.
    """
    if not data:
        raise FieldError(
            "no {data}: expected 'everyday', 'rig', cifar10:FOLDER, or a folder with one folder per class", {}
        )
    return [open_source(one, workspace, counts, download) for one in dict.fromkeys(data)]


def describe_data(data: TrainingSet, sources: list[DataSource]) -> None:
    """Print what is trained on and what is held out."""
    for source in sources:
        notice(f"data: {source.words}")
    notice(
        f"data: {len(data.train.images)} images of {len(data.labels)} classes to train on, "
        f"{len(data.held_out.images)} held out ({'; '.join(dict.fromkeys(s.held_out_words for s in sources))})"
    )


def _name_data(
    config: ClassifierConfig, sources: list[DataSource], pictures: ClassPictures | None, init: WeightsFile | None
) -> tuple[str, str]:
    """The training data and how the held-out images differ, in a few words each."""
    words = join_words(source.words for source in sources)
    held_out = "; ".join(dict.fromkeys(source.held_out_words for source in sources))
    if pictures is not None:
        words, held_out = (f"{each}, each with {pictures.words}" for each in (words, held_out))
    if config.corrupting is not None:
        words += f", {config.corrupting.share:.0%} of them corrupted"
    if config.robust is not None:
        words += f", each moved to where its loss is largest ({config.robust.describe()})"
    return words + (f", from the weights {init.name}" if init else ""), held_out
