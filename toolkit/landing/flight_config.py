"""The settings of flights: how an episode begins and ends, the controller's gains, the law of descent."""

import re
from typing import Annotated

from pydantic import Field, model_validator

from toolkit.core.config import Config, Flag, Range, Rising
from toolkit.core.errors import FieldError, ToolkitError

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
    blind_m: Annotated[float, Field(ge=0), Flag()] = Field(
        0.8, description="Below this height it flies straight down without looking, metres."
    )
    unseen_m: Annotated[float, Field(ge=0)] = 1.6


class EpisodeConfig(Config):
    """Where a landing begins, in which air, what the camera's mount does, and what counts as one.

    Attributes:
        start_height_m, start_angle_deg: height over the pad, and angle off its vertical, drawn evenly.
        wind_m_s: steady wind, drawn evenly; its direction too.
        gust_m_s, gust_time_s: standard deviation of the gusts on top, and how long they last.
        camera_hz: pictures a second.
        latency_s: from a picture to the command that it leads to.
        gimbal_error_deg: standard deviation of the mount's bias over an episode; a third of it trembles.
        radius_m: of the circle that a touchdown must be in.
        touchdown_m_s, touchdown_tilt_deg: at most.
        lost_s: how long the pad's centre may be out of view.
        time_limit_s: of an episode.
    """

    start_height_m: Annotated[Range, Rising(0.5, 100), Flag()] = Field(
        (5.0, 8.0), description="Lowest and highest start, metres."
    )
    start_angle_deg: Annotated[Range, Rising(0, 60), Flag()] = Field(
        (5.0, 20.0), description="Direction of the start, degrees from straight above the pad."
    )
    wind_m_s: Annotated[Range, Rising(0, 20), Flag("--wind")] = Field(
        (0.0, 3.0), description="Slowest and fastest steady wind, m/s."
    )
    gust_m_s: Annotated[float, Field(ge=0, le=10), Flag("--gust")] = Field(
        0.5, description="Gusts added to the wind, m/s, standard deviation."
    )
    gust_time_s: Annotated[float, Field(gt=0, le=60)] = 1.0
    camera_hz: Annotated[float, Field(gt=0, le=100), Flag()] = Field(10.0, description="Pictures a second.")
    latency_s: Annotated[float, Field(ge=0), Flag()] = Field(
        0.05, description="Delay from a picture to its command, seconds."
    )
    gimbal_error_deg: Annotated[float, Field(ge=0, le=20), Flag("--gimbal-error")] = Field(
        0.3, description="Error of the camera's mount, degrees, standard deviation."
    )
    radius_m: Annotated[float, Field(gt=0, le=10), Flag()] = Field(
        0.5, description="A landing counts as a success within this distance of the centre, metres."
    )
    touchdown_m_s: Annotated[float, Field(gt=0)] = 1.2
    touchdown_tilt_deg: Annotated[float, Field(gt=0, le=90)] = 15.0
    lost_s: Annotated[float, Field(gt=0)] = 2.0
    time_limit_s: Annotated[float, Field(gt=0, le=600), Flag()] = Field(30.0, description="Longest episode, seconds.")

    @model_validator(mode="after")
    def _check(self) -> "EpisodeConfig":
        if self.latency_s >= self.time_limit_s:
            limit = f"expected less than {{time_limit_s}}, {self.time_limit_s:g}: no command would ever arrive"
            raise FieldError(limit, {"latency_s": self.latency_s})
        if self.camera_hz * self.time_limit_s < 1:
            limit = f"expected a picture within {{time_limit_s}}, {self.time_limit_s:g}: it would fly blind"
            raise FieldError(limit, {"camera_hz": self.camera_hz})
        return self

    def describe(self) -> str:
        """What a success is, in words."""
        return (
            f"success: touchdown within {self.radius_m:g} m of the centre, at most {self.touchdown_m_s:g} m/s and "
            f"{self.touchdown_tilt_deg:g}° of tilt; missed: as soft, but farther off; crashed: harder, or against "
            f"something; lost: the centre out of view for {self.lost_s:g} s; timed out: {self.time_limit_s:g} s; "
            "diverged: out of control"
        )
