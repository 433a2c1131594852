"""Keys of kept results: a hash of what was done, the version of its method, and all inputs."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_json

INPUTS = "inputs_sha256"
"""Name of the field that holds a key in manifests, records, checkpoints and summaries."""
NOWHERE = -1
Made = TypeVar("Made")


@dataclass(frozen=True)
class Work:
    """A kind of work whose results are kept, so that nothing is done twice.

    State it once, beside the method. Raise `version`, and leave `old_at` out, when the same inputs give another result.

        CELLS = Work("cell", 1)
        key = CELLS.key(image_sha256, weights_sha256, severity)

    Attributes:
        kind: what is made; part of every key.
        version: of the method; part of every key.
        old_at: for work that is older than this class, so that its results stay readable: the place of the version
            among the inputs, its name if the only input is a mapping, or `NOWHERE` if the first version is left out.
            Such keys do not hold the kind.
    """

    kind: str
    version: int = 1
    old_at: int | str | None = None

    def key(self, *inputs: object) -> str:
        """Hash of kind, version and inputs, which must be JSON; what is not is hashed as `str` shows it."""
        if isinstance(self.old_at, str):
            (named,) = inputs
            return sha256_json({**named, self.old_at: self.version})  # type: ignore[dict-item]
        if self.old_at is None or (self.old_at == NOWHERE and self.version > 1):
            return sha256_json([self.kind, self.version, *inputs])
        version = [] if self.old_at == NOWHERE else [self.version]
        return sha256_json([*inputs[: self.old_at], *version, *inputs[self.old_at :]])


def find_made(key: str, read: Callable[[], Made], held: Callable[[Made], object], *files: Path) -> Made | None:
    """What `read` finds of an earlier run, if all files are there and it `held` the same key; else None.

    What cannot be read is made again: a kill between a file and its record leaves such a pair.
    """
    if not all(file.is_file() for file in files):
        return None
    try:
        made = read()
    except ToolkitError:
        return None
    return made if held(made) == key else None
