"""The training loop: steps, checkpoints at any moment, resuming to the same bytes, and the finish.

A `TrainingTask` gives the parameters, and the loss of step i, which depends on the parameters and on (seed, i) alone.
`fit` does the rest, in a single process or in those that torchrun started.
"""

import signal
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from math import cos, isfinite, pi
from time import monotonic
from typing import Any, Generic, TypeVar

from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError, one_of
from toolkit.core.files import delete_file
from toolkit.core.lazy import np, torch
from toolkit.core.records import hold_folder
from toolkit.core.work import Work
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.processes import EndedElsewhere, current, follow, lead

OPTIMISERS = ("sign", "sgd", "adam")
SCHEDULES = ("constant", "linear", "cosine", "one-cycle")
LAST_LR_SHARE = 0.05
"""Lowest learning rate of the falling schedules, as a share of the highest. For pixels it is half an 8-bit level."""
# torch's OneCycleLR by default: 1/25 of the highest rate at first, and 1e-4 of that at last
CYCLE_FIRST_SHARE, CYCLE_LAST_SHARE = 0.04, 1e-4
TINY = 1e-12
LOSS = "loss"
SHOWN = {"accuracy": "recognised {:.0%}"}
Made = TypeVar("Made")


@dataclass(frozen=True)
class FitConfig:
    """How parameters go down the gradient of a loss.

    Attributes:
        steps: how many.
        lr: the highest learning rate.
        schedule: how it goes over the steps: `constant`; `linear` and `cosine` fall to a twentieth; `one-cycle` rises
            and falls by two half cosines (Smith and Topin 2017).
        optimiser: `sign` moves each number by lr against the sign of its gradient; `sgd` and `adam` are torch's.
        seed: of every random draw.
        warm_up: of `one-cycle`, the share of the steps in which the learning rate rises.
        momentum, nesterov: of `sgd`.
        weight_decay: of `sgd` and `adam`, for parameters of two dimensions or more, not for biases and normalisation.
        rho: length by which parameters go up the gradient before the gradient that moves them is taken, for a flat
            minimum (SAM; Foret et al. 2021, equations 2 and 3); 0: it is taken where they are. A step then costs two.
    """

    steps: int
    lr: float
    schedule: str = "constant"
    optimiser: str = "sgd"
    seed: int = 0
    warm_up: float = 0.2
    momentum: float = 0.9
    nesterov: bool = False
    weight_decay: float = 0.0
    rho: float = 0.0

    def __post_init__(self) -> None:
        if self.optimiser not in OPTIMISERS:
            raise one_of("optimiser", self.optimiser, list(OPTIMISERS))
        if self.schedule not in SCHEDULES:
            raise one_of("schedule", self.schedule, list(SCHEDULES))
        if self.steps < 1:
            raise FieldError("expected at least 1", {"steps": self.steps})

    def lr_at(self, step: int) -> float:
        """Learning rate of a step, counted from 0."""
        if self.schedule == "one-cycle":
            return self.lr * self._cycle_at(step)
        done = step / self.steps
        fall = {"constant": 1.0, "linear": 1 - done, "cosine": (1 + cos(pi * done)) / 2}[self.schedule]
        return self.lr * (LAST_LR_SHARE + (1 - LAST_LR_SHARE) * fall)

    def _cycle_at(self, step: int) -> float:
        # a run of few steps may have no warm-up: nothing is divided by 0
        peak = max(self.warm_up * self.steps - 1, 1e-9)
        last = max(self.steps - 1, 1)
        if step <= peak:
            low, high, done = CYCLE_FIRST_SHARE, 1.0, step / peak
        else:
            low, high, done = 1.0, CYCLE_FIRST_SHARE * CYCLE_LAST_SHARE, (step - peak) / max(last - peak, 1e-9)
        return high + (low - high) * (1 + cos(pi * done)) / 2


class History:
    """Figures of every step made, the loss among them."""

    def __init__(self, figures: Mapping[str, list[float]] | None = None) -> None:
        self.figures = {name: list(values) for name, values in (figures or {}).items()}

    def __len__(self) -> int:
        return len(self.figures.get(LOSS, ()))

    def append(self, figures: Mapping[str, float]) -> None:
        """Add the values of another step."""
        for name, value in figures.items():
            self.figures.setdefault(name, []).append(value)

    def recent(self, count: int) -> dict[str, float]:
        """Means over the last steps, the loss first: a single batch is noise."""
        names = sorted(self.figures, key=lambda name: (name != LOSS, name))  # the same whether or not it was resumed
        return {name: float(np.mean(self.figures[name][-count:])) for name in names}


class TrainingTask(ABC, Generic[Made]):
    """A training for `fit`.

    Attributes:
        work: kind and version of the task: checkpoints are read by the same kind only, and its draws are its own.
        title: above the progress bar.
        advice: what to do where the loss is no number; fields in braces, see `FieldError`.
        recent: steps whose mean is shown and recorded.
        batch: items of a step, of whose loss several processes find their part each, see `Processes.part`; 0: one
            process alone can train it.
    """

    work: Work
    title: str = "Training"
    advice: str = "check the data, or take a lower {lr}"
    recent: int = 10
    batch: int = 0

    @cached_property
    def key(self) -> str:
        """Key of the result, by which an interrupted run resumes and a finished one is found."""
        return self.work.key(*self.list_inputs())

    def list_inputs(self) -> list[Any]:
        """All that decides the result, as JSON; a task needs them if its result is kept."""
        raise TypeError(f"{type(self).__name__} keeps its result, so it must define list_inputs")

    @abstractmethod
    def parameters(self) -> Mapping[str, "torch.Tensor"]:
        """Leaf tensors by name, which the loop moves in place."""

    @abstractmethod
    def loss(self, step: int) -> "tuple[torch.Tensor, dict[str, float]]":
        """The loss of a step, a scalar, and further figures for the history.

        It depends on the parameters, the buffers and on (seed, step) alone; torch's own generator is seeded before.
        Each of several processes gives the mean over its part of the batch. With `FitConfig.rho` a step asks twice.
        """

    @abstractmethod
    def finish(self, history: History) -> Made:
        """Make the result of the trained parameters, and write it."""

    def buffers(self) -> "Mapping[str, torch.Tensor]":
        """Tensors that the loss itself changes, such as the statistics of batch normalisation; kept as well."""
        return {}

    def find_finished(self) -> Made | None:
        """The result, where an earlier run of the same inputs has finished it."""
        return None

    def describe(self) -> list[str]:
        """Active settings of this run, for the user."""
        return []

    def open(self) -> AbstractContextManager[object]:
        """Entered before the first step and left after `finish`: for processes that serve the run."""
        return nullcontext()

    def begin(self) -> None:
        """Called before the very first step, not when a run resumes."""

    def adjust_gradients(self, step: int) -> None:
        """Change the parameters' `grad` before they are moved."""

    def constrain(self) -> None:
        """Put the moved parameters back to where they are allowed."""

    def watch(self, step: int) -> None:
        """Look at the parameters that the step has moved: to add them to a mean in `buffers`, or to keep a copy."""

    def show(self) -> None:
        """Draw how far it is; called at every checkpoint, and after the last step."""


@dataclass(frozen=True)
class Fitted(Generic[Made]):
    """What `fit` made.

    Attributes:
        made: the task's result.
        resumed_from: steps that an earlier run had made; all of them when it was finished before.
        was_finished: whether there was nothing left to do.
    """

    made: Made
    resumed_from: int
    was_finished: bool


def fit(task: TrainingTask[Made], config: FitConfig, checkpoint: Checkpoint | None = None) -> Fitted[Made]:
    """Train, or resume an interrupted run of the same inputs: the result is the same to the byte.

    Args:
        task: what is trained.
        config: how.
        checkpoint: where the state is kept: every few seconds, on Ctrl-C and at the end; None keeps nothing.

    Raises:
        ToolkitError: the loss is not finite, the checkpoint cannot be used, the disk is full, the processes cannot
            share the task, or the task's own.
    """
    # several processes: the first keeps the state, the others follow
    if current().count > 1:
        current().check(task.batch, next(iter(task.parameters().values())).device)
    # the others start when the first has read and rendered
    if not current().is_first:
        fitted = _fit(task, config, None)
        follow()
        return fitted
    lead()
    if checkpoint is None:
        return _fit(task, config, None)
    # beside the folder of all runs, which the last run removes
    with hold_folder(checkpoint.folder.parent.parent, f".{checkpoint.file.stem}.lock"):
        return _fit(task, config, checkpoint)


def _fit(task: TrainingTask[Made], config: FitConfig, checkpoint: Checkpoint | None) -> Fitted[Made]:
    # a restart forgets the checkpoint, and does not look for a finished run
    def find_finished() -> Made | None:
        if checkpoint is not None and checkpoint.restart:
            delete_file(checkpoint.file)
            return None
        return task.find_finished()

    # a finished run is returned as it is
    finished = current().ask_first(find_finished)
    if finished is not None:
        if checkpoint is not None:
            checkpoint.remove()
        return Fitted(finished, config.steps, True)
    from toolkit.core.console import notice

    for line in task.describe():
        notice(line)
    # an interrupted run resumes at its checkpoint
    state = current().ask_first(lambda: None if checkpoint is None else checkpoint.read(task.work.kind))
    run = _Fitting(task, config)
    if state is not None:
        run.restore(state)
    resumed_from = len(run.history)
    if checkpoint is not None:
        checkpoint.announce(resumed_from, config.steps)
    with task.open():
        if not resumed_from:
            task.begin()
        # noise and checkpoint are the first process's own: the others begin where it does
        current().copy_first([*task.parameters().values(), *task.buffers().values()])
        _make_and_keep_steps(run, checkpoint)
        made = current().ask_first(lambda: task.finish(run.history))
    if checkpoint is not None:
        checkpoint.remove()
    return Fitted(made, resumed_from, False)


def make_steps(task: TrainingTask[Made], config: FitConfig) -> Iterator[None]:
    """Yield after each step, without progress, checkpoints and finish; for measurements."""
    with task.open():
        task.begin()
        yield from _Fitting(task, config).steps()


def _make_and_keep_steps(run: "_Fitting", checkpoint: Checkpoint | None) -> None:
    """Those that are left, with a progress bar and checkpoints."""
    from toolkit.core.console import progress

    task, history = run.task, run.history
    kept, kept_at = len(history), monotonic()

    def keep() -> None:
        if checkpoint is not None:
            checkpoint.write(run.state(), task.work.kind, len(history))

    with progress(task.title, run.config.steps, done=kept) as bar:
        try:
            for _ in run.steps():
                bar.advance(note=_note(history.recent(task.recent)))
                if checkpoint is not None and monotonic() - kept_at >= checkpoint.every_s:
                    keep()
                    kept = len(history)
                    current().act_first(task.show)
                    kept_at = monotonic()
        finally:
            # also when stopped or failed: what is done is kept
            if len(history) > kept:
                keep()
    current().act_first(task.show)


def _note(figures: Mapping[str, float]) -> str:
    loss = f"{LOSS} {figures[LOSS]:.3f}"
    others = {name: value for name, value in figures.items() if name != LOSS}
    return "  ".join([loss, *(SHOWN.get(name, name + " {:.3g}").format(value) for name, value in others.items())])


class _Fitting:
    """A task, its optimiser and its history, which are always those of the same step."""

    def __init__(self, task: TrainingTask, config: FitConfig) -> None:
        self.task, self.config, self.history = task, config, History()
        self._parameters = dict(task.parameters())
        self._optimiser = _make_optimiser(list(self._parameters.values()), config)

    def steps(self) -> Iterator[None]:
        """Make the steps from the history's end to the last, a step per turn; an interrupted step is not counted.

        Ctrl-C comes before the parameters are moved or after, never in between.
        """
        before: dict[str, torch.Tensor] = {}
        with torch.random.fork_rng(devices=[]):
            try:
                for step in range(len(self.history), self.config.steps):
                    # what the loss changes is put back where the step is cut short
                    before = {name: value.clone() for name, value in self.task.buffers().items()}
                    figures = self._find_gradients(step)
                    # sharpness-aware (SAM; Foret et al. 2021): the gradient is taken uphill, the step is made from
                    # where it was
                    if self.config.rho:
                        with self._climbed():
                            self._find_gradients(step)
                    with _hold_interrupts():
                        self._move(step)
                        self.history.append(figures)
                        before = {}
                    yield
            finally:
                for name, value in before.items():
                    self.task.buffers()[name].copy_(value)

    def _find_gradients(self, step: int) -> dict[str, float]:
        draw = int(Draws(self.config.seed, step, self.task.work.kind).of("dropout").integers(2**62))
        # of dropout: another mask in each process, the same masks when the run resumes
        torch.manual_seed(draw + current().rank)
        for parameter in self._parameters.values():
            # every gradient begins at none: the paper's release never zeroed the patch's
            parameter.grad = None
        loss, figures = self.task.loss(step)
        # to the parameters alone: networks keep no gradients of their weights
        loss.backward(inputs=list(self._parameters.values()))
        found = [parameter.grad for parameter in self._parameters.values() if parameter.grad is not None]
        current().average(found)
        largest = torch.stack([gradient.abs().max().double() for gradient in found]).max()
        figures = current().average_figures({LOSS: loss.item(), **figures})
        if not (isfinite(figures[LOSS]) and isfinite(largest.item())):
            if not current().is_first:
                raise EndedElsewhere("the loss is not finite")
            raise FieldError(
                f"the loss or its gradient at step {step + 1} is not a finite number (loss {figures[LOSS]}): "
                f"{self.task.advice}",
                {},
            )
        return figures

    @contextmanager
    def _climbed(self) -> Iterator[None]:
        """Within, the parameters lie `rho` up their gradient, the way by which the loss rises fastest."""
        # the parameters come back afterwards, to the bit
        before = {name: value.detach().clone() for name, value in self._parameters.items()}
        found = {name: value.grad for name, value in self._parameters.items() if value.grad is not None}
        # the length over all parameters together
        length = torch.stack([gradient.norm() for gradient in found.values()]).norm().clamp_min(TINY)
        try:
            with torch.no_grad():
                for name, gradient in found.items():
                    self._parameters[name].add_(gradient * (self.config.rho / length))
            yield
        finally:
            with torch.no_grad():
                for name, value in before.items():
                    self._parameters[name].copy_(value)

    def _move(self, step: int) -> None:
        lr = self.config.lr_at(step)
        with torch.no_grad():
            # the task's own changes first, such as cutting gradients
            self.task.adjust_gradients(step)
            if self._optimiser is None:
                for parameter in self._parameters.values():
                    if parameter.grad is not None:
                        parameter.sub_(lr * parameter.grad.sign())
            else:
                for group in self._optimiser.param_groups:
                    group["lr"] = lr
                self._optimiser.step()
            # the task's bounds, such as colours between 0 and 1
            self.task.constrain()
            self.task.watch(step)

    def state(self) -> "dict[str, np.ndarray]":
        """All that a later run needs to go on: parameters, buffers, the optimiser's state, the history."""
        tensors = {f"parameter.{name}": value for name, value in self._parameters.items()}
        tensors |= {f"buffer.{name}": value for name, value in self.task.buffers().items()}
        if self._optimiser is not None:
            for name, parameter in self._parameters.items():
                own = {key: value for key, value in self._optimiser.state[parameter].items() if value is not None}
                tensors |= {f"optimiser.{key}.{name}": value for key, value in own.items()}
        arrays = {name: value.detach().cpu().contiguous().numpy() for name, value in tensors.items()}
        return arrays | {f"history.{name}": np.array(values) for name, values in self.history.figures.items()}

    def restore(self, arrays: "Mapping[str, np.ndarray]") -> None:
        """Take up what `state` gave."""
        own: dict[str, torch.Tensor] = {f"parameter.{name}": value for name, value in self._parameters.items()}
        own |= {f"buffer.{name}": value for name, value in self.task.buffers().items()}
        with torch.no_grad():
            for name, tensor in own.items():
                tensor.copy_(torch.from_numpy(np.array(arrays[name])))
        # the history's numbers, and the optimiser's moments of each parameter
        for path, array in arrays.items():
            kind, _, name = path.partition(".")
            if kind == "history":
                self.history.figures[name] = array.tolist()
            elif kind == "optimiser" and self._optimiser is not None:
                key, _, name = name.partition(".")
                parameter, value = self._parameters[name], torch.from_numpy(np.array(array))
                # in the layout of its parameter: sums in another order would round otherwise
                is_like = value.shape == parameter.shape and value.ndim > 0
                self._optimiser.state[parameter][key] = torch.empty_like(parameter).copy_(value) if is_like else value


def _make_optimiser(parameters: "list[torch.Tensor]", config: FitConfig) -> "torch.optim.Optimizer | None":
    """None for `sign`, which has no state."""
    decayed = [parameter for parameter in parameters if parameter.ndim > 1]
    others = [parameter for parameter in parameters if parameter.ndim <= 1]
    groups = [{"params": decayed, "weight_decay": config.weight_decay}, {"params": others, "weight_decay": 0.0}]
    groups = [group for group in groups if group["params"]]
    if config.optimiser == "sgd":
        return torch.optim.SGD(groups, lr=config.lr, momentum=config.momentum, nesterov=config.nesterov)
    return torch.optim.Adam(groups, lr=config.lr) if config.optimiser == "adam" else None


@contextmanager
def _hold_interrupts() -> Iterator[None]:
    """Ctrl-C waits until it is left."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals go to the main thread
        return
    held: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: held.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before or signal.SIG_DFL)
        if held:
            signal.raise_signal(signal.SIGINT)
