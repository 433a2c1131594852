"""Append-only logs of records, a JSON object on each line, and locks that keep other runs out of a folder."""

import fcntl
import json
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, Generic, TypeVar

from pydantic import BaseModel, ValidationError

from toolkit.core.errors import ToolkitError
from toolkit.core.files import (
    explain_read_error,
    explain_validation,
    explain_write_error,
    make_folder,
    open_in_place,
    open_plain,
    real_path,
)
from toolkit.core.places import check_links

LOCK = ".lock"
_held = threading.local()
MOST_LINE_BYTES = 16 << 20
"""Largest size of a record, bytes, which bounds the memory for a file without line ends."""


@contextmanager
def hold_folder(folder: Path, name: str = LOCK) -> Iterator[None]:
    """Keep other runs out of a folder until the block has ended; if another run holds it, report it and wait.

    The lock is the kernel's (flock) and ends with its process. The same thread may hold the folder again.

    Args:
        folder: folder, made if it is missing.
        name: name of the lock's file in it, which is deleted afterwards; another name is another lock.

    Raises:
        ToolkitError: the folder may not be written, or a link in a workspace leads to it.
    """
    check_links(folder)  # before links are followed
    file = real_path(Path(folder)) / name
    mine: set[Path] = _held.__dict__.setdefault("files", set())
    # taken before by the same thread, as commands call each other
    if file in mine:
        yield
        return
    # a folder that was made for the lock alone is removed again
    is_new = not file.parent.exists()
    number = _lock(file)
    mine.add(file)
    try:
        yield
    finally:
        mine.discard(file)
        file.unlink(missing_ok=True)  # before the lock ends, so that a waiting run takes a new file
        if is_new:
            with suppress(OSError):  # something was written
                file.parent.rmdir()
        os.close(number)


def _lock(file: Path) -> int:
    is_said = False
    # a lock whose file was removed meanwhile locks nothing, so another is taken
    while True:
        make_folder(file.parent)
        try:
            number = open_in_place(file)
            try:
                fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                # who holds it is told once
                if not is_said:
                    from toolkit.core.console import notice

                    holder = os.read(number, 200).decode("utf-8", errors="replace")
                    who = f"process {holder}" if holder else "another run"
                    notice(f"waiting until {who} has finished with {file.parent}")
                is_said = True
                fcntl.flock(number, fcntl.LOCK_EX)
            # without a name, its last holder removed it between our opening and our lock
            if os.fstat(number).st_nlink:
                # who holds it, for those who wait
                os.truncate(number, 0)
                os.write(number, f"{os.getpid()} ({' '.join(['toolkit', *sys.argv[1:2]])})".encode())
                return number
        except OSError as error:
            raise explain_write_error(file, error) from error
        except BaseException:  # Ctrl-C while waiting
            os.close(number)
            raise
        os.close(number)  # try again with a new file


Record = TypeVar("Record", bound=BaseModel)


class RecordLog(Generic[Record]):
    """A file of JSON lines, a record in each. A last line that a kill cut short is dropped.

    Attributes:
        required: whether a broken line is an error, as records cannot be made again; otherwise it is skipped.
        compact: whether lines have no spaces, as pydantic writes them.
    """

    def __init__(self, file: Path, model: type[Record], required: bool = True, compact: bool = False) -> None:
        self.file, self.model, self.required, self.compact = Path(file), model, required, compact

    def read(self) -> Iterator[Record]:
        """Yield the records from first to last; none without a file.

        Raises:
            ToolkitError: the file cannot be read, or a `required` line is broken; the message names line and field.
        """
        # a missing file is an empty log
        try:
            stream = open_plain(self.file)
        except (FileNotFoundError, NotADirectoryError):
            return
        except (OSError, ValueError) as error:
            raise explain_read_error(self.file, error) from None
        with stream:
            # lines end with b"\n" alone: names may hold other line ends of Unicode
            for number, line in enumerate(iter(lambda: stream.readline(MOST_LINE_BYTES), b""), 1):
                text = line.decode("utf-8", errors="replace")
                if not text.strip():
                    continue
                try:
                    record = self.model.model_validate_json(text)
                except ValidationError as error:
                    # a line without an end was cut short by a kill, and the next append drops it
                    if self.required and (line.endswith(b"\n") or len(line) == MOST_LINE_BYTES):
                        why = explain_validation(error)
                        raise ToolkitError(f"{self.file}: line {number} is broken ({why}): delete that line") from None
                    continue
                yield record

    def read_last(self, key: Callable[[Record], str]) -> dict[str, Record]:
        """Return the last record of each key, in the order of the keys' first records; raises as `read`."""
        return {key(record): record for record in self.read()}

    def append(self, *records: Record) -> None:
        """Append records in a single write and flush them to disk; a `ToolkitError` if they cannot be written."""
        if self.compact:
            lines = [record.model_dump_json() for record in records]
        else:
            lines = [json.dumps(record.model_dump(), ensure_ascii=False) for record in records]
        content = "".join(f"{line}\n" for line in lines).encode()
        try:
            make_folder(self.file.parent)
            # appended, so that two writers do not overwrite each other
            number = open_in_place(self.file, os.O_APPEND)
            with os.fdopen(number, "a+b") as stream:
                # a line that was cut short would swallow the next
                _end_last_line(stream)
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise explain_write_error(self.file, error) from error


def _end_last_line(stream: BinaryIO) -> None:
    """End a complete last line, as an editor may leave it; drop a line that a kill cut short."""
    size, last = stream.seek(0, os.SEEK_END), b""
    while len(last) < size and b"\n" not in last:
        start = max(0, size - 2 * len(last) - 1)  # a byte shows a complete line, then twice as much each time
        stream.seek(start)
        last = stream.read(size - start)
    last = last.rpartition(b"\n")[2]
    if not last:
        return
    try:
        json.loads(last)
        stream.write(b"\n")
    except ValueError:
        stream.truncate(size - len(last))
