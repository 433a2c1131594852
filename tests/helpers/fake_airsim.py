"""A simulator for the tests: a thread that speaks msgpack-rpc as AirSim, Colosseum or Cosys-AirSim do.

It counts arguments and looks at their types as their servers do, draws a small world from the actors in it, and shows
it late, as game engines do. `faults` make it misbehave. Its frames are worked out here once more, by hand.
"""

import socket
import threading
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import cv2
import msgpack
import numpy as np

POSE, TEXT = dict, str
COMMON: dict[str, tuple[type, ...]] = {
    "getServerVersion": (), "simPause": (bool,), "simIsPaused": (), "simContinueForTime": (float,),
    "simContinueForFrames": (int,), "simEnableWeather": (bool,), "simSetWeatherParameter": (int, float),
    "simSetVehiclePose": (POSE, bool, TEXT), "simListSceneObjects": (TEXT,), "simListAssets": (),
    "simSpawnObject": (TEXT, TEXT, POSE, dict, bool, bool), "simDestroyObject": (TEXT,),
    "simSetObjectPose": (TEXT, POSE, bool), "simSetSegmentationObjectID": (TEXT, int, bool),
}  # fmt: skip
OWN: dict[str, dict[str, tuple[type, ...]]] = {
    "airsim": {
        "simGetImages": (list, TEXT, bool), "simSetCameraPose": (TEXT, POSE, TEXT, bool),
        "simSetCameraFov": (TEXT, float, TEXT, bool), "simGetObjectPose": (TEXT,),
    },
    "cosys": {
        "simGetImages": (list, TEXT), "simSetCameraPose": (TEXT, POSE, TEXT), "simSetCameraFov": (TEXT, float, TEXT),
        "simGetObjectPose": (TEXT, bool),
    },
}  # fmt: skip
OWN["old"] = {**OWN["airsim"], "simSpawnObject": (TEXT, TEXT, POSE, dict, bool)}
VERSIONS = {"airsim": 1, "old": 1, "cosys": 4}
SKY_M = 65504.0
Drawn = tuple[np.ndarray, np.ndarray, np.ndarray]
"""(h, w, 3) RGB, (h, w) depth in metres, (h, w, 3) colours of a segmentation."""


@dataclass
class FakeAirSim:
    """What runs behind the port.

    Attributes:
        flavour: `airsim` (AirSim 1.8, Colosseum), `old` (AirSim 1.4) or `cosys`.
        draw: (the fake) -> what its camera sees now.
        assets: names that can be spawned.
        lag: frames until a new pose is drawn.
        faults: method -> an error's words, or what to do: `hang`, `close`, `garbage`, `http`, `none`.
    """

    flavour: str = "airsim"
    draw: Callable[["FakeAirSim"], Drawn] = lambda fake: fake.draw_empty()
    assets: tuple[str, ...] = ("crate_unpatched", "crate_patched")
    lag: int = 3
    side_px: int = 16
    faults: dict[str, Any] = field(default_factory=dict)
    calls: list[tuple[str, list[Any]]] = field(default_factory=list)
    actors: dict[str, dict] = field(default_factory=dict)
    weather: dict[int, float] = field(default_factory=dict)
    is_paused: bool = False
    is_weather_on: bool = False
    fov_deg: float = 90.0
    asked_pose: dict | None = None
    shown_pose: dict | None = None
    wait: int = 0
    pictures: int = 0

    def answer(self, method: str, arguments: list[Any]) -> tuple[Any, Any]:
        """(error, result) of a call."""
        self.calls.append((method, arguments))
        takes = {**COMMON, **OWN[self.flavour]}
        if self.flavour == "old":
            takes.pop("simContinueForFrames")
        if method not in takes:
            return (
                f"rpclib: client error C0001: Function '{method}' (called with {len(arguments)} arg(s)) not found",
                None,
            )
        if len(arguments) != len(takes[method]):
            return (
                f"rpclib: client error C0002: Function '{method}' was called with an invalid number of arguments. "
                f"Expected: {len(takes[method])}, got: {len(arguments)}"
            ), None
        for kind, given in zip(takes[method], arguments, strict=True):
            if type(given) is not kind:
                return f"rpclib: function '{method}' threw an exception: std::bad_cast", None
        if method in self.faults:
            fault = self.faults[method]
            return (fault, None) if isinstance(fault, str | list | dict) else (None, fault(self, *arguments))
        return None, getattr(self, method)(*arguments)

    def getServerVersion(self) -> int:
        return VERSIONS[self.flavour]

    def simPause(self, is_paused: bool) -> None:
        self.is_paused = is_paused

    def simIsPaused(self) -> bool:
        return self.is_paused

    def simContinueForTime(self, seconds: float) -> None:
        self.simContinueForFrames(1)

    def simContinueForFrames(self, frames: int) -> None:
        assert self.is_paused
        self.tick(frames)

    def tick(self, frames: int) -> None:
        self.wait -= frames
        if self.wait <= 0:
            self.shown_pose = self.asked_pose

    def simEnableWeather(self, on: bool) -> None:
        self.is_weather_on = on

    def simSetWeatherParameter(self, number: int, value: float) -> None:
        assert self.is_weather_on and 0 <= value <= 1
        self.weather[number] = value

    def simSetCameraPose(self, camera: str, pose: dict, vehicle: str, external: bool = False) -> None:
        assert list(pose["position"].values()) == [0, 0, 0] and pose["orientation"]["w_val"] == 1

    def simSetCameraFov(self, camera: str, fov_deg: float, vehicle: str, external: bool = False) -> None:
        self.fov_deg = fov_deg

    def simSetVehiclePose(self, pose: dict, ignore_collision: bool, vehicle: str) -> None:
        self.asked_pose, self.wait = pose, self.lag
        self.shown_pose = self.shown_pose or pose

    def simListSceneObjects(self, pattern: str) -> list[str]:
        return [name for name in self.actors if name.startswith(pattern.removesuffix(".*"))]

    def simListAssets(self) -> list[str]:
        return [*self.assets, "Cube"]

    def simSpawnObject(self, name: str, asset: str, pose: dict, scale: dict, *flags: bool) -> str:
        assert asset in self.assets and name not in self.actors and list(scale.values()) == [1, 1, 1]
        self.actors[f"{name}_7"] = pose  # the engine makes names unique
        return f"{name}_7"

    def simDestroyObject(self, name: str) -> bool:
        return self.actors.pop(name, None) is not None

    def simSetObjectPose(self, name: str, pose: dict, teleport: bool) -> bool:
        self.actors[name] = pose
        return True

    def simGetObjectPose(self, name: str, ned: bool = True) -> dict:
        assert ned
        return self.actors[name]

    def simSetSegmentationObjectID(self, name: str, number: int, is_regex: bool) -> bool:
        return True

    def simGetImages(self, requests: list[dict], vehicle: str, external: bool = False) -> list[dict]:
        self.pictures += 1
        keys = {"camera_name", "image_type", "pixels_as_float", "compress"}
        keys |= {"annotation_name"} if self.flavour == "cosys" else set()
        assert all(set(request) == keys for request in requests)
        picture, depth, colours = self.draw(self)
        planes = {0: picture, 2: depth, 5: colours}
        replies = [self._reply(request, planes[request["image_type"]]) for request in requests]
        self.tick(1)
        return replies

    def _reply(self, request: dict, plane: np.ndarray) -> dict:
        is_depth = request["pixels_as_float"]
        content = b"" if is_depth else cv2.imencode(".png", np.ascontiguousarray(plane[..., ::-1]))[1].tobytes()
        return {
            "image_data_uint8": content,
            "image_data_float": plane.ravel().tolist() if is_depth else [0.0],
            "camera_position": self.shown_pose["position"], "camera_orientation": self.shown_pose["orientation"],
            "camera_name": request["camera_name"], "time_stamp": 1, "message": "", "pixels_as_float": is_depth,
            "compress": request["compress"], "width": plane.shape[1], "height": plane.shape[0],
            "image_type": request["image_type"],
        }  # fmt: skip

    def draw_empty(self) -> Drawn:
        """Grey to the horizon, which tells the pose: one pixel is as far north as the camera is."""
        side = self.side_px
        picture = np.full((side, side, 3), (200, 100, 50), np.uint8)
        depth = np.full((side, side), SKY_M)
        depth[0, 0] = self.shown_pose["position"]["x_val"]
        return picture, depth, np.zeros((side, side, 3), np.uint8)


def matrix_of(pose: dict) -> np.ndarray:
    """(4, 4) of position and quaternion, by the textbook formula."""
    w, x, y, z = (pose["orientation"][f"{axis}_val"] for axis in "wxyz")
    found = np.eye(4)
    found[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    found[:3, 3] = [pose["position"][f"{axis}_val"] for axis in "xyz"]
    return found


@contextmanager
def serve(fake: FakeAirSim, at_all: str = ""):
    """The port of a fake; `at_all` is done in place of every answer: `hang`, `close`, `http` or `garbage`."""
    listener = socket.create_server(("127.0.0.1", 0))
    done = threading.Event()

    def talk(line: socket.socket) -> None:
        unpacker = msgpack.Unpacker()
        while not done.is_set():
            content = line.recv(1 << 16)
            if not content:
                return
            unpacker.feed(content)
            for kind, number, method, arguments in unpacker:
                assert kind == 0
                what = at_all or fake.faults.get(f"at {method}", "")
                if what == "hang":
                    done.wait(10)
                    return
                if what == "close":
                    return
                if what in ("http", "garbage"):
                    line.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n" if what == "http" else b"\xc1" * 64)
                    return
                error, result = fake.answer(method, arguments)
                in_bytes = fake.flavour == "cosys"  # others send pictures as text
                line.sendall(msgpack.packb([1, number, error, result], use_bin_type=in_bytes))

    def accept() -> None:
        while not done.is_set():
            try:
                line, _ = listener.accept()
            except OSError:
                return
            with line:
                try:
                    talk(line)
                except (OSError, AssertionError) as error:
                    fake.calls.append(("broke", [repr(error)]))

    thread = threading.Thread(target=accept, daemon=True)
    thread.start()
    try:
        yield listener.getsockname()[1]
    finally:
        done.set()
        listener.close()
