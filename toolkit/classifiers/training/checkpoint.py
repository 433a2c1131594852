"""A half-trained network on disk: one safetensors file, so that it is whole or absent whenever the process dies."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolkit.errors import ToolkitError
from toolkit.files import write_bytes

FORMAT = "toolkit classifier checkpoint 1"


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
    import torch
    from safetensors.torch import save

    history = torch.tensor([checkpoint.losses, checkpoint.accuracies], dtype=torch.float64)
    about = {"format": FORMAT, "inputs_sha256": checkpoint.inputs_sha256}
    write_bytes(file, save({**checkpoint.tensors, "history": history}, {"toolkit": json.dumps(about)}))


def read_checkpoint(file: Path, inputs_sha256: str) -> Checkpoint | None:
    """Read it, None where there is none.

    Raises:
        ToolkitError: it is damaged, or of other inputs.
    """
    from safetensors import SafetensorError, safe_open

    if not file.is_file():
        return None
    mend = "delete it, or run the same command with --restart"
    try:
        with safe_open(file, "pt") as stored:
            about = json.loads((stored.metadata() or {})["toolkit"])
            tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118 (no mapping)
        losses, accuracies = (tuple(row) for row in tensors.pop("history").tolist())
        if about["format"] != FORMAT or about["inputs_sha256"] != inputs_sha256:
            raise ToolkitError(f"checkpoint {file} is of a run with other inputs: {mend}")
    except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else error.__class__.__name__
        raise ToolkitError(f"checkpoint {file} is damaged ({reason}): {mend}") from None
    return Checkpoint(inputs_sha256, tensors, losses, accuracies)
