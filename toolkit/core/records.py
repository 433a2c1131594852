"""Append-only logs of records, one JSON object per line: safe against a kill, resumable, one writer for all of them."""

import json
import os
from collections.abc import Callable, Iterator
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
)

Record = TypeVar("Record", bound=BaseModel)
MOST_LINE_BYTES = 16 << 20
"""Of one record; ours take a few thousand. A file without line ends is not read into memory whole."""


class RecordLog(Generic[Record]):
    """A file of JSON lines, each of one record.

    A last line that a kill cut short is passed over by `read` and dropped by the next `append`.

    Attributes:
        file: the log; it need not exist.
        model: of the records.
        required: a broken line is an error, as the records cannot be made again; otherwise it is passed over.
        compact: lines without spaces and with escapes only where JSON needs them, as pydantic writes them.
    """

    def __init__(self, file: Path, model: type[Record], required: bool = True, compact: bool = False) -> None:
        self.file, self.model, self.required, self.compact = Path(file), model, required, compact

    def read(self) -> Iterator[Record]:
        """The records from first to last; nothing where there is no file.

        Raises:
            ToolkitError: the file cannot be read, or a record is `required` and its line is broken; the message names
                the line and the field.
        """
        try:
            stream = open_plain(self.file)
        except (FileNotFoundError, NotADirectoryError):
            return
        except (OSError, ValueError) as error:
            raise explain_read_error(self.file, error) from None
        with stream:
            # ended by b"\n" alone: names may hold what Unicode calls an end
            for number, line in enumerate(iter(lambda: stream.readline(MOST_LINE_BYTES), b""), 1):
                text = line.decode("utf-8", errors="replace")
                if not text.strip():
                    continue
                try:
                    record = self.model.model_validate_json(text)
                except ValidationError as error:
                    if self.required and (line.endswith(b"\n") or len(line) == MOST_LINE_BYTES):
                        why = explain_validation(error)
                        raise ToolkitError(f"{self.file}: line {number} is broken ({why}): delete that line") from None
                    continue
                yield record

    def read_last(self, key: Callable[[Record], str]) -> dict[str, Record]:
        """The last record of each key, in the order in which the keys first came; raises as `read`."""
        return {key(record): record for record in self.read()}

    def append(self, *records: Record) -> None:
        """Append records in one write and flush them to disk; a link in the log's place is not followed.

        Raises:
            ToolkitError: the disk is full or read-only, or the folder may not be written.
        """
        content = "".join(f"{self._write_line(record)}\n" for record in records).encode()
        try:
            make_folder(self.file.parent)
            number = open_in_place(self.file, os.O_APPEND)
            with os.fdopen(number, "a+b") as stream:
                _end_last_line(stream)
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise explain_write_error(self.file, error) from error

    def _write_line(self, record: Record) -> str:
        return record.model_dump_json() if self.compact else json.dumps(record.model_dump(), ensure_ascii=False)


def _end_last_line(stream: BinaryIO) -> None:
    """End a last line that is whole, as an editor may leave it; drop one that a kill cut short."""
    size, last = stream.seek(0, os.SEEK_END), b""
    while len(last) < size and b"\n" not in last:
        start = max(0, size - 2 * len(last) - 1)  # a byte is enough for a whole line, then twice as much each time
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
