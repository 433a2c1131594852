"""Half-finished training on disk: one safetensors file, so that it is whole or absent whenever the process dies."""

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes, write_bytes


def write_arrays(file: Path, arrays: Mapping[str, np.ndarray], kind: str, inputs_sha256: str, steps_done: int) -> None:
    """Write named arrays in one rename; the header says in JSON what they are, and holds a hash of the numbers.

    Args:
        file: to write.
        arrays: by name.
        kind: of the checkpoint, with its version.
        inputs_sha256: hash of everything that the run depends on.
        steps_done: how many steps have been made, for whoever looks into the file.

    Raises:
        ToolkitError: the disk is full or read-only.
    """
    from safetensors.numpy import save

    arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    about = {
        "format": kind,
        "inputs_sha256": inputs_sha256,
        "steps_done": steps_done,
        "content_sha256": _hash_arrays(arrays),
    }
    write_bytes(file, save(arrays, {"toolkit": json.dumps(about)}))


def read_arrays(file: Path, names: set[str], kind: str, inputs_sha256: str) -> dict[str, np.ndarray] | None:
    """The arrays of a checkpoint, None where there is none; nothing in the file is executed.

    Args:
        file: to read.
        names: arrays that must be there.
        kind: as written.
        inputs_sha256: of the run that wants to go on.

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
        whole = about["format"] == kind and about["content_sha256"] == _hash_arrays(arrays) and names <= arrays.keys()
        found = about["inputs_sha256"]
    except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else error.__class__.__name__
        raise ToolkitError(f"checkpoint {file} is damaged ({reason}): {mend}") from None
    if not whole:
        raise ToolkitError(f"checkpoint {file} is damaged (its numbers do not match its hash): {mend}")
    if found != inputs_sha256:
        raise ToolkitError(f"checkpoint {file} is of a run with other inputs: {mend}")
    return arrays


def _hash_arrays(arrays: Mapping[str, np.ndarray]) -> str:
    digests = (name + sha256_bytes(arrays[name].tobytes()) for name in sorted(arrays))
    return sha256_bytes("".join(digests).encode())


def forget_run(training: Path, inputs_sha256: str, shared: Iterable[str] = ()) -> None:
    """Remove the checkpoint of a finished run, and folders that are empty then.

    Args:
        training: folder of the checkpoints, one for each run: the hash's first 16 digits and `.safetensors`.
        inputs_sha256: of the run.
        shared: patterns of files that serve all runs; they go with the last checkpoint.
    """
    key = inputs_sha256[:16]
    for file in (*training.glob(f"{key}.safetensors"), *training.glob(f".{key}.*.partial")):
        file.unlink(missing_ok=True)
    if training.is_dir() and not any(training.glob("*.safetensors")):
        for pattern in shared:
            for file in training.glob(pattern):
                file.unlink(missing_ok=True)
        for folder in (training, training.parent):
            if not any(folder.iterdir()):
                folder.rmdir()


def say_start(say: Callable[[str], None], done: int, steps: int, training: Path) -> None:
    """Say whether a run goes on, or begins beside an unfinished one with other inputs."""
    if done:
        say(f"going on after step {done} of {steps}; --restart begins anew")
    elif any(training.glob("*.safetensors")):
        say(f"{training} holds an unfinished run with other inputs: it is kept, this one begins anew")
