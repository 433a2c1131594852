"""`toolkit landing demo`: from an empty folder to the report, small."""

from dataclasses import dataclass
from pathlib import Path

from toolkit.core.console import notice
from toolkit.core.workspace import Workspace
from toolkit.rooms.landing.boost import Boosted, boost_pad
from toolkit.rooms.landing.collect import collect
from toolkit.rooms.landing.config import (
    BoostConfig,
    CameraConfig,
    CollectConfig,
    DemoConfig,
    FlyConfig,
    LandingTrainConfig,
)
from toolkit.rooms.landing.flight_report import (
    CellResult,
    PairResult,
    film_episode,
    place_results,
    write_report,
    write_summary,
)
from toolkit.rooms.landing.fly import fly_all
from toolkit.rooms.landing.train import TrainedRegressor, train_regressor
from toolkit.rooms.worlds.conditions import parse_weathers

NAME = "demo"
BOOSTED_IN = ("snow:1-4", "fog:4-5")
"""Weather that the pad meets in training; under lying snow the plain pad is lost."""


@dataclass(frozen=True)
class Demonstrated:
    """Results of the demonstration."""

    trained: TrainedRegressor
    boosted: Boosted
    results: list[CellResult]
    pairs: list[PairResult]
    report: Path
    film: Path


def run_demo(space: Workspace, config: DemoConfig, seed: int = 0, device: str = "cpu") -> Demonstrated:
    """Collect, train, boost, fly plain and boosted pads, report; what is there already is taken up.

    Raises:
        ToolkitError: a step cannot be done.
    """
    optics = CameraConfig(image_px=config.image_px)
    notice("1 of 4: collect")
    collect(space, CollectConfig(name=NAME, frames=config.frames, optics=optics), seed)
    notice("2 of 4: train")
    training = LandingTrainConfig(name=NAME, epochs=config.epochs, batch=32)
    trained = train_regressor(space, NAME, training, seed=seed, device=device)
    notice("3 of 4: boost")
    # a tenth of the frames' number, within bounds
    views = max(8, min(240, config.frames // 10))
    boosting = BoostConfig(steps=config.steps, views=views, weathers=parse_weathers(BOOSTED_IN))
    boosted = boost_pad(space, NAME, boosting, seed=seed, device=device)
    notice("4 of 4: fly")
    flying = FlyConfig(
        regressors=(NAME,), pads=("plain", boosted.file.stem), weathers=parse_weathers(config.weathers),
        episodes=config.episodes, places=4,
    )  # fmt: skip
    flown = fly_all(space, flying, seed=seed, device=device)
    flown = place_results(flying, flown, seed)
    results, pairs = write_summary(flown.folder, flying, flown, seed)
    film = film_episode(space, flying, flown, results[-1].records[0], seed)
    report = write_report(flying, flown, results, pairs, space, [film])
    return Demonstrated(trained, boosted, results, pairs, report, film.write(flown.folder / "episode.mp4"))
