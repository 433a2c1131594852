"""SimpleFlight's cascade: a velocity is turned into a tilt, the tilt into a rate, the rate into signals of rotors."""

from dataclasses import dataclass

import numpy as np

from toolkit.landing.dynamics import ROTOR_TURN, ROTOR_X, ROTOR_Y, MultirotorState, to_body


@dataclass(frozen=True)
class CascadeGains:
    """AirSim's gains and limits. Every controller's output is clipped to ±1 and scales the limit of the next.

    Attributes:
        velocity_p: of forward and sideward velocity, per m/s.
        climb_p, climb_i: of vertical velocity.
        climb_leak: factor on the integral at each step.
        level_p: of roll, pitch and yaw, per rad.
        rate_p: of their rates, per rad/s.
        most_velocity_m_s: of a command along each axis.
        most_tilt_rad: of roll and pitch.
        most_rate_rad_s: of all three.
        least_throttle: in velocity control.
        least_angling_throttle: below it the rotors all run alike.
    """

    velocity_p: float = 0.2
    climb_p: float = 2.0
    climb_i: float = 2.0
    climb_leak: float = 0.9999
    level_p: float = 2.5
    rate_p: float = 0.25
    most_velocity_m_s: float = 6.0
    most_tilt_rad: float = np.pi / 5.5
    most_rate_rad_s: float = 2.5
    least_throttle: float = 0.3
    least_angling_throttle: float = 0.05


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
            state: of the vehicles, known exactly.
            velocity: (3, n) wanted in the world, m/s; cut to the limit.
            yaw_rad: (n,) wanted.
            step_s: since the last call.
        """
        gains, most = self.gains, self.gains.most_velocity_m_s
        error = to_body(state.rotation, np.clip(velocity, -most, most) - state.velocity)
        self._climb = np.clip(self._climb * gains.climb_leak + gains.climb_i * error[2] * step_s, -1, 1)
        climb = np.clip(gains.climb_p * error[2] + self._climb, -1, 1)
        throttle = np.maximum((climb + 1) / 2, gains.least_throttle)
        roll, pitch, yaw = state.angles
        level = np.array(
            [
                -gains.most_tilt_rad * np.clip(gains.velocity_p * error[1], -1, 1) - roll,
                gains.most_tilt_rad * np.clip(gains.velocity_p * error[0], -1, 1) - pitch,
                (yaw_rad - yaw + np.pi) % (2 * np.pi) - np.pi,
            ]
        )
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
    signals = signals - np.minimum(signals.min(axis=0), 0)
    return np.clip(signals / np.maximum(signals.max(axis=0), 1), 0, 1)
