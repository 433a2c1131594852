"""The quadrotor against closed forms, a linear model, and RotorPy."""

from time import perf_counter

import numpy as np
import pytest

from toolkit.rooms.landing.dynamics import (
    GRAVITY,
    SIMPLE_FLIGHT,
    CascadeGains,
    Multirotor,
    MultirotorState,
    VelocityControl,
    advance,
)

STEP_S = 0.003


def at_rest(count: int = 1, signal: float = 0.0) -> MultirotorState:
    return MultirotorState.at(np.zeros((3, count)), np.zeros(count), signal)


def run(state: MultirotorState, signals: np.ndarray, seconds: float, step_s: float = STEP_S) -> MultirotorState:
    still = np.zeros_like(state.position)
    for _ in range(round(seconds / step_s)):
        state = advance(SIMPLE_FLIGHT, state, signals, still, step_s)
    return state


def steer(
    state: MultirotorState, velocity: np.ndarray, seconds: float, wind: np.ndarray | None = None
) -> list[np.ndarray]:
    control, count = VelocityControl(state.position.shape[1]), state.position.shape[1]
    wind, path = np.zeros((3, count)) if wind is None else wind, []
    for _ in range(round(seconds / STEP_S)):
        signals = control.signals(state, velocity, np.zeros(count), STEP_S)
        state = advance(SIMPLE_FLIGHT, state, signals, wind, STEP_S)
        path.append(np.concatenate([state.position, state.velocity, state.angles]))
    return path


def test_it_has_airsims_numbers() -> None:
    assert SIMPLE_FLIGHT.hover_signal == pytest.approx(9.80665 / 16.717785, rel=1e-6)
    box, motors = 0.78 / 12, 0.22
    assert SIMPLE_FLIGHT.inertia[0] == pytest.approx(box * (0.11**2 + 0.04**2) + motors * (0.2275**2 / 2 + 0.025**2))
    top = 0.18 * 0.11 + 4 * np.pi * 0.2286**2
    assert SIMPLE_FLIGHT.drag[2] == pytest.approx(top * 0.325 / 2 * 1.225)


def test_it_falls_as_the_closed_form_says() -> None:
    """v = v∞ tanh(g t / v∞), and the path is its integral."""
    # the speed at which the drag carries the weight
    limit = np.sqrt(SIMPLE_FLIGHT.mass_kg * GRAVITY / SIMPLE_FLIGHT.drag[2])
    for seconds in (0.3, 1.5, 6.0):
        fallen = run(at_rest(), np.zeros((4, 1)), seconds)
        assert -fallen.velocity[2, 0] == pytest.approx(limit * np.tanh(GRAVITY * seconds / limit), rel=2e-3)
        path = limit**2 / GRAVITY * np.log(np.cosh(GRAVITY * seconds / limit))
        assert -fallen.position[2, 0] == pytest.approx(path, rel=2e-3)
    assert limit == pytest.approx(8.533, abs=1e-3)


def test_a_draught_carries_it_along_as_the_closed_form_says() -> None:
    """With its weight carried, its speed through the air is u₀ / (1 + k u₀ t / m)."""
    state, wind = at_rest(1, SIMPLE_FLIGHT.hover_signal), np.array([[0.0], [0.0], [3.0]])
    signals = np.full((4, 1), SIMPLE_FLIGHT.hover_signal)
    for _ in range(4000):
        state = advance(SIMPLE_FLIGHT, state, signals, wind, STEP_S)
    assert state.velocity[2, 0] == pytest.approx(3 - 3 / (1 + SIMPLE_FLIGHT.drag[2] * 3 * 12), rel=2e-3)


def test_it_hovers_where_thrust_is_weight() -> None:
    state = run(at_rest(3, SIMPLE_FLIGHT.hover_signal), np.full((4, 3), SIMPLE_FLIGHT.hover_signal), 10)
    assert np.abs(state.velocity).max() < 1e-9
    assert np.abs(state.position).max() < 1e-8


def test_a_turning_body_keeps_its_angular_momentum_and_energy() -> None:
    free = Multirotor(drag_coefficient=0.0)
    state = MultirotorState.at(np.zeros((3, 1)), np.zeros(1), 0.0)
    spin = np.array([[2.0], [1.0], [3.0]])
    state = MultirotorState(state.position, state.velocity, state.attitude, spin, state.rotors)

    def momentum(of: MultirotorState) -> np.ndarray:
        return np.einsum("ijn,jn->in", of.rotation, free.inertia[:, None] * of.rates)

    before = momentum(state)
    for _ in range(5_000):
        state = advance(free, state, np.zeros((4, 1)), np.zeros((3, 1)), 2e-4)
    assert np.allclose(momentum(state), before, rtol=0.01)
    assert (free.inertia[:, None] * state.rates**2).sum() == pytest.approx(
        float((free.inertia[:, None] * spin**2).sum()), rel=0.01
    )


@pytest.mark.parametrize(("axis", "lever"), [(0, (-1, 1, 1, -1)), (1, (-1, 1, -1, 1))])
def test_rotors_turn_it_as_their_levers_say(axis: int, lever: tuple[int, ...]) -> None:
    """A roll lifts the left, a positive pitch the rear; the rate is torque over inertia times time."""
    signal = 0.5 + 0.01 * np.array(lever, float)[:, None]
    state = MultirotorState.at(np.zeros((3, 1)), np.zeros(1), 0.0)
    state = MultirotorState(state.position, state.velocity, state.attitude, state.rates, signal)
    state = run(state, signal, 0.03)
    torque = 4 * 0.01 * SIMPLE_FLIGHT.thrust_n * SIMPLE_FLIGHT.arm_m / np.sqrt(2)
    assert state.rates[axis, 0] == pytest.approx(torque / SIMPLE_FLIGHT.inertia[axis] * 0.03, rel=1e-6)


def test_a_small_step_in_velocity_answers_as_the_linear_cascade() -> None:
    """Against scipy's solution of the linearised chain: velocity, tilt, rate, rotors."""
    from scipy.signal import StateSpace, lsim

    gains, goal, seconds = CascadeGains(), 0.1, 4.0
    turn = 4 * SIMPLE_FLIGHT.thrust_n * SIMPLE_FLIGHT.arm_m / np.sqrt(2) / SIMPLE_FLIGHT.inertia[1]
    a, level, rate = 1 / SIMPLE_FLIGHT.delay_s, gains.level_p * gains.most_rate_rad_s, gains.rate_p
    tilt = gains.velocity_p * gains.most_tilt_rad
    # states: velocity, pitch, pitch rate, what the rotors give of the commanded turn
    A = np.array(
        [
            [0, GRAVITY, 0, 0],
            [0, 0, 1, 0],
            [0, 0, 0, turn],
            [-a * rate * level * tilt, -a * rate * level, -a * rate, -a],
        ]
    )
    B = np.array([[0], [0], [0], [a * rate * level * tilt]])
    times = np.arange(1, round(seconds / STEP_S) + 1) * STEP_S
    _, expected, _ = lsim(StateSpace(A, B, np.eye(4), np.zeros((4, 1))), np.full(len(times), goal), times)
    path = np.array(steer(at_rest(1, SIMPLE_FLIGHT.hover_signal), np.array([[goal], [0], [0]]), seconds))[:, :, 0]
    assert np.abs(path[:, 3] - expected[:, 0]).max() < 0.03 * goal
    assert path[-1, 3] == pytest.approx(expected[-1, 0], rel=0.02)


def test_tilt_and_velocity_stay_within_their_limits() -> None:
    path = np.array(steer(at_rest(1, SIMPLE_FLIGHT.hover_signal), np.array([[50.0], [0], [0]]), 20.0))[:, :, 0]
    assert np.degrees(np.abs(path[:, 6:8])).max() < 180 / 5.5 * 1.1
    assert 4.0 < path[-1, 3] < 6.0


def test_it_climbs_and_sinks_at_the_commanded_speed() -> None:
    for speed in (-1.5, 1.5):
        path = np.array(steer(at_rest(1, SIMPLE_FLIGHT.hover_signal), np.array([[0], [0], [speed]]), 8.0))[:, :, 0]
        assert path[-1, 5] == pytest.approx(speed, abs=0.1)


def test_a_vehicle_flies_the_same_alone_and_among_64() -> None:
    rng = np.random.default_rng(3)
    velocity, wind = rng.normal(0, 3, (3, 64)), rng.normal(0, 4, (3, 64))
    start = MultirotorState.at(rng.normal(0, 9, (3, 64)), np.zeros(64), 0.5)
    among = steer(start, velocity, 1.5, wind)[-1]
    for one in (0, 37, 63):
        some = np.array([one])
        alone = steer(start.part(some), velocity[:, some], 1.5, wind[:, some])[-1]
        assert alone[:, 0].tobytes() == among[:, one].tobytes()


def test_physics_is_far_quicker_than_time() -> None:
    state = at_rest(64, SIMPLE_FLIGHT.hover_signal)
    start = perf_counter()
    steer(state, np.zeros((3, 64)), 0.6)
    assert 64 * 200 / (perf_counter() - start) > 20 * 439  # RotorPy's drone-steps a second


def test_rotorpy_agrees() -> None:
    """The same vehicle in RotorPy, sharp turns included, drag left out: its drag is of another form."""
    multirotor = pytest.importorskip("rotorpy.vehicles.multirotor", reason="RotorPy is not installed")
    free = Multirotor(drag_coefficient=0.0)
    side = free.arm_m / np.sqrt(2)
    places = {"r1": (side, -side), "r2": (-side, side), "r3": (side, side), "r4": (-side, -side)}
    params = {
        "mass": free.mass_kg, "Ixx": free.inertia[0], "Iyy": free.inertia[1], "Izz": free.inertia[2], "Ixy": 0.0,
        "Iyz": 0.0, "Ixz": 0.0, "num_rotors": 4, "rotor_pos": {k: np.array([*v, 0.0]) for k, v in places.items()},
        "rotor_directions": np.array([1, 1, -1, -1]), "rI": np.zeros(3), "c_Dx": 0.0, "c_Dy": 0.0, "c_Dz": 0.0,
        "k_eta": 1e-6, "k_m": 1e-6 * free.torque_nm / free.thrust_n, "k_d": 0.0, "k_z": 0.0, "k_h": 0.0,
        "k_flap": 0.0, "tau_m": 1e-4,
        "rotor_speed_min": 0.0, "rotor_speed_max": 1e5, "motor_noise_std": 0.0, "k_w": 1.0, "k_v": 1.0,
        "kp_att": 1.0, "kd_att": 1.0,
    }  # fmt: skip
    gravity = 9.81  # its own
    thrust = gravity / 4 * np.array([1.02, 0.98, 1.03, 1.05])
    speeds = np.sqrt(thrust / 1e-6)
    peer = multirotor.Multirotor(params, control_abstraction="cmd_motor_speeds")
    start = {"x": np.zeros(3), "v": np.zeros(3), "q": np.array([0, 0, 0, 1.0]), "w": np.zeros(3), "wind": np.zeros(3),
             "rotor_speeds": speeds}  # fmt: skip
    seen, state = start, at_rest(1)
    share = (thrust / free.thrust_n)[:, None]
    state = MultirotorState(state.position, state.velocity, state.attitude, state.rates, share)
    for _ in range(100):
        seen = peer.step(seen, {"cmd_motor_speeds": speeds}, 0.003)
    for _ in range(1200):
        state = advance(free, state, share, np.zeros((3, 1)), 0.00025)
    ours = state.velocity[:, 0] - [0, 0, (gravity - GRAVITY) * 0.3]
    assert np.allclose(state.rates[:, 0], seen["w"], rtol=0.01, atol=1e-3)
    assert np.allclose(ours, seen["v"], rtol=0.01, atol=0.01)
