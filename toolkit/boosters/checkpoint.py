"""A half-trained patch on disk: one safetensors file, so that it is whole or absent whenever the process dies."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toolkit.errors import ToolkitError
from toolkit.files import sha256_bytes, write_bytes

FORMAT = "toolkit patch checkpoint 1"


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
    """Write it in one rename; the header says in JSON what it is, and holds a hash of the numbers.

    Raises:
        ToolkitError: the disk is full or read-only.
    """
    from safetensors.numpy import save

    arrays = _arrays(checkpoint)
    about = {
        "format": FORMAT,
        "inputs_sha256": checkpoint.inputs_sha256,
        "steps_done": checkpoint.done,
        "content_sha256": _hash_arrays(arrays),
    }
    write_bytes(file, save(arrays, {"toolkit": json.dumps(about)}))


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
        with safe_open(file, "np") as stored:
            about = json.loads((stored.metadata() or {})["toolkit"])
            arrays = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118 (no mapping)
        checkpoint = Checkpoint(about["inputs_sha256"], arrays["patch"], arrays["losses"], arrays["accuracies"])
        whole = about["format"] == FORMAT and about["content_sha256"] == _hash_arrays(arrays)
    except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else error.__class__.__name__
        raise ToolkitError(f"checkpoint {file} is damaged ({reason}): {mend}") from None
    if not whole:
        raise ToolkitError(f"checkpoint {file} is damaged (its numbers do not match its hash): {mend}")
    if checkpoint.inputs_sha256 != inputs_sha256:
        raise ToolkitError(f"checkpoint {file} is of a run with other inputs: {mend}")
    return checkpoint


def _arrays(checkpoint: Checkpoint) -> dict[str, np.ndarray]:
    return {
        "patch": np.ascontiguousarray(checkpoint.patch, np.float32),
        "losses": np.ascontiguousarray(checkpoint.losses, np.float64),
        "accuracies": np.ascontiguousarray(checkpoint.accuracies, np.float64),
    }


def _hash_arrays(arrays: dict[str, np.ndarray]) -> str:
    return sha256_bytes(b"".join(name.encode() + arrays[name].tobytes() for name in sorted(arrays)))
