"""Poses as simulators of AirSim's family have them: metres north, east and down, and quaternions.

Convention: our world is z up, metres. A GLB of ours that Unreal imports lies with our +y north and our +x east, as maps
do: `NED_WORLD`. A body's axes are forward, right and down.
"""

import reprlib

import numpy as np

from toolkit.core.errors import ToolkitError

NED_WORLD = np.array([(0.0, 1, 0), (1, 0, 0), (0, 0, -1)])
"""From our axes, z up, to north, east, down; it is its own inverse."""
BODY_CAMERA = np.array([(0.0, 0, 1), (1, 0, 0), (0, 1, 0)])
"""From OpenCV's axes of a camera (right, down, forward) to the simulator's (forward, right, down)."""
NEAR_M, NEAR_DEG = 0.01, 0.1


def to_quaternion(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """(w, x, y, z) of a (3, 3) rotation, w not negative."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True).tolist()
    return w, x, y, z


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
    w, x, y, z = to_quaternion(pose[:3, :3])
    north, east, down = pose[:3, 3].tolist()
    return {
        "position": {"x_val": north, "y_val": east, "z_val": down},
        "orientation": {"w_val": w, "x_val": x, "y_val": y, "z_val": z},
    }


def unpack_pose(found: object, where: str) -> np.ndarray:
    """(4, 4) of a reply's pose, named `where` in errors; a `ToolkitError` where it is none."""
    from scipy.spatial.transform import Rotation

    fields = read_fields(found, where)
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
    return float(value) if isinstance(value, int | float) else float("nan")


def show(found: object) -> str:
    """What a server said, in a few words, however much it is."""
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
    return {key.decode("utf-8", "replace") if isinstance(key, bytes) else str(key): one for key, one in found.items()}
