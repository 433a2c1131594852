"""A half-trained texture on disk."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from toolkit.boosters.textures.optimiser import state_names
from toolkit.checkpoints import read_arrays, write_arrays

FORMAT = "toolkit texture checkpoint 1"
OWN = ("texture", "losses", "accuracies")


@dataclass(frozen=True)
class Checkpoint:
    """Where a run stands.

    Attributes:
        inputs_sha256: hash of everything that the run depends on; a run with another hash is another run.
        texture: θ, (3, n, n) float32, not dilated.
        losses, accuracies: (steps made,) float64, one per step.
        optimiser: its state by name, each of θ's shape.
    """

    inputs_sha256: str
    texture: np.ndarray
    losses: np.ndarray
    accuracies: np.ndarray
    optimiser: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def done(self) -> int:
        """How many steps have been made."""
        return len(self.losses)


def write_checkpoint(file: Path, state: Checkpoint) -> None:
    """Write it in one rename.

    Raises:
        ToolkitError: the disk is full or read-only.
    """
    arrays = {name: getattr(state, name) for name in OWN} | state.optimiser
    write_arrays(file, arrays, FORMAT, state.inputs_sha256, state.done)


def read_checkpoint(file: Path, inputs_sha256: str, optimiser: str) -> Checkpoint | None:
    """Read it, None where there is none.

    Raises:
        ToolkitError: it is damaged, or of other inputs.
    """
    names = state_names(optimiser)
    arrays = read_arrays(file, {*OWN, *names}, FORMAT, inputs_sha256)
    if arrays is None:
        return None
    kept = {name: arrays[name] for name in names}
    return Checkpoint(inputs_sha256, arrays["texture"], arrays["losses"], arrays["accuracies"], kept)
