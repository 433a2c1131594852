"""The pilot: a PID controller on where the pad is said to be, and a law for going down."""

import re
from typing import Annotated

import numpy as np
from pydantic import Field

from toolkit.core.config import Config, Flag
from toolkit.core.errors import ToolkitError
from toolkit.landing.episodes import Flights, Look

GAINS = {"paper": (5.0, 0.0, 5.0), "gentle": (1.0, 0.0, 0.0)}
"""Kp, Ki, Kd: the paper's (appendix B.3), and a control that a noisy regressor does not upset."""
OWN = re.compile(r"(\d+\.?\d*),(\d+\.?\d*),(\d+\.?\d*)")


def parse_gains(word: str) -> tuple[float, float, float]:
    """Kp, Ki, Kd of `paper`, `gentle`, or numbers such as `2,0,0.5`.

    Raises:
        ToolkitError: it is neither.
    """
    if word in GAINS:
        return GAINS[word]
    found = OWN.fullmatch(word)
    if found is None:
        raise ToolkitError(f"gains '{word}': expected {', '.join(GAINS)}, or Kp,Ki,Kd such as 2,0,0.5")
    kp, ki, kd = (float(number) for number in found.groups())
    return kp, ki, kd


class DescentConfig(Config):
    """When and how fast the drone goes down.

    Attributes:
        fastest_m_s, slowest_m_s: of the descent, which slows with the height over the pad.
        rate: speed per metre of height between the two.
        align_m, align_share: it goes down while the pad is within align_m + align_share · height of straight below.
        blind_m: below this height over the pad it goes straight down and looks no more.
        unseen_m: below this height a pad that is not found, as one that fills the picture, does not stop it.
    """

    fastest_m_s: Annotated[float, Field(gt=0, le=6), Flag("--descent")] = Field(
        1.5, description="Fastest descent, m/s."
    )
    slowest_m_s: Annotated[float, Field(gt=0, le=6)] = 0.5
    rate: Annotated[float, Field(gt=0)] = 0.5
    align_m: Annotated[float, Field(gt=0)] = 0.15
    align_share: Annotated[float, Field(ge=0)] = 0.25
    blind_m: Annotated[float, Field(ge=0), Flag()] = Field(0.8, description="Below this height it goes straight down.")
    unseen_m: Annotated[float, Field(ge=0)] = 1.6


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
        self._sum[chosen] += np.where(known[:, None], error, 0.0) * step_s
        slope = (error - self._last[chosen]) / step_s
        # of a first picture, and after one without a pad, there is no slope
        slope[~np.isfinite(slope)] = 0.0
        self._last[chosen] = error
        level = np.where(known[:, None], kp * error + ki * self._sum[chosen] + kd * slope, 0.0)
        height = flights.state.position[2, chosen] - flights.pads[chosen, 2]
        aligned = known & (np.hypot(*error.T) < law.align_m + law.align_share * height)
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
        offsets = flights.level_offsets(seen, chosen)
        for k, offset in zip(chosen, offsets, strict=True):
            flights.episodes[k].seen.append(offset)
        flights.advance(pilot.steer(seen, chosen))
