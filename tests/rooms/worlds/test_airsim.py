"""A simulator of AirSim's family: its frames against closed forms, and what it says and refuses, against a fake one."""

import time

import numpy as np
import pytest
from fake_airsim import FakeAirSim, matrix_of, serve
from scipy.spatial.transform import Rotation

from toolkit.core.errors import ToolkitError
from toolkit.rig.camera import as_quaternion, look_at
from toolkit.rooms.worlds.airsim import Address, AirSim, camera_to_ned, object_to_ned
from toolkit.rooms.worlds.depth_weather import to_airsim

NORTH = look_at(np.array([3.0, 5.0, 2.0]), np.array([3.0, 9.0, 2.0]))
"""3 m east and 5 m north of the origin, 2 m up, looking level to the north."""


@pytest.fixture
def start(request):
    """A function (fake, at_all) -> the address where it listens."""
    opened = []

    def begin(fake: FakeAirSim, at_all: str = "") -> Address:
        context = serve(fake, at_all)
        opened.append(context)
        return Address("127.0.0.1", context.__enter__())

    yield begin
    for context in opened:
        context.__exit__(None, None, None)


def test_a_camera_that_looks_north_is_not_turned() -> None:
    pose = camera_to_ned(NORTH, (100.0, 0.0, -1.0))
    assert pose == pytest.approx(np.array([(1, 0, 0, 105), (0, 1, 0, 3), (0, 0, 1, -3), (0, 0, 0, 1.0)]), abs=1e-12)
    assert as_quaternion(pose[:3, :3]) == pytest.approx((1, 0, 0, 0))


@pytest.mark.parametrize("yaw_deg", [-170, -30, 0, 45, 135])
@pytest.mark.parametrize("pitch_deg", [-60, 0, 20])
def test_yaw_is_from_north_to_east_and_pitch_up(yaw_deg: float, pitch_deg: float) -> None:
    """AirSim: yaw clockwise from above, pitch nose up, in that order."""
    yaw, pitch = np.radians(yaw_deg), np.radians(pitch_deg)
    forward = np.array([np.sin(yaw) * np.cos(pitch), np.cos(yaw) * np.cos(pitch), np.sin(pitch)])  # east, north, up
    pose = camera_to_ned(look_at(np.zeros(3), forward))
    assert pose[:3, :3] == pytest.approx(Rotation.from_euler("ZYX", [yaw, pitch, 0]).as_matrix(), abs=1e-9)
    w, x, y, z = as_quaternion(pose[:3, :3])
    packed = {"orientation": dict(w_val=w, x_val=x, y_val=y, z_val=z), "position": dict(x_val=0, y_val=0, z_val=0)}
    assert matrix_of(packed) == pytest.approx(pose, abs=1e-9)


def test_an_objects_turn_keeps_its_points() -> None:
    """glTF's (y, z, x) of ours is what Unreal makes (x, z, y) of: an actor's north is our y, its east our x."""
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = Rotation.from_euler("z", 30, degrees=True).as_matrix(), (4.0, 7.0, 0.5)
    point = np.array([2.0, -1.0, 3.0, 1.0])
    east, north, up, _ = turned @ point
    gltf = point[[1, 2, 0]]
    unreal = gltf[[0, 2, 1]]
    actor = np.array([unreal[0], unreal[1], -unreal[2], 1.0])  # down instead of up
    assert object_to_ned(turned) @ actor == pytest.approx(np.array([north, east, -up, 1.0]))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("unreal://host", "renderer unreal://host: expected raycast or airsim://HOST"),
        ("airsim:///x", "expected raycast or airsim://HOST"),
        ("airsim://host:99999", "expected raycast or airsim://HOST"),
        ("airsim://host:abc", "expected raycast or airsim://HOST"),
        ("airsim://host?speed=2", "no option called 'speed': known: camera, vehicle, origin"),
        ("airsim://host?origin=1,2", "expected metres north, east and down"),
        ("airsim://host?origin=1,nan,0", "expected metres north, east and down"),
        ("airsim://host?what", "expected raycast or airsim://HOST"),
    ],
)
def test_an_address_that_is_none_is_one_line(text: str, said: str) -> None:
    with pytest.raises(ToolkitError) as caught:
        Address.parse(text)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_an_address_is_read() -> None:
    assert Address.parse("airsim://sim.local") == Address("sim.local", 41451)
    assert str(Address.parse("airsim://[::1]:9")) == "airsim://[::1]:9"
    found = Address.parse("airsim://h:1?camera=front_center&vehicle=V1&origin=1,-2.5,0")
    assert found == Address("h", 1, "front_center", "V1", (1.0, -2.5, 0.0))


@pytest.mark.parametrize("flavour", ["airsim", "old", "cosys"])
def test_every_flavour_shoots_the_frame_that_was_asked_for(start, flavour: str) -> None:
    fake = FakeAirSim(flavour, lag=4)
    with AirSim(start(fake)) as simulator:
        assert fake.is_paused
        simulator.set_camera(50.0)
        simulator.number_things()
        for north in (5.0, 8.0, 2.0):
            there = NORTH.copy()
            there[1, 3] = north
            shot = simulator.shoot(there)
            assert shot.depth_m[0, 0] == north and np.isinf(shot.depth_m[1:]).all()
            assert (shot.picture == (200, 100, 50)).all() and shot.segmentation.shape == (16, 16, 3)
        said = simulator.describe()
    assert said == ("Cosys-AirSim, server version 4" if flavour == "cosys" else "AirSim or Colosseum, server version 1")
    assert (fake.fov_deg, fake.is_paused) == (50.0, False)
    assert not any(method == "broke" for method, _ in fake.calls)


def test_weather_is_set_by_its_number_and_goes_when_the_air_clears(start) -> None:
    fake = FakeAirSim()
    with AirSim(start(fake)) as simulator:
        simulator.set_weather(to_airsim("dust", 5))
        assert fake.weather == {6: 1.0}
        simulator.set_weather(to_airsim("fog", 2))
        assert fake.weather == {6: 0.0, 7: 0.4}
        simulator.set_weather({})
        assert not any(fake.weather.values())
        simulator.set_weather(to_airsim("snow", 1))
        assert fake.weather[2] == 0.2 and fake.weather[3] > 0
    assert not any(fake.weather.values())


def test_objects_are_spawned_moved_and_taken_away(start) -> None:
    fake = FakeAirSim("cosys", actors={"crate_patched": {}})
    with AirSim(start(fake)) as simulator:
        stand = np.eye(4)
        stand[:3, 3] = (4.0, 7.0, 0.5)
        simulator.place("crate_unpatched", stand)
        assert matrix_of(fake.actors["crate_unpatched_7"])[:3, 3] == pytest.approx((7, 4, -0.5))
        simulator.place("crate_unpatched", None)
        assert matrix_of(fake.actors["crate_unpatched_7"])[2, 3] == -3000
        simulator.place("crate_patched", stand)
        assert sum(method == "simSpawnObject" for method, _ in fake.calls) == 1
        with pytest.raises(ToolkitError, match=r"neither an actor nor an asset is called 'jet'.* import jet\.glb"):
            simulator.place("jet", stand)
    assert list(fake.actors) == ["crate_patched"]


def blame(start, fake: FakeAirSim, at_all: str = "", timeout_s: float = 5.0) -> str:
    """The line that a use of it ends with."""
    began = time.monotonic()
    with pytest.raises(ToolkitError) as caught, AirSim(start(fake, at_all), timeout_s) as simulator:
        simulator.set_camera(50.0)
        simulator.set_weather({"Fog": 0.2})
        simulator.place("crate_unpatched", np.eye(4))
        simulator.shoot(NORTH)
    assert "\n" not in str(caught.value) and time.monotonic() - began < 5
    return str(caught.value)


def test_nobody_there() -> None:
    with pytest.raises(ToolkitError, match=r"airsim://127\.0\.0\.1:9: no answer .* start the simulator"):
        AirSim(Address("127.0.0.1", 9))
    with pytest.raises(ToolkitError, match="no answer"):
        AirSim(Address("no.such.host.invalid"))


def off_by_a_metre(fake: FakeAirSim, *given: object) -> list[dict]:
    replies = fake.simGetImages(*given)
    return [{**one, "camera_position": {**one["camera_position"], "y_val": 4.0}} for one in replies]


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"at simGetImages": "hang"}, "no answer to simGetImages within 0.3 s"),
        ({"at simSetCameraFov": "close"}, "lost during simSetCameraFov (it closed the connection)"),
        ({"at simPause": "http"}, "what answers simPause does not speak msgpack-rpc"),
        ({"at simPause": "garbage"}, "what answers simPause does not speak msgpack-rpc"),
        ({"simPause": "not implemented"}, "cannot be paused (", ),
        ({"simPause": ["code 3", "no permission"]}, "no permission"),
        ({"simIsPaused": lambda fake: False}, "cannot be paused (it runs on)"),
        ({"simGetImages": off_by_a_metre}, "camera '0' is still 1 m and 0° from where it was put after 8 frames"),
        ({"simGetImages": lambda fake, *given: []}, "answer to simGetImages: expected 1 images"),
        ({"simGetImages": lambda fake, *given: [{}]}, "expected width, height and a list of depths"),
        ({"simGetImages": lambda fake, *given: 5}, "expected 1 images"),
        ({"simSetObjectPose": lambda fake, *given: False}, "cannot be moved: set its Mobility to Movable"),
        ({"simSpawnObject": lambda fake, *given: ""}, "asset 'crate_unpatched' cannot be spawned"),
        ({"simGetObjectPose": lambda fake, *given: None}, "answer to simGetObjectPose: expected a map, found None"),
        ({"simSetWeatherParameter": "no weather here"}, "refuses simSetWeatherParameter: no weather here"),
        ({"getServerVersion": lambda fake: "1"}, "getServerVersion says b'1': expected a number"),
    ],
)  # fmt: skip
def test_what_goes_wrong_is_one_line(start, fault: dict, said: str) -> None:
    assert said in blame(start, FakeAirSim(faults=fault, lag=0), timeout_s=0.3)


@pytest.mark.parametrize("at_all", ["hang", "close", "http", "garbage"])
def test_what_is_no_simulator_is_one_line(start, at_all: str) -> None:
    assert "getServerVersion" in blame(start, FakeAirSim(), at_all, timeout_s=0.3)


def test_broken_pictures_are_told(start) -> None:
    def spoil(**changes: object):
        return lambda fake, *given: [{**one, **changes} for one in FakeAirSim.simGetImages(fake, *given)]

    assert "expected a picture as PNG" in blame(
        start, FakeAirSim(lag=0, faults={"simGetImages": spoil(image_data_uint8=b"\0")})
    )
    assert "expected 16 × 16 depths, found 1" in blame(
        start, FakeAirSim(lag=0, faults={"simGetImages": spoil(image_data_float=[0.0])})
    )
