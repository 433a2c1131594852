"""One field of grass for all tests of landings: it is lit once."""

import pytest

from toolkit.rooms.landing.config import CameraConfig
from toolkit.rooms.landing.site import PadSite, draw_pad, find_sky, find_world, plan_places
from toolkit.rooms.worlds.world import World


@pytest.fixture(scope="session")
def grass() -> World:
    return find_world("grass")


@pytest.fixture(scope="session")
def site(grass: World) -> PadSite:
    place = plan_places(grass, 2.0, 2)[1]
    return PadSite(grass, place, find_sky("overcast"), draw_pad("plain"), CameraConfig(image_px=64))
