"""Landing episodes: what each draws, how they fly in lockstep, and how each of them ends."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import ceil
from typing import Protocol

import numpy as np

from toolkit.core.draws import Draws
from toolkit.rooms.landing.config import EpisodeConfig
from toolkit.rooms.landing.dynamics import (
    SIMPLE_FLIGHT,
    STATE,
    CascadeGains,
    Multirotor,
    MultirotorState,
    VelocityControl,
    advance,
)

# of AirSim's own physics
STEP_S = 0.003
GUST_STEP_S = 0.1
FLYING = ""
OUTCOMES = ("success", "missed", "crashed", "lost", "timed_out", "diverged")
"""`success`: touchdown near the centre, slow and level; `missed`: as soft, but too far off; `crashed`: against
something, or too fast or tilted; `lost`: the pad's centre out of view for too long; `diverged`: out of control."""
FARTHEST_M = 200.0
STEEPEST_DEG = 80.0

Look = Callable[[np.ndarray, np.ndarray, int], np.ndarray]
"""(m,) indices of episodes, (m, 4, 4) `T_world_camera`, tick -> (m, 2) the pad's (x, y) in each camera's frame, metres;
NaN where it was not found."""


class Ground(Protocol):
    """The ground and obstacles of a flight."""

    def height_below(self, points: np.ndarray) -> np.ndarray:
        """(n,) height of the first surface under points (n, 3), metres; -inf where there is none."""
        ...

    def is_hit(self, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
        """(n,) bool whether something lies between points (n, 3) and (n, 3)."""
        ...


@dataclass(frozen=True)
class FlatGround:
    """An endless plane."""

    height_m: float = 0.0

    def height_below(self, points: np.ndarray) -> np.ndarray:
        """The plane's, everywhere."""
        return np.full(len(points), self.height_m)

    def is_hit(self, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
        """Never: what goes through the plane has touched it."""
        return np.zeros(len(start), bool)


@dataclass(frozen=True)
class EpisodeDraws:
    """Random conditions of episode `index` of a seed; they depend on these two alone."""

    offset: np.ndarray  # (3,) of the start from the pad's centre, metres, in the world
    yaw_rad: float  # its heading, held throughout
    wind: np.ndarray  # (3,) steady, m/s
    gusts: np.ndarray  # (k, 3) for each tenth of a second, m/s
    gimbal: np.ndarray  # (t + 1, 2) turns of the camera about its x and y at each picture, rad

    @classmethod
    def of(cls, config: EpisodeConfig, seed: int, index: int) -> "EpisodeDraws":
        """Drawn part by part, so that another wind leaves the start as it was."""
        draws = Draws(seed, index, "landing")
        rng = draws.of("start")
        height, angle = rng.uniform(*config.start_height_m), np.radians(rng.uniform(*config.start_angle_deg))
        around, yaw = rng.uniform(0, 2 * np.pi, 2)
        # the start is on a cone that stands on the pad
        aside = height * np.tan(angle)
        rng = draws.of("wind")
        speed, bearing = rng.uniform(*config.wind_m_s), rng.uniform(0, 2 * np.pi)
        steps = ceil(config.time_limit_s / GUST_STEP_S) + 1
        # half as strong upwards as level
        noise = draws.of("gusts").standard_normal((steps, 3)) * [1.0, 1.0, 0.5]
        # an Ornstein-Uhlenbeck process at its steps: the spread stays 1, however fine they are
        keep = float(np.exp(-GUST_STEP_S / config.gust_time_s))
        gusts = np.empty_like(noise)
        gusts[0] = noise[0]
        for k in range(1, steps):
            gusts[k] = keep * gusts[k - 1] + (1 - keep * keep) ** 0.5 * noise[k]
        ticks = ceil(config.time_limit_s * config.camera_hz) + 1
        rng, spread = draws.of("gimbal"), np.radians(config.gimbal_error_deg)
        return cls(
            np.array([aside * np.cos(around), aside * np.sin(around), height]), float(yaw),
            speed * np.array([np.cos(bearing), np.sin(bearing), 0.0]), config.gust_m_s * gusts,
            spread * (rng.standard_normal(2) + rng.standard_normal((ticks, 2)) / 3),
        )  # fmt: skip


@dataclass
class Episode:
    """How an episode went."""

    index: int
    outcome: str = FLYING  # from `OUTCOMES`, or `FLYING`
    error_m: float | None = None  # distance of its end from the pad's centre, level; None where it never came down
    time_s: float = 0.0  # how long it took
    path_m: float = 0.0  # length of its way
    speed_m_s: float | None = None  # speed_m_s, tilt_deg: at touchdown
    tilt_deg: float | None = None
    track: list[np.ndarray] = field(default_factory=list)  # places (3,) at each picture
    # what the regressor said of each picture, (2,), as an offset in the world
    seen: list[np.ndarray] = field(default_factory=list)


class Flights:
    """Episodes in lockstep, from picture to picture: poses of their cameras out, velocities in."""

    def __init__(
        self, config: EpisodeConfig, pads: np.ndarray, ground: Ground, *, seed: int, indices: "list[int]",
        view_tan: float = 1.0, vehicle: Multirotor = SIMPLE_FLIGHT, gains: CascadeGains = CascadeGains(),
    ) -> None:  # fmt: skip
        """Put them at their starts.

        Args:
            pads: (3,) the pad's centre in the world, metres, or (n, 3) of each episode's own.
            view_tan: tangent of half the camera's angle of view, for `lost`.
        """
        self.config, self.ground, self._vehicle = config, ground, vehicle
        # a pad for all, or a pad for each
        self.pads = np.broadcast_to(np.asarray(pads, float), (len(indices), 3))
        draws = [EpisodeDraws.of(config, seed, index) for index in indices]
        self.episodes = [Episode(index) for index in indices]
        self.yaw = np.array([draw.yaw_rad for draw in draws])
        self._wind = np.array([draw.wind for draw in draws])
        self._gusts, self._gimbal = np.array([draw.gusts for draw in draws]), np.array([draw.gimbal for draw in draws])
        # starts are drawn around each episode's own pad
        start = self.pads + np.array([draw.offset for draw in draws])
        self.state = MultirotorState.at(start.T, self.yaw, vehicle.hover_signal)
        self._control = VelocityControl(len(indices), gains)
        # commands that wait for their latency to pass, as (time, velocity)
        self._command, self._waiting = np.zeros((3, len(indices))), []  # type: ignore[var-annotated]
        self._view_tan, self._unseen = view_tan, np.zeros(len(indices))
        self.tick, self._step = 0, 0

    @property
    def flying(self) -> np.ndarray:
        """(m,) numbers of those that have not ended."""
        return np.array([k for k, episode in enumerate(self.episodes) if episode.outcome == FLYING], int)

    @property
    def time_s(self) -> float:
        """Since the start."""
        return self._step * STEP_S

    def camera_poses(self, chosen: np.ndarray) -> np.ndarray:
        """(m, 4, 4) `T_world_camera` of downward cameras, the top of the picture ahead; the mount's error in them."""
        cosine, sine = np.cos(self.yaw[chosen]), np.sin(self.yaw[chosen])
        tilt = self._gimbal[chosen, min(self.tick, self._gimbal.shape[1] - 1)]
        return place_cameras(self.state.position[:, chosen].T, cosine, sine, tilt)

    def level_offsets(self, seen: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """(m, 2) in the world, from (m, 2) in the cameras' frames, as a level camera would have seen them."""
        cosine, sine = np.cos(self.yaw[chosen]), np.sin(self.yaw[chosen])
        x, y = seen.T
        return np.array([x * sine - y * cosine, -x * cosine - y * sine]).T

    def advance(self, velocity: np.ndarray) -> None:
        """Fly to the next picture; a command begins to act after the latency.

        Args:
            velocity: (3, n) of all episodes, in the world, m/s; those that have ended are left where they are.
        """
        chosen = self.flying
        self.tick += 1
        # from the tick, not added up: pictures keep their times however the steps divide
        last = round(self.tick / self.config.camera_hz / STEP_S)
        if not len(chosen):
            self._step = last
            return
        before = self.state.position.T.copy()
        # the track has a point for each picture
        for k in chosen:
            self.episodes[k].track.append(before[k])
        # a velocity that is not a number means standing still
        self._waiting.append((self.time_s + self.config.latency_s, np.nan_to_num(velocity, posinf=0.0, neginf=0.0)))
        # a ray for each picture, not for each step of 3 ms
        below = self.ground.height_below(before[chosen])
        state, control = self.state.part(chosen), self._control.part(chosen)
        way = np.zeros(len(chosen))
        while self._step < last and len(chosen):
            self._step += 1
            moved = self._make_step(state, control, chosen)
            way += np.sqrt(((moved.position - state.position) ** 2).sum(axis=0))
            state = moved
            # not `<=`: a height that is no number has ended too
            ended = ~(state.position[2] > below)
            if ended.any() or self._step == last:
                self._store(chosen, state, control, way)
                self._judge(chosen, ended)
                flying = np.array([self.episodes[k].outcome == FLYING for k in chosen])
                chosen, below, state, control = chosen[flying], below[flying], state.part(flying), control.part(flying)
                way = np.zeros(len(chosen))
        self._step = last
        self._judge_sight(chosen, before)

    def _make_step(self, state: MultirotorState, control: VelocityControl, chosen: np.ndarray) -> MultirotorState:
        # a hair later: times are sums of steps, which round
        while self._waiting and self._waiting[0][0] <= self.time_s + 1e-9:
            self._command = self._waiting.pop(0)[1]
        gust = self._gusts[chosen, min(int(self.time_s / GUST_STEP_S), self._gusts.shape[1] - 1)]
        wind = (self._wind[chosen] + gust).T
        with np.errstate(all="ignore"):  # what overflows ends the episode
            signals = control.signals(state, self._command[:, chosen], self.yaw[chosen], STEP_S)
            return advance(self._vehicle, state, signals, wind, STEP_S)

    def _store(self, chosen: np.ndarray, state: MultirotorState, control: VelocityControl, way: np.ndarray) -> None:
        for name in STATE:
            getattr(self.state, name)[:, chosen] = getattr(state, name)
        self._control.put(chosen, control)
        for k, length in zip(chosen, way, strict=True):
            self.episodes[k].path_m += float(np.nan_to_num(length))

    def _judge(self, chosen: np.ndarray, down: np.ndarray) -> None:
        """End what has touched down, and what is out of control."""
        config, state = self.config, self.state.part(chosen)
        tilt, speed = np.degrees(state.tilt), np.sqrt((state.velocity**2).sum(axis=0))
        # offsets from each drone's own pad
        away = state.position - self.pads[chosen].T
        level = np.hypot(away[0], away[1])
        fine = np.isfinite(state.position).all(axis=0) & np.isfinite(speed) & np.isfinite(tilt)
        # asked so that NaN counts as wild
        wild = ~(fine & (tilt <= STEEPEST_DEG) & (level <= FARTHEST_M) & (away[2] <= FARTHEST_M))
        for j, k in enumerate(chosen):
            # out of control comes first: a position that is not finite tells nothing else
            if wild[j]:
                self._end(k, "diverged")
            elif down[j]:
                # a landing is gentle and level; within the radius it is a success
                hard = speed[j] > config.touchdown_m_s or tilt[j] > config.touchdown_tilt_deg
                self._end(k, "crashed" if hard else "success" if level[j] <= config.radius_m else "missed")
                episode = self.episodes[k]
                episode.error_m, episode.speed_m_s, episode.tilt_deg = float(level[j]), float(speed[j]), float(tilt[j])

    def _judge_sight(self, chosen: np.ndarray, before: np.ndarray) -> None:
        """End what flew against something, has the pad out of view for too long, or has no time left."""
        if not len(chosen):
            return
        places = self.state.position.T[chosen]
        hit = self.ground.is_hit(before[chosen], places)
        offset = self.level_frame(places, chosen)
        height = np.maximum(places[:, 2] - self.pads[chosen, 2], 1e-6)
        # low over the pad it no longer fits the view, which is not losing it
        out = (np.abs(offset) > self._view_tan * height[:, None]).any(axis=1) & (height > self.config.radius_m)
        # how long the pad has been out of view without a break
        self._unseen[chosen] = np.where(out, self._unseen[chosen] + 1 / self.config.camera_hz, 0.0)
        for j, k in enumerate(chosen):
            if hit[j]:
                self._end(k, "crashed")
            elif self._unseen[k] >= self.config.lost_s:
                self._end(k, "lost")
            elif self.time_s >= self.config.time_limit_s - 1e-9:
                self._end(k, "timed_out")

    def level_frame(self, places: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """(m, 2) the pad's (x, y) in the frame of level cameras at places (m, 3): right and back."""
        # the mirror between the two frames is its own inverse
        return self.level_offsets(self.pads[chosen, :2] - places[:, :2], chosen)

    def _end(self, k: int, outcome: str) -> None:
        episode, place = self.episodes[k], self.state.position[:, k]
        episode.outcome, episode.time_s = outcome, self.time_s
        if np.isfinite(place).all():
            episode.track.append(place.copy())


def draw_in_cone(
    rng: np.random.Generator, height_m: tuple[float, float], half_angle_deg: float
) -> tuple[np.ndarray, float]:
    """(3,) a camera's place over the pad's centre, in a cone that stands on it, metres; and its heading, rad."""
    # even in the logarithm: as many pictures of each doubling of the height
    height = np.exp(rng.uniform(*np.log(height_m)))
    yaw, around = rng.uniform(0, 2 * np.pi, 2)
    # the root spreads cameras evenly over the disc at this height
    aside = height * np.tan(np.radians(half_angle_deg)) * rng.uniform() ** 0.5
    return np.array([aside * np.cos(around), aside * np.sin(around), height]), float(yaw)


def place_cameras(places: np.ndarray, cosine: np.ndarray, sine: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """(m, 4, 4) `T_world_camera` of cameras that look down from (m, 3), the top of the picture to the heading.

    Args:
        places: metres.
        cosine, sine: (m,) of the heading.
        tilt: (m, 2) small turns about the camera's own x and y, rad.
    """
    count = len(places)
    # camera axes as columns: x right, y down in the picture, z along the look, which is down
    level = np.zeros((count, 3, 3))
    level[:, 0, 0], level[:, 1, 0] = sine, -cosine  # right of the heading
    level[:, 0, 1], level[:, 1, 1] = -cosine, -sine  # down in the picture: back
    level[:, 2, 2] = -1.0
    (cx, cy), (sx, sy) = np.cos(tilt).T, np.sin(tilt).T
    turn = np.zeros((count, 3, 3))  # about x, then about y
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 0, 2] = cy, sy * sx, sy * cx
    turn[:, 1, 1], turn[:, 1, 2] = cx, -sx
    turn[:, 2, 0], turn[:, 2, 1], turn[:, 2, 2] = -sy, cy * sx, cy * cx
    pose = np.tile(np.eye(4), (count, 1, 1))
    for k in range(3):  # sums spelt out, as in `dynamics`
        pose[:, :3, k] = (level * turn[:, None, :, k]).sum(axis=2)
    pose[:, :3, 3] = places
    return pose
