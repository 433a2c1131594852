"""Keys of kept results: a hash of the kind of work, its version, and all inputs."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_json

INPUTS = "inputs_sha256"
"""Name of the field that holds a key in manifests, records, checkpoints and summaries."""
NOWHERE = -1
Made = TypeVar("Made")


@dataclass(frozen=True)
class Work:
    """A kind of work whose results are kept, so that nothing is done twice.

    Define it once, beside the method. Raise `version`, and remove `old_at`, if the same inputs give another result.

        CELLS = Work("cell", 1)
        key = CELLS.key(image_sha256, weights_sha256, severity)

    Attributes:
        kind: kind of the result; part of every key.
        version: version of the method; part of every key.
        old_at: for keys that are older than this class, without the kind: the place of the version among the inputs,
            its name if the only input is a mapping, or `NOWHERE` if the first version is left out.
    """

    kind: str
    version: int = 1
    old_at: int | str | None = None

    def key(self, *inputs: object) -> str:
        """Return the hash of kind, version and inputs: JSON values, or their `str`."""
        if isinstance(self.old_at, str):
            (named,) = inputs
            return sha256_json({**named, self.old_at: self.version})  # type: ignore[dict-item]
        if self.old_at is None or (self.old_at == NOWHERE and self.version > 1):
            return sha256_json([self.kind, self.version, *inputs])
        version = [] if self.old_at == NOWHERE else [self.version]
        return sha256_json([*inputs[: self.old_at], *version, *inputs[self.old_at :]])


def find_made(key: str, read: Callable[[], Made], held: Callable[[Made], object], *files: Path) -> Made | None:
    """Return the result of `read` if all files exist and it `held` the key; else None, also if it cannot be read."""
    if not all(file.is_file() for file in files):
        return None
    try:
        made = read()
    except ToolkitError:
        return None
    return made if held(made) == key else None


@dataclass(frozen=True, kw_only=True)
class WorkResult:
    """Result of a run that may have been interrupted, beside what it made.

    Attributes:
        skipped: (path, reason) of images that could not be used.
        resumed_from: steps that an earlier run had made; all of them when it was finished before.
        was_finished: whether there was nothing left to do.
    """

    skipped: tuple[tuple[str, str], ...] = ()
    resumed_from: int = 0
    was_finished: bool = False

    def describe_run(self) -> dict[str, Any]:
        """Return the fields that scripts get of every run."""
        skipped = [{"path": path, "reason": reason} for path, reason in self.skipped]
        return {"was_finished": self.was_finished, "resumed_from": self.resumed_from, "skipped": skipped}

    def was_there(self, what: object) -> str:
        """Return the line for a run that was finished before."""
        return f"{what} was trained with these inputs before: nothing to do; --restart trains it again"
