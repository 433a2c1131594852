"""The settings of landing, declared once for the command line and for Python; nothing heavy is loaded for them."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from toolkit.core.config import Config, Flag, Joined, Later, Range, Rising
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.text import is_file_name
from toolkit.printing import AnyPaper
from toolkit.printing.page import parse_paper
from toolkit.rig.renderers import IN_WORLDS, RAYCAST, check_world_renderer
from toolkit.rooms.worlds.conditions import CLEAR, Time, Times, Weathers, check_weather, parse_weathers
from toolkit.training.loop import FitConfig

if TYPE_CHECKING:
    from toolkit.rig.camera import Camera
GAINS = {"paper": (5.0, 0.0, 5.0), "gentle": (1.0, 0.0, 0.0)}
"""Kp, Ki, Kd: the paper's (appendix B.3), and a control that a noisy regressor does not upset."""
OWN = re.compile(r"(\d+\.?\d*),(\d+\.?\d*),(\d+\.?\d*)")


def _check_name(name: str) -> str:
    if name and not is_file_name(name):
        raise ValueError("expected a name of letters, digits, - and _")
    return name


Ground = Literal["pads", "bare", "both"]
Pool = Literal["average", "grid"]
OwnName = Annotated[str, AfterValidator(_check_name)]
"""Name of a file or folder; empty if it follows from other settings."""
WorldName = Annotated[str, Flag(metavar="NAME|FILE"), Field(description="Built-in world, or a mesh or kit file.")]
WorldSeed = Annotated[int, Field(ge=0, description="Seed of the world."), Flag()]
OneTime = Annotated[Time, Flag(metavar="NAME"), Field(description="Time of day.")]
WeatherWords = Annotated[Weathers, Flag("--weather", metavar="NAME[:SEVERITY]", typed=tuple[str, ...])]
Heights = Annotated[
    Range, Rising(0.3, 200), Flag(), Field(description="Lowest and highest camera, metres above the pad.")
]
HalfAngle = Annotated[
    float,
    Field(gt=0, le=50, description="Cameras stand in a cone above the pad; degrees from its axis to its side."),
    Flag("--half-angle"),
]
GimbalError = Annotated[
    float,
    Field(ge=0, le=20, description="Error of the camera's mount, degrees, standard deviation."),
    Flag("--gimbal-error"),
]


class CameraConfig(Config):
    """The downward camera."""

    image_px: Annotated[int, Field(ge=32, le=1024), Flag("--image-px")] = Field(
        96, description="Side of a picture, pixels."
    )
    fov_deg: Annotated[float, Field(ge=20, le=120), Flag("--fov", metavar="DEGREES")] = Field(
        70.0, description="Horizontal field of view."
    )
    # standard deviation of the sensor at middle grey, see `toolkit.rig.shading.tone_map`
    noise: Annotated[float, Field(ge=0, le=0.2)] = 0.006
    renderer: Annotated[str, AfterValidator(check_world_renderer), Later(), Flag(metavar="|".join(IN_WORLDS))] = Field(
        RAYCAST, description="Renderer of the pictures."
    )

    @property
    def camera(self) -> "Camera":
        """Intrinsics."""
        from toolkit.rig.camera import Camera

        return Camera.from_fov(self.image_px, self.image_px, self.fov_deg)

    @property
    def view_tan(self) -> float:
        """Tangent of half the angle of view."""
        import numpy as np

        return float(np.tan(np.radians(self.fov_deg) / 2))


class CollectConfig(Config):
    """A data set for landings."""

    name: Annotated[OwnName, Flag(positional=True, metavar="NAME")] = Field(
        "", description="Folder below captures/landing. Default: the world's name."
    )
    world: WorldName = "grass"
    world_seed: WorldSeed = 0
    pad: Annotated[str, Flag(metavar="NAME|FILE")] = Field(
        "plain", description="plain, apriltag, grey, noise, a name in print/pads, or a square picture."
    )
    size_m: Annotated[float, Flag("--size-m")] = Field(2.0, description="Side of the pad, metres.")
    frames: Annotated[int, Field(ge=2, le=10_000_000), Flag()] = Field(20_000, description="Number of pictures.")
    places: Annotated[int, Field(ge=1, le=1000), Flag()] = Field(
        40, description="Number of places for the pad, in turn."
    )
    ground: Annotated[Ground, Flag()] = Field("both", description="Ground under the pad: decks, grass, or both.")
    at: Annotated[tuple[float, float] | None, Joined(", "), Flag(metavar="X Y", typed=tuple[float, float])] = Field(
        None, description="Your own place in the world, metres, instead."
    )
    height_m: Heights = (0.8, 10.0)
    half_angle_deg: HalfAngle = 25.0
    gimbal_error_deg: GimbalError = 0.3
    times: Annotated[Times, Flag("--time", metavar="NAME")] = Field(
        ("noon",), description="Time of day; repeat for more: each place takes the next."
    )
    weathers: WeatherWords = Field(
        (CLEAR,), description="Weather, drawn for each frame: clear, fog:3, dust:1-3, rain; repeat for more."
    )
    split: Annotated[Literal["place", "random"], Flag()] = Field(
        "place", description="Test frames: all frames of some places, or frames at random."
    )
    held_out: Annotated[float, Field(ge=0, le=0.9), Flag()] = Field(0.2, description="Share of the frames to test on.")
    shard_frames: Annotated[int, Field(ge=1, le=100_000)] = 500
    optics: CameraConfig = CameraConfig()

    @model_validator(mode="after")
    def _check(self) -> "CollectConfig":
        import numpy as np

        for weather in self.weathers:
            check_weather(*weather)
        # a cone as wide as the view would put the pad outside of the picture
        if np.tan(np.radians(self.half_angle_deg)) >= self.optics.view_tan:
            raise FieldError(
                f"expected less than half of {{optics.fov_deg}}, {self.optics.fov_deg:g}: else the pad is out of view",
                {"half_angle_deg": self.half_angle_deg},
            )
        # a place is wholly in a split, so that held-out frames show unseen ground
        if self.split == "place" and self.held_out > 0 and self.places < 2 and self.at is None:
            raise FieldError("a split by place needs at least 2; or hold frames out at random", {"places": self.places})
        if self.split == "place" and self.frames < self.places and self.at is None:
            raise FieldError("expected a frame for each place", {"frames": self.frames, "places": self.places})
        return self

    @property
    def folder_name(self) -> str:
        """Name of the data set's folder."""
        return self.name or (self.world if is_file_name(self.world) else Path(self.world).stem)


class LandingTrainConfig(Config):
    """How a regressor is trained."""

    name: Annotated[OwnName, Flag(metavar="NAME")] = Field(
        "", description="Name of the network's file. Default: the data set's name."
    )
    arch: Annotated[str, Flag(metavar="NAME")] = Field("resnet18", description="Torchvision network.")
    init: Annotated[Path | None, Flag(metavar="FILE", typed=Path)] = Field(
        None,
        description="Weights to start from. Default: ImageNet's if they are on this machine, else the bundled "
        "network's.",
    )
    # see `build_module`
    pool: Annotated[Pool, Flag()] = Field(
        "grid", description="Features for the last layer: their average, or a grid of them."
    )
    # linear probing, then fine-tuning (Kumar et al. 2022); normalisation keeps the statistics of the given weights
    probe: Annotated[bool, Flag()] = Field(True, description="Fit the last layer by ridge regression before training.")
    frames: Annotated[int | None, Field(ge=8), Flag(typed=int)] = Field(
        None, description="Train on at most so many frames."
    )
    epochs: Annotated[int, Field(ge=1, le=1000), Flag()] = Field(8, description="Times through the frames.")
    batch: Annotated[int, Field(ge=2, le=4096), Flag()] = Field(64, description="Frames per step.")
    lr: Annotated[float, Field(gt=0, le=10), Flag()] = Field(2e-4, description="Highest learning rate.")
    optimiser: Annotated[Literal["sgd", "adam"], Flag()] = Field("adam", description="Optimiser of the weights.")
    schedule: Annotated[Literal["constant", "linear", "cosine", "one-cycle"], Flag()] = Field(
        "one-cycle", description="How the learning rate changes."
    )
    momentum: Annotated[float, Field(ge=0, lt=1)] = 0.9
    weight_decay: Annotated[float, Field(ge=0, le=1), Flag()] = Field(1e-4, description="Weight decay.")
    loss: Annotated[Literal["mse", "relative"], Flag()] = Field(
        "relative", description="mse: mean square error in metres; relative: as a share of the height."
    )
    augment: Annotated[bool, Flag()] = Field(True, description="Quarter turns, and changes of light.")
    # a third output: the logarithm of the standard deviation, by the likelihood of a normal error
    uncertainty: Annotated[bool, Flag()] = Field(
        False, description="Also predict the error to be expected, by maximum likelihood; {loss} then does not count."
    )

    def fit_config(self, frames: int, seed: int) -> FitConfig:
        """Return the settings of the training loop."""
        steps = max(frames // self.batch, 1) * self.epochs
        return FitConfig(
            steps=steps, lr=self.lr, schedule=self.schedule, optimiser=self.optimiser, seed=seed,
            momentum=self.momentum, weight_decay=self.weight_decay,
        )  # fmt: skip


RECIPES = {
    "quick": LandingTrainConfig(),
    "paper": LandingTrainConfig(
        epochs=10, batch=512, lr=1e-3, optimiser="sgd", schedule="constant", weight_decay=1e-4, loss="mse",
        augment=False,
    ),
}  # fmt: skip
"""`paper`: appendix B.3 of Salman et al. 2021; it names no momentum: 0.9, as for their patches."""


class BoostConfig(Config):
    """How a pad's picture is trained."""

    name: Annotated[OwnName, Flag(metavar="NAME")] = Field(
        "", description="Name of the pad. Default: REGRESSOR-boosted."
    )
    size_px: Annotated[int, Field(ge=8, le=512), Flag()] = Field(64, description="Side of the picture, pixels.")
    start: Annotated[Literal["plain", "grey", "noise"], Flag("--start-pad")] = Field(
        "plain", description="Picture that training starts from."
    )
    world: WorldName = "grass"
    world_seed: WorldSeed = 0
    places: Annotated[int, Field(ge=1, le=200), Flag()] = Field(8, description="Number of places for the pad.")
    ground: Annotated[Ground, Flag()] = Field("both", description="Ground under the pad: decks, grass, or both.")
    time: OneTime = "noon"
    views: Annotated[int, Field(ge=8, le=20_000), Flag()] = Field(320, description="Number of rendered views.")
    height_m: Heights = (0.8, 10.0)
    half_angle_deg: HalfAngle = 25.0
    weathers: WeatherWords = Field(
        parse_weathers(["fog", "dust"]), description="Weather between pad and camera; repeat for more."
    )
    weather_probability: Annotated[float, Field(ge=0, le=1), Flag()] = Field(
        0.7, description="Probability that a view has weather."
    )
    steps: Annotated[int, Field(ge=1, le=1_000_000), Flag()] = Field(240, description="Training steps.")
    batch: Annotated[int, Field(ge=1, le=1024), Flag()] = Field(24, description="Views per step.")
    lr: Annotated[float, Field(gt=0, le=1), Flag()] = Field(
        0.02, description="Learning rate: the change of a pixel per step."
    )
    light: Annotated[Range, Rising(0.2, 3)] = (0.75, 1.25)  # factor on all light, drawn for each view
    noise: Annotated[float, Field(ge=0, le=0.5)] = 0.01  # standard deviation of the camera, encoded


class PadPrintConfig(Config):
    """The pad on paper."""

    print_size_m: Annotated[float | None, Field(ge=0.5, le=2.0), Flag(typed=float)] = Field(
        None, description="Side of the printed pad, metres. Default: as trained."
    )
    paper: Annotated[AnyPaper, Flag(metavar="SIZE", typed=str)] = Field(
        parse_paper("a3"), description="a0 to a5, letter, or your own: 200x300mm."
    )


def parse_gains(word: str) -> tuple[float, float, float]:
    """Kp, Ki, Kd of `paper`, `gentle`, or numbers such as `2,0,0.5`; raises a `ToolkitError` if it is neither."""
    if word in GAINS:
        return GAINS[word]
    found = OWN.fullmatch(word)
    if found is None:
        raise ToolkitError(f"gains '{word}': expected {', '.join(GAINS)}, or Kp,Ki,Kd such as 2,0,0.5")
    kp, ki, kd = (float(number) for number in found.groups())
    return kp, ki, kd


class DescentConfig(Config):
    """When and how fast the drone goes down."""

    fastest_m_s: Annotated[float, Field(gt=0, le=6), Flag("--descent")] = Field(
        1.5, description="Fastest descent, m/s."
    )
    slowest_m_s: Annotated[float, Field(gt=0, le=6)] = 0.5  # near the pad
    rate: Annotated[float, Field(gt=0)] = 0.5  # speed per metre of height between the two
    # it descends while the pad is within align_m + align_share · height of straight below
    align_m: Annotated[float, Field(gt=0)] = 0.15
    align_share: Annotated[float, Field(ge=0)] = 0.25
    blind_m: Annotated[float, Field(ge=0), Flag()] = Field(
        0.8, description="Below this height it flies straight down without looking, metres."
    )
    # below this height a missed pad, such as a pad that fills the picture, does not stop it
    unseen_m: Annotated[float, Field(ge=0)] = 1.6


class EpisodeConfig(Config):
    """Where a landing begins, in which air, what the camera's mount does, and what counts as a landing."""

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
    gust_time_s: Annotated[float, Field(gt=0, le=60)] = 1.0  # how long gusts last
    camera_hz: Annotated[float, Field(gt=0, le=100), Flag()] = Field(10.0, description="Pictures a second.")
    latency_s: Annotated[float, Field(ge=0), Flag()] = Field(
        0.05, description="Delay from a picture to its command, seconds."
    )
    # the deviation of its bias over an episode; a third of it trembles
    gimbal_error_deg: GimbalError = 0.3
    radius_m: Annotated[float, Field(gt=0, le=10), Flag()] = Field(
        0.5, description="A landing counts as a success within this distance of the centre, metres."
    )
    touchdown_m_s: Annotated[float, Field(gt=0)] = 1.2  # fastest that counts as a landing
    touchdown_tilt_deg: Annotated[float, Field(gt=0, le=90)] = 15.0  # largest tilt that counts
    lost_s: Annotated[float, Field(gt=0)] = 2.0  # how long the pad's centre may be out of view
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
        """The definition of a success, in words."""
        return (
            f"success: touchdown within {self.radius_m:g} m of the centre, at most {self.touchdown_m_s:g} m/s and "
            f"{self.touchdown_tilt_deg:g}° of tilt; missed: as soft, but farther off; crashed: harder, or against "
            f"something; lost: the centre out of view for {self.lost_s:g} s; timed out: {self.time_limit_s:g} s; "
            "diverged: out of control"
        )


class FlyConfig(Config):
    """What is flown."""

    regressors: Annotated[tuple[str, ...], Flag(positional=True, metavar="REGRESSOR...")] = Field(
        min_length=1, description="Trained regressors; features and apriltag are classical ones."
    )
    name: Annotated[OwnName, Flag(metavar="NAME")] = Field(
        "", description="Folder below eval/landing. Default: the first regressor's."
    )
    pads: Annotated[tuple[str, ...], Flag("--pad", metavar="NAME|FILE")] = Field(
        ("plain",), description="Pad; repeat for more. The others are compared with the first."
    )
    world: WorldName = "grass"
    world_seed: WorldSeed = 0
    places: Annotated[int, Field(ge=1, le=200), Flag()] = Field(
        8, description="Number of places; each episode takes the next."
    )
    ground: Annotated[Ground, Flag()] = Field("both", description="Ground under pads: decks, grass, or both.")
    time: OneTime = "noon"
    weathers: WeatherWords = Field((CLEAR,), description="Weather; repeat for more: clear, fog:1-5, dust:3, rain.")
    gains: Annotated[tuple[str, ...], Flag(metavar="NAME|KP,KI,KD")] = Field(
        ("gentle",), description="paper (5,0,5), gentle (1,0,0), or your own; repeat for more."
    )
    episodes: Annotated[int, Field(ge=1, le=100_000), Flag()] = Field(64, description="Episodes in each cell.")
    batch: Annotated[int, Field(ge=1, le=1024), Flag()] = Field(64, description="Episodes that are computed together.")
    size_m: Annotated[float | None, Flag("--size-m", typed=float)] = Field(
        None, description="Side of the pads, metres. Default: as trained."
    )
    image_px: Annotated[int | None, Field(ge=32, le=1024), Flag("--image-px", typed=int)] = Field(
        None,
        description="Side of a picture for features and apriltag. Default: 96. Regressors: as trained.",
    )
    episode: EpisodeConfig = EpisodeConfig()
    descent: DescentConfig = DescentConfig()

    @model_validator(mode="after")
    def _check(self) -> "FlyConfig":
        for word in self.gains:
            parse_gains(word)
        return self


class DemoConfig(Config):
    """How small the demonstration is."""

    frames: Annotated[int, Field(ge=40), Flag()] = Field(2400, description="Pictures to collect.")
    epochs: Annotated[int, Field(ge=1), Flag()] = Field(10, description="Epochs of the regressor.")
    image_px: Annotated[int, Field(ge=32), Flag("--image-px")] = Field(64, description="Side of a picture, pixels.")
    steps: Annotated[int, Field(ge=1), Flag()] = Field(240, description="Steps of the pad's training.")
    episodes: Annotated[int, Field(ge=1), Flag()] = Field(16, description="Episodes in each cell.")
    weathers: Annotated[tuple[str, ...], Flag("--weather", metavar="NAME[:SEVERITY]")] = Field(
        ("clear", "fog:4", "snow:2"), description="Weather to fly in; repeat for more."
    )
