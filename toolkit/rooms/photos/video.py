"""Videos of an object: the moments when the camera was held still, and single frames out of them."""

import os
import threading
from contextlib import closing
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np

from toolkit.core.errors import FieldError
from toolkit.imaging.read import MAX_MEGAPIXELS, UnreadableImage

LOOK_WIDTH_PX = 160
SHARP_WIDTH_PX = 960
BLUR_PX = 1.5
NOISE_PX = 1.0
"""Smoothing before sharpness is measured, or noise would pass for it."""
STILL_CHANGE = 0.04
"""Change between two looks, as a share of the picture's contrast, up to which it may be noise and a hand's tremor."""
STILL_SHARE = 0.3
"""In a video that moves, what changes less than this share of its fast parts is held still."""
LEAST_STILL_S = 0.4
BRIDGED_LOOKS = 3
"""Unsteady looks that do not end a still moment, if the pictures before and after them are equal."""
LEAST_CONTRAST = 4.0


@dataclass(frozen=True)
class FrameLook:
    """A frame's number, its small blurred grey picture (float32), and its sharpness."""

    frame: int
    small: np.ndarray
    sharpness: float


def look_at_frame(pixels: np.ndarray, frame: int) -> FrameLook:
    """Measure a frame, (h, w, 3) uint8; sharpness is the variance of the Laplacian, 960 px wide and smoothed."""
    grey = cv2.cvtColor(_shrink(pixels, SHARP_WIDTH_PX), cv2.COLOR_RGB2GRAY)
    small = cv2.GaussianBlur(_shrink(grey, LOOK_WIDTH_PX), (0, 0), BLUR_PX).astype(np.float32)
    calm = cv2.GaussianBlur(grey, (0, 0), NOISE_PX)
    return FrameLook(frame, small, float(cv2.Laplacian(calm, cv2.CV_32F).var()))


def choose_still_frames(looks: list[FrameLook], fps: float) -> list[int]:
    """The number of the sharpest frame of each moment of stillness of at least 0.4 s, in order."""
    if len(looks) < 2:
        return [look.frame for look in looks]
    changes = np.array([measure_change(before.small, other.small) for before, other in pairwise(looks)])
    # the ninth decile is the fast part of the video; moments with less than a share of its change are still
    limit = max(STILL_CHANGE, STILL_SHARE * float(np.quantile(changes, 0.9)))
    moments = _join(_find_runs(changes < limit), looks, limit)
    chosen = []
    for first, last in moments:  # changes first … last - 1 lie between looks first … last
        if (looks[last].frame - looks[first].frame) / fps >= LEAST_STILL_S:
            chosen.append(max(looks[first : last + 1], key=lambda look: look.sharpness).frame)
    return chosen


def measure_change(first: np.ndarray, other: np.ndarray) -> float:
    """Mean absolute difference of two small grey pictures, as a share of their contrast; 0 for equal pictures."""
    # the larger contrast of both, and never less than `LEAST_CONTRAST`: a blank wall's noise is no change
    contrast = max(float(first.std()), float(other.std()), LEAST_CONTRAST)
    return float(np.abs(first - other).mean()) / contrast


def _find_runs(still: np.ndarray) -> list[tuple[int, int]]:
    """(first, last + 1) of runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]


def _join(runs: list[tuple[int, int]], looks: list[FrameLook], limit: float) -> list[tuple[int, int]]:
    """Join runs with a short jolt between them; a cut, after which the picture differs, parts them."""
    joined: list[tuple[int, int]] = []
    for first, end in runs:
        before = joined[-1] if joined else None
        near = before is not None and first - before[1] <= BRIDGED_LOOKS
        if before is not None and near and measure_change(looks[before[1]].small, looks[first].small) < limit:
            joined[-1] = (before[0], end)
        else:
            joined.append((first, end))
    return joined


def _shrink(picture: np.ndarray, width_px: int) -> np.ndarray:
    scale = width_px / picture.shape[1]
    return picture if scale >= 1 else cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)


# FFmpeg writes its own words on stderr otherwise; OpenCV reads this when it first meets a video
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm")
LOOKS_PER_S = 12.0
"""How often a video is looked at for stillness."""
LONGEST_S = 3600.0
MOST_FPS = 480.0
MP4_EPOCH = datetime(1904, 1, 1, tzinfo=timezone.utc)
MP4_BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot")
HEADER_BYTES = 32


@dataclass(frozen=True)
class VideoFacts:
    """A video's upright size in pixels, frames per second, number of frames, and start."""

    width: int
    height: int
    fps: float
    n_frames: int
    began: datetime | None

    def taken_at(self, frame: int) -> datetime | None:
        """When a frame was taken."""
        return None if self.began is None else self.began + timedelta(seconds=frame / self.fps)


def is_video(path: Path) -> bool:
    """Whether a file is MP4, QuickTime, AVI, Matroska or WebM by its first bytes.

    Only these go to the decoder: it also knows play lists, which would open other files and addresses.
    """
    with Path(path).open("rb") as file:
        head = file.read(HEADER_BYTES)
    brand = head[8:11]
    if head[4:8] == b"ftyp" and brand in (b"hei", b"hev", b"mif", b"msf", b"avi"):
        return False  # HEIC and AVIF photographs are of the same family
    return head[4:8] in MP4_BOXES or (head[:4] == b"RIFF" and head[8:12] == b"AVI ") or head[:4] == b"\x1aE\xdf\xa3"


def read_video(path: Path) -> VideoFacts:
    """Describe a video; `UnreadableImage` if it cannot be opened, holds no picture, or is far too long or large."""
    with closing(_Reader(Path(path))) as reader:
        return reader.facts


def pick_frames(path: Path, every_s: float | None = None) -> list[int]:
    """Numbers of the frames to take out of a video, in order.

    Args:
        path: the video.
        every_s: length of the periods of which the sharpest frame is taken, seconds; None: of each period in which
            the camera was held still.

    Raises:
        UnreadableImage: the video does not decode, or the camera was never held still.
        ToolkitError: `every_s` is no time.
    """
    if every_s is not None and not 0.05 <= every_s <= LONGEST_S:
        raise FieldError(f"expected 0.05 to {LONGEST_S:g} seconds", {"every_s": every_s})
    path = Path(path)
    # a time is divided into periods, and the sharpest frame of each is taken
    looks, fps = _look_through(path)
    if every_s is not None:
        windows: dict[int, list[FrameLook]] = {}
        for look in looks:
            windows.setdefault(int(look.frame / fps / every_s), []).append(look)
        return [max(window, key=lambda look: look.sharpness).frame for window in windows.values()]
    chosen = choose_still_frames(looks, fps)
    if not chosen:
        never = "the camera is never held still: stop for a second at each pose, or take a frame every few seconds"
        raise UnreadableImage(path, f"{never} (every_s)")
    return chosen


def load_frame(path: Path, frame: int) -> np.ndarray:
    """Read a frame, (h, w, 3) uint8 sRGB, upright; frames in ascending order are read in a single pass.

    Raises:
        UnreadableImage: the video does not decode so far.
    """
    path = Path(path)
    # a single reader at a time: it is a position in a file
    with _LOCK:
        return _cached_reader(path, path.stat().st_mtime_ns).read(frame)


class _Reader:
    """A video that is read forwards; frames are counted, not sought, so that a number always means the same frame."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._rewind()
        self.facts = self._read_facts()

    def read(self, frame: int) -> np.ndarray:
        if frame < self._next:
            self._rewind()
        while self._next < frame:
            self.skip()
        pixels = self.step()
        if pixels is None:
            raise UnreadableImage(self.path, f"truncated: frame {frame} is missing")
        return pixels

    def step(self) -> np.ndarray | None:
        """The next frame; None at the end."""
        good, pixels = self._capture.read()
        self._next += 1
        return cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB) if good else None

    def skip(self) -> None:
        if not self._capture.grab():
            raise UnreadableImage(self.path, f"truncated: it ends at frame {self._next}")
        self._next += 1

    def close(self) -> None:
        self._capture.release()

    def _rewind(self) -> None:
        logging = cv2.utils.logging
        level = logging.getLogLevel()
        logging.setLogLevel(logging.LOG_LEVEL_SILENT)  # the error below names the fault
        try:
            self._capture = cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG)
        finally:
            logging.setLogLevel(level)
        self._next = 0
        if not self._capture.isOpened():
            raise UnreadableImage(self.path, "a damaged video, or a kind that cannot be decoded here")

    def _read_facts(self) -> VideoFacts:
        get = self._capture.get
        width, height, fps = get(cv2.CAP_PROP_FRAME_WIDTH), get(cv2.CAP_PROP_FRAME_HEIGHT), get(cv2.CAP_PROP_FPS)
        n_frames = get(cv2.CAP_PROP_FRAME_COUNT)
        if not (width >= 1 and height >= 1 and 0 < fps <= MOST_FPS and n_frames >= 1):
            raise UnreadableImage(self.path, "a damaged video: it does not say how large or how long it is")
        if width * height / 1e6 > MAX_MEGAPIXELS or n_frames / fps > LONGEST_S:
            raise UnreadableImage(self.path, f"longer than {LONGEST_S / 60:.0f} minutes, or far too large: cut it")
        return VideoFacts(int(width), int(height), float(fps), int(n_frames), _read_start(self.path))


_LOCK = threading.Lock()


@lru_cache(maxsize=1)
def _cached_reader(path: Path, mtime_ns: int) -> _Reader:
    return _Reader(path)


def _look_through(path: Path) -> tuple[list[FrameLook], float]:
    with closing(_Reader(path)) as reader:
        fps, frame = reader.facts.fps, 0
        # a dozen looks a second are enough to see movement
        step = max(1, round(fps / LOOKS_PER_S))
        looks: list[FrameLook] = []
        while frame < LONGEST_S * fps and (pixels := reader.step()) is not None:
            looks.append(look_at_frame(pixels, frame))
            frame += step
            try:
                for _ in range(step - 1):
                    reader.skip()
            except UnreadableImage:  # the end
                break
        if not looks:
            raise UnreadableImage(path, "a damaged video: no frame decodes")
        return looks, fps


def _read_start(path: Path) -> datetime | None:
    """When an MP4 or QuickTime film began, from its movie header (ISO/IEC 14496-12, 8.2.2)."""
    # boxes within boxes: the header of the film lies in the box `moov`
    with path.open("rb") as file:
        end = path.stat().st_size
        movie = _find_box(file, b"moov", 0, end)
        header = _find_box(file, b"mvhd", *movie) if movie else None
        if header is None:
            return None
        file.seek(header[0])
        content = file.read(12)
    if len(content) < 12:
        return None
    # version 1 of the box has times of eight bytes, version 0 of four; 0 is a clock that was not set
    seconds = int.from_bytes(content[4:12] if content[0] == 1 else content[4:8], "big")
    try:
        return MP4_EPOCH + timedelta(seconds=seconds) if seconds else None
    except OverflowError:
        return None


def _find_box(file: BinaryIO, kind: bytes, start: int, end: int) -> tuple[int, int] | None:
    """Return where the content of the first box of a kind begins and ends."""
    while start + 8 <= end:
        file.seek(start)
        head = file.read(16)
        if len(head) < 8:
            return None
        size, body = int.from_bytes(head[:4], "big"), start + 8
        # a size of 1 says that the true size follows in eight bytes, 0 that the box reaches to the file's end
        if size == 1:
            size, body = int.from_bytes(head[8:16], "big"), start + 16
        elif size == 0:
            size = end - start
        # a damaged size would never get to the end
        if size < 8:
            return None
        if head[4:8] == kind:
            return body, min(start + size, end)
        start += size
    return None
