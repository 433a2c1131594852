"""Refine a network from its settings to files: what `toolkit refine-network` runs, and its task for the loop."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn.functional import cross_entropy, kl_div, log_softmax
from torch.nn.utils import clip_grad_norm_

from toolkit.core.console import notice, progress
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError
from toolkit.core.files import delete_file, delete_folder, read_json, write_bytes, write_json
from toolkit.core.records import hold_folder
from toolkit.core.work import INPUTS, Work, WorkResult, find_made
from toolkit.core.workspace import Workspace
from toolkit.models.architectures import list_architectures
from toolkit.models.find import AnswerCounts, ClassifierRecord, NetworkSet, Refinement, is_program
from toolkit.models.network import Classifier
from toolkit.models.precision import autocast, choose_precision
from toolkit.models.predict import predict
from toolkit.models.vision import torchvision
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.classifier import CHECKPOINT_EVERY_S
from toolkit.training.classifier_config import PHOTOGRAPHS, Attack
from toolkit.training.classifier_task import (
    TEST_PART,
    augment_batch,
    choose_images,
    find_finished,
    find_worst_images,
    halve_weights,
    load_tensors,
    measure_losses,
    summarise_answers,
    write_classifier,
)
from toolkit.training.data import TrainingSet, keep_classes, load_training_set, open_photographs, store_preprocessing
from toolkit.training.loop import History, TrainingTask, fit
from toolkit.training.processes import current
from toolkit.training.refine_config import HELD_OUT, LONGEST_GRADIENT, RefineConfig

KEPT = "path-*"
"""Files that are kept on the way, beside the checkpoints of the training."""
TEST_BATCH, TEST_EPS, TEST_STEPS, MOST_ATTACKED = 32, 0.5, 5, 100
"""Photographs at a time; the attack of the test, in l2; and how many of the held-out photographs it moves."""


def distill_loss(student: torch.Tensor, teacher: torch.Tensor, temperature: float) -> torch.Tensor:
    """KL of the student's answers from the teacher's, both softened; mean over (b, classes) logits, a scalar.

    Softmax of logits / T, times T², which keeps the size of the gradient (Hinton et al. 2015, section 2).
    """
    log_student, log_teacher = (log_softmax(logits / temperature, dim=1) for logits in (student, teacher))
    return kl_div(log_student, log_teacher, reduction="batchmean", log_target=True) * temperature**2


@dataclass(frozen=True)
class Tested:
    """A network's answers to the held-out photographs.

    Attributes:
        answers: (n,) classes.
        clean, attacked: these counted, and those under attack.
    """

    answers: np.ndarray
    clean: AnswerCounts
    attacked: AnswerCounts


@dataclass(frozen=True)
class RefineInputs:
    """Inputs of a refinement.

    Attributes:
        teacher: the network as it is.
        data: photographs.
        held_out_words: which of them are held out.
    """

    teacher: Classifier
    data: TrainingSet
    held_out_words: str


class RefineTask(TrainingTask[list[ClassifierRecord]]):
    """A copy of a network goes down the KL from the frozen network's answers to the same photographs.

    The copy sees varied views, the teacher the photograph as it is: of the same view both would say the same, and
    nothing would move. The copy stays in eval mode: batch normalisation goes by the statistics of the given weights,
    folded layers too, and nothing updates them.
    """

    work = Work("refinement", 1, old_at=0)
    recent = 50

    def __init__(self, config: RefineConfig, inputs: RefineInputs, folder: Path, kept: Path) -> None:
        """Begin with a copy of the teacher.

        Args:
            config: every setting.
            inputs: the teacher and its data.
            folder: where the networks are written.
            kept: folder of what is kept on the way.
        """
        self.config, self.inputs, self.folder, self.kept = config, inputs, folder, kept
        self.title = f"Refining {config.name}"
        self.advice = f"refine again with {{restart}} and a lower {{lr}} than {config.lr:g}"
        self.batch = min(config.batch, len(inputs.data.train.images))
        self.student = self._copy_teacher(is_trained=True)
        self._precision = "float32"
        self._views: tuple[int, torch.Tensor, torch.Tensor] | None = None
        is_averaged = config.flat == "swa"
        self._mean = {
            name: torch.zeros_like(value, requires_grad=False)
            for name, value in self.parameters().items() if is_averaged
        }  # fmt: skip

    def _copy_teacher(self, is_trained: bool) -> Classifier:
        module = deepcopy(self.inputs.teacher.module).requires_grad_(is_trained).eval()
        teacher = self.inputs.teacher
        return Classifier(
            teacher.arch, module, teacher.labels, teacher.preprocessing, teacher.weights, teacher.device,
            teacher.is_imagenet, name=self.config.name,
        )  # fmt: skip

    def list_inputs(self) -> list[Any]:
        """Settings, the teacher, and the photographs that it answers."""
        config, teacher, data = self.config, self.inputs.teacher, self.inputs.data
        return [
            config.name, config.record(), teacher.arch, teacher.weights.sha256, teacher.preprocessing.describe(),
            data.train.sha256, data.held_out.sha256,
        ]  # fmt: skip

    def parameters(self) -> dict[str, torch.Tensor]:
        """Weights and biases."""
        return dict(self.student.module.named_parameters())

    def buffers(self) -> dict[str, torch.Tensor]:
        """The mean of the weights, where they are averaged."""
        return {f"mean.{name}": value for name, value in self._mean.items()}

    def find_finished(self) -> list[ClassifierRecord] | None:
        """The records, where all weights are whole and of the same inputs."""
        found = [find_finished(self._file(name), self.key) for name in self.config.names]
        records = [record for record in found if record is not None]
        if len(records) < len(found):
            return None
        file = self.folder / f"{self.config.name}.json"
        is_whole = find_made(self.key, lambda: read_json(file, NetworkSet), lambda made: made.inputs_sha256) is not None
        return records if is_whole or len(found) == 1 else None

    @contextmanager
    def open(self) -> Iterator[None]:
        """Choose the precision."""
        teacher = self.inputs.teacher
        if teacher.arch in list_architectures():
            self._precision = choose_precision(teacher.arch, teacher.preprocessing.crop_px, teacher.device)
        yield

    def loss(self, step: int) -> tuple[torch.Tensor, dict[str, float]]:
        """KL from the teacher, and how often both give the same answer."""
        # SAM asks twice in a step, of the same views
        if self._views is None or self._views[0] != step:
            self._views = (step, *self._draw_views(step))
        _, views, wanted = self._views
        answers = self._ask(self.student, views)
        agreed = (answers.argmax(1) == wanted.argmax(1)).float().mean()
        return distill_loss(answers, wanted, self.config.temperature), {"agreement": float(agreed)}

    def _ask(self, network: Classifier, images: torch.Tensor) -> torch.Tensor:
        with autocast(self._precision, network.device):
            return network.logits(images).to(torch.float64 if images.dtype == torch.float64 else torch.float32)

    def _draw_views(self, step: int) -> tuple[torch.Tensor, torch.Tensor]:
        """This process's views of a step, robust views at their worst, and the teacher's answers to the photographs.

        The worst views are those at which the student is least sure of what the teacher answers.
        """
        pack, teacher = self.inputs.data.train, self.inputs.teacher
        chosen = choose_images(self.config.seed, step, self.config.batch, len(pack.images))
        raw = torch.from_numpy(np.ascontiguousarray(pack.images[chosen].transpose(0, 3, 1, 2))).to(teacher.device)
        rng = Draws(self.config.seed, step, self.work.kind).of("augmentation")
        # drawn for the whole batch, and then shared: the number of processes changes no view
        views = current().share(augment_batch(raw, rng, teacher.preprocessing.crop_px, PHOTOGRAPHS))
        middles = torchvision.transforms.functional.center_crop(raw, [teacher.preprocessing.crop_px] * 2)
        with torch.no_grad():
            wanted = self._ask(teacher, current().share(middles) / 255)
        if self.config.robust is not None:
            # the teacher's own answers stand for labels: none are needed
            labels = wanted.argmax(1)
            views = find_worst_images(
                views, lambda images: cross_entropy(self._ask(self.student, images), labels, reduction="none"),
                self.config.robust,
            )  # fmt: skip
        return views, wanted

    def adjust_gradients(self, step: int) -> None:
        """Cut their length (Pascanu et al. 2013): fixed statistics do not damp a large step as a batch's own would."""
        clip_grad_norm_(self.parameters().values(), LONGEST_GRADIENT)

    def watch(self, step: int) -> None:
        """Add the weights to their mean (Izmailov et al. 2018, algorithm 1), or keep them where a network is due."""
        number = step - self.config.first_averaged + 1
        if number >= 1:
            for name, value in self.parameters().items():
                if name in self._mean:
                    # a running mean: the k-th weights move it by 1/k of the way
                    self._mean[name].lerp_(value, 1 / number)
        if step + 1 in self.config.kept_steps[:-1] and current().is_first:
            write_bytes(self._kept_file(step + 1), _pack(self.student))

    def _kept_file(self, step: int) -> Path:
        return self.kept / f"{KEPT[:-1]}{self.key[:16]}-{step:07d}"

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}.safetensors"

    def finish(self, history: History) -> list[ClassifierRecord]:
        """Test what is written, in half precision, and write each network and its record; of several the set last."""
        # an average of the last steps takes the place of the last step
        with torch.no_grad():
            for name, value in self.parameters().items():
                if name in self._mean:
                    value.copy_(self._mean[name])
        # networks along the path were kept when they were reached
        contents = [self._read_kept(step) for step in self.config.kept_steps[:-1]] + [_pack(self.student)]
        names, (n, attacked) = self.config.names, self._count_tested()
        # the teacher is tested in the same way, for the comparison
        with progress("Testing on held-out photographs", (n + attacked) * (len(names) + 1)) as bar:
            before = self._test(self.inputs.teacher, bar.advance, None)
            records = []
            for name, step, content in zip(names, self.config.kept_steps, contents, strict=True):
                after = self._test(self._unpack(content), bar.advance, before.answers)
                records.append(self._write(name, content, step, before, after, history))
        if len(names) > 1:
            whole = NetworkSet(name=self.config.name, networks=names, inputs_sha256=self.key)
            # a network of this name, of an earlier run, would be found in the place of the set
            delete_file(self._file(self.config.name))
            write_json(self.folder / f"{self.config.name}.json", whole.model_dump(mode="json", exclude={"turns"}))
        return records

    def _read_kept(self, step: int) -> bytes:
        file = self._kept_file(step)
        if not file.is_file():
            raise FieldError(f"{file} is missing, the network of step {step}: refine again with {{restart}}", {})
        return file.read_bytes()

    def _unpack(self, content: bytes) -> Classifier:
        from safetensors.torch import load

        network = self._copy_teacher(is_trained=False)
        load_tensors(network.module, load(content))
        return network

    def _count_tested(self) -> tuple[int, int]:
        n = len(self.inputs.data.held_out.images)
        return n, min(n, MOST_ATTACKED)

    @property
    def test_attack(self) -> Attack:
        """The attack that networks are tested under."""
        return Attack(norm="l2", eps=TEST_EPS, steps=TEST_STEPS)

    def _test(self, network: Classifier, advance: Callable[[int], None], taught: np.ndarray | None) -> Tested:
        """Answers to the held-out photographs and to the first of them when attacked, in single precision.

        `taught` are the teacher's answers, None where it is tested itself.
        """
        pack, (n, most) = self.inputs.data.held_out, self._count_tested()
        clean, moved = (np.zeros(count, np.int64) for count in (n, most))
        for start in range(0, n, TEST_BATCH):
            part = slice(start, start + TEST_BATCH)
            batch = torch.stack([network.preprocess(image) for image in pack.images[part]]).to(network.device)
            clean[part] = predict(batch, network, part=TEST_PART).argmax(1).numpy()
            advance(len(batch))
            # the attack costs many times an answer: the first photographs alone are moved
            some = batch[: max(most - start, 0)]
            if len(some):
                classes = torch.from_numpy(np.array(pack.classes[part][: len(some)])).to(network.device)
                worst = find_worst_images(some, partial(measure_losses, network, classes), self.test_attack)
                moved[start : start + len(some)] = predict(worst, network, part=TEST_PART).argmax(1).numpy()
                advance(len(some))
        # agreement with the teacher's answers, whatever is correct
        taught = clean if taught is None else taught
        return Tested(clean, _count(clean, pack.classes, taught), _count(moved, pack.classes[:most], taught[:most]))

    def _write(
        self, name: str, content: bytes, step: int, before: Tested, after: Tested, history: History
    ) -> ClassifierRecord:
        teacher, data = self.inputs.teacher, self.inputs.data
        refined = Refinement(
            teacher=teacher.name, teacher_sha256=teacher.weights.sha256, attack=self.test_attack.record(),
            before=before.clean, after=after.clean, before_attacked=before.attacked, after_attacked=after.attacked,
            step=step,
        )  # fmt: skip
        own = {"precision": self._precision, INPUTS: self.key}
        return write_classifier(
            self._file(name), content, teacher.preprocessing, arch=teacher.arch,
            trained_on=self.config.words(teacher.name), labels=list(teacher.labels), data=data.record,
            seed=self.config.seed, settings=self.config.record() | own, final=history.recent(self.recent),
            refined=refined, held_out=summarise_answers(
                teacher.labels, data.held_out.classes, after.answers, self.inputs.held_out_words
            ),
        )  # fmt: skip


def _pack(network: Classifier) -> bytes:
    from safetensors.torch import save

    return save(halve_weights(network.module.state_dict()))


def _count(answers: np.ndarray, classes: np.ndarray, taught: np.ndarray) -> AnswerCounts:
    return AnswerCounts(n=len(answers), correct=int((answers == classes).sum()), agreed=int((answers == taught).sum()))


@dataclass(frozen=True, kw_only=True)
class RefinedNetworks(WorkResult):
    """Result of a run.

    Attributes:
        name: that `--model` takes for all of them.
        folder: of their files.
        records: of each network.
    """

    name: str
    folder: Path
    records: list[ClassifierRecord]

    def as_json(self) -> dict[str, Any]:
        """All of it for a script."""
        return {
            "model": self.name,
            "files": [str(self.folder / f"{record.name}.safetensors") for record in self.records],
            **self.describe_run(),
            "records": [record.model_dump(mode="json") for record in self.records],
        }

    def lines(self) -> Iterator[str]:
        """The same for people."""
        if self.was_finished:
            yield f"{self.name} was refined with these inputs before: nothing to do; --restart refines it again"
        for record in self.records:
            if record.refined is not None:
                refined = record.refined
                attack = f"{refined.attack['norm']} {refined.attack['eps']:g}"
                yield f"{record.name}: held-out photographs, {_compare(refined.before, refined.after)}"
                yield f"  under attack ({attack}), {_compare(refined.before_attacked, refined.after_attacked)}"
        yield f"next: toolkit train-patch --object OBJECT --model {self.name}"


def _compare(before: AnswerCounts, after: AnswerCounts) -> str:
    agreed = f"as the network before {before.agreed} → {after.agreed}"
    return f"correct {before.correct} → {after.correct} of {after.n}, {agreed}"


def refine_network(
    config: RefineConfig, workspace: Workspace, teacher: Classifier, *, out: Path | None = None, restart: bool = False,
    checkpoint_every_s: float = CHECKPOINT_EVERY_S,
) -> RefinedNetworks:  # fmt: skip
    """Refine a network by its own answers, or take it up where an interrupted run of the same settings left it.

    What binds a booster to a network is in its sharp and brittle features; refined surrogates have fewer of them:
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
    # only a network that can be built again can be refined
    if teacher.untrainable or is_program(teacher.arch):
        why = teacher.untrainable or "it is a program, and no weights of a network that can be built"
        raise FieldError(
            f"cannot be refined: {why}: expected a network of torchvision or timm", {"model": teacher.arch}
        )
    folder = out or workspace.classifiers_dir
    training = folder / ".training" / config.name
    if restart and current().is_first:
        delete_folder(training)
    # photographs of the teacher's classes, in the teacher's preprocessing
    sources = [open_photographs(photographs, HELD_OUT) for photographs in dict.fromkeys(config.data)]
    classes = keep_classes(sources, teacher, "model")
    stored = store_preprocessing(teacher.preprocessing, teacher.preprocessing.resize_px)
    with hold_folder(folder, f".{config.name}.lock"):
        data = load_training_set(sources, classes, stored, training, workers=1, every_class=False)
    held_out = len(data.held_out.images)
    notice(f"data: {len(data.train.images)} photographs to refine with, {held_out} held out")
    inputs = RefineInputs(teacher, data, sources[0].held_out_words)
    # decoded data and the networks along the path are shared by all runs of this name
    task = RefineTask(config, inputs, folder, training)
    fitted = fit(
        task, config.fit_config(), Checkpoint(training, task.key, restart, checkpoint_every_s, ("data-*", KEPT))
    )
    return RefinedNetworks(
        name=config.name, folder=folder, records=fitted.made, skipped=data.skipped, resumed_from=fitted.resumed_from,
        was_finished=fitted.was_finished,
    )  # fmt: skip
