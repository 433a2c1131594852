"""Pictures that stay on disk: a sample of them, or all, each with its depth, its segmentation and the truth."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, SerializerFunctionWrapHandler, model_serializer

from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_bytes, sha256_bytes, write_bytes
from toolkit.core.records import RecordLog
from toolkit.imaging.read import UnreadableImage, decode_frame
from toolkit.objects.spec import ObjectSpec
from toolkit.rig.scene import Stand
from toolkit.rooms.worlds.evaluation.cameras import GridCamera, PlaceCameras
from toolkit.rooms.worlds.evaluation.frames import Frame, PictureTask, Stage, WeatherKey

CM_PER_M, FARTHEST_CM = 100.0, 65_534
SHOWN_AT = (30.0, 15.0, 1.6)
"""Preferred azimuth and elevation, degrees, and distance, object lengths. The report shows the nearest camera of each
place that sees the whole object."""
MOST_PICTURE_BYTES = 64 << 20
OBJECT_MARGIN = 1.15
"""Side of the square that the report shows, in sides of the object's outline."""


class KeptFrame(BaseModel):
    """A line of `frames/manifest.jsonl`.

    Attributes:
        path: folder of the frame below `frames/`: `PLACE/VARIANT/CAMERA`.
        frame: hash of everything that the frame depends on.
        object: name of the object.
        class_name: class that a network should predict.
        variant: variant of the object.
        world, place, sky: world, place and sky of the frame.
        camera: number of the camera.
        weathers: names of the images, such as `clear` and `fog-3`, each a `.png`.
        T_world_camera, T_world_object: 4×4 matrix, OpenCV axes, metres.
        intrinsics: width, height, fx, fy, cx and cy in pixels.
        box: (8, 3) corners of the object's bounding box in the world, metres.
        azimuth_deg, elevation_deg, distance_m, visible_share, picture_share: as in `GridCamera`.
        renderer: simulator that rendered the images; None, and not written, for our own renderers.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    path: str
    frame: str
    object: str
    class_name: str | int
    variant: str
    world: str
    place: str
    sky: str
    camera: int
    weathers: list[str]
    T_world_camera: list[list[float]]
    T_world_object: list[list[float]]
    intrinsics: dict[str, float]
    box: list[list[float]]
    azimuth_deg: float
    elevation_deg: float
    distance_m: float
    visible_share: float
    picture_share: float
    renderer: str | None = None

    @model_serializer(mode="wrap")
    def _dump(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {name: value for name, value in dump(self).items() if name != "renderer" or value is not None}


def name_picture(weather: WeatherKey) -> str:
    """`clear`, `fog-3`: the picture's file without its suffix."""
    name, severity = weather
    return f"{name}-{severity}" if severity else name


class KeptFrames:
    """The folder `frames/` of a run, and which frames belong into it."""

    def __init__(
        self, folder: Path, stage: Stage, places: tuple[PlaceCameras, ...], spec: ObjectSpec, everything: bool
    ) -> None:
        """Read what is there.

        Args:
            everything: keep all frames; otherwise a camera of each place.
        """
        self.renderer: str | None = None
        self.folder, self._stage, self._spec = folder, stage, spec
        self.shown = {place.placed.spot.name: choose_shown(place) for place in places}
        self._everything = everything
        self._log = RecordLog(folder / "manifest.jsonl", KeptFrame, required=False)
        self._known = self._log.read_last(lambda record: record.path)

    @property
    def object_name(self) -> str:
        """Name of the object at the place."""
        return self._spec.name

    def wants(self, task: PictureTask) -> bool:
        """Whether a frame is kept."""
        return self._everything or task.camera.number == self.shown[self._name(task)].number

    def lacks(self, task: PictureTask) -> bool:
        """Whether a frame is kept, and is not there in all of its weathers."""
        if not self.wants(task):
            return False
        record = self._known.get(self.path_of(self._name(task), task.variant, task.camera))
        if record is None or record.frame != task.frame:
            return True
        names = [name_picture(weather) for weather in task.weathers]
        folder = self.folder / record.path
        # the line and the file itself: either may be missing
        return any(name not in record.weathers or not (folder / f"{name}.png").is_file() for name in names)

    def describe_renderers(self, tasks: Iterable[PictureTask]) -> str:
        """The simulators that made the pictures of tasks, each once."""
        paths = [self.path_of(self._name(task), task.variant, task.camera) for task in tasks]
        return "; ".join(sorted({self._known[path].renderer or "" for path in paths}))

    def has_shown(self, place: PlaceCameras, variants: Iterable[str], weathers: Iterable[WeatherKey]) -> bool:
        """Whether the pictures of a place that are shown are there, and none of its camera failed."""
        name = place.placed.spot.name
        folders = [self.folder / self.path_of(name, variant, self.shown[name]) for variant in variants]
        pictures = [f"{name_picture(weather)}.png" for weather in weathers]
        is_there = all((folder / picture).is_file() for folder in folders for picture in pictures)
        return is_there and self.shown[name] in place.cameras

    def find_object(self, path: str) -> tuple[int, int, int, int]:
        """Return the square around the object in a kept frame: left, top, right and bottom, pixels, in the image."""
        record = self._known[path]
        from_world, size = np.linalg.inv(record.T_world_camera), record.intrinsics
        # corners of the object's box in the camera's axes, then pixels of a pinhole
        x, y, z = from_world[:3, :3] @ np.array(record.box).T + from_world[:3, 3:]
        u, v = size["fx"] * x / z + size["cx"], size["fy"] * y / z + size["cy"]
        width, height = int(size["width"]), int(size["height"])
        # a square with a margin, moved until it lies in the frame
        side = min(width, height, OBJECT_MARGIN * max(np.ptp(u), np.ptp(v)))
        left = float(np.clip((u.min() + u.max() - side) / 2, 0, width - side))
        top = float(np.clip((v.min() + v.max() - side) / 2, 0, height - side))
        return round(left), round(top), round(left + side), round(top + side)

    def path_of(self, place: str, variant: str, camera: GridCamera) -> str:
        """Folder of a frame below `frames/`."""
        return f"{place}/{variant}/{camera.number:04d}"

    def write(self, task: PictureTask, files: Mapping[str, bytes]) -> None:
        """Put a frame's files into the folder, then its line into the manifest.

        Raises:
            ToolkitError: the disk is full or may not be written.
        """
        path = self.path_of(self._name(task), task.variant, task.camera)
        names = [name_picture(weather) for weather in task.weathers]
        # files first, the line last: a frame with a line is whole
        for name, content in files.items():
            write_bytes(self.folder / path / name, content)
        before = self._known.get(path)
        # another run in other weathers adds its pictures to the same frame
        if before is not None and before.frame == task.frame:
            names = list(dict.fromkeys([*before.weathers, *names]))
        record = self._describe(path, task, names)
        # a run that was killed before its answer was noted makes the frame again: its line is there
        if record != before:
            self._log.append(record)
            self._known[path] = record

    def _name(self, task: PictureTask) -> str:
        return self._stage.places[task.place].spot.name

    def _describe(self, path: str, task: PictureTask, names: list[str]) -> KeptFrame:
        stage, camera = self._stage, task.camera
        placed = stage.places[task.place]
        return KeptFrame(
            path=path, frame=task.frame, object=self._spec.name, class_name=self._spec.class_name,
            variant=task.variant, world=f"{stage.world.name}/{stage.world.seed}", place=placed.spot.name,
            sky=stage.sky.name, camera=camera.number, weathers=names, T_world_camera=camera.T_world_camera.tolist(),
            T_world_object=pose_of(placed.stand).tolist(), intrinsics=stage.camera.intrinsics,
            box=np.round(placed.box, 6).tolist(), azimuth_deg=camera.azimuth_deg, elevation_deg=camera.elevation_deg,
            distance_m=camera.distance_m, visible_share=camera.visible_share, picture_share=camera.picture_share,
            renderer=self.renderer,
        )  # fmt: skip


def encode_frame(frame: Frame) -> dict[str, bytes]:
    """The files of a kept frame by name: a picture for each weather, depth and classes."""
    pictures = zip(frame.task.weathers, frame.pictures, strict=True)
    # OpenCV writes blue first
    files = {f"{name_picture(weather)}.png": _encode(picture[..., ::-1]) for weather, picture in pictures}
    if frame.depth_m is not None and frame.classes is not None:
        files |= {"depth.png": _encode(encode_depth(frame.depth_m)), "classes.png": _encode(frame.classes)}
    return files


def choose_shown(place: PlaceCameras) -> GridCamera:
    """The camera of a place whose pictures are shown: the object whole, from a little above, three quarters ahead."""
    best = max(camera.visible_share for camera in place.cameras)
    # whole, or as much of it as any camera sees
    seeing = [camera for camera in place.cameras if camera.visible_share >= min(0.9, best)]
    length = float(np.ptp(place.placed.mesh.bounds, axis=0).max())
    azimuth, elevation, lengths = SHOWN_AT

    def miss(camera: GridCamera) -> float:
        # each in a unit that counts as a large difference: a quarter turn, 30°, a length
        turn = abs((abs((camera.azimuth_deg + 180) % 360 - 180)) - azimuth) / 90
        rise = abs(camera.elevation_deg - elevation) / 30
        return turn + rise + abs(camera.distance_m / length - lengths)

    return min(seeing, key=miss)


def pose_of(stand: Stand) -> np.ndarray:
    """(4, 4) `T_world_object`."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = stand.turn, stand.place
    return pose


def encode_depth(depth_m: np.ndarray) -> np.ndarray:
    """(h, w) uint16 centimetres; 0 is the sky, and what is further than 655 m is at 655.34 m."""
    # 0 stands for the sky, so that what is nearest begins at 1
    centimetres = np.minimum(np.nan_to_num(depth_m, posinf=0.0) * CM_PER_M, FARTHEST_CM).round()
    return np.where(np.isinf(depth_m), 0, np.maximum(centimetres, 1)).astype(np.uint16)


def _encode(pixels: np.ndarray) -> bytes:
    done, content = cv2.imencode(".png", np.ascontiguousarray(pixels))
    if not done:
        raise ValueError("OpenCV made no PNG")
    return content.tobytes()


class ShotFrames(NamedTuple):
    """Frames that lie in a folder."""

    folder: Path  # `frames/` of a run
    places: tuple[str, ...]  # names by the tasks' numbers
    renderer: str  # who made them

    def frames(self, tasks: Sequence[PictureTask]) -> Iterator[Frame]:
        """The pictures of tasks, without depth and classes, which lie there already.

        Raises:
            ToolkitError: a file is gone or no picture.
        """
        for task in tasks:
            yield Frame(task._replace(is_kept=False), tuple(self._decode(task, weather) for weather in task.weathers))

    def hash_pictures(self, task: PictureTask) -> list[object]:
        """Identity of a task's pictures: who made them, and their bytes."""
        files = [self._file(task, weather) for weather in task.weathers]
        return [self.renderer, [[file.stem, sha256_bytes(read_bytes(file, MOST_PICTURE_BYTES))] for file in files]]

    def _file(self, task: PictureTask, weather: WeatherKey) -> Path:
        folder = self.folder / self.places[task.place] / task.variant / f"{task.camera.number:04d}"
        return folder / f"{name_picture(weather)}.png"

    def _decode(self, task: PictureTask, weather: WeatherKey) -> np.ndarray:
        file = self._file(task, weather)
        try:
            return decode_frame(read_bytes(file, MOST_PICTURE_BYTES), file)
        except UnreadableImage as error:
            raise ToolkitError(f"{error}: delete it and run again, with the simulator running") from None
