"""The pilot: a PID controller on where the pad is said to be, and a law for going down."""

import numpy as np

from toolkit.landing.episodes import Flights, Look
from toolkit.landing.flight_config import DescentConfig


class Pilot:
    """Turns what a regressor says of each picture into velocities."""

    def __init__(self, gains: tuple[float, float, float], descent: DescentConfig, flights: Flights) -> None:
        count = len(flights.episodes)
        self._gains, self._descent, self._flights = gains, descent, flights
        self._sum, self._last = np.zeros((count, 2)), np.full((count, 2), np.nan)
        self._velocity = np.zeros((3, count))

    def steer(self, seen: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """(3, n) velocities of all episodes, m/s in the world.

        Args:
            seen: (m, 2) the pad in the frame of each camera, metres; NaN where it was not found: it waits there.
            chosen: (m,) which episodes these are.
        """
        (kp, ki, kd), flights, law = self._gains, self._flights, self._descent
        step_s = 1 / flights.config.camera_hz
        error = flights.level_offsets(seen, chosen)
        known = np.isfinite(error).all(axis=1)
        # where no pad is said to be seen, the sum waits
        self._sum[chosen] += np.where(known[:, None], error, 0.0) * step_s
        slope = (error - self._last[chosen]) / step_s
        # of a first picture, and after one without a pad, there is no slope
        slope[~np.isfinite(slope)] = 0.0
        self._last[chosen] = error
        level = np.where(known[:, None], kp * error + ki * self._sum[chosen] + kd * slope, 0.0)
        height = flights.state.position[2, chosen] - flights.pads[chosen, 2]
        aligned = known & (np.hypot(*error.T) < law.align_m + law.align_share * height)
        # just above the pad it fills the picture or leaves it: straight down, whatever is said
        blind = (height < law.blind_m) | (~known & (height < law.unseen_m))
        down = np.where(aligned | blind, np.clip(law.rate * height, law.slowest_m_s, law.fastest_m_s), 0.0)
        self._velocity[:2, chosen] = np.where(blind, 0.0, level.T)
        self._velocity[2, chosen] = -down
        return self._velocity.copy()


def fly(flights: Flights, look: Look, gains: tuple[float, float, float], descent: DescentConfig) -> None:
    """Fly all episodes to their ends; each picture's answers come from one call of `look` for all that still fly."""
    pilot = Pilot(gains, descent, flights)
    while len(chosen := flights.flying):
        poses = flights.camera_poses(chosen)
        seen = np.asarray(look(np.array([flights.episodes[k].index for k in chosen]), poses, flights.tick), float)
        # kept before the flight goes on: the answers belong to these poses
        offsets = flights.level_offsets(seen, chosen)
        for k, offset in zip(chosen, offsets, strict=True):
            flights.episodes[k].seen.append(offset)
        flights.advance(pilot.steer(seen, chosen))
