"""A quadrotor as a rigid body, many at a time, with the numbers of AirSim's SimpleFlight vehicle.

Frames: the world is z up, metres; the body is x forward, y left, z up. Arrays hold a column per vehicle.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import exp, sqrt

import numpy as np

GRAVITY = 9.80665
AIR_DENSITY = 1.225
ROTOR_X = np.array([1.0, -1.0, 1.0, -1.0])
ROTOR_Y = np.array([-1.0, 1.0, 1.0, -1.0])
ROTOR_TURN = np.array([1.0, 1.0, -1.0, -1.0])
"""Front right, rear left, front left, rear right, as AirSim counts them: side of the body, and sense of the torque."""


@dataclass(frozen=True)
class Multirotor:
    """Masses, thrust and drag of a vehicle; the defaults are AirSim's generic quadrotor."""

    mass_kg: float = 1.0  # of the whole
    arm_m: float = 0.2275  # from the middle to each rotor, the arms at 45°
    rotor_kg: float = 0.055  # rotor_kg, rotor_height_m: of each motor with its rotor, and its height over the middle
    rotor_height_m: float = 0.025
    body_m: tuple[float, float, float] = (0.180, 0.110, 0.040)  # box of the body, along x, y and z
    # thrust_n, torque_nm: of each rotor at full signal; both go with the signal, the square of its speed
    thrust_n: float = 4.179446268
    torque_nm: float = 0.055562
    delay_s: float = 0.005  # time constant of a rotor's answer to its signal
    rotor_diameter_m: float = 0.2286  # rotor_diameter_m, rotor_thickness_m: as they catch the air
    rotor_thickness_m: float = 0.01
    drag_coefficient: float = 0.325  # of all faces

    @cached_property
    def inertia(self) -> np.ndarray:
        """(3,) moments about the body's axes, kg m²: a box, and four motors as points."""
        x, y, z = self.body_m
        # a solid box has m (b^2 + c^2) / 12 about the axis across sides b and c; a point has m r^2
        box = (self.mass_kg - 4 * self.rotor_kg) / 12 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
        side, up = self.arm_m**2 / 2, self.rotor_height_m**2
        return box + 4 * self.rotor_kg * np.array([side + up, side + up, 2 * side])

    @cached_property
    def drag(self) -> np.ndarray:
        """(3,) force along each body axis per square of the speed along it, N s²/m².

        AirSim's faces: the box's, and of each rotor π d² from above, four times its disc, and π d h from aside.
        """
        x, y, z = self.body_m
        # areas that meet the air: the body's faces, and those of four propellers, flat discs of some thickness
        above, aside = np.pi * self.rotor_diameter_m**2, np.pi * self.rotor_diameter_m * self.rotor_thickness_m
        faces = np.array([y * z + 4 * aside, x * z + 4 * aside, x * y + 4 * above])
        return faces * self.drag_coefficient / 2 * AIR_DENSITY

    @property
    def hover_signal(self) -> float:
        """Share of full thrust that balances its weight."""
        return self.mass_kg * GRAVITY / (4 * self.thrust_n)


SIMPLE_FLIGHT = Multirotor()


@dataclass(frozen=True)
class MultirotorState:
    """Places and motions of n vehicles; float64."""

    position: np.ndarray  # position, velocity: (3, n) in the world, metres and m/s
    velocity: np.ndarray
    attitude: np.ndarray  # (4, n) unit quaternion w, x, y, z from the body to the world
    rates: np.ndarray  # (3, n) angular velocity in the body, rad/s
    rotors: np.ndarray  # (4, n) share of each rotor's full thrust

    @classmethod
    def at(cls, position: np.ndarray, yaw_rad: np.ndarray, signal: float) -> "MultirotorState":
        """At rest and level at (3, n) positions, turned by (n,) yaw, all rotors at the same signal."""
        count = position.shape[1]
        attitude = np.zeros((4, count))
        # the unit quaternion of a turn about z: (cos(a / 2), 0, 0, sin(a / 2))
        attitude[0], attitude[3] = np.cos(yaw_rad / 2), np.sin(yaw_rad / 2)
        still = np.zeros((3, count))
        return cls(np.array(position, float), still, attitude, still.copy(), np.full((4, count), signal))

    @cached_property
    def rotation(self) -> np.ndarray:
        """(3, 3, n) from the body to the world."""
        # the matrix of a unit quaternion
        w, x, y, z = self.attitude
        xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
        return np.array(
            [
                [1 - 2 * (yy + zz), 2 * (xy - wz), 2 * (xz + wy)],
                [2 * (xy + wz), 1 - 2 * (xx + zz), 2 * (yz - wx)],
                [2 * (xz - wy), 2 * (yz + wx), 1 - 2 * (xx + yy)],
            ]
        )

    @property
    def angles(self) -> np.ndarray:
        """(3, n) roll, pitch and yaw, rad: turns about x, y and z, the last first; a positive pitch lowers the nose."""
        turn = self.rotation
        # read off R = Rz(yaw) Ry(pitch) Rx(roll)
        pitch = np.arcsin(np.clip(-turn[2, 0], -1, 1))
        return np.array([np.arctan2(turn[2, 1], turn[2, 2]), pitch, np.arctan2(turn[1, 0], turn[0, 0])])

    @property
    def tilt(self) -> np.ndarray:
        """(n,) angle between the body's up and the world's, rad."""
        # the cosine is the z of the body's own z axis; rounding may put it above 1
        return np.arccos(np.clip(self.rotation[2, 2], -1, 1))

    def part(self, chosen: np.ndarray) -> "MultirotorState":
        """Some of the vehicles, by number or mask."""
        return MultirotorState(*(getattr(self, name)[:, chosen] for name in STATE))


STATE = ("position", "velocity", "attitude", "rates", "rotors")


def to_body(rotation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(3, n) world vectors in the body. Sums are spelt out: a product of matrices rounds by how many there are."""
    return rotation[0] * vectors[0] + rotation[1] * vectors[1] + rotation[2] * vectors[2]


def advance(
    vehicle: Multirotor, state: MultirotorState, signals: np.ndarray, wind: np.ndarray, step_s: float
) -> MultirotorState:
    """The state one step later; each vehicle by itself, so that its numbers do not depend on how many there are.

    Args:
        signals: (4, n) in [0, 1], what each rotor is told.
        wind: (3, n) velocity of the air in the world, m/s.
    """
    # a lag of first order, solved exactly over the step
    rotors = signals + (state.rotors - signals) * exp(-step_s / vehicle.delay_s)
    thrust, rotation = rotors * vehicle.thrust_n, state.rotation
    # drag goes with the square of the airspeed along each body axis; thrust is along z alone
    air = to_body(rotation, state.velocity - wind)
    force = -vehicle.drag[:, None] * air * np.abs(air)
    force[2] += thrust[0] + thrust[1] + thrust[2] + thrust[3]
    # into the world, then gravity
    pull = (rotation[:, 0] * force[0] + rotation[:, 1] * force[1] + rotation[:, 2] * force[2]) / vehicle.mass_kg
    pull[2] -= GRAVITY
    velocity = state.velocity + pull * step_s
    # trapezoid rule: exact for a constant pull
    position = state.position + (state.velocity + velocity) * (step_s / 2)
    # semi-implicit Euler: the attitude turns at the new rates
    rates = state.rates + _angular_pull(vehicle, state.rates, rotors) * step_s
    return replace(
        state, position=position, velocity=velocity, attitude=_turn(state.attitude, rates, step_s), rates=rates,
        rotors=rotors,
    )  # fmt: skip


def _angular_pull(vehicle: Multirotor, rates: np.ndarray, rotors: np.ndarray) -> np.ndarray:
    """(3, n) angular acceleration of thrust, rotor torque and the gyroscopic term."""
    # arms stand at 45 degrees between the axes
    lever = vehicle.arm_m / sqrt(2) * vehicle.thrust_n
    torque = np.array(
        [
            lever * _combine(ROTOR_Y, rotors),
            -lever * _combine(ROTOR_X, rotors),
            vehicle.torque_nm * _combine(ROTOR_TURN, rotors),
        ]
    )
    # Euler's equations, in the principal axes of inertia
    a, b, c = vehicle.inertia
    p, q, r = rates
    gyroscopic = np.array([(b - c) * q * r, (c - a) * r * p, (a - b) * p * q])
    return (torque + gyroscopic) / vehicle.inertia[:, None]


def _combine(signs: np.ndarray, rows: np.ndarray) -> np.ndarray:
    return signs[0] * rows[0] + signs[1] * rows[1] + signs[2] * rows[2] + signs[3] * rows[3]


def _turn(attitude: np.ndarray, rates: np.ndarray, step_s: float) -> np.ndarray:
    """(4, n) after turning at constant rates, of unit length."""
    # one Euler step of dq/dt = q ⊗ (0, ω) / 2
    w, x, y, z = attitude
    p, q, r = rates * (step_s / 2)
    moved = attitude + np.array(
        [-x * p - y * q - z * r, w * p + y * r - z * q, w * q - x * r + z * p, w * r + x * q - y * p]
    )
    w, x, y, z = moved
    # the step leaves the unit sphere a little
    return moved / np.sqrt(w * w + x * x + y * y + z * z)


@dataclass(frozen=True)
class CascadeGains:
    """AirSim's gains and limits. Every controller's output is clipped to ±1 and scales the limit of the next."""

    velocity_p: float = 0.2  # of forward and sideward velocity, per m/s
    climb_p: float = 2.0  # climb_p, climb_i: of vertical velocity
    climb_i: float = 2.0
    climb_leak: float = 0.9999  # factor on the integral at each step
    level_p: float = 2.5  # of roll, pitch and yaw, per rad
    rate_p: float = 0.25  # of their rates, per rad/s
    most_velocity_m_s: float = 6.0  # of a command along each axis
    most_tilt_rad: float = np.pi / 5.5  # of roll and pitch
    most_rate_rad_s: float = 2.5  # of all three
    least_throttle: float = 0.3  # in velocity control
    least_angling_throttle: float = 0.05  # below it the rotors all run alike


class VelocityControl:
    """Holds a commanded velocity and yaw; keeps the integral of the climb."""

    def __init__(self, count: int, gains: CascadeGains = CascadeGains()) -> None:
        self.gains, self._climb = gains, np.zeros(count)

    def part(self, chosen: np.ndarray) -> "VelocityControl":
        """That of some of the vehicles, by number or mask."""
        made = VelocityControl(0, self.gains)
        made._climb = self._climb[chosen]
        return made

    def put(self, chosen: np.ndarray, part: "VelocityControl") -> None:
        """Take back that of some of the vehicles."""
        self._climb[chosen] = part._climb

    def signals(self, state: MultirotorState, velocity: np.ndarray, yaw_rad: np.ndarray, step_s: float) -> np.ndarray:
        """(4, n) what each rotor is told.

        Args:
            velocity: (3, n) wanted in the world, m/s; cut to the limit.
            yaw_rad: (n,) wanted.
        """
        gains, most = self.gains, self.gains.most_velocity_m_s
        error = to_body(state.rotation, np.clip(velocity, -most, most) - state.velocity)
        # proportional and leaking integral: the climb must carry the weight with no error left
        self._climb = np.clip(self._climb * gains.climb_leak + gains.climb_i * error[2] * step_s, -1, 1)
        climb = np.clip(gains.climb_p * error[2] + self._climb, -1, 1)
        throttle = np.maximum((climb + 1) / 2, gains.least_throttle)
        roll, pitch, yaw = state.angles
        # a velocity error asks for a tilt: sideward for roll, forward for pitch; the yaw error by the shorter way
        level = np.array(
            [
                -gains.most_tilt_rad * np.clip(gains.velocity_p * error[1], -1, 1) - roll,
                gains.most_tilt_rad * np.clip(gains.velocity_p * error[0], -1, 1) - pitch,
                (yaw_rad - yaw + np.pi) % (2 * np.pi) - np.pi,
            ]
        )
        # a tilt error asks for a rate, and a rate error for a turn
        rates = gains.most_rate_rad_s * np.clip(gains.level_p * level, -1, 1)
        return mix(throttle, np.clip(gains.rate_p * (rates - state.rates), -1, 1), gains.least_angling_throttle)


def mix(throttle: np.ndarray, turns: np.ndarray, least_angling: float) -> np.ndarray:
    """(4, n) signals in [0, 1] of (n,) throttle and (3, n) roll, pitch and yaw, as AirSim's mixer has them."""
    turns = np.where(throttle < least_angling, 0.0, turns)
    signals = (
        throttle
        + ROTOR_Y[:, None] * turns[0]
        - ROTOR_X[:, None] * turns[1]
        + ROTOR_TURN[:, None] * turns[2]
    )  # fmt: skip
    # up until no rotor is told less than 0, then down to 1: turning comes before thrust
    signals = signals - np.minimum(signals.min(axis=0), 0)
    return np.clip(signals / np.maximum(signals.max(axis=0), 1), 0, 1)
