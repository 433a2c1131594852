"""A half-trained patch on disk."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toolkit.checkpoints import read_arrays, write_arrays

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
