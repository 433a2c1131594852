"""A half-trained network on disk."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.checkpoints import read_arrays, write_arrays

FORMAT = "toolkit classifier checkpoint 2"
HISTORY = "history"


@dataclass(frozen=True)
class Checkpoint:
    """Where a run stands.

    Attributes:
        inputs_sha256: hash of everything that the run depends on; a run with another hash is another run.
        tensors: what `Fit.state` gave.
        losses, accuracies: one per step made.
    """

    inputs_sha256: str
    tensors: Mapping[str, Any]
    losses: tuple[float, ...]
    accuracies: tuple[float, ...]


def write_checkpoint(file: Path, checkpoint: Checkpoint) -> None:
    """Write it in one rename.

    Raises:
        ToolkitError: the disk is full or read-only.
    """
    history = np.array([checkpoint.losses, checkpoint.accuracies], np.float64)
    arrays = {name: tensor.numpy() for name, tensor in checkpoint.tensors.items()} | {HISTORY: history}
    write_arrays(file, arrays, FORMAT, checkpoint.inputs_sha256, len(checkpoint.losses))


def read_checkpoint(file: Path, inputs_sha256: str) -> Checkpoint | None:
    """Read it, None where there is none.

    Raises:
        ToolkitError: it is damaged, or of other inputs.
    """
    import torch

    arrays = read_arrays(file, {HISTORY}, FORMAT, inputs_sha256)
    if arrays is None:
        return None
    losses, accuracies = (tuple(row) for row in arrays.pop(HISTORY).tolist())
    tensors = {name: torch.from_numpy(np.array(array)) for name, array in arrays.items()}
    return Checkpoint(inputs_sha256, tensors, losses, accuracies)
