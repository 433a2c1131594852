"""Pictures that a simulator made, from the folder where they were kept."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_bytes, sha256_bytes
from toolkit.experiments.worlds.answers import WeatherKey
from toolkit.experiments.worlds.frames import Frame, Task
from toolkit.experiments.worlds.keep import name_picture
from toolkit.imaging.read import UnreadableImage, decode_frame

MOST_PICTURE_BYTES = 64 << 20


class ShotFrames(NamedTuple):
    """Frames that lie in a folder.

    Attributes:
        folder: `frames/` of a run.
        places: names by the tasks' numbers.
        renderer: who made them.
    """

    folder: Path
    places: tuple[str, ...]
    renderer: str

    def frames(self, tasks: Sequence[Task]) -> Iterator[Frame]:
        """The pictures of tasks, without depth and classes, which lie there already.

        Raises:
            ToolkitError: a file is gone or no picture.
        """
        for task in tasks:
            yield Frame(task._replace(is_kept=False), tuple(self._decode(task, weather) for weather in task.weathers))

    def hash_pictures(self, task: Task) -> list[object]:
        """What tells a task's pictures from all others: who made them, and their bytes."""
        files = [self._file(task, weather) for weather in task.weathers]
        return [self.renderer, [[file.stem, sha256_bytes(read_bytes(file, MOST_PICTURE_BYTES))] for file in files]]

    def _file(self, task: Task, weather: WeatherKey) -> Path:
        folder = self.folder / self.places[task.place] / task.variant / f"{task.camera.number:04d}"
        return folder / f"{name_picture(weather)}.png"

    def _decode(self, task: Task, weather: WeatherKey) -> np.ndarray:
        file = self._file(task, weather)
        try:
            return decode_frame(read_bytes(file, MOST_PICTURE_BYTES), file)
        except UnreadableImage as error:
            raise ToolkitError(f"{error}: delete it and run again, with the simulator running") from None
