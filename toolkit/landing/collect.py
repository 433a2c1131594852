"""`toolkit landing collect`: what a drone sees from an imaginary cone that stands on a pad, with the truth of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from toolkit import __version__
from toolkit.core.config import Config, Flag, Range, Rising
from toolkit.core.console import notice, progress
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import read_json, sha256_file, write_json
from toolkit.core.locks import hold_folder
from toolkit.core.names import is_file_name
from toolkit.core.workspace import Workspace
from toolkit.landing.dataset import DATASET, DatasetFile, Sample, Shard, Split, Truth, write_shard
from toolkit.landing.episodes import place_cameras
from toolkit.landing.pads import Pad, find_pad
from toolkit.landing.site import (
    CameraConfig,
    Ground,
    PadPlace,
    PadSite,
    View,
    find_sky,
    find_world,
    place_at,
    plan_places,
)
from toolkit.rig.raycast import map_frames
from toolkit.worlds.sky import TIMES
from toolkit.worlds.weather import CLEAR, make_weather, parse_weathers
from toolkit.worlds.world import World

Weathers = tuple[tuple[str, int], ...]
MOST_TRIES = 60


def read_weathers(given: object) -> object:
    """(name, severity) from words such as `fog:1-3`; anything else as it is."""
    if isinstance(given, list | tuple) and all(isinstance(word, str) for word in given):
        return parse_weathers(given)
    return given


class CollectConfig(Config):
    """A data set for landings.

    Attributes:
        name: of its folder below captures/landing; by default the world's.
        world, world_seed: where.
        pad, size_m: what is looked for, and its side.
        frames: how many.
        places, ground: on how many places the pad lies, and on what.
        at: x and y of a place of the user's own, instead.
        height_m, half_angle_deg: of the cone of cameras; heights are drawn evenly in their logarithm.
        gimbal_error_deg: standard deviation of the camera's tilt about each axis.
        times: of day, in turn by place.
        weathers: (name, severity), drawn evenly for each frame.
        split, held_out: how frames are held out, and their share.
        shard_frames: in one tar.
        optics: the camera.
    """

    name: Annotated[str, Flag(positional=True, metavar="NAME")] = Field(
        "", description="Folder below captures/landing. Default: the world's name."
    )
    world: Annotated[str, Flag(metavar="NAME|FILE")] = Field(
        "grass", description="Built-in world, or a mesh or kit file."
    )
    world_seed: Annotated[int, Field(ge=0), Flag()] = Field(0, description="Of the world.")
    pad: Annotated[str, Flag(metavar="NAME|FILE")] = Field(
        "plain", description="plain, apriltag, grey, noise, one of print/pads, or a square picture."
    )
    size_m: Annotated[float, Flag("--size-m")] = Field(2.0, description="Side of the pad, metres.")
    frames: Annotated[int, Field(ge=2, le=10_000_000), Flag()] = Field(20_000, description="How many pictures.")
    places: Annotated[int, Field(ge=1, le=1000), Flag()] = Field(10, description="Places that the pad lies on in turn.")
    ground: Annotated[Ground, Flag()] = Field("both", description="What it lies on: decks, bare grass, or both.")
    at: Annotated[tuple[float, float] | None, Flag(metavar="X Y", typed=tuple[float, float])] = Field(
        None, description="One place of your own in the world, metres, instead."
    )
    height_m: Annotated[Range, Rising(0.3, 200), Flag()] = Field((0.8, 10.0), description="Heights of the camera.")
    half_angle_deg: Annotated[float, Field(gt=0, le=50), Flag("--half-angle")] = Field(
        25.0, description="Of the cone that cameras are in, its vertex on the pad."
    )
    gimbal_error_deg: Annotated[float, Field(ge=0, le=20), Flag("--gimbal-error")] = Field(
        0.3, description="Of the camera's mount: standard deviation."
    )
    times: Annotated[tuple[str, ...], Flag("--time", metavar="NAME")] = Field(
        ("noon",), description="Time of day; repeat for more, which places have in turn."
    )
    weathers: Annotated[Weathers, Flag("--weather", metavar="NAME[:SEVERITY]", typed=tuple[str, ...])] = Field(
        (CLEAR,), description="Weather, drawn for each frame: clear, fog:3, dust:1-3, rain; repeat for more."
    )
    split: Annotated[Literal["place", "random"], Flag()] = Field("place", description="How frames are held out.")
    held_out: Annotated[float, Field(ge=0, le=0.9), Flag()] = Field(0.2, description="Share that is held out.")
    shard_frames: Annotated[int, Field(ge=1, le=100_000)] = 500
    optics: CameraConfig = CameraConfig()

    @field_validator("weathers", mode="before")
    @classmethod
    def _read_weathers(cls, given: object) -> object:
        return read_weathers(given)

    @model_validator(mode="after")
    def _check(self) -> "CollectConfig":
        if self.name and not is_file_name(self.name):
            raise FieldError("expected a name of letters, digits, - and _", {"name": self.name})
        for time in self.times:
            find_time(time)
        for weather in self.weathers:
            make_weather(*weather)
        if np.tan(np.radians(self.half_angle_deg)) >= self.optics.view_tan:
            raise FieldError(
                f"expected less than half of {{optics.fov_deg}}, {self.optics.fov_deg:g}: else the pad is out of view",
                {"half_angle_deg": self.half_angle_deg},
            )
        if self.split == "place" and self.held_out > 0 and self.places < 2 and self.at is None:
            raise FieldError("a split by place needs at least 2; or hold frames out at random", {"places": self.places})
        return self

    @property
    def folder_name(self) -> str:
        """Of the data set."""
        return self.name or (self.world if is_file_name(self.world) else Path(self.world).stem)


def find_time(time: str) -> str:
    """A time of day, if it is one; else a `ToolkitError`."""
    if time not in TIMES:
        from toolkit.core.errors import one_of

        raise one_of("time of day", time, list(TIMES))
    return time


@dataclass(frozen=True)
class Collected:
    """What `collect` made.

    Attributes:
        folder: of the data set.
        about: its `dataset.json`.
        made: shards of this run; the others were there.
    """

    folder: Path
    about: DatasetFile
    made: int

    def count(self, split: Split) -> int:
        """Frames of a split."""
        return sum(shard.n for shard in self.about.shards if shard.split == split)


class Collector:
    """All frames of a config: frame i depends on (seed, i) alone."""

    def __init__(self, config: CollectConfig, world: World, pad: Pad, seed: int) -> None:
        self.config, self.world, self.pad, self.seed = config, world, pad, seed
        self.places: Sequence[PadPlace] = (
            (place_at(world, *config.at, config.size_m),)
            if config.at is not None
            else plan_places(world, config.size_m, config.places, seed, config.ground)
        )
        self._sites: dict[int, PadSite] = {}

    @cached_property
    def held_out_places(self) -> frozenset[int]:
        """Numbers of the places whose frames are held out, drawn by the seed."""
        count = len(self.places)
        if self.config.split != "place" or not self.config.held_out or count < 2:
            return frozenset()
        most = min(max(round(count * self.config.held_out), 1), count - 1)
        return frozenset(np.random.default_rng([self.seed, 62]).permutation(count)[:most].tolist())

    def split_of(self, index: int) -> Split:
        """Whether a frame is trained on or held out."""
        if self.config.split == "place" and len(self.places) > 1:
            return "held_out" if index % len(self.places) in self.held_out_places else "train"
        drawn = Draws(self.seed, index, "landing").of("split").uniform()
        return "held_out" if drawn < self.config.held_out else "train"

    def site(self, number: int) -> PadSite:
        """The pad on one of the places."""
        if number not in self._sites:
            # spots alternate as well: each has every time
            sky = find_sky(self.config.times[number // 2 % len(self.config.times)])
            self._sites[number] = PadSite(self.world, self.places[number], sky, self.pad, self.config.optics)
        return self._sites[number]

    def shoot(self, index: int) -> Sample:
        """One frame.

        Raises:
            ToolkitError: no free place is found in the cone.
        """
        number = index % len(self.places)
        site, draws = self.site(number), Draws(self.seed, index, "landing")
        weather = self.config.weathers[int(draws.of("weather").integers(len(self.config.weathers)))]
        pose, yaw = self.aim(index)
        image, mask = site.photograph_with_mask(View(pose, self.seed, index, weather))
        x, y, z = (round(float(value), 6) for value in site.truth(pose))
        turn = (np.degrees(yaw) - 90 - site.place.turn_deg + 180) % 360 - 180
        truth = Truth(
            index=index, seed=self.seed, x_m=x, y_m=y, z_m=z, yaw_deg=round(float(turn), 4), place=site.place.name,
            time=site.sky.name, weather=weather[0], severity=weather[1], seen_px=int(mask.sum()),
        )  # fmt: skip
        return Sample(image, mask, truth)

    def aim(self, index: int) -> tuple[np.ndarray, float]:
        """(4, 4) a frame's downward camera: in the cone, in free air, the pad in plain view; and its heading, rad."""
        site, rng = self.site(index % len(self.places)), Draws(self.seed, index, "landing").of("camera")
        low, high = np.log(self.config.height_m)
        for _ in range(MOST_TRIES):
            height, yaw, around = np.exp(rng.uniform(low, high)), rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi)
            aside = height * np.tan(np.radians(self.config.half_angle_deg)) * rng.uniform() ** 0.5
            tilt = np.radians(self.config.gimbal_error_deg) * rng.standard_normal((1, 2))
            place = site.centre + np.array([aside * np.cos(around), aside * np.sin(around), height])
            above = site.centre[None] + [[0, 0, 0.05]]
            if not (self.world.inside_building(place[None])[0] or site.ground.is_hit(above, place[None])[0]):
                return place_cameras(place[None], np.cos([yaw]), np.sin([yaw]), tilt)[0], float(yaw)
        raise ToolkitError(
            f"'{site.place.name}' of {self.world.name}: {MOST_TRIES} cameras in a row were in a wall or saw nothing of "
            "the pad: the cone goes through a building: take a narrower or lower one, or another place"
        )


def collect(space: Workspace, config: CollectConfig, seed: int = 0, restart: bool = False) -> Collected:
    """Shoot a data set into `captures/landing/NAME`; a run that was stopped goes on, to the same bytes.

    Args:
        space: the workspace.
        config: what.
        seed: of all draws.
        restart: forget what an earlier run left.

    Raises:
        ToolkitError: the folder holds a set of other settings, or the world has no place for the pad.
    """
    folder = space.captures_dir / "landing" / config.folder_name
    world, pad = find_world(config.world, config.world_seed), find_pad(space, config.pad, config.size_m, seed)
    collector = Collector(config, world, pad, seed)
    with hold_folder(folder):
        about = _begin(folder, config, collector, restart)
        if about.complete and all((folder / shard.file).is_file() for shard in about.shards):
            return Collected(folder, about, 0)
        return _shoot_shards(folder, config, collector, about)


def _begin(folder: Path, config: CollectConfig, collector: Collector, restart: bool) -> DatasetFile:
    """The set's file, of this or an earlier run; what a killed one left half-written is removed."""
    world, pad, settings = collector.world, collector.pad, config.record()
    inputs = config.sha256(world.sha256, pad.sha256, collector.seed, 1)
    file = folder / DATASET
    if restart:
        for found in (*folder.glob("*.tar"), file):
            found.unlink(missing_ok=True)
    for left in folder.glob(".*.partial"):
        left.unlink(missing_ok=True)
    if file.is_file():
        about = read_json(file, DatasetFile)
        if about.inputs_sha256 != inputs:
            raise FieldError(
                f"{folder} holds a data set of other settings: take another {{name}}, or run again with {{restart}}",
                {"name": config.folder_name},
            )
        return about
    places: dict[str, list[str]] = {"train": [], "held_out": []}
    for k, place in enumerate(collector.places):
        places["held_out" if k in collector.held_out_places else "train"].append(place.name)
    about = DatasetFile(
        inputs_sha256=inputs, seed=collector.seed, world=world.name, world_seed=world.seed, pad=pad.name,
        pad_sha256=pad.sha256, size_m=pad.size_m, camera=config.optics.camera.intrinsics, places=places,
        settings=settings, complete=False, shards=[], toolkit_version=__version__,
    )  # fmt: skip
    write_json(file, about.model_dump(mode="json"))
    return about


def _shoot_shards(folder: Path, config: CollectConfig, collector: Collector, about: DatasetFile) -> Collected:
    plan = plan_shards(config, collector)
    missing = [name for name, _, _ in plan if not (folder / name).is_file()]
    done = sum(len(some) for name, _, some in plan if name not in missing)
    if done:
        notice(f"going on: {done} of {config.frames} frames are there")
    with progress("Shooting frames", config.frames, done=done) as bar:
        for name, _, some in plan:
            if name in missing:
                for number in sorted({index % len(collector.places) for index in some}):
                    collector.site(number)  # lit before threads ask for it
                samples: list[Sample] = []
                for sample in map_frames(collector.shoot, some):
                    samples.append(sample)
                    bar.advance()
                write_shard(folder / name, samples)
    shards = [
        Shard(file=name, split=split, n=len(some), sha256=sha256_file(folder / name)) for name, split, some in plan
    ]
    about = about.model_copy(update={"complete": True, "shards": shards})
    write_json(folder / DATASET, about.model_dump(mode="json"))
    return Collected(folder, about, len(missing))


def plan_shards(config: CollectConfig, collector: Collector) -> list[tuple[str, Split, list[int]]]:
    """File, split and frames of every shard."""
    by_split: dict[Split, list[int]] = {"train": [], "held_out": []}
    for index in range(config.frames):
        by_split[collector.split_of(index)].append(index)
    plan: list[tuple[str, Split, list[int]]] = []
    for split, indices in by_split.items():
        for number, start in enumerate(range(0, len(indices), config.shard_frames)):
            name = f"{split.replace('_', '-')}-{number:06d}.tar"
            plan.append((name, split, indices[start : start + config.shard_frames]))
    return plan


def describe_collected(collected: Collected) -> dict[str, Any]:
    """What a script is told."""
    about = collected.about
    return {
        "folder": str(collected.folder), "train": collected.count("train"), "held_out": collected.count("held_out"),
        "shards": len(about.shards), "made": collected.made, "places": about.places,
    }  # fmt: skip
