"""Pictures in a row as an MP4 that browsers play, written by OpenCV: nothing else need be installed."""

import contextlib
import secrets
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.files import make_folder, move_file

CODECS = ("vp09", "mp4v")
"""VP9, which every browser plays; where a build of OpenCV lacks it MPEG-4 Part 2, which players play."""
FPS = 25


def write_film(path: Path, frames: Iterable[np.ndarray], size: tuple[int, int], count: int) -> Path:
    """Write an MP4; at `path` there is the old file or the whole new one.

    Args:
        path: `.mp4`.
        frames: (height, width, 3) uint8 sRGB.
        size: width and height, even.
        count: how many frames there are.

    Raises:
        ToolkitError: this OpenCV writes no film, or the film cannot be read back whole: mostly a full disk.
    """
    make_folder(path.parent)
    partial = path.with_name(f".{path.stem}.{secrets.token_hex(4)}.partial.mp4")
    try:
        writer = _open_writer(partial, size)
        for frame in frames:
            writer.write(np.ascontiguousarray(frame[..., ::-1]))
        writer.release()
        found = count_frames(partial)
        if found != count:
            raise ToolkitError(
                f"cannot write {path}: of {count} frames {found} can be read back: is the disk full? Free some space "
                "and run the same command again, it goes on where it stopped"
            )
        return move_file(partial, path, path.parent)
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)


def _open_writer(path: Path, size: tuple[int, int]) -> cv2.VideoWriter:
    for codec in CODECS:
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), FPS, size)
        if writer.isOpened():
            return writer
    raise ToolkitError(
        f"cannot write a film to {path.parent}: the folder may not be written to, or this OpenCV knows neither "
        f"{' nor '.join(CODECS)}: choose another folder, or leave the film out"
    )


def count_frames(path: Path) -> int:
    """How many frames of a film can be decoded."""
    reader, found = cv2.VideoCapture(str(path)), 0
    while reader.grab():
        found += 1
    reader.release()
    return found
