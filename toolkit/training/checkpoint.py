"""Half-finished training on disk: a safetensors file, so that it is whole or absent whenever the process dies."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from toolkit.core.errors import FieldError
from toolkit.core.files import delete_file, delete_folder, sha256_bytes, write_bytes
from toolkit.core.lazy import np
from toolkit.core.work import INPUTS

FORMAT = "toolkit training checkpoint 1"


@dataclass(frozen=True)
class Checkpoint:
    """Place of an unfinished run.

    Attributes:
        folder: of the checkpoints of all runs of the same name; a run's file is called by its hash.
        key: of the run, see `Work`; a run with another key is another run.
        restart: forget what an earlier run left.
        every_s: how much work a kill may cost, seconds.
        shared: patterns of what lies in the folder for all runs; it goes with the last checkpoint.
    """

    folder: Path
    key: str
    restart: bool = False
    every_s: float = 5.0
    shared: tuple[str, ...] = ()

    @property
    def file(self) -> Path:
        """The run's own."""
        return self.folder / f"{self.key[:16]}.safetensors"

    def write(self, arrays: "Mapping[str, np.ndarray]", kind: str, steps_done: int) -> None:
        """Write named arrays in a single rename; the JSON header says what they are, and holds a hash of the numbers.

        Raises:
            ToolkitError: the disk is full or read-only.
        """
        from safetensors.numpy import save

        # safetensors writes the bytes as they lie in memory
        arrays = {name: np.asarray(array, order="C") for name, array in arrays.items()}
        about = {
            "format": FORMAT,
            "kind": kind,
            INPUTS: self.key,
            "steps_done": steps_done,
            # a rename is whole, a disk need not be: the numbers have their own hash
            "content_sha256": _hash_arrays(arrays),
        }
        write_bytes(self.file, save(arrays, {"toolkit": json.dumps(about)}))

    def read(self, kind: str) -> "dict[str, np.ndarray] | None":
        """The arrays, None where there is no checkpoint; nothing in the file is executed.

        Raises:
            ToolkitError: it is damaged, of another version, or of other inputs.
        """
        from safetensors import SafetensorError, safe_open

        if not self.file.is_file():
            return None
        way_out = "delete it, or run the same again with {restart}"
        try:
            # numbers and description are read together, then judged
            with safe_open(self.file, "np") as stored:
                about = json.loads((stored.metadata() or {})["toolkit"])
                arrays = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118 (no mapping)
            found, inputs = (about["format"], about.get("kind")), about[INPUTS]
            # asked later: a file of another version is said to be that, and not damaged
            is_whole = about["content_sha256"] == _hash_arrays(arrays)
        except (SafetensorError, OSError, KeyError, TypeError, ValueError, AttributeError) as error:
            reason = str(error).splitlines()[0] if str(error) else error.__class__.__name__
            raise FieldError(f"checkpoint {self.file} is damaged ({reason}): {way_out}", {}) from None
        if found != (FORMAT, kind):
            raise FieldError(f"checkpoint {self.file} is of another version or kind ({found[0]}): {way_out}", {})
        if not is_whole:
            raise FieldError(f"checkpoint {self.file} is damaged (its numbers do not match its hash): {way_out}", {})
        if inputs != self.key:
            raise FieldError(f"checkpoint {self.file} is of a run with other inputs: {way_out}", {})
        return arrays

    def announce(self, done: int, steps: int) -> None:
        """Report whether a run resumes, or begins beside an unfinished run with other inputs."""
        from toolkit.core.console import notice

        if done:
            notice(f"going on after step {done} of {steps}; restart begins again")
        elif any(self.folder.glob("*.safetensors")):
            notice(
                f"{self.folder} holds an unfinished run with other inputs: that one is kept, this one starts at step 1"
            )

    def remove(self) -> None:
        """Forget the run, finished or not; what is `shared` goes when no other run is left, and empty folders too."""
        key = self.file.stem
        for file in (self.file, *self.folder.glob(f".{key}.*.partial")):
            delete_file(file)
        if not self.folder.is_dir() or any(self.folder.glob("*.safetensors")):
            return
        for pattern in self.shared:
            for found in self.folder.glob(pattern):
                (delete_folder if found.is_dir() else delete_file)(found)
        with suppress(OSError):  # not empty, or another run was faster
            self.folder.rmdir()
            self.folder.parent.rmdir()


def _hash_arrays(arrays: "Mapping[str, np.ndarray]") -> str:
    # by name, so that the order in which a task lists its tensors does not matter
    digests = (name + sha256_bytes(arrays[name].tobytes()) for name in sorted(arrays))
    return sha256_bytes("".join(digests).encode())
