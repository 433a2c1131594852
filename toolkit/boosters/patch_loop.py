"""The training loop on disk: it shows how it goes and can be killed at any moment."""

from dataclasses import dataclass
from pathlib import Path
from time import monotonic

import numpy as np

from toolkit.boosters.data import stack_on_device
from toolkit.boosters.mounted import MountedViews, draw_mounted
from toolkit.boosters.patch_config import PatchRequest
from toolkit.boosters.patch_steps import Step, Target, draw_first_patch, train_steps
from toolkit.core.console import progress
from toolkit.training.checkpoint import read_arrays, write_arrays

FORMAT = "toolkit patch checkpoint 2"


@dataclass(frozen=True)
class Checkpoint:
    """Where a run stands.

    Attributes:
        inputs_sha256: hash of everything that the run depends on; a run with another hash is another run.
        patch: θ, (3, n, n) float32.
        losses, accuracies: (steps made,) float64, one per step.
    """

    inputs_sha256: str
    patch: np.ndarray
    losses: np.ndarray
    accuracies: np.ndarray

    @property
    def done(self) -> int:
        """How many steps have been made."""
        return len(self.losses)


def write_checkpoint(file: Path, checkpoint: Checkpoint) -> None:
    """Write it in one rename.

    Raises:
        ToolkitError: the disk is full or read-only.
    """
    arrays: dict[str, np.ndarray] = {
        "patch": checkpoint.patch.astype(np.float32),
        "losses": checkpoint.losses.astype(np.float64),
        "accuracies": checkpoint.accuracies.astype(np.float64),
    }
    write_arrays(file, arrays, FORMAT, checkpoint.inputs_sha256, checkpoint.done)


def read_checkpoint(file: Path, inputs_sha256: str) -> Checkpoint | None:
    """Read it, None where there is none.

    Raises:
        ToolkitError: it is damaged, or of other inputs.
    """
    arrays = read_arrays(file, {"patch", "losses", "accuracies"}, FORMAT, inputs_sha256)
    return None if arrays is None else Checkpoint(inputs_sha256, **arrays)


CHECKPOINT_EVERY_S = 5.0
RECENT = slice(-10, None)
"""The steps whose mean is shown and recorded: one batch alone is noise."""


def make_steps(
    request: PatchRequest,
    targets: list[Target],
    images: np.ndarray,
    state: Checkpoint | None,
    inputs_sha256: str,
    file: Path,
    every_s: float = CHECKPOINT_EVERY_S,
    quiet: bool = False,
    views: MountedViews | None = None,
) -> Checkpoint:
    """Make the steps that are left; a checkpoint is written every few seconds, on Ctrl-C, and at the end.

    Args:
        request: what to train.
        targets: the networks.
        images: (k, s, s, 3) uint8 sRGB.
        state: where an earlier run stopped, None to begin.
        inputs_sha256: hash of the run's inputs.
        file: of the checkpoint.
        every_s: how much work a kill may cost, seconds.
        quiet: no progress bar.
        views: of the object with the sheet mounted on it.

    Raises:
        ToolkitError: the loss is not finite, or the disk is full.
    """
    import torch

    first, image_px = targets[0].classifier, targets[0].classifier.preprocessing.crop_px
    if state is None:
        start = draw_first_patch(request.size_px, request.descent.seed, request.descent.start_contrast).numpy()
        state = Checkpoint(inputs_sha256, start, np.zeros(0), np.zeros(0))
    losses, accuracies = list(state.losses), list(state.accuracies)
    last = Step(state.done, torch.from_numpy(np.array(state.patch)), 0.0, 0.0)

    def snapshot() -> Checkpoint:
        patch = last.patch.cpu().numpy()
        return Checkpoint(inputs_sha256, patch, np.array(losses[: last.done]), np.array(accuracies[: last.done]))

    steps = train_steps(
        last.patch,
        last.done,
        stack_on_device(images, first.device),
        targets,
        request.appearance(),
        request.descent,
        image_px,
        None if views is None else lambda draws, count: draw_mounted(views, draws, count, image_px),
        request.mounted_share,
        request.penalty(),
    )
    written = monotonic()
    title = f"Training {first.labels[targets[0].class_index]}"
    with progress(title, request.descent.steps, quiet, done=last.done) as bar:
        try:
            for step in steps:
                losses.append(step.loss)
                accuracies.append(step.accuracy)
                last = step
                bar.advance(note=f"loss {np.mean(losses[RECENT]):.3f}  recognised {np.mean(accuracies[RECENT]):.0%}")
                if monotonic() - written >= every_s:
                    write_checkpoint(file, snapshot())
                    written = monotonic()
        finally:
            # also when stopped or failed: what is done is kept, and a step that was cut short is not counted
            if last.done > state.done:
                write_checkpoint(file, snapshot())
    return snapshot()
