"""The map beside a film says what the flight was judged by."""

import numpy as np
import pytest
from test_fly import record

from toolkit.rooms.landing.config import FlyConfig
from toolkit.rooms.landing.flight_report import CellResult, draw_map, pick_cells
from toolkit.rooms.landing.fly import EpisodeRecord, FlightCell

GREEN, ORANGE = (0, 122, 90), (194, 65, 12)
HEIGHTS_M = (4.0, 2.0, 0.9, 0.7, -0.01)


def flight() -> EpisodeRecord:
    track = [(1.5, 0.0, height) for height in HEIGHTS_M]
    return record("plain", 0, "success").model_copy(update={"track": track, "seen": [(-1.0, 0.4)] * 4})


def find(canvas: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    return np.argwhere((canvas == colour).all(axis=2))


def test_the_circle_is_the_one_of_a_success() -> None:
    wide = {}
    for radius_m in (0.4, 0.8):
        config = FlyConfig(regressors=("net",), episode={"radius_m": radius_m})
        wide[radius_m] = np.ptp(find(draw_map(flight(), 4, config), GREEN)[:, 0])
    assert wide[0.8] == pytest.approx(2 * wide[0.4], abs=6)


@pytest.mark.parametrize("airs", [2, 4, 7, 20])
def test_tracks_are_drawn_of_every_pad(airs: int) -> None:
    pads = ("plain", "boosted")
    cells = [FlightCell(pad, "net", "grass", "fog", air, "gentle") for air in range(airs) for pad in pads]
    picked = pick_cells([CellResult(cell, ()) for cell in cells], 9)
    assert len(picked) == min(9, len(cells))
    assert {one.cell.pad for one in picked} == set(pads)
    assert (picked[0].cell, picked[-1].cell) == (cells[0], cells[-1])


def test_what_is_no_more_looked_at_is_not_drawn() -> None:
    """Below 0.8 m the pilot goes straight down."""
    config = FlyConfig(regressors=("net",))
    drawn = [len(find(draw_map(flight(), k, config), ORANGE)) > 0 for k in range(5)]
    assert drawn == [True, True, True, False, False]
