"""The report of flights: one HTML file, its figures within; and the film of an episode."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toolkit.core.files import write_bytes
from toolkit.core.workspace import Workspace
from toolkit.evaluation.page import write_page
from toolkit.landing.config import CameraConfig, FlyConfig
from toolkit.landing.episodes import OUTCOMES, Flights
from toolkit.landing.flight_figures import draw_success, draw_tracks, write_film
from toolkit.landing.flight_results import CellResult, PairResult, describe_success
from toolkit.landing.fly import TICKS, EpisodeRecord, Flown
from toolkit.landing.pads import find_pad
from toolkit.landing.regressor import list_regressors, load_regressor
from toolkit.landing.site import PadSite, View, find_sky, find_world
from toolkit.rig.raycast import map_frames
from toolkit.worlds.weather import describe_weathers


@dataclass(frozen=True)
class ReportFiles:
    """Where the files are; no film where none was asked for."""

    report: Path
    success: Path
    tracks: Path
    film: Path | None = None


def write_report(
    config: FlyConfig, flown: Flown, results: Sequence[CellResult], pairs: Sequence[PairResult], space: Workspace
) -> ReportFiles:
    """Write `report.html`, `success.png` and `tracks.png`."""
    folder, success, tracks = flown.folder, draw_success(results), draw_tracks(results, config.episode.radius_m)
    own = list_regressors(space)
    errors = [
        load_regressor(space, name).record
        for name in dict.fromkeys(one.cell.regressor for one in results)
        if name in own
    ]
    context = {
        "title": folder.name, "results": results, "pairs": pairs, "outcomes": OUTCOMES[1:],
        "success_is": describe_success(config.episode), "weathers": describe_weathers(config.weathers),
        "settings": [row for row in config.rows() if row[0] != "weathers"], "records": errors, "places": flown.places,
        "success": success, "tracks": tracks,
    }  # fmt: skip
    page = write_page(folder / "report.html", "toolkit.landing", "flights.html.j2", context)
    return ReportFiles(page, write_bytes(folder / "success.png", success), write_bytes(folder / "tracks.png", tracks))


def film_episode(
    space: Workspace, config: FlyConfig, flown: Flown, record: EpisodeRecord, seed: int, path: Path
) -> Path:
    """A film of an episode whose track was kept: what its camera saw is rendered again along the track.

    Args:
        space: the workspace.
        config, flown: of the flights.
        record: the episode.
        seed: of the flights.
        path: where to.
    """
    number = record.index % len(flown.places)
    trained = [load_regressor(space, name).record for name in config.regressors if name in list_regressors(space)]
    optics = CameraConfig(image_px=trained[0].image_px, fov_deg=trained[0].fov_deg) if trained else CameraConfig()
    size_m = config.size_m or (trained[0].size_m if trained else 2.0)
    pad = next(pad for pad in (find_pad(space, word, size_m, seed) for word in config.pads) if pad.name == record.pad)
    world = find_world(config.world, config.world_seed)
    site = PadSite(world, flown.places[number], find_sky(config.time), pad, optics)
    flights = Flights(config.episode, site.centre, site.ground, seed=seed, indices=[record.index])
    views = []
    for tick, place in enumerate(record.track[:-1]):
        flights.tick, flights.state.position[:, 0] = tick, site.centre + np.array(place)
        pose = flights.camera_poses(np.array([0]))[0]
        views.append(View(pose, seed, record.index * TICKS + tick, (record.weather, record.severity)))
    pictures = list(map_frames(site.photograph, views))
    title = f"{record.cell.key}, episode {record.index}"
    return write_film(path, pictures, record, title, config)
