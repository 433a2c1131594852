"""Cameras, weather and objects in a running simulator of AirSim's family: AirSim, Colosseum and Cosys-AirSim.

Functions, their arguments and the replies are as in the servers' sources: `AirLib/src/api/RpcLibServerBase.cpp` and
`RpcLibAdaptorsBase.hpp` of microsoft/AirSim, CodexLabsLLC/Colosseum and Cosys-Lab/Cosys-AirSim (MIT).
"""

import contextlib
import math
import re
import reprlib
import socket
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np

from toolkit.core.child import limit_memory, without_collector
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.extras import import_package
from toolkit.core.text import shorten
from toolkit.imaging.read import MAX_SIDE_PX, UnreadableImage, decode_frame
from toolkit.rig.camera import as_quaternion

REQUEST, REPLY = 0, 1
MOST_REPLY_BYTES = 256 << 20
"""Largest size of a reply, bytes: three pictures of 4096² with depth as floats."""
MOST_BYTES = 1 << 30
"""Largest size of a reply in Python, bytes; a byte may become a separate object."""
MOST_LEVELS = 8
"""Largest depth of nested words in an error."""
CHUNK_BYTES = 1 << 20
LONGEST_WORDS = 300
ARGUMENT_COUNT = re.compile(r"invalid number of arguments\. Expected: (\d+)")
NOT_FOUND = re.compile(r"Function '\w+' .*not found|could not find function", re.IGNORECASE)
NED_WORLD = np.array([(0.0, 1, 0), (1, 0, 0), (0, 0, -1)])
"""From our axes, z up, to north, east, down; it is its own inverse."""
BODY_CAMERA = np.array([(0.0, 0, 1), (1, 0, 0), (0, 1, 0)])
"""From OpenCV's axes of a camera (right, down, forward) to the simulator's (forward, right, down)."""
NEAR_M, NEAR_DEG = 0.01, 0.1
SCHEME, PORT = "airsim", 41451
EXPECTED = f"expected raycast or {SCHEME}://HOST:PORT, such as {SCHEME}://127.0.0.1:{PORT}"
OPTIONS = ("camera", "vehicle", "origin")
WEATHER_NUMBERS = {
    "Rain": 0, "Roadwetness": 1, "Snow": 2, "RoadSnow": 3, "MapleLeaf": 4, "RoadLeaf": 5, "Dust": 6, "Fog": 7,
}  # fmt: skip
"""`WeatherParameter`, the same in AirSim 1.3 and later, Colosseum and Cosys-AirSim."""
SCENE, DEPTH_PERSPECTIVE, SEGMENTATION = 0, 2, 5
FIRST_COSYS = 2
"""`getServerVersion` from which on it is Cosys-AirSim; AirSim and Colosseum both say 1."""
STEP_FRAMES, STEP_S, TRIES = 2, 0.05, 8
SETTLE_S, PAUSE_S = 2.0, 30.0
"""Simulated seconds in which drops and flakes come down, and real ones in which a step ends."""
ENDLESS_M = 60_000.0
"""Depth from which on a ray met nothing: the simulators write 65,504 or 65,535."""
PARKED_UP_M = 3000.0
OBJECT_NUMBER = 42


class CallError(ToolkitError):
    """The server answered a call with an error.

    Attributes:
        words: the server's own.
    """

    def __init__(self, where: str, method: str, words: str) -> None:
        self.words = words
        super().__init__(f"{where} refuses {method}: {shorten(words, LONGEST_WORDS)}")

    @property
    def expected_arguments(self) -> int | None:
        """How many arguments the server's function takes, where their number was the error."""
        found = ARGUMENT_COUNT.search(self.words)
        return int(found[1]) if found else None

    @property
    def is_unknown(self) -> bool:
        """Whether the server has no such function."""
        return NOT_FOUND.search(self.words) is not None


class Connection:
    """A connection to a msgpack-rpc server; a context manager that closes it.

    Attributes:
        where: the server's address as errors name it.
        timeout_s: longest wait for a reply.
    """

    def __init__(self, host: str, port: int, where: str, timeout_s: float = 60.0) -> None:
        """Connect; raises a `ToolkitError` if msgpack is not installed, or nobody answers."""
        msgpack = import_package("msgpack", "airsim", "a simulator")
        self.where, self.timeout_s = where, timeout_s
        self._pack = msgpack.Packer()
        # raw: pictures come as text or as bytes, by the server's version
        self._unpacker = msgpack.Unpacker(raw=True, strict_map_key=False, max_buffer_size=MOST_REPLY_BYTES)
        self._calls = 0
        try:
            self._socket = socket.create_connection((host, port), timeout=min(timeout_s, 10.0))
        except OSError as error:
            raise ToolkitError(
                f"{where}: no answer ({error.strerror or error}): start the simulator, press Play, and check host "
                "and port (ApiServerPort in its settings.json)"
            ) from None

    def __enter__(self) -> "Connection":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Hang up."""
        with contextlib.suppress(OSError):
            self._socket.close()

    def call(self, method: str, *arguments: object) -> object:
        """The result of a server's function; texts in it are bytes.

        Raises:
            CallError: the server answers with an error.
            ToolkitError: no answer in time, no connection any more, or an answer that is no msgpack-rpc.
        """
        self._calls += 1
        try:
            self._socket.settimeout(self.timeout_s)
            # the number of the call comes back with its reply, so an answer to an earlier call is noticed
            self._socket.sendall(self._pack.pack([REQUEST, self._calls, method, list(arguments)]))
            with limit_memory(MOST_BYTES), without_collector():
                reply = self._receive(method)
        except MemoryError:
            raise ToolkitError(
                f"{self.where}: its answer to {method} takes over {MOST_BYTES >> 30} GB: ask for smaller pictures"
            ) from None
        except TimeoutError:
            raise ToolkitError(
                f"{self.where}: no answer to {method} within {self.timeout_s:g} s: see whether the simulator still runs"
            ) from None
        except OSError as error:
            raise self._lost(method, str(error.strerror or error)) from None
        # a reply is [1, number of the call, error, result] (msgpack-rpc's specification)
        if not isinstance(reply, list) or len(reply) != 4 or reply[:2] != [REPLY, self._calls]:
            raise self._no_rpc(method)
        if reply[2] is not None:
            raise CallError(self.where, method, _words_of(reply[2]))
        return reply[3]

    def _receive(self, method: str) -> object:
        import msgpack

        # a limit for the whole answer, however many pieces it comes in
        end = time.monotonic() + self.timeout_s
        while True:
            try:
                return self._unpacker.unpack()
            except msgpack.OutOfData:
                pass
            except (ValueError, TypeError, msgpack.UnpackException):  # a map's key may be a list
                raise self._no_rpc(method) from None
            # what is left of the whole: a server that sends a byte now and then must not hold us for ever
            self._socket.settimeout(max(end - time.monotonic(), 1e-3))
            content = self._socket.recv(CHUNK_BYTES)
            if not content:
                raise self._lost(method, "it closed the connection")
            try:
                self._unpacker.feed(content)
            except msgpack.BufferFull:
                raise ToolkitError(
                    f"{self.where}: its answer to {method} is larger than {MOST_REPLY_BYTES >> 20} MB: ask for smaller "
                    "pictures"
                ) from None

    def _lost(self, method: str, why: str) -> ToolkitError:
        return ToolkitError(f"{self.where}: lost during {method} ({why}): see the simulator's window or its log")

    def _no_rpc(self, method: str) -> ToolkitError:
        return ToolkitError(
            f"{self.where}: what answers {method} does not speak msgpack-rpc: expected a simulator of AirSim's family; "
            "check the port"
        )


def _words_of(error: object, levels: int = MOST_LEVELS) -> str:
    """A server's error in words: a text, or a list or map that holds a text."""
    if isinstance(error, bytes):
        return error.decode("utf-8", errors="replace")
    if isinstance(error, dict):
        error = list(error.values())
    if isinstance(error, Sequence) and not isinstance(error, str):
        return ", ".join(_words_of(part, levels - 1) for part in error[:MOST_LEVELS]) if levels else ""
    return str(error)


def camera_to_ned(T_world_camera: np.ndarray, origin: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    """(4, 4) `T_ned_body` of a camera, metres: its body looks along x."""
    return _to_ned(T_world_camera, BODY_CAMERA.T, origin)


def object_to_ned(T_world_object: np.ndarray, origin: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    """(4, 4) `T_ned_actor` of an object's GLB, metres."""
    return _to_ned(T_world_object, NED_WORLD, origin)


def _to_ned(T_world_thing: np.ndarray, thing_body: np.ndarray, origin: tuple[float, float, float]) -> np.ndarray:
    pose = np.eye(4)
    # a change of basis on both sides: the world's axes, and those of the thing itself
    pose[:3, :3] = NED_WORLD @ T_world_thing[:3, :3] @ thing_body
    pose[:3, 3] = NED_WORLD @ T_world_thing[:3, 3] + origin
    return pose


def pack_pose(pose: np.ndarray) -> dict[str, dict[str, float]]:
    """A (4, 4) pose as calls take it."""
    w, x, y, z = as_quaternion(pose[:3, :3]).tolist()
    north, east, down = pose[:3, 3].tolist()
    return {
        "position": {"x_val": north, "y_val": east, "z_val": down},
        "orientation": {"w_val": w, "x_val": x, "y_val": y, "z_val": z},
    }


def unpack_pose(found: object, where: str) -> np.ndarray:
    """(4, 4) of a reply's pose, named `where` in errors; a `ToolkitError` where it is none."""
    from scipy.spatial.transform import Rotation

    fields = read_fields(found, where)
    # the order x, y, z, w is SciPy's as well
    position, turn = (read_fields(fields.get(name), where) for name in ("position", "orientation"))
    numbers = np.array([_number(position.get(f"{axis}_val")) for axis in "xyz"])
    quaternion = np.array([_number(turn.get(f"{axis}_val")) for axis in "xyzw"])
    # a quaternion of a rotation has length 1
    if not np.isfinite([*numbers, *quaternion]).all() or not 0.5 < np.abs(quaternion).sum() < 4:
        raise ToolkitError(f"{where}: expected a pose, found {show({**position, **turn})}")
    pose = np.eye(4)
    pose[:3, 3], pose[:3, :3] = numbers, Rotation.from_quat(quaternion).as_matrix()
    return pose


def _number(value: object) -> float:
    try:
        return float(value) if isinstance(value, int | float) else math.nan
    except OverflowError:  # a whole number of a reply has any length
        return math.inf


def show(found: object) -> str:
    """A server's answer in a few words, however long it is."""
    return reprlib.repr(found)


def find_miss(found: np.ndarray, wanted: np.ndarray) -> str | None:
    """How far a pose is from another, in words; None where it is there."""
    away_m = float(np.linalg.norm(found[:3, 3] - wanted[:3, 3]))
    # the trace of a rotation by an angle a is 1 + 2 cos a
    cosine = (np.trace(found[:3, :3].T @ wanted[:3, :3]) - 1) / 2
    turned_deg = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return None if away_m <= NEAR_M and turned_deg <= NEAR_DEG else f"{away_m:.3g} m and {turned_deg:.3g}°"


def read_fields(found: object, where: str) -> dict[str, object]:
    """A reply's map by text; a `ToolkitError` where it is none."""
    if not isinstance(found, dict):
        raise ToolkitError(f"{where}: expected a map, found {show(found)}")
    return {
        key.decode("utf-8", "replace") if isinstance(key, bytes) else str(key): value for key, value in found.items()
    }


@dataclass(frozen=True)
class Address:
    """A simulator's server, and what is used of it."""

    host: str  # host, port: of its server
    port: int = PORT
    camera: str = "0"  # camera, vehicle: names in its settings; empty for the first vehicle
    vehicle: str = ""
    # (3,) where our world's origin lies, metres north, east and down
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def parse(cls, text: str) -> "Address":
        """From `airsim://HOST:PORT?camera=0&vehicle=NAME&origin=N,E,D`; all but the host may be left out.

        Raises:
            FieldError: another scheme, no host, a port that is none, or an unknown option.
        """
        # urlsplit raises for a port out of range, parse_qs for an option without a value
        try:
            parts = urlsplit(text)
            host, port = parts.hostname, parts.port or PORT
            options = parse_qs(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
        except ValueError as error:
            raise FieldError(f"{EXPECTED} ({error})", {"renderer": text}) from None
        if parts.scheme != SCHEME or not host or parts.path.strip("/") or parts.fragment:
            raise FieldError(EXPECTED, {"renderer": text})
        # a misspelt option must not fall back to its default unnoticed
        unknown = [name for name in options if name not in OPTIONS]
        if unknown:
            raise FieldError(f"no option called '{unknown[0]}': known: {', '.join(OPTIONS)}", {"renderer": text})
        given = {name: values[-1] for name, values in options.items()}
        try:
            north, east, down = (float(number) for number in given.get("origin", "0,0,0").split(","))
            is_finite = bool(np.isfinite([north, east, down]).all())
        except ValueError:
            is_finite = False
        if not is_finite:
            raise FieldError("expected metres north, east and down, such as origin=10,-4,0", {"renderer": text})
        return cls(host, port, given.get("camera", "0"), given.get("vehicle", ""), (north, east, down))

    def __str__(self) -> str:
        return f"{SCHEME}://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"


@dataclass(frozen=True)
class SimulatorShot:
    """Pictures of a simulator's camera."""

    picture: np.ndarray  # (h, w, 3) uint8 sRGB
    depth_m: np.ndarray  # (h, w) float32 along each ray, inf where it met nothing
    segmentation: np.ndarray  # (h, w, 3) uint8, a colour for each thing


class AirSim:
    """A running simulator, paused while it is used; a context manager that lets it run again.

    Attributes:
        address: of its server.
        version: what `getServerVersion` says.
    """

    def __init__(self, address: Address, timeout_s: float = 60.0) -> None:
        """Connect, find out which simulator answers, and pause it.

        Raises:
            ToolkitError: nobody answers, what answers is no simulator, or it cannot be paused.
        """
        self.address = address
        self._rpc = Connection(address.host, address.port, str(address), timeout_s)
        self._counts: dict[str, int] = {}
        self._weather: dict[str, float] = {}
        self._actors: dict[str, str] = {}
        self._spawned: list[str] = []
        try:
            # any program may answer on that port: only a simulator answers this with a number
            version = self._rpc.call("getServerVersion")
            if not isinstance(version, int):
                raise ToolkitError(f"{address}: getServerVersion says {show(version)}: expected a number, as AirSim's")
            self.version = version
            # paused from here on, or pictures would not fit their poses
            self._pause()
        except BaseException:
            self._rpc.close()
            raise

    def __enter__(self) -> "AirSim":
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        """Take away what was spawned, clear the air and let the simulator run, if it still can."""
        # the level is left as it was found; a failed clean-up must not hide the error that ended the run
        try:
            for name in self._spawned:
                self._call("simDestroyObject", name)
            self.set_weather({})
            self._call("simPause", False)
        except ToolkitError:
            if kind is None:
                raise
        finally:
            self._rpc.close()

    @property
    def is_cosys(self) -> bool:
        """Whether it is Cosys-AirSim."""
        return self.version >= FIRST_COSYS

    def describe(self) -> str:
        """`Cosys-AirSim, server version 4`; AirSim and Colosseum cannot be told apart from outside."""
        return f"{'Cosys-AirSim' if self.is_cosys else 'AirSim or Colosseum'}, server version {self.version}"

    def set_camera(self, fov_deg: float) -> None:
        """Put the camera into the middle of its vehicle, and set its horizontal field of view."""
        name, vehicle = self.address.camera, self.address.vehicle
        self._call("simSetCameraPose", name, pack_pose(np.eye(4)), vehicle, False)
        self._call("simSetCameraFov", name, float(fov_deg), vehicle, False)

    def set_weather(self, numbers: Mapping[str, float]) -> None:
        """Set AirSim's weather parameters, each 0 to 1, and let it come up; all others are 0."""
        # only what differs: each change costs the seconds in which it comes down
        changed = {
            name: float(numbers.get(name, 0.0))
            for name in {**self._weather, **numbers}
            if numbers.get(name, 0.0) != self._weather.get(name, 0.0)
        }
        # weather is switched on once, before its first parameter
        if changed and not self._weather:
            self._call("simEnableWeather", True)
        for name, number in changed.items():
            self._call("simSetWeatherParameter", WEATHER_NUMBERS[name], number)
            self._weather[name] = number
        # drops and flakes come down in simulated time: it runs for a while, then pauses again
        if changed:
            self._call("simContinueForTime", SETTLE_S)
            self._wait_until_paused()

    def number_things(self) -> None:
        """Give all things one segmentation colour, so that only the object differs; Cosys-AirSim does this itself."""
        if not self.is_cosys:
            self._call("simSetSegmentationObjectID", r"[\w]*", 0, True)

    def place(self, name: str, T_world_object: np.ndarray | None) -> None:
        """Put an actor where an object stands; an actor that is not in the level is spawned from the asset of its name.

        Args:
            T_world_object: (4, 4) in metres; None takes it out of sight.

        Raises:
            ToolkitError: there is neither, or it cannot be moved.
        """
        # "out of sight" is a place far above everything
        away = np.eye(4)
        away[2, 3] = PARKED_UP_M
        pose = object_to_ned(away if T_world_object is None else T_world_object, self.address.origin)
        actor = self._actors.get(name) or self._find_actor(name, pose)
        self._actors[name] = actor
        moved = self._call("simSetObjectPose", actor, pack_pose(pose), True)
        found = unpack_pose(self._call("simGetObjectPose", actor, True), self._where("simGetObjectPose"))
        # asked back: what counts is where it ended up
        miss = find_miss(found, pose)
        if not moved or miss is not None:
            raise ToolkitError(
                f"{self.address}: actor '{actor}' cannot be moved{f' (it is {miss} away)' if miss else ''}: set its "
                "Mobility to Movable and its physics off"
            )

    def shoot(self, T_world_camera: np.ndarray) -> SimulatorShot:
        """Picture, depth and segmentation of the camera at a pose, in the weather that is set.

        The simulator is stepped, its first pictures are dropped, and the pose that comes with the next ones is checked.

        Raises:
            ToolkitError: the camera never comes there, or a reply cannot be read.
        """
        # pose and pictures come in the order in which the simulator gets them
        pose = camera_to_ned(T_world_camera, self.address.origin)
        self._call("simSetVehiclePose", pack_pose(pose), True, self.address.vehicle)
        miss = None
        for _ in range(TRIES):
            self._step()
            # the first picture may still be of the pose before
            self._get_images(SCENE)
            replies = self._get_images(SCENE, DEPTH_PERSPECTIVE, SEGMENTATION)
            misses = [find_miss(reply.pose, pose) for reply in replies]
            miss = next((miss for miss in misses if miss), None)
            if miss is None:
                picture, depth, segmentation = replies
                return SimulatorShot(picture.decode(), depth.read_depth(), segmentation.decode())
        raise ToolkitError(
            f"{self.address}: camera '{self.address.camera}' is still {miss} from where it was put after {TRIES} "
            'frames: set "SimMode": "ComputerVision" in the simulator\'s settings.json, and leave out the vehicle\'s '
            "X, Y, Z"
        )

    def _pause(self) -> None:
        try:
            self._call("simPause", True)
            is_paused = self._call("simIsPaused")
        except CallError as error:
            raise self._no_pause(error.words) from None
        if is_paused is not True:
            raise self._no_pause("it runs on")

    def _no_pause(self, why: str) -> ToolkitError:
        return ToolkitError(
            f"{self.address} cannot be paused ({shorten(why)}): pictures would not fit their poses; take a version "
            "whose simPause works in its SimMode, AirSim 1.4 or later"
        )

    def _step(self) -> None:
        """Let some frames pass."""
        # a server that cannot step by frames is stepped by time
        try:
            self._call("simContinueForFrames", STEP_FRAMES)
        except CallError as error:
            if not error.is_unknown:
                raise
            self._call("simContinueForTime", STEP_S)
        self._wait_until_paused()

    def _wait_until_paused(self) -> None:
        end = time.monotonic() + PAUSE_S
        while self._call("simIsPaused") is not True:
            if time.monotonic() > end:
                raise self._no_pause(f"it runs on for more than {PAUSE_S:g} s")
            time.sleep(0.002)

    def _find_actor(self, name: str, pose: np.ndarray) -> str:
        # the name is a pattern to the server: if nothing is called so exactly, a single match counts
        seen = _texts(self._call("simListSceneObjects", f"{name}.*"))
        actor = name if name in seen else seen[0] if len(seen) == 1 else ""
        if not actor:
            # what is not in the level is spawned from the asset, and taken away at the end
            if name not in _texts(self._call("simListAssets")):
                raise ToolkitError(
                    f"{self.address}: neither an actor nor an asset is called '{name}': import {name}.glb, which "
                    "lies in the run's folder objects/, into the simulator's project under that name"
                )
            size = {"x_val": 1.0, "y_val": 1.0, "z_val": 1.0}
            [actor] = _texts([self._call("simSpawnObject", name, name, pack_pose(pose), size, False, False)])
            if not actor:
                raise ToolkitError(f"{self.address}: asset '{name}' cannot be spawned: see the simulator's log")
            self._spawned.append(actor)
        # Cosys-AirSim numbers its things itself; elsewhere the object needs a colour of its own
        if not self.is_cosys:
            self._call("simSetSegmentationObjectID", actor, OBJECT_NUMBER, False)
        return actor

    def _get_images(self, *kinds: int) -> "list[_Image]":
        # depth comes as floats, uncompressed; picture and segmentation come as PNG
        asked = [
            {
                "camera_name": self.address.camera, "image_type": kind, "pixels_as_float": kind == DEPTH_PERSPECTIVE,
                "compress": kind != DEPTH_PERSPECTIVE, **({"annotation_name": ""} if self.is_cosys else {}),
            }
            for kind in kinds
        ]  # fmt: skip
        where = self._where("simGetImages")
        replies = self._call("simGetImages", asked, self.address.vehicle, False)
        if not isinstance(replies, list) or len(replies) != len(kinds):
            raise ToolkitError(f"{where}: expected {len(kinds)} images: see whether camera and vehicle are called so")
        return [_Image.read(reply, where) for reply in replies]

    def _call(self, method: str, *arguments: object) -> object:
        """A call whose last arguments are left out where the server takes fewer: simulators differ in them."""
        known = self._counts.get(method, len(arguments))
        try:
            return self._rpc.call(method, *arguments[:known])
        except CallError as error:
            count = error.expected_arguments
            if count is None or not 0 < count < known:
                raise
            # kept, so that only the first call of a function is made twice
            self._counts[method] = count
            return self._rpc.call(method, *arguments[:count])

    def _where(self, method: str) -> str:
        return f"{self.address}: answer to {method}"


@dataclass(frozen=True)
class _Image:
    """A reply of `simGetImages`; `where` names it in errors."""

    content: bytes
    numbers: list[float]
    size_px: tuple[int, int]
    pose: np.ndarray
    where: str

    @classmethod
    def read(cls, reply: object, where: str) -> "_Image":
        fields = read_fields(reply, where)
        content, numbers = fields.get("image_data_uint8", b""), fields.get("image_data_float", [])
        width, height = fields.get("width"), fields.get("height")
        # a reply is not trusted: a wrong size would otherwise fail deep inside NumPy
        if not isinstance(width, int) or not isinstance(height, int) or not isinstance(numbers, list):
            raise ToolkitError(f"{where}: expected width, height and a list of depths")
        if not 0 < width <= MAX_SIDE_PX or not 0 < height <= MAX_SIDE_PX:
            raise ToolkitError(
                f"{where}: pictures of {show(width)} × {show(height)} px: see whether the camera is called so"
            )
        # some servers send bytes as a list of numbers
        if not isinstance(content, bytes):
            listed = content if isinstance(content, list) else []
            is_bytes = all(isinstance(value, int) and 0 <= value < 256 for value in listed)
            content = bytes(listed) if is_bytes else b""
        pose = {b"position": fields.get("camera_position"), b"orientation": fields.get("camera_orientation")}
        return cls(content, numbers, (width, height), unpack_pose(pose, where), where)

    def decode(self) -> np.ndarray:
        """(h, w, 3) uint8 RGB of a PNG."""
        try:
            return decode_frame(self.content, Path(), size_px=self.size_px)
        except UnreadableImage as error:
            raise ToolkitError(f"{self.where}: {error.reason}: see whether the camera is called so") from None

    def read_depth(self) -> np.ndarray:
        """(h, w) float32 metres."""
        width, height = self.size_px
        if len(self.numbers) != width * height or not width * height:
            raise ToolkitError(f"{self.where}: expected {width} × {height} depths, found {len(self.numbers)}")
        try:
            with np.errstate(over="ignore"):  # what single precision cannot hold is endless
                depth = np.array(self.numbers, np.float32).reshape(height, width)
        except (TypeError, ValueError):
            raise ToolkitError(f"{self.where}: a depth in it is no number") from None
        # the sky has no depth: what a simulator writes instead becomes infinite
        return np.where((depth >= ENDLESS_M) | ~np.isfinite(depth), np.float32(np.inf), depth)


def _texts(found: object) -> list[str]:
    each = found if isinstance(found, list) else []
    return [text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text or "") for text in each]
