"""`toolkit landing collect`: what a drone sees from an imaginary cone that stands on a pad, with the truth of it."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from toolkit import __version__
from toolkit.core.console import notice
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import delete_file, read_json, sha256_file, write_json
from toolkit.core.records import hold_folder
from toolkit.core.threads import map_ahead
from toolkit.core.work import Work
from toolkit.core.workspace import Workspace
from toolkit.engine import EngineConfig
from toolkit.engine.units import Engine, Shared, Unit, cut_groups, run_resumable
from toolkit.rooms.landing.config import CollectConfig
from toolkit.rooms.landing.dataset import (
    DATASET,
    DatasetFile,
    EncodedSample,
    Sample,
    ShardFile,
    Split,
    Truth,
    encode_sample,
    write_shard,
)
from toolkit.rooms.landing.episodes import draw_in_cone, place_cameras
from toolkit.rooms.landing.site import (
    Pad,
    PadPlace,
    PadSite,
    Sites,
    SiteView,
    find_pad,
    find_world,
    place_at,
    plan_places,
)
from toolkit.rooms.worlds.world import World

MOST_TRIES = 60
FRAMES = Work("landing frames", 1, old_at=3)
UNIT_FRAMES = 100
"""Frames that are shot together."""


@dataclass(frozen=True)
class Collected:
    """What `collect` made."""

    folder: Path  # of the data set
    about: DatasetFile  # its `dataset.json`
    made: int  # shards of this run; the others were there
    # (what, reason) of frames that could not be shot; without them the set is not complete, and the next run tries them
    # again
    failed: tuple[tuple[str, str], ...] = ()

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
        self.sites = Sites(world, self.places, config.times, config.optics)

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
        # by place: frames of the same place look alike, and would be known from training
        if self.config.split == "place" and len(self.places) > 1:
            return "held_out" if index % len(self.places) in self.held_out_places else "train"
        drawn = Draws(self.seed, index, "landing").of("split").uniform()
        return "held_out" if drawn < self.config.held_out else "train"

    def site(self, number: int) -> PadSite:
        """The pad on a place by its number."""
        return self.sites.site(self.pad, number)

    def light_pads(self, indices: Iterable[int]) -> None:
        """Light the pad on all places of some frames."""
        self.sites.light_pads(self.pad, (index % len(self.places) for index in indices))

    def shoot(self, index: int) -> Sample:
        """A frame; raises a `ToolkitError` if no free place is found in the cone."""
        # frames take the places in turn; the weather is drawn
        number = index % len(self.places)
        site, draws = self.site(number), Draws(self.seed, index, "landing")
        weather = self.config.weathers[int(draws.of("weather").integers(len(self.config.weathers)))]
        pose, yaw = self.aim(index)
        image, mask = site.photograph_with_mask(SiteView(pose, self.seed, index, weather))
        x, y, z = (round(float(value), 6) for value in site.truth(pose))
        # heading against the pad's own turn, within half a turn either way
        turn = (np.degrees(yaw) - 90 - site.place.turn_deg + 180) % 360 - 180
        truth = Truth(
            index=index, seed=self.seed, x_m=x, y_m=y, z_m=z, yaw_deg=round(float(turn), 4), place=site.place.name,
            time=site.sky.name, weather=weather[0], severity=weather[1], seen_px=int(mask.sum()),
        )  # fmt: skip
        return Sample(image, mask, truth)

    def aim(self, index: int) -> tuple[np.ndarray, float]:
        """(4, 4) a frame's downward camera: in the cone, in free air, the pad in plain view; and its heading, rad."""
        site, rng = self.site(index % len(self.places)), Draws(self.seed, index, "landing").of("camera")
        for _ in range(MOST_TRIES):
            offset, yaw = draw_in_cone(rng, self.config.height_m, self.config.half_angle_deg)
            # the gimbal's error is a normal draw about both axes of the camera
            tilt = np.radians(self.config.gimbal_error_deg) * rng.standard_normal((1, 2))
            place = site.centre + offset
            # from just above the pad: the line of sight must not begin in its sheet
            above = site.centre[None] + [[0, 0, 0.05]]
            if not (self.world.inside_building(place[None])[0] or site.ground.is_hit(above, place[None])[0]):
                return place_cameras(place[None], np.cos([yaw]), np.sin([yaw]), tilt)[0], yaw
        raise ToolkitError(
            f"'{site.place.name}' of {self.world.name}: {MOST_TRIES} cameras in a row were in a wall or saw nothing of "
            "the pad: the cone goes through a building: take a narrower or lower cone, or another place"
        )


def collect(
    space: Workspace, config: CollectConfig, seed: int = 0, restart: bool = False, engine: EngineConfig | None = None
) -> Collected:
    """Shoot a data set into `captures/landing/NAME`; an interrupted run resumes, to the same bytes.

    Args:
        engine: where frames are shot; by default in this process.

    Raises:
        ToolkitError: the folder holds a set of other settings, the world has no place for the pad, or no shard can be
            shot.
    """
    folder = space.captures_dir / "landing" / config.folder_name
    world, pad = find_world(config.world, config.world_seed), find_pad(space, config.pad, config.size_m, seed)
    collector = Collector(config, world, pad, seed)
    with hold_folder(folder):
        about = _begin(folder, config, collector, restart)
        # a finished set is left alone, whatever a new run could improve
        if about.complete and all((folder / shard.file).is_file() for shard in about.shards):
            return Collected(folder, about, 0)
        with (engine or EngineConfig()).open() as workers:
            return _shoot_shards(folder, collector, about, workers)


def _begin(folder: Path, config: CollectConfig, collector: Collector, restart: bool) -> DatasetFile:
    """The set's file, of this or an earlier run; what a killed run left half-written is removed."""
    world, pad, settings = collector.world, collector.pad, config.record()
    key = FRAMES.key(world.sha256, pad.sha256, collector.seed, settings)
    file = folder / DATASET
    # remove what a restart or a killed run leaves
    if restart:
        for found in (*folder.glob("*.tar"), file):
            delete_file(found)
    for left in folder.glob(".*.partial"):
        delete_file(left)
    # a set that is there must have the same settings
    if file.is_file():
        about = read_json(file, DatasetFile)
        if about.inputs_sha256 != key:
            raise FieldError(
                f"{folder} holds a data set of other settings: take another {{name}}, or run again with {{restart}}",
                {"name": config.folder_name},
            )
        return about
    # a new set begins with its file, still incomplete
    places: dict[str, list[str]] = {"train": [], "held_out": []}
    for k, place in enumerate(collector.places):
        places["held_out" if k in collector.held_out_places else "train"].append(place.name)
    about = DatasetFile(
        inputs_sha256=key, seed=collector.seed, world=world.name, world_seed=world.seed, pad=pad.name,
        pad_sha256=pad.sha256, size_m=pad.size_m, camera=config.optics.camera.intrinsics, places=places,
        settings=settings, complete=False, shards=[], toolkit_version=__version__,
    )  # fmt: skip
    write_json(file, about.model_dump(mode="json"))
    return about


FrameKey = tuple[str, int]
"""File of a frame's shard, and its index."""


def _shoot_shards(folder: Path, collector: Collector, about: DatasetFile, engine: Engine) -> Collected:
    """Shoot shards that are not there; each is written when its frames are, and a set with a gap is not complete."""
    # what is wanted, and what earlier runs have written
    plan = plan_shards(collector.config, collector)
    wanted = {(name, index): name for name, _, some in plan for index in some}
    there = {name for name, _, _ in plan if (folder / name).is_file()}
    missing = {key: name for key, name in wanted.items() if name not in there}
    if there:
        notice(f"going on: {len(wanted) - len(missing)} of {len(wanted)} frames are there")
    sizes = {name: len(some) for name, _, some in plan}
    shard: dict[FrameKey, EncodedSample] = {}
    made: list[str] = []

    def keep(key: FrameKey, name: str, sample: EncodedSample) -> None:
        if shard and next(iter(shard))[0] != name:  # the shard before lacks frames
            shard.clear()
        shard[key] = sample
        if len(shard) == sizes[name]:
            write_shard(folder / name, list(shard.values()))
            made.append(name)

    # shoot the missing frames
    units = _list_units(collector, missing, engine)
    ran = run_resumable("Shooting frames", wanted, missing, units, keep, engine, folder)
    if ran.failed:
        if not made and not there:
            raise ToolkitError(ran.failed[0][1])
        return Collected(folder, about, len(made), ran.failed)
    # the set is complete: its file lists the shards with their hashes
    shards = [
        ShardFile(file=name, split=split, n=len(some), sha256=sha256_file(folder / name)) for name, split, some in plan
    ]
    about = about.model_copy(update={"complete": True, "shards": shards})
    write_json(folder / DATASET, about.model_dump(mode="json"))
    return Collected(folder, about, len(made))


def _list_units(collector: Collector, missing: Mapping[FrameKey, str], engine: Engine) -> Iterator[Unit[EncodedSample]]:
    """Some frames of a shard each."""
    collector.sites.light_world()
    shared = engine.share(collector)
    for keys, (name, *_) in cut_groups(missing, lambda name: name, UNIT_FRAMES):
        some = [index for _, index in keys]
        yield Unit(keys, shoot_unit, (shared, some), f"{name} frames {some[0]}-{some[-1]}")


def shoot_unit(shared: Shared[Collector], indices: Sequence[int]) -> Iterator[EncodedSample]:
    """The work of a unit: frames as they lie in a shard."""
    collector = shared.get()
    collector.light_pads(indices)  # before threads ask for them
    yield from map_ahead(lambda index: encode_sample(collector.shoot(index)), indices)


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
