"""One run at a time in a folder: a second one waits, so that no work is done and no line is written twice."""

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from toolkit.core.files import explain_write_error, make_folder, open_in_place, real_path

try:
    import fcntl
except ImportError:  # Windows: runs there do not wait for each other
    fcntl = None  # type: ignore[assignment]

LOCK = ".lock"
_held = threading.local()


@contextmanager
def hold_folder(folder: Path, name: str = LOCK) -> Iterator[None]:
    """Keep other runs out of a folder until the block has ended; while one is there, say who, and wait.

    The lock is the kernel's (flock): it ends with its process however that ends, so that nobody waits for the dead.
    Within the block the same thread may hold the folder again; another thread waits.

    Args:
        folder: made where it is missing.
        name: of the lock's file in it, which is gone afterwards; another name is another lock.

    Raises:
        ToolkitError: the folder may not be written.
    """
    file = real_path(Path(folder)) / name
    mine: set[Path] = _held.__dict__.setdefault("files", set())
    if fcntl is None or file in mine:
        yield
        return
    is_new = not file.parent.exists()
    number = _lock(file)
    mine.add(file)
    try:
        yield
    finally:
        mine.discard(file)
        file.unlink(missing_ok=True)  # before the lock ends: who waits sees that it guards nothing any more
        if is_new:
            with suppress(OSError):  # something was written
                file.parent.rmdir()
        os.close(number)


def _lock(file: Path) -> int:
    is_said = False
    while True:
        make_folder(file.parent)
        try:
            number = open_in_place(file)
            try:
                fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if not is_said:
                    from toolkit.core.console import notice

                    notice(f"waiting until {_read_holder(number)} has finished with {file.parent}")
                is_said = True
                fcntl.flock(number, fcntl.LOCK_EX)
            # still the file of that name: else its last holder removed it between our opening and our lock
            if os.fstat(number).st_nlink:
                os.truncate(number, 0)
                os.write(number, f"{os.getpid()} ({' '.join(['toolkit', *sys.argv[1:2]])})".encode())
                return number
        except OSError as error:
            raise explain_write_error(file, error) from error
        except BaseException:  # Ctrl-C while waiting
            os.close(number)
            raise
        os.close(number)  # its last holder removed it: take the one that there is now


def _read_holder(number: int) -> str:
    said = os.read(number, 200).decode("utf-8", errors="replace")
    return f"process {said}" if said else "another run"
