"""Landing as a Gymnasium environment: the camera's picture in, a velocity out. It needs the extra `landing`."""

from typing import TYPE_CHECKING, Any

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.extras import import_package
from toolkit.rooms.landing.config import CameraConfig, EpisodeConfig
from toolkit.rooms.landing.episodes import FLYING, Flights
from toolkit.rooms.landing.fly import TICKS
from toolkit.rooms.landing.site import Pad, PadSite, SiteView, draw_pad, find_sky, find_world, plan_places
from toolkit.rooms.worlds.conditions import CLEAR

if TYPE_CHECKING:
    import gymnasium
else:
    gymnasium = import_package("gymnasium", "landing", "the landing environment")

MOST_M_S = 6.0
REWARDS = {"success": 10.0}
FAILURE = -10.0


class LandingEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A drone above a pad.

    Observations are (h, w, 3) uint8 sRGB pictures of the downward camera. Actions are (3,) float32 velocities in m/s
    along the heading, to its left and up, each within ±6. The reward is how much nearer the pad is after the step,
    metres, and at the end 10 for a success, -10 for anything else. `reset(seed=…)` begins at episode 0 of that seed,
    further resets begin the next.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012, Gymnasium's own

    def __init__(
        self, world: str = "grass", pad: Pad | None = None, *, episode: EpisodeConfig | None = None,
        optics: CameraConfig | None = None, weather: tuple[str, int] = CLEAR, time: str = "noon", places: int = 4,
        render_mode: str | None = "rgb_array",
    ) -> None:  # fmt: skip
        """Build the world and light it.

        Args:
            world: a built-in world, or a file.
            pad: what is landed on; by default a plain pad of 2 m.
            episode: starts, winds and what counts as a success.
            weather: (name, severity).
            render_mode: `rgb_array`: `render` gives the last picture.
        """
        self.episode, self.optics = episode or EpisodeConfig(), optics or CameraConfig()
        self.weather, self.render_mode = weather, render_mode
        pad, built = pad or draw_pad("plain"), find_world(world)
        self._sites = [
            PadSite(built, place, find_sky(time), pad, self.optics) for place in plan_places(built, pad.size_m, places)
        ]
        side = self.optics.image_px
        self.observation_space = gymnasium.spaces.Box(0, 255, (side, side, 3), np.uint8)
        self.action_space = gymnasium.spaces.Box(-MOST_M_S, MOST_M_S, (3,), np.float32)
        self._seed, self._index = 0, -1
        self._flights: Flights | None = None
        self._picture = np.zeros((side, side, 3), np.uint8)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin the next episode, or with a seed its first; `options={"index": k}` begins episode k."""
        super().reset(seed=seed)
        if seed is not None:
            self._seed, self._index = seed, -1
        # an episode's number decides all of its draws
        self._index = int((options or {}).get("index", self._index + 1))
        site = self._site
        self._flights = Flights(
            self.episode, site.centre, site.ground, seed=self._seed, indices=[self._index],
            view_tan=self.optics.view_tan,
        )  # fmt: skip
        return self._look(), self._info()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Fly at a velocity to the next picture."""
        if self._flights is None:
            raise ToolkitError("no episode has begun: call reset first")
        flights = self._flights
        before = self._distance()
        # actions are in the drone's frame, forward, left, up; the world's frame turns with the heading
        ahead, left, up = np.asarray(action, float)
        cosine, sine = np.cos(flights.yaw[0]), np.sin(flights.yaw[0])
        flights.advance(np.array([[ahead * cosine - left * sine], [ahead * sine + left * cosine], [up]]))
        outcome = flights.episodes[0].outcome
        # metres nearer to the pad: summed over an episode it is the way come nearer, however it was flown
        reward = before - self._distance()
        if outcome != FLYING:
            reward += REWARDS.get(outcome, FAILURE)
        # Gymnasium tells an episode that ended (terminated) from one that ran out of time (truncated)
        is_late = outcome == "timed_out"
        return self._look(), float(np.nan_to_num(reward)), outcome != FLYING and not is_late, is_late, self._info()

    def render(self) -> np.ndarray:
        """(h, w, 3) uint8 the last picture."""
        return self._picture

    @property
    def _site(self) -> PadSite:
        return self._sites[self._index % len(self._sites)]

    def _distance(self) -> float:
        assert self._flights is not None
        return float(np.linalg.norm(self._flights.state.position[:, 0] - self._site.centre))

    def _look(self) -> np.ndarray:
        assert self._flights is not None
        if np.isfinite(self._flights.state.position).all():
            pose = self._flights.camera_poses(np.array([0]))[0]
            item = self._index * TICKS + self._flights.tick
            self._picture = self._site.photograph(SiteView(pose, self._seed, item, self.weather))
        return self._picture

    def _info(self) -> dict[str, Any]:
        assert self._flights is not None
        place = self._flights.state.position[:, 0]
        offset = self._flights.level_frame(place[None], np.array([0]))[0]
        episode = self._flights.episodes[0]
        return {"index": self._index, "outcome": episode.outcome, "offset_m": offset, "time_s": self._flights.time_s,
                "height_m": float(place[2] - self._site.centre[2])}  # fmt: skip
