"""The classical finders, on rendered pads."""

import numpy as np
import pytest

from toolkit.rooms.landing.baselines import ClassicalFinder, make_apriltag, make_features
from toolkit.rooms.landing.config import CameraConfig
from toolkit.rooms.landing.episodes import place_cameras
from toolkit.rooms.landing.site import PadSite, SiteView, draw_pad


@pytest.mark.parametrize(("kind", "make"), [("plain", make_features), ("apriltag", make_apriltag)])
def test_they_find_a_pad_that_is_near(site: PadSite, kind: str, make: object) -> None:
    near = PadSite(site.world, site.place, site.sky, draw_pad(kind), CameraConfig(image_px=128))
    baseline: ClassicalFinder = make(near.pad, near.camera)  # type: ignore[operator]
    errors = []
    for k, offset in enumerate(((0.2, 0.1, 2.5), (-0.4, 0.3, 3.0), (0.1, -0.5, 3.0))):
        pose = place_cameras(near.centre[None] + [offset], np.cos([k]), np.sin([k]), np.zeros((1, 2)))[0]
        seen = baseline.predict(near.photograph(SiteView(pose, 0, k))[None])[0]
        errors.append(np.linalg.norm(seen - near.truth(pose)[:2]))
    assert np.nanmax(errors) < 0.08
    assert np.isfinite(errors).sum() >= 2


def test_they_say_so_where_there_is_none(site: PadSite) -> None:
    nothing = np.full((2, 64, 64, 3), 90, np.uint8)
    for make in (make_features, make_apriltag):
        assert np.isnan(make(draw_pad("apriltag"), site.camera).predict(nothing)).all()
