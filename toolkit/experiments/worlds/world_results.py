"""The answers of a run beside what they were given to, and its `predictions.csv` and `cameras.csv`."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from toolkit.captures.read import UNPATCHED
from toolkit.core.tables import encode_csv
from toolkit.evaluation.metrics import rank_variant
from toolkit.evaluation.predict import OK
from toolkit.evaluation.predictions_csv import NEEDED
from toolkit.experiments.worlds.answers import Answers, WeatherKey
from toolkit.experiments.worlds.cameras import GridCamera, PlaceCameras
from toolkit.experiments.worlds.config import WorldEvalConfig
from toolkit.experiments.worlds.frames import Stage
from toolkit.experiments.worlds.keep import name_picture
from toolkit.models.network import Classifier
from toolkit.objects.load import TableObject
from toolkit.worlds.weather import make_weather

SOURCE = "sim"
SEEN = ("azimuth_deg", "elevation_deg", "distance_m", "visible_share", "picture_share")
"""What is known of every camera."""
COLUMNS = (*NEEDED, "world", "place", "weather", "severity", "visibility_m", *SEEN)
CAMERA_COLUMNS = ("place", "pose_id", "x_m", "y_m", "z_m", "left_out", *SEEN)


@dataclass(frozen=True)
class WorldResults:
    """What the network said, and of what.

    Attributes:
        config: of the run.
        classifier: who was asked.
        item: the object.
        true_index: its class.
        stage: world, sky, camera, places and variants.
        places: cameras at each place.
        answers: by variant and weather, of all cameras of all places, in order.
        renderer: the simulator that made the pictures; None of our own.
    """

    config: WorldEvalConfig
    classifier: Classifier
    item: TableObject
    true_index: int
    stage: Stage
    places: tuple[PlaceCameras, ...]
    answers: dict[tuple[str, WeatherKey], Answers]
    renderer: str | None = None

    @cached_property
    def variants(self) -> list[str]:
        """Names, `unpatched` first."""
        return sorted(self.stage.variants, key=lambda name: (name != UNPATCHED, rank_variant(name)))

    @property
    def weathers(self) -> tuple[WeatherKey, ...]:
        """Clear air first."""
        return self.config.weathers

    @cached_property
    def cameras(self) -> list[GridCamera]:
        """Of all places, in the order of the answers."""
        return [camera for place in self.places for camera in place.cameras]

    @cached_property
    def place_of(self) -> np.ndarray:
        """(n,) int, number of the place of each camera."""
        return np.repeat(np.arange(len(self.places)), [len(place.cameras) for place in self.places])

    @cached_property
    def place_names(self) -> list[str]:
        """Of the places, in order."""
        return [place.placed.spot.name for place in self.places]

    def column(self, name: str) -> np.ndarray:
        """(n,) one number of every camera, such as `distance_m`."""
        return np.array([getattr(camera, name) for camera in self.cameras], float)

    @property
    def length_m(self) -> float:
        """Longest side of the object."""
        return float(np.ptp(self.stage.places[0].mesh.bounds, axis=0).max())

    @property
    def world_name(self) -> str:
        """Of the world, with its seed, such as `city/0`."""
        return f"{self.stage.world.name}/{self.stage.world.seed}"


def find_visibility_m(weather: WeatherKey) -> float | None:
    """At 5 % contrast, metres; None in clear air."""
    visibility = make_weather(*weather).visibility_m
    return None if np.isinf(visibility) else round(visibility, 3)


def encode_predictions(results: WorldResults) -> str:
    """The text of `predictions.csv`: one row per picture."""
    return encode_csv(COLUMNS, _list_predictions(results))


def _list_predictions(results: WorldResults) -> Iterator[list[object]]:
    labels, name = results.classifier.labels, results.item.name
    for variant in results.variants:
        for weather in results.weathers:
            found, visibility = results.answers[variant, weather], find_visibility_m(weather)
            for k, camera in enumerate(results.cameras):
                place = results.place_names[results.place_of[k]]
                rank, first = int(found.true_rank[k]), int(found.top1_index[k])
                path = f"{place}/{variant}/{camera.number:04d}/{name_picture(weather)}.png"
                yield [
                    SOURCE, name, variant, camera.number, path, results.true_index, labels[results.true_index], first,
                    labels[first], f"{found.top1_prob[k]:.6f}", f"{found.true_prob[k]:.6g}", rank, int(rank == 1),
                    int(rank <= 5), OK, results.world_name, place, *weather, visibility, *_describe_camera(camera),
                ]  # fmt: skip


def encode_cameras(results: WorldResults) -> str:
    """The text of `cameras.csv`: one row per point of the grid, whether a camera stands there and what it sees."""
    rows: list[list[object]] = []
    for place in results.places:
        shot = {camera.number: camera for camera in place.cameras}
        for k, (point, reason) in enumerate(zip(place.points, place.reasons, strict=True)):
            camera = shot.get(k + 1)
            left_out = reason or ("" if camera else "not in the sample")
            own = _describe_camera(camera) if camera else [""] * 5
            rows.append([place.placed.spot.name, k + 1, *np.round(point, 4).tolist(), left_out, *own])
    return encode_csv(CAMERA_COLUMNS, rows)


def _describe_camera(camera: GridCamera) -> list[object]:
    return [getattr(camera, name) for name in SEEN]
