"""`toolkit landing fly`: a pilot, and episodes in closed loop for every pad, regressor, weather and set of gains."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Annotated, Protocol

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict

from toolkit.core.console import notice
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import delete_file, sha256_bytes
from toolkit.core.records import hold_folder
from toolkit.core.threads import map_ahead
from toolkit.core.work import NOWHERE, Work
from toolkit.core.workspace import Workspace
from toolkit.engine import EngineConfig
from toolkit.engine.units import Engine, Shared, Unit, WorkLog, cut_groups, run_resumable
from toolkit.rooms.landing.baselines import make_apriltag, make_features
from toolkit.rooms.landing.config import CameraConfig, DescentConfig, FlyConfig, parse_gains
from toolkit.rooms.landing.episodes import OUTCOMES, Episode, Flights, Look
from toolkit.rooms.landing.regressor import SUFFIX, Regressor, load_regressor
from toolkit.rooms.landing.site import (
    Pad,
    PadPlace,
    PadSite,
    Sites,
    SiteView,
    WorldGround,
    find_pad,
    find_world,
    plan_places,
)
from toolkit.rooms.worlds.conditions import name_weather
from toolkit.rooms.worlds.world import World

FINDERS = ("features", "apriltag")
"""Classical ones, which stand where a regressor's name does."""
TICKS = 100_000
"""Pictures of an episode at most; its noise and weather are drawn by index · TICKS + tick."""
KEPT_TRACKS = 16
FLIGHTS = Work("episode", 1, old_at=NOWHERE)


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
        # of a first picture, and after a picture without a pad, there is no slope
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
        # kept before the next step: the answers belong to these poses
        offsets = flights.level_offsets(seen, chosen)
        for k, offset in zip(chosen, offsets, strict=True):
            flights.episodes[k].seen.append(offset)
        flights.advance(pilot.steer(seen, chosen))


@dataclass(frozen=True, order=True)
class FlightCell:
    """A combination that is flown."""

    pad: str
    regressor: str
    world: str
    weather: str
    severity: int
    gains: str

    @property
    def key(self) -> str:
        """`plain/pad-net/grass/fog:3/gentle`."""
        air = name_weather(self.weather, self.severity)
        return "/".join((self.pad, self.regressor, self.world, air, self.gains))

    @property
    def air(self) -> str:
        """`clear`, or `fog 3`."""
        return name_weather(self.weather, self.severity).replace(":", " ")

    @property
    def words(self) -> str:
        """`plain, pad-net, fog 3, gentle`."""
        return ", ".join((self.pad, self.regressor, self.air, self.gains))


def _check_outcome(word: str) -> str:
    if word not in OUTCOMES:
        raise ValueError(f"expected {', '.join(OUTCOMES)}")
    return word


class EpisodeRecord(BaseModel):
    """An episode that has ended, a line of `episodes.jsonl`.

    Attributes:
        inputs: hash of all that decides it but cell and index.
        pad, regressor, world, weather, severity, gains: of its cell.
        index, place: of it.
        outcome, error_m, time_s, path_m, speed_m_s, tilt_deg: see `Episode`.
        track: (x, y, z) over the pad at each picture, metres; of the first episodes only.
        seen: (x, y) that the regressor said of each picture, as an offset in the world.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    inputs: str
    pad: str
    regressor: str
    world: str
    weather: str
    severity: int
    gains: str
    index: int
    place: str
    outcome: Annotated[str, AfterValidator(_check_outcome)]
    error_m: float | None
    time_s: float
    path_m: float
    speed_m_s: float | None
    tilt_deg: float | None
    track: list[tuple[float, float, float]] = []
    seen: list[tuple[float, float] | None] = []

    @property
    def cell(self) -> FlightCell:
        """The combination that it was flown in."""
        return FlightCell(self.pad, self.regressor, self.world, self.weather, self.severity, self.gains)


class PadFinder(Protocol):
    """A regressor or a classical finder."""

    def predict(self, images: np.ndarray) -> np.ndarray:
        """(n, 2) metres of (n, h, w, 3) uint8; NaN where the pad is not found."""
        ...


@dataclass(frozen=True)
class Flown:
    """What `fly_all` made."""

    folder: Path  # eval/landing/NAME
    records: tuple[EpisodeRecord, ...]  # of all episodes of the cells
    cells: tuple[FlightCell, ...]  # in order; a cell whose episodes failed is left out
    made: int  # episodes of this run
    places: tuple[PadPlace, ...]
    # what rendering, network and physics of this run took, of several processes all of theirs
    seconds: dict[str, float]
    # (what, reason) of episodes that could not be flown; the next run tries them again
    failed: tuple[tuple[str, str], ...] = ()


@dataclass
class Clock:
    """Time of a run by its use, seconds, summed over processes."""

    rendering: float = 0.0
    network: float = 0.0
    whole: float = 0.0

    @property
    def shares(self) -> dict[str, float]:
        """Shares of the time for rendering, network, and the rest (physics and control)."""
        rest = self.whole - self.rendering - self.network
        return {"rendering_s": self.rendering, "network_s": self.network, "physics_s": rest, "whole_s": self.whole}

    def add(self, other: "Clock") -> None:
        """Count another's time as well."""
        self.rendering += other.rendering
        self.network += other.network
        self.whole += other.whole


@dataclass(frozen=True)
class FlightSetup:
    """Inputs of all flights of a run."""

    config: FlyConfig
    seed: int
    sites: Sites  # pads on their places
    pads: dict[str, Pad]  # pads, predictors: by name; None for classical finders
    predictors: dict[str, Regressor | None]

    def key(self, cell: FlightCell) -> str:
        """Key of all that decides an episode of a cell, but cell and index."""
        config, sites = self.config, self.sites
        key = FLIGHTS.key(
            config.descent.record(), sites.world.sha256, [(place.centre, place.turn_deg) for place in sites.places],
            config.time, self.seed, sites.optics.record(), config.episode.record(),
        )  # fmt: skip
        predictor = self.predictors[cell.regressor]
        weights = cell.regressor if predictor is None else predictor.record.sha256
        return f"{key[:16]}-{sha256_bytes((self.pad(cell).sha256 + weights).encode())[:16]}"

    def pad(self, cell: FlightCell) -> Pad:
        """The pad of a cell."""
        return next(pad for pad in self.pads.values() if pad.name == cell.pad)

    def finder(self, cell: FlightCell) -> PadFinder:
        """The regressor of a cell, or a classical finder of its pad."""
        make = make_features if cell.regressor == "features" else make_apriltag
        return self.predictors[cell.regressor] or make(self.pad(cell), self.sites.optics.camera)


def fly_all(
    space: Workspace, config: FlyConfig, *, seed: int = 0, device: str = "cpu", restart: bool = False,
    engine: EngineConfig | None = None,
) -> Flown:  # fmt: skip
    """Fly every cell, or what an interrupted run of the same settings left of them.

    Episodes are added to `eval/landing/NAME/episodes.jsonl` as they end. Episode i starts at the same place, in the
    same wind and noise, in every cell. A cell in which episodes fail is left out.

    Args:
        engine: where episodes are flown; by default in this process.

    Raises:
        ToolkitError: a regressor, pad, world or weather cannot be used, or no cell can be flown.
    """
    # the finders decide the camera and the pad's size
    predictors, optics, size_m = load_predictors(space, config, device)
    pads = {word: find_pad(space, word, size_m, seed) for word in config.pads}
    _check_names({word: (pad.name, pad.sha256) for word, pad in pads.items()})
    world = find_world(config.world, config.world_seed)
    # spots that a regressor was trained on are avoided while there are others
    places = _choose_places(world, config, size_m, seed, _find_used(predictors, world))
    folder = space.eval_dir / "landing" / (config.name or name_finder(config.regressors[0]))
    setup = FlightSetup(config, seed, Sites(world, places, (config.time,), optics), pads, predictors)
    cells = list_cells(config, pads, world)
    # the folder is held: two runs would mix their episodes
    with hold_folder(folder), (engine or EngineConfig()).open(gpus=int(device != "cpu")) as workers:
        file = folder / "episodes.jsonl"
        if restart:
            delete_file(file)
        return _fly_missing(setup, cells, file, workers)


EpisodeKey = tuple[str, FlightCell, int]
"""Hash of all that decides an episode but cell and index, and these."""
Flight = tuple[Episode, Clock]
"""An episode, and what the time of all that flew in lockstep went to, which the first of them counts."""


def _fly_missing(setup: FlightSetup, cells: Sequence[FlightCell], file: Path, engine: Engine) -> Flown:
    # a cell is known by the hash of its inputs, so settings can change between runs
    digests, numbers = {cell: setup.key(cell) for cell in cells}, range(setup.config.episodes)
    wanted = {(digest, cell, index): cell for cell, digest in digests.items() for index in numbers}
    cache = WorkLog(file, EpisodeRecord, lambda row: [((row.inputs, row.cell, row.index), row)], wanted)
    missing, clock, places = cache.find_missing(wanted), Clock(), setup.sites.places

    def keep(key: EpisodeKey, cell: FlightCell, flight: Flight) -> None:
        clock.add(flight[1])
        cache.add(_record(cell, key[0], places, flight[0]))

    units = _list_units(setup, missing, engine)
    ran = run_resumable("Flying episodes", wanted, missing, units, keep, engine, file.parent)
    # a cell with a failed episode is left out whole: its rate would be of fewer episodes
    lost = set(cache.find_missing(wanted).values())
    left = tuple(cell for cell in cells if cell not in lost)
    if not left:
        raise ToolkitError(ran.failed[0][1])
    records = tuple(cache.known[key] for key, cell in wanted.items() if cell not in lost)
    return Flown(file.parent, records, left, ran.made, places, clock.shares, ran.failed)


def _list_units(setup: FlightSetup, missing: Mapping[EpisodeKey, FlightCell], engine: Engine) -> Iterator[Unit[Flight]]:
    """A unit for each batch of a cell's episodes."""
    setup.sites.light_world()
    shared = engine.share(setup)
    for keys, (cell, *_) in cut_groups(missing, lambda cell: cell, setup.config.batch):
        indices = [index for _, _, index in keys]
        yield Unit(keys, fly_unit, (shared, cell, indices), f"{cell.key} episodes {indices[0]}-{indices[-1]}")


def fly_unit(shared: Shared[FlightSetup], cell: FlightCell, indices: list[int]) -> Iterator[Flight]:
    """The work of a unit: `fly_cell`."""
    setup, clock, begun = shared.get(), Clock(), perf_counter()
    episodes = fly_cell(setup, cell, indices, clock)
    clock.whole = perf_counter() - begun
    for at, episode in enumerate(episodes):
        yield episode, Clock() if at else clock


def load_predictors(
    space: Workspace, config: FlyConfig, device: str
) -> tuple[dict[str, Regressor | None], CameraConfig, float]:
    """Regressors by name, None for classical finders; their camera, and their pad's side."""
    loaded = {word: None if word in FINDERS else load_regressor(space, word, device) for word in config.regressors}
    _check_names({word: (name_finder(word), one.record.sha256 if one else "") for word, one in loaded.items()})
    predictors = {name_finder(word): one for word, one in loaded.items()}
    trained = [regressor for regressor in predictors.values() if regressor is not None]
    # classical finders work with any camera
    if not trained:
        optics = CameraConfig() if config.image_px is None else CameraConfig(image_px=config.image_px)
        return predictors, optics, config.size_m or 2.0
    first = trained[0].record
    if config.image_px not in (None, first.image_px):
        raise FieldError(f"expected {first.image_px}, as {trained[0].name} was trained", {"image_px": config.image_px})
    optics = CameraConfig(image_px=first.image_px, fov_deg=first.fov_deg)
    for network in trained:
        network.check(optics)
    return predictors, optics, config.size_m or first.size_m


def name_finder(word: str) -> str:
    """Name of a regressor that is given by its name or its file, or of a classical finder."""
    return Path(word).name.removesuffix(SUFFIX)


def _check_names(named: Mapping[str, tuple[str, str]]) -> None:
    """Raise a `ToolkitError` if two words mean files of one name: their episodes would be counted together.

    Args:
        named: name and SHA-256 by word.
    """
    first: dict[str, tuple[str, str]] = {}
    for word, (name, sha256) in named.items():
        other, known = first.setdefault(name, (word, sha256))
        if known != sha256:
            raise ToolkitError(
                f"{other} and {word} would both be called {name} in the results: rename one of the files"
            )


def _find_used(predictors: Mapping[str, Regressor | None], world: World) -> frozenset[str]:
    """Spots of a world that regressors were trained on."""
    data = [regressor.record.data for regressor in predictors.values() if regressor is not None]
    sets = [found for recorded in data for found in recorded.get("sets", [recorded])]
    here = [data for data in sets if (data["world"], data.get("world_seed", world.seed)) == (world.name, world.seed)]
    return frozenset(name.rpartition("-")[0] for place in here for name in place["places"]["train"])


def _choose_places(
    world: World, config: FlyConfig, size_m: float, seed: int, used: frozenset[str]
) -> tuple[PadPlace, ...]:
    """Places drawn apart from those of data sets, on spots that were not trained on where there are any."""
    own = seed + 1_000_003
    try:
        return plan_places(world, size_m, config.places, own, config.ground, used)
    except FieldError:
        raise
    except ToolkitError:
        places = plan_places(world, size_m, config.places, own, config.ground)
        notice(f"every spot of {world.name} was trained on: pads lie on other points of the same spots")
        return places


def list_cells(config: FlyConfig, pads: dict[str, Pad], world: World) -> list[FlightCell]:
    """All combinations; an AprilTag is looked for on no other pad."""
    names = [name_finder(word) for word in config.regressors]
    return [
        FlightCell(pad.name, name, world.name, weather, severity, gains)
        for gains in config.gains
        for weather, severity in config.weathers
        for name in names
        for pad in pads.values()
        if name != "apriltag" or pad.name == "apriltag"
    ]


def fly_cell(setup: FlightSetup, cell: FlightCell, indices: list[int], clock: Clock) -> list[Episode]:
    """Some episodes of a cell in lockstep: one batched call of the finder for each picture of all that still fly."""
    config, sites, seed = setup.config, setup.sites, setup.seed
    pad, finder, count = setup.pad(cell), setup.finder(cell), len(sites.places)
    begun = perf_counter()
    own = {index: sites.site(pad, index % count) for index in indices}
    clock.rendering += perf_counter() - begun  # pads are lit when they are first asked for
    # episodes of a cell may fly at different places
    centres = np.array([own[index].centre for index in indices])
    flights = Flights(
        config.episode, centres, WorldGround(sites.world), seed=seed, indices=indices, view_tan=sites.optics.view_tan
    )
    fly(
        flights,
        make_look(own, seed, (cell.weather, cell.severity), finder, clock),
        parse_gains(cell.gains),
        config.descent,
    )
    return flights.episodes


def make_look(sites: dict[int, PadSite], seed: int, weather: tuple[str, int], finder: PadFinder, clock: Clock) -> Look:
    """Pictures of a drone's camera, and a finder's answers to them."""

    def look(indices: np.ndarray, poses: np.ndarray, tick: int) -> np.ndarray:
        begun = perf_counter()
        views = [
            # each frame's draws depend on the seed, the episode and the tick
            (sites[int(index)], SiteView(pose, seed, int(index) * TICKS + tick, weather))
            for index, pose in zip(indices, poses, strict=True)
        ]
        images = np.stack(list(map_ahead(lambda pair: pair[0].photograph(pair[1]), views)))
        seen = perf_counter()
        answers = finder.predict(images)
        clock.rendering += seen - begun
        clock.network += perf_counter() - seen
        return answers

    return look


def _record(cell: FlightCell, inputs: str, places: Sequence[PadPlace], episode: Episode) -> EpisodeRecord:
    place = places[episode.index % len(places)]
    # tracks of the first episodes only: they take far more space than outcomes
    keep = episode.index < KEPT_TRACKS
    track = (np.array(episode.track) - place.centre).round(3).tolist() if keep else []
    seen = (
        [tuple(sight.round(3).tolist()) if np.isfinite(sight).all() else None for sight in episode.seen] if keep else []
    )
    return EpisodeRecord(
        inputs=inputs, pad=cell.pad, regressor=cell.regressor, world=cell.world, weather=cell.weather,
        severity=cell.severity, gains=cell.gains, index=episode.index, place=place.name, outcome=episode.outcome,
        error_m=_rounded(episode.error_m), time_s=round(episode.time_s, 3), path_m=round(episode.path_m, 3),
        speed_m_s=_rounded(episode.speed_m_s), tilt_deg=_rounded(episode.tilt_deg),
        track=[tuple(point) for point in track], seen=seen,
    )  # fmt: skip


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)
