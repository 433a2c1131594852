"""Where the studio keeps photographs that nobody has said yes to, and the marks of shots that were put off.

All below `.studio/` of the workspace; nothing there counts as a capture. The names are made here, never taken from
outside.
"""

import secrets
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from toolkit.captures.photos.photo import SUFFIXES, Photo
from toolkit.captures.shot_order import ShotStep
from toolkit.errors import ToolkitError
from toolkit.files import explain_write_error

FOLDER = ".studio"
HASH_DIGITS = 32
"""Of a photograph's SHA-256 in its name, 128 bits."""
PART = ".part"


@dataclass(frozen=True)
class Places:
    """Folders of one workspace's studio."""

    root: Path

    @property
    def incoming_dir(self) -> Path:
        """Uploads that are not whole yet."""
        return self.root / FOLDER / "incoming"

    def waiting_dir(self, step: ShotStep) -> Path:
        """Holds at most one photograph of a shot, while its verdict is read."""
        return self.root / FOLDER / "waiting" / step.object / step.variant / f"pose_{step.pose_id:02d}"

    def skip_mark(self, step: ShotStep) -> Path:
        """An empty file that says the shot was put off."""
        return self.root / FOLDER / "skipped" / step.object / step.variant / f"pose_{step.pose_id:02d}"

    def new_incoming(self) -> Path:
        """A name for the next upload.

        Raises:
            ToolkitError: the folder cannot be made.
        """
        try:
            self.incoming_dir.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise explain_write_error(self.incoming_dir, error) from error
        return self.incoming_dir / f"{secrets.token_hex(16)}{PART}"

    def find_waiting(self, step: ShotStep) -> Path | None:
        """The photograph of a shot that waits for a yes or no; None where there is none."""
        return max(self._list_waiting(step), default=None)  # the names begin with the time

    def put_waiting(self, step: ShotStep, upload: Path, photo: Photo) -> Path:
        """Move an upload to its shot; the one that waited there before goes.

        Raises:
            ToolkitError: the disk is full or not to be written.
        """
        stamp = datetime.now().strftime("%Y%m%d-%H%M%S-%f")
        file = self.waiting_dir(step) / f"{stamp}-{photo.sha256[:HASH_DIGITS]}{SUFFIXES[photo.kind]}"
        old = list(self._list_waiting(step))
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            upload.replace(file)
        except OSError as error:
            raise explain_write_error(file, error) from error
        for one in old:
            one.unlink(missing_ok=True)
        return file

    def drop_waiting(self, step: ShotStep) -> None:
        """Throw away what waits for a shot."""
        for one in list(self._list_waiting(step)):
            one.unlink(missing_ok=True)

    def set_skipped(self, step: ShotStep, skipped: bool) -> None:
        """Put a shot off, or call it back."""
        mark = self.skip_mark(step)
        try:
            if skipped:
                mark.parent.mkdir(parents=True, exist_ok=True)
                mark.touch()
            else:
                mark.unlink(missing_ok=True)
        except OSError as error:
            raise explain_write_error(mark, error) from error

    def sweep(self) -> None:
        """Remove what uploads left that a stopped server never finished."""
        if self.incoming_dir.is_dir():
            for one in self.incoming_dir.glob(f"*{PART}"):
                one.unlink(missing_ok=True)

    def _list_waiting(self, step: ShotStep) -> Iterator[Path]:
        folder = self.waiting_dir(step)
        if folder.is_dir():
            yield from (one for one in folder.iterdir() if one.is_file() and not one.name.startswith("."))


def hash_in_name(file: Path) -> str:
    """The first digits of a waiting photograph's SHA-256."""
    return file.stem.rpartition("-")[2]


def check_writable(places: Places) -> None:
    """A `ToolkitError` where no upload could be written, before anybody takes a photograph."""
    probe = places.new_incoming()
    try:
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise ToolkitError(str(explain_write_error(places.incoming_dir, error))) from error
